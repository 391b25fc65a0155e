"""`load` and `Mechanism`: a closed, analysed closed-chain mechanism, immutable and picklable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Protocol

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, Record, frozen
from ccpin.description import read_description
from ccpin.description.checks import check
from ccpin.description.model import Coupling, LoopClosure, MechanismDescription
from ccpin.description.stating import Stated, with_stated
from ccpin.description.writers import write_description
from ccpin.errors import (
    IndependentSetError,
    InvalidInputError,
    LoopNotClosedError,
    NoLoopError,
    SingularConfigurationError,
    UnsupportedMechanismError,
)
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import Parametrization
from ccpin.kinematics.tree import Tree, build_tree
from ccpin.mechanism.from_pinocchio import describe_pinocchio
from ccpin.mechanism.geometry import changed
from ccpin.mechanism.mobility import Mobility
from ccpin.mechanism.physics import JointPhysics, Motors, joint_physics, motors_of
from ccpin.mechanism.pinocchio import constraint_models
from ccpin.mechanism.reference import check_independent, how_closed, idle, settle
from ccpin.mechanism.selection import choose_independent

GEOMETRY_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class Mechanism(Record):
    """A closed-chain mechanism: the free system, its closures, and which coordinates are independent.

    Nothing in it can be written to; it is equal to itself only, hashable and picklable.

    Attributes:
        description: What the file says.
        tree: The free system Σ′ as the Pinocchio model ccpin computes with, and where each link sits.
        independent: Names of the independent joints (or ``joint:axis`` components), in the order of q.
        actuated: Names of the actuated joints, in the order of u.
        q_reference: A closed, nonsingular configuration, of shape (nq,); defines the default assembly mode.
        mobility: The mobility analysis.
        notes: What readers and analysis had to assume, in sentences.
    """

    description: MechanismDescription
    tree: Tree
    independent: tuple[str, ...]
    actuated: tuple[str, ...]
    q_reference: Array
    mobility: Mobility
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The mechanism's name in its file."""
        return self.description.name

    @cached_property
    def pin_model(self) -> pin.Model:
        """A copy of the free system's Pinocchio model, the caller's own: ccpin reads nothing written to it.

        One copy a mechanism, made when first asked for; a pickle does not carry it.
        """
        return self.tree.model.copy()

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """The loop closures."""
        return self.description.closures

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """The joint couplings."""
        return self.description.couplings

    @property
    def nq(self) -> int:
        """Size of a configuration q′."""
        return int(self.tree.model.nq)

    @property
    def n_free(self) -> int:
        """n′, the number of velocity components of the free system."""
        return int(self.tree.model.nv)

    @property
    def n(self) -> int:
        """The number of independent velocities."""
        return self.mobility.mobility

    @cached_property
    def joints(self) -> JointPhysics:
        """Damping, friction, springs, rotor inertias and limits of the free system's joints, of shape (n′,) each."""
        return joint_physics(self.tree)

    @cached_property
    def motors(self) -> Motors:
        """The motors in the order of u: what is stated of each, gears and bounds of u."""
        return motors_of(self.description, self.tree, self.actuated)

    @property
    def position_limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the entries of q′, of shape (nq,) each, ±∞ where there is none."""
        return frozen(self.tree.model.lowerPositionLimit), frozen(self.tree.model.upperPositionLimit)

    @property
    def direct(self) -> bool:
        """Whether u acts on the independent velocities themselves, ρᵀSᵀu = u: motors on them, in order, of gear 1."""
        return self.actuated == self.independent and bool((self.motors.gears == 1.0).all())

    @property
    def actuation(self) -> Array:
        """S of shape (motors, n′), constant, gears included: u enters the free system as Sᵀu.

        Raises:
            UnsupportedMechanismError: A single component of a joint is actuated, so that S depends on q′
                (`State.joint_efforts` gives Sᵀu then).
        """
        coordinates = IndependentCoordinates(self.tree, self.actuated, self.q_reference)
        if not coordinates.constant:
            raise UnsupportedMechanismError("S is not constant: a single component of a joint is actuated")
        return self.motors.gears[:, None] * coordinates.jacobian(self.q_reference)

    def save(self, path: str | Path, format: str | None = None) -> None:
        """Write the mechanism to a file, with the independent and actuated joints and the reference chosen here.

        Args:
            path: The file; its suffix tells the format where `format` does not (.urdf, .xml, .yaml).
            format: ``"urdf"`` (with URDF+ loops), ``"mjcf"`` or ``"toolbox"`` (robot.yaml with its robot.urdf).

        Raises:
            InvalidInputError: The format is none of these, or the file cannot be written.
            DescriptionError: The format has no words for something, by name.
        """
        write_description(self.settled(), path, format)

    def pinocchio_constraints(self) -> list[pin.RigidConstraintModel]:
        """The closures as constraint models of `pin_model`, for Pinocchio's own solvers: the caller's, made anew.

        A spherical closure is a 3D contact, a fixed one a 6D contact, a revolute one two 3D contacts on its axis
        (their six rows have rank five: give the solver a proximal step). Ends are in the joints' frames.

        Raises:
            UnsupportedMechanismError: A closure of another kind, or a coupling.
        """
        return constraint_models(self.constraints())

    def settled(self) -> MechanismDescription:
        """The description with what was chosen here: independent and actuated joints, and the closed reference.

        Components of a joint cannot be marked in a description: with such coordinates nothing is.
        """
        own = {joint.name for joint in self.description.joints}
        chosen = self.independent if own.issuperset(self.independent) else None
        poses = {joint.name: joint.kind.told(self.q_reference[joint.q]) for joint in self.tree.joints}
        return replace(
            self.description,
            independent=chosen,
            independent_is_default=False,
            actuated=self.actuated if own.issuperset(self.actuated) else self.description.actuated,
            reference={name: pose for name, pose in poses.items() if name in own},
        )

    def __repr__(self) -> str:
        return f"Mechanism({', '.join(f'{key}: {value}' for key, value in self._summary())})"

    def _repr_html_(self) -> str:
        """A small table for notebooks."""
        gravity = ", ".join(f"{g:g}" for g in self.description.gravity)
        rows = [*self._summary(), ("gravity", f"({gravity}) m/s²"), *(("note", note) for note in self.notes)]
        cells = (f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows)
        return f"<table>{''.join(cells)}</table>"

    def _summary(self) -> list[tuple[str, str]]:
        """What identifies the mechanism to its reader, in words."""
        lists = {
            "loops": [closure.name for closure in self.closures],
            "couplings": [coupling.name for coupling in self.couplings],
            "independent": self.independent,
            "actuated": self.actuated,
        }
        sizes = [("name", self.name), ("n", str(self.n)), ("n′", str(self.n_free))]
        return sizes + [(key, " ".join(names)) for key, names in lists.items() if names]

    def constraints(self) -> Constraints:
        """φ; one for all who ask."""
        return self._parametrization.constraints

    def parametrization(self) -> Parametrization:
        """ψ, σ, ρ; one for all who ask."""
        return self._parametrization

    @cached_property
    def _parametrization(self) -> Parametrization:
        coordinates = IndependentCoordinates(self.tree, self.independent, self.q_reference)
        return Parametrization(Constraints(self.tree, self.closures, self.couplings), coordinates, self.q_reference)


class HasMechanism(Protocol):
    """What a mechanism can be read off: a `ReducedModel`, say."""

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""


def mechanism_of(thing: Mechanism | HasMechanism) -> Mechanism:
    """The mechanism itself, or that of a model.

    Raises:
        InvalidInputError: It is neither.
    """
    found = getattr(thing, "mechanism", thing)
    if not isinstance(found, Mechanism):
        raise InvalidInputError(f"a mechanism (`ccpin.load`) or a ReducedModel is needed, not {type(thing).__name__}")
    return found


def load(
    path: str | Path | MechanismDescription | pin.Model,
    *,
    closures: Iterable[LoopClosure] | None = None,
    couplings: Iterable[Coupling] | None = None,
    independent: Sequence[str] | None = None,
    actuated: Sequence[str] | None = None,
    joints: Stated | None = None,
    motors: Stated | None = None,
    floating_base: bool = False,
    format: str | None = None,
    model: str | None = None,
    include_root: str | Path | None = None,
    xacro_arguments: Mapping[str, str] | None = None,
    geometry: pin.GeometryModel | None = None,
    constraints: Iterable[object] = (),
    geometry_tolerance: float = GEOMETRY_TOLERANCE,
) -> Mechanism:
    """Load a mechanism from a file, an installed model's name, a description or a Pinocchio model.

    Args:
        path: A file (URDF with loop elements, SDFormat, toolbox-parallel-robots YAML, MJCF), the name of a model that
            comes with ccpin (``"rpdr"``), a `MechanismDescription`, or a `pinocchio.Model`.
        closures: Loop closures, in addition to the file's.
        couplings: Joint couplings, in addition to the file's.
        independent: The independent joints in the order of q; default what the file marks, completed if it marks
            only motors (the completion is among the mechanism's notes).
        actuated: The actuated joints in the order of u; default the file's motors, else the independent joints.
        joints: What the file lacks or says otherwise of its joints, by name: damping, friction, stiffness and
            spring_reference, armature, effort, velocity, lower, upper (`ccpin.description.Joint`), as in
            ``{"knee": {"damping": 0.1, "stiffness": 5.0}}``.
        motors: Likewise of the motors, by the joint they drive: gear, lower, upper (`ccpin.description.Motor`).
        floating_base: Free the root link with a 6-dof joint named ``root_joint``.
        format: ``"urdf"``, ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` to override detection from the content.
        model: Which model of an SDFormat file to read, where it holds several.
        include_root: The folder an SDFormat or MJCF file may include others from; default its own.
        xacro_arguments: Values of a xacro file's arguments (the extra ``[xacro]``).
        geometry: What to draw of a `pinocchio.Model`.
        constraints: Pinocchio's constraint models that close the loops of a `pinocchio.Model`.
        geometry_tolerance: Error of the file's lengths and angles, relative to the size of a loop. Rows that are
            redundant within it are made so by the smallest change of frames (`ccpin.mechanism.repair`), which notes
            tell; 0 takes every number as exact.

    Raises:
        DescriptionNotFoundError, InvalidXmlError, DescriptionError: The file is absent, malformed or unsound.
        NoLoopError: It declares no closure and no coupling.
        LoopNotClosedError: No closed configuration was found.
        IndependentSetError: The independent or actuated joints named cannot be used.
        InvalidInputError: What is stated of joints or motors names none of them, or is no number.
    """
    _check_arguments(path, independent, actuated, geometry_tolerance)
    if isinstance(path, MechanismDescription):
        description = path
    elif isinstance(path, pin.Model):
        description = describe_pinocchio(path, geometry=geometry, constraints=constraints)
    else:
        description = read_description(
            path, format, model=model, include_root=include_root, xacro_arguments=xacro_arguments
        )
    if joints or motors:
        description = with_stated(description, joints, motors)
    if description is path or closures or couplings or joints or motors:
        description = check(
            replace(
                description,
                closures=description.closures + tuple(closures or ()),
                couplings=description.couplings + tuple(couplings or ()),
            )
        )
    if not description.closures and not description.couplings:
        raise NoLoopError(_no_loop_message(description), source=description.source)
    try:
        mechanism = _analysed(description, floating_base, independent, actuated, geometry_tolerance)
    except MemoryError:
        message = f"{description.source or description.name}: {len(description.joints)} joints do not fit into memory"
        raise UnsupportedMechanismError(message) from None
    except (IndependentSetError, LoopNotClosedError, SingularConfigurationError, UnsupportedMechanismError) as error:
        error.args = (f"{description.source or description.name}: {error}",)
        raise
    idle = [name for name in motors or () if name not in {motor.joint for motor in mechanism.motors.each}]
    if idle:
        driven = ", ".join(mechanism.actuated)
        raise InvalidInputError(f"motors: joint '{idle[0]}' is not actuated; {driven} are (actuated= chooses)")
    return mechanism


def _analysed(
    description: MechanismDescription,
    floating_base: bool,
    independent: Sequence[str] | None,
    actuated: Sequence[str] | None,
    tolerance: float,
) -> Mechanism:
    """Close the loops, count the motions, settle who measures and who drives them."""
    wanted = tuple(independent) if independent is not None else (description.independent or ())
    tree = build_tree(description, floating_base)
    settled = settle(tree, description, wanted, tolerance)
    repairs = [found.repair for found in settled if found.repair is not None]
    for repair in repairs:
        description = changed(description, repair.change)
    tree = build_tree(description, floating_base) if repairs else tree
    choice = choose_independent(tree, [found.motion for found in settled], description, independent, actuated)
    rank = sum(found.tangent.rank for found in settled)
    mobility = Mobility(
        n_free=int(tree.model.nv),
        rows=sum(found.constraints.size for found in settled),
        rank=rank,
        mobility=int(tree.model.nv) - rank,
        idle=idle(tree, settled),
        notes=choice.notes,
    )
    notes = dict.fromkeys(
        [*description.notes, *choice.notes, *how_closed(settled), *_forces_told(description, tree, choice.actuated)]
    )
    q_reference = np.empty(tree.model.nq)
    for found in settled:
        q_reference[found.part.q] = found.closed.q_free
    IndependentCoordinates(tree, choice.actuated, q_reference)  # refuses names that cannot be actuated
    check_independent(settled, choice.independent)
    return Mechanism(description, tree, choice.independent, choice.actuated, q_reference, mobility, tuple(notes))


def _forces_told(description: MechanismDescription, tree: Tree, actuated: tuple[str, ...]) -> list[str]:
    """Notes where joints state dry friction, and where one unit of u is not one N m (or N) on its joint."""
    told, rubbing = [], [joint.name for joint in tree.joints if joint.stated.friction]
    if rubbing:
        told.append(
            f"dry friction of {', '.join(rubbing)}: `simulate` has it, the smooth equations (dynamics, laws, "
            "certificates) have not"
        )
    geared = [f"{m.gear:g} on {m.joint}" for m in description.motors if m.gear != 1.0 and m.joint in actuated]
    if geared:
        told.append(f"u is the motors' own input: one unit is {', '.join(geared)} (N m or N)")
    return told


def _check_arguments(path: object, independent: object, actuated: object, tolerance: object) -> None:
    if not isinstance(path, str | Path | MechanismDescription | pin.Model):
        known = "a path, a model's name, a description or a pinocchio.Model"
        raise InvalidInputError(f"load takes {known}, not {type(path).__name__}")
    for role, names in (("independent", independent), ("actuated", actuated)):
        if isinstance(names, str) or (names is not None and not all(isinstance(n, str) for n in names)):  # type: ignore[attr-defined]
            raise InvalidInputError(f"{role} must be a sequence of joint names, e.g. ['joint1', 'joint2']")
    if not isinstance(tolerance, float | int) or not 0.0 <= tolerance <= 1e-2:
        raise InvalidInputError(f"geometry_tolerance is {tolerance}; it must be a number between 0 and 0.01")


def _no_loop_message(description: MechanismDescription) -> str:
    if description.independent is not None and len(description.independent) < len(description.joints):
        return (
            'joints are marked dependent (independent="false") but no <loop> or <coupling> says what they depend on; '
            "add the loops to the file, a robot.yaml beside it, or pass closures="
        )
    return (
        "no loop closure and no coupling is declared, so there is nothing to reduce; add <loop> elements or closures="
    )
