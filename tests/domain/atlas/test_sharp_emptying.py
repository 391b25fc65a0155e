"""Cells called empty are those proved to be so, whole, and no others; a search's end leaves the rest unreached."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.cells import CellStatus, CellTree, place
from ccpin.covering.region import Region
from ccpin.domain.atlas import emptying as module
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges

CERTIFIED, UNDECIDED, UNREACHED, EMPTY, SPLIT = (
    CellStatus.CERTIFIED, CellStatus.UNDECIDED, CellStatus.UNREACHED, CellStatus.EMPTY, CellStatus.SPLIT
)  # fmt: skip
LINE = Region(np.array([0.0]), np.array([16.0]), np.array([False]))
SYSTEM = SimpleNamespace(
    n=1, m=1, n_free=2, independent=np.array([0]), dependent=np.array([1]), periodic=np.zeros(2, bool)
)
PROBLEM = SimpleNamespace(system=SYSTEM)


def tree_of(*leaves):
    """[0, 16] in cells of the lengths and statuses given, made by halving."""
    tree, ends = CellTree.whole(1), np.cumsum([0, *(length for length, _ in leaves)])
    while True:
        cells = tree.leaves()
        centre, half = place(tree, LINE, cells)
        inner = [np.any((ends > c - h) & (ends < c + h)) for c, h in zip(centre[:, 0], half[:, 0], strict=True)]
        if not any(inner):
            break
        tree.split(cells[inner], np.zeros(sum(inner), dtype=int))
    for cell in tree.leaves():
        tree.status[cell] = leaves[int(np.searchsorted(ends, place(tree, LINE, np.array([cell]))[0][0, 0]) - 1)][1]
    return tree


def told(tree):
    """Statuses of the sixteen units of the line."""
    cells = tree.locate(LINE.cell_coordinates(np.arange(0.5, 16.0)[:, None]))
    return tree.status[cells].tolist()


def proved_empty(monkeypatch, tree, low, high, depth, chain=True, platform=None, chunk=20_000):
    """Cells in [low, high] are shown to be empty by chains, those in another interval by the platform."""

    def within(ends, centre, half):
        return ((centre - half >= ends[0]) & (centre + half <= ends[1]))[:, 0]

    monkeypatch.setattr(module, "groups_of", lambda system: ["chains"] if chain else [])
    monkeypatch.setattr(module, "platform_of", lambda system: platform)
    monkeypatch.setattr(module, "empty_cells", lambda system, groups, c, h: within((low, high), c, h) & chain)
    monkeypatch.setattr(module, "platform_empty", lambda system, platform, c, h: (within(platform, c, h), None))
    monkeypatch.setattr(module, "_CHUNK", chunk)
    checks = []
    runner = SimpleNamespace(problem=PROBLEM, check=lambda: checks.append(1))
    module.prove_empty(runner, tree, LINE, depth, thorough=platform is not None)
    return told(tree), checks


@pytest.mark.parametrize("chunk", [1, 2, 3, 100])
def test_cells_are_empty_where_that_is_proved(monkeypatch, chunk):
    """Unreached ones are halved as often as told, others are tried as they are, certified ones never."""
    tree = tree_of((4, UNREACHED), (2, CERTIFIED), (2, UNDECIDED), (4, UNDECIDED), (4, UNREACHED))
    found, _ = proved_empty(monkeypatch, tree, 1.0, 14.0, 4, chunk=chunk)
    assert found == [UNREACHED, *3 * [EMPTY], *2 * [CERTIFIED], *8 * [EMPTY], *2 * [UNREACHED]]
    tree = tree_of((4, UNREACHED), (2, CERTIFIED), (2, UNDECIDED), (4, UNDECIDED), (4, UNREACHED))
    found, _ = proved_empty(monkeypatch, tree, 1.0, 11.0, 3, chunk=chunk)
    assert found == [*2 * [UNREACHED], *2 * [EMPTY], *2 * [CERTIFIED], *2 * [EMPTY], *4 * [UNDECIDED], *4 * [UNREACHED]]
    assert len(tree.leaves(UNREACHED)) == 1 + 2


@pytest.mark.parametrize("chunk", [1, 2, 3, 100])
@pytest.mark.parametrize("chain", [True, False])
def test_a_platform_proves_more(monkeypatch, chunk, chain):
    tree = tree_of((8, UNREACHED), (8, UNDECIDED))
    found, checks = proved_empty(monkeypatch, tree, 1.0, 3.0, 4, chain, (5.0, 7.0), chunk)
    chains = EMPTY if chain else UNREACHED
    assert found == [UNREACHED, *2 * [chains], *2 * [UNREACHED], *2 * [EMPTY], UNREACHED, *8 * [UNDECIDED]]
    assert checks
    plain = tree_of((8, UNREACHED), (8, UNDECIDED))
    found, checks = proved_empty(monkeypatch, plain, 0.0, 16.0, 4, False)
    assert (set(found), checks) == ({UNREACHED, UNDECIDED}, [])


def test_halves_are_along_the_longest_edge_and_none_that_is_held(monkeypatch):
    """Down to the depth told, by the longest edge that is not held."""
    region = Region(np.array([0.0, 0.0, 5.0]), np.array([8.0, 1.0, 5.0]), np.zeros(3, dtype=bool))
    tree = CellTree.whole(3)
    monkeypatch.setattr(module, "groups_of", lambda system: ["chains"])
    monkeypatch.setattr(module, "platform_of", lambda system: None)
    monkeypatch.setattr(
        module, "empty_cells", lambda system, groups, c, h: (c[:, 0] + h[:, 0] <= 1.0) & (h[:, 0] <= 0.5)
    )
    runner = SimpleNamespace(problem=PROBLEM, check=lambda: None)
    module.prove_empty(runner, tree, region, 3)
    leaves = tree.leaves(EMPTY)
    assert len(leaves) == 1
    np.testing.assert_array_equal(place(tree, region, leaves)[1], [[0.5, 0.5, 0.0]])
    assert np.all(tree.size[tree.leaves(), 2] == tree.size[0, 2])


# By search


class Searching:
    """A search that drops candidates over cells without one of some points, for so many rounds."""

    def __init__(self, points, rounds=1000):
        self.points, self.rounds, self.over, self.asked = np.array(points), rounds, False, []

    def settled(self, waiting, rounds):
        self.rounds -= 1
        self.over = self.rounds < 0
        if self.over:
            return waiting
        self.asked.append(waiting)
        low, high = waiting.centre[:, :1] - waiting.half[:, :1], waiting.centre[:, :1] + waiting.half[:, :1]
        kept = np.any((low <= self.points) & (self.points <= high), axis=1)
        return Candidates(*(column[kept] for column in waiting))


def over_all(problem, ranges, lower, upper):
    """All of the region, and one dependent coordinate."""
    centre, half = np.append(0.5 * (lower + upper), 0.0), np.append(0.5 * (upper - lower), 0.0)
    return Candidates(np.zeros(1, dtype=np.intp), centre[None], half[None], np.zeros((1, 1, len(lower))))


def searched(monkeypatch, tree, points, depth=4, rounds=1000, ranges="ranges", m=1):
    """What is called empty where closed configurations are over some points only."""
    search = Searching(points, rounds)
    system = SimpleNamespace(**{**vars(SYSTEM), "m": m})
    reading = SimpleNamespace(problem=SimpleNamespace(system=system))
    monkeypatch.setattr(module, "all_values", lambda *_: ranges)
    monkeypatch.setattr(module, "Pruning", lambda *_: search)
    monkeypatch.setattr(module, "_unsettled", lambda problem, waiting: waiting)

    monkeypatch.setattr(module, "over_all", over_all)
    runner = SimpleNamespace(check=lambda: None, problem=reading.problem)
    module.search_empty(runner, reading, tree, LINE, depth)
    return told(tree), search


@pytest.mark.parametrize("points", [[], [0.5], [4.5, 11.5], [8.5, 9.5, 10.5, 3.5]])
@pytest.mark.parametrize(
    "leaves",
    [
        [(16, UNREACHED)],
        [(8, UNREACHED), (8, CERTIFIED)],
        [(4, CERTIFIED), (4, UNREACHED), (4, UNDECIDED), (4, UNREACHED)],
        [(2, UNREACHED), (2, CERTIFIED), (5, UNREACHED), (1, UNDECIDED), (2, UNREACHED), (4, CERTIFIED)],
    ],
    ids=["whole", "half", "quarters", "many"],
)  # fmt: skip
def test_unreached_cells_without_configurations_are_empty(monkeypatch, points, leaves):
    """All of them, to a unit, whatever others are beside them; certified and undecided ones stay what they are."""
    before = told(tree_of(*leaves))
    found, _ = searched(monkeypatch, tree_of(*leaves), points)
    held = {int(point) for point in points}
    expected = [EMPTY if status == UNREACHED and k not in held else status for k, status in enumerate(before)]
    assert found == expected


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_cells_are_halved_as_often_as_told(monkeypatch, depth):
    tree = tree_of((16, UNREACHED))
    found, _ = searched(monkeypatch, tree, [0.5], depth)
    size = 16 >> depth
    assert found == [*size * [UNREACHED], *(16 - size) * [EMPTY]]
    assert len(tree.leaves()) == depth + 1


@pytest.mark.parametrize("depth", [1, 2])
@pytest.mark.parametrize("width", [1.0, 100.0, 0.0])
def test_cells_are_as_small_as_told_in_every_coordinate(monkeypatch, depth, width):
    """The longest edge that may be is halved first, none more often; of a coordinate that is held none is."""
    region = Region(np.array([0.0, 0.0]), np.array([16.0, width]), np.zeros(2, dtype=bool))
    tree, search = CellTree.whole(2), Searching([0.5], rounds=20)
    system = SimpleNamespace(
        n=2, m=1, n_free=3, independent=np.array([0, 1]), dependent=np.array([2]), periodic=np.zeros(3, bool)
    )
    monkeypatch.setattr(module, "all_values", lambda *_: "ranges")
    monkeypatch.setattr(module, "Pruning", lambda *_: search)
    monkeypatch.setattr(module, "_unsettled", lambda problem, waiting: waiting)

    monkeypatch.setattr(module, "over_all", over_all)
    reading = SimpleNamespace(problem=SimpleNamespace(system=system))
    module.search_empty(SimpleNamespace(check=lambda: None, problem=reading.problem), reading, tree, region, depth)
    assert not search.over
    left, edges = tree.leaves(UNREACHED), tree.size[0] >> np.array([depth, depth if width else 0])
    np.testing.assert_array_equal(tree.size[left], np.tile(edges, (len(left), 1)))
    assert len(left) == (2**depth if width else 1)
    assert tree.cut[0] == int(width > 16.0)


@pytest.mark.parametrize("rounds", [0, 1, 2, 3])
def test_what_a_search_had_no_time_for_stays_unreached(monkeypatch, rounds):
    """What it has shown by then is empty."""
    found, _ = searched(monkeypatch, tree_of((16, UNREACHED)), [0.5], rounds=rounds)
    assert found[0] == UNREACHED
    size = 16 if rounds < 2 else 16 >> (rounds - 1)
    assert found == [*size * [UNREACHED], *(16 - size) * [EMPTY]]


@pytest.mark.parametrize(
    ("more", "tried"), [({}, True), ({"ranges": None}, False), ({"m": 8}, True), ({"m": 9}, False)]
)
def test_what_is_not_searched(monkeypatch, more, tried):
    """Without ranges, with more than eight dependent coordinates, or where nearly nothing is unreached."""
    found, search = searched(monkeypatch, tree_of((8, UNREACHED), (8, CERTIFIED)), [20.0], **more)
    assert bool(search.asked) == tried
    assert found[:8] == 8 * [EMPTY if tried else UNREACHED]
    little = CellTree.whole(1)
    for _ in range(14):
        little.split(little.leaves()[-1:], np.zeros(1, dtype=int))
    for powers, known in (((9,), True), ((10, 14), True), ((10,), False), ((11, 12), False)):
        leaves = little.leaves()
        little.status[leaves] = CERTIFIED
        little.status[[leaves[np.argmin(np.abs(little.shares(leaves) - 2.0**-k))] for k in powers]] = UNREACHED
        assert bool(searched(monkeypatch, little, [20.0])[1].asked) == known


def test_which_cells_hold_an_unreached_leaf():
    tree = tree_of((8, CERTIFIED), (4, UNREACHED), (2, UNREACHED), (2, UNDECIDED))
    open_cells = module.holding(np.ones(len(tree.child), bool), tree.child, tree.status == UNREACHED)
    for cell in range(len(tree.child)):
        centre, half = place(tree, LINE, np.array([cell]))
        inside = [k for k in range(16) if abs(k + 0.5 - centre[0, 0]) < half[0, 0]]
        assert open_cells[cell] == any(told(tree)[k] == UNREACHED for k in inside)


def test_all_unreached_leaves_of_a_cell_are_marked():
    tree = tree_of((4, CERTIFIED), (2, UNREACHED), (1, UNDECIDED), (1, UNREACHED), (8, UNREACHED))
    module._mark(tree, tree.child[[0]])
    assert told(tree) == [*4 * [CERTIFIED], EMPTY, EMPTY, UNDECIDED, EMPTY, *8 * [UNREACHED]]
    module._mark(tree, np.zeros(1, dtype=int))
    assert told(tree)[8:] == 8 * [EMPTY]


# What is proved of them.


@pytest.mark.parametrize(("by_legs", "by_search"), [((0, 1, 2, 3), ()), ((1,), (0, 3)), ((), (2,)), ((), None)])
def test_what_is_not_proved_to_be_empty_is_undecided(monkeypatch, by_legs, by_search):
    """By closed forms first, what they leave by a search of all values where there is one; the rest is undecided."""
    tree = tree_of((4, EMPTY), (4, CERTIFIED), (4, EMPTY), (2, EMPTY), (2, EMPTY))
    cells, claims = tree.leaves(EMPTY), []

    def prove(claim):
        claims.append(claim)
        mask = np.zeros(len(tree.child), dtype=bool)
        mask[cells[list(by_legs if len(claims) == 1 else by_search)]] = True
        return SimpleNamespace(found={"empty": mask})

    ranges = Ranges(np.array([-1.0]), np.array([4.0]), None, "limits")
    monkeypatch.setattr(module, "all_values", lambda *_: None if by_search is None else ranges)
    monkeypatch.setattr(module, "closures_of", lambda problem: problem)
    monkeypatch.setattr(module, "_weights", lambda system, centre, half: np.column_stack([centre, half]))
    monkeypatch.setattr(module, "Unreachable", lambda equations, **data: data)
    monkeypatch.setattr(module, "Excluded", lambda equations, **data: data)
    monkeypatch.setattr(module, "prove", prove)
    facts = module.empty_facts(SimpleNamespace(problem=PROBLEM), LINE, tree)
    proved = {*by_legs, *(by_search or ())}
    assert [tree.status[cell] == EMPTY for cell in cells] == [k in proved for k in range(4)]
    assert set(tree.status[cells]) <= {EMPTY, UNDECIDED}
    np.testing.assert_array_equal(claims[0]["cell"], cells)
    np.testing.assert_array_equal(claims[0]["weights"], np.column_stack(place(tree, LINE, cells)))
    assert len(facts) == len(claims) == 1 + (len(by_legs) < 4 and by_search is not None)
    if len(claims) > 1:
        left = [cell for k, cell in enumerate(cells) if k not in by_legs]
        assert np.flatnonzero(~claims[1]["kept"]).tolist() == left
        assert (claims[1]["limits"], claims[1]["middle"].tolist(), claims[1]["singular"].tolist()) == (
            "limits", [1.5], [False],
        )  # fmt: skip


def test_without_empty_cells_nothing_is_to_be_proved():
    assert module.empty_facts(SimpleNamespace(problem=PROBLEM), LINE, tree_of((16, UNDECIDED))) == ()
