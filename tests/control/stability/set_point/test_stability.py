"""Theorem 3: what is certified is true of the closed form and of simulations, and what is not so is refused."""

import signal
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson
from scipy.optimize import brentq

import ccpin
from ccpin import plotting
from ccpin.control import Measurement, PDFullGravity, PDSimpleGravity, certify_set_point, suggest_gains
from ccpin.control.stability.set_point import gains as gains_module
from ccpin.control.stability.set_point.gains import gravity_slope_over
from ccpin.control.stability.set_point.starting_cells import cells_of_atlas
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.control.stability.set_point.well import Well
from ccpin.domain import certify
from ccpin.dynamics import linearize
from ccpin.errors import CcpinError, DifferentSubjectsError, InvalidInputError, UnattainableGainsError
from ccpin.simulation import lyapunov_along
from tests.oracles import rpdr as oracle
from tests.support.long_cases import later
from tests.support.paper import GOAL, K_P, K_V, START

UPRIGHT, UPRIGHT_MODE = np.radians([90.0, 90.0]), np.radians([90.0, -30.0, 90.0, 30.0])


@lru_cache
def _case(name, long=False):
    """A law, its certificate and how long its motions take to settle; of long work for slow runs."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q_d, k_p, k_v, (depth, cells), duration = {
        "rpdr": (GOAL, K_P, K_V, (11, 700) if long else (10, 300), 1.0),
        "delta": (np.zeros(3), np.full(3, 30.0), np.full(3, 4.0), (9, 150), 2.0),
        "stewart": (model.alpha(model.mechanism.q_reference), np.full(6, 4e3), np.full(6, 300.0), (None, None), 0.8),
        "hexa": (model.alpha(model.mechanism.q_reference), np.full(6, 100.0), np.full(6, 5.0), (None, None), 1.0),
    }[name]
    law = PDSimpleGravity(model, q_d, k_p, k_v)
    return law, certify_law(law, max_depth=depth, budget=cells), duration


def _stopped_after(cells, how):
    """Progress that ends the work once so many cells are proved."""

    def told(flooded):
        if flooded.cells >= cells:
            how()

    return told


@pytest.mark.slow
def test_interrupted_it_keeps_what_it_proved():
    """After Ctrl-C the level so far stands: no higher than with all the time, and its motions are as certified."""
    law, whole, _ = _case("rpdr", long=True)
    ctrl_c = _stopped_after(150, lambda: signal.raise_signal(signal.SIGINT))
    part = certify_law(law, max_depth=11, budget=700, progress=ctrl_c)
    assert (part.limit, part.verdict) == ("interrupted", "proven")
    assert 150 <= part.proved < 200 < whole.proved
    assert 0.0 < part.level < whole.level
    assert "interruption" in part.reason
    assert np.all([whole.contains(q) for q in np.concatenate(part.cells) if part.contains(q)])


@pytest.mark.parametrize("cells", later(3, 20))
def test_what_progress_raises_ends_it(cells):
    """Told before every cell; an exception comes through, from the search over an atlas's boxes too."""
    law, *_ = _case("rpdr")
    atlas = certify(law.model, GOAL, max_depth=4)

    def leave():
        raise TimeoutError

    for domain in (None, atlas):
        with pytest.raises(TimeoutError):
            certify_law(law, domain, progress=_stopped_after(cells, leave))


def _closed_form_potential(paper):
    q1, q2, q3, q4 = paper
    inner = (oracle.M1 * oracle.LC1 + oracle.M3 * oracle.A1) * np.sin(q1)
    inner += (oracle.M2 * oracle.LC2 + oracle.M4 * oracle.A2) * np.sin(q2)
    return oracle.GRAVITY * (
        inner + oracle.M3 * oracle.LC3 * np.sin(q1 + q3) + oracle.M4 * oracle.LC4 * np.sin(q2 + q4)
    )


def _closed_form_gravity(q):
    paper = oracle.sigma(q, 1)
    return oracle.rho(paper).T @ oracle.gravity(paper)


def _closed_form_well(q):
    """U of the paper's law, with NumPy alone."""
    error = GOAL - q
    potential = _closed_form_potential(oracle.sigma(q, 1)) - _closed_form_potential(oracle.sigma(GOAL, 1))
    return potential + error @ _closed_form_gravity(GOAL) + 0.5 * error @ (K_P * error)


def _closed_form_slope(q, step=1e-5):
    columns = [_closed_form_gravity(q + step * e) - _closed_form_gravity(q - step * e) for e in np.eye(2)]
    return np.linalg.norm(np.column_stack(columns) / (2 * step), 2)


@lru_cache
def _grid():
    """The closed form's well on a 2° grid over ±64° about the set point, where it can be assembled."""
    axis = np.radians(np.arange(-64.0, 64.5, 2.0))
    points = [GOAL + np.array([x, y]) for x in axis for y in axis]
    points = np.array([q for q in points if 0.01 < oracle.elongation(q) < 0.995])
    return points, np.array([_closed_form_well(q) for q in points])


def _where_the_gain_fails():
    """The least U along rays from the set point to where ‖∂g/∂q‖ of the closed form comes to be K_p's 11."""
    wells = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False):
        ray = np.array([np.cos(angle), np.sin(angle)])
        for before, far in pairwise(np.radians(np.arange(2.0, 64.0, 2.0))):
            if not 0.01 < oracle.elongation(GOAL + far * ray) < 0.995:
                break
            if _closed_form_slope(GOAL + far * ray) >= 11.0:
                edge = brentq(lambda x, ray=ray: _closed_form_slope(GOAL + x * ray) - 11.0, before, far)
                wells.append(_closed_form_well(GOAL + edge * ray))
                break
    return min(wells)


def _starts(certificate, rng, count):
    """Random states of B₂, some moving."""
    lower, upper = certificate.cells
    low, high, found = lower.min(axis=0), upper.max(axis=0), []
    law = certificate.law
    while len(found) < count:
        q = rng.uniform(low, high)
        if not certificate.contains(q):
            continue
        spare = certificate.level - law.lyapunov(q, np.zeros(len(q)))
        direction = rng.standard_normal(len(q))
        mass = law.model.terms(q, direction, law.q_free_d).D
        speed = np.sqrt(2.0 * spare * rng.uniform(0.0, 0.98) / (direction @ mass @ direction))
        assert certificate.contains(q, speed * direction)
        found.append((q, speed * direction))
    return found


# ---- the Lyapunov function ------------------------------------------------------------------------------------------


def check_rate(law, **times):
    """𝒱̇ is what is dissipated, and 𝒱 is its integral, along the paper's motion under a law."""
    trajectory = ccpin.simulate(law.model, law, START, rtol=1e-10, atol=1e-12, **times)
    history = lyapunov_along(law, trajectory)
    np.testing.assert_allclose(history.V_dot, history.dissipation, atol=1e-7)
    fallen = cumulative_simpson(history.V_dot, x=trajectory.t, initial=0.0)
    np.testing.assert_allclose(history.V - history.V[0], fallen, atol=1e-7)


@pytest.mark.parametrize("kind", [PDSimpleGravity, PDFullGravity])
def test_rate_along_solutions(rpdr_model, kind):
    """𝒱̇ = −q̇ᵀK_v q̇ along the paper's motion, and 𝒱 is its integral."""
    check_rate(kind(rpdr_model, GOAL, K_P, K_V), duration=0.4, sample_period=5e-4)


@pytest.mark.parametrize("kind", [PDSimpleGravity, PDFullGravity])
def test_dampers_are_in_the_rate(kind):
    """𝒱̇ = −q̇ᵀ(K_v + damping)q̇, and 𝒱 is its integral, where joints on and off the coordinates have dampers."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint1": {"damping": 0.2}, "joint4": {"damping": 0.3}}))
    check_rate(kind(model, GOAL, K_P, K_V), duration=0.15, sample_period=2e-4)


def test_rate_of_another_controller(rpdr_model):
    """The rate is that of the efforts that acted: without a motor it is not the law's."""
    law = PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    trajectory = ccpin.simulate(rpdr_model, None, START, duration=0.2, sample_period=5e-4)
    history = lyapunov_along(law, trajectory)
    fallen = cumulative_simpson(history.V_dot, x=trajectory.t, initial=0.0)
    np.testing.assert_allclose(history.V - history.V[0], fallen, atol=1e-6)
    assert np.abs(history.V_dot - history.dissipation).max() > 1.0


# ---- the RPDR against its closed form -------------------------------------------------------------------------------


@pytest.mark.slow
def test_rpdr_levels_are_below_the_truth_and_near():
    """c never exceeds the closed form's level, and is within a few per cent of it."""
    certificate = _case("rpdr", long=True)[1]
    about = -oracle.coincident_elbows()[None] + 1e-6 * np.column_stack(
        [np.cos(np.linspace(0, 2 * np.pi, 400)), np.sin(np.linspace(0, 2 * np.pi, 400))]
    )
    edge_of_domain = min(_closed_form_well(q) for q in about)
    gain_fails = _where_the_gain_fails()
    assert certificate.rigorous
    assert 0.95 * edge_of_domain < certificate.level_domain <= edge_of_domain
    assert 0.93 * gain_fails < certificate.level <= gain_fails + 1e-9
    assert certificate.limit == "gain"


@pytest.mark.parametrize("long", later(False, True))
def test_rpdr_beta_is_a_bound(long):
    """No sample of the closed form in 𝒬 has a larger ‖∂g/∂q‖ than β, and β is below the gains."""
    certificate = _case("rpdr", long)[1]
    inside = [q for q in _grid()[0] if certificate.contains(q)]
    assert len(inside) > 250
    assert max(_closed_form_slope(q) for q in inside) <= certificate.beta < certificate.gain == 11.0


@pytest.mark.parametrize("long", later(False, True))
def test_rpdr_sublevel_is_the_closed_forms(long):
    """Membership at rest is U < c: every grid point with U < c joined to q_d is inside, every other is not."""
    certificate = _case("rpdr", long)[1]
    points, well = _grid()
    inside = np.array([certificate.contains(q) for q in points])
    np.testing.assert_array_equal(inside, well < certificate.level)


def test_paper_start_is_not_covered(rpdr_model):
    """𝒱 at the paper's start is far above any level, though the gain condition holds on 𝒟."""
    law, certificate, _ = _case("rpdr")
    assert law.lyapunov(START, np.zeros(2)) == pytest.approx(_closed_form_well(START), abs=1e-9)
    assert _closed_form_well(START) > 4.0 * certificate.level_domain
    assert not certificate.contains(START)
    grid = [np.radians([a, b]) for a in np.arange(-150.0, -89.0, 4.0) for b in np.arange(-160.0, -99.0, 4.0)]
    assert max(_closed_form_slope(q) for q in grid) < 11.0


def test_kinetic_energy_counts():
    """At q_d a velocity is in B₂ exactly while its kinetic energy is below c."""
    certificate = _case("rpdr")[1]
    paper = oracle.sigma(GOAL, 1)
    mass = oracle.reduced_terms(paper, np.zeros(2))[0]
    speed = np.sqrt(2.0 * certificate.level / mass[0, 0])
    assert certificate.contains(GOAL, [0.999 * speed, 0.0])
    assert not certificate.contains(GOAL, [1.001 * speed, 0.0])


@pytest.mark.parametrize("name", ["rpdr", "delta", "stewart", "hexa"])
def test_well_is_at_least_c_on_the_boundary(name):
    """Attack the level: no point of the cells' outer faces has U below c, and no sample in a cell leaves its bounds."""
    law, certificate, _ = _case(name)
    rng, rest = np.random.default_rng(4), np.zeros(law.model.n)
    members = list(zip(*certificate.cells, _wells(certificate), strict=True))
    chosen = range(len(members)) if len(members) < 60 else rng.choice(len(members), 60, replace=False)
    for lower, upper, well in (members[k] for k in chosen):
        near = certificate._region.near(0.5 * (lower + upper))
        for q in rng.uniform(lower, upper, (4, law.model.n)):
            value = law.lyapunov(q, rest, near)
            assert abs(value - well.quadratic(q - well.centre)) <= well.remainder
            assert well.range_over(lower, upper).lower <= value
            assert np.linalg.norm(law.model.gravity_derivative(q, near), 2) <= well.beta
    assert min(law.lyapunov(q, rest) for q in _outer_points(certificate, rng)) >= certificate.level


def _wells(certificate):
    """U over the cells that hold 𝒬, as the claim has it."""
    claim, within = certificate.sublevel.claim, certificate.sublevel.found["within"]
    return claim.wells(certificate.sublevel.premises[0].claim.boxes.take(within))


def _outer_points(certificate, rng):
    """Random points of the members' faces that are in no other member."""
    lower, upper = certificate.cells
    found = []
    while len(found) < 150:
        k, axis, side = rng.integers(len(lower)), rng.integers(lower.shape[1]), rng.integers(2)
        q = rng.uniform(lower[k], upper[k])
        q[axis] = (lower, upper)[side][k, axis]
        holding = np.all((lower - 1e-12 <= q) & (q <= upper + 1e-12), axis=1)
        if holding.sum() == 1:
            found.append(q)
    return found


@pytest.mark.slow
def test_one_coordinate_against_the_well_itself():
    """Slider-crank: c is U at the nearest place where |∂g/∂q| reaches K_p, found by bisection on the model."""
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    q_d, k_p = 0.2, 0.02
    law = PDSimpleGravity(model, [q_d], [k_p], [0.01])
    certificate = certify_law(law)

    def slope(q):
        return abs(model.gravity_derivative([q])[0, 0])

    ends = []
    for direction in (-1.0, 1.0):
        steps = q_d + direction * np.linspace(0.0, 1.5, 300)
        first = next(k for k, q in enumerate(steps) if slope(q) >= k_p)
        ends.append(brentq(lambda q: slope(q) - k_p, *sorted(steps[first - 1 : first + 1])))
    truth = min(law.lyapunov(np.array([q]), np.zeros(1)) for q in ends)
    assert certificate.limit == "gain"
    assert 0.98 * truth < certificate.level <= truth


@settings(max_examples=150)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.booleans())
def test_range_over_a_part_of_a_box(seed, n, convex):
    """The bounds of a quadratic's minimum hold at any point, and are sharp where it is convex."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n))
    hessian = root @ root.T + 0.05 * np.eye(n) if convex else root + root.T
    well = Well(rng.standard_normal(n), 0.3, 2.0 * rng.standard_normal(n), hessian, 1e-3, 1.0, np.inf)
    lower = well.centre - rng.uniform(0.0, 1.0, n)
    upper = lower + rng.uniform(0.0, 2.0, n) * (rng.random(n) < 0.8)
    found = well.range_over(lower, upper)
    least = min(well.quadratic(q - well.centre) for q in rng.uniform(lower, upper, (300, n)))
    assert found.lower <= least - well.remainder + 1e-12
    assert np.all((lower - 1e-12 <= found.point) & (found.point <= upper + 1e-12))
    assert found.upper == pytest.approx(well.quadratic(found.point - well.centre) + well.remainder)
    if convex and n <= 2:
        assert found.upper - found.lower <= 2.0 * well.remainder + 1e-3


# ---- every start in B₂ converges ------------------------------------------------------------------------------------


def _converges(name, count, seed):
    law, certificate, duration = _case(name)
    for q, v in _starts(certificate, np.random.default_rng(seed), count):
        trajectory = ccpin.simulate(
            law.model, law, q, v, duration=duration, rtol=1e-6, atol=1e-9, sample_period=duration / 20
        )
        assert trajectory.status == "finished"
        first = law.lyapunov(q, v)
        last = law.lyapunov(trajectory.q[-1], trajectory.v[-1], trajectory.q_free[-1])
        assert all(certificate.contains(*state) for state in zip(trajectory.q, trajectory.v, strict=True))
        assert last < 1e-3 * min(first, certificate.level) + 1e-12


@pytest.mark.parametrize(("name", "count"), [("rpdr", 15), ("delta", 5), ("stewart", 5)])
def test_starts_in_the_set_converge(name, count):
    """Random states of B₂ stay in it and go to the set point."""
    _converges(name, count, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rpdr", "delta", "stewart"])
def test_a_thousand_starts_converge(name):
    """The same for a thousand."""
    _converges(name, 1000, 1)


# ---- what is refused ------------------------------------------------------------------------------------------------


def test_gain_below_the_slope_is_refused_and_runs_away(rpdr_model):
    """Upright, ∂g/∂q = −1.56 N m/rad in one direction: K_p = 0.4 is refused and runs away, K_p = 11 is certified."""
    slope = rpdr_model.gravity_derivative(UPRIGHT, UPRIGHT_MODE)
    assert np.linalg.eigvalsh(slope)[0] < -1.0
    weak = PDSimpleGravity(rpdr_model, UPRIGHT, [0.4, 0.4], K_V, UPRIGHT_MODE)
    refused = certify_law(weak)
    assert refused.verdict == "refuted"
    assert refused.stiffness < 0.0
    assert "not stable" in refused.reason
    assert not refused.contains(UPRIGHT)
    off = UPRIGHT + np.array([2e-3, -1e-3])
    gone = ccpin.simulate(rpdr_model, weak, off, duration=3.2, near=UPRIGHT_MODE)
    assert np.abs(gone.q[-1] - UPRIGHT).max() > 0.3
    strong = PDSimpleGravity(rpdr_model, UPRIGHT, K_P, K_V, UPRIGHT_MODE)
    certificate = certify_law(strong, max_depth=8, budget=120)
    assert certificate.verdict == "proven"
    assert certificate.contains(off)
    back = ccpin.simulate(rpdr_model, strong, off, duration=3.2, near=UPRIGHT_MODE)
    assert np.abs(back.q[-1] - UPRIGHT).max() < 1e-8


def test_gain_condition_is_sufficient_only(rpdr_model):
    """Where K_p is below ‖∂g/∂q‖ but K_p + ∂g/∂q is positive definite, Theorem 3 is silent, and says why."""
    reference = rpdr_model.alpha(rpdr_model.mechanism.q_reference)
    certificate = certify_law(PDSimpleGravity(rpdr_model, reference, [1.2, 1.2], K_V))
    assert certificate.verdict == "refuted"
    assert certificate.stiffness > 0.0
    assert "gain condition fails" in certificate.reason


def test_full_matrix_gains(rpdr_model):
    """k is the least eigenvalue of a K_p that is not diagonal."""
    matrix = np.array([[14.0, 4.0], [4.0, 9.0]])
    certificate = certify_law(PDSimpleGravity(rpdr_model, GOAL, matrix, K_V), max_depth=8, budget=100)
    assert certificate.gain == pytest.approx(11.5 - np.sqrt(2.5**2 + 16.0))
    assert certificate.verdict == "proven"


def test_bad_input_is_refused(rpdr_model):
    """Another law, a region that does not hold q_d, motors elsewhere: each is named."""
    with pytest.raises(InvalidInputError, match="simple gravity"):
        certify_law(PDFullGravity(rpdr_model, GOAL, K_P, K_V))
    law = PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    with pytest.raises(InvalidInputError, match="outside of the region"):
        certify_law(law, (GOAL + 0.1, GOAL + 0.2))
    with pytest.raises(InvalidInputError, match="below its upper corner"):
        certify_law(law, (GOAL + 0.1, GOAL - 0.2))
    with pytest.raises(InvalidInputError, match=r"\(lower, upper\), each of shape"):
        certify_law(law, np.zeros((3, 2)))
    with pytest.raises(InvalidInputError, match=r"a mechanism .* or a ReducedModel is needed, not str"):
        certify_set_point("rpdr", GOAL, K_P, K_V)


@pytest.mark.parametrize("motors", [("joint3", "joint4"), ("joint3", "joint2"), ("joint1", "joint2", "joint4")])
def test_motors_elsewhere_than_on_the_coordinates(motors):
    """B₂ is that of motors on q, and over its cells the bound on ρᵀSᵀ's least singular value is never exceeded."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", independent=["joint1", "joint2"], actuated=list(motors)))
    certificate = certify_set_point(model, GOAL, K_P, K_V, max_depth=8, budget=60)
    assert certificate.verdict == "proven"
    rng = np.random.default_rng(2)
    for lower, upper, well in list(zip(*certificate.cells, _wells(certificate), strict=True))[::3]:
        assert 0.0 < well.effort < np.inf
        for q in rng.uniform(lower, upper, (8, 2)):
            state = model.at(q, certificate.law.near)
            least = np.linalg.svd(state.reference.transmission, compute_uv=False)[-1]
            assert well.effort <= least + 1e-12


def test_where_motors_lose_their_grip_the_set_ends():
    """Motors on joints 1 and 3 lose their grip where arm 2 turns back; no member cell holds such q."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", independent=["joint1", "joint2"], actuated=["joint1", "joint3"]))
    certificate = certify_set_point(model, GOAL, [60.0, 60.0], K_V, max_depth=9, budget=400)
    rng = np.random.default_rng(3)
    for lower, upper in zip(*certificate.cells, strict=True):
        for q in rng.uniform(lower, upper, (3, 2)):
            state = model.at(q, certificate.law.near)
            assert np.linalg.svd(state.reference.transmission, compute_uv=False)[-1] > 0.0
    assert certificate.verdict == "proven"


# ---- other domains --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def atlas(rpdr):
    """A square of ±30° about the goal."""
    region = GOAL - np.radians(30.0), GOAL + np.radians(30.0)
    return certify(rpdr, GOAL, region, max_depth=8)


def test_atlas_as_domain(rpdr_model, atlas):
    """With an atlas the level is limited by its edge, and below the closed form's least U there."""
    law = PDSimpleGravity(rpdr_model, GOAL, [20.0, 20.0], K_V)
    certificate = certify_law(law, atlas)
    assert certificate.rigorous
    assert certificate.limit == "domain"
    assert "boxes of an atlas" in certificate.method
    side = np.linspace(-1.0, 1.0, 121) * np.radians(30.0)
    edges = [GOAL + np.radians(30.0) * s * e + t * e[::-1] for s in (-1, 1) for e in np.eye(2) for t in side]
    least = min(_closed_form_well(q) + 4.5 * (q - GOAL) @ (q - GOAL) for q in edges)
    assert 0.98 * least < certificate.level <= least
    assert certificate.contains(GOAL + np.radians([15.0, -15.0]))
    assert not certificate.contains(GOAL + np.radians([29.9, 0.0]))


@pytest.mark.slow
def test_atlas_in_space():
    """Delta, a cube of ±10°: the proved level is just below the least U of samples on its faces; β bounds samples."""
    law = _case("delta")[0]
    half, model = np.radians(10.0), law.model
    region = np.full(3, -half), np.full(3, half)
    cube = certify(model.mechanism, np.zeros(3), region, max_depth=4)
    certificate = certify_law(law, cube)
    rng = np.random.default_rng(2)
    faces = rng.uniform(-half, half, (300, 3))
    faces[np.arange(300), rng.integers(3, size=300)] = half * rng.choice([-1.0, 1.0], 300)
    axes = half * np.vstack([np.eye(3), -np.eye(3)])
    least = min(law.lyapunov(q, np.zeros(3)) for q in [*faces, *axes])
    assert certificate.limit == "domain"
    assert 0.97 * least < certificate.level <= least
    inside = [q for q in rng.uniform(-half, half, (200, 3)) if certificate.contains(q)]
    assert len(inside) > 40
    assert max(np.linalg.norm(model.gravity_derivative(q), 2) for q in inside) <= certificate.beta < 30.0


@pytest.mark.slow
def test_the_whole_branch_as_domain(rpdr, rpdr_model):
    """The default atlas, thousands of boxes, is no work spent: about the goal the level is that of cells laid there."""
    branch = certify(rpdr, GOAL)
    certificate = certify_set_point(rpdr_model, GOAL, K_P, K_V, branch)
    assert certificate.verdict == "proven"
    around = certify_set_point(rpdr_model, GOAL, K_P, K_V)
    assert certificate.level == pytest.approx(around.level, rel=0.02)
    with pytest.raises(UnattainableGainsError, match="near a singularity") as refused:
        suggest_gains(rpdr_model, GOAL, branch)
    assert refused.value.gains.verdict == "proven"


def test_a_budget_spent_is_told_as_that(rpdr_model):
    """One box far too coarse for the gains: undecided, never "the gain condition fails"; more work proves it."""
    half = np.radians(14.0)
    coarse = certify(rpdr_model.mechanism, GOAL, (GOAL - half, GOAL + half), max_depth=0)
    K_p = [7.0, 7.0]
    spent = certify_set_point(rpdr_model, GOAL, K_p, K_V, coarse, max_depth=0, budget=0)
    assert spent.verdict == "undecided"
    assert spent.slope < spent.gain
    assert "budget" in spent.reason
    assert certify_set_point(rpdr_model, GOAL, K_p, K_V, coarse).verdict == "proven"


def test_atlas_of_another_branch_or_place(rpdr_model, atlas):
    """A set point outside of the atlas, on another branch, or of another mechanism is refused."""
    elsewhere = PDSimpleGravity(rpdr_model, np.radians([-150.0, -150.0]), K_P, K_V)
    with pytest.raises(InvalidInputError, match="not in the atlas"):
        certify_law(elsewhere, atlas)
    up = oracle.sigma(GOAL, -1)[[0, 2, 1, 3]]
    with pytest.raises(InvalidInputError, match="another branch"):
        certify_law(PDSimpleGravity(rpdr_model, GOAL, K_P, K_V, up), atlas)
    slider = ccpin.ReducedModel(ccpin.load("slider_crank"))
    law = PDSimpleGravity(slider, slider.alpha(slider.mechanism.q_reference), [1.0], [1.0])
    with pytest.raises(DifferentSubjectsError, match="closures or independent"):
        certify_law(law, atlas)


def test_plain_region_says_it_is_sampled(rpdr_model):
    """Over a region the figures are estimates that say so, close to those of an atlas of the same region."""
    law = PDSimpleGravity(rpdr_model, GOAL, [20.0, 20.0], K_V)
    half = np.radians(30.0)
    certificate = certify_law(law, (GOAL - half, GOAL + half))
    assert not certificate.rigorous
    assert "sampled" in certificate.method
    side = np.linspace(-half, half, 400)
    edges = [GOAL + half * s * e + t * e[::-1] for s in (-1, 1) for e in np.eye(2) for t in side]
    least = min(_closed_form_well(q) + 4.5 * (q - GOAL) @ (q - GOAL) for q in edges)
    assert certificate.level == pytest.approx(least, rel=5e-3)
    assert certificate.contains(GOAL)
    assert not certificate.contains(GOAL - 2 * half)


def test_region_with_the_goal_at_its_corner(rpdr_model):
    """𝒟 itself holds no B₂: the paper's goal is a corner of it."""
    certificate = certify_law(PDSimpleGravity(rpdr_model, GOAL, K_P, K_V), (START, GOAL))
    assert certificate.verdict == "undecided"
    assert certificate.beta < 11.0


# ---- gains ----------------------------------------------------------------------------------------------------------


def test_suggested_gains_damp_every_mode(rpdr, rpdr_model):
    """K_p is the margin over a proved β, and the linearised loop's poles all have the damping asked for."""
    half = np.radians(16.0)
    atlas = certify(rpdr, GOAL, (GOAL - half, GOAL + half), max_depth=8)
    gains = suggest_gains(rpdr_model, GOAL, atlas, margin=1.3, damping=0.6)
    steepest = max(_closed_form_slope(q) for q in _grid()[0] if np.abs(q - GOAL).max() <= half + 1e-9)
    assert gains.verdict == "proven"
    assert steepest <= gains.beta <= 1.07 * steepest
    assert 0.95 * gains.beta <= gains.beta_seen <= gains.beta
    np.testing.assert_allclose(gains.K_p, 1.3 * gains.beta * np.eye(2))
    law = PDSimpleGravity(rpdr_model, GOAL, gains.K_p, gains.K_v)
    loop = linearize(rpdr_model, GOAL, law.gravity_d).closed_loop(-gains.K_p, -gains.K_v)
    poles = np.linalg.eigvals(loop)
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.6, atol=1e-8)
    np.testing.assert_allclose(np.sort(np.abs(poles))[::2], gains.frequencies, rtol=1e-8)
    assert certify_law(law, atlas).verdict == "proven"


@pytest.fixture
def few_cells(monkeypatch):
    """No more than 200 cells are proved for a slope that no number of them bounds well."""
    monkeypatch.setattr(gains_module, "gravity_slope_over", partial(gravity_slope_over, cells=200))


def test_gains_beside_a_singularity_say_what_limits_them(rpdr_model, atlas, few_cells):
    """The ±30° square ends 3° from the isolated singular point, where ∂g/∂q has no useful bound: that is said."""
    store = cells_of_atlas(PDSimpleGravity(rpdr_model, GOAL, K_P, K_V), atlas)
    slope = gravity_slope_over(store, cells=200)
    assert slope.bound > 2.0 * slope.seen
    assert 200 <= slope.proved <= 202
    with pytest.raises(UnattainableGainsError, match="joint1 for up to") as refused:
        suggest_gains(rpdr_model, GOAL, atlas)
    gains = refused.value.gains
    singular = np.radians([-56.9, -123.1])  # (56.9°, 123.1°) in the paper's upper half, mirrored
    assert np.abs(gains.steepest - singular).max() < np.radians(6.0)


def test_gains_are_held_against_the_motors(rpdr):
    """A motor that gives 1 N m is asked for more by K_p over ±16°: which, and by how much, is said."""
    half = np.radians(16.0)
    atlas = certify(rpdr, GOAL, (GOAL - half, GOAL + half), max_depth=5)
    weak = ccpin.load("rpdr", motors={"joint1": {"lower": -1.0, "upper": 1.0}})
    told = r"K_p = \S+ I N m/rad asks joint1 for up to \S+ of its 1 N m from rest"
    with pytest.raises(UnattainableGainsError, match=told) as refused:
        suggest_gains(ccpin.ReducedModel(weak), GOAL, atlas)
    gains = refused.value.gains
    law = PDSimpleGravity(ccpin.ReducedModel(weak), GOAL, gains.K_p, gains.K_v)
    corners = [GOAL + half * np.array(signs) for signs in ((-1, -1), (-1, 1), (1, -1), (1, 1))]
    asked = np.abs([law.torque(0.0, Measurement(q), np.zeros(2)) for q in corners]).max(axis=0)
    np.testing.assert_allclose(gains.effort, asked, rtol=1e-6)
    assert "joint2" not in str(refused.value)
    assert suggest_gains(ccpin.ReducedModel(rpdr), GOAL, atlas).effort_limit.shape == (2,)


@pytest.mark.parametrize("motors", [("joint3", "joint4"), ("joint1", "joint2", "joint4")])
def test_effort_of_motors_elsewhere_bounds_what_is_asked_anywhere(motors):
    """u = (ρᵀSᵀ)⁺τ changes with q: no motor is asked for more at any q of the atlas, corners included."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", independent=["joint1", "joint2"], actuated=list(motors)))
    half = np.radians(16.0)
    atlas = certify(model.mechanism, GOAL, (GOAL - half, GOAL + half), max_depth=8)
    gains = suggest_gains(model, GOAL, atlas)
    law = PDSimpleGravity(model, GOAL, gains.K_p, gains.K_v)
    signs = np.array([(s, t) for s in (-1, 0, 1) for t in (-1, 0, 1)])
    asked = np.abs([law.torque(0.0, Measurement(GOAL + half * sign), np.zeros(2)) for sign in signs]).max(axis=0)
    assert gains.effort.shape == (len(motors),)
    assert np.all(asked <= gains.effort)
    assert np.all(gains.effort < 50.0 * asked.max())


def test_gains_over_a_region(rpdr_model):
    """Over a plain region β is the largest sample: 7.25 N m/rad on 𝒟 by the closed form."""
    gains = suggest_gains(rpdr_model, GOAL, (START, GOAL))
    expected = max(_closed_form_slope(np.radians([-90.0, b])) for b in np.arange(-160.0, -99.0, 0.5))
    assert gains.verdict == "undecided"
    assert gains.beta == pytest.approx(expected, rel=5e-3)


@pytest.mark.slow
def test_gains_no_loop_could_be_closed_with_are_refused(rpdr, rpdr_model, few_cells):
    """Whatever the motors give: beside a singularity K_p was 8e10 N m/rad."""
    half = np.radians(16.0)
    atlas = certify(rpdr, GOAL, (GOAL - half, GOAL + half), max_depth=5)
    gains = suggest_gains(rpdr_model, GOAL, atlas)
    assert gains.frequencies[-1] < 1e3
    with pytest.raises(UnattainableGainsError, match=r"makes a mode of .* rad/s, faster than 10"):
        suggest_gains(rpdr_model, GOAL, atlas, fastest=10.0)
    with pytest.raises(UnattainableGainsError, match="near a singularity"):
        suggest_gains(rpdr_model, GOAL, certify(rpdr, GOAL, max_depth=6))


@pytest.mark.parametrize("bad", [{"margin": 1.0}, {"margin": np.nan}, {"damping": 0.0}])
def test_bad_margins(rpdr_model, bad):
    """A margin of one or less, or no damping, is refused."""
    with pytest.raises(InvalidInputError, match=r"(margin|damping) = .* must be a (number above 1|positive number)"):
        suggest_gains(rpdr_model, GOAL, (START, GOAL), **bad)


# ---- pictures -------------------------------------------------------------------------------------------------------


def test_pictures(tmp_path, rpdr_model):
    """Both figures are written; the sublevel picture refuses other than two coordinates."""
    law, certificate, _ = _case("rpdr")
    trajectory = ccpin.simulate(rpdr_model, law, START, duration=0.05)
    history = lyapunov_along(law, trajectory)
    plotting.save(plotting.plot_lyapunov(trajectory.t, history, certificate.level), tmp_path / "v.png")
    window = (GOAL - 0.6, GOAL + 0.6)
    figure = plotting.plot_sublevel(certificate, [GOAL + 0.1, START], window)
    words = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "start 1: in B₂" in words
    assert "start 2: outside of B₂" in words
    plotting.save(figure, tmp_path / "u.png")
    assert all((tmp_path / name).read_bytes()[:4] == b"\x89PNG" for name in ("v.png", "u.png"))
    with pytest.raises(CcpinError, match="3 coordinates"):
        plotting.plot_sublevel(_case("delta")[1])


def test_the_call_by_set_point_is_that_of_its_law(rpdr_model):
    """certify_set_point(model, q_d, K_p, K_v) makes the law (28) and certifies it."""
    budget = {"max_depth": 8, "budget": 100}
    by_gains = certify_set_point(rpdr_model, GOAL, K_P, K_V, **budget)
    by_law = certify_law(PDSimpleGravity(rpdr_model, GOAL, K_P, K_V), **budget)
    assert by_gains.level == by_law.level > 0.0
    assert by_gains.rigorous
