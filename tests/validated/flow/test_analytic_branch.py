"""σ over a polydisc: a circle's arc, whose branch can be written down, and where it cannot be continued."""

import numpy as np
import pytest

pytest.importorskip("flint")
import ccpin
from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.balls import ball, flint, upper
from ccpin.validated.arithmetic.polydisc import ring
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.flow.analytic_branch import branch_over, followed
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.model.closed_loop import recorded_loop

DEGREE = 30


@pytest.fixture(scope="module")
def arc():
    """q² + y² = 1: y = √(1 − q²), analytic for |q| < 1."""
    with flint().ctx.workprec(128):
        tape = Tape(3)
        q, y, v = tape.inputs
        nothing = in_balls(tape, [q - q, y - y, v - v])
        closure = in_balls(tape, [q * q + y * y - 1])
        return ClosedLoopEquations(
            2, 1, (0,), nothing, closure, in_balls(tape, [y * 2]), nothing, in_balls(tape, [v - v, v - v])
        )


def over(arc, centre, reach, radius, y=None):
    c, r = np.array([centre]), np.array([reach])
    found = followed(arc, c, r, np.array([np.sqrt(1.0 - centre**2)]), DEGREE) if y is None else y
    return branch_over(arc, c, r, found, np.array([radius]), DEGREE)


def test_the_series_of_the_arc(arc):
    """√(1 − R²ξ²) = 1 − R²ξ²/2 − R⁴ξ⁴/8 − …."""
    branch = over(arc, 0.0, 0.5, 1e-3)
    assert branch.proved
    np.testing.assert_allclose(branch.inputs.mid[1, :5], [1.0, 0.0, -0.125, 0.0, -1.0 / 128], atol=1e-15)
    assert branch.inputs.rest.tolist() == [0.0, 1e-3, 0.0]
    assert branch.inputs.mid[0, :3].tolist() == [0.0, 0.5, 0.0]


def test_it_ends_where_the_arc_does(arc):
    """±1 are folds."""
    assert over(arc, 0.0, 0.7, 1e-4).proved
    assert not over(arc, 0.0, 1.0, 1e-4).proved
    assert over(arc, 0.4, 0.4, 1e-4).proved
    assert not over(arc, 0.4, 0.6, 1e-4).proved


def test_lipschitz_constant_and_image_are_sharp(arc):
    """At one point B = 1/(2y), y ↦ y − Bφ has the slope 1 − 2yB: r about 1, and the image is r of it from y_N off."""
    still = np.zeros((1, DEGREE + 1))
    still[0, 0] = 1.0
    branch = over(arc, 0.0, 1e-9, 0.125, still)
    assert branch.share == pytest.approx(0.125, rel=1e-9)
    assert branch.image[0] == pytest.approx(0.125**2, rel=1e-9)
    assert branch.share >= 0.125
    still[0, 0] = 1.01
    off = over(arc, 0.0, 1e-9, 0.125, still)
    assert off.image[0] == pytest.approx((1.01**2 - 1.0) / 2.02 + 0.125**2 / 1.01, rel=1e-9)
    assert off.proved
    assert not over(arc, 0.0, 1e-9, 5e-3, still).proved
    assert not over(arc, 0.0, 1e-9, 1.0, still).proved


def test_what_does_not_contract_proves_nothing(arc):
    """β = 1, as it may round to where the image is a hair within: points would be any distance off."""
    branch = over(arc, 0.0, 0.5, 1e-3)
    assert branch._replace(share=float(np.nextafter(1.0, 0.0))).proved
    assert not branch._replace(share=1.0).proved


def test_a_wide_tube_holds_the_other_arc(arc):
    """−√(1 − q²) is 2 off: no tube of that radius is one sheet's."""
    assert not over(arc, 0.0, 0.1, 2.0).proved


@pytest.mark.parametrize("off", [0.0, 1e-6, -3e-5])
def test_points_are_as_near_as_their_residual(arc, off):
    """Balls hold σ, and are not much wider than the point is off."""
    branch = over(arc, 0.0, 0.5, 1e-3)
    xi, exact = np.array([0.8]), np.sqrt(1.0 - 0.16)
    with flint().ctx.workprec(128):
        found = branch.closed(
            [ball(0.5) * ball(0.8)], xi, [(1 - (ball(0.5) * ball(0.8)) ** 2).sqrt().mid() + ball(off)]
        )
        assert found[1].contains((1 - (ball(0.5) * ball(0.8)) ** 2).sqrt())
    assert abs(float(found[1].mid()) - exact - off) < 1e-15
    assert abs(off) <= upper(found[1].rad()) <= 1.01 * abs(off) * (1 + branch.share) + 1e-30


def test_points_off_the_tube_are_none(arc):
    """They may be of another sheet."""
    branch = over(arc, 0.0, 0.5, 1e-3)
    for off, inside in ((0.9e-3, True), (1.1e-3, False), (-1.1e-3, False)):
        with flint().ctx.workprec(128):
            found = branch.closed([ball(0.4)], np.array([0.8]), [ball(float(np.sqrt(1.0 - 0.16) + off))])
        assert (found is not None) == inside


def test_a_tube_as_wide_as_roundings_holds_nothing(arc):
    """Where y_N is in doubles is known to 1e-12."""
    branch = over(arc, 0.0, 0.5, 5e-13)
    with flint().ctx.workprec(128):
        assert branch.closed([ball(0.4)], np.array([0.8]), [ball(float(np.sqrt(1.0 - 0.16)))]) is None


def test_two_numbers_of_q():
    """σ of the five-bar at random q of the polydisc is within the image of the polynomials."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    with flint().ctx.workprec(128):
        loop, own = recorded_loop(model, None)
    x = own.numbers(model.mechanism.q_reference)
    c, reach = x[list(loop.independent)], np.array([0.05, 0.1])
    y = followed(loop, c, reach, x[list(loop.dependent)], 8)
    branch = branch_over(loop, c, reach, y, np.full(len(y), 1e-3), 8)
    assert branch.proved
    rng, start = np.random.default_rng(3), model.alpha(model.mechanism.q_reference)
    for _ in range(5):
        xi = rng.uniform(-1.0, 1.0, 2)
        state = model.at(model.coordinates.integrate(start, reach * xi))
        exact = own.numbers(state.q_free)[list(loop.dependent)]
        near = y @ np.prod(xi ** ring(2, 8).exponents, axis=1)
        assert np.all(np.abs(near - exact) <= branch.image + 1e-9)
    narrow = np.array([1e-15, *[1e-3] * (len(y) - 1)])
    assert not branch_over(loop, c, reach, y, narrow, 8).proved
    assert not branch._replace(image=np.array([1e-2, *branch.image[1:]])).proved
    with flint().ctx.workprec(128):
        q, inside = [ball(x) for x in c.tolist()], [ball(x) for x in y[:, 0].tolist()]
        assert branch.closed(q, np.zeros(2), inside) is not None
        assert branch.closed(q, np.zeros(2), [inside[0] + 1, *inside[1:]]) is None
