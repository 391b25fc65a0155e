"""What a file says of a mechanism: one reader a format, each returning the same plain `MechanismDescription`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from ccpin.description.closure_kinds import CLOSURE_KINDS
from ccpin.description.combining import Part, combine
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.description.model import (
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Motor,
    Shape,
    Visual,
)
from ccpin.description.scaling import scaled
from ccpin.errors import AmbiguousFormatError, DescriptionNotFoundError

__all__ = [
    "CLOSURE_KINDS",
    "FORMATS",
    "JOINT_KINDS",
    "Coupling",
    "CouplingTerm",
    "Inertia",
    "Joint",
    "Link",
    "LoopClosure",
    "MechanismDescription",
    "Motor",
    "Part",
    "Shape",
    "Visual",
    "combine",
    "find_file",
    "installed_models",
    "read_description",
    "scaled",
]

FORMATS = ("urdf", "sdf", "mjcf", "toolbox")
_ROOTS = {"robot": "urdf", "sdf": "sdf", "mujoco": "mjcf"}


def installed_models() -> dict[str, Path]:
    """The mechanisms that come with ccpin: their files by name."""
    packaged = Path(str(files("ccpin"))) / "models"
    checkout = Path(__file__).resolve().parents[3] / "models"
    folder = packaged if packaged.is_dir() else checkout
    return {path.stem: path for path in sorted(folder.glob("*.urdf"))}


def find_file(path: str | Path) -> Path:
    """Resolve a path or an installed model's name.

    Raises:
        DescriptionNotFoundError: Neither exists.
    """
    try:
        candidate = Path(path)
        if candidate.exists():
            return candidate
        models = installed_models()
        if str(path) in models:
            return models[str(path)]
    except (OSError, ValueError, TypeError) as error:
        raise DescriptionNotFoundError(f"not a usable path: {error}", source=str(path)[:200]) from None
    raise DescriptionNotFoundError(
        f"no such file, and no installed model of that name (those are {', '.join(models)})", source=str(path)
    )


def read_description(
    path: str | Path,
    format: str | None = None,
    *,
    model: str | None = None,
    include_root: str | Path | None = None,
    xacro: bool = False,
    xacro_arguments: Mapping[str, str] | None = None,
) -> MechanismDescription:
    """Read a file in the format its content shows, or in the one named.

    Args:
        path: File or installed model's name; a folder stands for the robot.yaml, robot.urdf, robot.xml or model.sdf
            in it.
        format: ``"urdf"``, ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` (toolbox-parallel-robots: YAML beside a URDF).
        model: Which model of an SDFormat file to read, where it holds several.
        include_root: The folder an SDFormat or MJCF file may include others from; default its own.
        xacro: Expand xacro elements and expressions also where the file's name does not end in ``.xacro``. A xacro
            file is a program, so no other is expanded unasked (`ccpin.description.xacro_files`).
        xacro_arguments: Values of a xacro file's arguments.

    Raises:
        DescriptionNotFoundError, AmbiguousFormatError, InvalidXmlError, DescriptionError: See `ccpin.errors`.
    """
    if format is not None and (not isinstance(format, str) or format not in FORMATS):
        raise AmbiguousFormatError(f"format {format!r:.80} is not one of {', '.join(FORMATS)}", source=str(path))
    file = find_file(path)
    if file.is_dir():
        file = _file_in(file)
    if not file.is_file():
        raise DescriptionNotFoundError("neither a file nor a folder (a device or a pipe, perhaps)", source=str(file))
    try:
        text = file.read_bytes()
    except OSError as error:
        raise DescriptionNotFoundError(f"cannot be read: {error.strerror}", source=str(file)) from None
    if format == "toolbox" or (format is None and _is_toolbox(text, str(file))):
        from ccpin.description.toolbox import toolbox_description

        return toolbox_description(text, file)
    from ccpin.description.xacro_files import SUFFIX, is_xacro
    from ccpin.description.xml import fail, parse_xml, tag

    root = parse_xml(text, str(file))
    kind = format or _ROOTS.get(tag(root))
    if kind != "urdf" and is_xacro(root):
        raise fail(root, "the file holds xacro elements; only URDFs are expanded here, so give the expanded file")
    if kind == "sdf":
        from ccpin.description.sdf.reader import sdf_description

        return sdf_description(root, model=model, include_root=include_root)
    if kind == "mjcf":
        from ccpin.description.mjcf.reader import mjcf_description

        return mjcf_description(root, include_root=include_root)
    if kind == "urdf" and is_xacro(root):
        from ccpin.description.xacro_files import xacro_description

        if not (xacro or file.suffix == SUFFIX):
            raise fail(
                root,
                "the file holds xacro elements or expressions, which are programs: they are run only in a file whose "
                "name ends in .xacro, or where xacro=True (--xacro) says that this one is trusted",
            )
        return xacro_description(file, root, xacro_arguments)
    if kind == "urdf":
        from ccpin.description.urdf import urdf_description

        return urdf_description(root)
    message = f"the root element <{tag(root)}> is none of <robot> (URDF), <sdf> and <mujoco>"
    raise AmbiguousFormatError(message, source=str(file))


def _file_in(folder: Path) -> Path:
    for name in ("robot.yaml", "robot.urdf", "robot.xml"):
        if (folder / name).is_file():
            return folder / name
    from ccpin.description.sdf.includes import model_in

    found = model_in(folder)
    if found is not None:
        return found
    known = "robot.yaml, robot.urdf, robot.xml or model.sdf"
    raise DescriptionNotFoundError(f"the folder holds no {known}", source=str(folder))


def _is_toolbox(text: bytes, source: str) -> bool:
    """Whether the content is a robot.yaml rather than XML.

    Raises:
        AmbiguousFormatError: It is neither.
    """
    if text.lstrip().startswith((b"<", b"\xef\xbb\xbf<", b"\xff\xfe", b"\xfe\xff")):
        return False
    if b"closed_loop" in text:
        return True
    raise AmbiguousFormatError(
        "neither XML (URDF, SDFormat, MJCF) nor a YAML file with a 'closed_loop' key", source=source
    )
