"""The regressor against inverse dynamics, Pinocchio's own, and what energy says of each of its columns."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccpin
from ccpin.description import Coupling, CouplingTerm
from ccpin.dynamics.parameters import INERTIAL, KINDS
from ccpin.errors import InvalidInputError, SingularConfigurationError, UnreachableError
from tests.oracles.finite_differences import derivative
from tests.support.agreement import reference_model
from tests.support.strategies import Growth, mechanisms

ANKLE = "docs/howto/ankle.urdf"
ZOO = ("rpdr", "delta", "stewart", "planar_3rrr", "bennett", "four_bar", "hexa", "sarrus", "slider_crank")


def with_physics(description, rng):
    """The description with rotors, dampers, dry friction and springs on its joints."""

    def physical(joint):
        armature, damping, friction, stiffness = rng.uniform(0.1, 2.0, 4)
        kind = joint.kind
        if kind == "fixed":
            return joint
        springs = {"stiffness": stiffness} if kind in ("revolute", "prismatic", "spherical") else {}
        springs |= {"spring_reference": float(rng.normal())} if kind in ("revolute", "prismatic") else {}
        return replace(joint, armature=armature, damping=damping, friction=friction, **springs)

    return replace(description, joints=tuple(map(physical, description.joints)))


def moving(model, rng, near=0.1):
    """A State near the reference, and q̇, q̈, q̇_r."""
    start = model.alpha(model.mechanism.q_reference)
    step = near * rng.normal(size=model.n)
    for _ in range(14):
        try:
            state = model.at(model.coordinates.integrate(start, step))
            break
        except (UnreachableError, SingularConfigurationError):
            step = 0.5 * step
    size = np.linalg.norm(state.rho)
    return state, *(rng.normal(size=(3, model.n)) / size)


def friction(state, v):
    """ρᵀ c sign(q̇′)."""
    return state.rho.T @ (state.model.mechanism.joints.friction * np.sign(state.v_free(v)))


def assert_linear(model, rng):
    """Y π is inverse dynamics, and Y_r π that of Slotine and Li, to 1e-12 of the largest term."""
    state, v, a, v_r = moving(model, rng)
    pi = model.parameters.values
    Y, Y_r = state.regressor(v, a), state.regressor(v, a, v_r)
    size = np.abs(Y * pi).max() + 1.0
    np.testing.assert_allclose(Y @ pi, state.tau(v, a) + friction(state, v), rtol=0, atol=1e-12 * size)
    wanted = state.D @ a + state.C(v) @ v_r + state.g + state.damping @ v_r + friction(state, v)
    np.testing.assert_allclose(Y_r @ pi, wanted, rtol=0, atol=1e-12 * (size + np.abs(Y_r * pi).max()))
    slack = 0.5 * model.mechanism.joints.stiffness @ model.mechanism.joints.spring_reference**2
    row, energy = state.energy_regressor(v), sum(state.energy(v))
    assert abs(row @ pi + slack - energy) <= 1e-12 * (np.abs(row * pi).sum() + slack)


@pytest.mark.parametrize("name", [*ZOO, ANKLE])
def test_inverse_dynamics_of_every_model(name):
    """Y π = D q̈ + C q̇ + damping q̇ + g + friction, with Slotine and Li's q̇_r as well, and the energy."""
    description = ccpin.load(name).description
    rng = np.random.default_rng(1)
    for told in (description, with_physics(description, rng)):
        assert_linear(ccpin.ReducedModel(ccpin.load(told)), rng)


def random_mechanism(drawn, seed):
    """A model of a random mechanism with rotors, dampers, friction and springs."""
    rng = np.random.default_rng(seed)
    return ccpin.ReducedModel(ccpin.load(with_physics(drawn.description, rng), free=["all"])), rng


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=4)
@given(mechanisms(), seeds)
def test_inverse_dynamics_of_random_mechanisms(drawn, seed):
    """Y π and Y_r π, whatever the joints and closures."""
    assert_linear(*random_mechanism(drawn, seed))


@pytest.mark.slow
@settings(max_examples=100)
@given(mechanisms(), seeds)
def test_inverse_dynamics_of_a_hundred_random_mechanisms(drawn, seed):
    """The same of more."""
    assert_linear(*random_mechanism(drawn, seed))


@pytest.mark.parametrize("name", ["rpdr", "delta", ANKLE])
def test_columns_of_bodies_are_pinocchios(name):
    """Columns of the ten numbers of bodies are ρᵀ times Pinocchio's regressor of the free system."""
    model, rng = ccpin.ReducedModel(ccpin.load(name)), np.random.default_rng(2)
    state, v, a, _ = moving(model, rng)
    tree = model.free_system.model
    theirs = state.rho.T @ pin.computeJointTorqueRegressor(
        tree, tree.createData(), state.q_free, state.v_free(v), state.a_free(v, a)
    )
    ours = state.regressor(v, a)[:, model.parameters.of("inertia")]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())


def test_columns_of_a_tree_are_pinocchios():
    """Of an open arm columns of bodies are Pinocchio's, and of rotors q̈′; a geared pair stands beside it."""
    growth = Growth(np.random.default_rng(3))
    growth.grow("base", ["revolute", "prismatic", "spherical", "revolute", "planar"])
    for _ in range(2):
        growth.grow("base", ["revolute"])
    gear = Coupling(
        "gear", tuple(CouplingTerm(growth.joints[k].name, (0.0, sign)) for k, sign in ((-2, 1.0), (-1, -1.0)))
    )
    described = replace(growth.drawn().description, couplings=(gear,))
    model, rng = ccpin.ReducedModel(ccpin.load(described, reference={})), np.random.default_rng(4)
    state, v, a, _ = moving(model, rng)
    tree, Y, told = model.free_system.model, state.regressor(v, a), model.parameters
    a_free = state.a_free(v, a)
    theirs = state.rho.T @ pin.computeJointTorqueRegressor(
        tree, tree.createData(), state.q_free, state.v_free(v), a_free
    )
    np.testing.assert_allclose(Y[:, told.of("inertia")], theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())
    np.testing.assert_allclose(Y[:, told.of("armature")].sum(axis=1), state.rho.T @ a_free, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["rpdr", "sarrus", ANKLE])
def test_energy_of_every_column(name):
    """For each constant alone: its energy's rate is q̇ᵀ of its force; dampers and friction hold none, and take some."""
    description = with_physics(ccpin.load(name).description, np.random.default_rng(5))
    model = ccpin.ReducedModel(ccpin.load(description))
    state, v, a, _ = moving(model, np.random.default_rng(5))

    def energy(s):
        there = model.at(model.coordinates.integrate(state.q, s * v + 0.5 * s * s * a), state)
        return there.energy_regressor(v + s * a)

    power, lossy = v @ state.regressor(v, a), model.parameters.of("damping", "friction")
    rate = derivative(energy, 1e-3)
    assert np.abs(rate[lossy]).max() == 0.0
    assert power[lossy].min() >= 0.0
    power[lossy] = 0.0
    np.testing.assert_allclose(rate, power, rtol=0, atol=1e-8 * np.abs(power).max())


@pytest.mark.parametrize("name", ["rpdr", "bennett", ANKLE])
def test_every_column_of_slotine_and_li_is_skew(name):
    """For each constant alone Ḋ − 2C is skew symmetric, C q̇_r = Y_r(q̇, 0, q̇_r) − Y_r(q̇, 0, 0)."""
    model = ccpin.ReducedModel(ccpin.load(name))
    state, v, _, _ = moving(model, np.random.default_rng(6))
    rest, columns = np.zeros(model.n), model.parameters.of("inertia", "armature")

    def masses(s):
        there = model.at(model.coordinates.integrate(state.q, s * v), state)
        still = there.regressor(rest, rest)
        return np.stack([(there.regressor(rest, e) - still)[:, columns] for e in np.eye(model.n)], axis=1)

    still = state.regressor(v, rest, rest)
    C = np.stack([(state.regressor(v, rest, e) - still)[:, columns] for e in np.eye(model.n)], axis=1)
    off = derivative(masses, 1e-3) - 2.0 * C
    np.testing.assert_allclose(off + off.swapaxes(0, 1), 0.0, atol=1e-8 * np.abs(C).max())


def test_batches_are_rows_asked_for_alone():
    """Y of many states at once, and what becomes of a row that cannot be."""
    model, rng = ccpin.ReducedModel(ccpin.load("rpdr")), np.random.default_rng(7)
    Q = model.alpha(model.mechanism.q_reference) + 0.1 * rng.normal(size=(5, 2))
    V, A = rng.normal(size=(2, 5, 2))
    Y = model.regressor_many(Q, V, A)
    for k in range(5):
        np.testing.assert_allclose(Y[k], model.at(Q[k]).regressor(V[k], A[k]), rtol=1e-12, atol=1e-13)
    R = rng.normal(size=(5, 2))
    Y_r = model.regressor_many(Q, V, A, V_r=R, threads=2)
    for k in range(5):
        np.testing.assert_allclose(Y_r[k], model.at(Q[k]).regressor(V[k], A[k], R[k]), rtol=1e-12, atol=1e-13)
    failures = {}
    Q[2] = [np.pi, 0.0]
    Y = model.regressor_many(Q, V, A, failures=failures)
    assert list(failures) == [2]
    assert np.isnan(Y[2]).any()
    assert np.isfinite(Y[[0, 1, 3, 4]]).all()
    with pytest.raises(InvalidInputError, match="different lengths"):
        model.regressor_many(Q, V, A[:4])
    with pytest.raises(InvalidInputError, match="V_r has shape"):
        model.regressor_many(Q, V, A, V_r=V[:, :1])


@pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")
@pytest.mark.parametrize("name", ["rpdr", "delta", "bennett", ANKLE])
def test_the_core_s_is_the_reference_s(name):
    """Y_r to 1e-13 of its largest entry, with all constants that joints can have."""
    model = ccpin.ReducedModel(ccpin.load(name))
    falling = {j.name: {"breakaway": 0.3, "stribeck_speed": 0.5} for j in model.mechanism.tree.joints[::2]}
    model = ccpin.ReducedModel(ccpin.load(name, joints=falling))
    reference, rng = reference_model(model.mechanism), np.random.default_rng(8)
    for _ in range(3):
        state, v, a, v_r = moving(model, rng)
        known = reference.at(state.q, state.q_free).regressor(v, a, v_r)
        np.testing.assert_allclose(state.regressor(v, a, v_r), known, rtol=0, atol=1e-13 * np.abs(known).max())


def test_names_units_and_values():
    """Each constant has one name and a unit, and the value that its file states."""
    falling = {"friction": 0.1, "breakaway": 0.3, "stribeck_speed": 0.2}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint1": falling}))
    told, joints = model.parameters, model.mechanism.joints
    assert len(set(told.names)) == len(told) == len(told.units) == len(told.kinds)
    assert set(told.kinds) == set(KINDS)
    np.testing.assert_array_equal(told.values[told.of("armature")], joints.armature)
    np.testing.assert_array_equal(told.values[told.of("friction")], joints.friction)
    assert told.values[told.of("stribeck")].tolist() == [0.3 - 0.1]
    assert len(told.of("inertia")) == len(INERTIAL) * len(joints.names)
    assert told.units[told.of("mass")[0]] == "kg"
    assert told.units[told.of("stiffness")[0]] == "N m/rad"
    with pytest.raises(InvalidInputError, match="kind"):
        told.of("weight")
