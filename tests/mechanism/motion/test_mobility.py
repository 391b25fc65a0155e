"""Mobility, idle motions and the choice of independent coordinates."""

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.linalg import subspace_angles

import ccpin
from ccpin.description import Inertia, Joint, Link
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.motion.mobility import generic_rank, null_space, tangent
from tests.oracles import descriptor
from tests.support.backends import same_on_both
from tests.support.strategies import Growth, mechanisms


@same_on_both
@settings(max_examples=30)
@given(mechanisms())
def test_mobility_is_the_null_space_of_unreduced_rows(drawn):
    """n is n′ less the rank of rows written anew, and the null spaces are the same."""
    mechanism = ccpin.load(drawn.description, free=["all"])
    tree, q_free = mechanism.pin_model, mechanism.q_reference
    rows = np.array([r.gradient for r in descriptor.rows(drawn.description, tree, q_free, np.zeros(tree.nv))])
    rank = np.linalg.matrix_rank(rows, tol=1e-7)
    assert mechanism.mobility.rank == rank
    assert mechanism.n == mechanism.n_free - rank
    basis = null_space(mechanism.constraints(), q_free, rank)
    np.testing.assert_allclose(rows @ basis, 0.0, rtol=0, atol=1e-7)
    np.testing.assert_allclose(basis.T @ basis, np.eye(mechanism.n), rtol=0, atol=1e-12)


@settings(max_examples=30)
@given(mechanisms())
def test_the_independent_set_measures_the_motion(drawn):
    """The coordinates chosen are n in number, and ψ_q′ is far from singular wherever a better set is possible."""
    mechanism = ccpin.load(drawn.description)
    model = ccpin.ReducedModel(mechanism)
    assert model.n == mechanism.n
    motion = model.rho(mechanism.q_reference)
    basis = null_space(mechanism.constraints(), mechanism.q_reference, mechanism.mobility.rank)
    assert np.max(subspace_angles(motion, basis), initial=0.0) < 1e-6
    assert np.linalg.norm(motion, 2) < 1e3


def test_a_singular_pose_does_not_hide_the_rank():
    """With all links in one line φ_q′ has rank 1; generic_rank looks around and finds 2."""
    z, body = np.array([0.0, 0.0, 1.0]), Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))

    def at(x):
        placement = np.eye(4)
        placement[0, 3] = x
        return placement

    joints = (
        Joint("a", "revolute", "base", "la", at(0.0), z),
        Joint("b", "revolute", "la", "lb", at(1.0), z),
        Joint("c", "revolute", "base", "lc", at(1.5), z),
    )
    links = (Link("base"), *(Link(name, body) for name in ("la", "lb", "lc")))
    closure = ccpin.LoopClosure("tip", "spherical", "lb", "lc", at(1.0), at(0.5))
    flat = ccpin.MechanismDescription("change point", "base", links, joints, (closure,))
    constraints = Constraints(build_tree(flat), (closure,), ())
    assert tangent(constraints, np.zeros(3)).rank == 1
    rank, samples = generic_rank(constraints, tangent(constraints, np.zeros(3)))
    assert rank == 2
    assert all(tangent(constraints, sample.q_free).rank == 2 for sample in samples)
    mechanism = ccpin.load(flat)
    assert mechanism.n == 1
    assert "the loops were closed from a step away from a singular closed pose" in mechanism.notes
    assert "arbitrary" in mechanism.notes[-1]


def rod():
    """A rod between two ground points: spherical on the ground, closed by a spherical joint on a slider."""
    body = Inertia(1.0, np.array([0.25, 0.0, 0.0]), 0.1 * np.eye(3))
    tip, rail = np.eye(4), np.eye(4)
    tip[0, 3], rail[:3, 3] = 0.5, (0.4, 0.3, 0.0)
    joints = (
        Joint("ball", "spherical", "base", "rod"),
        Joint("slider", "prismatic", "base", "cart", rail, np.array([0.0, 0.6, 0.8])),
    )
    links = (Link("base"), Link("rod", body), Link("cart", body))
    closure = ccpin.LoopClosure("tip", "spherical", "rod", "cart", tip)
    return ccpin.MechanismDescription("rod", "base", links, joints, (closure,))


def test_idle_rod():
    """A rod between two balls spins about its own axis: one idle mobility, named, direction along the rod."""
    mechanism = ccpin.load(rod())
    assert (mechanism.n_free, mechanism.mobility.rank, mechanism.n) == (4, 3, 1)
    assert len(mechanism.mobility.idle) == 1
    assert mechanism.mobility.idle[0].startswith("'rod' can spin about its axis: direction (0.8, 0.6, 0)")


def test_no_idle_motion_in_the_case_study(rpdr):
    """The five-bar has none, and the analysis says how its rows were counted."""
    assert rpdr.mobility.idle == ()
    assert (rpdr.mobility.n_free, rpdr.mobility.rows, rpdr.mobility.rank, rpdr.mobility.mobility) == (4, 2, 2, 2)


@same_on_both
@pytest.mark.parametrize("kind", ["revolute", "planar"])
def test_vanishing_rows_have_no_rank(kind):
    """Rows that are round-off on the manifold (a planar loop closed about a skew axis) are not counted as rank."""
    for seed in range(20):
        growth = Growth(np.random.default_rng(seed), planar=True)
        growth.aligned_frame = lambda _, growth=growth: growth.rotation()
        growth.close(
            kind,
            growth.grow("base", ["revolute", "prismatic", "revolute"]),
            growth.grow("base", ["prismatic", "revolute"]),
        )
        mechanism = ccpin.load(growth.drawn().description)
        assert mechanism.mobility.rank == {"revolute": 3, "planar": 2}[kind]
