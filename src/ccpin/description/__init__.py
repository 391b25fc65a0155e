"""What a file says of a mechanism: one reader a format, each returning the same plain `MechanismDescription`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ccpin.description.combining import Part, combine
from ccpin.description.model import (
    CLOSURE_KINDS,
    JOINT_KINDS,
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Shape,
    Visual,
)
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
    "Part",
    "Shape",
    "Visual",
    "combine",
    "detect_format",
    "find_file",
    "installed_models",
    "read_description",
]

FORMATS = ("urdf", "mjcf", "toolbox")


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
    except (OSError, ValueError) as error:
        raise DescriptionNotFoundError(f"not a usable path: {error}", source=str(path)[:200]) from None
    raise DescriptionNotFoundError(
        f"no such file, and no installed model of that name (those are {', '.join(models)})", source=str(path)
    )


def read_description(path: str | Path, format: str | None = None) -> MechanismDescription:
    """Read a file in the format its content shows, or in the one named.

    Args:
        path: File or installed model's name; a folder stands for the robot.yaml or robot.urdf in it.
        format: ``"urdf"``, ``"mjcf"`` or ``"toolbox"`` (the YAML of toolbox-parallel-robots beside its URDF).

    Raises:
        DescriptionNotFoundError, AmbiguousFormatError, InvalidXmlError, DescriptionError: See `ccpin.errors`.
    """
    if format is not None and format not in FORMATS:
        raise AmbiguousFormatError(f"format '{format}' is not one of {', '.join(FORMATS)}", source=str(path))
    file = find_file(path)
    if file.is_dir():
        file = _file_in(file)
    if not file.is_file():
        raise DescriptionNotFoundError("neither a file nor a folder (a device or a pipe, perhaps)", source=str(file))
    try:
        text = file.read_bytes()
    except OSError as error:
        raise DescriptionNotFoundError(f"cannot be read: {error.strerror}", source=str(file)) from None
    kind = format or detect_format(text, str(file))
    if kind == "toolbox":
        from ccpin.description.toolbox import read_toolbox

        return read_toolbox(file)
    if kind == "mjcf":
        from ccpin.description.mjcf.reader import read_mjcf

        return read_mjcf(text, str(file))
    from ccpin.description.urdf import read_urdf

    return read_urdf(text, str(file))


def _file_in(folder: Path) -> Path:
    for name in ("robot.yaml", "robot.urdf", "robot.xml"):
        if (folder / name).is_file():
            return folder / name
    raise DescriptionNotFoundError("the folder holds no robot.yaml, robot.urdf or robot.xml", source=str(folder))


def detect_format(text: bytes, source: str | None) -> str:
    """Tell the format from the content.

    Raises:
        AmbiguousFormatError: It is none ccpin reads.
        InvalidXmlError: It looks like XML and is not well-formed.
    """
    from ccpin.description.xml import parse_xml, tag

    if text.lstrip().startswith((b"<", b"\xef\xbb\xbf<", b"\xff\xfe", b"\xfe\xff")):
        root = tag(parse_xml(text, source))
        if root == "robot":
            return "urdf"
        if root == "mujoco":
            return "mjcf"
        raise AmbiguousFormatError(f"the root element <{root}> is neither <robot> (URDF) nor <mujoco>", source=source)
    if b"closed_loop" in text:
        return "toolbox"
    raise AmbiguousFormatError("neither XML (URDF, MJCF) nor a YAML file with a 'closed_loop' key", source=source)
