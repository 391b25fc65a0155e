"""What is asked of a tube's premises, just where it holds and does not: times, places, boxes and their gluing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control import PDPlus, certify_tracking
from ccpin.control.stability.tracking.tube_claim import TubeKept
from ccpin.proof.facts import NotProvedError
from ccpin.proof.newton import Boxes, predict, reached
from ccpin.proof.solutions import GluedBoxes, Met
from tests.support.tracked import law_for


@pytest.fixture(scope="module")
def known():
    """The fact about PD+, whose storage function differs from cell to cell."""
    return certify_tracking(law_for(PDPlus), 1e-4, cells=48).proved


def test_numbers_are_those_of_the_worst_cell(known):
    """Γ of the largest w, units of the widest cell."""
    claim = known.claim
    levels = claim._levels(known.premises[1], claim._cells())
    assert levels.sources.min() < levels.sources.max()
    assert known.found["gain"][0] == np.sqrt(levels.sources.max()) / claim.sigma_error[0]
    assert np.all(levels.widths.min(axis=0) < levels.widths.max(axis=0))
    np.testing.assert_array_equal(known.found["unit"], levels.widths.max(axis=0))


def test_premises_are_a_path_boxes_and_glue(known):
    path, boxes, *glue = known.premises
    for premises, said in (
        ((path, boxes), "are needed"), ((boxes, boxes, *glue), "no path"), ((path, path, *glue), "no boxes"),
    ):  # fmt: skip
        with pytest.raises(NotProvedError, match=said):
            known.claim.examined(*premises)


TIMES = [
    (lambda x: np.insert(x, 3, 0.5 * (x[2] + x[3])), "fall back"),
    (lambda x: np.delete(x, 3), "fall back"),
    (lambda x: np.concatenate([x[:3], x[2:3], x[4:]]), "fall back"),
    (lambda x: np.concatenate([x[:3], [0.0], x[4:]]), "fall back"),
    (lambda x: np.concatenate([[0.5 * x[1]], x[1:]]), "not all"),
    (lambda x: np.concatenate([x[:-1], [x[-1] + 1.0]]), "not all"),
    (lambda x: np.concatenate([x[:-1], [0.5 * (x[-2] + x[-1])]]), "not all"),
    (lambda x: np.concatenate([x[:-2], [x[-2] + 0.1], x[-1:]]), "beyond a knot"),
]


@pytest.mark.parametrize(("change", "said"), TIMES)
def test_times_are_all_of_the_references(known, change, said):
    claim = known.claim
    with pytest.raises(NotProvedError, match=said):
        replace(claim, times=change(claim.times))._cells()


@pytest.mark.parametrize(("share", "held"), [(0.75, True), (1.0, True), (1.0 + 1e-9, False)])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_law_starts_in_the_first_box(known, axis, share, held):
    """As far beside the path as the box reaches, with its own configuration."""
    own, path = known.claim.equations, known.premises[0]
    system, box = own.closures.system, path.premises[0].claim.boxes.take(np.array([0]))
    delta = np.zeros((1, 3))
    delta[0, 0], delta[0, 1 + axis] = -1.0, share * reached(system, box)[0, 1 + axis]
    theta = predict(own.closures, box, delta)[0]
    theta[system.independent] = box.centre[0, system.independent] - box.directions[0, system.independent, 0]
    theta[system.independent[axis]] += delta[0, 1 + axis]
    moved = SimpleNamespace(reference=own.reference, closures=own.closures, theta=theta)
    claim = replace(known.claim, equations=moved)
    if held:
        claim._require_path(path)
    else:
        with pytest.raises(NotProvedError, match="beside"):
            claim._require_path(path)


def claim_over(times, room):
    """A claim of which only times and rooms are asked."""
    closures = SimpleNamespace(system=SimpleNamespace(n=1, independent=np.array([0]), n_free=2))
    none = np.zeros(1)
    return TubeKept(SimpleNamespace(closures=closures), np.array(times), np.array(room), *[none] * 7)


@pytest.mark.parametrize("edge", [1.0 + 3e-9, 0.7, 2e-3])
def test_cells_reach_to_the_edge_of_their_boxes(edge):
    """E and what the chord strays, 8u more, are what the box has; the next double is not."""
    boxes = Boxes(
        np.array([[0.3, 0.2]]), np.array([[1.0, edge]]), np.array([[[0.1, 1.0], [0.0, 0.0]]]), *[np.zeros((1, 1))] * 5
    )
    claim = claim_over([0.0, 1.0], [[1.0, 1.0]])
    most = reached(claim.equations.closures.system, boxes)[0, 1]
    place = SimpleNamespace(middle=np.array([[0.3]]), along=np.array([[0.1]]), deviation=np.zeros((1, 1)))
    room = most
    while room * (1.0 + 8.0 * 2.0**-53) > most:
        room = np.nextafter(room, 0.0)
    solutions = SimpleNamespace(claim=SimpleNamespace(boxes=boxes))
    for wide, held in ((room, True), (np.nextafter(room, 9.0), False)):
        for own, strayed in ((wide, 0.0), (2.0**-80, wide)):
            cells = SimpleNamespace(place=SimpleNamespace(**vars(place) | {"deviation": np.array([[strayed]])}))
            asked = replace(claim, room=np.array([[own, 1.0]]))
            if held:
                asked._require_covered(solutions, cells)
            else:
                with pytest.raises(NotProvedError, match="in its box"):
                    asked._require_covered(solutions, cells)
    short = boxes._replace(half=np.array([[np.nextafter(1.0, 0.0), edge]]))
    with pytest.raises(NotProvedError, match="in its box"):
        replace(claim, room=np.array([[room, 1.0]]))._require_covered(
            SimpleNamespace(claim=SimpleNamespace(boxes=short)), SimpleNamespace(place=place)
        )


class Glue:
    """A path of three boxes and a tube of two cells, [0, 1] and [1, 2], with pairs that are told."""

    def __init__(self, pairs, turns=None, kind=GluedBoxes, ends=(0.0, 0.75, 1.25, 2.0)):
        self.along, self.solutions = object(), object()
        self.path = SimpleNamespace(premises=(self.along,), claim=SimpleNamespace(times=np.array(ends)))
        first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        at = np.zeros((len(first), 1))
        turn = np.zeros((len(first), 2), dtype=np.int64) if turns is None else np.array(turns)
        premises = (self.along, self.solutions) if kind is GluedBoxes else ("points", self.along, self.solutions)
        claim = (
            GluedBoxes(None, first, second, at, at) if kind is GluedBoxes else Met(None, first, second, at, at, first)
        )
        self.facts = [SimpleNamespace(claim=claim, premises=premises, found={"turn": turn})]

    def held(self):
        claim_over([0.0, 1.0, 2.0], np.ones((2, 2)))._require_glued(self.path, self.solutions, self.facts)

    def refused(self, said):
        with pytest.raises(NotProvedError, match=said):
            self.held()


@pytest.mark.parametrize("kind", [GluedBoxes, Met])
def test_every_cell_is_glued_where_the_path_is_at_that_time(kind):
    """Numbers from three on are the cells; box 1 of the path is beside both, 0 and 2 beside one; ends do not do."""
    for pairs, held in (
        ([(0, 3), (2, 4)], True), ([(1, 3), (1, 4)], True), ([(0, 3), (1, 4)], True),
        ([(0, 3)], False), ([(2, 4)], False), ([(2, 3), (2, 4)], False), ([(0, 3), (0, 4)], False),
        ([(3, 0), (4, 2)], False), ([(3, 3), (2, 4)], False), ([(0, 0), (2, 4)], False), ([(0, 3), (4, 4)], False),
        ([(0, 1), (0, 3), (2, 2)], False), ([], False),
    ):  # fmt: skip
        glue = Glue(pairs, kind=kind)
        glue.held() if held else glue.refused("not glued")
    Glue([(0, 3), (1, 4)], kind=kind, ends=(0.0, 1.0, 1.5, 2.0)).held()
    Glue([(1, 3), (1, 4)], kind=kind, ends=(0.0, 1.0, 1.5, 2.0)).refused("not glued")


def test_a_turn_is_no_glue():
    for turns, held in (([[0, 0], [0, 0]], True), ([[0, 1], [0, 0]], False), ([[0, 0], [-1, 0]], False)):
        glue = Glue([(0, 3), (2, 4)], turns)
        glue.held() if held else glue.refused("not glued")


def test_glue_is_about_the_paths_boxes_and_the_cells():
    """To the object: first those, then these, and nothing else."""
    for change in (
        lambda g: (g.solutions, g.along), lambda g: (g.along,), lambda g: (g.along, object()),
        lambda g: (object(), g.solutions), lambda g: (g.along, g.solutions, g.solutions),
    ):  # fmt: skip
        glue = Glue([(0, 3), (2, 4)])
        glue.facts[0].premises = change(glue)
        glue.refused("other facts")
    glue = Glue([(0, 3), (2, 4)])
    glue.facts[0].claim = SimpleNamespace(**vars(glue.facts[0].claim))
    glue.refused("other kinds")
