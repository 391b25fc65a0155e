"""Jets of programs over boxes of closed states, and σ proven over them."""

import numpy as np
import pytest

import ccpin
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V

flint = pytest.importorskip("flint")

from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, joined  # noqa: E402
from ccpin.validated.model.closed_loop import recorded_loop  # noqa: E402
from ccpin.validated.sets.branch import closed_boxes, jets_of, nearly_closed, states_of  # noqa: E402

FREE = [0, 2, 1, 3]  # the paper's (q1, q2, q3, q4) in ccpin's order (q1, q3, q2, q4)
Q = np.radians([[-120.0, -130.0], [-100.0, -115.0], [-140.0, -150.0]])


@pytest.fixture(scope="module")
def loop(rpdr_model):
    return recorded_loop(rpdr_model, ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)).equations


def configurations(q):
    return np.array([oracle.sigma(x, 1.0)[FREE] for x in q])


def states(loop, q, reach_q, v, reach_v):
    """Jets' boxes about closed states, with their centres."""
    centre = configurations(q)
    points, _ = closed_boxes(loop, centre, np.full((len(q), 2), 1e-15))
    boxes, proven = closed_boxes(loop, centre, np.full((len(q), 2), reach_q))
    assert proven.all()
    rest = joined(exactly(v), BallArray(v, np.full_like(v, reach_v)))
    reach = np.concatenate([np.full((len(q), 2), reach_q + 1e-15), np.full_like(v, reach_v)], axis=1)
    return states_of(loop, joined(points, boxes), rest, reach)


def test_boxes_hold_the_closed_form(loop):
    """σ of the paper's closed form lies in the boxes proven, all over them, and nowhere near their edges."""
    centre = configurations(Q)
    boxes, proven = closed_boxes(loop, centre, np.full((3, 2), 0.02))
    assert proven.all()
    rng = np.random.default_rng(0)
    for _ in range(200):
        inside = configurations(Q + 0.02 * rng.uniform(-1, 1, (3, 2)))
        turned = np.angle(np.exp(1j * (inside - boxes.mid)))
        assert np.all(np.abs(turned) <= boxes.rad)
    assert np.all(boxes.rad[:, list(loop.dependent)] < 0.2)


def test_boxes_with_a_singularity_are_not_proven(loop):
    """Stretched links a hundredth of a radian away: a box that reaches them is refused, a small one is not."""
    q = np.radians([-108.0, -72.0])
    line = q + np.outer(np.linspace(0.0, 0.5, 400), [-1.0, 1.0])
    near = line[np.argmin([oracle.elongation(x) < 0.999 for x in line]) - 1]
    centre = configurations(near[None])
    assert not closed_boxes(loop, centre, np.full((1, 2), 0.05))[1].any()
    assert closed_boxes(loop, centre, np.full((1, 2), 1e-6))[1].all()


def test_newton_finds_the_neighbour(loop):
    """Nearly closed configurations beside known ones are the closed form's."""
    offset = np.full((3, 2), 0.03)
    found = nearly_closed(loop, configurations(Q), offset)
    turned = np.angle(np.exp(1j * (found - configurations(Q + offset))))
    np.testing.assert_allclose(turned, 0.0, rtol=0, atol=1e-13)


def test_jets_are_derivatives(loop, rpdr_model):
    """q̈'s first and second derivatives along (q, q̇) at a point are differences of the model's own q̈."""
    v = np.array([[2.0, -1.0], [5.0, 3.0], [0.0, 0.0]])
    points, _ = closed_boxes(loop, configurations(Q), np.full((3, 2), 1e-15))
    found = jets_of(states_of(loop, points, exactly(v)), loop, loop.field)
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)

    def rate(s):
        state = rpdr_model.at(s[:2], centre)
        return rpdr_model.forward_dynamics(state.q, s[2:], law.torque(0.0, state, s[2:]), state.q_free)

    for k in range(3):
        centre, start, step = configurations(Q)[k], np.append(Q[k], v[k]), 1e-4 * np.eye(4)
        slope = np.array([(rate(start + e) - rate(start - e)) / 2e-4 for e in step]).T
        bend = np.array(
            [
                [(rate(start + e + f) - rate(start + e - f) - rate(start - e + f) + rate(start - e - f)) for f in step]
                for e in step
            ]
        ).transpose(2, 0, 1)
        np.testing.assert_allclose(found.slope.mid[k, 4:], slope, rtol=0, atol=1e-6 * np.abs(slope).max())
        np.testing.assert_allclose(found.bend.mid[k, 4:], bend / 4e-8, rtol=0, atol=1e-5 * np.abs(bend).max() / 4e-8)


@pytest.mark.slow
def test_jets_over_a_box_hold_those_at_its_points(loop):
    """Values and derivatives at random states of a box lie in the box's, which are not much wider than they must be."""
    v, rng = np.array([[4.0, -3.0], [1.0, 6.0], [-2.0, 0.5]]), np.random.default_rng(1)
    over = jets_of(states(loop, Q, 2e-3, v, 0.1), loop, loop.field)
    seen = [np.zeros_like(x.rad) for x in over]
    for _ in range(50):
        q, w = Q + 2e-3 * rng.uniform(-1, 1, (3, 2)), v + 0.1 * rng.uniform(-1, 1, (3, 2))
        points, _ = closed_boxes(loop, configurations(q), np.full((3, 2), 1e-15))
        there = jets_of(states_of(loop, points, exactly(w)), loop, loop.field)
        for wide, point, far in zip(over, there, seen, strict=True):
            gap = np.abs(point.mid - wide.mid)
            assert np.all(gap <= wide.rad + point.rad)
            np.maximum(far, gap, out=far)
    for wide, far in zip(over[:2], seen[:2], strict=True):
        assert wide.rad[:, 4:].max() < 5 * far[:, 4:].max()
