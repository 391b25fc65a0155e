"""The MJCF reader: MuJoCo's model files as mechanism descriptions.

Where the file is silent MuJoCo's defaults hold. Displacements are MuJoCo's qpos: a joint's `ref` is its
displacement in the pose the file draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ccpin.description.checks import check
from ccpin.description.elements.xml import XmlElement, fail, parse_xml, source_of
from ccpin.description.mjcf.actuators import Actuators, read_actuators
from ccpin.description.mjcf.bodies import BodyReader
from ccpin.description.mjcf.defaults import Defaults, read_compiler
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.equality import Equalities, read_equalities
from ccpin.description.mjcf.geoms import read_assets
from ccpin.description.mjcf.inertia import scaled_to_total
from ccpin.description.mjcf.joints import WorldBody
from ccpin.description.mjcf.keyframes import read_keyframes
from ccpin.description.mjcf.replicate import expand_replicates
from ccpin.description.mjcf.resolving import damped, inertias_at_reference, sprung
from ccpin.description.mjcf.schema import ATTRIBUTES, DISABLED, SECTIONS, WORLD
from ccpin.description.mjcf.tendons import left_out, read_tendons
from ccpin.description.model import Joint, MechanismDescription, Motor, SolverWords

_UNMODELLED = {
    "contact": "The contact section is left out: ccpin does not model contacts.",
    "deformable": "The deformable bodies are left out: ccpin models rigid bodies only.",
}
_Gravity = tuple[float, float, float]


def mjcf_description(root: XmlElement, *, include_root: str | Path | None = None) -> MechanismDescription:
    """Read a parsed MJCF file: the bodies and joints as a tree below "world", the equalities as closures.

    The reference pose is that of the keyframe "reference" where there is one, else qpos0; the others are poses.

    A body's link keeps the body's name and frame. Several joints in one body become a chain of massless links;
    connect becomes a spherical closure, weld a fixed one, joint a coupling, and so does tendon between fixed tendons;
    actuators become motors. What has no counterpart here (contacts, other tendons, servo loops, inactive equalities)
    is listed in the notes.

    Args:
        root: The file's root element; includes and meshes are looked up against its source.
        include_root: The folder included files may come from; default the file's own.

    Raises:
        InvalidXmlError: An included file is not well-formed, or refused for safety.
        DescriptionError: An element is unknown, unsupported, incomplete or contradictory.
    """
    source = source_of(root)
    if root.tag != "mujoco":
        raise fail(root, "an MJCF file has the root element <mujoco>")
    expand_includes(root, include_root)
    sections = _sections(root)
    compiler = read_compiler(sections["compiler"])
    expand_replicates(root, compiler)
    defaults = Defaults(sections["default"])
    assets = read_assets(sections["asset"], defaults, compiler)
    tree = BodyReader(sections["worldbody"], defaults, compiler, assets).read()
    options = _options(sections["option"])
    tendons = read_tendons(sections["tendon"], tree)
    equalities = read_equalities(sections["equality"], tree, defaults, tendons)
    if "equality" in options.disabled:
        equalities = Equalities(notes=["The equalities are left out: the file disables them (flag equality)."])
    actuators = read_actuators(sections["actuator"], tree, defaults, compiler.autolimits)
    notes = [note for name, note in _UNMODELLED.items() if any(len(section) for section in sections[name])]
    if left_out(sections["tendon"], defaults, frozenset(equalities.tendons)):
        notes.append("The tendons are left out, but for equalities of fixed ones: ccpin does not model them.")
    if any(xml.get("solref") or xml.get("solimp") for part in root.iter("equality") for xml in part.iter()):
        said = "The softness of constraints (solref, solimp) is left out: closures and couplings hold exactly"
        notes.append(f"{said}; files written as MJCF state it again.")
    notes += [*options.notes, *actuators.notes]
    joints = _joints(tree, actuators, options.disabled, notes)
    poses = read_keyframes(sections["keyframe"], tree)
    reference = poses.pop("reference", tree.reference)
    return check(
        MechanismDescription(
            name=root.get("model") or (Path(source).stem if source else "mechanism"),
            root=WORLD,
            links=scaled_to_total(tree.links, compiler.total_mass),
            joints=joints,
            closures=tuple(equalities.closures),
            couplings=tuple(equalities.couplings),
            dependent_hint=tuple(dict.fromkeys(equalities.dependent)),
            actuated=actuators.driven,
            motors=_motors(tree, joints, actuators.motors),
            reference=reference,
            poses=poses,
            gravity=options.gravity,
            source=source,
            notes=(*tree.notes, *equalities.notes, *notes),
            solver=SolverWords(options.words, options.flags, equalities.softness, tree.softness),
        )
    )


def _sections(root: XmlElement) -> dict[str, list[XmlElement]]:
    """Sort the root's children by tag; MJCF allows every section more than once."""
    Element.of(root)
    sections: dict[str, list[XmlElement]] = {name: [] for name in SECTIONS}
    for child in root.iterchildren("*"):
        if child.tag not in sections:
            raise fail(child, f"MJCF has no such section; it has: {', '.join(sorted(SECTIONS))}")
        if f"mujoco/{child.tag}" in ATTRIBUTES:
            Element.of(child)
        sections[child.tag].append(child)
    return sections


class _FileOptions(NamedTuple):
    """Gravity, what of physics the file switches off, notes on what it has besides, and all other words and flags."""

    gravity: _Gravity
    disabled: frozenset[str]
    notes: tuple[str, ...]
    words: dict[str, str]
    flags: dict[str, str]


def _options(sections: Sequence[XmlElement]) -> _FileOptions:
    """Read every <option>, later ones winning."""
    gravity, disabled, notes = (0.0, 0.0, -9.81), set[str](), dict[str, None]()
    kept, switches = dict[str, str](), dict[str, str]()
    for section in sections:
        said = Element.of(section)
        kept |= {name: value for name, value in said.values.items() if name != "gravity"}
        x, y, z = said.vector("gravity", 3, gravity)
        gravity = (float(x), float(y), float(z))
        for name in ("density", "viscosity"):
            if said.number(name, 0.0):
                notes[f"The surrounding fluid's {name} is left out: ccpin does not model fluids."] = None
        if said.text("actuatorgroupdisable"):
            notes["The groups of actuators that the file disables (actuatorgroupdisable) count as motors."] = None
        for xml in section.iterchildren("flag"):
            flags = Element.of(xml)
            words = ("enable", "disable")
            switches |= {name: value for name, value in flags.values.items() if name not in DISABLED}
            for name in DISABLED:
                if name in flags.values:
                    off = flags.choice(name, words, "enable") == "disable"
                    (disabled.add if off else disabled.discard)(name)
    if "actuation" in disabled:
        notes["The file disables its actuators (flag actuation); they count as motors."] = None
    felt = (0.0, 0.0, 0.0) if "gravity" in disabled else gravity
    return _FileOptions(felt, frozenset(disabled), tuple(notes), kept, switches)


def _loaded(tree: WorldBody, actuators: Actuators) -> list[Joint]:
    """The joints with their rotors' inertias, and the springs and dampers that MuJoCo makes of times and ratios."""
    joints = [replace(each, armature=each.armature + actuators.armature.get(each.name, 0.0)) for each in tree.joints]
    if not tree.springdampers:
        return joints
    moved = inertias_at_reference(tree.links, joints, tree.reference)
    wanted = {name: said for name, said in tree.springdampers.items() if name in moved}
    lost = tree.springdampers.keys() - wanted.keys()
    tree.notes.extend(f"Left out: springdamper of joint '{name}', which moves no mass alone." for name in sorted(lost))
    return [sprung(each, *wanted[each.name], moved[each.name]) if each.name in wanted else each for each in joints]


def _motors(tree: WorldBody, joints: Sequence[Joint], motors: Sequence[Motor]) -> tuple[Motor, ...]:
    """The motors, their ratios of damping resolved."""
    if not any("dampratio" in motor.gains and "bias" in motor.gains for motor in motors):
        return tuple(motors)
    moved = inertias_at_reference(tree.links, joints, tree.reference)
    return tuple(
        damped(each, moved[each.joint]) if {"dampratio", "bias"} <= each.gains.keys() and each.joint in moved else each
        for each in motors
    )


def _joints(tree: WorldBody, actuators: Actuators, disabled: frozenset[str], notes: list[str]) -> tuple[Joint, ...]:
    """The joints with what their actuators add to them, and without the forces that the file switches off."""
    joints, lost = [], dict[str, list[str]]()
    for joint in _loaded(tree, actuators):
        physics = {"damping": joint.damping + actuators.damping.get(joint.name, 0.0)}
        for flag, field in (("spring", "stiffness"), ("damper", "damping"), ("frictionloss", "friction")):
            off = flag in disabled or ("passive" in disabled and flag != "frictionloss")
            if off and physics.get(field, getattr(joint, field)):
                physics[field] = 0.0
                lost.setdefault(f"{field} (flag {flag if flag in disabled else 'passive'})", []).append(joint.name)
        joints.append(replace(joint, **physics))  # type: ignore[arg-type]
    notes += [f"The file disables {what}: left out of {', '.join(who)}." for what, who in lost.items()]
    return tuple(joints)


def expand_includes(root: XmlElement, include_root: str | Path | None = None) -> None:
    """Replace every ``<include>`` below `root` by the content of the file it names, from below one folder only.

    File names are relative to the folder of the root's source, whatever file they stand in. Each file may come once.

    Raises:
        DescriptionError: The file is absent, outside `include_root` (default the source's folder), included twice, or
            empty.
        InvalidXmlError: The included file is not well-formed.
    """
    source = source_of(root)
    seen = {Path(source).resolve()} if source else set()
    while (include := next(root.iter("include"), None)) is not None:
        path = _locate(include, source, include_root)
        if path in seen:
            raise fail(include, f"the file '{path.name}' is included twice")
        seen.add(path)
        try:
            text = path.read_bytes()
        except OSError as error:
            raise fail(include, f"the file '{path.name}' cannot be read: {error.strerror}") from None
        content = list(parse_xml(text, str(path)).iterchildren("*"))
        if not content:
            raise fail(include, f"the file '{path.name}' holds nothing to include")
        parent, index = include.getparent(), include.getparent().index(include)
        parent[index : index + 1] = content


def _locate(include: XmlElement, source: str | None, include_root: str | Path | None) -> Path:
    said = Element.of(include)
    name = said.required("file")
    if source is None or not Path(source).is_file():
        raise said.fail(f"the file '{name[:120]}' cannot be found, because this model was not read from a file")
    folder = Path(source).resolve().parent
    allowed = Path(include_root).resolve() if include_root else folder
    try:
        path = (folder / name).resolve()
        inside, found = path.is_relative_to(allowed), path.is_relative_to(allowed) and path.is_file()
    except (OSError, ValueError, RuntimeError):
        raise said.fail(f"'{name[:120]}' is no usable file name") from None
    if not inside:
        raise said.fail(
            f"the file '{name[:120]}' lies outside {allowed.name}/, which is refused (include_root names the folder "
            "that may be included from)"
        )
    if not found:
        raise said.fail(f"there is no file '{name[:120]}', looked up from the model's folder {folder.name}/")
    return path
