"""Closed loops small enough to know everything of: σ(q) = √q of φ = y² − q, σ(q) = c q, and plain linear ones."""

from types import SimpleNamespace

import numpy as np

from ccpin.validated.arithmetic.tape import Tape
from ccpin.validated.model.closed_loop import ClosedLoop


def parabola():
    """Y² = q; q̈ = y q̇, so F(q, v) = (v, √q v)."""
    tape = Tape(3)
    q, y, v = tape.inputs
    speed = tape.solve([[2 * y]], [[v]])[0, 0]
    return loop(tape, 2, 1, [y * y - q], [v, speed, y * v])


def lines(*slopes):
    """X_k = c_k q for dependent coordinates."""
    tape = Tape(2 + len(slopes))
    q, *x, v = tape.inputs
    slopes = [exact(c) for c in slopes]
    return loop(
        tape,
        1 + len(slopes),
        1,
        [a - q * c for a, c in zip(x, slopes, strict=True)],
        [v, *(v * c for c in slopes), q * 0 + v],
    )


def linear(stiffness, damping):
    """Nothing depends: q̈ = −Kq − Cv."""
    n = len(stiffness)
    tape = Tape(2 * n)
    q, v = tape.inputs[:n], tape.inputs[n:]
    pull = [
        sum((x * exact(-K[k]) for k, x in enumerate(q)), 0) + sum((x * exact(-C[k]) for k, x in enumerate(v)), 0)
        for K, C in zip(stiffness, damping, strict=True)
    ]
    return loop(tape, n, n, [], [*v, *pull])


class KnownLoop(SimpleNamespace):
    """What a `ClosedLoop` tells, as far as it is asked for."""

    at_rest = ClosedLoop.at_rest


def exact(value):
    from ccpin.validated.arithmetic.balls import rational

    return rational(value)


def loop(tape, n_x, n, closure, field, **more):
    """A closed loop of recorded rows and rates; the first n numbers are q."""
    known = {
        "wrapped": (),
        "upright": (),
        "efforts": None,
        "gains": None,
        "turns": (),
        "left_out": None,
        "scalar": True,
    }
    return KnownLoop(
        n_x=n_x,
        n=n,
        independent=tuple(range(n)),
        dependent=tuple(range(n, n_x)),
        closure=tape.program(closure),
        field=tape.program(field),
        near=np.zeros(n_x),
        **known | more,
    )
