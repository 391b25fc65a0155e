"""Finding the mesh files a description names, and putting them beside a file that is written."""

from __future__ import annotations

import filecmp
import os
import shutil
from dataclasses import replace
from itertools import chain, count
from pathlib import Path

from ccpin.description.model import MechanismDescription
from ccpin.errors import InvalidInputError

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


def with_meshes_beside(description: MechanismDescription, path: Path) -> MechanismDescription:
    """The description with its mesh files below the folder of a file that is to be written, and named from there.

    A file that lies there already stays; others are copied into ``meshes``, two of one name under different ones. What
    is not found keeps its name.

    Raises:
        InvalidInputError: A file cannot be copied.
    """
    names: dict[str, str] = {}
    shapes = [visual.shape for link in description.links for visual in link.visuals]
    for mesh in dict.fromkeys(shape.mesh for shape in shapes if shape.mesh):
        if is_mesh(Path(mesh)):
            try:
                names[mesh] = _beside(Path(mesh).resolve(), path.resolve().parent)
            except OSError as error:
                raise InvalidInputError(f"'{mesh}' cannot be copied beside '{path}': {error.strerror}") from error
    links = tuple(
        replace(
            link,
            visuals=tuple(
                replace(visual, shape=replace(visual.shape, mesh=names[visual.shape.mesh]))
                if visual.shape.mesh in names
                else visual
                for visual in link.visuals
            ),
        )
        for link in description.links
    )
    return replace(description, links=links)


def _beside(mesh: Path, folder: Path) -> str:
    """The name from a folder of a mesh file, or of its copy there."""
    if mesh.is_relative_to(folder):
        return mesh.relative_to(folder).as_posix()
    names = chain([mesh.name], (f"{mesh.stem}_{k}{mesh.suffix}" for k in count(2)))
    for target in (folder / "meshes" / name for name in names):
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(mesh, target)
            return target.relative_to(folder).as_posix()
        if target.is_file() and filecmp.cmp(mesh, target, shallow=False):
            return target.relative_to(folder).as_posix()
    raise AssertionError("names do not end")
