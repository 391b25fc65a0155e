"""The closed loop as an explicit analytic differential equation x′ = f(x), x = (q′, q̇), on a tape.

    d/dt q′ = ρ(q′) q̇ (13),    d/dt q̇ = D⁻¹(τ − ρᵀ(D′b + C′q̇′ + B′q̇′ + g′)) (22),    b = ρ̇q̇ = −ψ_q′⁻¹[φ̇_q′ q̇′; 0] (35),

with τ the law's generalized force, B′ the joints' dampers, springs in g′ and no dry friction. φ(q′) = 0 is an invariant
of the exact flow, because φ_q′ρ = 0: a solution that starts closed stays closed. f is analytic wherever ψ_q′ and D are
nonsingular, whether closed or not.

Inertial forces are projected body by body (Kane's form): with c the centre of mass, J_c and J_ω the partial
velocities along the columns of ρ, D = Σ m J_cᵀJ_c + J_ωᵀ I J_ω + ρᵀ diag(rotor inertias) ρ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.control.laws import ControlLaw, NoTorque, PDFullGravity, PDSimpleGravity
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.tree import Tree
from ccpin.validated.balls import rational
from ccpin.validated.chains import ExactJoint, Table, closure_rows, exact, exact_joints, poses
from ccpin.validated.tape import Expression, Program, Tape


class ClosedLoop(NamedTuple):
    """A mechanism under a law as programs over x = (q′, q̇).

    Attributes:
        n_free, n: Sizes of q′ and q̇.
        independent: Places of q in q′.
        dependent: The other places, in order.
        field: f(x), of n_free + n outputs.
        closure: φ(q′), m outputs.
        jacobian: ∂φ/∂y for the dependent coordinates y, row-major, m² outputs: |det ψ_q′| is its determinant's size.
        drift: (ρ(q′) q̇, 0): the mechanism moved with q̇ constant.
        energies: Kinetic energy and potential energy, in joules.
        lyapunov: 𝒱 + V(q_d) of Theorem 3 for PD with simple gravity compensation, else ``None``.
        efforts: u(q′, q̇) of a law that is sampled and held, else ``None``. The state is then (q′, q̇, u) with u′ = 0,
            and `field` and `drift` have as many outputs.
        feedback: ∂u/∂(q, q̇) of that law, constant, of shape (n, 2n).
    """

    n_free: int
    n: int
    independent: tuple[int, ...]
    dependent: tuple[int, ...]
    field: Program
    closure: Program
    jacobian: Program
    drift: Program
    energies: Program
    lyapunov: Program | None
    efforts: Program | None = None
    feedback: Array | None = None


def closed_loop(model: ReducedModel, law: ControlLaw | None, held: bool = False) -> ClosedLoop:
    """Record a mechanism and its law at the current precision; `held`: with efforts held from sample to sample.

    Raises:
        InvalidInputError: `model` is no reduced model.
        UnsupportedMechanismError: Joints other than revolute and prismatic, rows of φ that are redundant, independent
            coordinates that are not whole joints, or a law other than none and the two PD laws.
    """
    mechanism, coordinates = model.mechanism, model.coordinates
    if not (coordinates.scalar and coordinates.constant):
        raise UnsupportedMechanismError("validated integration covers whole 1-dof joints as independent coordinates")
    constraints = model.parametrization.constraints
    n_free, n = mechanism.n_free, model.n
    joints = exact_joints(mechanism.tree)
    if constraints.size + n != n_free:
        raise UnsupportedMechanismError(
            f"validated integration needs a square ψ_q′; φ has {constraints.size} rows for "
            f"{n_free - n} dependent coordinates"
        )
    independent = [part.q_free.start for part in coordinates.parts]
    dependent = [k for k in range(n_free) if k not in independent]
    feedback = _feedback(law) if held else None
    tape = Tape(n_free + n * (1 if feedback is None else 2))
    q_free, v, u = np.split(np.array(tape.inputs, dtype=object), [n_free, n_free + n])
    phi = closure_rows(tape, constraints, joints, q_free)
    closed = _closed(tape, phi, v, independent, dependent)
    frames = poses(tape, joints, q_free)
    terms = _dynamics(mechanism.tree, joints, frames, closed, (q_free, v), exact(model.gravity_vector))
    force, lyapunov = _law(law, q_free[independent], v, terms)
    acting = u if held else force
    acceleration = tape.solve(terms.mass, (acting - terms.bias)[:, None])[:, 0]
    still = [0] * len(u)
    return ClosedLoop(
        n_free,
        n,
        tuple(independent),
        tuple(dependent),
        field=tape.program([*closed.v_free, *acceleration, *still]),
        closure=tape.program(phi),
        jacobian=tape.program(closed.jacobian.ravel()),
        drift=tape.program([*closed.v_free, *[0] * n, *still]),
        energies=tape.program([terms.kinetic, terms.potential]),
        lyapunov=None if lyapunov is None else tape.program([lyapunov]),
        efforts=tape.program(list(force)) if held else None,
        feedback=feedback,
    )


def _feedback(law: ControlLaw | None) -> Array:
    """∂u/∂(q, q̇) of a law that can be sampled and held.

    Raises:
        UnsupportedMechanismError: Another law than (28), or motors that do not sit on the independent joints.
    """
    if not isinstance(law, PDSimpleGravity):
        raise UnsupportedMechanismError(
            f"a sampled loop is enclosed under PDSimpleGravity only, not under {type(law).__name__}"
        )
    if law.near.reference.transmission is not None:
        raise UnsupportedMechanismError(
            "a sampled loop is enclosed where the motors sit on the independent joints: efforts held elsewhere are not "
            "constant generalized forces"
        )
    return np.hstack([-law.K_p, -law.K_v])


class _Closed(NamedTuple):
    """∂φ/∂y, ρ, q̇′ and b."""

    jacobian: Table
    rho: Table
    v_free: Table
    bias: Table


class _DynamicTerms(NamedTuple):
    """D, ρᵀ(D′b + C′q̇′ + B′q̇′ + g′), g, and the energies."""

    mass: Table
    bias: Table
    gravity: Table
    kinetic: Expression
    potential: Expression


def _closed(tape: Tape, phi: list[Expression], v: Table, independent: list[int], dependent: list[int]) -> _Closed:
    """What the closures make of q̇."""
    n_free, n = len(independent) + len(dependent), len(v)
    slopes = np.array([tape.derivative(phi, {k: 1}) for k in range(n_free)], dtype=object).T
    jacobian = slopes[:, dependent]
    rho, bias = np.zeros((n_free, n), dtype=object), np.zeros(n_free, dtype=object)
    rho[independent] = np.eye(n, dtype=object)
    rho[dependent] = tape.solve(jacobian, -slopes[:, independent])
    v_free = rho @ v
    direction = dict(enumerate(v_free))
    rate = np.array(tape.derivative(tape.derivative(phi, direction), direction), dtype=object)
    bias[dependent] = tape.solve(jacobian, -rate[:, None])[:, 0]
    return _Closed(jacobian, rho, v_free, bias)


def _dynamics(
    tree: Tree,
    joints: Sequence[ExactJoint],
    frames: dict[int, Table],
    closed: _Closed,
    state: tuple[Table, Table],
    gravity: Table,
) -> _DynamicTerms:
    """D, bias force, gravity's and springs' force and energies, body by body and joint by joint."""
    q_free, v = state
    n = len(v)
    mass, bias, weight = (np.zeros(shape, dtype=object) for shape in ((n, n), n, n))
    potential: Expression = 0
    for joint, body in zip(joints, _motions(joints, frames, closed), strict=True):
        rotation, position = frames[joint.number][:3, :3], frames[joint.number][:3, 3]
        inertia, place = tree.model.inertias[joint.number], joint.number - 1
        m, rotor, tensor = rational(inertia.mass), rational(tree.model.armature[place]), exact(inertia.inertia)
        lever = rotation @ exact(inertia.lever)
        partial = body.velocity[:n] + cross(body.omega[:n], lever)
        turns = body.omega @ rotation
        turning, omega, alpha = turns[:n], turns[n], body.alpha @ rotation
        whirl = cross(body.omega[n], cross(body.omega[n], lever))
        acceleration = body.acceleration + cross(body.alpha, lever) + whirl
        moment = tensor @ alpha + cross(omega, tensor @ omega)
        row = closed.rho[place]
        potential = potential - m * (gravity @ (position + lever))
        weight = weight - (partial @ gravity) * m
        bias = bias + (partial @ acceleration) * m + turning @ moment + row * rotor * closed.bias[place]
        mass = mass + (partial @ partial.T) * m + turning @ tensor @ turning.T + np.outer(row, row) * rotor
        stated = tree.joints[place].stated
        if stated.stiffness:
            pull = rational(stated.stiffness) * (q_free[place] - rational(stated.spring_reference))
            potential = potential + rational(0.5) * pull * (q_free[place] - rational(stated.spring_reference))
            weight = weight + row * pull
        if stated.damping:
            bias = bias + row * (rational(stated.damping) * closed.v_free[place])
    mass = np.tril(mass) + np.tril(mass, -1).T  # equal expressions: recorded once
    return _DynamicTerms(mass, bias + weight, weight, rational(0.5) * (v @ (mass @ v)), potential)


class _Motion(NamedTuple):
    """How a body moves, in world axes; with n columns of ρ, a row each, and q̇′ below them.

    Attributes:
        omega: Angular velocities, of shape (n + 1, 3).
        velocity: The origin's velocities, alike.
        alpha: ω̇ for q̇′ and q̈′ = b, of shape (3,).
        acceleration: The origin's acceleration, alike.
    """

    omega: Table
    velocity: Table
    alpha: Table
    acceleration: Table


def _motions(joints: Sequence[ExactJoint], frames: dict[int, Table], closed: _Closed) -> list[_Motion]:
    """Every body's motion, by joint. A joint's axis in the world is the same before and after the joint turns."""
    rates = np.column_stack([closed.rho, closed.v_free])
    still = np.zeros((rates.shape[1], 3), dtype=object)
    found = {0: _Motion(still, still, still[0], still[0])}
    for joint in joints:
        omega, velocity, alpha, acceleration = found[joint.parent]
        arm = frames[joint.number][:3, 3] - frames[joint.parent][:3, 3]
        axis = frames[joint.parent][:3, :3] @ (joint.placement[:3, :3] @ joint.axis)
        along, change = np.outer(rates[joint.number - 1], axis), axis * closed.bias[joint.number - 1]
        velocity = velocity + cross(omega, arm)
        acceleration = acceleration + cross(alpha, arm) + cross(omega[-1], cross(omega[-1], arm))
        turning = cross(omega[-1], along[-1])
        if joint.revolute:
            found[joint.number] = _Motion(omega + along, velocity, alpha + turning + change, acceleration)
        else:
            found[joint.number] = _Motion(omega, velocity + along, alpha, acceleration + change + turning + turning)
    return [found[joint.number] for joint in joints]


def _law(law: ControlLaw | None, q: Table, v: Table, terms: _DynamicTerms) -> tuple[Table, Expression | None]:
    """The generalized force ρᵀSᵀu of a law, and 𝒱 + V(q_d) with the law's own g(q_d).

    Where motors do not sit on the independent joints, the laws' u has ρᵀSᵀu = this force wherever ρᵀSᵀ has full rank.
    """
    if law is None or isinstance(law, NoTorque):
        return np.zeros(len(v), dtype=object), None
    if not isinstance(law, PDSimpleGravity | PDFullGravity):
        raise UnsupportedMechanismError(
            f"validated integration knows PDSimpleGravity, PDFullGravity and no torque, not {type(law).__name__}"
        )
    error = exact(law.q_d) - q
    spring = exact(law.K_p) @ error
    force = spring - exact(law.K_v) @ v
    if isinstance(law, PDFullGravity):
        return force + terms.gravity, None
    constant = exact(law.gravity_d)
    stored = error @ constant + rational(0.5) * (error @ spring)
    return force + constant, terms.kinetic + terms.potential + stored
