"""Theorem N: its bounds against what they bound, its boxes against closed forms, wrong claims against its check."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import extrapolate, glued, newton
from ccpin.description import Joint
from ccpin.domain import certify_path, kantorovich_radius
from ccpin.domain.atlas.square import newton_steps
from ccpin.domain.closures.system import reading_of
from ccpin.errors import ConvergenceError, InvalidInputError, SingularConfigurationError, UnsupportedMechanismError
from ccpin.proof.equations import closure_values, closures_of, derivatives, problem_of
from ccpin.proof.newton import bounds_of, check, predict, solve_in_boxes
from tests.oracles import rpdr as oracle
from tests.support.ball_joint import ball_joint
from tests.support.closures import ARMS, KINDS, PLANAR, SPATIAL, closed_problem, open_problem, two_arms
from tests.support.long_cases import later

CENTRES = ((-108.0, -72.0), (-108.0, -48.0), (-108.0, -120.0), (-70.0, -110.0))
EXACT = (15.056, 3.467, 40.737, 13.056)
REACH = (7.9, 2.8, 6.3, 3.5)
at_centres = pytest.mark.parametrize(("centre", "exact", "reach"), [*zip(CENTRES, EXACT, REACH, strict=True)])


def centre_of(rpdr, degrees, mode=1.0):
    q1, q2, q3, q4 = oracle.sigma(np.radians(degrees), mode)
    return np.array([q1, q3, q2, q4])


def assert_bounds_hold(problem, theta, trials):
    """Y, Z̄R, Zw and the curvature are not exceeded in boxes of many sizes about θ, and Y is not idle."""
    system, rng = problem.system, np.random.default_rng(1)
    n, m, count = system.n, system.m, 8
    widths = np.geomspace(1e-3, 0.8, count)
    boxes = certify_boxes(problem, np.tile(theta, (count, 1)), np.repeat(widths[:, None], n, 1), np.eye(n)).boxes
    skew = rng.standard_normal((count, m, m)) * 0.2 + np.eye(m)
    boxes = boxes._replace(
        modes=boxes.modes @ skew,
        preconditioner=np.linalg.inv(skew) @ boxes.preconditioner,
        radius=widths[:, None] * rng.uniform(0.1, 1, (count, m)),
        weight=rng.uniform(0.5, 1, (count, m)),
    )
    found = bounds_of(problem, boxes)
    image, shrunk = (
        found.mean(boxes.radius).of(boxes.radius),
        found.contraction(boxes.radius).of(boxes.weight),
    )
    curvature = found.curvature(boxes.radius, boxes.weight)

    def slope(delta, zeta):
        jacobian = closure_values(problem, predict(problem, boxes, delta, zeta))[1][:, :, system.dependent]
        return boxes.preconditioner @ jacobian @ boxes.modes

    closest = 0.0
    for trial in range(trials):
        sides = (
            rng.choice([-1.0, 1.0], (2, count, max(n, m))) if trial % 2 else rng.uniform(-1, 1, (2, count, max(n, m)))
        )
        delta, zeta = boxes.half * sides[0, :, :n], boxes.radius * sides[1, :, :m]
        phi = closure_values(problem, predict(problem, boxes, delta))[0]
        f = np.abs((boxes.preconditioner @ phi[..., None])[..., 0])
        assert np.all(f <= found.y)
        whole = closure_values(problem, predict(problem, boxes, delta, zeta))[0]
        step = zeta - (boxes.preconditioner @ (whole - phi)[..., None])[..., 0]
        assert np.all(np.abs(step) <= image)
        defect = np.abs(np.eye(m) - slope(delta, zeta)) @ boxes.weight[..., None]
        assert np.all(defect[..., 0] <= shrunk)
        other = boxes.radius * rng.uniform(-1, 1, (count, m))
        gap = np.max(np.abs(zeta - other) / boxes.weight, axis=1)
        change = np.abs(slope(delta, zeta) - slope(delta, other)) @ boxes.weight[..., None]
        assert np.all(change[..., 0] <= curvature * gap[:, None] + 1e-12)
        closest = max(closest, float(np.max(f / found.y)))
    assert closest > 0.2


@pytest.mark.parametrize("arms", ARMS.values(), ids=ARMS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("states", later(2, 6))
def test_chains_give_the_constraints_of_every_kind_of_joint_and_closure(arms, kind, states):
    """φ from chains is φ of `Constraints` at random configurations, and φ_θ is its derivative in the chart."""
    mechanism = two_arms(arms, kind)
    reading = reading_of(mechanism, mechanism.q_reference)
    system = reading.system
    constraints, rng = mechanism.constraints(), np.random.default_rng(5)
    theta = rng.uniform(-1.2, 1.2, (states, mechanism.n_free))
    step = 1e-6
    phi, jacobian = closure_values(problem_of(system, "reach"), theta)
    for k, row in enumerate(theta):
        assert np.abs(phi[k] - constraints.residual(reading.configuration(row))).max() < 1e-13
        for j in range(mechanism.n_free):
            ahead, behind = row + step * np.eye(len(row))[j], row - step * np.eye(len(row))[j]
            slope = constraints.residual(reading.configuration(ahead))
            slope = slope - constraints.residual(reading.configuration(behind))
            assert np.abs(jacobian[k, :, j] - slope / (2 * step)).max() < 1e-8
    assert np.abs(reading.chart.theta(reading.configuration(theta[0])) - theta[0]).max() < 1e-12


@pytest.mark.parametrize("name", [*PLANAR, *SPATIAL])
def test_second_derivatives(name):
    """φ_θθ is the derivative of Pinocchio's φ_q′."""
    mechanism = ccpin.load(name)
    system, constraints = reading_of(mechanism, mechanism.q_reference).system, mechanism.constraints()
    rng, step = np.random.default_rng(0), 1e-6
    theta = rng.uniform(-3, 3, (3, mechanism.n_free))
    found = derivatives(problem_of(system, "reach"), theta)
    for k, row in enumerate(theta):
        along = rng.standard_normal(len(row))
        ahead = constraints.value(row + step * along).jacobian
        rate = (ahead - constraints.value(row - step * along).jacobian) / (2 * step)
        assert np.abs(found.jacobian[k] - constraints.value(row).jacobian).max() < 1e-14 * (1 + np.abs(row).max()) * 10
        assert np.abs(found.hessian[k] @ along - rate).max() < 3e-9


@pytest.mark.parametrize(
    ("name", "bounds"), [(n, "planar") for n in PLANAR] + [(n, "reach") for n in (*PLANAR, *SPATIAL)]
)
@pytest.mark.parametrize("trials", later(30, 80))
def test_bounds_bound(name, bounds, trials):
    """Y, Z, Z̄ and the curvature are never exceeded at random points and corners of small, large and skewed boxes."""
    problem, theta = closed_problem(name, bounds)
    assert_bounds_hold(problem, theta, trials)


@pytest.mark.parametrize("arms", ARMS.values(), ids=ARMS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("trials", later(10, 30))
def test_bounds_bound_for_every_kind_of_closure(arms, kind, trials):
    """The same at open configurations of chains with directions, offsets, slides after turns and many-axis joints."""
    assert_bounds_hold(*open_problem(arms, kind), trials)


@at_centres
def test_one_shot_radius_of_the_rpdr(rpdr, centre, exact, reach):
    """One box certifies most of what the closed form allows, never more, and the planar bounds more than reach."""
    q_free = centre_of(rpdr, centre)
    generic, planar = (
        np.degrees(kantorovich_radius(rpdr, q_free)),
        np.degrees(kantorovich_radius(rpdr, q_free, "planar")),
    )
    assert reach <= generic < planar < exact
    assert kantorovich_radius(rpdr, q_free, "auto") == np.radians(planar)


@at_centres
def test_newton_steps_suffice(rpdr, centre, exact, reach):
    """After the number of steps promised Newton is at σ, from the predictor, at corners and inside of the square."""
    q_free, rng = centre_of(rpdr, centre), np.random.default_rng(2)
    radius = 0.5 * kantorovich_radius(rpdr, q_free, "planar")
    steps = newton_steps(rpdr, q_free, radius, 1e-10)
    assert 1 <= steps <= 6
    assert newton_steps(rpdr, q_free, radius / 100, 1e-10) < steps
    problem = reading_of(rpdr, q_free).problem
    moves = radius * np.concatenate([rng.uniform(-1, 1, (60, 2)), [[1, 1], [-1, 1], [1, -1]]])
    found = newton(problem, extrapolate(problem, q_free, moves), steps).theta
    for q1, q3, q2, q4 in found:
        gap = np.array([q1, q2, q3, q4]) - oracle.sigma((q1, q2), 1.0)
        assert np.abs(np.remainder(gap + np.pi, 2 * np.pi) - np.pi).max() < 1e-10 + 1e-12


def test_newton_steps_refuse_too_large_a_square(rpdr):
    """Beyond what is guaranteed an error says what is."""
    q_free = centre_of(rpdr, CENTRES[0])
    with pytest.raises(ConvergenceError, match="too large"):
        newton_steps(rpdr, q_free, 0.3)
    with pytest.raises(InvalidInputError, match="positive"):
        newton_steps(rpdr, q_free, -0.1)


def altered(boxes, **changes):
    return boxes._replace(**{name: getattr(boxes, name) + change for name, change in changes.items()})


def test_wrong_claims_are_caught(rpdr):
    """Boxes whose square, tube, centre, weights or contraction factor claims too much fail the check."""
    problem, theta = reading_of(rpdr, rpdr.q_reference).problem, centre_of(rpdr, CENTRES[0])
    half = np.full((1, 2), np.radians(12.0))
    attempt = certify_boxes(problem, theta[None], half, np.eye(2))
    boxes = attempt.boxes
    assert attempt.proved[0]
    assert check(closures_of(problem), boxes).proved[0]
    wrong = {
        "wider square": altered(boxes, half=np.radians(5.0)),
        "wider tube": boxes._replace(radius=boxes.radius * 30),
        "narrower tube": boxes._replace(radius=boxes.radius * 0.5),
        "moved centre": altered(boxes, centre=np.array([0.0, 0.2, 0.0, 0.0])),
        "moved q": altered(boxes, centre=np.array([0.15, 0.0, 0.0, 0.0])),
        "other slope": altered(boxes, directions=np.full((1, 4, 2), 0.5)),
        "other preconditioner": boxes._replace(preconditioner=-boxes.preconditioner),
        "no contraction": boxes._replace(kappa=boxes.kappa * 0.5),
        "kappa one": boxes._replace(kappa=np.ones(1)),
        "negative weight": boxes._replace(weight=-boxes.weight),
        "not a number": boxes._replace(centre=np.full((1, 4), np.nan)),
    }
    for reason, claim in wrong.items():
        assert not check(closures_of(problem), claim).proved[0], reason


def test_other_assembly_mode_is_not_glued(rpdr):
    """Neighbouring boxes of one mode are glued at their common face, those of different modes are not."""
    problem, half = reading_of(rpdr, rpdr.q_reference).problem, np.full((2, 2), np.radians(3.0))
    left, right = (centre_of(rpdr, (angle, -90.0)) for angle in (-100.0, -94.0))
    other = centre_of(rpdr, (-94.0, -90.0), mode=-1.0)
    turned = right + 2 * np.pi * np.array([0, 1, 0, -1])
    boxes = certify_boxes(problem, np.array([left, right]), half, np.eye(2))
    rest = certify_boxes(problem, np.array([other, turned]), half, np.eye(2))
    assert boxes.proved.all()
    assert rest.proved.all()
    first, second = boxes.boxes.take(np.array([0, 0, 0])), boxes.boxes.take(np.array([1]))
    neighbours = type(first)(*(np.concatenate(pair) for pair in zip(second, rest.boxes, strict=True)))
    face = np.array([[half[0, 0], 0.0]] * 3)
    assert glued(problem, first, face, neighbours, -face).tolist() == [True, False, True]


def test_certified_iteration_cannot_fail(rpdr):
    """σ is found from every corner of a square only just certified, where κ is close to 1."""
    q_free = centre_of(rpdr, CENTRES[1])
    problem = reading_of(rpdr, q_free).problem
    half = np.full((4, 2), kantorovich_radius(rpdr, q_free, "planar"))
    attempt = certify_boxes(problem, np.tile(q_free, (4, 1)), half, np.eye(2))
    corners = half * [[1, 1], [1, -1], [-1, 1], [-1, -1]]
    found = solve_in_boxes(problem, attempt.boxes, corners)
    for (q1, q3, q2, q4), error in zip(found.theta, found.error, strict=True):
        expected = oracle.sigma((q1, q2), 1.0)
        gap = np.remainder(np.array([q3 - expected[2], q4 - expected[3]]) + np.pi, 2 * np.pi) - np.pi
        assert np.abs(gap).max() < 1e-9
        assert error.max() < 1e-8


@pytest.mark.parametrize("name", ["bennett", "sarrus"])
def test_redundant_rows_are_refused(name):
    """Bennett's and Sarrus' linkages keep redundant rows, about which a choice of rows would prove nothing."""
    mechanism = ccpin.load(name)
    with pytest.raises(UnsupportedMechanismError, match=r"5 rows of rank \d"):
        kantorovich_radius(mechanism, mechanism.q_reference)


def test_rotations_as_independent_coordinates_are_refused():
    """A quaternion has no box of scalar coordinates."""
    mechanism = ball_joint().mechanism
    with pytest.raises(UnsupportedMechanismError, match="'shoulder' is independent"):
        kantorovich_radius(mechanism, mechanism.q_reference)


def test_bad_input(rpdr):
    """Shapes, singular configurations and unsuitable bounds are refused in words."""
    with pytest.raises(InvalidInputError, match="4 finite numbers"):
        kantorovich_radius(rpdr, np.zeros(3))
    delta = ccpin.load("delta")
    with pytest.raises(UnsupportedMechanismError, match="planar bounds"):
        kantorovich_radius(delta, delta.q_reference, "planar")
    q1, q2 = oracle.coincident_elbows()
    with pytest.raises(SingularConfigurationError):
        kantorovich_radius(rpdr, np.array([q1, 0.3 - q1, q2, 0.3 - q2]))


@pytest.mark.parametrize("name", SPATIAL)
def test_spatial_balls_hold_sigma(name):
    """Inside the certified ball of the Delta, the Gough-Stewart platform and the Hexa σ is where Newton finds it."""
    mechanism, rng = ccpin.load(name), np.random.default_rng(4)
    radius = kantorovich_radius(mechanism, mechanism.q_reference)
    assert radius > 3e-3
    problem, theta = closed_problem(name, "reach")
    attempt = certify_boxes(problem, np.tile(theta, (20, 1)), np.full((20, mechanism.n), radius), np.eye(mechanism.n))
    delta = radius * rng.choice([-1.0, 1.0], (20, mechanism.n))
    found = solve_in_boxes(problem, attempt.boxes, delta)
    parametrization = mechanism.parametrization()
    for row in found.theta:
        expected = parametrization.sigma(row[problem.system.independent]).q_free
        assert np.abs(row - expected).max() < 1e-9


def floating_delta():
    """The Delta with its platform on one floating joint instead of three slides and three turns."""
    description = ccpin.load("delta").description
    chain = [joint for joint in description.joints if joint.name.startswith("platform_")]
    inner = {joint.child for joint in chain} - {"platform"}
    joints = tuple(joint for joint in description.joints if joint not in chain)
    free = Joint("platform_joint", "floating", chain[0].parent, "platform", chain[0].placement)
    position = tuple(description.reference[f"platform_{axis}"][0] for axis in "xyz")
    reference = {name: value for name, value in description.reference.items() if name not in {j.name for j in chain}}
    links = tuple(link for link in description.links if link.name not in inner)
    changed = replace(
        description,
        joints=(free, *joints),
        links=links,
        reference=reference | {"platform_joint": (*position, 0.0, 0.0, 0.0, 1.0)},
    )
    return ccpin.load(changed, independent=["arm1", "arm2", "arm3"])


def test_a_floating_joint_is_as_good_as_its_six_parts():
    """The Delta on a floating joint has the ball and the path of the Delta on slides and turns, and the same σ."""
    parts, whole = ccpin.load("delta"), floating_delta()
    radius = kantorovich_radius(parts, parts.q_reference)
    assert kantorovich_radius(whole, whole.q_reference) == pytest.approx(radius, rel=1e-6)
    line = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.25]])
    path, other = certify_path(whole, line), certify_path(parts, line)
    assert path.verdict == "proven"
    found, expected = path.sigma(1.0), other.sigma(1.0)
    assert np.abs(whole.constraints().residual(found)).max() < 1e-12
    arms = [list(m.pin_model.names).index("arm1") for m in (whole, parts)]
    first = [int(m.pin_model.idx_qs[k]) for m, k in zip((whole, parts), arms, strict=True)]
    assert np.abs(found[first[0] : first[0] + 5] - expected[first[1] : first[1] + 5]).max() < 1e-9
    assert np.abs(whole.parametrization().sigma(line[1]).q_free - found).max() < 1e-9
