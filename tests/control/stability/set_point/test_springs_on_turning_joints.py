"""Theorem 3 where springs act on turning joints: V is a function on the line, whatever turns an atlas is glued with."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import PDSimpleGravity, suggest_gains
from ccpin.control.stability.set_point.starting_cells import cells_of_atlas
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.covering.claims import proved_boxes
from ccpin.domain import certify
from ccpin.errors import UnattainableGainsError
from tests.support.long_cases import later
from tests.support.paper import GOAL, K_P, K_V

TURN = 2.0 * np.pi
STIFFNESS, REST = {"joint3": 2.0, "joint4": 1.0}, {"joint3": 0.4, "joint4": -0.7}
WIDTH = np.radians(20.0)
_JOINTS = {name: {"stiffness": STIFFNESS[name], "spring_reference": REST[name]} for name in STIFFNESS}


@pytest.fixture(scope="module")
def model():
    """The RPDR with springs on its passive elbows."""
    return ccpin.ReducedModel(ccpin.load("rpdr", joints=_JOINTS))


@pytest.fixture(scope="module")
def law(model):
    """PD at the paper's goal."""
    return PDSimpleGravity(model, GOAL, 3.0 * np.asarray(K_P), K_V)


def _atlas(model, law, turns=0, names=("joint3",)):
    """A square about the goal, from a configuration with passive joints turned on by whole turns."""
    start = law.q_free_d.copy()
    start[[model.mechanism.tree.joint(name).q.start for name in names]] += TURN * turns
    return certify(model.mechanism, GOAL, (GOAL - WIDTH, GOAL + WIDTH), near=start, max_depth=6)


def _well(law, q):
    """U from the model's own energy, the springs on the line from the law's configuration on."""
    state, error = law.model.at(q, law.q_free_d), law.q_d - q
    potential = state.energy(np.zeros(2)).potential - law.near.energy(np.zeros(2)).potential
    return potential + error @ law.gravity_d + 0.5 * error @ law.K_p @ error


def _least_on_the_edge(law):
    side = np.linspace(-WIDTH, WIDTH, 31)
    edge = [np.array(place) for s in (-WIDTH, WIDTH) for t in side for place in ((s, t), (t, s))]
    return min(_well(law, GOAL + place) for place in edge)


@pytest.mark.parametrize("turns", [-1, *later(2, 0, 1)])
def test_an_atlas_wound_otherwise_proves_the_laws_level(model, law, turns):
    """The level is below the least U on the atlas's edge, U with the springs as the law's configuration stretches."""
    certificate = certify_law(law, _atlas(model, law, turns), max_depth=10, budget=600)
    assert certificate.verdict == "proven"
    assert 0.9 * _least_on_the_edge(law) < certificate.level <= _least_on_the_edge(law)


def test_motions_from_just_below_the_level_arrive(model, law):
    """From rest at 0.9 to 0.99 of a level proved over an atlas one turn on motions converge and stay on σ."""
    certificate = certify_law(law, _atlas(model, law, 1), max_depth=10, budget=600)
    rng, starts = np.random.default_rng(11), []
    while len(starts) < 6:
        q = GOAL + rng.uniform(-WIDTH, WIDTH, 2)
        if 0.9 * certificate.level < _well(law, q) < 0.99 * certificate.level:
            assert certificate.contains(q)
            starts.append(q)
    for q in starts:
        motion = ccpin.simulate(model, law, q, near=law.q_free_d, duration=1.5, sample_period=0.05)
        np.testing.assert_allclose(motion.q[-1], GOAL, atol=1e-3)
        assert np.all(np.abs(motion.q - GOAL) <= WIDTH)


def test_boxes_with_turns_of_their_own(model, law):
    """An atlas's boxes turned by hand, each by turns of its own, prove what the atlas proves: all are turned back."""
    atlas, rng = _atlas(model, law), np.random.default_rng(5)
    turned = atlas.boxes.centre.copy()
    dependent = atlas.problem.system.dependent
    turned[:, dependent] += TURN * rng.integers(-2, 3, (len(turned), 2))
    solutions, proved = proved_boxes(atlas.problem, atlas.boxes._replace(centre=turned))
    assert proved.all()
    other = replace(atlas, solutions=(solutions,), proved=None)
    store, same = cells_of_atlas(law, other), cells_of_atlas(law, atlas)
    assert store.whole
    assert same.whole
    for cell, expected in zip(store.cells, same.cells, strict=True):
        np.testing.assert_allclose(cell.box.centre, expected.box.centre, atol=1e-12)
        assert cell.neighbours == expected.neighbours
    level, plain = (certify_law(law, domain, max_depth=8, budget=100).level for domain in (other, atlas))
    assert level == pytest.approx(plain, rel=1e-6)


def test_the_laws_own_turns_count(model, law):
    """A law whose configuration is a turn on has other springs stretched: its level over the atlas is another one."""
    start = law.q_free_d.copy()
    start[model.mechanism.tree.joint("joint3").q] += TURN
    other = PDSimpleGravity(model, GOAL, 20.0 * np.asarray(K_P), K_V, start)
    np.testing.assert_allclose(other.q_free_d, start, atol=1e-9)
    atlas = _atlas(model, law)
    certificate, least = certify_law(other, atlas, max_depth=10, budget=600), _least_on_the_edge(other)
    assert certificate.verdict == "proven"
    assert 0.9 * least < certificate.level_domain <= least
    assert certificate.level <= least


@pytest.mark.parametrize("depth", later(6, 7))
def test_over_a_full_turn_neighbours_have_one_energy(model, law, depth):
    """Ways round turn the springs: U of two neighbouring cells agrees at their face over the whole branch."""
    store = cells_of_atlas(law, certify(model.mechanism, GOAL, max_depth=depth))
    assert not store.whole
    for number, cell in enumerate(store.cells):
        for other in (k for k in cell.neighbours if k > number):
            one, two, place = cell.well, store.well(other), store.face(number, other).middle
            gap = one.quadratic(place - one.centre) - two.quadratic(place - two.centre)
            assert abs(gap) <= one.remainder + two.remainder


@pytest.mark.parametrize("turns", [0, 1])
def test_gains_are_suggested_for_the_laws_turns(model, law, turns):
    """β holds what ‖∂g/∂q‖ is along the law's own σ, whatever turns the atlas has."""
    gains = suggest_gains(model, GOAL, _atlas(model, law, turns), near=law.q_free_d)
    rng = np.random.default_rng(7)
    seen = 0.0
    corners = WIDTH * np.array([(s, t) for s in (-1, 1) for t in (-1, 1)])
    for q in GOAL + np.concatenate([corners, rng.uniform(-WIDTH, WIDTH, (40, 2))]):
        state = model.at(q, law.q_free_d)
        seen = max(seen, float(np.linalg.norm(model.gravity_derivative(q, state.q_free), 2)))
    assert gains.verdict == "proven"
    assert seen <= gains.beta < 1.5 * seen


def test_where_turns_do_not_agree_a_face_is_a_boundary(model, law, monkeypatch):
    """A way round that turns a spring-loaded joint: faces glued only by a turn are none, and the atlas is not whole."""
    from ccpin.control.stability.set_point import starting_cells

    atlas, found = _atlas(model, law), starting_cells._turns

    def wound(*given):
        turns, reached = found(*given)
        far = atlas.lower[:, 0] > atlas.lower[:, 0].min() + 1e-9
        assert 0 < far.sum() < len(far)
        turns[np.ix_(far, [int(model.mechanism.tree.joint("joint3").v.start)])] += 1.0
        return turns, reached

    monkeypatch.setattr(starting_cells, "_turns", wound)
    store, elbow = cells_of_atlas(law, atlas), model.mechanism.tree.joint("joint3").v.start
    assert not store.whole
    for number, cell in enumerate(store.cells):
        for other in cell.neighbours:
            there = store.cells[other]
            assert abs(cell.box.centre[0, elbow] - there.box.centre[0, elbow]) < np.pi, number
    with pytest.raises(UnattainableGainsError) as refused:
        suggest_gains(model, GOAL, atlas, near=law.q_free_d)
    assert refused.value.gains.verdict == "undecided"


@pytest.mark.parametrize("sprung", [True, False])
def test_cells_agree_where_their_boxes_do(sprung):
    """A neighbour's box a turn on agrees where no spring is on the joint, where one is it does not."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=_JOINTS if sprung else None))
    law = PDSimpleGravity(model, GOAL, K_P, K_V)
    store = cells_of_atlas(law, _atlas(model, law))
    number = next(k for k, cell in enumerate(store.cells) if len(cell.neighbours) > 1)
    others = sorted(store[number].neighbours)
    assert store.agree(number, others) == [True] * len(others)
    elbow, cell = model.mechanism.tree.joint("joint3").v.start, store[others[0]]
    centre = cell.box.centre.copy()
    centre[0, elbow] += TURN
    cell.box = cell.box._replace(centre=centre)
    assert store.agree(number, others) == [not sprung] + [True] * (len(others) - 1)
