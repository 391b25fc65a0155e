"""Closures written down by hand of which all is known: y = Sq + d, sin(q + y) = 0, and two links that reach a point."""

import numpy as np

from ccpin.proof.bounds import Frame
from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.equations import Closures, Problem, problem_of
from ccpin.proof.newton import Boxes

Y, Z = np.eye(3)[1:]
_PLANE = np.eye(3)[[0, 2]]


def straight(slope, offset=None):
    """φ = y − Sq − d, S of shape (m, n); θ = (q, y), no chains."""
    slope = np.array(slope, dtype=float)
    m, n = slope.shape
    return Closures(
        ClosureSystem(
            chains=(),
            couplings=np.hstack([-slope, np.eye(m)]),
            offset=np.zeros(m) if offset is None else -np.array(offset, dtype=float),
            moduli=np.zeros(m),
            independent=np.arange(n),
            dependent=np.arange(n, n + m),
            periodic=np.zeros(n + m, dtype=bool),
        )
    )


def circles(n=1, planar=False):
    """φ = sin(q₁ + … + y): what turns about one axis leave of a direction; all coordinates close on themselves."""
    size = n + 1
    still, along = np.tile(np.eye(3), (size, 1, 1)), np.tile(Z, (size, 1))
    slides = np.zeros(size, dtype=bool)
    chain = Chain(np.arange(size), still, np.zeros((size, 3)), along, slides, np.eye(3)[0], True, Y[None])
    system = ClosureSystem(
        chains=(chain,),
        couplings=np.zeros((1, size)),
        offset=np.zeros(1),
        moduli=np.zeros(1),
        independent=np.arange(n),
        dependent=np.array([n]),
        periodic=np.ones(size, dtype=bool),
    )
    return Closures(system, planar)


def arm():
    """The problem of two links of length 1 that reach (q₁, 0, q₂), turned by y₁ and y₂: `reached_by` says how."""
    still, along = np.tile(np.eye(3), (2, 1, 1)), np.tile(Y, (2, 1))
    link = np.eye(3)[0]
    chain = Chain(np.array([2, 3]), still, np.array([0.0 * link, link]), along, np.zeros(2, bool), link, False, _PLANE)
    system = ClosureSystem(
        chains=(chain,),
        couplings=np.hstack([-np.eye(2), np.zeros((2, 2))]),
        offset=np.zeros(2),
        moduli=np.zeros(2),
        independent=np.arange(2),
        dependent=np.arange(2, 4),
        periodic=np.array([False, False, True, True]),
    )
    return problem_of(system)


def reached_by(y):
    """θ (…, 4) of the arm turned by y (…, 2)."""
    y = np.array(y, dtype=float)
    first, both = y[..., 0], y[..., 0] + y[..., 1]
    q = np.cos(first) + np.cos(both), -np.sin(first) - np.sin(both)
    return np.stack([*q, y[..., 0], y[..., 1]], axis=-1)


def problem_by_hand(equations):
    """Closures as what the searches are told, by reach bounds."""
    return Problem(equations.system, equations.stack, None)


def whole_numbers(*values):
    """As claims have them."""
    return np.array(values, dtype=np.int64)


def at_points(boxes):
    """The boxes without parameters."""
    count, size = boxes.centre.shape
    return boxes._replace(half=np.zeros((count, 0)), directions=np.zeros((count, size, 0)))


def boxes_about(centre, half, slope, radius, preconditioner=1.0, **others):
    """Boxes about θ_c, one a row, along slopes S (m, n), all else alike: V = I, w = 1, κ = 0.9."""
    centre, slope = np.atleast_2d(np.array(centre, dtype=float)), np.array(slope, dtype=float)
    count, (m, n) = len(centre), slope.shape
    given = {
        "centre": centre,
        "half": np.broadcast_to(np.array(half, dtype=float), (count, n)),
        "directions": np.tile(np.vstack([np.eye(n), slope]), (count, 1, 1)),
        "modes": np.tile(np.eye(m), (count, 1, 1)),
        "preconditioner": np.tile(np.eye(m) * preconditioner, (count, 1, 1)),
        "radius": np.broadcast_to(np.array(radius, dtype=float), (count, m)),
        "weight": np.ones((count, m)),
        "kappa": np.full(count, 0.9),
    }
    return Boxes(**(given | others))


def random_frame(rng, unknowns, parameters, m, size):
    """A frame of random numbers for one box; its dependent coordinates are the last m, its roundings large."""
    modes = np.zeros((1, unknowns, m))
    modes[:, -m:] = rng.normal(size=(1, m, m))
    return Frame(
        rng.normal(size=(1, m, m)),
        rng.normal(size=(1, unknowns, parameters)),
        modes,
        size * rng.uniform(0.5, 1, (1, parameters)),
        np.array([0.01]),
    )


def assert_bounds_are(bounds, stated, radius, weight, rtol):
    """That Y, Z̄R, Z(R)w and the curvature of a box are what a theorem states, at R and w (m,)."""
    R, w = radius[None], weight[None]
    for found, expected in (
        (bounds.y, stated.y()),
        (bounds.mean(R).of(R), stated.mean(radius)),
        (bounds.contraction(R).of(w), stated.contraction(radius, weight)),
        (bounds.curvature(R, w), stated.curvature(radius, weight)),
    ):
        np.testing.assert_allclose(found[0], expected, rtol=rtol)
