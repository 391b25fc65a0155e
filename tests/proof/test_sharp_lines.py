"""What Proposition L rests on: every condition is asked, at the ends of each inequality, and of facts that fit."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

import ccpin
from ccpin.domain.closures.system import reading_of
from ccpin.domain.paths.refutation import _join, _on_branch
from ccpin.domain.paths.walker import Walker
from ccpin.domain.singular.folds import singular_points
from ccpin.proof import lines as module
from ccpin.proof.equations import Closures, closures_of
from ccpin.proof.equations import problem_of as closed_by
from ccpin.proof.facts import NotProvedError, prove
from ccpin.proof.lines import SingularOnSegment
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK
from tests.support.unfolded import CIRCLE


def system_of(independent, size):
    independent = np.array(independent)
    dependent = np.setdiff1d(np.arange(size), independent)
    return SimpleNamespace(
        independent=independent, dependent=dependent, n=len(independent), m=len(dependent), n_free=size,
        periodic=np.zeros(size, dtype=bool),
    )  # fmt: skip


def problem_of(independent, size):
    return SimpleNamespace(system=system_of(independent, size))


def boxes_of(centre, half, directions, modes, radius):
    """Boxes of one row each, but for kappa."""
    centre, half, directions, modes, radius = (
        np.array(x, dtype=float) for x in (centre, half, directions, modes, radius)
    )
    one = np.ones_like(radius)
    return Boxes(centre, half, directions, modes, modes, radius, one, one[:, 0])


LINE = problem_of([2], 4)  # s is the coordinate that is the parameter; the others depend


@pytest.mark.parametrize(
    ("s", "error", "aside", "found"),
    [
        (0.5, 0.125, 0.0, True), (0.9375, 0.125, 0.0, True), (0.94, 0.125, 0.0, False), (-0.9375, 0.125, 0.0, True),
        (-0.94, 0.125, 0.0, False), (1.5, 0.0, 0.0, False), (0.0, 2.5, 0.0, False),
        (0.0, 0.125, 2.6874, True), (0.0, 0.125, 2.6876, False), (0.0, 0.5, 1.7498, True), (0.0, 0.5, 1.7502, False),
    ],
)  # fmt: skip
def test_a_tube_holds_a_singular_configuration_with_all_its_error(monkeypatch, s, error, aside, found):
    """θ₃ = 5 + 2s, |s| ≤ 1, θ₀ = 1 + 3s within 3: ε of θ₃ is ε/2 of s, and so 3ε/2 more of θ₀."""
    monkeypatch.setattr(module, "closures_of", lambda line: None)
    monkeypatch.setattr(module, "check", lambda equations, box: SimpleNamespace(proved=np.array([False])))
    directions = np.zeros((1, 4, 2))
    directions[0, :, 0] = 3.0, 0.0, 2.0, -1.0
    box = boxes_of([[1.0, 0, 5, 0]], [[1.0, 0.0]], directions, [np.eye(3)], [[3.0, 3.0, 3.0]])
    singular = np.array([1.0 + 3 * s + aside, 0.0, 5.0 + 2 * s, -s])
    assert module.holds(LINE, box, singular, error) is found


@pytest.mark.parametrize("proved", [True, False])
def test_a_tube_is_made_wider_where_that_is_proved(monkeypatch, proved):
    """Theorem N is asked of it with a κ below 1."""
    asked = []
    monkeypatch.setattr(module, "closures_of", lambda line: None)
    monkeypatch.setattr(module, "check", lambda equations, box: asked.append(box) or SimpleNamespace(proved=[proved]))
    directions = np.zeros((1, 4, 2))
    directions[0, 2, 0] = 1.0
    box = boxes_of([[0.0] * 4], [[1.0, 0.0]], directions, [np.eye(3)], [[0.25] * 3])
    assert module.holds(LINE, box, np.zeros(4), 0.2)
    assert module.holds(LINE, box, np.array([0.2, 0, 0, 0]), 0.2) is proved
    assert np.all(asked[0].radius > box.radius + 0.2)
    assert asked[0].kappa[0] < 1.0


JOINED = problem_of([0], 3)


def lies(monkeypatch, theta, error, half=1.0, radius=1.0, modes=None):
    """Whether a curve's end θ, known to errors in a box's modes, lies in θ₁ = 2 + 3q, θ₂ = 0 about q = 1."""
    asked = []

    def solve(line, box, delta):
        asked.append(delta.tolist())
        return SimpleNamespace(theta=np.array([theta], dtype=float), error=np.array([error], dtype=float))

    monkeypatch.setattr(module, "solve_in_boxes", solve)
    line = problem_of([2], 3)  # of the curve θ₂ is the parameter
    modes = np.eye(2) if modes is None else np.array(modes)
    box = SimpleNamespace(modes=np.array([modes]))
    directions = [[[1.0], [3.0], [0.0]]]
    join = boxes_of([[1.0, 2.0, 0.0]], [[half]], directions, [np.eye(2)], [[radius] * 2])
    found = module.lies_in(JOINED, join, line, box, -1.0)
    assert asked == [[[-1.0, 0.0]]]
    return found


@pytest.mark.parametrize(
    ("theta", "error", "radius", "found"),
    [
        ((2.0, 5.0, 0.0), (0.0, 0.0), 1.0, False), ((2 - 1e-9, 5, 0), (0, 0), 1.0, True),
        ((1e-9, -1, 0), (0, 0), 1.0, True),
        ((1.75, 4.25, 0), (0.2499, 0), 1.0, True), ((1.75, 4.25, 0), (0.2501, 0), 1.0, False),
        ((0.75, 1.25, 0), (0.25, 0.25), 1.0001, True), ((0.75, 1.25, 0), (0.25, 0.25), 0.9999, False),
        ((0.75, 1.25, 0.74), (0.0, 0.0), 0.75, True), ((0.75, 1.25, 0.76), (0.0, 0.0), 0.75, False),
        ((0.75, 1.5, 0), (0.0, 0.25), 0.5001, True), ((0.75, 1.5, 0), (0.0, 0.25), 0.4999, False),
        ((1.25, 2.75, 0), (0.1, 0.0), 0.31, True), ((1.25, 2.75, 0), (0.1, 0.0), 0.29, False),
    ],
)  # fmt: skip
def test_an_end_lies_over_the_join_and_in_its_tube(monkeypatch, theta, error, radius, found):
    """With all that it is known to; an error of q is three times as much of θ₁."""
    assert lies(monkeypatch, theta, error, radius=radius) is found


def test_an_end_is_known_to_its_boxs_modes_and_rounding(monkeypatch):
    """|V| times the modes' errors; 1e-15 (1 + |θ|) besides."""
    for size, found in ((0.2499, True), (0.2501, False)):
        assert lies(monkeypatch, (1.5, 3.5, 0.0), (0.0, size), modes=[[1.0, -2.0], [0.0, 1.0]], radius=9.0) is found
    for share, found in ((0.98, False), (1.02, True)):
        assert lies(monkeypatch, (1.0, 2.0, 0.0), (0.0, 0.0), half=2e-15 * share) is found


def test_an_end_over_the_join_is_so_in_every_coordinate(monkeypatch):
    found = SimpleNamespace(theta=np.array([[0.0, 0.5, 0.0, 0.0]]), error=np.zeros((1, 3)))
    monkeypatch.setattr(module, "solve_in_boxes", lambda *_: found)
    directions = np.zeros((1, 4, 2))
    directions[0, :2] = np.eye(2)
    box = SimpleNamespace(modes=np.array([np.eye(3)]))
    for half, over in (((1.0, 1.0), True), ((1.0, 0.25), False)):
        join = boxes_of([[0.0] * 4], [half], directions, [np.eye(2)], [[1.0, 1.0]])
        assert module.lies_in(problem_of([0, 1], 4), join, problem_of([3], 4), box, 1.0) is over


def test_the_range_of_a_curve():
    """By its boxes' chords, widths and tubes; a little more for rounding."""
    line, q, direction = problem_of([2], 4), np.array([1.0, -1.0]), np.array([2.0, 0.0])
    directions = np.zeros((2, 4, 2))
    directions[:, 0] = [[1.0, 0.5], [-2.0, 0.0]]
    modes = np.tile(np.eye(3), (2, 1, 1))
    modes[0, 0] = 0.25, -0.5, 0.0
    centre = [[2.0, 9.0, 0, 0], [4.0, 9.0, 0, 0]]
    boxes = boxes_of(centre, [[1.0, 0.5], [1.0, 2.0]], directions, modes, [[1.0, 0.5, 8.0], [0.125, 8.0, 8.0]])
    low, high = module._range_along(line, boxes, np.array([0, 1]), q, direction)
    # s = (θ₀ − 1)/2: ½ ± (1 + ¼ + ¼ + ¼)/2 and 3/2 ± (2 + 1/8)/2
    np.testing.assert_allclose([low, high], [0.5 - 0.875, 1.5 + 1.0625], rtol=1e-9)
    assert low < 0.5 - 0.875 - 0.99 * (SLACK - 1) * 0.875
    assert high > 1.5 + 1.0625 + 0.99 * (SLACK - 1) * 1.0625
    still = boxes._replace(directions=0.0 * directions, radius=0.0 * boxes.radius)
    first = still.take(np.array([0]))
    low, high = module._range_along(line, first, np.array([0, 1]), q, direction)
    assert low <= 0.5 - 2.0**-51 * (1.0 + 3.0) / 2 * 0.99
    assert high >= 0.5 + 2.0**-51 * (1.0 + 3.0) / 2 * 0.99
    assert high - low < 2.0**-51 * (1.0 + 3.0) * 1.01


def test_the_lines_rows_join_the_closures():
    """φ as it is, N orthogonal to the line's direction; θ_j alone is independent, no coordinate of N a circle."""
    mechanism = ccpin.load("planar_3rrr")
    reading = reading_of(mechanism, mechanism.q_reference)
    problem, system = reading.problem, reading.system
    rng = np.random.default_rng(0)
    theta = reading.theta(mechanism.q_reference)
    for direction in (np.array([0.5, -1.0, 2.0]), np.array([0.0, 3.0, 0.0])):
        j = int(system.dependent[1])
        line = Closures(module.line_system(system, theta[system.independent], direction, j))
        assert line.system.independent.tolist() == [j]
        assert line.system.dependent.tolist() == [k for k in range(system.n_free) if k != j]
        at = theta + rng.normal(size=(5, system.n_free))
        values, slopes = line.first(at)
        plain = closures_of(problem).first(at)
        np.testing.assert_allclose(values[:, : system.m], plain[0], rtol=0, atol=1e-14)
        np.testing.assert_allclose(slopes[:, : system.m], plain[1], rtol=0, atol=1e-14)
        away = at[:, system.independent] - theta[system.independent]
        length = np.linalg.norm(away - np.outer(away @ direction, direction) / (direction @ direction), axis=1)
        np.testing.assert_allclose(np.linalg.norm(values[:, system.m :], axis=1), length, rtol=1e-12)
        assert values.shape == (5, system.m + 2)
        joined = np.any(np.abs(slopes[:, system.m :]) > 0.0, axis=(0, 1))
        assert line.system.periodic.tolist() == (system.periodic & ~joined).tolist()
        assert line.system.moduli.shape == line.system.offset.shape == (system.m + 2,)


# Proposition L


def asked_of(monkeypatch, low=-0.5, high=1.0, lies=True, held=True, at=(0.0, 0.0), direction=(2.0, -1.0), more=()):
    """Whether the second of a curve's boxes holds the second of some singular points, and what is asked of which."""
    asked, one = {}, np.ones((2, 1))
    half = [[*more, 9.0, 9.0], [*more, 1.5, 0.5]]
    joins = boxes_of([[9.0] * 3, [*at, 5.0]], half, np.zeros((2, 3, 2)), one[..., None], one)
    modes, width = np.tile(np.eye(2), (3, 1, 1)), np.ones((3, 2))
    boxes = boxes_of(np.arange(9.0).reshape(3, 3), width, np.zeros((3, 3, 2)), modes, width)
    known = {"point": boxes_of([[0.0, 0.0, 5.0]], np.zeros((1, 0)), np.zeros((1, 3, 0)), np.ones((1, 1, 1)), [[1.0]])}
    known |= {"join": joins, "curve": boxes}
    monkeypatch.setattr(module, "boxes_of", lambda facts: known[facts[0]])

    def ranged(line, boxes, rows, q, d):
        asked["ranged"] = line, boxes.centre[:, 0].tolist(), rows.tolist(), q.tolist(), d.tolist()
        return low, high

    def lies_in(equations, join, line, box, side):
        asked["lies"] = join.centre[0].tolist(), line, box.centre[0, 0], side
        return lies

    def holds(line, box, theta, error):
        asked["held"] = line, box.centre[0, 0], theta.tolist(), error
        return held

    for name, function in (("_range_along", ranged), ("lies_in", lies_in), ("holds", holds)):
        monkeypatch.setattr(module, name, function)
    theta = np.array([[0.0] * 3, [1.0, 2.0, 3.0]])
    points = SimpleNamespace(
        origin=np.zeros((2, 2)), directions=np.array([[[7.0], [7.0]], np.reshape(direction, (2, 1))]), x=theta,
        system=SimpleNamespace(theta=lambda x: x),
    )  # fmt: skip
    join = SimpleNamespace(point=np.array([0]), first=np.array([1]))
    premises = (
        SimpleNamespace(claim=join, premises=("point", "join")),
        SimpleNamespace(claim=SimpleNamespace(equations="line"), premises=("curve", "start")),
        SimpleNamespace(claim=points, found={"error": np.array([9.0, 0.125])}),
    )
    claim = SingularOnSegment(SimpleNamespace(system=system_of([0, 1], 3)), np.array([1]), np.array([1]))
    examined = claim.examined(*premises)
    return bool(examined.proved[0]), asked, examined.found


def test_the_conditions_are_asked_of_their_boxes(monkeypatch):
    """s from −δ to 1 on all of them to that of the singular configuration, whose error is that of θ."""
    proved, asked, found = asked_of(monkeypatch)
    assert proved
    assert asked["ranged"] == ("line", [0.0, 3.0], [0, 1], [0.0, 0.0], [2.0, -1.0])
    assert asked["lies"] == ([0.0, 0.0, 5.0], "line", 0.0, -1.0)
    assert asked["held"] == ("line", 3.0, [1.0, 2.0, 3.0], 0.25)
    assert (found["theta"].tolist(), found["error"].tolist()) == ([[1.0, 2.0, 3.0]], [0.25])
    assert asked_of(monkeypatch, direction=(0.5, -0.25))[1]["held"][3] == 0.125
    assert asked_of(monkeypatch, low=-0.125, direction=(0.5, -4.0))[1]["held"][3] == 0.5


@pytest.mark.parametrize(
    ("told", "proved"),
    [
        ({"low": -0.51}, False), ({"low": -0.9}, False), ({"high": 1.01}, False), ({"high": 1.9}, False),
        ({"lies": False}, False), ({"held": False}, False),
        ({"at": (0.5, 0.0)}, True), ({"at": (-0.5, 0.0)}, True), ({"at": (0.51, 0.0)}, False),
        ({"at": (0.0, 0.01)}, False), ({"at": (0.0, -0.01)}, False),
        ({"direction": (2.0, 0.0), "low": -0.75}, True), ({"direction": (2.0, 0.0), "low": -0.76}, False),
        ({"direction": (2.0, 0.0), "at": (0.0, 0.49)}, True), ({"direction": (2.0, 0.0), "at": (0.0, 0.51)}, False),
        ({"direction": (2.0, 0.0), "at": (0.0, 0.51), "low": 0.5}, False),
        ({"at": (1.5, 0.0), "low": 0.0}, True), ({"at": (1.6, 0.0), "low": 0.1}, False),
    ],
)  # fmt: skip
def test_one_condition_that_fails_is_enough(monkeypatch, told, proved):
    """The box of q-space is as wide as 1.5 and 0.5 about where it is; q_r is the origin."""
    assert asked_of(monkeypatch, **told)[0] is proved


def test_the_boxs_parameters_are_q(monkeypatch):
    with pytest.raises(NotProvedError):
        asked_of(monkeypatch, more=(1.0,))


# Facts that fit


@pytest.fixture(scope="module")
def branch():
    """φ = cos y − q from q = ½, y = π/3 along q = ½ + s: the fold at q = 1 is on the branch."""
    problem = closed_by(CIRCLE.system, "reach")
    made = SimpleNamespace(problem=problem)
    for name, side in (("upper", 1.0), ("lower", -1.0)):
        theta = np.array([0.5, side * np.pi / 3])
        still = PPoly(np.stack([np.zeros((1, 1)), theta[None, :1]]), np.array([0.0, 1.0]))
        walker = Walker(problem, still, np.zeros(1), theta)
        found = singular_points(problem, np.tile(theta, (2, 1)), np.array([[1.0], [0.75]]))
        assert found.proved.all()
        join = _join(walker)
        facts = [_on_branch(walker, join, d, found, k) for k, d in enumerate(np.array([[1.0], [0.75]]))]
        setattr(made, name, SimpleNamespace(join=join, found=found, facts=facts, theta=theta))
    return made


def test_the_fold_is_on_both_branches_that_meet_in_it(branch):
    """The facts say where, and are the same when they are proved again."""
    for side in (branch.upper, branch.lower):
        for k, fact in enumerate(side.facts):
            assert fact.claim.singular.tolist() == [k]
            np.testing.assert_allclose(fact.found["theta"][0], [1.0, 0.0], atol=fact.found["error"][0])
            assert fact.replay().found["error"] == fact.found["error"]


def test_facts_that_do_not_fit_prove_nothing(branch):
    """Another branch's box or curve, the other line, other kinds, one too few, numbers of nothing."""
    upper, lower = branch.upper, branch.lower
    fact = upper.facts[0]
    join, curve, points = fact.premises
    claim, (other, short) = fact.claim, (lower.facts[0].premises[1], upper.facts[1].premises[1])
    assert prove(claim, join, curve, points)

    def refused(*premises, **changes):
        numbers = {"singular": claim.singular, "box": claim.box} | {k: np.array(v) for k, v in changes.items()}
        with pytest.raises(NotProvedError):
            prove(SingularOnSegment(claim.equations, **numbers), *(premises or fact.premises))

    refused(lower.join, curve, points)
    refused(join, other, points)
    refused(curve, join, points)
    refused(join, points, curve)
    refused(join, curve)
    refused(join, curve, points, points)
    refused(join, curve, join)
    refused(join.premises[1], curve, points)
    refused(singular=[2])
    refused(singular=[-1])
    refused(box=[len(curve.premises[0].claim.kappa)])
    refused(box=[0])
    refused(box=[0, 1])
    refused(singular=[0.0])
    twice = prove(join.claim.take(np.array([0, 0])), *join.premises)
    refused(twice, curve, points)
    way = Walker(branch.problem, PPoly(np.array([[[0.1]], [[0.5]]]), np.array([0.0, 1.0])), np.zeros(1), upper.theta)
    assert way.walk() is None
    refused(way.proved().premises[1], curve, points)
    moved = singular_points(branch.problem, np.array([[0.6, 0.9]]), np.array([[1.0]])).fact
    refused(join, curve, moved)
    assert len(short.premises) > 1


def test_a_curve_is_over_its_own_line():
    """For a mechanism of three coordinates: the curve of another line is about other equations."""
    mechanism = ccpin.load("planar_3rrr")
    reading = reading_of(mechanism, mechanism.q_reference).bounded("reach")
    system, equations = reading.system, closures_of(reading.problem)
    q, j = reading.theta(mechanism.q_reference)[system.independent], int(system.dependent[0])
    digests = {
        Closures(module.line_system(system, *line)).digest
        for line in ((q, np.eye(3)[0], j), (q, np.eye(3)[1], j), (q + 0.1, np.eye(3)[0], j), (q, np.eye(3)[0], j + 1))
    }
    assert len(digests | {equations.digest}) == 5
