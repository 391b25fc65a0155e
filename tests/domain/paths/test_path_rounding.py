"""Paths of high degree and paths that jump a little: what is certified is the exact polynomial, by exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.interpolate import PPoly

import ccpin
from ccpin.domain import certify_path
from ccpin.domain.closures.seeds import seed_at_coordinates
from ccpin.domain.paths.path import _targets
from ccpin.domain.paths.pieces import pieces_of
from ccpin.domain.paths.walker import Walker
from ccpin.errors import InvalidInputError
from ccpin.proof.chords import chord_of, points_of

GAP = 9e-10


def wave(degree):
    """T_d(2t − 1) in powers of t: its coefficients grow like 5.8^d, so evaluating it cancels them."""
    powers = np.polynomial.Polynomial(chebyshev.cheb2poly(np.eye(degree + 1)[degree]))(
        np.polynomial.Polynomial([-1.0, 2.0])
    )
    return powers.coef[::-1]


def exact(coefficients, t):
    """A polynomial in powers, the highest first, at a fraction."""
    total = Fraction(0)
    for c in coefficients:
        total = total * t + Fraction(float(c))
    return total


def exact_gap(pieces, piece, start, end, chord, share):
    """How far the exact path is from the computed chord at a share of the stretch, of shape (n,)."""
    t = Fraction(start) + Fraction(share) * (Fraction(end) - Fraction(start)) - Fraction(float(pieces.x[piece]))
    line = [
        (1 - Fraction(share)) * Fraction(a) + Fraction(share) * Fraction(b) for a, b in zip(*chord[:2], strict=True)
    ]
    return [abs(exact(pieces.c[:, piece, k], t) - line[k]) for k in range(pieces.c.shape[2])]


@pytest.mark.parametrize("degree", [1, 3, 12, 20, 30, 50])
def test_a_path_of_high_degree_is_bounded_with_its_rounding(degree):
    """The exact polynomial is within the deviation of the computed chord at every share, the ends within `rounding`."""
    rng = np.random.default_rng(degree)
    c = np.stack([wave(degree), rng.normal(size=degree + 1)], axis=1)[:, None]
    pieces = pieces_of(PPoly(c, np.array([0.25, 1.25])), 2)
    for _ in range(10):
        start, end = (float(t) for t in np.sort(rng.uniform(0.25, 1.25, 2)))
        chord = chord_of(pieces, start, end)
        for share in (0.0, 0.25, 0.5, 0.875, 1.0):
            gap = exact_gap(pieces, 0, start, end, chord, share)
            assert all(g <= Fraction(d) for g, d in zip(gap, chord.deviation, strict=True))
            if share in (0.0, 1.0):
                assert all(g <= Fraction(r) for g, r in zip(gap, chord.rounding[int(share)], strict=True))


def test_what_is_allowed_for_rounding_is_needed():
    """A wave of degree 20 loses more than 1e-14 (1 + |q|), the allowance of before, and no more than is allowed."""
    pieces = pieces_of(PPoly(wave(20)[:, None, None], np.array([0.0, 1.0])), 1)
    t = np.linspace(0.9, 1.0, 50)
    values, rounding = points_of(pieces, t)
    truth = [exact(pieces.c[:, 0, 0], Fraction(x)) for x in t]
    off = np.array([float(abs(a - Fraction(b))) for a, b in zip(truth, values[:, 0], strict=True)])
    assert off.max() > 1e-10
    assert np.all(off <= rounding[:, 0])


def test_degrees_and_jumps_that_are_refused():
    """Degree 51, values beyond the doubles, knots that fall back, and a jump proved to be above 1e-9."""
    with pytest.raises(InvalidInputError, match="degree 51"):
        pieces_of(PPoly(np.zeros((52, 1, 1)), np.array([0.0, 1.0])), 1)
    with pytest.raises(InvalidInputError, match=r"jumps by 1\.1e-09"):
        pieces_of(PPoly(np.array([[[0.0], [1.1e-9]]]), np.array([0.0, 1.0, 2.0])), 1)
    with pytest.raises(InvalidInputError, match="overflow"):
        pieces_of(PPoly(np.ones((51, 1, 1)), np.array([0.0, 1e10])), 1)
    with pytest.raises(InvalidInputError, match="do not increase"):
        pieces_of(PPoly(np.zeros((2, 2, 1)), np.array([2.0, 1.0, 0.0])), 1)


@pytest.mark.parametrize("tube", [0.0, 1e-4])
def test_boxes_on_both_sides_of_a_jump_hold_the_place_where_they_are_glued(tube):
    """A path that jumps at its knots: each box holds the end of the one before, and the exact path on its stretch."""
    mechanism = ccpin.load("rpdr")
    start = ccpin.ReducedModel(mechanism).alpha(mechanism.q_reference)
    c = np.zeros((2, 4, 2))
    c[1] = start + GAP * np.array([[0, 0], [1, -1], [0, 0], [1, 0]])
    c[0, 2] = [0.05, -0.02]
    c[1, 3] += c[0, 2]
    path = certify_path(mechanism, PPoly(c, np.arange(5.0)), tube)
    assert path.verdict == "proven"
    boxes, independent = path.boxes, path.problem.system.independent
    middle, along = boxes.centre[:, independent], boxes.directions[:, independent, 0]
    for k in range(1, len(boxes.kappa)):
        held = middle[k - 1] + along[k - 1] - (middle[k] - along[k])
        assert np.all(np.abs(held) <= boxes.half[k, 1:])
    for k, t in enumerate(path.times[:-1]):
        assert np.all(np.abs(path.pieces(t) - middle[k] + along[k]) + tube <= boxes.half[k, 1:] + 1e-15)


@pytest.mark.parametrize(("tube", "some"), [(0.0, False), (1e-4, True)])
def test_segments_that_may_refute_lie_in_the_tube_beside_a_jump(tube, some):
    """From before a jump the way ahead on the path is in a tube that is wider than the jump, and in no other."""
    mechanism = ccpin.load("rpdr")
    start = ccpin.ReducedModel(mechanism).alpha(mechanism.q_reference)
    c = np.zeros((2, 2, 2))
    c[1, 0], c[1, 1] = start, start + GAP
    c[0] = [0.05, -0.02]
    c[1, 1] += c[0, 0]
    path = certify_path(mechanism, PPoly(c, np.arange(3.0)), tube)
    walker = Walker(path.problem, path.pieces, path.tube, seed_at_coordinates(mechanism, start, None).theta)
    assert walker.walk() is None
    before = walker.back(sum(t > 1.0 for t in walker.times))
    assert before.here == 1.0
    assert bool(_targets(before, 2.0)) is some
