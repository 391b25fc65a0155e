"""What is excluded over cells: all of a cell and a little beside it, whatever a tree's numbers are."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from ccpin.arrays import rows_of
from ccpin.proof import exhausted as module
from ccpin.proof.cell_tree import WHOLE, CellRegion, HalvedTree, tree_of
from ccpin.proof.equations import Closures
from ccpin.proof.exhausted import Excluded, over_cells
from ccpin.proof.facts import NotProvedError, prove
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import NO_LIMIT, proved_ranges
from ccpin.work import Stopped, stoppable
from tests.support.made_up import made_up
from tests.support.straight import arm, circles, problem_by_hand, straight, whole_numbers

U = 2.0**-53
LINE, ARM = straight([[1.0]]), Closures(arm().system)
QUARTERS = {"cut": (0,) * 7, "child": (1, 3, 5, -1, -1, -1, -1)}


def excluded(equations=LINE, lower=(0.0,), upper=(1.0,), cut=(0, 0, 0), child=(1, -1, -1), kept=(), **others):
    """A claim: by default of the halves of [0, 1], of no singular configuration, without limits."""
    n, m = equations.system.n, equations.system.m
    given = {
        "wrapped": np.zeros(n, dtype=bool),
        "kept": np.isin(np.arange(len(child)), kept),
        "limits": np.tile([-NO_LIMIT, NO_LIMIT], (m, 1)),
        "middle": np.zeros(m),
        "singular": np.ones(1, dtype=bool),
    }
    cut, child = whole_numbers(*cut), whole_numbers(*child)
    return Excluded(equations, np.array(lower), np.array(upper), cut=cut, child=child, **(given | others))


def empty_of(claim):
    return prove(claim).found["empty"].tolist()


# What is singular, at a limit, or there at all


@pytest.mark.parametrize("width", [2.0**-36, 2.0**-34])
@pytest.mark.parametrize("singular", [True, False])
def test_a_cell_that_begins_where_an_arm_is_stretched_is_not_empty(width, singular):
    """At q = (2, 0) alone, its lower end, it holds a configuration, which is singular; the cell before holds more."""
    far = excluded(
        ARM, (2.0 - 3 * width, 0.0), (2.0 + width, 0.0), (0,) * 5, (1, -1, 3, -1, -1), kept=(1, 3),
        singular=np.array([singular]),
    )  # fmt: skip
    assert empty_of(far) == [False] * 5
    beside = replace(far, lower=far.lower + 5e-12, upper=far.upper + 5e-12)
    assert empty_of(beside) == [False] * 4 + [True]


def test_what_is_closed_is_not_excluded_unless_it_is_to_be_singular():
    """y = q is nowhere singular."""
    assert empty_of(excluded()) == [False, True, True]
    assert empty_of(excluded(singular=np.array([False]))) == [False] * 3
    assert empty_of(excluded(child=(-1,), cut=(0,))) == [True]


@pytest.mark.parametrize("singular", [True, False])
def test_limits_are_the_claims_own(singular):
    """y = q ≤ 0.3 where nothing singular is: what is at the limit is not excluded, what is beyond is."""
    below, above = np.array([[-NO_LIMIT, 0.3]]), np.array([[0.7, NO_LIMIT]])
    for limits, ours in ((below, 1), (above, 2)):
        found = empty_of(excluded(limits=limits, singular=np.array([singular])))
        assert found == [False, ours != 1, ours != 2]
    assert empty_of(excluded(limits=np.array([[-1.0, -0.7]]), singular=np.array([singular]))) == [False, True, True]


def test_leaves_that_are_kept_or_not_reached_are_not_spoken_of():
    kept = excluded(**QUARTERS, kept=(0, 4, 5))
    assert empty_of(kept) == [k in (3, 6) for k in range(7)]
    spare = excluded(cut=(0,) * 5, child=(3, -1, 1, -1, -1))
    assert empty_of(spare) == [False, False, False, True, True]
    assert empty_of(excluded(kept=(0, 1, 2))) == [False] * 3


def test_full_turns_are_about_the_middle_that_is_told():
    for middle in (0.0, 5.0):
        ranges = proved_ranges(circles().system, middle, (np.zeros(1), np.ones(1)), excluded(circles()).limits)
        np.testing.assert_allclose([ranges.lower, ranges.upper], [[middle - np.pi], [middle + np.pi]])
        claim = excluded(circles(), middle=np.array([middle]))
        np.testing.assert_array_equal(claim.ranges().lower, ranges.lower)
        assert empty_of(claim) == [False, True, True]
        assert empty_of(replace(claim, singular=np.array([False]))) == [False] * 3


# What is no claim


def test_forged_claims_are_refused():
    """Misshapen arrays, a tree that is none, exchanged corners, no full turn, numbers that are none, premises."""
    claim = excluded()
    fact = prove(claim)
    wrong = [
        {"kept": np.zeros(2, dtype=bool)}, {"kept": np.zeros(3)}, {"lower": np.zeros(2)}, {"middle": np.zeros(2)},
        {"limits": np.zeros((2, 2))}, {"limits": np.array([[-np.inf, 0.0]])}, {"middle": np.array([np.nan])},
        {"upper": np.array([np.inf])}, {"singular": np.ones(2, dtype=bool)}, {"wrapped": np.ones(1, dtype=bool)},
        {"lower": np.array([1.5])}, {"cut": whole_numbers(1, 0, 0)}, {"cut": whole_numbers(0, 0)},
        {"child": whole_numbers(1, 1, -1)}, {"child": whole_numbers(0, -1, -1)}, {"child": whole_numbers(2, -1, -1)},
        {"child": whole_numbers(-2, -1, -1)}, {"cut": whole_numbers(), "child": whole_numbers()},
    ]  # fmt: skip
    for change in wrong:
        with pytest.raises(NotProvedError):
            prove(replace(claim, **change))
    with pytest.raises(NotProvedError):
        prove(claim, fact)


def test_rows_that_hold_modulo_something_are_refused():
    modulo = Closures(replace(LINE.system, moduli=np.array([1.0])))
    with pytest.raises(NotProvedError, match="modulo"):
        prove(excluded(modulo))


def test_what_nothing_bounds_is_refused():
    free = Closures(replace(LINE.system, couplings=np.array([[1.0, 0.0]])))
    with pytest.raises(NotProvedError, match="no range"):
        prove(excluded(free))
    assert empty_of(excluded(free, limits=np.array([[-1.0, 1.0]]))) == [False, False, True]


# Down the tree


def q_of(candidate):
    """From where to where candidates are in q, exactly."""
    return [
        (Fraction(float(c)) - Fraction(float(h)), Fraction(float(c)) + Fraction(float(h)))
        for c, h in zip(candidate.centre[:, 0], candidate.half[:, 0], strict=True)
    ]


def planted(monkeypatch, q, narrowest=0.0):
    """One thing at q is looked for, and nothing is found about candidates that are not narrower than told."""
    seen = []

    def narrowed_both(problem, ranges, waiting, singular=False):
        ends = q_of(waiting)
        seen.extend(zip(waiting.cell.tolist(), ends, strict=True))
        held = [low <= q <= high or high - low > 2 * narrowest > 0 for low, high in ends]
        return rows_of(waiting, np.array(held, dtype=bool))

    monkeypatch.setattr(module, "narrowed_both", narrowed_both)
    none_due = lambda problem, waiting: (np.ones(len(waiting.cell), dtype=int), np.zeros(len(waiting.cell), dtype=bool))  # noqa: E731
    monkeypatch.setattr(module, "to_halve", none_due)
    return seen


TREES = {
    "in order": ((1, 3, 5, -1, -1, -1, -1), (3, 4, 5, 6)),
    "from behind": ((5, -1, -1, -1, -1, 3, 1), (3, 4, 1, 2)),
    "with cells that nobody reaches": ((5, -1, -1, -1, -1, 3, 1, 7, 7, 5, -1), (3, 4, 1, 2)),
    "that refer to one another": ((5, -1, -1, -1, -1, 3, 1, 8, 6, 3), (3, 4, 1, 2)),
}


@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("wide", [1.0, 2.0**-38])
def test_the_leaf_that_holds_something_is_not_empty(monkeypatch, name, wide):
    """Anywhere in it, its ends with it, and 1e-12 beside: of [7, 7 + w] in four, all other leaves are."""
    child, leaves = TREES[name]
    claim = excluded(lower=(7.0,), upper=(7.0 + wide,), cut=(0,) * len(child), child=child)
    beyond, widest = Fraction(1e-12), Fraction(2e-12)
    for k, share in product(range(4), (0, Fraction(1, 3), 1)):
        ends = [Fraction(7) + Fraction(wide) * Fraction(k + end, 4) for end in (0, 1)]
        q = ends[0] + (ends[1] - ends[0]) * share
        for moved in {0: (q - beyond, q), 1: (q, q + beyond)}.get(share, (q,)):
            planted(monkeypatch, moved)
            empty = prove(claim).found["empty"]
            for j, leaf in enumerate(leaves):
                low, high = (Fraction(7) + Fraction(wide) * Fraction(j + end, 4) for end in (0, 1))
                if low - beyond <= moved <= high + beyond:
                    assert not empty[leaf]
                if not low - widest <= moved <= high + widest:
                    assert empty[leaf]
            others = np.setdiff1d(np.arange(len(child)), leaves)
            assert not empty[others].any()


def test_candidates_hold_their_cells_and_a_little_more(monkeypatch):
    """To the last bit: those over every cell, 1e-12 and roundings beyond it each way."""
    for lower, upper in ((-0.7, 0.6), (1e6 + 0.1, 1e6 + 0.3), (1e9, 1e9 + 1e-3)):
        seen = planted(monkeypatch, Fraction(lower))
        monkeypatch.setattr(module, "_DEEPER", 0)
        claim = excluded(lower=(lower,), upper=(upper,), **QUARTERS)
        tree, size = tree_of(claim.cut, claim.child, 1), Fraction(upper) - Fraction(lower)
        prove(claim)
        assert {cell for cell, _ in seen} >= {0, 1, 3}
        for cell, (low, high) in seen:
            first = Fraction(lower) + size * Fraction(int(tree.lower[cell, 0]), WHOLE)
            last = first + size * Fraction(int(tree.size[cell, 0]), WHOLE)
            for room in (first - low, high - last):
                assert Fraction(1e-12) <= room <= Fraction(1e-12) + 10 * Fraction(U) * abs(last) + Fraction(2e-14)


def test_a_leaf_is_halved_a_few_times_more(monkeypatch):
    """Where candidates over so small parts of it are seen to be empty, it is; where smaller ones are due, not."""
    for deeper in (1, 3):
        monkeypatch.setattr(module, "_DEEPER", deeper)
        for share, empty in ((1.1, True), (0.9, False)):
            planted(monkeypatch, Fraction(-9), narrowest=share * 0.25 * 2.0**-deeper)
            assert empty_of(excluded()) == [False, empty, empty]


@pytest.mark.parametrize(
    ("kept", "cells"), [((3, 4), [0, 2, 5, 6]), ((3, 5, 6), [0, 1, 4]), ((3, 4, 5, 6), []), ((), [*range(7)])]
)
def test_cells_are_looked_at_down_to_the_last_that_is_asked(monkeypatch, kept, cells):
    """None over which all leaves are kept; where one is not, it is for all that the others are."""
    seen = planted(monkeypatch, Fraction(9), narrowest=1e-9)
    monkeypatch.setattr(module, "_DEEPER", 0)
    assert not prove(excluded(**QUARTERS, kept=kept)).found["empty"].any()
    assert sorted(cell for cell, _ in seen) == cells


def test_so_many_candidates_are_tried(monkeypatch):
    """One over [0, 1] and one over each half: three are looked at where fewer than four may be."""
    planted(monkeypatch, Fraction(9), narrowest=1e-9)
    for most, proved in ((4, True), (3, False)):
        monkeypatch.setattr(module, "_MOST", most)
        if proved:
            assert empty_of(excluded()) == [False] * 3
        else:
            with pytest.raises(NotProvedError, match="more candidates"):
                prove(excluded())


def test_candidates_are_halved_while_that_is_due(monkeypatch):
    """And narrowed after."""
    asked = []
    monkeypatch.setattr(module, "narrowed_both", lambda problem, ranges, waiting, singular: waiting)

    def to_halve(problem, waiting):
        asked.append(len(waiting.cell))
        return np.ones(len(waiting.cell), dtype=int), waiting.half[:, 1] > 0.3

    monkeypatch.setattr(module, "to_halve", to_halve)
    box = Candidates(np.zeros(1, dtype=int), np.zeros((1, 2)), np.ones((1, 2)), np.zeros((1, 1, 1)))
    found = module._settled(problem_by_hand(LINE), None, box, True)
    assert asked == [1, 2, 4]
    np.testing.assert_allclose(np.sort(found.centre[:, 1]), [-0.75, -0.25, 0.25, 0.75])
    monkeypatch.setattr(module, "ROUNDS", 2)
    assert len(module._settled(problem_by_hand(LINE), None, box, True).cell) == 4


def test_where_an_interrupt_was_asked_for_nothing_is_proved():
    """Nor are candidates narrowed."""
    with stoppable() as flag:
        flag.set()
        with pytest.raises(Stopped):
            prove(excluded())


def asked_by_hand(cell, child, kept):
    """The cells of a tree below one that have a leaf that is not kept."""
    if child[cell] < 0:
        return set() if kept[cell] else {cell}
    below = asked_by_hand(child[cell], child, kept) | asked_by_hand(child[cell] + 1, child, kept)
    return below | {cell} if below else below


def test_which_cells_hold_some_leaves():
    """Trees with their numbers shuffled, and cells that nobody reaches which call others their children."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        pairs = rng.permutation(12)
        child, leaves, count = np.full(25, -1), [0], int(rng.integers(9))
        for pair in pairs[:count]:
            cell = leaves.pop(int(rng.integers(len(leaves))))
            child[cell] = 1 + 2 * pair
            leaves += [1 + 2 * pair, 2 + 2 * pair]
        for pair in pairs[count:]:
            child[1 + 2 * pair] = int(rng.integers(-1, 24))
        reached = tree_of(np.zeros(25, dtype=int), child, 1).reached
        kept = rng.random(25) < rng.choice([0.3, 0.9])
        assert set(np.flatnonzero(module.holding(reached, child, ~kept))) == asked_by_hand(0, child, kept)


# Candidates over their cells


def test_a_band_is_the_same_from_wherever_it_is_measured():
    """What candidates hold over a cell and 1e-12 beside it, they hold from its middle, to the last bit."""
    rng = np.random.default_rng(8)
    problem, region = made_up(), CellRegion(np.array([-1.0, 2.0]), np.array([2.0, 2.5]), np.zeros(2, dtype=bool))
    for steep in (1.0, 30.0, 1e6):
        for _ in range(40):
            low, size = rng.integers(0, WHOLE // 2, (1, 2)), rng.integers(1, WHOLE // 2, (1, 2))
            tree = HalvedTree(low, size, np.ones(1, dtype=bool))
            slopes, half = steep * rng.uniform(-1, 1, (1, 2, 2)), rng.uniform(1e-3, 2e-3, (1, 4))
            box = Candidates(np.zeros(1, dtype=int), rng.uniform(-3, 3, (1, 4)), half, slopes)
            found = over_cells(problem, region, tree, box)
            for ends, sides in product(product((0, 1), repeat=2), product((-1, 1), repeat=2)):
                q = [
                    Fraction(a)
                    + (Fraction(b) - Fraction(a)) * Fraction(int(c + e * s), WHOLE)
                    + (2 * e - 1) * Fraction(1e-12)
                    for a, b, c, e, s in zip(region.lower, region.upper, low[0], ends, size[0], strict=True)
                ]
                y = [band(box, i, q) + side * Fraction(half[0, 2 * i]) for i, side in zip((0, 1), sides, strict=True)]
                assert all(abs(y[i] - band(found, i, q)) <= Fraction(found.half[0, 2 * i]) for i in (0, 1))
                assert all(
                    abs(q[j] - Fraction(found.centre[0, 1 + 2 * j])) <= Fraction(found.half[0, 1 + 2 * j])
                    for j in (0, 1)
                )


def band(box, i, q):
    """The middle of the i-th dependent coordinate over q, exactly; those are 0 and 2, q 1 and 3."""
    moved = [q[j] - Fraction(box.centre[0, 1 + 2 * j]) for j in (0, 1)]
    return Fraction(box.centre[0, 2 * i]) + sum(Fraction(box.slopes[0, i, j]) * moved[j] for j in (0, 1))


def test_a_band_is_wider_by_roundings_only():
    """4u (1 + |y|), and 4u (1 + |moved|) three times over for what slopes do to two coordinates; cells by 1e-12."""
    region = CellRegion(np.array([-9.0, 1.5]), np.array([-1.0, 1.5]), np.zeros(2, dtype=bool))
    tree = HalvedTree(
        whole_numbers(WHOLE // 2, 0)[None], whole_numbers(WHOLE // 4, WHOLE)[None], np.ones(1, dtype=bool)
    )
    slopes = np.array([[[-1000.0, 5.0], [0.0, 0.0]]])
    box = Candidates(np.zeros(1, dtype=int), np.array([[2.0, 3.0, 5.0, 1.5]]), np.array([[0.0, 9.0, 0.0, 9.0]]), slopes)
    found = over_cells(made_up(), region, tree, box)
    np.testing.assert_array_equal(found.centre, [[2.0 + 7000.0, -4.0, 5.0, 1.5]])
    y, slope = 4 * U * (1 + 7002.0), 3 * 4 * U * (1000 * (1 + 7.0) + 5.0)
    np.testing.assert_allclose(found.half[0, [0, 2]], [y + slope, 4 * U * 6.0], rtol=1e-9)
    assert found.half[0, 1] - 1.0 == pytest.approx(1e-12 + 1e-14 + 4 * U * 5.0, rel=1e-3)
    assert found.half[0, 3] == 0.0
    assert (found.slopes is slopes, found.cell.tolist()) == (True, [0])
