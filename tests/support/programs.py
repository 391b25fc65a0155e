"""Programs evaluated in exact numbers: instructions with constants as they are recorded, in balls of many bits."""

from fractions import Fraction

import flint
import numpy as np

from ccpin.programs.instructions import Kind

BITS = 200


def ball_of(value):
    """A rational or a double as a ball."""
    exact = Fraction(value)
    return flint.arb(flint.fmpq(exact.numerator, exact.denominator))


def exact_gain(w, order):
    """A derivative of g(w) = 2 arccos(w)/√(1 − w²) = 2 ₂F₁(1, 1; 3/2; (1 − w)/2) at a ball, by Gauss's series."""
    factor = flint.arb(2)
    for k in range(order):
        factor = factor * flint.fmpq(-1, 2) * (1 + k) * (1 + k) / (flint.fmpq(3, 2) + k)
    return factor * ((1 - w) / 2).hypgeom_2f1(1 + order, 1 + order, flint.fmpq(3, 2) + order)


def exact_values(code, inputs):
    """All outputs at inputs (balls or doubles), in balls: every kind of instruction without solves, written anew."""
    values = dict(enumerate(x if isinstance(x, flint.arb) else ball_of(float(x)) for x in inputs))
    does = {
        Kind.ADD: lambda i: values[i.a] + values[i.b],
        Kind.SUBTRACT: lambda i: values[i.a] - values[i.b],
        Kind.MULTIPLY: lambda i: values[i.a] * values[i.b],
        Kind.SCALE: lambda i: ball_of(i.constant) * values[i.a],
        Kind.CONSTANT: lambda i: ball_of(i.constant),
        Kind.SINE: lambda i: values[i.a].sin(),
        Kind.COSINE: lambda i: values[i.a].cos(),
        Kind.RECIPROCAL: lambda i: 1 / values[i.a],
        Kind.ROOT: lambda i: values[i.a].sqrt(),
        Kind.ANGLE: lambda i: flint.arb.atan2(values[i.a], values[i.b]),
        Kind.GAIN: lambda i: exact_gain(values[i.a], i.b),
    }
    for item in code.instructions:
        values[item.target] = does[item.kind](item)
    return [values[number] for number in code.outputs]


def exact_sigma(source, q, y, steps=12):
    """σ(q) from near it, by Newton's method in balls whose radii are dropped: to some 50 digits."""
    from ccpin.programs.program_sources import slopes_of

    slopes, m = slopes_of(source.closure, source.dependent), len(y)
    q, y = [ball_of(float(each)) for each in q], [ball_of(float(each)) for each in y]
    for _ in range(steps):
        x = [flint.arb(0)] * source.closure.inputs
        for places, numbers in ((source.independent, q), (source.dependent, y)):
            for place, number in zip(places, numbers, strict=True):
                x[place] = number
        residual = exact_values(source.closure, x)
        table = exact_values(slopes, x)
        matrix = flint.arb_mat(m, m, [entry.mid() for entry in table])
        step = matrix.solve(flint.arb_mat(m, 1, [entry.mid() for entry in residual]))
        y = [(a - b).mid() for a, b in zip(y, step.entries(), strict=True)]
        if max((abs(float(b.mid())) for b in step.entries()), default=0.0) < 1e-50:
            break
    return y


def states(rng, certificate, count):
    """Random inputs (q, what else is read) in a certificate's region, of shape (count, …)."""
    q = rng.uniform(certificate.lower, certificate.upper, (count, len(certificate.lower)))
    return q, certificate.bounds * rng.uniform(-1.0, 1.0, (count, len(certificate.bounds)))


def on_branch(certificate, q):
    """y of shape (N, y) on the branch at points of shape (N, n), by Newton's method in doubles from its cells."""
    from ccpin.programs.evaluation import values_of
    from ccpin.programs.program_sources import slopes_of

    claim, source = certificate.branch.claim, certificate.program.source
    counts = claim.counts
    share = (q - claim.lower) / (claim.upper - claim.lower)
    cell = np.ravel_multi_index(tuple(np.minimum((share * counts).astype(int), counts - 1).T), tuple(counts))
    place = np.stack(np.unravel_index(cell, tuple(counts)), 1)
    centre = claim.lower + (place + 0.5) / counts * (claim.upper - claim.lower)
    y = claim.centre[cell] + np.einsum("bij,bj->bi", claim.slopes[cell], q - centre)
    slopes, m = slopes_of(source.closure, source.dependent), y.shape[1]
    for _ in range(5):
        x = np.zeros((source.closure.inputs, len(q)))
        x[list(source.independent)], x[list(source.dependent)] = q.T, y.T
        residual, table = (
            np.stack(
                [np.broadcast_to(found[k], len(q)) for found in [values_of(code, list(x), np)] for k in code.outputs], 1
            )
            for code in (source.closure, slopes)
        )
        y = y - np.linalg.solve(table.reshape(-1, m, m), residual[..., None])[..., 0]
    return y
