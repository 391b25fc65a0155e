"""Claims about how many configurations an arm has, made at random and spoilt: what is proved of them is true."""

import numpy as np
import pytest

from ccpin.arrays import joined
from ccpin.proof.cell_tree import WHOLE, tree_of
from ccpin.proof.equations import Closures
from ccpin.proof.exhausted import Excluded
from ccpin.proof.facts import NotProvedError, prove, prove_some
from ccpin.proof.newton import Boxes
from ccpin.proof.ranges import NO_LIMIT
from ccpin.proof.solution_counts import CompleteCells, CountedCells
from ccpin.proof.solutions import SolutionsInBoxes
from tests.support.long_cases import later
from tests.support.straight import arm, reached_by

ARM = Closures(arm().system)
TURN = 2.0 * np.pi


def number_at(q):
    """An arm of two links of length 1 reaches q in two ways, not at all, or is singular (−1)."""
    size = np.linalg.norm(q)
    return -1 if size == 2.0 or size == 0.0 else 2 if size < 2.0 else 0


def configurations(q, middle=0.0):
    """y of both, by the law of cosines, about a middle."""
    bend = np.arccos(np.clip(0.5 * np.sum(np.square(q)) - 1.0, -1.0, 1.0))
    found = [np.array([np.arctan2(-q[1], q[0]) - side * 0.5 * bend, side * bend]) for side in (1.0, -1.0)]
    for y in found:
        np.testing.assert_allclose(reached_by(y)[:2], q, atol=1e-7)
    return [y + TURN * np.round((middle - y) / TURN) for y in found]


def random_tree(rng, cells):
    """A tree of so many cells or some more, its numbers shuffled, and cells that nobody reaches."""
    pairs, child, cut = rng.permutation(cells), np.full(2 * cells + 1, -1), rng.integers(0, 2, 2 * cells + 1)
    leaves = [0]
    for pair in pairs[: cells - 2]:
        cell = leaves.pop(int(rng.integers(len(leaves))))
        child[cell] = 1 + 2 * pair
        leaves += [1 + 2 * pair, 2 + 2 * pair]
    for pair in pairs[cells - 2 :]:
        child[1 + 2 * pair] = int(rng.integers(-1, 2 * cells))
    return cut, child


def box_about(rng, q, y, half):
    """A box about a configuration, with numbers that may prove it."""
    theta = np.concatenate([q, y])[None]
    jacobian = ARM.first(theta)[1]
    inverse = np.linalg.inv(jacobian[:, :, 2:]) if abs(np.linalg.det(jacobian[0, :, 2:])) > 1e-3 else np.eye(2)[None]
    directions = np.concatenate([np.eye(2)[None], -inverse @ jacobian[:, :, :2]], axis=1)
    one = np.ones((1, 2))
    radius = one * (float(rng.choice([1e-9, 1e-3])) + 4.0 * np.max(half))
    return Boxes(
        theta, np.array(half, dtype=float)[None], directions, np.eye(2)[None], inverse, radius, one, np.full(1, 0.95)
    )


NONE = box_about(np.random.default_rng(0), np.zeros(2), np.ones(2), np.zeros(2)).take(np.zeros(0, dtype=int))


def spoilt(rng, boxes):
    """Boxes turned, told twice, left out, moved or widened."""
    count, way = len(boxes.kappa), rng.integers(12)
    if not count:
        return boxes
    rows = np.arange(count)
    if way == 0:
        rows = np.delete(rows, rng.integers(count))
    elif way == 1:
        rows = np.append(rows, rng.integers(0, count, 2))
    centre, radius = boxes.centre.copy(), boxes.radius.copy()
    if way == 2:
        centre[rng.integers(count), 2:] += TURN * rng.integers(-2, 3, 2)
    elif way == 3:
        centre[rng.integers(count), rng.integers(4)] += rng.choice([1e-12, 1e-3, 0.1, TURN])
    elif way == 4:
        radius[rng.integers(count)] *= rng.choice([0.5, 2.0, 30.0])
    return boxes._replace(centre=centre, radius=radius).take(rows)


def corners(lower, upper):
    return np.array([[lower[0], lower[1]], [lower[0], upper[1]], [upper[0], lower[1]], upper, 0.5 * (lower + upper)])


def random_cells(rng):
    """The fact about cells of a random region, some kept, and the two ends of all cells."""
    angle = rng.uniform(-3, 3)
    middle = rng.uniform(0.3, 2.1) * np.array([np.cos(angle), np.sin(angle)])
    width = rng.choice([0.5, 0.05, 1e-3]) * rng.uniform(0.5, 1.0, 2) * (rng.random(2) > 0.1)
    lower, upper = middle - width, middle + width
    cut, child = random_tree(rng, 9)
    claim = Excluded(
        ARM, lower, upper, np.zeros(2, dtype=bool), cut, child, rng.random(len(child)) < rng.choice([0.0, 0.3]),
        np.tile([-NO_LIMIT, NO_LIMIT], (2, 1)), rng.uniform(-9, 9, 2), np.array([rng.random() < 0.9]),
    )  # fmt: skip
    tree = tree_of(cut, child, 2)
    ends = [lower + (upper - lower) * (corner / WHOLE) for corner in (tree.lower, tree.lower + tree.size)]
    return prove(claim), np.flatnonzero(tree.reached & (child < 0)), ends


def random_count(rng, excluded, leaves, ends):
    """A claim about how many there are over a cell, and the fact about boxes over a q that may be in it."""
    empty = np.flatnonzero(excluded.found["empty"])
    cells = rng.choice(empty if empty.size else leaves, 1)
    moved = rng.choice([0.0, 0.2, 0.3]) * rng.uniform(-1, 1, 2)
    q = 0.5 * (ends[0] + ends[1])[cells] + moved * (ends[1] - ends[0])[cells]
    ways = configurations(q[0], excluded.claim.middle) if number_at(q[0]) == 2 else []
    over = joined([NONE, *(box_about(rng, q[0], y, np.zeros(2)) for y in ways)])
    points = prove_some(SolutionsInBoxes(ARM, *spoilt(rng, over)))[0]
    return CountedCells(ARM, cells, q, np.zeros(len(points.claim.kappa), dtype=np.int64)), points


def random_boxes(rng, leaves, ends):
    """The fact about boxes over leaves, and over which they are said to lie."""
    some, lies = [NONE], []
    for leaf in leaves:
        centre, half = 0.5 * (ends[0] + ends[1])[leaf], 0.5 * (ends[1] - ends[0])[leaf]
        if number_at(centre) == 2:
            some += [box_about(rng, centre, y, half * rng.choice([1.0, 1.01, 0.9])) for y in configurations(centre)]
            lies += [leaf, leaf]
    boxes, kept = prove_some(SolutionsInBoxes(ARM, *joined(some)))
    cell = np.array(lies, dtype=np.int64)[kept]
    box = np.arange(len(cell))
    if len(cell) and rng.random() < 0.5:
        box[rng.integers(len(cell))] = rng.integers(len(cell))
    if len(cell) and rng.random() < 0.3:
        cell = np.roll(cell, int(rng.integers(3)))
    return boxes, cell, box


def each_in_one(boxes, q):
    """That boxes hold the arm's configurations over q, each one of its own."""
    true = configurations(q) if number_at(q) == 2 else []
    near = boxes.centre + (boxes.directions @ (q - boxes.centre[:, :2])[..., None])[..., 0]
    gaps = np.abs(np.angle(np.exp(1j * (np.reshape(true, (1, -1, 2)) - near[:, None, 2:]))))
    held = np.all(gaps <= boxes.radius[:, None] * 1.001 + 1e-9, axis=2)
    assert held.shape == (len(true), len(true))
    assert held.any(axis=0).all()
    assert held.any(axis=1).all()


@pytest.mark.parametrize("seed", later(0, 2, 3))
def test_what_is_proved_of_an_arm_is_true(seed):
    """At the corners and in the middle of cells; and much is proved."""
    rng, found = np.random.default_rng(seed), np.zeros(3, dtype=int)
    for _ in range(6):
        excluded, leaves, ends = random_cells(rng)
        numbers = [{number_at(q) for q in corners(*pair)} for pair in zip(*ends, strict=True)]
        empty = np.flatnonzero(excluded.found["empty"])
        assert all(numbers[cell] in ([{0}, {2}] if excluded.claim.singular[0] else [{0}]) for cell in empty)
        try:
            claim, points = random_count(rng, excluded, leaves, ends)
            counted = prove(claim, excluded, points)
        except NotProvedError:
            continue
        count = counted.found["count"]
        assert all(numbers[cell] == {count[cell]} for cell in np.flatnonzero(count >= 0))
        boxes, cell, box = random_boxes(rng, leaves, ends)
        whole = prove(CompleteCells(ARM, excluded.claim.cut, excluded.claim.child, cell, box), counted, boxes)
        complete = np.flatnonzero(whole.found["complete"])
        for leaf in complete:
            for q in corners(ends[0][leaf], ends[1][leaf]):
                each_in_one(boxes.claim.boxes.take(box[cell == leaf]), q)
        found += [len(empty), np.sum(count >= 0), len(complete)]
    assert np.all(found > 0)
