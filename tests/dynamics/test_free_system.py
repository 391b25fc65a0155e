"""D′, C′, g′ and energies of the tree cut open."""

import numpy as np
import pinocchio as pin
import pytest

from ccpin.dynamics.free_system import FreeSystem
from ccpin.kinematics.tree import build_tree
from tests.oracles import rpdr as oracle
from tests.oracles.finite_differences import along, assert_close
from tests.support.paper import order, to_free
from tests.support.strategies import Growth

KINDS = ("revolute", "continuous", "prismatic", "spherical", "fixed", "planar", "floating", "prismatic", "revolute")


@pytest.fixture(scope="module", params=[False, True], ids=["fixed base", "floating base"])
def free_system(request):
    """A branched tree with a joint of each kind and rotor inertias."""
    growth = Growth(np.random.default_rng(30))
    growth.grow(growth.grow("base", KINDS[:4]), KINDS[4:])
    growth.grow("l1", ("revolute", "prismatic"))
    return FreeSystem(build_tree(growth.drawn().description, request.param))


def states(model, count=10):
    rng = np.random.default_rng(31)
    for _ in range(count):
        yield pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)), *rng.normal(size=(2, model.nv))


def test_the_five_bars_closed_forms(rpdr):
    """D′ (36) with the motors, C′ (37) and g′ (38), anywhere."""
    rng = np.random.default_rng(32)
    system, columns = FreeSystem(rpdr.tree), order(rpdr)
    for q_paper, v_paper in zip(rng.uniform(-3, 3, (50, 4)), rng.normal(size=(50, 4)), strict=True):
        q_free, v_free = to_free(rpdr, q_paper), to_free(rpdr, v_paper)
        window = np.ix_(columns, columns)
        assert_close(system.mass_matrix(q_free)[window], oracle.mass_matrix(q_paper), 1e-14)
        assert_close(system.coriolis_matrix(q_free, v_free)[window], oracle.coriolis_matrix(q_paper, v_paper), 1e-14)
        assert_close(system.gravity(q_free)[columns], oracle.gravity(q_paper), 1e-13)


def test_two_algorithms_agree(free_system):
    """D′q̈′ + C′q̇′ + g′ is what the recursive Newton-Euler algorithm gives."""
    for q, v, a in states(free_system.model):
        sum_ = free_system.mass_matrix(q) @ a + free_system.coriolis_matrix(q, v) @ v + free_system.gravity(q)
        assert_close(free_system.inverse_dynamics(q, v, a), sum_, 1e-12)


def test_coriolis_matrix_is_christoffels(free_system):
    """Ḋ′ = C′ + C′ᵀ, Ḋ′ by finite differences."""
    for q, v, _ in states(free_system.model):
        coriolis = free_system.coriolis_matrix(q, v)
        assert_close(coriolis + coriolis.T, along(free_system.model, q, v, free_system.mass_matrix), 1e-9)


def test_energies(free_system):
    """T is the bodies' and rotors' kinetic energy and ∂V/∂q′ = g′."""
    model, data = free_system.model, free_system.model.createData()
    assert model.armature.any()
    for q, v, _ in states(model):
        pin.forwardKinematics(model, data, q, v)
        kinetic = sum(0.5 * model.inertias[j].vtiv(data.v[j]) for j in range(1, model.njoints))
        energy = free_system.energy(q, v)
        assert energy.kinetic == pytest.approx(kinetic + 0.5 * model.armature @ v**2, rel=1e-12)
        slope = along(model, q, v, lambda at, v=v: free_system.energy(at, v).potential)
        assert_close(slope, free_system.gravity(q) @ v, 1e-9)


def test_results_are_the_callers_own(free_system):
    """A later call does not change arrays returned earlier."""
    (q1, v1, a1), (q2, v2, a2) = states(free_system.model, 2)

    def everything(q, v, a):
        s = free_system
        return s.mass_matrix(q), s.coriolis_matrix(q, v), s.gravity(q), s.inverse_dynamics(q, v, a)

    first = everything(q1, v1, a1)
    kept = [array.copy() for array in first]
    everything(q2, v2, a2)
    for array, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(array, copy)
