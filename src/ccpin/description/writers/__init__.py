"""Descriptions out again: one writer a format, chosen by name or by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ccpin.description.model import MechanismDescription
from ccpin.errors import InvalidInputError

FORMATS = ("urdf", "sdf", "mjcf", "toolbox")
_SUFFIXES = {
    ".urdf": "urdf",
    ".sdf": "sdf",
    ".xml": "mjcf",
    ".mjcf": "mjcf",
    ".yaml": "toolbox",
    ".yml": "toolbox",
}


def write_description(description: MechanismDescription, path: str | Path, format: str | None = None) -> None:
    """Write a description as a file that `ccpin.load` and the format's own tools read.

    Args:
        description: What to write.
        path: The file; its suffix tells the format where `format` does not (.urdf, .sdf, .xml, .yaml).
        format: ``"urdf"`` (with URDF+ loops), ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` (robot.yaml with its robot.urdf).

    Raises:
        InvalidInputError: The format is none of these, or the file cannot be written.
        DescriptionError: The format has no words for something, by name.
    """
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
    wanted = _SUFFIXES.get(Path(path).suffix.lower()) if format is None else format
    writers = _writers()
    if not isinstance(wanted, str) or wanted not in writers:
        told = f"format {format!r:.80}" if format is not None else f"the suffix of '{path}'"
        raise InvalidInputError(f"{told} names none of {', '.join(writers)}; say format=")
    writers[wanted](description, path)


def _writers() -> dict[str, Callable[[MechanismDescription, str | Path], None]]:
    from ccpin.description.writers.mjcf import write_mjcf
    from ccpin.description.writers.sdf import write_sdf
    from ccpin.description.writers.toolbox import write_toolbox
    from ccpin.description.writers.urdf import write_urdf

    return {"urdf": write_urdf, "sdf": write_sdf, "mjcf": write_mjcf, "toolbox": write_toolbox}
