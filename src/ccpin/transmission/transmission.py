"""`Transmission`: a closed chain as what stands between motors and the joints of a serial robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from numpy.typing import ArrayLike

from ccpin.arrays import Array, choice, vector
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.other_coordinates.independent_sets import with_independent
from ccpin.programs.program import Program
from ccpin.programs.recordings import record
from ccpin.transmission.linkage import linkage_model
from ccpin.transmission.posture import Models, Posture
from ccpin.transmission.sides import Side, sides_of

Given = Literal["motors", "joints"]
_MAPS = ("sigma", "across", "across_jacobian", "across_inverse")


class Transmission:
    """What stands between motors and joints: q_m(q_j) of a closed chain, exact, with all that follows of it.

    One mechanism in two sets of independent coordinates: q_j of the joints that a serial model of the robot has, and
    q_m of the motors' joints. Each way is σ in these coordinates, on the branch of `near`. Nothing is remembered
    between calls, and any number of threads may share a transmission.

    Args:
        model: The reduced model, or a mechanism.
        joints: The serial robot's joints, of one freedom each; default the mechanism's independent coordinates where
            these are not its motors; else the joints of that end of each loop which no motor moves, and motors in no
            loop.
        motors: The joints that motors drive; default the mechanism's.

    Attributes:
        joints, motors: Their names.
        joint_model, motor_model: The reduced model in either's coordinates; u of both are the motors in order.
        joint_side, motor_side: Their displacements as plain numbers.
        linkage: In the joints' coordinates, without the serial robot: what rods, cranks and rotors take.

    Raises:
        IndependentSetError: Joints or motors are not as many as motions, not evident, or do not measure the motion; the
            message names candidates.
        InvalidInputError: No mechanism is given.
    """

    def __init__(
        self,
        model: ReducedModel | Mechanism,
        joints: Sequence[str] | None = None,
        motors: Sequence[str] | None = None,
    ) -> None:
        given = model_of(model)
        mechanism = given.mechanism
        sides = sides_of(mechanism, joints, motors)
        self.joints, self.motors = sides
        self.joint_model, self.motor_model = (
            ReducedModel(_measured(mechanism, names, self.motors), given.gravity_vector) for names in sides
        )
        self.linkage = linkage_model(self.joint_model, sides)
        self.joint_side, self.motor_side = (Side(self.joint_model.mechanism, names) for names in sides)
        self._mechanisms = mechanism, self.joint_model.mechanism, self.motor_model.mechanism
        self._models = Models(self.joint_model, self.motor_model, self.linkage, self.joint_side, self.motor_side)

    def __repr__(self) -> str:
        return f"Transmission({self.joint_model.mechanism.name}: {', '.join(self.motors)} → {', '.join(self.joints)})"

    def __reduce__(self) -> tuple[type[Transmission], tuple[ReducedModel, tuple[str, ...], tuple[str, ...]]]:
        return Transmission, (self.joint_model, self.joints, self.motors)

    @property
    def n(self) -> int:
        """The number of joints, and of motors."""
        return len(self.joints)

    @property
    def reference(self) -> Posture:
        """The mechanism's reference."""
        q_free = self.joint_model.mechanism.q_reference
        return Posture(self._models, self.joint_model.at(self.joint_model.alpha(q_free), q_free))

    def at(self, q_joint: ArrayLike, near: Near | Posture = None) -> Posture:
        """The posture at joints' displacements, on the branch of `near`.

        Args:
            q_joint: rad or m, of shape (n,).
            near: A posture, a State of this mechanism or a configuration q′; default the reference.

        Raises:
            UnreachableError: A singular configuration is in the way.
            SingularConfigurationError: The posture is one.
            InvalidInputError: A wrong shape, not finite, or a place of another mechanism.
        """
        q = self.joint_side.configuration(vector(q_joint, "q_joint", self.n))
        return Posture(self._models, self.joint_model.at(q, self._place(near)))

    def at_motor(self, q_motor: ArrayLike, near: Near | Posture = None) -> Posture:
        """The posture at motors' displacements; arguments and errors as for `at`."""
        q = self.motor_side.configuration(vector(q_motor, "q_motor", self.n))
        q_free = self.motor_model.at(q, self._place(near)).q_free
        return Posture(self._models, self.joint_model.at(self.joint_model.alpha(q_free), q_free))

    def motor_from_joint(self, q_joint: ArrayLike, near: Near | Posture = None) -> Array:
        """q_m(q_j), of shape (n,): `Posture.q_motor` of `at`."""
        return self.at(q_joint, near).q_motor

    def joint_from_motor(self, q_motor: ArrayLike, near: Near | Posture = None) -> Array:
        """q_j(q_m), of shape (n,): `Posture.q_joint` of `at_motor`."""
        return self.at_motor(q_motor, near).q_joint

    def program(self, given: Given, *, steps: int = 2) -> Program:
        """One side's map to the other as a program: σ from the last y by Newton steps, positions and both matrices.

        Outputs `sigma` (the next call's y), `across` (the other side's displacements), `across_jacobian` (their
        derivative by q) and `across_inverse`. With J = ∂q_m/∂q_j, `"motors"` has J⁻¹ and J, `"joints"` J and J⁻¹;
        q̇_m = J q̇_j and τ_j = Jᵀτ_m. Recorded about the reference.

        Args:
            given: Whose displacements are the program's q: `"motors"` or `"joints"`.
            steps: Newton steps of σ; one more with the last matrix follows.

        Raises:
            InvalidInputError: Neither side, or motors that are the joints: nothing is to be found.
        """
        by_motors = choice(given, "given", ("motors", "joints")) == "motors"
        if set(self.motors) == set(self.joints):
            raise InvalidInputError(f"{self!r}: motors are the joints")
        model, others = (self.motor_model, self.joints) if by_motors else (self.joint_model, self.motors)
        return record(model, _MAPS, given="near", steps=steps, across=others)

    def _place(self, near: Near | Posture) -> ArrayLike | None:
        """A configuration of this mechanism, whichever coordinates it came with."""
        found = near.state if isinstance(near, Posture) else near
        if not isinstance(found, State):
            return found
        if not any(found.model.mechanism is own for own in self._mechanisms):
            name = self.joint_model.mechanism.name
            raise InvalidInputError(f"near is of '{found.model.mechanism.name}', not of '{name}' as loaded for this")
        return found.q_free


def _measured(mechanism: Mechanism, names: tuple[str, ...], motors: tuple[str, ...]) -> Mechanism:
    """The mechanism in coordinates of these names, driven by these motors."""
    if mechanism.independent == names and mechanism.actuated == motors:
        return mechanism
    return replace(with_independent(mechanism, names, mechanism.q_reference), actuated=motors)
