"""The closed loop as an explicit analytic differential equation x′ = f(x), x = (q′, q̇), on a tape.

    d/dt q′ = ρ(q′) q̇ (13),    d/dt q̇ = D⁻¹(τ − ρᵀ(D′b + C′q̇′ + g′)) (22),    b = ρ̇q̇ = −ψ_q′⁻¹[φ̇_q′ q̇′; 0] (35),

with τ the law's generalized force. φ(q′) = 0 is an invariant of the exact flow, because φ_q′ρ = 0: a solution that
starts closed stays closed. f is analytic wherever ψ_q′ and D are nonsingular, whether closed or not.

Inertial forces are projected body by body (Kane's form): with c the centre of mass, J_c and J_ω the partial
velocities along the columns of ρ, D = Σ m J_cᵀJ_c + J_ωᵀ I J_ω + ρᵀ diag(rotor inertias) ρ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ccpin.control.laws import ControlLaw, NoTorque, PDFullGravity, PDSimpleGravity
from ccpin.control.stability.well import checked_model
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnsupportedMechanismError
from ccpin.validated.balls import rational
from ccpin.validated.chains import (
    ExactJoint,
    Matrix,
    Pose,
    Vector,
    add,
    apply,
    cross,
    dot,
    exact_joints,
    exact_vector,
    multiply,
    poses,
    scale,
    subtract,
    transposed,
)
from ccpin.validated.closure_rows import closure_rows
from ccpin.validated.tape import Expression, Node, Program, Tape


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


def closed_loop(model: ReducedModel, law: ControlLaw | None) -> ClosedLoop:
    """Record a mechanism and its law at the current precision.

    Raises:
        InvalidInputError: `model` is no reduced model.
        UnsupportedMechanismError: Joints other than revolute and prismatic, rows of φ that are redundant, independent
            coordinates that are not whole joints, or a law other than none and the two PD laws.
    """
    mechanism, coordinates = checked_model(model).mechanism, model.coordinates
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
    independent = tuple(part.q_free.start for part in coordinates.parts)
    dependent = tuple(k for k in range(n_free) if k not in independent)
    tape = Tape(n_free + n)
    recorder = _LoopRecorder(tape, joints, tape.inputs[:n_free], tape.inputs[n_free:], independent, dependent)
    phi = closure_rows(tape, constraints, joints, recorder.q_free)
    jacobian = recorder.close(phi)
    masses = _masses(mechanism.tree.model)
    terms = recorder.dynamics(masses, exact_vector(model.gravity_vector))
    force, lyapunov = _law(law, recorder, terms)
    acceleration = recorder.accelerate(terms, force)
    return ClosedLoop(
        n_free,
        n,
        independent,
        dependent,
        field=tape.program([*recorder.v_free, *acceleration]),
        closure=tape.program(phi),
        jacobian=tape.program([entry for row in jacobian for entry in row]),
        drift=tape.program([*recorder.v_free, *[0] * n]),
        energies=tape.program([terms.kinetic, terms.potential]),
        lyapunov=None if lyapunov is None else tape.program([lyapunov]),
    )


class _Masses(NamedTuple):
    """Mass, centre of mass and rotational inertia of each body, and rotor inertias; by joint."""

    mass: list[Expression]
    centre: list[Vector]
    inertia: list[Matrix]
    rotor: list[Expression]


class _DynamicTerms(NamedTuple):
    """D, ρᵀ(D′b + C′q̇′ + g′), g, and the energies."""

    mass: list[list[Expression]]
    bias: list[Expression]
    gravity: list[Expression]
    kinetic: Expression
    potential: Expression


def _masses(model: object) -> _Masses:
    inertias = list(model.inertias)[1:]  # type: ignore[attr-defined]
    return _Masses(
        [rational(body.mass) for body in inertias],
        [exact_vector(body.lever) for body in inertias],
        [[exact_vector(row) for row in (body.inertia + body.inertia.T) / 2] for body in inertias],
        [rational(value) for value in model.armature],  # type: ignore[attr-defined]
    )


class _LoopRecorder:
    """What the recording shares: the tree, q′, q̇, and ρ, q̇′ and b once the closures are known."""

    def __init__(
        self,
        tape: Tape,
        joints: Sequence[ExactJoint],
        q_free: Sequence[Node],
        v: Sequence[Node],
        independent: tuple[int, ...],
        dependent: tuple[int, ...],
    ) -> None:
        self.tape, self.joints, self.q_free, self.v = tape, joints, q_free, v
        self.independent, self.dependent = independent, dependent
        self.rho: list[list[Expression]] = []
        self.v_free: list[Expression] = []
        self.bias: list[Expression] = []

    def close(self, phi: list[Expression]) -> list[list[Expression]]:
        """ρ, q̇′ and b from φ; returns ∂φ/∂y."""
        columns = [self.tape.derivative(phi, {k: 1}) for k in range(len(self.q_free))]
        matrix = [[columns[k][row] for k in self.dependent] for row in range(len(phi))]
        right = [[-1 * columns[k][row] for k in self.independent] for row in range(len(phi))]
        solved = self.tape.solve(matrix, right)
        self.rho = [[]] * len(self.q_free)
        for place, k in enumerate(self.independent):
            self.rho[k] = [int(column == place) for column in range(len(self.v))]
        for row, k in enumerate(self.dependent):
            self.rho[k] = list(solved[row])
        self.v_free = [dot(row, list(self.v)) for row in self.rho]
        direction = dict(enumerate(self.v_free))
        rate = self.tape.derivative(self.tape.derivative(phi, direction), direction)
        self.bias = [0] * len(self.q_free)
        for k, solution in zip(self.dependent, self.tape.solve(matrix, [[-1 * r] for r in rate]), strict=True):
            self.bias[k] = solution[0]
        return matrix

    def dynamics(self, masses: _Masses, gravity: Vector) -> _DynamicTerms:
        """D, bias force, gravity force and energies, body by body."""
        n, frames = len(self.v), poses(self.tape, self.joints, self.q_free)
        twists = [self.twists(frames, [row[k] for row in self.rho]) for k in range(n)]
        motion = self.motion(frames)
        mass: list[list[Expression]] = [[0] * n for _ in range(n)]
        bias: list[Expression] = [0] * n
        weight: list[Expression] = [0] * n
        potential: Expression = 0
        for joint in self.joints:
            place, frame = joint.number - 1, frames[joint.number]
            lever = apply(frame.rotation, masses.centre[place])
            partial = [add(t[joint.number][1], cross(t[joint.number][0], lever)) for t in twists]
            turning = [apply(transposed(frame.rotation), t[joint.number][0]) for t in twists]
            spun = [apply(masses.inertia[place], w) for w in turning]
            omega, alpha, acceleration = motion[joint.number]
            acceleration = add(acceleration, add(cross(alpha, lever), cross(omega, cross(omega, lever))))
            omega, alpha = (apply(transposed(frame.rotation), x) for x in (omega, alpha))
            moment = add(apply(masses.inertia[place], alpha), cross(omega, apply(masses.inertia[place], omega)))
            m, rotor = masses.mass[place], masses.rotor[place]
            potential = potential - m * dot(gravity, add(frame.position, lever))
            for i in range(n):
                weight[i] = weight[i] - m * dot(partial[i], gravity)
                inertial = m * dot(partial[i], acceleration) + dot(turning[i], moment)
                bias[i] = bias[i] + inertial + rotor * self.rho[place][i] * self.bias[place]
                for j in range(i + 1):
                    entry = m * dot(partial[i], partial[j]) + dot(turning[i], spun[j])
                    mass[i][j] = mass[i][j] + entry + rotor * self.rho[place][i] * self.rho[place][j]
                    mass[j][i] = mass[i][j]
        kinetic = rational(0.5) * dot(list(self.v), [dot(row, list(self.v)) for row in mass])
        return _DynamicTerms(mass, add(bias, weight), weight, kinetic, potential)

    def twists(self, frames: dict[int, Pose], rates: list[Expression]) -> dict[int, tuple[Vector, Vector]]:
        """Angular velocity and the origin's velocity of every body for joint rates."""
        found: dict[int, tuple[Vector, Vector]] = {0: ([0, 0, 0], [0, 0, 0])}
        for joint in self.joints:
            omega, velocity = found[joint.parent]
            arm = subtract(frames[joint.number].position, frames[joint.parent].position)
            along = scale(rates[joint.number - 1], self.axis(frames, joint))
            velocity = add(velocity, cross(omega, arm))
            if joint.revolute:
                found[joint.number] = add(omega, along), velocity
            else:
                found[joint.number] = omega, add(velocity, along)
        return found

    def motion(self, frames: dict[int, Pose]) -> dict[int, tuple[Vector, Vector, Vector]]:
        """ω, ω̇ and the origin's acceleration of every body for q̇′ and q̈′ = b."""
        found: dict[int, tuple[Vector, Vector, Vector]] = {0: ([0, 0, 0], [0, 0, 0], [0, 0, 0])}
        for joint in self.joints:
            omega, alpha, acceleration = found[joint.parent]
            arm = subtract(frames[joint.number].position, frames[joint.parent].position)
            axis = self.axis(frames, joint)
            along = scale(self.v_free[joint.number - 1], axis)
            change = scale(self.bias[joint.number - 1], axis)
            acceleration = add(acceleration, add(cross(alpha, arm), cross(omega, cross(omega, arm))))
            turning = cross(omega, along)
            if joint.revolute:
                found[joint.number] = add(omega, along), add(alpha, add(turning, change)), acceleration
            else:
                found[joint.number] = omega, alpha, add(acceleration, add(change, add(turning, turning)))
        return found

    def axis(self, frames: dict[int, Pose], joint: ExactJoint) -> Vector:
        """A joint's axis in the world: it is the same before and after the joint turns."""
        return apply(multiply(frames[joint.parent].rotation, joint.rotation), joint.axis)

    def accelerate(self, terms: _DynamicTerms, force: list[Expression]) -> list[Expression]:
        """q̈ = D⁻¹(τ − bias)."""
        right = [[tau - bias] for tau, bias in zip(force, terms.bias, strict=True)]
        return [row[0] for row in self.tape.solve(terms.mass, right)]


def _law(
    law: ControlLaw | None, recorder: _LoopRecorder, terms: _DynamicTerms
) -> tuple[list[Expression], Expression | None]:
    """The generalized force ρᵀSᵀu of a law, and 𝒱 + V(q_d) with the law's own g(q_d).

    Where motors do not sit on the independent joints, the laws' u has ρᵀSᵀu = this force wherever ρᵀSᵀ has full rank.
    """
    n = len(recorder.v)
    if law is None or isinstance(law, NoTorque):
        return [0] * n, None
    if not isinstance(law, PDSimpleGravity | PDFullGravity):
        raise UnsupportedMechanismError(
            f"validated integration knows PDSimpleGravity, PDFullGravity and no torque, not {type(law).__name__}"
        )
    q = [recorder.q_free[k] for k in recorder.independent]
    error = [rational(goal) - x for goal, x in zip(law.q_d, q, strict=True)]
    spring = [dot([rational(k) for k in row], error) for row in law.K_p]
    damper = [dot([rational(k) for k in row], list(recorder.v)) for row in law.K_v]
    if isinstance(law, PDFullGravity):
        force = [s - d + g for s, d, g in zip(spring, damper, terms.gravity, strict=True)]
        return force, None
    constant = [rational(g) for g in law.gravity_d]
    force = [s - d + g for s, d, g in zip(spring, damper, constant, strict=True)]
    stored = dot(error, constant) + rational(0.5) * dot(error, spring)
    return force, terms.kinetic + terms.potential + stored
