"""What is told of a path beside its proof: σ on it, what is refused, and that witnesses against it lie in its tube."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

import ccpin
from ccpin.domain import certify_path
from ccpin.domain.paths import path as module
from ccpin.domain.paths.path import CertifiedPath
from ccpin.errors import InvalidInputError
from ccpin.proof.newton import Boxes

SYSTEM = SimpleNamespace(independent=np.array([0, 2]), dependent=np.array([1]), n=2, m=1, n_free=3)
LINE = PPoly(np.array([[[1.0, 2.0], [1.0, 0.0]], [[0.0, 0.0], [1.0, 2.0]]]), np.array([0.0, 1.0, 2.0]))


def told(proved=None, witness=None, boxes=3, reached=2.0):
    """A path of three boxes over [0, ½], [½, 1] and [1, 2]."""
    directions = np.zeros((boxes, 3, 3))
    directions[:, :, 0] = [0.25, 9.0, -0.5]
    one = np.ones((boxes, 1, 1))
    centre = np.column_stack([np.arange(boxes), np.full(boxes, 9.0), -np.arange(boxes)]).astype(float)
    held = Boxes(centre, one[:, 0], directions, one, one, one[:, 0], one[:, 0], np.zeros(boxes))
    reading = SimpleNamespace(problem=SimpleNamespace(system=SYSTEM), configuration=lambda theta: theta)
    times = np.array([0.0, 0.5, 1.0, 2.0])[: boxes + 1]
    return CertifiedPath(reached, proved, "", witness, 1.0, 0, times, np.zeros(2), held, LINE, reading)


@pytest.mark.parametrize(
    ("proved", "follows", "witness", "verdict"),
    [
        ("fact", True, None, "proven"), ("fact", True, "place", "proven"), ("fact", False, None, "undecided"),
        ("fact", False, "place", "refuted"), (None, True, None, "undecided"), (None, True, "place", "refuted"),
    ],
)  # fmt: skip
def test_proven_is_what_a_fact_follows_to_the_end(monkeypatch, proved, follows, witness, verdict):
    monkeypatch.setattr(module, "is_fact", lambda fact, kind: fact == "fact" and kind is module.Followed)
    monkeypatch.setattr(module, "follows", lambda fact, pieces: follows)
    assert told(proved, witness).verdict == verdict
    assert told(proved, witness).reason == ""


@pytest.mark.parametrize(
    ("t", "box", "s"),
    [(0.0, 0, -1.0), (0.25, 0, 0.0), (0.5, 1, -1.0), (0.625, 1, -0.5), (1.0, 2, -1.0), (1.5, 2, 0.0), (2.0, 2, 1.0)],
)
def test_sigma_is_asked_of_the_stretchs_box(monkeypatch, t, box, s):
    """At its share of the chord, and as far aside as the path is from that."""
    asked = []

    def solve(problem, boxes, delta):
        asked.append((boxes.centre[:, 0].tolist(), delta.tolist()))
        return SimpleNamespace(theta=np.zeros((1, 3)))

    monkeypatch.setattr(module, "solve_in_boxes", solve)
    monkeypatch.setattr(module, "newton", lambda problem, theta, steps: SimpleNamespace(theta=theta + 7.0))
    assert told().sigma(t).tolist() == [7.0] * 3
    aside = LINE(t) - [box + 0.25 * s, -box - 0.5 * s]
    assert asked == [([float(box)], [[s, *aside]])]


def test_sigma_beyond_what_is_certified_is_refused():
    for t in (-0.01, 1.01, 2.0, [0.5, 1.5], [-1.0, 0.5]):
        with pytest.raises(InvalidInputError, match="from 0 to 1"):
            told(reached=1.0).sigma(t)
    later = replace(told(reached=2.0), times=np.array([1.0, 1.25, 1.5, 2.0]))
    for t in (0.9, 0.6):
        with pytest.raises(InvalidInputError, match="from 1 to 2"):
            later.sigma(t)
    with pytest.raises(InvalidInputError, match="certified"):
        told(boxes=0, reached=0.0).sigma(0.0)


@cache
def crank():
    return ccpin.load("slider_crank")


@pytest.mark.parametrize("tube", [-1.0, np.nan, [1.0, 1.0]])
def test_tubes_that_are_none_are_refused(tube):
    with pytest.raises(InvalidInputError, match="tube"):
        certify_path(crank(), [[0.0], [0.1]], tube)


@pytest.mark.parametrize("tube", [[0.1, -0.1], [-0.1, 0.1], [np.nan, 0.1], [0.1, np.inf]])
def test_every_width_is_looked_at(rpdr, tube):
    ways = np.radians([(-108.0, -72.0), (-107.0, -72.0)])
    with pytest.raises(InvalidInputError, match="tube"):
        certify_path(rpdr, ways, tube)
    assert certify_path(rpdr, ways, [0.0, 0.0]).verdict == "proven"


def test_what_the_kernel_refuses_is_not_told(monkeypatch):
    """Then nothing of the path is certified."""
    assert certify_path(crank(), [[0.0], [0.1]]).verdict == "proven"
    monkeypatch.setattr(module.Walker, "proved", lambda walker: None)
    found = certify_path(crank(), [[0.0], [0.1]])
    assert (found.verdict, found.reached, found.times.tolist(), len(found.boxes.kappa)) == ("undecided", 0.0, [0.0], 0)


# Witnesses against it


class Walking(SimpleNamespace):
    """A walker with some boxes."""

    def back(self, steps):
        return Walking(**{**vars(self), "steps": steps})


def refuted(monkeypatch, knot=2.0, boxes=3, singular=None, rounding=(0.0, 0.0), tube=(0.0, 0.0), here=1.0):
    """The witness, the walkers and knots asked for one, and the places asked for emptiness."""
    asked, places = [], []
    monkeypatch.setattr(module, "_targets", lambda walker, knot: knot)
    monkeypatch.setattr(module, "_next_knot", lambda walker: 1.5)

    def witness(walker, reading, target):
        asked.append((walker.steps, target))
        return "found" if walker.steps == singular else None

    def points(pieces, t):
        lost = np.tile(rounding[0], (len(t), 1))
        lost[len(t) // 2 :] = rounding[1]
        return np.column_stack([t, t]), lost

    monkeypatch.setattr(module, "singular_witness", witness)
    monkeypatch.setattr(module, "points_of", points)
    monkeypatch.setattr(module, "empty_witness", lambda problem, q: places.append(q) or "empty")
    walker = Walking(times=np.zeros(boxes + 1), here=here, pieces=LINE, tube=np.array(tube), problem=None)
    return module._refuted(walker, None, knot), asked, places


def test_witnesses_are_looked_for_from_here_and_before(monkeypatch):
    """From as many boxes before as there are, up to the knot that was not reached or the next one."""
    assert refuted(monkeypatch, singular=0)[:2] == ("found", [(0, 1.5)])
    assert refuted(monkeypatch, knot=1.25, singular=3)[:2] == ("found", [(0, 1.25), (1, 1.25), (3, 1.25)])
    assert refuted(monkeypatch, boxes=0)[1] == [(0, 1.5)]
    assert [steps for steps, _ in refuted(monkeypatch, boxes=5)[1]] == [0, 1, 3]


@pytest.mark.parametrize(
    ("tube", "rounding", "known"),
    [
        ((0.0, 0.0), 0.95e-13, True), ((0.0, 0.0), 1.05e-13, False), ((1e-3, 2e-3), 0.9e-3, True),
        ((1e-3, 2e-3), 1.1e-3, False), ((1e-3, 0.0), 1e-12, False),
    ],
)  # fmt: skip
def test_places_without_configurations_are_of_the_tube(monkeypatch, tube, rounding, known):
    """Ahead on the path, each known to the tube's width in every coordinate, or to the rounding of a straight line."""
    found, _, places = refuted(monkeypatch, tube=tube, rounding=(rounding, rounding))
    assert found == ("empty" if known else None)
    if known:
        assert (places[0].min(), places[0].max()) == (1.0, 2.0)
    found, _, places = refuted(monkeypatch, tube=tube, rounding=(rounding, 1.0))
    assert found == ("empty" if known else None)
    assert not known or places[0].max() < 1.5


def test_the_next_knot():
    for here, knot in ((0.0, 1.0), (0.5, 1.0), (1.0, 2.0), (1.5, 2.0), (2.0, 2.0)):
        assert module._next_knot(SimpleNamespace(pieces=LINE, here=here)) == knot


def targets(monkeypatch, pieces, tube, here=0.0, aside=(0.0, 0.0), normal=(3.0, -1.0), knot=1.0):
    """Places to which segments are said to lie in the tube, from beside a path's point."""
    slope = np.array([[[normal[0], 1.0, normal[1]]]])
    monkeypatch.setattr(module, "closure_values", lambda problem, theta: (None, slope))
    q = pieces(here) + aside
    walker = SimpleNamespace(
        problem=SimpleNamespace(system=SYSTEM), here=here, theta=np.array([q[0], 0.0, q[1]]), pieces=pieces,
        tube=np.array(tube),
    )  # fmt: skip
    return q, module._targets(walker, knot)


def outside(pieces, tube, start, target, here=0.0, knot=1.0):
    """By how much of the tube's width the segment is beyond the tube at most, on a fine grid."""
    t = np.linspace(here, knot, 4001)
    path, beyond = pieces(t), 0.0
    for share in np.linspace(0.0, 1.0, 11):
        at = start + share * (target - start)
        beyond = max(beyond, float((np.abs(path - at) / tube).max(axis=1).min()))
    return beyond - 1.0


BENT = PPoly(np.array([[[0.0, 0.5]], [[1.0, 0.0]], [[0.0, 0.0]]]), np.array([0.0, 1.0]))


@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.0, 0.0625), (0.05, -0.0625)])
@pytest.mark.parametrize("pieces", [BENT, PPoly(np.array([[[1.0, 2.0]], [[0.0, 0.0]]]), np.array([0.0, 1.0]))])
@pytest.mark.parametrize(
    ("tube", "here", "knot"),
    [((0.125, 0.125), 0.0, 1.0), ((0.0625, 0.25), 0.0, 1.0), ((0.01, 0.3), 0.0, 1.0), ((0.0625, 0.125), 0.25, 0.75)],
)
def test_segments_to_targets_lie_in_the_tube(monkeypatch, pieces, tube, here, knot, aside):
    """Whatever the path's bend, and where it jumps too; some reach the tube's corners on both sides."""
    aside = np.minimum(np.abs(aside), 0.5 * np.array(tube)) * np.sign(aside)
    start, found = targets(monkeypatch, pieces, tube, here, aside, knot=knot)
    assert len(found) > 4
    reached = [outside(pieces, np.array(tube), start, target, here, knot) for target in found[:1] + found[3:]]
    assert max(reached) < 2e-2
    corner = np.array(tube) * [1.0, -1.0]
    np.testing.assert_array_equal(found[1:3], [start + corner, start - corner])
    if not np.any(aside) and pieces is not BENT:
        np.testing.assert_array_equal(found[0], pieces(knot))
        np.testing.assert_allclose(found[3:5], [pieces(knot) + corner, pieces(knot) - corner], rtol=1e-12)


def test_a_line_without_a_tube_has_its_end_ahead(monkeypatch):
    """The farthest whose chord is straight but for rounding; from beside the path nothing."""
    straight = PPoly(np.array([[[1.0, 2.0]], [[0.0, 0.0]]]), np.array([0.0, 1.0]))
    assert [t.tolist() for t in targets(monkeypatch, straight, (0.0, 0.0))[1]] == [[1.0, 2.0]]
    for aside, known in ((0.5e-13, True), (1.5e-13, False)):
        assert bool(targets(monkeypatch, straight, (0.0, 0.0), aside=(0.0, aside))[1]) == known
    assert len(targets(monkeypatch, BENT, (0.125, 0.0))[1]) == 2  # beside where one is: its chords bend
