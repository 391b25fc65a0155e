"""`load`: from a file, a description or a Pinocchio model to a closed, analysed mechanism."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pinocchio as pin

from ccpin.arrays import records
from ccpin.description import read_description
from ccpin.description.changes.overrides import Stated, with_stated
from ccpin.description.changes.reference_pose import Pose, with_reference
from ccpin.description.checks import check
from ccpin.description.elements.graph import without_strays
from ccpin.description.finding import closing_file_of
from ccpin.description.model import Coupling, LoopClosure, MechanismDescription
from ccpin.errors import (
    IndependentSetError,
    InvalidInputError,
    LoopNotClosedError,
    NoLoopError,
    SingularConfigurationError,
    UnsupportedMechanismError,
)
from ccpin.mechanism.loading.analysis import Wishes, analysed
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.pinocchio.reader import describe_pinocchio

GEOMETRY_TOLERANCE = 1e-5  # relative to the length around a loop: rows that are redundant within it are meant to be


def load(
    path: str | Path | MechanismDescription | pin.Model,
    *,
    closures: Iterable[LoopClosure] | None = None,
    couplings: Iterable[Coupling] | None = None,
    independent: Sequence[str] | None = None,
    actuated: Sequence[str] | None = None,
    locked: Sequence[str] = (),
    free: Sequence[str] = (),
    reference: Pose | None = None,
    joints: Stated | None = None,
    motors: Stated | None = None,
    floating_base: bool = False,
    format: str | None = None,
    model: str | None = None,
    include_root: str | Path | None = None,
    xacro: bool = False,
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
        locked: Joints, or single components of one (``"ball:rx"``), to hold still: where the stated pose has them, else
            where the loops close. The mechanism is then one without them: they are fixed, and count in nothing.
        free: Idle spins to leave free, by the joint or component that `Mechanism.locked` and `notes` name, or
            ``["all"]``. A spin that moves nothing but itself (a rod between two balls) is else locked, unless
            `independent` or a motor names it (`ccpin.mechanism.loading.locking` says what that changes: nothing, for a
            rod).
        reference: A pose near which the loops are to close, which chooses the assembly mode: the name of a keyframe or
            group_state of the file, or displacements of some joints as ``{"crank": 0.5}`` (a quaternion x, y, z, w of
            a ball joint); the others stay as in the file. Tried first; after it, where the loops do not close from it
            within the joint limits, the file's other poses in their order, the neutral pose, the middle of the ranges,
            and spread starts; `notes` tell which it was, and by how much stated joints had to move.
        joints: What the file lacks or says otherwise of its joints, by name: damping, friction, stiffness and
            spring_reference, armature, effort, velocity, lower, upper (`ccpin.description.Joint`), as in
            ``{"knee": {"damping": 0.1, "stiffness": 5.0}}``.
        motors: Likewise of the motors, by the joint they drive: gear, lower, upper (`ccpin.description.Motor`).
        floating_base: Free the root link with a 6-dof joint named ``root_joint``.
        format: ``"urdf"``, ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` to override detection from the content.
        model: Which model of an SDFormat file to read, where it holds several.
        include_root: The folder an SDFormat or MJCF file may include others from; default its own.
        xacro: Expand xacro also where the file's name does not end in ``.xacro``: a xacro file is a program.
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
        InvalidInputError: What is stated of joints or motors names none of them or is no number; a name to be locked
            or free is of no such joint.
    """
    _check_arguments(path, geometry_tolerance, independent=independent, actuated=actuated, locked=locked, free=free)
    more_closures = records(() if closures is None else closures, "closures", LoopClosure)
    more_couplings = records(() if couplings is None else couplings, "couplings", Coupling)
    if isinstance(path, MechanismDescription):
        read = path
    elif isinstance(path, pin.Model):
        read = describe_pinocchio(path, geometry=geometry, constraints=constraints)
    else:
        read = read_description(
            path, format, model=model, include_root=include_root, xacro=xacro, xacro_arguments=xacro_arguments
        )
    stated = _with_stated(read, joints, motors, reference, more_closures, more_couplings)
    if read is path or stated is not read:
        stated = check(stated)
    if not stated.closures and not stated.couplings:
        raise NoLoopError(_no_loop_message(stated), source=stated.source)
    description = without_strays(stated, independent or ())
    try:
        wishes = Wishes(independent, actuated, tuple(locked), tuple(free))
        mechanism = analysed(description, floating_base, wishes, geometry_tolerance)
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


def _with_stated(
    description: MechanismDescription,
    joints: Stated | None,
    motors: Stated | None,
    reference: Pose | None,
    closures: tuple[LoopClosure, ...],
    couplings: tuple[Coupling, ...],
) -> MechanismDescription:
    """The description with what is stated beside it, to be checked again; itself where nothing is."""
    stated = description
    if joints is not None or motors is not None:
        stated = with_stated(stated, joints, motors)
    if reference is not None:
        stated = with_reference(stated, reference)
    if closures or couplings:
        stated = replace(stated, closures=stated.closures + closures, couplings=stated.couplings + couplings)
    return stated


def _check_arguments(path: object, tolerance: object, **named: object) -> None:
    if not isinstance(path, str | Path | MechanismDescription | pin.Model):
        known = "a path, a model's name, a description or a pinocchio.Model"
        raise InvalidInputError(f"load takes {known}, not {type(path).__name__}")
    for role, names in named.items():
        words = isinstance(names, Iterable) and not isinstance(names, str) and all(isinstance(n, str) for n in names)
        if names is not None and not words:
            raise InvalidInputError(f"{role} must be a sequence of joint names, e.g. ['joint1', 'joint2']")
    if not isinstance(tolerance, float | int) or not 0.0 <= tolerance <= 1e-2:
        raise InvalidInputError(f"geometry_tolerance is {tolerance}; it must be a number between 0 and 0.01")


def _no_loop_message(description: MechanismDescription) -> str:
    closing = closing_file_of(description.source)
    if closing is not None:
        return f"no loop closure and no coupling is declared here, but '{closing}' declares its loops: give that file"
    if description.independent is not None and len(description.independent) < len(description.joints):
        return (
            'joints are marked dependent (independent="false") but no <loop> or <coupling> says what they depend on; '
            "add the loops to the file, a robot.yaml beside it, or pass closures="
        )
    return (
        "no loop closure and no coupling is declared, so there is nothing to reduce; add <loop> elements or closures="
    )
