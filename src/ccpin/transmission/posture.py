"""One posture of a transmission: what joints and motors are to one another there, each thing computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, instance, matrix, numbers, one_each, vector
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import SingularConfigurationError
from ccpin.kinematics.sigma_derivatives import SigmaDerivatives
from ccpin.simulation.plant.motors import MotorModel
from ccpin.transmission.motor_bounds import at_speed, less_friction, stated_efforts, stated_speeds
from ccpin.transmission.polytopes import Polytope
from ccpin.transmission.sides import Side

_SINGULAR = 1e-12  # reciprocal condition number of J: what is below has no inverse worth the name


class Models(NamedTuple):
    """One mechanism three times: in the joints' coordinates, in the motors', and its linkage alone.

    Attributes:
        joint, motor: The model in either side's coordinates.
        linkage: In the joints', without the serial robot (`ccpin.transmission.linkage`).
        joints, motors: The sides.
    """

    joint: ReducedModel
    motor: ReducedModel
    linkage: ReducedModel
    joints: Side
    motors: Side


@dataclass(frozen=True, eq=False, repr=False)
class Posture:
    """A closed posture, with q_m(q_j) and what follows of it; from `Transmission.at`.

    q_j are the joints' displacements, q_m the motors' joints' (behind their gears), rad or m, of shape (n,) each.
    Efforts on them are N m or N, and power goes through: τ_jᵀ q̇_j = τ_mᵀ q̇_m. Immutable; threads may share one.

    Raises:
        InvalidInputError: An argument of a wrong shape, or not finite (every method).
        SingularConfigurationError: The motors do not hold the joints there (what needs J⁻¹).

    Attributes:
        models: The models.
        state: The State in the joints' coordinates.
    """

    models: Models
    state: State

    def __repr__(self) -> str:
        joint, motor = (np.array2string(q, precision=5, separator=", ") for q in (self.q_joint, self.q_motor))
        return f"Posture({self.state.model.mechanism.name}, q_joint={joint}, q_motor={motor})"

    # Positions and velocities.

    @cached_property
    def q_joint(self) -> Array:
        """q_j, of shape (n,)."""
        return frozen(self.models.joints.positions(self.state.q))

    @cached_property
    def q_motor(self) -> Array:
        """q_m, of shape (n,)."""
        side = self.models.motors
        return frozen(side.positions(side.coordinates.alpha(self.state.q_free)))

    @cached_property
    def motor_state(self) -> State:
        """The State in the motors' coordinates."""
        return self.models.motor.at(self.models.motors.configuration(self.q_motor), self.state.q_free)

    @cached_property
    def jacobian(self) -> Array:
        """J = ∂q_m/∂q_j, of shape (n, n): the rows of ρ (14) of the motors' joints."""
        return frozen(self.state.rho[self.models.motors.rows])

    @cached_property
    def inverse(self) -> Array:
        """J⁻¹ = ∂q_j/∂q_m, of shape (n, n)."""
        if self.rcond < _SINGULAR:
            raise SingularConfigurationError(
                f"the motors do not hold the joints at {self!r}: reciprocal condition number of J {self.rcond:.1e}",
                q_free=self.state.q_free,
                rcond=self.rcond,
            )
        return frozen(np.linalg.inv(self.jacobian))

    def jacobian_rate(self, v_joint: ArrayLike) -> Array:
        """J̇ along q̇_j, exact, of shape (n, n): the motors' rows of ρ̇ (35)."""
        return np.asarray(self.state.rho_dot(v_joint)[self.models.motors.rows])

    @cached_property
    def curvature(self) -> Array:
        """∂²q_m/∂q_j∂q_j, exact, of shape (n, n, n): entry (i, j, k) is ∂J_ij/∂q_k."""
        derivatives = SigmaDerivatives(self.models.joint.parametrization, self.state.point)
        rows = np.eye(len(self.state.rho))[self.models.motors.rows]
        return frozen([derivatives.of_force(row) for row in rows])

    def motor_velocity(self, v_joint: ArrayLike) -> Array:
        """q̇_m = J q̇_j, of shape (n,)."""
        return self.jacobian @ self._vector(v_joint, "v_joint")

    def joint_velocity(self, v_motor: ArrayLike) -> Array:
        """q̇_j = J⁻¹ q̇_m, of shape (n,)."""
        return self.inverse @ self._vector(v_motor, "v_motor")

    def motor_acceleration(self, v_joint: ArrayLike, a_joint: ArrayLike) -> Array:
        """q̈_m = J q̈_j + J̇ q̇_j, of shape (n,)."""
        v, a = self._vector(v_joint, "v_joint"), self._vector(a_joint, "a_joint")
        return self.jacobian @ a + self.jacobian_rate(v) @ v

    # Efforts.

    def joint_effort(self, motor_effort: ArrayLike) -> Array:
        """τ_j = Jᵀ τ_m, of shape (n,): statics of a linkage without weight."""
        return self.jacobian.T @ self._vector(motor_effort, "motor_effort")

    def motor_effort(self, joint_effort: ArrayLike) -> Array:
        """τ_m = J⁻ᵀ τ_j, of shape (n,): statics of a linkage without weight."""
        return self.inverse.T @ self._vector(joint_effort, "joint_effort")

    def linkage_effort(self, v_joint: ArrayLike, a_joint: ArrayLike) -> Array:
        """What rods, cranks and rotors take at the joints, of shape (n,): inertia, weight, dampers, springs."""
        return self._linkage.tau(v_joint, a_joint)

    def delivered_effort(self, motor_effort: ArrayLike, v_joint: ArrayLike, a_joint: ArrayLike) -> Array:
        """What arrives at the serial robot's joints, of shape (n,): Jᵀ τ_m less what the linkage takes."""
        return self.joint_effort(motor_effort) - self.linkage_effort(v_joint, a_joint)

    def required_effort(self, joint_effort: ArrayLike, v_joint: ArrayLike, a_joint: ArrayLike) -> Array:
        """τ_m with which a joint effort arrives at the serial robot, of shape (n,): `delivered_effort` inverted."""
        wanted = self._vector(joint_effort, "joint_effort")
        return self.motor_effort(wanted + self.linkage_effort(v_joint, a_joint))

    def serial_effort(self, v_joint: ArrayLike, a_joint: ArrayLike) -> Array:
        """What the serial robot alone takes at its joints for a motion, of shape (n,)."""
        return self.state.tau(v_joint, a_joint) - self.linkage_effort(v_joint, a_joint)

    # What one side feels of the other.

    @cached_property
    def rotor_inertia(self) -> Array:
        """Jᵀ diag(I) J, of shape (n, n): the motors' rotors, as the motors' joints state them, felt at the joints."""
        return frozen(self.apparent_inertia(self.state.model.mechanism.joints.armature[self.models.motors.rows]))

    def apparent_inertia(self, rotor_inertia: ArrayLike) -> Array:
        """Jᵀ I J, of shape (n, n), kg m² (kg): rotors behind their gears, one number each, felt at the joints."""
        return self.jacobian.T @ (self._vector(rotor_inertia, "rotor_inertia")[:, None] * self.jacobian)

    @cached_property
    def linkage_inertia(self) -> Array:
        """All that the linkage adds to the joints' mass matrix, rods, cranks and rotors, of shape (n, n)."""
        return self._linkage.D

    def joint_stiffness(self, stiffness: ArrayLike, motor_effort: ArrayLike | None = None) -> Array:
        """−∂τ_j/∂q_j of motors with −∂τ_m/∂q_m = K and an effort τ_m now: JᵀKJ − Σ τ_mᵢ ∂²q_mᵢ/∂q_j², of shape (n, n).

        Args:
            stiffness: K, of shape (n, n), or its diagonal.
            motor_effort: τ_m, of shape (n,); default none.
        """
        found = self.jacobian.T @ self._matrix(stiffness, "stiffness") @ self.jacobian
        if motor_effort is None:
            return found
        return found - np.tensordot(self._vector(motor_effort, "motor_effort"), self.curvature, 1)

    def motor_stiffness(self, stiffness: ArrayLike, joint_effort: ArrayLike | None = None) -> Array:
        """−∂τ_m/∂q_m of joints with −∂τ_j/∂q_j = K and an effort τ_j now, of shape (n, n).

        J⁻ᵀ (K + Σ τ_mᵢ ∂²q_mᵢ/∂q_j²) J⁻¹ with τ_m = J⁻ᵀ τ_j, as `joint_stiffness` has it.
        """
        found = self._matrix(stiffness, "stiffness")
        if joint_effort is not None:
            found = found + np.tensordot(self.motor_effort(joint_effort), self.curvature, 1)
        return self.inverse.T @ found @ self.inverse

    def joint_damping(self, damping: ArrayLike) -> Array:
        """JᵀBJ, of shape (n, n), of motors' B (n, n), or its diagonal."""
        return self.jacobian.T @ self._matrix(damping, "damping") @ self.jacobian

    def motor_damping(self, damping: ArrayLike) -> Array:
        """J⁻ᵀBJ⁻¹, of shape (n, n), of joints' B (n, n), or its diagonal."""
        return self.inverse.T @ self._matrix(damping, "damping") @ self.inverse

    @cached_property
    def gear_ratios(self) -> Array:
        """The singular values of J, of shape (n,), largest first: motors' rate per joints' rate, over directions."""
        return frozen(np.linalg.svd(self.jacobian, compute_uv=False))

    @cached_property
    def axis_ratios(self) -> Array:
        """√(JᵀJ)ⱼⱼ of each joint, of shape (n,): rotors of inertia I on all motors are felt as I times its square."""
        return frozen(np.linalg.norm(self.jacobian, axis=0))

    def joint_play(self, motor_play: ArrayLike) -> Array:
        """How far joints move within a backlash, or a step of the encoders, of the motors: |J⁻¹| δ, of shape (n,).

        To first order, at worst over all |δq_mᵢ| ≤ δᵢ.

        Args:
            motor_play: δ of each motor, rad or m, of shape (n,).
        """
        return np.abs(self.inverse) @ np.abs(self._vector(motor_play, "motor_play"))

    def motor_play(self, joint_play: ArrayLike) -> Array:
        """How far motors move while joints stay within a δ of each: |J| δ, of shape (n,), as `joint_play`."""
        return np.abs(self.jacobian) @ np.abs(self._vector(joint_play, "joint_play"))

    # Limits, as they are.

    def torque_polytope(
        self,
        v_joint: ArrayLike | None = None,
        *,
        effort: ArrayLike | None = None,
        motors: MotorModel | None = None,
        friction: ArrayLike | None = None,
    ) -> Polytope:
        """{Jᵀ τ_m}: the joint efforts that all motors together give, at a velocity; statics, without weight.

        Args:
            v_joint: q̇_j, of shape (n,); default at rest.
            effort: Largest efforts behind the gears, N m or N, one or one each; default the mechanism's.
            motors: Their torque–speed line, in units of u (`ccpin.simulation.MotorModel`); default none.
            friction: Levels at the motors' joints, one or one each; default what the file states of them.

        Raises:
            InvalidInputError: A negative effort or level, or no effort is given and none stated.
        """
        velocity = np.zeros(self.models.joint.n) if v_joint is None else self._vector(v_joint, "v_joint")
        models, moving = self.models, self.motor_velocity(velocity)
        lower, upper = stated_efforts(models.joint, models.motors.names, effort)
        if motors is not None and instance(motors, "motors", MotorModel).speeds:
            lower, upper = at_speed(models.joint, motors, self.state, velocity, lower, upper)
        stated = models.joint.mechanism.joints.breakaway[models.motors.rows]
        level = stated if friction is None else one_each(friction, "friction", len(stated))
        lower, upper = less_friction(lower, upper, level, moving)
        return Polytope(self.jacobian.T, self.inverse.T, lower, upper, models.joints.names, models.motors.names)

    def speed_polytope(self, *, speed: ArrayLike | None = None) -> Polytope:
        """{J⁻¹ q̇_m}: the joint velocities for which no motor's joint is faster than its limit.

        Args:
            speed: Largest speeds of the motors' joints, rad/s or m/s, one or one each; default the file's.

        Raises:
            InvalidInputError: A speed that is not positive, or none is given and none stated.
        """
        models = self.models
        most = stated_speeds(models.joint, models.motors.names, models.motors.rows, speed)
        return Polytope(self.inverse, self.jacobian, -most, most, models.joints.names, models.motors.names)

    # How near to singular.

    @property
    def rcond(self) -> float:
        """σ_min/σ_max of J: towards 0 where the motors cease to hold the joints (or to move them)."""
        ratios = self.gear_ratios
        return float(ratios[-1] / ratios[0]) if len(ratios) and ratios[0] > 0.0 else 0.0

    @property
    def margins(self) -> tuple[float, float]:
        """1/κ(ψ_q′) in the joints' and in the motors' coordinates.

        The first vanishes where the motors move and the joints need not, the second where the joints move and the
        motors need not.
        """
        motors = self.models.motor.parametrization.rcond(self.state.q_free)
        return self.state.rcond, motors

    # What the above share.

    @cached_property
    def _linkage(self) -> State:
        return self.models.linkage.at(self.state.q, self.state.q_free)

    def _vector(self, value: ArrayLike, name: str) -> Array:
        return vector(value, name, self.models.joint.n)

    def _matrix(self, value: ArrayLike, name: str) -> Array:
        n = self.models.joint.n
        if numbers(value, name).ndim == 1:
            return np.diag(self._vector(value, name))
        return matrix(value, name, (n, n))
