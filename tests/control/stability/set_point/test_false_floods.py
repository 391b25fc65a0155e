"""Floods and stores of cells that go wrong: what they find is checked, and no level is proven that is not true.

The oracle is U along the model's own σ: on the square about the goal a level is at most U's least value on its edge,
and where gains are small at most U wherever ‖∂g/∂q‖ reaches them.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import ccpin
from ccpin.arrays import joined
from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point import certified_cells, flood
from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.control.stability.set_point.flood import Flood
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.domain import certify
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_V

HALF = 0.2
STIFF, SOFT = np.array([20.0, 20.0]), np.array([8.0, 8.0])


@pytest.fixture(scope="module")
def square(model):
    """Boxes over a square about the goal."""
    return certify(model.mechanism, GOAL, (GOAL - HALF, GOAL + HALF), max_depth=5)


@pytest.fixture(scope="module")
def law(model):
    """Gains well above ∂g/∂q on the square."""
    return PDSimpleGravity(model, GOAL, STIFF, K_V)


@pytest.fixture(scope="module")
def soft(model):
    """Gains that ‖∂g/∂q‖ reaches not far from the goal."""
    return PDSimpleGravity(model, GOAL, SOFT, K_V)


def at_rest(law, points):
    """U at points."""
    return np.array([law.lyapunov(q, np.zeros(2), law.q_free_d) for q in points])


@pytest.fixture(scope="module")
def edge(law):
    """The least U on the square's edge."""
    side = np.linspace(-HALF, HALF, 81)
    return at_rest(law, [GOAL + place for s in (-HALF, HALF) for t in side for place in ((s, t), (t, s))]).min()


@pytest.fixture(scope="module")
def steep(soft):
    """The least U where ‖∂g/∂q‖ is not below the gains, on a grid."""
    axis = np.linspace(-1.0, 1.0, 41)
    points = [GOAL + np.array([x, y]) for x in axis for y in axis]
    points = [q for q in points if 0.05 < oracle.elongation(q) < 0.98]
    slopes = [np.linalg.norm(soft.model.gravity_derivative(q, soft.q_free_d), 2) for q in points]
    return at_rest(soft, [q for q, slope in zip(points, slopes, strict=True) if slope >= SOFT[0]]).min()


def proven(certificate):
    """The level, where one is said to be proven."""
    return certificate.level if certificate.verdict == "proven" else 0.0


around = partial(certify_law, max_depth=8, budget=120)


def test_levels_of_honest_floods_are_near_the_truth(law, soft, square, edge, steep):
    assert 0.9 * edge < proven(certify_law(law, square)) <= edge
    assert 0.5 * steep < proven(around(soft)) <= steep


@pytest.mark.parametrize("axis", [0, 1])
def test_faces_left_out_of_the_boundary(law, square, edge, monkeypatch, axis):
    """Of the faces at the edge those across one axis are not told."""
    honest = CellStore.exposed
    monkeypatch.setattr(CellStore, "exposed", lambda *own: [f for f in honest(*own) if f.lower[axis] != f.upper[axis]])
    assert proven(certify_law(law, square)) <= edge


def test_a_boundary_that_is_empty(law, square, edge, monkeypatch):
    monkeypatch.setattr(Flood, "_flood", lambda self, q_d: (setattr(self, "_level", 9.0), ("domain", q_d))[1])
    assert proven(certify_law(law, square)) <= edge


def test_cells_of_another_branch_among_the_neighbours(soft, monkeypatch):
    """Beyond a line what is proved are another assembly mode's boxes, and the search takes them for this one's."""
    honest, lines, swapped = certified_cells.prove, [], []

    def mixed(problem, cells):
        found = honest(problem, cells)
        beyond = cells.centre[:, 0] - cells.half[:, 0] >= GOAL[0] + 0.05
        lines.extend((cells.centre - cells.half)[beyond, 0])
        theta = np.array([oracle.sigma(q, -1)[[0, 2, 1, 3]] for q in cells.centre])
        other = certify_boxes(problem, theta, cells.half, np.eye(2))
        swapped.extend(np.flatnonzero(other.proved & beyond))
        chosen = [(other if far else found).boxes.take(np.array([k])) for k, far in enumerate(beyond)]
        return found._replace(boxes=joined(chosen), proved=np.where(beyond, other.proved, found.proved))

    monkeypatch.setattr(certified_cells, "prove", mixed)
    monkeypatch.setattr(certified_cells, "glued", lambda problem, first, *_: np.ones(len(first.kappa), dtype=bool))
    found = around(soft)
    assert swapped
    assert (
        proven(found) <= at_rest(soft, [[min(lines), y] for y in np.linspace(GOAL[1] - 0.5, GOAL[1] + 0.5, 81)]).min()
    )


def test_members_that_are_taken_to_agree(soft, steep, monkeypatch):
    """Nothing is ever glued."""
    monkeypatch.setattr(CellStore, "agree", lambda self, number, others: [True] * len(others))
    monkeypatch.setattr(certified_cells, "glued", lambda problem, first, *_: np.ones(len(first.kappa), dtype=bool))
    assert proven(around(soft)) <= steep


@pytest.mark.parametrize("change", [{"value": 1.0}, {"remainder": -1.0}])
def test_wells_that_are_too_high(law, square, edge, monkeypatch, change):
    """Bounds of U are raised on their way to the flood."""
    honest = certified_cells.wells

    def raised(*given):
        more = [{name: getattr(w, name) + by for name, by in change.items()} for w in honest(*given)]
        return [w._replace(**m) for w, m in zip(honest(*given), more, strict=True)]

    monkeypatch.setattr(certified_cells, "wells", raised)
    assert proven(certify_law(law, square)) <= edge


@pytest.mark.parametrize("wrong", [{"beta": 0.0}, {"beta": -1.0}])
def test_slopes_that_are_too_small(soft, steep, monkeypatch, wrong):
    """The gain condition is said to hold everywhere."""
    honest = certified_cells.wells
    monkeypatch.setattr(certified_cells, "wells", lambda *given: [w._replace(**wrong) for w in honest(*given)])
    assert proven(around(soft)) <= steep


def test_motors_that_lose_their_grip(monkeypatch):
    """Their effort is said to be positive everywhere: members have it where it is computed again."""
    mechanism = ccpin.load("rpdr", independent=["joint1", "joint2"], actuated=["joint1", "joint3"])
    law = PDSimpleGravity(ccpin.ReducedModel(mechanism), GOAL, [60.0, 60.0], K_V)
    honest = certified_cells.wells
    monkeypatch.setattr(certified_cells, "wells", lambda *given: [w._replace(effort=1.0) for w in honest(*given)])
    found = certify_law(law, max_depth=7, budget=150)
    rng = np.random.default_rng(3)
    for lower, upper in zip(*found.cells, strict=True):
        for q in rng.uniform(lower, upper, (2, 2)):
            if found.verdict == "proven" and found.contains(q):
                state = law.model.at(q, law.near)
                assert np.linalg.det(state.reference.transmission) * np.linalg.det(law.near.reference.transmission) > 0


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_boxes_that_are_not_proved(soft, steep, monkeypatch, share):
    """Tubes narrower than what was proved."""
    honest = certified_cells.prove

    def narrowed(*given):
        found = honest(*given)
        return found._replace(boxes=found.boxes._replace(radius=share * found.boxes.radius))

    monkeypatch.setattr(certified_cells, "prove", narrowed)
    assert proven(around(soft)) <= steep


def test_boxes_wider_than_was_proved(law, square, edge, monkeypatch):
    """An atlas's cells are said to reach further than their boxes."""
    honest = CellStore.add_proved

    def wider(self, boxes, lower, upper, touching):
        middle = 0.5 * (lower + upper)
        honest(self, boxes, GOAL + 2.0 * (lower - GOAL), GOAL + 2.0 * (upper - GOAL), touching)
        assert len(middle)

    monkeypatch.setattr(CellStore, "add_proved", wider)
    assert proven(certify_law(law, square)) <= edge


@pytest.mark.parametrize("told", [{"level": 9.0}, {"beta": 0.0}])
def test_numbers_changed_by_hand(law, square, edge, told):
    """A certificate with another level or β is not proven."""
    found = certify_law(law, square)
    changed = replace(found, **told)
    assert changed.verdict != "proven"
    assert "level" not in told or proven(changed) <= edge


@pytest.mark.parametrize("change", [{"level": 9.0}])
def test_numbers_changed_on_the_way(law, square, edge, monkeypatch, change):
    """What the flood returns is another level."""
    honest = Flood.run
    monkeypatch.setattr(Flood, "run", lambda self, q_d: honest(self, q_d)._replace(**change))
    found = certify_law(law, square)
    slopes = [np.linalg.norm(law.model.gravity_derivative(q, law.q_free_d), 2) for q in (GOAL, GOAL + 0.1)]
    assert proven(found) <= edge
    assert found.verdict != "proven" or found.beta >= max(slopes)


@pytest.mark.parametrize("kept", ["around q_d alone", "all but those around q_d", "every other", "none"])
def test_members_left_out(law, square, edge, monkeypatch, kept):
    """The level is that of the members that are told, as far as q_d's own reach."""
    honest = Flood.run

    def some(self, q_d):
        found = honest(self, q_d)
        holds = [k for k in found.members if flood._holds(self._store[k], q_d)]
        left = {
            "around q_d alone": tuple(holds),
            "all but those around q_d": tuple(k for k in found.members if k not in holds),
            "every other": found.members[::2],
            "none": (),
        }[kept]
        told.extend(left)
        stores.append(self._store)
        return found._replace(members=left)

    told, stores = [], []
    monkeypatch.setattr(Flood, "run", some)
    found = certify_law(law, square)
    cells = [stores[0][k] for k in told]
    if kept != "around q_d alone":
        assert proven(found) <= (edge if kept == "every other" else 0.0)
    for cell in cells:  # the corners of what is left are on its boundary but for q_d
        corners = [q for q in (cell.lower, cell.upper) if np.abs(q - GOAL).max() > 1e-9]
        if kept == "around q_d alone":
            assert proven(found) <= at_rest(law, corners).max()


def test_states_of_other_components(law, square, monkeypatch):
    """Whatever cells the search joins, a state is in B₂ only below the level, in the square."""
    found = certify_law(law, square)
    for q in np.random.default_rng(0).uniform(GOAL - 1.5 * HALF, GOAL + 1.5 * HALF, (60, 2)):
        if found.contains(q):
            assert np.all(np.abs(q - GOAL) <= HALF)
            assert at_rest(law, [q])[0] < found.level
