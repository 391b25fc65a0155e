"""Searches for tubes that go wrong: what they propose is checked, and no bound is proven that a motion breaks.

The oracle is a motion under the σ that pushes most: it stays within whatever is told to be proven.
"""

from functools import lru_cache

import numpy as np
import pytest

import ccpin
from ccpin.control import ComputedTorque, PDPlus, certify_tracking
from ccpin.control.stability.tracking import reference_tube, tube_search
from ccpin.control.stability.tracking.cell_forms import TimeCells
from ccpin.control.stability.tracking.reference_tube import ReferenceTube
from ccpin.control.stability.tracking.tube_search import TubeSearch
from ccpin.covering.proposals.krawczyk import certify_boxes
from tests.oracles import rpdr as oracle
from tests.support.long_cases import later
from tests.support.paper import START
from tests.support.sigma_attacks import WithWrongSigma, pushing
from tests.support.tracked import LAWS, RUN, assert_within, law_for

EPSILON = 1e-3
CELLS = 48
every_law = pytest.mark.parametrize(
    "law_class", [ComputedTorque, pytest.param(PDPlus, marks=pytest.mark.slow)]
)  # what is checked asks a law for two matrices


@lru_cache
def motions(law_class):
    """Pushed in either coordinate."""
    law = law_for(law_class)
    attacks = [WithWrongSigma(law, pushing(law, EPSILON, axis)) for axis in np.eye(2)]
    return [ccpin.simulate(law.model, attack, START, **RUN) for attack in attacks]


def outcome(law_class, size=EPSILON):
    """The verdict, if the motions keep to what is proven."""
    proof = certify_tracking(law_for(law_class), size, cells=CELLS)
    if proof.verdict == "proven":
        for motion in motions(law_class):
            assert_within(proof, law_for(law_class), motion)
    return proof.verdict


@pytest.mark.parametrize("law_class", later(*LAWS))
def test_honest_searches_prove(law_class):
    assert outcome(law_class) == "proven"


@every_law
@pytest.mark.parametrize("share", later(0.1, 1e-3, 0.5))
def test_rooms_that_are_too_small(law_class, share, monkeypatch):
    """Levels are told to be lower than they are, so that the first room seems to do."""
    honest = tube_search.levels_of

    def lower(*given):
        found = honest(*given)
        return found._replace(reached=share**2 * found.reached, entries=share * found.entries)

    monkeypatch.setattr(tube_search, "levels_of", lower)
    verdict = outcome(law_class)
    assert share > 0.2 or verdict == "undecided"


@every_law
def test_deviations_that_are_left_out(law_class, monkeypatch):
    """G is said to be a tenth, and the law's terms those of a smaller error."""
    honest = tube_search.deviation_of

    def smaller(*given):
        found = honest(*given)
        return found._replace(slope=found.slope * 0.1, push=0.1 * found.push)

    monkeypatch.setattr(tube_search, "deviation_of", smaller)
    outcome(law_class)


@every_law
@pytest.mark.parametrize("share", later(0.5, 0.25))
def test_boxes_that_are_not_proved(law_class, share, monkeypatch):
    """Tubes narrower than what was proved."""
    honest = ReferenceTube.boxes

    def narrowed(self, room):
        boxes, proved = honest(self, room)
        return boxes._replace(radius=share * boxes.radius), proved

    monkeypatch.setattr(ReferenceTube, "boxes", narrowed)
    outcome(law_class)


@every_law
def test_boxes_of_another_branch(law_class, monkeypatch):
    """All cells but the first few are the other assembly mode's, which is proved as well."""
    honest, swapped = ReferenceTube.boxes, []

    def mixed(self, room):
        boxes, proved = honest(self, room)
        system = self.path.problem.system
        theta = np.array([oracle.sigma(q, -1)[[0, 2, 1, 3]] for q in self.cells.place.middle])
        theta[:, system.independent] = self.cells.place.middle
        other = certify_boxes(self.path.problem, theta, boxes.half, boxes.directions[:, system.independent])
        far = (np.arange(len(proved)) >= 3) & other.proved
        swapped.append(far.sum())
        chosen = (np.where(far.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in zip(boxes, other.boxes, strict=True))
        return type(other)(type(boxes)(*chosen), proved | far)

    monkeypatch.setattr(ReferenceTube, "boxes", mixed)
    assert outcome(law_class) == "undecided"
    assert max(swapped) > 10


@every_law
@pytest.mark.parametrize("kept", later(slice(None, -1), slice(1, None), slice(None, None, 2), slice(0, 0)))
def test_cells_that_are_not_glued(law_class, kept, monkeypatch):
    honest = reference_tube.proved_glue

    def fewer(problem, seams, solutions):
        return honest(problem, type(seams)(*(rows[kept] for rows in seams)), solutions)

    monkeypatch.setattr(reference_tube, "proved_glue", fewer)
    assert outcome(law_class) == "undecided"


@every_law
def test_jumps_that_are_left_out(law_class, monkeypatch):
    """And cells of other times: what the search has of the reference is not what the claim is about."""
    honest = reference_tube.tube_of

    def still(law, cells):
        found = honest(law, cells)
        return found._replace(cells=found.cells._replace(kicks=0.0 * found.cells.kicks))

    monkeypatch.setattr("ccpin.control.stability.tracking.tracking_error.tube_of", still)
    outcome(law_class)


@every_law
@pytest.mark.parametrize("change", ["first", *later("middle", "last", "later")])
def test_cells_left_out(law_class, change, monkeypatch):
    """Times of the reference that no cell has, and the cells' boxes with them."""
    honest = reference_tube._cut

    def shorter(knots, rests, cells):
        times = honest(knots, rests, cells)
        return {
            "first": times[1:],
            "last": times[:-1],
            "middle": np.delete(times, len(times) - 2),
            "later": np.append(times[:1], times[1:] + 0.5 * (times[2] - times[1])),
        }[change]

    monkeypatch.setattr(reference_tube, "_cut", shorter)
    try:
        verdict = outcome(law_class)
    except ValueError:  # beyond the reference's own times
        return
    assert verdict == "undecided"


@every_law
@pytest.mark.parametrize("change", ["no P", *later("smaller P", "faster", "scale")])
def test_storage_functions_that_are_none(law_class, change, monkeypatch):
    honest = TubeSearch._choice

    def other(self, middle):
        found = honest(self, middle)
        none = np.zeros((0, 0)) if found.P is None else found.P
        return {
            "faster": found._replace(decay=20.0 * found.decay),
            "smaller P": found._replace(P=1e-6 * none if none.size else None, cross=100.0 * found.cross),
            "no P": found._replace(P=-none if none.size else np.eye(4)),
            "scale": found._replace(scale=1e-9 * found.scale),
        }[change]

    monkeypatch.setattr(TubeSearch, "_choice", other)
    outcome(law_class)


@every_law
def test_paths_of_another_reference(law_class, monkeypatch):
    """What was proved is a motion nearby, at the same times."""
    honest = reference_tube.certify_path

    def beside(mechanism, pieces, *more):
        c = pieces.c.copy()
        c[-1] += 1e-4
        return honest(mechanism, type(pieces)(c, pieces.x), *more)

    monkeypatch.setattr(reference_tube, "certify_path", beside)
    assert outcome(law_class) == "undecided"


@every_law
def test_chords_that_do_not_stray(law_class, monkeypatch):
    """The search's cells are said to be straight: their boxes are too narrow."""
    honest = TimeCells.of.__func__

    def straight(cls, *given):
        found = honest(cls, *given)
        return found._replace(place=found.place._replace(deviation=0.0 * found.place.deviation))

    law = law_for(law_class)
    tube = reference_tube.tube_of(law, CELLS)
    monkeypatch.setattr(
        "ccpin.control.stability.tracking.tracking_error.tube_of",
        lambda *_: tube._replace(cells=straight(TimeCells, tube.equations.motion, tube.cells.times)),
    )
    outcome(law_class)


def test_an_error_of_sigma_that_is_larger(monkeypatch):
    """What is proved for ε is not told of another."""
    honest = TubeSearch.found

    def other(self):
        self.given = self.given._replace(sigma_error=1e-9)
        return honest(self)

    monkeypatch.setattr(TubeSearch, "found", other)
    assert outcome(ComputedTorque) == "undecided"
