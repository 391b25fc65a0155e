"""The reader of toolbox-parallel-robots files: a robot.yaml that closes and motorises the robot.urdf beside it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ccpin.description.checks import check
from ccpin.description.model import Joint, Link, LoopClosure, MechanismDescription, frozen
from ccpin.description.toolbox_document import ToolboxDocument, parse_document
from ccpin.description.urdf import read_urdf
from ccpin.errors import DescriptionError, DescriptionNotFoundError

AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
UNIVERSAL = tuple(f"UJOINT_{a}{b}" for a in AXES for b in AXES if a != b)
JOINT_TYPES = ("SPHERICAL", "FIXED", *UNIVERSAL)


def read_toolbox(file: Path) -> MechanismDescription:
    """Read a toolbox-parallel-robots YAML and the URDF beside it (``robot.urdf``, or the only ``.urdf`` there).

    A closed_loop pair names two frames, each a link or a joint (whose frame moves with its child link). The type
    ``3d`` makes their origins coincide (spherical), any other makes the frames coincide (fixed).

    Joint types apply in the joint's own frame: SPHERICAL frees every rotation about its origin, FIXED locks it at
    zero, UJOINT_ab replaces it by ``<name>_a``, which turns about that frame's axis a, and ``<name>_b``, about the
    turned frame's axis b, with a massless link between them.

    Args:
        file: The YAML file.

    Raises:
        DescriptionNotFoundError: There is no URDF beside it, or several of which none is called robot.urdf.
        InvalidXmlError: One of the files is malformed, or refused for safety.
        DescriptionError: A list has the wrong length, a name does not exist, or the URDF is unsound.
    """
    source = str(file)
    document = parse_document(_read(file), source)
    urdf = _urdf_beside(file)
    description = _override(read_urdf(_read(urdf), str(urdf)), document.overrides, source)
    _check_motors(document.motors, description, source)
    return check(
        replace(
            description,
            closures=description.closures + _closures(document, description, source),
            actuated=document.motors or description.actuated,
            source=source,
            notes=description.notes + document.notes,
        )
    )


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise DescriptionNotFoundError(f"cannot be read: {error.strerror}", source=str(file)) from None


def _urdf_beside(file: Path) -> Path:
    named = file.parent / "robot.urdf"
    if named.is_file():
        return named
    found = sorted(path for path in file.parent.glob("*.urdf") if path.is_file())
    if len(found) == 1:
        return found[0]
    lack = f"none of {', '.join(path.name for path in found)} is called robot.urdf" if found else "there is no .urdf"
    raise DescriptionNotFoundError(f"needs its robot.urdf in the same folder: {lack}", source=str(file))


def _closures(document: ToolboxDocument, description: MechanismDescription, source: str) -> tuple[LoopClosure, ...]:
    links = {link.name for link in description.links}
    carriers = {joint.name: joint.child for joint in description.joints}
    for name, kind in document.overrides.items():
        if kind in UNIVERSAL:
            carriers[name] = carriers[f"{name}_{kind[-1]}"]

    def link_of(name: str) -> str:
        """The link whose frame that name stands for.

        Raises:
            DescriptionError: It names neither a link nor a joint, or one of each with different frames.
        """
        element = f"closed_loop frame '{name}'"
        if name not in links and name not in carriers:
            raise DescriptionError("is neither a link nor a joint of the URDF", source=source, element=element)
        if name in links and carriers.get(name, name) != name:
            raise DescriptionError(
                f"is a link and a joint with another child ('{carriers[name]}'): rename one of them",
                source=source,
                element=element,
            )
        return name if name in links else carriers[name]

    return tuple(
        LoopClosure(f"{a}_{b}", "spherical" if kind == "3d" else "fixed", link_of(a), link_of(b))
        for (a, b), kind in zip(document.pairs, document.kinds, strict=True)
    )


def _check_motors(motors: tuple[str, ...], description: MechanismDescription, source: str) -> None:
    movable = [joint.name for joint in description.joints if joint.kind != "fixed"]
    missing = [name for name in motors if name not in movable]
    if missing:
        raise DescriptionError(
            f"{', '.join(missing)}: not among the movable joints, which are {', '.join(movable)}",
            source=source,
            element="name_mot",
        )


def _override(description: MechanismDescription, overrides: dict[str, str], source: str) -> MechanismDescription:
    """Apply the joint types; what the URDF says of such a joint's position, limits and rotor no longer applies.

    Raises:
        DescriptionError: A joint does not exist or is fixed in the URDF, or its type is none of JOINT_TYPES.
    """
    joints: list[Joint] = []
    between: list[Link] = []
    notes: list[str] = []
    _check_overrides(description, overrides, source)
    for joint in description.joints:
        kind = overrides.get(joint.name)
        if kind is None:
            joints.append(joint)
            continue
        if joint.armature:
            notes.append(f"{source}: joint '{joint.name}' becomes {kind} and loses its rotor inertia")
        if kind in UNIVERSAL:
            first, middle, second = _universal(joint, kind)
            joints += [first, second]
            between.append(middle)
        else:
            joints.append(
                Joint(joint.name, "fixed", joint.parent, joint.child, joint.placement)
                if kind == "FIXED"
                else Joint(joint.name, "spherical", joint.parent, joint.child, joint.placement)
            )
    kept = {joint.name for joint in joints if joint.kind != "fixed"}
    marked = description.independent
    return replace(
        description,
        links=description.links + tuple(between),
        joints=tuple(joints),
        independent=None if marked is None else tuple(name for name in marked if name in kept),
        actuated=None if description.actuated is None else tuple(n for n in description.actuated if n in kept) or None,
        reference={name: value for name, value in description.reference.items() if name not in overrides},
        notes=description.notes + tuple(notes),
    )


def _check_overrides(description: MechanismDescription, overrides: dict[str, str], source: str) -> None:
    kinds = {joint.name: joint.kind for joint in description.joints}
    for name, kind in overrides.items():
        element = f"joint_name '{name}'"
        if name not in kinds:
            raise DescriptionError("is not a joint of the URDF", source=source, element=element)
        if kind not in JOINT_TYPES:
            raise DescriptionError(
                f"joint_type '{kind}' is not one of {', '.join(JOINT_TYPES)}", source=source, element=element
            )
        if kinds[name] == "fixed" and kind != "FIXED":
            raise DescriptionError(
                f"is fixed in the URDF, and joint_type {kind} changes movable joints only",
                source=source,
                element=element,
            )


def _universal(joint: Joint, kind: str) -> tuple[Joint, Link, Joint]:
    """The two revolute joints of UJOINT_ab and the massless link between them."""
    a, b = kind[-2], kind[-1]
    middle = Link(f"{joint.name}_{a}_link")
    first = Joint(f"{joint.name}_{a}", "revolute", joint.parent, middle.name, joint.placement, frozen(AXES[a]))
    return first, middle, Joint(f"{joint.name}_{b}", "revolute", middle.name, joint.child, axis=frozen(AXES[b]))
