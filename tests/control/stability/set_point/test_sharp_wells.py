"""Wells, gains and what they rest on: minima of quadratics that are attained, sums written out, poles."""

from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.control import PDSimpleGravity, certify_set_point, local_gains, suggest_gains
from ccpin.control.stability.set_point import gains as module
from ccpin.control.stability.set_point.gains import (
    Gains,
    SlopeBound,
    _damped,
    _norm_over,
    _what_is_too_much,
    gravity_slope_over,
)
from ccpin.control.stability.set_point.set_point_cells import SlopeBounded
from ccpin.control.stability.set_point.set_point_reading import set_point_of
from ccpin.control.stability.set_point.well import SetPoint, Well, _efforts, wells
from ccpin.errors import InvalidInputError, UnattainableGainsError, UnsupportedMechanismError
from ccpin.proof.facts import NotProvedError
from tests.support.carriage import carriage
from tests.support.paper import GOAL, K_P, K_V
from tests.support.places import MODELS


def well(hessian, gradient=(0.0, 0.0), remainder=0.0, value=2.0, centre=(1.0, -1.0)):
    return Well(np.array(centre), value, np.array(gradient), np.array(hessian), remainder, 1.0, 1.0)


def corner(x):
    return np.array(x, float)


def test_minima_inside_and_on_the_edge_of_convex_wells():
    """Attained: at the middle, on a face, at a corner; with the remainder on both sides."""
    one = well([[2.0, 0.0], [0.0, 8.0]], remainder=0.25)
    for low, high, least, point in (
        ((-1, -2), (2, 1), 2.0, (1.0, -1.0)),
        ((2, -2), (3, 1), 3.0, (2.0, -1.0)),
        ((2, 0), (3, 1), 7.0, (2.0, 0.0)),
        ((1.5, -1), (1.5, -1), 2.25, (1.5, -1.0)),
        ((1.5, -2), (1.5, 1), 2.25, (1.5, -1.0)),
    ):
        found = one.range_over(corner(low), corner(high))
        assert found.lower == pytest.approx(least - 0.25, abs=1e-12)
        assert found.upper == pytest.approx(least + 0.25, abs=1e-12)
        np.testing.assert_allclose(found.point, point)
    flat = well(np.zeros((2, 2)), gradient=(1.0, 0.0)).range_over(corner((0, -2)), corner((2, 0)))
    assert (flat.lower, flat.upper) == (1.0, 1.0)
    mixed = well([[2.0, 1.0], [1.0, 2.0]], gradient=(0.3, -0.4))
    assert mixed.quadratic(np.array([0.5, -0.25])) == pytest.approx(2.0 + 0.15 + 0.1 + 0.25 + 0.0625 - 0.125)
    exact = 2.0 - 0.5 * np.array([0.3, -0.4]) @ np.linalg.solve([[2.0, 1.0], [1.0, 2.0]], [0.3, -0.4])
    found = mixed.range_over(corner((-1, -3)), corner((3, 1)))
    assert found.lower <= exact <= found.upper + 1e-15
    assert found.upper - found.lower < 1e-3


def test_minima_at_the_corners_of_wells_that_are_not_convex():
    """Attained where the curvature is one; on a box that is flat in one edge, in the other alone."""
    one = well(-2.0 * np.eye(2), gradient=(0.3, -0.5), remainder=0.125)
    low, high = corner((0.5, -1.5)), corner((2.0, 1.0))
    ends = [one.quadratic(np.array([x, y]) - one.centre) for x in (0.5, 2.0) for y in (-1.5, 1.0)]
    found = one.range_over(low, high)
    middle = 0.5 * (low + high) - one.centre
    slope, half = one.gradient + one.hessian @ middle, 0.5 * (high - low)
    exact = one.quadratic(middle) - np.abs(slope) @ half - half @ half
    assert found.lower == pytest.approx(exact - 0.125, abs=1e-12)
    assert min(ends) >= exact - 1e-12
    assert found.upper == pytest.approx(min(ends) + 0.125, abs=1e-12)
    flat = one.range_over(corner((0.5, -1.5)), corner((0.5, 1.0)))
    assert flat.lower == pytest.approx(min(ends[:2]) - 0.125, abs=1e-12)
    saddle = well([[-2.0, 0.0], [0.0, 4.0]])
    rng = np.random.default_rng(0)
    for _ in range(20):
        low = rng.uniform(-2, 1, 2)
        high = low + rng.uniform(0, 2, 2)
        found = saddle.range_over(low, high)
        points = low + (high - low) * rng.random((50, 2))
        assert found.lower <= min(saddle.quadratic(p - saddle.centre) for p in points)
        assert np.all((low <= found.point + 1e-12) & (found.point <= high + 1e-12))
        assert found.upper == pytest.approx(saddle.quadratic(found.point - saddle.centre))


def test_wells_by_their_definition():
    """V − V_d + q̃ᵀg_d + ½q̃ᵀK_p q̃, its gradient and Hessian, and 1e-12 of what they are added from."""
    K_p = np.array([[11.0, 2.0], [2.0, 9.0]])
    law = SetPoint(np.array([0.5, -0.25]), K_p, K_p, np.array([4.0, -5.0]), -3.0, None)
    centres, half = np.array([[0.75, 0.5], [0.0, 0.0]]), np.array([[0.1, 0.2], [0.3, 0.1]])
    bounds = SimpleNamespace(
        value=np.array([-2.0, 7.0]),
        gradient=np.array([[6.0, -1.0], [2.0, 3.0]]),
        hessian=np.array([[[1.0, 0.5], [0.5, 2.0]], np.eye(2)]),
        remainder=np.array([1e-11, 0.0]),
        norm=np.array([3.0, 4.0]),
        turning=None,
    )
    found = wells(law, centres, half, np.zeros((2, 3, 2)), bounds)
    for k, one in enumerate(found):
        error = law.q_d - centres[k]
        parts = [bounds.value[k], 3.0, error @ law.gravity_d, 0.5 * error @ K_p @ error]
        assert one.value == pytest.approx(sum(parts), rel=1e-14)
        np.testing.assert_allclose(one.gradient, bounds.gradient[k] - law.gravity_d - K_p @ error)
        np.testing.assert_array_equal(one.hessian, bounds.hessian[k] + K_p)
        slopes = np.abs(bounds.gradient[k]) + np.abs(law.gravity_d) + np.abs(K_p) @ (np.abs(error) + half[k])
        rounding = 1e-12 * (np.abs(parts).sum() + slopes @ half[k])
        assert one.remainder == pytest.approx(bounds.remainder[k] + rounding, rel=1e-9, abs=0.0)
        assert (one.beta, one.effort) == (bounds.norm[k], np.inf)


def test_the_grip_of_motors_by_weyls_inequality():
    """σ_min of S D less ‖|S| turning‖_F and a rounding of the largest; infinite where the motors sit on q."""
    S = np.array([[1.0, 0.0, 2.0], [0.0, -1.0, 1.0]])
    slopes = np.random.default_rng(1).normal(size=(2, 4, 2))
    turning = np.abs(np.random.default_rng(2).normal(size=(2, 4, 2)))
    law = SetPoint(np.zeros(2), np.eye(2), np.eye(2), np.zeros(2), 0.0, S)
    expected = [
        np.linalg.svd(S @ D[:3])[1].min() - np.sqrt(np.sum((np.abs(S) @ t[:3]) ** 2))
        for D, t in zip(slopes, turning, strict=True)
    ]
    np.testing.assert_allclose(_efforts(law, slopes, turning), expected, rtol=1e-9)
    exact = _efforts(law, np.eye(3)[None, :, :2] * 1.0, np.zeros((1, 3, 2)))
    assert exact[0] == pytest.approx(1.0 - 1e-12, abs=1e-14)


@pytest.mark.parametrize(("independent", "elsewhere"), [(("a", "b"), False), (("b", "a"), True)])
def test_the_numbers_of_a_law(independent, elsewhere):
    """Its own, V at q_d in its configuration, and S where its motors sit elsewhere."""
    asked, S = [], np.eye(2)
    model = SimpleNamespace(
        n=2,
        energy=lambda *given: asked.append(given) or SimpleNamespace(potential=-3.0),
        mechanism=SimpleNamespace(actuated=("a", "b"), independent=independent, actuation=S),
    )
    law = SimpleNamespace(model=model, q_d="q_d", q_free_d="q′_d", gravity_d="g", K_p="K_p", K_v="K_v")
    assert set_point_of(law) == ("q_d", "K_p", "K_v", "g", -3.0, S if elsewhere else None)
    ((q, v, free),) = asked
    assert (q, free, v.tolist()) == ("q_d", "q′_d", [0.0, 0.0])


# Gains.


@pytest.mark.parametrize("damping", [0.5, 1.0])
def test_damped_modes_have_the_damping(damping):
    """Poles of M ẍ + K_v ẋ + K x = 0 have −Re λ/|λ| = ζ and |λ| = ω."""
    rng = np.random.default_rng(3)
    M, K = (a @ a.T + np.eye(3) for a in rng.normal(size=(2, 3, 3)))
    damper, frequencies = _damped(
        M, K + 0.1 * np.triu(np.ones((3, 3)), 1) - 0.1 * np.tril(np.ones((3, 3)), -1), damping
    )
    fall = -np.linalg.solve(M, np.hstack([K, damper]))
    poles = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((3, 3)), np.eye(3)]), fall]))
    np.testing.assert_allclose(-poles.real / np.abs(poles), damping, atol=1e-6)
    np.testing.assert_allclose(np.unique(np.abs(poles).round(6)), frequencies.round(6), atol=1e-5)


def test_gains_at_a_set_point_alone(rpdr_model):
    """ω²D + 1.5‖∂g/∂q‖ I."""
    stiff, damper = local_gains(rpdr_model, GOAL, frequency=12.0, damping=0.6)
    mass, slope = rpdr_model.at(GOAL).D, rpdr_model.gravity_derivative(GOAL)
    np.testing.assert_allclose(stiff, 144.0 * mass + 1.5 * np.linalg.norm(slope, 2) * np.eye(2), rtol=1e-12)
    np.testing.assert_allclose(damper, _damped(mass, stiff + slope, 0.6)[0], rtol=1e-9)


class Halving:
    """Cells with bounds of ‖∂g/∂q‖ that halving lowers towards what is seen at their centres."""

    def __init__(self, bounds, seen, proved=0, whole=True):
        self.cells = [cell(b) for b in bounds] + [SimpleNamespace(well=None, live=True)]
        self.seen, self.proved, self.whole = seen, proved, whole
        self.law = SimpleNamespace(K_p=5.0 * np.eye(2))

    def __getitem__(self, k):
        return self.cells[k]

    def well(self, k):
        found = self.cells[k].well
        return SimpleNamespace(beta=found.beta, hessian=self.law.K_p + np.diag([self.seen, 0.0]))

    def halve_proved(self, k):
        beta = self.cells[k].well.beta
        self.cells += [cell(0.5 * (beta + self.seen), k), cell(0.75 * self.seen, k)]
        self.proved += 2
        return len(self.cells) - 2, len(self.cells) - 1


def cell(beta, k=0.0, live=True, effort=np.inf):
    place = np.full(2, float(k))
    return SimpleNamespace(well=SimpleNamespace(beta=beta, effort=effort), live=live, lower=place - 1, upper=place + 2)


def test_slopes_are_bounded_by_the_steepest_cell():
    """Until what is seen bears it out to 5 %, or the cells are spent; never below any cell's bound."""
    found = gravity_slope_over(Halving([1.0, 4.0, 2.0], 2.0))
    assert found.seen == 2.0
    assert 2.0 <= found.bound <= 2.1
    assert found.bound == pytest.approx(2.0625)
    assert found.proved == 10
    spent = gravity_slope_over(Halving([1.0, 4.0], 2.0, proved=7), cells=7)
    assert (spent.bound, spent.proved) == (4.0, 7)
    np.testing.assert_array_equal(spent.at, [0.5, 0.5])
    once = gravity_slope_over(Halving([1.0, 4.0], 2.0, proved=6), cells=7)
    assert once.bound == 3.0
    stuck = Halving([1.0, 4.0], 2.0)
    stuck.halve_proved = lambda k: None
    assert gravity_slope_over(stuck).bound == 4.0
    for factor, sharp in ((1.049, True), (1.051, False)):
        one = Halving([2.0 * factor], 2.0)
        assert (gravity_slope_over(one).proved == 0) is sharp
    assert gravity_slope_over(Halving([0.95e-12], 0.0)).proved == 0
    assert gravity_slope_over(Halving([1.05e-12], 0.0)).proved > 0


def test_efforts_beyond_a_grip():
    assert _norm_over(np.array([3.0, 4.0]), 2.0) == 2.5
    assert _norm_over(np.array([3.0, 4.0]), 0.0) == np.inf
    assert _norm_over(np.array([3.0, 4.0]), -1.0) == np.inf


def told(effort, limit, fastest, frequency=10.0):
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    made = Gains(None, None, 1.0, 1.0, None, np.array([1.0, frequency]), np.array(effort), np.array(limit), "")
    return _what_is_too_much(model, made, fastest)


def test_what_motors_cannot_give_is_told():
    assert told([1.0, 2.0], [1.0, 2.0], 10.0) == ""
    assert "asks joint2 for up to 2.01 of its 2 N m from" in told([1.0, 2.01], [1.0, 2.0], 10.0)
    assert "asks joint1 for up to 1.01 of its 1 N m from" in told([1.01, 2.0], [1.0, 2.0], 10.0)
    assert "mode" in told([1.0, 2.0], [1.0, 2.0], 9.9)


@pytest.fixture
def over(monkeypatch, rpdr_model):
    """`suggest_gains` over an atlas whose cells are told."""

    def run(model=rpdr_model, cells=(), bound=2.0, seen=1.9, whole=True, proved=None, refused=False, **given):
        lower, upper = [GOAL - [0.5, 0.2], GOAL - [0.1, 0.6]], [GOAL + [0.1, 0.3], GOAL + [0.7, 0.4]]
        fake = SimpleNamespace(lower=np.array(lower), upper=np.array(upper))
        monkeypatch.setattr(module, "Atlas", SimpleNamespace)
        monkeypatch.setattr(module, "require_about", lambda *_: None)
        store = SimpleNamespace(cells=list(cells) or [cell(2.0)], whole=whole)
        monkeypatch.setattr(module, "cells_of_atlas", lambda *_: store)
        told = SlopeBound(seen, bound, np.array([1.0, 2.0]), 3, tuple(range(len(store.cells))))
        monkeypatch.setattr(module, "gravity_slope_over", lambda _: told)
        grip = min(c.well.effort for c in store.cells if c.well is not None and c.live)

        def prove(*_):
            if refused:
                raise NotProvedError("refused")
            return SimpleNamespace(found={"beta": [proved or bound], "effort": [grip]})

        monkeypatch.setattr(module, "_proved", prove)
        monkeypatch.setattr(module, "is_fact", lambda fact, kind: fact is not None and kind is SlopeBounded)
        return suggest_gains(model, GOAL, fake, **given)

    return run


def test_gains_over_an_atlas(over, rpdr_model):
    """Margin · β, the damping, and what is asked of the motors from the farthest corner."""
    found = over(margin=1.25, damping=0.6)
    np.testing.assert_allclose(found.K_p, 2.5 * np.eye(2))
    mass, slope = rpdr_model.at(GOAL).D, rpdr_model.gravity_derivative(GOAL)
    np.testing.assert_allclose(found.K_v, _damped(mass, found.K_p + slope, 0.6)[0], rtol=1e-9)
    gravity = rpdr_model.at(GOAL).g
    np.testing.assert_allclose(found.effort, 2.5 * np.array([0.7, 0.6]) + np.abs(gravity), rtol=1e-9)
    assert (found.verdict, found.beta, found.beta_seen) == ("proven", 2.0, 1.9)
    assert "limited by" in found.reason
    np.testing.assert_allclose(over(margin=1.05).K_p, 2.1 * np.eye(2))
    torn = over(whole=False)
    assert torn.verdict == "undecided"
    assert "no function" in torn.reason
    assert over(proved=2.5).beta == 2.5
    lost = over(refused=True)
    assert (lost.verdict, lost.proved, lost.beta) == ("undecided", None, 2.0)
    assert "refused" in lost.reason
    assert "between" in over(bound=4.0, seen=1.9).reason
    assert "limited by" in over(bound=3.9, seen=1.95).reason
    with pytest.raises(InvalidInputError, match="no slope"):
        over(bound=1e-13)
    with pytest.raises(InvalidInputError, match="no slope"):
        over(bound=0.95e-12)
    assert over(bound=1.05e-12).beta == 1.05e-12


def test_efforts_of_motors_elsewhere_are_bounded_by_the_worst_grip(over):
    """‖τ‖/s with the least s of the cells that are alive."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"], independent=["joint1", "joint2"]))
    cells = [
        cell(2.0, effort=0.5),
        cell(2.0, effort=2.0),
        cell(2.0, effort=0.1, live=False),
        SimpleNamespace(well=None, live=True),
    ]
    found = over(model, cells)
    asked = found.K_p @ np.array([0.7, 0.6]) + np.abs(model.at(GOAL).g)
    np.testing.assert_allclose(found.effort, np.linalg.norm(asked) / 0.5, rtol=1e-9)
    assert np.all(np.isinf(over(model, [cell(2.0, effort=-0.1)]).effort))
    at_goal = over(model, [cell(2.0)])
    pulled = np.abs(np.linalg.pinv(PDSimpleGravity(model, GOAL, K_P, K_V).near.reference.transmission)) @ asked
    np.testing.assert_allclose(at_goal.effort, pulled, rtol=1e-9)


def test_gains_over_a_region_are_sampled(monkeypatch, rpdr_model):
    """The largest among samples."""
    samples = SimpleNamespace(norm=np.array([1.0, 3.0, 2.0]), q=np.array([GOAL, GOAL + 0.1, GOAL - 0.1]))
    monkeypatch.setattr(module, "sample_region", lambda *_: samples)
    found = suggest_gains(rpdr_model, GOAL, (GOAL - 0.2, GOAL + 0.3))
    assert (found.beta, found.beta_seen, found.verdict) == (3.0, 3.0, "undecided")
    np.testing.assert_array_equal(found.steepest, GOAL + 0.1)
    assert "nothing is proved" in found.reason
    with pytest.raises(UnattainableGainsError):
        suggest_gains(rpdr_model, GOAL, (GOAL - 0.2, GOAL + 0.3), fastest=1e-3)
    for bad in ({"margin": 1.0}, {"damping": 0.0}, {"fastest": 0.0}):
        with pytest.raises(InvalidInputError):
            suggest_gains(rpdr_model, GOAL, (GOAL - 0.2, GOAL + 0.3), **bad)


@pytest.fixture(scope="module")
def without_a_domain(rpdr_model):
    """`suggest_gains` without a domain, and what it asked of `cells_around`."""
    asked, around = [], module.cells_around
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "cells_around", lambda *given: asked.append(given) or around(*given))
        return suggest_gains(rpdr_model, GOAL), asked


def test_gains_without_a_domain(rpdr_model, without_a_domain):
    """β holds, to 5 %, on the cell that is told, and efforts are those from its farthest corner."""
    found, _ = without_a_domain
    lower, upper = found.proved.claim.over_lower[0], found.proved.claim.over_upper[0]
    half = 0.5 * (upper - lower)
    assert found.verdict == "proven"
    np.testing.assert_allclose(0.5 * (lower + upper), GOAL, atol=1e-12)
    assert f"over q_d ± ({half[0]:.3g}, {half[1]:.3g}): K_p is limited by" in found.reason
    assert half.min() > 0.1
    grid = [GOAL + half * np.array([x, y]) for x in np.linspace(-1, 1, 9) for y in np.linspace(-1, 1, 9)]
    steepest = max(np.linalg.norm(rpdr_model.gravity_derivative(q, rpdr_model.sigma(q)), 2) for q in grid)
    assert steepest <= found.beta <= 1.06 * steepest
    np.testing.assert_allclose(found.K_p, 1.5 * found.beta * np.eye(2))
    gravity = rpdr_model.at(GOAL).g
    np.testing.assert_allclose(found.effort, 1.5 * found.beta * half + np.abs(gravity), rtol=1e-9)
    proof = certify_set_point(rpdr_model, GOAL, found.K_p, found.K_v, budget=50)
    assert proof.verdict == "proven"


def test_the_cell_without_a_domain_is_that_of_a_lattice(rpdr_model, without_a_domain):
    """`certify_law`'s own helper: more cells may follow, any slope will do, edges as K_p = 1.5 ‖∂g/∂q‖ I has them."""
    found, ((law, gain, limits, none),) = without_a_domain
    assert none is None
    slope = np.linalg.norm(rpdr_model.gravity_derivative(GOAL), 2)
    np.testing.assert_allclose(law.K_p, 1.5 * slope * np.eye(2), rtol=1e-12)
    assert (gain, limits.cells > 1) == (np.inf, True)
    np.testing.assert_array_equal(law.q_d, GOAL)
    box = found.proved.claim
    store = module.cells_around(law, gain, limits)
    np.testing.assert_allclose([box.over_lower[0], box.over_upper[0]], [store[0].lower, store[0].upper])


def test_without_slope_or_plain_coordinates_no_domain_suggests_itself(tmp_path):
    """A level carriage has no gravity in its way; a crank that turns on a circle has a q̃ that jumps."""
    with pytest.raises(InvalidInputError, match=r"no slope at q_d.*give one"):
        suggest_gains(carriage(), [0.0])
    text = (MODELS / "four_bar.urdf").read_text(encoding="utf-8").replace('type="revolute"', 'type="continuous"')
    (tmp_path / "round.urdf").write_text(text, encoding="utf-8")
    model = ccpin.ReducedModel(ccpin.load(tmp_path / "round.urdf"))
    with pytest.raises(UnsupportedMechanismError, match="revolute and prismatic"):
        suggest_gains(model, model.alpha(model.mechanism.q_reference))


@pytest.mark.parametrize(("slope", "told"), [(0.95e-12, "give one"), (1.05e-12, "cells are laid")])
def test_how_little_slope_is_none(monkeypatch, rpdr_model, slope, told):
    """At the set point as over a domain: 1e-12."""

    def laid(*_):
        raise InvalidInputError("cells are laid")

    monkeypatch.setattr(module, "cells_around", laid)
    monkeypatch.setattr(type(rpdr_model), "gravity_derivative", lambda *_: slope * np.diag([1.0, 0.5]))
    with pytest.raises(InvalidInputError, match=told):
        suggest_gains(rpdr_model, GOAL)


def test_limits_of_motors_either_way(over):
    """The smaller of what a motor can pull and push."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    limits = np.array([[-30.0, 50.0], [-70.0, 40.0]])
    real = model.mechanism.motors
    fake = SimpleNamespace(limits=limits, gears=real.gears, each=real.each)
    try:
        object.__setattr__(model.mechanism, "motors", fake)
    except (AttributeError, TypeError):
        pytest.skip("motors are computed")
    try:
        assert over(model).effort_limit.tolist() == [30.0, 40.0]
    finally:
        object.__setattr__(model.mechanism, "motors", real)
