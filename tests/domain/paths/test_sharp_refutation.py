"""What refutes that σ goes on: every condition of the proposition is asked, at the ends of each inequality."""

from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.domain.closures.system import reading_of
from ccpin.domain.paths import refutation as module
from ccpin.errors import SingularConfigurationError
from ccpin.proof.equations import closures_of
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK


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


# The place of a witness


def witnesses(monkeypatch, along, error=0.125, proved=True, on=(0, 1, 2), join="join", targets=((4.0, 2.0),) * 3):
    """Which of three singular configurations are asked about and the witness, if one on the branch is found."""
    count = len(along)
    theta = np.column_stack([np.zeros((count, 2)), np.arange(count)])
    found = SimpleNamespace(
        proved=np.broadcast_to(proved, count), along=np.array(along), error=np.full(count, error), theta=theta,
        kernel=np.ones((count, 1)),
    )  # fmt: skip
    asked, lines = [], []
    monkeypatch.setattr(module, "singular_points", lambda problem, theta, directions: lines.append(directions) or found)
    monkeypatch.setattr(module, "_join", lambda walker: join)

    def on_branch(problem, theta, join, direction, singular, kernel, error):
        asked.append((int(singular[2]), error))
        return int(singular[2]) in on

    monkeypatch.setattr(module, "_on_branch", on_branch)
    walker = SimpleNamespace(problem=problem_of([0, 1], 3), theta=np.array([1.0, -1.0, 0.0]))
    reading = SimpleNamespace(configuration=lambda theta: theta)
    return module.singular_witness(walker, reading, np.array(targets)), asked, lines


def test_singular_configurations_are_on_the_segment(monkeypatch):
    """With all of their error; the nearest is asked first, with its error in q."""
    witness, asked, lines = witnesses(monkeypatch, [0.5, 0.25, 0.75], on=(0, 2))
    assert lines[0].tolist() == [[3.0, 3.0]] * 3
    assert asked == [(1, 0.375), (0, 0.375)]
    assert (witness.kind, witness.q_free.tolist(), witness.error) == ("singular", [0.0, 0.0, 0.0], 0.375)
    assert witnesses(monkeypatch, [0.5] * 3, on=())[0] is None
    for along, near in (
        (0.125, True),
        (0.12, False),
        (0.1, False),
        (0.875, True),
        (0.88, False),
        (1.2, False),
        (-0.5, False),
    ):
        assert bool(witnesses(monkeypatch, [along] * 3)[1]) == near
    assert witnesses(monkeypatch, [0.5] * 3, proved=False)[1] == []
    assert witnesses(monkeypatch, [0.5] * 3, join=None)[:2] == (None, [])


def test_an_error_is_at_least_that_of_the_parameter(monkeypatch):
    """Directions longer than one make more of it, shorter ones no less; those of no length are left out."""
    for long, error in (((1.5, -1.25), 0.125), ((1.0, 4.0), 0.625)):
        witness = witnesses(monkeypatch, [0.5] * 3, targets=(long,) * 3)[0]
        assert witness.error == error
    targets = ((1.0, -1.0), (1.0, 4.0), (1.0, -1.0), (2.0, -1.0), (3.0, 3.0))
    assert witnesses(monkeypatch, [0.5] * 3, targets=targets)[2][0].tolist() == [[0, 5], [1, 0], [2, 4]]
    assert witnesses(monkeypatch, [0.5] * 3, targets=((1.0, -1.0),))[1:] == ([], [])


@pytest.mark.parametrize("proved", [True, False])
@pytest.mark.parametrize("carried", [True, False])
def test_a_join_is_proved_and_carries_the_branch(monkeypatch, proved, carried):
    tried = SimpleNamespace(proved=np.array([proved]), boxes="boxes")
    monkeypatch.setattr(module, "certify_boxes", lambda *_: tried)
    walker = SimpleNamespace(problem=problem_of([0], 2), theta=np.zeros(2), carries=lambda boxes, delta: carried)
    assert module._join(walker) == ("boxes" if proved and carried else None)


# The curve


class Told:
    def __init__(self, numbers):
        self.numbers = list(numbers)

    def take(self, index):
        return Told([self.numbers[k] for k in index])


def on_branch(
    monkeypatch, low=-0.25, high=1.0, lies=True, holding=2, walks=None, starts=True, times=(0, 0.2, 0.4, 0.95, 1)
):
    """Whether all is proved of a curve of four boxes to a fold that is two thirds of the way; what is asked."""
    asked = {}

    def walker(line, pieces, tube, theta):
        if not starts:
            raise SingularConfigurationError("", q_free=theta, rcond=0.0)
        asked["ends"] = float(pieces(0.0)[0]), float(pieces(1.0)[0]), pieces.x.tolist()
        return SimpleNamespace(times=list(times), boxes=Told(range(len(times) - 1)), walk=lambda stride: walks)

    def lies_in(problem, join, line, box, side):
        asked["lies"] = box.numbers, side
        return lies

    def ranged(line, boxes, rows, theta, direction):
        asked["ranged"] = boxes.numbers
        return low, high

    monkeypatch.setattr(module, "line_problem", lambda problem, theta, direction, j: asked.update(j=j))
    monkeypatch.setattr(module, "extrapolate", lambda problem, theta, steps: theta[None])
    monkeypatch.setattr(module, "Walker", walker)
    monkeypatch.setattr(module, "lies_in", lies_in)
    monkeypatch.setattr(module, "_range_along", ranged)
    monkeypatch.setattr(module, "holds", lambda line, box, singular, error: box.numbers == [holding])
    problem, join = problem_of([0, 1], 4), SimpleNamespace(half=np.array([[1.5, 0.5]]))
    theta, singular = np.array([0.0, 0.0, 5.0, -3.0]), np.array([0.0, 0.0, 5.0, -1.0])
    args = np.array([2.0, -1.0]), singular, np.array([0.5, -1.0]), 0.01
    return module._on_branch(problem, theta, join, *args), asked


def test_the_curve_leads_to_the_fold(monkeypatch):
    """From its first point, in the join's tube, to the box that holds the fold; s from −δ to 1 on all of these."""
    proved, asked = on_branch(monkeypatch)
    assert proved
    end = -1.0 + 0.05 * 2.0 + 10 * 0.01
    assert asked["j"] == 3
    assert asked["ends"][0] == -3.0
    np.testing.assert_allclose(asked["ends"][1], end, rtol=1e-14)
    assert asked["ends"][2] == [0.0, 1.0]
    assert asked["lies"] == ([0], -1.0)
    assert asked["ranged"] == [0, 1, 2]  # the fold is at 2/2.2 of it
    at = on_branch(monkeypatch, times=(0, 0.5, 0.905, 1), holding=2)
    assert (at[0], at[1]["ranged"]) == (True, [0, 1, 2])


@pytest.mark.parametrize(
    "told",
    [
        {"low": -0.26}, {"low": -0.5}, {"high": 1.01}, {"high": 1.9}, {"lies": False}, {"holding": 1}, {"walks": 1.0},
        {"starts": False},
    ],
)  # fmt: skip
def test_nothing_is_proved_of_a_curve_that_fails_one_condition(monkeypatch, told):
    assert not on_branch(monkeypatch, **told)[0]


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
    line, theta, direction = problem_of([2], 4), np.array([1.0, -1.0, 0, 0]), np.array([2.0, 0.0])
    directions = np.zeros((2, 4, 2))
    directions[:, 0] = [[1.0, 0.5], [-2.0, 0.0]]
    modes = np.tile(np.eye(3), (2, 1, 1))
    modes[0, 0] = 0.25, -0.5, 0.0
    centre = [[2.0, 9.0, 0, 0], [4.0, 9.0, 0, 0]]
    boxes = boxes_of(centre, [[1.0, 0.5], [1.0, 2.0]], directions, modes, [[1.0, 0.5, 8.0], [0.125, 8.0, 8.0]])
    low, high = module._range_along(line, boxes, np.array([0, 1]), theta, direction)
    # s = (θ₀ − 1)/2: ½ ± (1 + ¼ + ¼ + ¼)/2 and 3/2 ± (2 + 1/8)/2
    np.testing.assert_allclose([low, high], [0.5 - 0.875, 1.5 + 1.0625], rtol=1e-9)
    assert low < 0.5 - 0.875 - 0.99 * (SLACK - 1) * 0.875
    assert high > 1.5 + 1.0625 + 0.99 * (SLACK - 1) * 1.0625
    still = boxes._replace(directions=0.0 * directions, radius=0.0 * boxes.radius)
    first = still.take(np.array([0]))
    low, high = module._range_along(line, first, np.array([0, 1]), theta, direction)
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
        line = module.line_problem(problem, theta, direction, j)
        assert line.system.independent.tolist() == [j]
        assert line.system.dependent.tolist() == [k for k in range(system.n_free) if k != j]
        at = theta + rng.normal(size=(5, system.n_free))
        values, slopes = closures_of(line).first(at)
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
