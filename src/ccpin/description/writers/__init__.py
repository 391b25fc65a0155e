"""Descriptions out again: one writer a format, chosen by name or by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from ccpin.description.model import MechanismDescription
from ccpin.errors import CcpinError, InvalidInputError

FORMATS = ("urdf", "sdf", "mjcf", "toolbox")
_SUFFIXES = {
    ".urdf": "urdf",
    ".sdf": "sdf",
    ".xml": "mjcf",
    ".mjcf": "mjcf",
    ".yaml": "toolbox",
    ".yml": "toolbox",
}


def write_description(
    description: MechanismDescription, path: str | Path, format: str | None = None
) -> tuple[str, ...]:
    """Write a description as a file that `ccpin.load` and the format's own tools read.

    Args:
        description: What to write.
        path: The file; its suffix tells the format where `format` does not (.urdf, .sdf, .xml, .yaml).
        format: ``"urdf"`` (with URDF+ loops), ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` (robot.yaml with its robot.urdf).

    Returns:
        What the description states and the format has no place for, in sentences.

    Raises:
        InvalidInputError: The format is none of these, or the file cannot be written.
        DescriptionError: The format has no words for something, by name.
        CcpinError: A library that writes the format does not load.
    """
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
    wanted = _SUFFIXES.get(Path(path).suffix.lower()) if format is None else format
    if not isinstance(wanted, str) or wanted not in FORMATS:
        told = f"format {format!r:.80}" if format is not None else f"the suffix of '{path}'"
        raise InvalidInputError(f"{told} names none of {', '.join(FORMATS)}; say format=")
    return _writer(wanted)(description, path)


def _writer(wanted: str) -> Callable[[MechanismDescription, str | Path], tuple[str, ...]]:
    """What writes a format.

    Raises:
        CcpinError: A library that it stands on does not load.
    """
    try:
        found: Callable[..., tuple[str, ...]] = getattr(import_module(f"{__name__}.{wanted}"), f"write_{wanted}")
    except ImportError as error:
        raise CcpinError(f"what writes {wanted} files does not load ({error}): install that package anew") from error
    return found
