"""What is claimed of workspaces beside their atlases: of which set, from which start, with which demands."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.covering.region import Region
from ccpin.covering.runner import Work
from ccpin.domain.atlas.cover import SquareNorm
from ccpin.domain.closures.task_coordinates import JointSpace
from ccpin.domain.workspaces import largest, workspace
from ccpin.domain.workspaces.largest import LargestWorkspace, _Asked, _goal, _LargestProblem
from ccpin.domain.workspaces.workspace import TaskProblem, _first, _limits, _region, task_problem
from ccpin.errors import InvalidInputError, UnreachableError
from ccpin.proof.rounding import SLACK
from ccpin.proof.verdict import Witness

CENTRE = np.array([1.0, -2.0, 0.5])


def found(round=False, half=1.0, weights=(1.0, 2.0, 0.0), reach=(2.0, 2.0, 0.25)):
    """A workspace about (1, −2) of edges 1 : ½, its third coordinate a turn of ¼ to both sides."""
    region = Region(CENTRE - reach, CENTRE + reach, np.zeros(3, dtype=bool))
    shape, atlas = SquareNorm(np.array(weights), round), SimpleNamespace(region=region, reading=None, seed=None)
    return LargestWorkspace(CENTRE, half, round, np.array([0.25]), atlas, shape)


@pytest.mark.parametrize(
    ("x", "cube", "ball"),
    [
        ((0, 0, 0), True, True), ((0.99, 0, 0), True, True), ((1.01, 0, 0), False, False), ((-0.99, 0, 0), True, True),
        ((0, 0.49, 0), True, True), ((0, 0.51, 0), False, False), ((0, -0.51, 0), False, False),
        ((0.8, 0.4, 0), True, False), ((0, 0, 0.25), True, True), ((0, 0, 0.26), False, False),
        ((0, 0, -0.26), False, False),
    ],
)  # fmt: skip
def test_what_is_in_a_workspace(x, cube, ball):
    """Nearer than the half width by its proportions, and with turns as far as tilted."""
    for round, inside in ((False, cube), (True, ball)):
        assert found(round).contains(CENTRE + x) is inside
        assert found(round).contains([CENTRE + x, CENTRE, CENTRE + 9.0]).tolist() == [inside, True, False]


def test_what_is_in_a_workspace_is_in_its_region():
    """In each coordinate, whatever the half width says."""
    wide = found(half=100.0, reach=(2.0, 2.0, 0.5))
    for k, reach in enumerate((2.0, 2.0, 0.5)):
        for side in (-1.0, 1.0):
            assert wide.contains(CENTRE + 0.999 * side * reach * np.eye(3)[k])
            assert not wide.contains(CENTRE + 1.001 * side * reach * np.eye(3)[k])
            assert not wide.contains(CENTRE + 1.9 * side * reach * np.eye(3)[k])


@pytest.mark.parametrize("round", [False, True])
def test_the_nearest_obstacle_beyond_what_is_certified(monkeypatch, round):
    """And how far it is at most, with all of its error in every coordinate."""
    places = [(3.0, 0, 0), (0.9, 0.0, 0.0), (0.0, 0.75, 0.0), (0.6, 0.2, 0.0), (0.0, -2.0, 9.0)]
    witnesses = [Witness("limit", CENTRE + place, None, 0.125) for place in places]
    monkeypatch.setattr(largest, "demand_witnesses", lambda *_: iter(witnesses))
    monkeypatch.setattr(LargestWorkspace, "_suspects", lambda self: [])
    space = found(round)
    assert space.obstacle is witnesses[2]
    spread = np.hypot(0.125, 0.25) if round else 0.25
    np.testing.assert_allclose(space.upper, (1.5 + spread) * SLACK, rtol=1e-14)
    assert found(round, half=3.5).obstacle is witnesses[4]
    assert found(round, half=4.5).obstacle is None
    assert found(round, half=4.5).upper == np.inf


def test_the_region_of_a_half_width():
    problem = _LargestProblem(CENTRE, np.array([1.0, 0.5, 0.0]), np.array([0.0, 0.0, 0.25]))
    region = problem.region(2.0)
    assert region.lower.tolist() == [-1.0, -3.0, 0.25]
    assert region.upper.tolist() == [3.0, -1.0, 0.75]


def asked(centre=None, proportions=1.0, tilt=0.0):
    return _Asked(centre, proportions, tilt, None, 0.02, None, False)


def start_of(slides=(True, True, False), x=(9.0, 8.0, 7.0)):
    names = tuple("xyabc"[: len(slides)])
    return SimpleNamespace(slides=np.array(slides), names=names, x=np.array(x))


def test_lengths_make_the_cube_and_turns_are_tilt():
    """A centre of positions alone has no turns; without positions turns make the cube."""
    goal = _goal(start_of(), asked((1.0, 2.0), (3.0, 4.0), 0.5))
    assert [x.tolist() for x in goal] == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 0.5]]
    goal = _goal(start_of(), asked((1.0, 2.0, 3.0)))
    assert [x.tolist() for x in goal] == [[1.0, 2.0, 3.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    assert _goal(start_of(), asked()).centre.tolist() == [9.0, 8.0, 7.0]
    turning = _goal(start_of((False, False), (1.0, 2.0)), asked(None, (2.0, 3.0)))
    assert [x.tolist() for x in turning] == [[1.0, 2.0], [2.0, 3.0], [0.0, 0.0]]
    mixed = _goal(start_of((True, False, False, True), (1.0, 2.0, 3.0, 4.0)), asked(None, (2.0, 3.0), (0.25, 0.5)))
    assert [x.tolist() for x in mixed[1:]] == [[2.0, 0.0, 0.0, 3.0], [0.0, 0.25, 0.5, 0.0]]


@pytest.mark.parametrize("proportions", [(0.0, 1.0), (1.0, -1.0), (1.0, np.inf), (np.nan, 1.0), np.inf])
def test_proportions_are_positive(proportions):
    with pytest.raises(InvalidInputError, match="proportions"):
        _goal(start_of(), asked(None, proportions))


@pytest.mark.parametrize(
    ("tilt", "good"),
    [
        ((0.0, 0.0), True), ((1.57, 0.0), True), ((1.58, 0.0), False), ((0.0, -1e-9), False), ((0.0, 2.5), False),
        ((np.nan, 0), False),
    ],
)  # fmt: skip
def test_a_tilt_is_below_a_quarter_turn(tilt, good):
    start = start_of((True, False, False))
    if good:
        assert _goal(start, asked(None, 1.0, tilt)).tilt.tolist() == [0.0, *tilt]
    else:
        with pytest.raises(InvalidInputError, match="tilt"):
            _goal(start, asked(None, 1.0, tilt))


@pytest.mark.parametrize("within", [None, 0.5])
def test_what_is_largest_is_told_of_its_own_atlas(monkeypatch, within):
    """By the proportions asked for: a distance counts by one over its edge, turns not at all."""
    scopes = []

    def about(self, start, goal, tolerance, seconds):
        scopes.append((self, goal))
        return SimpleNamespace(radius=0.25)

    monkeypatch.setattr(largest._SearchScope, "about", about)
    monkeypatch.setattr(largest, "_reach", lambda start, end_effector: 3.0)
    query = _Asked((1.0, 2.0), (0.5, 4.0), 0.125, within, 0.02, None, True)
    told = largest._largest(start_of(), query, None, Work())
    assert (told.half, told.round, told.tilt.tolist(), told.centre.tolist()) == (0.25, True, [0.125], [1.0, 2.0, 0.0])
    scope = scopes[0][0]
    assert (told.shape.weights.tolist(), told.shape.round) == ([2.0, 0.25, 0.0], True)
    assert (scope.most, scope.grows) == (0.75 if within is None else 0.5, within is None)


# Where one starts


def moving(monkeypatch, whole=(True,) * 3, kept=(True,) * 3):
    """A problem at (1, 2) whose ways in 1, 8 and 64 parts are walked whole or not, and keep to demands or not."""
    walked = []

    def walker(problem, pieces, tube, theta):
        number = len(walked)
        walked.append((pieces, tube))
        boxes = SimpleNamespace(number=number)
        return SimpleNamespace(
            walk=lambda: None if whole[number] else 0.5,
            boxes=boxes,
            theta=np.array([5.0, 6.0, 7.0]),
            here=0.5,
            rcond=lambda: 1.0,
        )

    monkeypatch.setattr(workspace, "Walker", walker)
    monkeypatch.setattr(workspace, "passable", lambda problem, boxes: np.array([True, kept[boxes.number]]))
    reading = SimpleNamespace(problem=None, system=SimpleNamespace(independent=np.array([2, 0])))
    return TaskProblem(("x", "y"), np.array([True, True]), reading, np.array([2.0, 9.0, 1.0])), walked


@pytest.mark.parametrize("passed", [0, 1, 2])
def test_a_start_is_moved_along_a_certified_way(monkeypatch, passed):
    """Straight from x to x, in more pieces where boxes are too long for demands; q is what was asked for."""
    problem, walked = moving(monkeypatch, kept=tuple(k >= passed for k in range(3)))
    theta = problem.moved_to(np.array([3.0, -2.0]))
    assert theta.tolist() == [-2.0, 6.0, 3.0]
    assert len(walked) == passed + 1
    for (pieces, tube), parts in zip(walked, (1, 8, 64), strict=False):
        assert pieces.x.tolist() == np.linspace(0.0, 1.0, parts + 1).tolist()
        for t in np.linspace(0.0, 1.0, 33):
            np.testing.assert_allclose(pieces(t), [1.0 + 2.0 * t, 2.0 - 4.0 * t], rtol=0, atol=1e-14)
        assert tube.tolist() == [0.0, 0.0]
    assert problem.moved_to(np.array([1.0, 2.0])) is problem.theta


@pytest.mark.parametrize(
    ("whole", "kept", "tried", "told"),
    [
        ((False,) * 3, (True,) * 3, 1, "it ends at"), ((True,) * 3, (False,) * 3, 3, "a limit"),
        ((True, False, True), (False, True, True), 2, "it ends at"),
    ],
)  # fmt: skip
def test_a_start_that_no_certified_way_leads_to_is_refused(monkeypatch, whole, kept, tried, told):
    problem, walked = moving(monkeypatch, whole, kept)
    with pytest.raises(UnreachableError, match=told):
        problem.moved_to(np.array([3.0, -2.0]))
    assert len(walked) == tried


def test_one_starts_where_one_is_or_in_the_middle():
    region = Region(np.array([1.0, -3.0]), np.array([2.0, 1.0]), np.zeros(2, dtype=bool))
    for x in ((1.0, 1.0), (2.0, -3.0), (1.5, 0.0)):
        assert _first(np.array(x), region).tolist() == list(x)
    for x in ((0.9, 0.0), (2.1, 0.0), (1.5, -3.1), (1.5, 1.1), (0.6, 0.0), (3.0, 0.0), (1.5, 1.9)):
        assert _first(np.array(x), region).tolist() == [1.5, -1.0]


def test_turns_left_out_are_held():
    region = _region(start_of((True, True, False)), [[0.0, 1.0], [2.0, 3.0]])
    assert (region.lower.tolist(), region.upper.tolist()) == ([0.0, 1.0, 0.0], [2.0, 3.0, 0.0])
    assert region.held.tolist() == [False, False, True]
    whole = _region(start_of((True, True, False)), [[0.0, 1.0, -0.5], [2.0, 3.0, 0.5]])
    assert whole.upper.tolist() == [2.0, 3.0, 0.5]
    plain = _region(start_of((True, True), (1.0, 2.0)), [[0.0, 1.0], [2.0, 3.0]])
    assert plain.upper.tolist() == [2.0, 3.0]
    for slides in ((False, False), (True, True, False)):
        with pytest.raises(InvalidInputError):
            _region(start_of(slides), [[0.0], [1.0]])
    with pytest.raises(InvalidInputError):
        _region(start_of((False, False)), np.zeros((2, 0)))


# Demands


@cache
def crank():
    return ccpin.load("slider_crank")


@cache
def five_bar():
    return ccpin.EndEffector(ccpin.load("rpdr"), "link3", (0.1, 0.0, 0.0))


def test_limits_are_the_files_or_those_given():
    mechanism = crank()
    names = [joint.name for joint in mechanism.tree.joints]
    low, high = mechanism.position_limits
    for limits in (True, {}):
        lower, upper = _limits(mechanism, limits, 4)
        assert (lower[:3].tolist(), upper[:3].tolist()) == (low.tolist(), high.tolist())
        assert (lower[3], upper[3]) == (-np.inf, np.inf)
    lower, upper = _limits(mechanism, False, 3)
    assert np.all(np.isinf(lower) & np.isinf(upper))
    lower, upper = _limits(mechanism, {names[1]: (-0.5, 0.25)}, 3)
    assert (lower[1], upper[1]) == (-0.5, 0.25)
    assert (lower[[0, 2]].tolist(), upper[[0, 2]].tolist()) == (low[[0, 2]].tolist(), high[[0, 2]].tolist())
    for bad in (
        {names[0]: (1.0, 0.75)},
        {names[0]: (1.0, 1.0)},
        {names[0]: (1.0, 2.0, 3.0)},
        {names[0]: (1.0,)},
        {"no": (0, 1)},
        "all",
        1,
    ):
        with pytest.raises(InvalidInputError, match="limits"):
            _limits(mechanism, bad, 3)


def problem_of(end_effector, limits=False, dexterity=0.0, length=None):
    return task_problem(end_effector, None, limits, dexterity, length, "auto")


@pytest.mark.parametrize(
    ("dexterity", "good"), [(0.0, True), (0.6, True), (0.999, True), (1.0, False), (1.5, False), (-0.1, False)]
)
def test_a_dexterity_is_from_0_to_below_1(dexterity, good):
    if good:
        assert problem_of(five_bar(), dexterity=dexterity).reading.problem.requirements.dexterity == dexterity
    else:
        with pytest.raises(InvalidInputError, match="from 0 to below 1"):
            problem_of(five_bar(), dexterity=dexterity)


def test_what_drives_and_what_turns_count_as(monkeypatch):
    """Lengths count as they are and turns by a length, which is asked for where both are and dexterity is."""
    mechanism = ccpin.load("planar_3rrr")
    end_effector = ccpin.EndEffector(mechanism, "platform")
    asked = problem_of(end_effector, dexterity=0.1, length=0.5)
    assert asked.slides.tolist() == [True, True, False]
    assert asked.reading.problem.requirements.units.tolist() == [1.0, 1.0, 0.5]
    names = [joint.name for joint in mechanism.tree.joints]
    driven = [names[k] for k in asked.reading.problem.requirements.driven]
    assert driven == list(mechanism.independent)
    with pytest.raises(InvalidInputError, match="give length="):
        problem_of(end_effector, dexterity=0.1)
    assert problem_of(end_effector).reading.problem.requirements.units.tolist() == [1.0] * 3
    assert problem_of(five_bar(), dexterity=0.1).reading.problem.requirements.units.tolist() == [1.0] * 2
    slider = JointSpace(crank(), (crank().tree.joints[1].name,))
    turning = problem_of(slider, dexterity=0.1)
    assert (turning.slides.tolist(), turning.reading.problem.requirements.units.tolist()) == ([False], [1.0])
    assert problem_of(slider, dexterity=0.1, length=3.0).reading.problem.requirements.units.tolist() == [3.0]
    for bad in ("platform", None, mechanism):
        with pytest.raises(InvalidInputError, match="EndEffector or a JointSpace"):
            problem_of(bad)


@pytest.mark.parametrize(
    ("ends", "circle"), [(None, True), ((-9.0, 9.0), False), ((-9.0, np.inf), False), ((-np.inf, 9.0), False)]
)
def test_a_joint_with_a_limit_is_no_circle(monkeypatch, ends, circle):
    """On either side; the others are as they were."""
    mechanism = five_bar().model.mechanism
    free = np.full(mechanism.n_free + 2, np.inf)
    lower, upper = -free, free.copy()
    if ends is not None:
        lower[3], upper[3] = ends
    monkeypatch.setattr(workspace, "_limits", lambda mechanism, limits, size: (lower, upper))
    problem = problem_of(five_bar()).reading.problem
    assert problem.system.periodic.tolist() == [True, True, True, circle, False, False]
    assert (problem.requirements.lower[3], problem.requirements.upper[3]) == (lower[3], upper[3])
