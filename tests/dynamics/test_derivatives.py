"""Exact derivatives of the reduced dynamics against finite differences, closed forms and identities."""

import re
import runpy
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.description import CLOSURE_KINDS, Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.dynamics import linearize
from ccpin.errors import (
    InvalidInputError,
    SingularConfigurationError,
    UnderactuatedError,
    UnreachableError,
)
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.rows import Directions
from tests.oracles.finite_differences import along, assert_close, derivative
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.places import MODELS, SCRIPTS, SHARED
from tests.support.strategies import mechanisms

ZOO = tuple(sorted(path.stem for path in MODELS.glob("*.urdf")))
STEP = 2e-4
TOLERANCE = 1e-7

seeds = st.integers(0, 2**32 - 1)


class State(NamedTuple):
    """A reduced model at a random closed configuration with random velocity, acceleration and effort."""

    model: ccpin.ReducedModel
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    near: np.ndarray

    @property
    def driven(self):
        """(q, v, u, near), as forward dynamics takes them."""
        return self.q, self.v, self.u, self.near

    @property
    def moving(self):
        """(q, v, a, near), as inverse dynamics takes them."""
        return self.q, self.v, self.a, self.near

    def by_q(self, function):
        """Finite differences of function(q) along tangent steps of q, of shape (·, n)."""
        move = self.model.coordinates.integrate
        units = np.eye(self.model.n)
        return np.array([derivative(lambda s, e=e: function(move(self.q, s * e)), STEP) for e in units]).T


def by_vector(function, x):
    """Finite differences of function(x) for a plain vector x, of shape (·, len(x))."""
    return np.array([derivative(lambda s, e=e: function(x + s * e)) for e in np.eye(len(x))]).T


def regular(model, point):
    """Whether σ bends gently enough at a point for differences with steps of STEP to be accurate.

    At a distance d from a fold ρ grows as 1/√d, so |ρ|/|∂ρ/∂q| = 2d: it must be a hundred steps at least.
    """
    bend = max(np.abs(model.rho_dot(point.q_free, column)).max() for column in point.rho.T)
    return point.rcond > 1e-3 and 200.0 * STEP * bend < max(1.0, np.abs(point.rho).max())


def random_state(model, seed, spread=0.15):
    """Off the reference by a random step, halved as long as its end is out of reach or too near a singularity."""
    rng = np.random.default_rng(seed)
    step = spread * rng.normal(size=model.n)
    start = model.alpha(model.mechanism.q_reference)
    v, a = rng.normal(size=(2, model.n))
    u = rng.normal(size=model.n_actuated)
    for _ in range(12):
        try:
            point = model.at(model.coordinates.integrate(start, step))
        except (UnreachableError, SingularConfigurationError):
            point = None
        if point is not None and regular(model, point):
            return State(model, model.alpha(point.q_free), v, a, u, point.q_free)
        step = 0.5 * step
    return None


def generalized_force(state, q, v, a):
    """D q̈ + C q̇ + g from the model's own terms."""
    terms = state.model.terms(q, v, state.near)
    return terms.D @ a + terms.C @ v + terms.g


def slope_size(values):
    """What a derivative that may vanish is measured by: the values a radian or metre, at most 1 of their unit."""
    return min(1.0, np.abs(values).max(initial=0.0))


def check_generalized_force(state):
    """∂τ of D q̈ + C q̇ + g, and ∂g."""
    q, v, a, near = state.moving
    slopes = state.model.generalized_force_derivatives(*state.moving)
    size = slope_size(generalized_force(state, q, v, a))
    assert_close(slopes.dtau_dq, state.by_q(lambda x: generalized_force(state, x, v, a)), TOLERANCE, scale=size)
    assert_close(slopes.dtau_dv, by_vector(lambda x: generalized_force(state, q, x, a), v), TOLERANCE, scale=size)
    assert_close(slopes.dtau_da, state.model.terms(q, v, near).D, 1e-12)
    gravity = state.model.gravity_derivative(q, near)
    assert_close(gravity, state.by_q(lambda x: state.model.gravity(x, near)), TOLERANCE, scale=size)


def check_forward(state):
    """∂q̈ of forward dynamics."""
    q, v, u, near = state.driven
    slopes = state.model.forward_dynamics_derivatives(*state.driven)
    dynamics = state.model.forward_dynamics
    size = slope_size(dynamics(q, v, u, near))
    assert_close(slopes.da_dq, state.by_q(lambda x: dynamics(x, v, u, near)), TOLERANCE, scale=size)
    assert_close(slopes.da_dv, by_vector(lambda x: dynamics(q, x, u, near), v), TOLERANCE, scale=size)
    assert_close(slopes.da_du, by_vector(lambda x: dynamics(q, v, x, near), u), TOLERANCE)


def check_inverse(state):
    """∂u of inverse dynamics."""
    q, v, a, near = state.moving
    slopes = state.model.inverse_dynamics_derivatives(*state.moving)
    dynamics = state.model.inverse_dynamics
    assert_close(slopes.du_dq, state.by_q(lambda x: dynamics(x, v, a, near)), TOLERANCE)
    assert_close(slopes.du_dv, by_vector(lambda x: dynamics(q, x, a, near), v), TOLERANCE)
    assert_close(slopes.du_da, by_vector(lambda x: dynamics(q, v, x, near), a), TOLERANCE)


@cache
def zoo_model(name, floating_base=False, actuated=None):
    return ccpin.ReducedModel(ccpin.load(name, floating_base=floating_base, actuated=actuated))


every_mechanism = pytest.mark.parametrize("name", ZOO)


@every_mechanism
@pytest.mark.parametrize("floating_base", [False, True], ids=["fixed", "floating"])
def test_every_mechanism(name, floating_base):
    """∂τ, ∂g and ∂q̈ agree with finite differences on the zoo, bolted down and floating; ∂u where it exists."""
    for seed in range(2):
        state = random_state(zoo_model(name, floating_base), seed)
        check_generalized_force(state)
        check_forward(state)
        if state.model.n_actuated >= state.model.n:
            check_inverse(state)


@pytest.mark.parametrize("floating_base", [False, True], ids=["fixed", "floating"])
def test_continuous_joints(floating_base):
    """The same on a leg of continuous joints and belts, where nq ≠ n."""
    path = SHARED / "mini_cheetah_leg.urdf"
    if not path.exists():
        pytest.skip("the shared models are not beside the project")
    independent = zoo_model(str(path), floating_base).mechanism.independent
    state = random_state(zoo_model(str(path), floating_base, independent), 3)
    check_generalized_force(state)
    check_forward(state)
    check_inverse(state)


@pytest.mark.parametrize(
    "kind", ["spherical", *later("planar", *sorted(CLOSURE_KINDS.keys() - {"planar", "spherical"}))]
)
def test_random_mechanisms(kind):
    """The same on random trees (spherical, planar and floating joints, joint components) under every closure kind."""

    @settings(max_examples=8, phases=(Phase.explicit, Phase.reuse, Phase.generate))
    @given(mechanisms(kinds=(kind,)), seeds)
    def check(drawn, seed):
        independent = ccpin.load(drawn.description).independent
        state = random_state(ccpin.ReducedModel(ccpin.load(drawn.description, actuated=independent)), seed)
        assume(state is not None)
        check_generalized_force(state)
        check_forward(state)

    check()


@settings(max_examples=30)
@given(mechanisms(), seeds)
def test_constraint_derivatives(drawn, seed):
    """D(φ_q′ q̈′ + φ̇_q′ q̇′) and D(φ_q′ w) agree with differences at open configurations too."""
    mechanism, rng = ccpin.load(drawn.description), np.random.default_rng(seed)
    constraints, model = mechanism.constraints(), mechanism.pin_model
    v_free, a_free, dq, dv = rng.normal(size=(4, model.nv))
    q_free = pin.integrate(model, mechanism.q_reference, rng.normal(size=model.nv))
    directions = Directions(dq[:, None], dv[:, None])
    value = constraints.value(q_free)
    exact = constraints.acceleration_derivative(value, v_free, a_free, directions)[:, 0]

    def acceleration(s):
        v = v_free + s * dv
        moved = constraints.value(pin.integrate(model, q_free, s * dq))
        bias = constraints.rate(moved, v) @ v
        assert_close(constraints.bias(moved, v), bias, 1e-12)
        return moved.jacobian @ a_free + bias

    assert_close(exact, derivative(acceleration), 1e-8)
    w, steps = rng.normal(size=(2, model.nv, 2))
    exact = constraints.second_derivative(value, w, steps)
    for k in range(2):
        expected = along(model, q_free, steps[:, k], lambda q: constraints.value(q).jacobian @ w)
        assert_close(exact[:, :, k], expected, 1e-8)


JOINT_PARTS = ("ball:rx", "ball:ry", "ball:rz", "slab:tx", "slab:ty", "slab:rz", "free:tx", "free:ty", "free:tz")
JOINT_PARTS += ("free:rx", "free:ry", "free:rz")


@settings(max_examples=25)
@given(st.sampled_from([0.0, 1e-9, 1e-4, 0.03, 0.3, 0.97, 1.03, 2.0, 3.0]), seeds)
def test_coordinate_bias(angle, seed):
    """D(α̇_q′ q̇′) of joint components agrees with differences, at the charts' centres and far from them."""
    rng = np.random.default_rng(seed)
    inertia = Inertia(1.0, np.zeros(3), np.eye(3))
    links = tuple(Link(name, inertia) for name in ("base", "a", "b", "c"))
    joints = (
        Joint("ball", "spherical", "base", "a"),
        Joint("slab", "planar", "a", "b"),
        Joint("free", "floating", "b", "c"),
    )
    tree = ccpin.kinematics.tree.build_tree(MechanismDescription("parts", "base", links, joints))
    reference = pin.integrate(tree.model, pin.neutral(tree.model), rng.normal(size=tree.model.nv))
    coordinates = IndependentCoordinates(tree, JOINT_PARTS, reference)
    v_free, dq, dv = rng.normal(size=(3, tree.model.nv))
    away = rng.normal(size=tree.model.nv)
    for window in (slice(0, 3), slice(9, 12)):
        away[window] *= angle / np.linalg.norm(away[window])
    q_free = pin.integrate(tree.model, reference, away)
    exact = coordinates.bias_derivative(q_free, v_free, dq[:, None], dv[:, None])[:, 0]

    def bias(s):
        v = v_free + s * dv
        return coordinates.jacobian_rate(pin.integrate(tree.model, q_free, s * dq), v) @ v

    assert_close(exact, derivative(bias), 1e-7)


@every_mechanism
def test_gravity_derivative_is_the_hessian_of_the_potential(name):
    """∂g/∂q is symmetric for angles and lengths, and dᵀ(∂g/∂q)d the second difference of V along d."""
    model = zoo_model(name)
    state = random_state(model, 5)
    hessian = model.gravity_derivative(state.q, state.near)
    assert_close(hessian, hessian.T, 1e-11)
    step, still = 1e-3, np.zeros(model.n)
    potential = [model.energy(state.q + k * step * state.v, still, state.near).potential for k in range(-2, 3)]
    curvature = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) @ potential / (12.0 * step**2)
    assert_close(state.v @ hessian @ state.v, curvature, 1e-6)


@every_mechanism
def test_forward_and_inverse_are_inverses(name):
    """q̈(q, q̇, u(q, q̇, q̈)) = q̈ differentiated: ∂q̈/∂x + ∂q̈/∂u ∂u/∂x = 0, and ∂q̈/∂u ∂u/∂q̈ = I."""
    model = zoo_model(name)
    state = random_state(model, 7)
    u = model.inverse_dynamics(*state.moving)
    forward = model.forward_dynamics_derivatives(state.q, state.v, u, state.near)
    inverse = model.inverse_dynamics_derivatives(*state.moving)
    force = model.generalized_force_derivatives(*state.moving)
    assert_close(forward.da_du @ inverse.du_dq, -forward.da_dq, 1e-10)
    assert_close(forward.da_du @ inverse.du_dv, -forward.da_dv, 1e-10)
    assert_close(forward.da_du @ inverse.du_da, np.eye(model.n), 1e-10)
    assert_close(np.linalg.solve(force.dtau_da, force.dtau_dv), -forward.da_dv, 1e-10)


@pytest.mark.parametrize(
    "actuated",
    [
        ("joint3", "joint4"),
        ("joint2", "joint3"),
        ("joint1", "joint3", "joint4"),
        ("joint4", "joint3", "joint2", "joint1"),
    ],
    ids=" ".join,
)
def test_motors_elsewhere(actuated):
    """Motors on dependent joints, and more motors than coordinates: ∂(ρᵀSᵀu)/∂q and the least-norm u enter."""
    state = random_state(zoo_model("rpdr", actuated=actuated), 11)
    check_forward(state)
    check_inverse(state)


def test_too_few_motors():
    """One motor on the RPDR: ∂q̈ and ∂τ exist, ∂u does not and says so."""
    state = random_state(zoo_model("rpdr", actuated=("joint1",)), 12)
    check_forward(state)
    check_generalized_force(state)
    terms = state.model.terms(state.q, state.v, state.near)
    reachable = np.linalg.solve(terms.D, np.array([1.0, 0.0]) - terms.C @ state.v - terms.g)
    with pytest.raises(UnderactuatedError, match="1 motors do not produce every one of 2"):
        state.model.inverse_dynamics_derivatives(state.q, state.v, reachable, state.near)


def coupled_arm():
    """Three revolute joints in a row; the third follows θ₃ = 0.4 θ₁ − 0.3 θ₁² + 0.5 θ₁³ + 0.7 θ₂ + 0.2 θ₂⁴."""
    inertia = Inertia(1.3, np.array([0.2, 0.05, -0.1]), np.diag([0.02, 0.03, 0.04]))
    names = ("base", "a", "b", "c")
    placement = np.eye(4)
    placement[:3, 3] = [0.4, 0.1, 0.2]
    joints = tuple(
        Joint(f"joint{k + 1}", "revolute", names[k], names[k + 1], placement, axis, armature=0.01 * k)
        for k, axis in enumerate(np.eye(3))
    )
    terms = (
        CouplingTerm("joint3", (0.0, 1.0)),
        CouplingTerm("joint1", (0.0, -0.4, 0.3, -0.5)),
        CouplingTerm("joint2", (0.0, -0.7, 0.0, 0.0, -0.2)),
    )
    return MechanismDescription(
        "coupled_arm",
        "base",
        tuple(Link(name, inertia) for name in names),
        joints,
        couplings=(Coupling("cam", terms),),
        independent=("joint1", "joint2"),
    )


def test_polynomial_coupling():
    """A cubic and a quartic cam: the third derivatives of the coupling enter."""
    state = random_state(ccpin.ReducedModel(ccpin.load(coupled_arm())), 13, spread=0.8)
    check_generalized_force(state)
    check_forward(state)


def four_bar_on_a_ball():
    """A four-bar carried by a spherical joint of the base, all of whose loop's ancestor moves."""
    inertia = Inertia(0.8, np.array([0.1, 0.02, 0.03]), np.diag([0.02, 0.03, 0.04]))
    at = np.eye(4), np.eye(4), np.eye(4)
    at[1][0, 3], at[2][0, 3] = 1.0, 0.5
    z = np.array([0.0, 0.0, 1.0])
    joints = (
        Joint("ball", "spherical", "base", "frame", at[1]),
        Joint("crank", "revolute", "frame", "crank", at[0], z),
        Joint("coupler", "revolute", "crank", "coupler", at[2], z),
        Joint("rocker", "revolute", "frame", "rocker", at[1], z),
    )
    tip_a, tip_b = np.eye(4), np.eye(4)
    tip_a[0, 3], tip_b[0, 3] = 1.0, 0.7
    return MechanismDescription(
        "four_bar_on_a_ball",
        "base",
        tuple(Link(name, inertia) for name in ("base", "frame", "crank", "coupler", "rocker")),
        joints,
        closures=(LoopClosure("pin", "revolute", "coupler", "rocker", tip_a, tip_b),),
        independent=("ball", "crank"),
        reference={"crank": (1.2,), "coupler": (-0.9,), "rocker": (1.4,)},
    )


def test_spherical_independent_joint():
    """A whole spherical joint is independent: derivatives are along right increments of its quaternion."""
    state = random_state(ccpin.ReducedModel(ccpin.load(four_bar_on_a_ball())), 17, spread=0.5)
    assert state.model.nq == 5
    check_generalized_force(state)
    check_forward(state)
    check_inverse(state)


def test_linearization_follows_the_flow():
    """ẋ = A x + B δu: the tangent from one motion to a disturbed one grows as A says, on a quaternion in motion too."""
    model = ccpin.ReducedModel(ccpin.load(four_bar_on_a_ball()))
    state = random_state(model, 19, spread=0.5)
    linear = linearize(model, state.q, state.u, state.v, state.near)
    rng = np.random.default_rng(23)
    dq, dv, du = rng.normal(size=(3, model.n))
    move, coordinates = model.coordinates.integrate, model.coordinates

    def departure_rate(e):
        """d/dt of (δq, δq̇) at t = 0 for the motion disturbed by e."""
        q, v, u = move(state.q, e * dq), state.v + e * dv, state.u + e * du
        rate = derivative(lambda t: coordinates.difference(move(state.q, t * state.v), move(q, t * v)))
        change = model.forward_dynamics(q, v, u, state.near) - model.forward_dynamics(*state.driven)
        return np.concatenate([rate, change])

    expected = linear.A @ np.concatenate([dq, dv]) + linear.B @ du
    assert_close(expected, derivative(departure_rate), 1e-6)
    assert np.abs(linear.A[:3, :3]).max() > 0.1


def test_linearization_at_rest():
    """About an equilibrium the poles ±√λ are those of D⁻¹ ∂g/∂q, and δu enters through D⁻¹."""
    model = zoo_model("rpdr")
    q = model.alpha(model.mechanism.q_reference)
    linear = linearize(model, q, model.gravity(q))
    inertia = model.terms(q, np.zeros(2)).D
    assert_close(linear.A, np.block([[np.zeros((2, 2)), np.eye(2)], [linear.A[2:, :2], np.zeros((2, 2))]]), 1e-12)
    assert_close(inertia @ linear.A[2:, :2], -model.gravity_derivative(q), 1e-12)
    assert_close(inertia @ linear.B[2:], np.eye(2), 1e-12)


def test_closed_loop_derivative():
    """A + B [∂u/∂q ∂u/∂q̇] is the derivative of the acceleration under PD with full gravity compensation."""
    model = zoo_model("rpdr")
    q_d = model.alpha(model.mechanism.q_reference)
    law = ccpin.control.PDFullGravity(model, q_d, [11.0, 12.0], [0.6, 0.5])
    linear = linearize(model, q_d, model.gravity(q_d))
    closed = linear.closed_loop(model.gravity_derivative(q_d) - law.K_p, -law.K_v)

    def acceleration(q, v):
        return model.forward_dynamics(q, v, law.torque(0.0, model.at(q), v))

    still = np.zeros(2)
    assert_close(closed[2:, :2], by_vector(lambda q: acceleration(q, still), q_d), TOLERANCE)
    assert_close(closed[2:, 2:], by_vector(lambda v: acceleration(q_d, v), still), TOLERANCE)
    assert np.linalg.eigvals(closed).real.max() < 0.0


def test_wrong_shapes_are_refused():
    """Gains and velocities of the wrong size raise InvalidInputError that names them."""
    model = zoo_model("rpdr")
    q = model.alpha(model.mechanism.q_reference)
    linear = linearize(model, q, [0.0, 0.0])
    with pytest.raises(InvalidInputError, match="du_dv has shape"):
        linear.closed_loop(np.zeros((2, 2)), np.zeros(2))
    with pytest.raises(InvalidInputError, match="v has shape"):
        linearize(model, q, [0.0, 0.0], v=[1.0])
    with pytest.raises(InvalidInputError, match="u has shape"):
        model.forward_dynamics_derivatives(q, [0.0, 0.0], [0.0])


def test_derivatives_do_not_share_memory():
    """A second call leaves the arrays of the first as they were."""
    model = zoo_model("rpdr")
    first, second = random_state(model, 1), random_state(model, 2)
    kept = model.generalized_force_derivatives(*first.moving)
    copies = [np.array(field) for field in kept]
    model.generalized_force_derivatives(*second.moving)
    for field, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(field, copy)


def test_free_system_derivatives():
    """∂g′/∂q′ and ∂τ′/∂q′ of the cut-open tree agree with differences, rotor inertias included."""
    model = zoo_model("rpdr", floating_base=True)
    free, tree = model.free_system, model.mechanism.pin_model
    state = random_state(model, 29)
    v_free, a_free, direction = np.random.default_rng(31).normal(size=(3, tree.nv))
    slopes = free.inverse_dynamics_derivatives(state.near, v_free, a_free)
    expected = along(tree, state.near, direction, lambda q: free.inverse_dynamics(q, v_free, a_free))
    assert_close(slopes.dtau_dq @ direction, expected, TOLERANCE)
    assert_close(slopes.tau, free.inverse_dynamics(state.near, v_free, a_free), 1e-12)
    assert_close(slopes.dtau_da, free.mass_matrix(state.near), 1e-12)
    expected = along(tree, state.near, direction, free.gravity)
    assert_close(free.gravity_derivative(state.near) @ direction, expected, TOLERANCE)


@same_on_both
def test_lqr_script(capsys):
    """The upright RPDR is unstable alone, stable under the script's regulator, and the simulation ends upright."""
    runpy.run_path(str(SCRIPTS / "lqr_rpdr.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    alone, regulated = (
        [complex(pole) for pole in re.findall(r"-?[\d.]+[+-][\d.]+j|-?[\d.]+", line.removesuffix("1/s"))]
        for line in lines[1:3]
    )
    assert len(alone) == len(regulated) == 4
    assert max(pole.real for pole in alone) > 1.0
    assert max(pole.real for pole in regulated) < -1.0
    assert float(re.findall(r"([\d.e+-]+)° at the end", lines[3])[0]) < 1e-6
