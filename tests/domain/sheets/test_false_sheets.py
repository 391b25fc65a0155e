"""Searches for sheets that go wrong cost a proof: whatever they leave out, what is counted is true."""

from dataclasses import replace

import numpy as np
import pytest

from ccpin.arrays import joined, rows_of
from ccpin.covering.pruning import Pruning
from ccpin.domain import certify_sheets
from ccpin.domain.closures.system import reading_of
from ccpin.domain.sheets import certifying, counting, sheet_claims
from ccpin.domain.sheets.cover import Front, Glued
from ccpin.errors import InvalidInputError
from ccpin.proof.newton import Boxes
from tests.support.long_cases import later

REGION = ((-2.4, -1.4), (-1.4, -0.4))  # of the RPDR: across its fold
Q = np.random.default_rng(5).uniform(*REGION, (40, 2))


@pytest.fixture(scope="module")
def truth(rpdr):
    """How many configurations close at some q, by Newton's method from a grid of all angles."""
    reading = reading_of(rpdr, rpdr.q_reference)
    system, angles = reading.system, np.linspace(-np.pi, np.pi, 13)[:-1]
    grid = np.stack(np.meshgrid(*system.m * [angles], indexing="ij"), axis=-1).reshape(-1, system.m)
    numbers = []
    for q in Q:
        theta = np.zeros((len(grid), system.n_free))
        theta[:, system.independent], theta[:, system.dependent] = q, grid
        found = counting.newton(reading.problem, theta, 40)
        closed = np.mod(found.theta[found.settled][:, system.dependent] + 1e-6, 2 * np.pi)
        numbers.append(len(np.unique(np.round(closed, 4), axis=0)))
    assert {0, 2} <= set(numbers)
    return np.array(numbers)


@pytest.fixture(scope="module")
def honest(rpdr):
    return certify_sheets(rpdr, REGION, max_depth=5)


def counted_well(sheets, truth):
    """That nothing false is said of any of these q."""
    said = sheets.number_of_solutions(Q)
    assert np.all((said == truth) | (said == -1))
    for k in np.flatnonzero(said > 0):
        try:
            assert len(sheets.solutions(Q[k])[0]) == truth[k]
        except InvalidInputError:  # not all of them are in boxes
            continue
    return float(np.mean(said >= 0))


def test_an_honest_search_counts_nearly_all(honest, truth):
    assert counted_well(honest, truth) > 0.8
    assert honest.proved is not None


def without_some(candidates, keep):
    return rows_of(candidates, keep(candidates))


@pytest.mark.parametrize("keep", [
    lambda found: np.arange(len(found.cell)) % 2 == 0,
    pytest.param(lambda found: found.cell % 3 > 0, marks=pytest.mark.slow),
    lambda found: np.zeros(len(found.cell), dtype=bool),
], ids=["every other", "cells", "all"])  # fmt: skip
def test_singular_candidates_left_out(monkeypatch, rpdr, truth, keep):
    """Cells that hold folds are called regular."""
    cover = counting.cover_singular

    def searched(*args):
        found = cover(*args)
        return found._replace(left=without_some(found.left, keep))

    monkeypatch.setattr(certifying, "cover_singular", searched)
    counted_well(certify_sheets(rpdr, REGION, max_depth=4), truth)


def test_candidates_lost_on_the_way(monkeypatch, rpdr, truth):
    settled = Pruning.settled
    monkeypatch.setattr(
        Pruning, "settled",
        lambda self, waiting, rounds: without_some(settled(self, waiting, rounds), lambda c: c.cell % 5 > 0),
    )  # fmt: skip
    counted_well(certify_sheets(rpdr, REGION, max_depth=5), truth)


def test_upper_halves_lost(monkeypatch, rpdr, truth):
    down = counting.handed_down
    monkeypatch.setattr(
        counting, "handed_down",
        lambda *args: without_some(down(*args), lambda c: np.arange(len(c.cell)) < len(c.cell) // 2),
    )  # fmt: skip
    counted_well(certify_sheets(rpdr, REGION, max_depth=5), truth)


def test_all_that_is_regular_called_one_part(monkeypatch, rpdr, truth):
    monkeypatch.setattr(sheet_claims, "parts_of", lambda tree, region, regular: [regular])
    counted_well(certify_sheets(rpdr, REGION, max_depth=5), truth)


OF_POINTS = {
    "one left out": lambda boxes: boxes.take(np.arange(len(boxes.kappa) - 1)) if len(boxes.kappa) else boxes,
    "one twice": lambda boxes: joined([boxes, boxes.take(np.arange(min(1, len(boxes.kappa))))]),
    "all turned": lambda boxes: boxes._replace(centre=boxes.centre + [0.0, 0.0, *(len(boxes.centre[0]) - 2) * [6.2832]])
    if len(boxes.kappa)
    else boxes,
    "none": lambda boxes: boxes.take(np.zeros(0, dtype=int)),
    "wide": lambda boxes: boxes._replace(radius=50.0 * boxes.radius),
}  # fmt: skip


@pytest.mark.parametrize("name", [*later("one left out", "none", "wide"), "one twice", "all turned"])
def test_points_that_are_not_all(monkeypatch, rpdr, truth, name):
    task = counting.solutions_task
    monkeypatch.setattr(
        sheet_claims, "solutions_task", lambda problem, arrays: tuple(OF_POINTS[name](Boxes(*task(problem, arrays))))
    )
    share = counted_well(certify_sheets(rpdr, REGION, max_depth=5), truth)
    assert name != "one twice" or share > 0.8  # each is counted once


MISPLACED = {
    "a neighbour's": lambda members: members._replace(cell=np.roll(members.cell, 2)),
    "one twice": lambda members: members._replace(box=members.box // 2 * 2),
}


@pytest.mark.parametrize("name", MISPLACED)
def test_boxes_over_other_cells_or_twice_over_one(monkeypatch, rpdr, truth, name):
    """They do not make a cell's configurations complete."""
    run = Front.run

    def misplaced(self):
        run(self)
        self.members = MISPLACED[name](self.members)

    monkeypatch.setattr(Front, "run", misplaced)
    sheets = certify_sheets(rpdr, REGION, max_depth=4)
    counted_well(sheets, truth)
    assert sheets.certified_fraction < 0.05


def test_sheets_that_do_not_touch_are_not_one(monkeypatch, rpdr, honest):
    """Boxes of two sheets said to be glued."""
    glued_pairs = certifying.glued_pairs

    def all_glued(runner, region, tree, members, boxes):
        found = glued_pairs(runner, region, tree, members, boxes)
        others = Glued(found.first, found.second[::-1], found.at_first, found.at_second[::-1])
        return joined([found, others, Glued(others.first, np.roll(others.first, 1), found.at_first, found.at_first)])

    monkeypatch.setattr(certifying, "glued_pairs", all_glued)
    sheets = certify_sheets(rpdr, REGION, max_depth=5)
    assert len(sheets.sheets) == len(honest.sheets)


def test_what_was_not_proved_is_not_said_to_be(honest):
    """Sheets whose numbers are altered are none that were proved."""
    for change in (
        {"count": np.where(honest.count == 0, 2, honest.count)},
        {"boxes": honest.boxes._replace(radius=0.5 * honest.boxes.radius)},
        {"members": honest.members._replace(cell=honest.members.cell[::-1])},
        {"glued": honest.glued._replace(second=honest.glued.first)},
    ):
        with pytest.raises(InvalidInputError, match="not those that were proved"):
            replace(honest, **change)
        assert replace(honest, **change, proved=None).proved is None


def test_a_file_is_believed_only_once_it_is_replayed(tmp_path, honest):
    """And what it says too much is found then."""
    path = tmp_path / "sheets.npz"
    honest.save(path)
    told = type(honest).load(path)
    assert told.proved is None
    again = type(honest).load(path, replay=True)
    assert again.proved is not None
    assert np.array_equal(again.count, honest.count)
    for change in (
        {"count": np.where(honest.count == 0, 2, honest.count)},
        {"count": np.where(honest.count < 0, 2, honest.count)},
        {"glued": honest.glued._replace(second=np.roll(honest.glued.second, 1))},
    ):
        replace(honest, **change, proved=None).save(path)
        with pytest.raises(InvalidInputError, match="altered"):
            type(honest).load(path, replay=True)
