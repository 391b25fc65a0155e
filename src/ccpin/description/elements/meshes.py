"""Finding the mesh files a description names."""

from __future__ import annotations

import os
from pathlib import Path

SUFFIXES = (".stl", ".obj", ".dae", ".ply", ".off", ".msh")
"""What a mesh file's name ends in, in any letter case; no other file is opened for its geometry."""
LARGEST = 500_000_000
"""Bytes of the largest mesh file that is opened."""
_ABOVE = 4  # folders above the file's own


def find_mesh(name: str, source: str | None) -> Path | None:
    """Resolve a mesh's file name: absolute, or next to the source file or one of the four folders above it.

    It is plain, or stands behind ``file://``, ``package://`` or ``model://``. Only a regular file with one of the
    `SUFFIXES` is found, and a name that is not absolute never leads out of the topmost of those folders.
    """
    if not name or "\0" in name or source is None:
        return None
    folder = Path(source).resolve().parent
    bases = (folder, *folder.parents[:_ABOVE])
    plain = name.split("://", 1)[-1].lstrip("/") if "://" in name else name
    beside = [Path(os.path.normpath(base / plain)) for base in bases]
    candidates = [path for path in beside if path.is_relative_to(bases[-1])]
    if name.startswith(("/", "file:///")):
        candidates.insert(0, Path(name.removeprefix("file://")))
    try:
        return next((path.resolve() for path in candidates if is_mesh(path)), None)
    except OSError:
        return None


def is_mesh(path: Path) -> bool:
    """Whether a path is a regular file that may be opened for its geometry; a name no file can have is none."""
    try:
        return path.suffix.lower() in SUFFIXES and path.is_file() and path.stat().st_size <= LARGEST
    except (OSError, ValueError):
        return False
