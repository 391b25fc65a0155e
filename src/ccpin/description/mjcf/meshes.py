"""Mesh assets of MJCF files: where they are, and the mass properties of the solids or shells they enclose."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array
from ccpin.description.elements.meshes import LARGEST
from ccpin.description.elements.xml import ZERO, source_of
from ccpin.description.mjcf.defaults import Compiler
from ccpin.description.mjcf.element import Element
from ccpin.description.model import Inertia, frame

_READABLE = (".msh", ".obj", ".stl")
_MOST_NUMBERS = 10_000_000  # of a mesh written into the file: bounds time and memory
_THINNEST = 1e-9  # volume or area by the mesh's size to the third or second power
_WAYS = ("legacy", "exact", "convex", "shell")


@dataclass(frozen=True, eq=False)
class MeshAsset:
    """A mesh file and how its vertices v become those of the geom, A v + b.

    Attributes:
        file: The file found, or as written where there is none; empty where the vertices are in the model.
        scale: MuJoCo's scale.
        placement: The frame (4, 4) of the scaled file in the geom's frame; ``None`` where no rigid frame exists
            (a reference orientation with unequal scales).
        matrix: A = S Rᵀ (3, 3).
        shift: b = −S Rᵀ p (3,).
        way: MuJoCo's word for what has mass: "legacy", "exact", "convex" or "shell".
    """

    said: Element
    file: str
    scale: tuple[float, ...]
    placement: Array | None
    matrix: Array
    shift: Array
    way: str

    @cached_property
    def solid(self) -> Inertia:
        """Mass, centre and inertia at density one, in the geom's frame; computed when first asked for.

        Raises:
            DescriptionError: The file cannot be read, or what it holds has no mass in the way the asset asks for.
        """
        corners, closed = self._corners()
        size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        if self.way == "exact" and not closed:
            raise self._fail("its surface is not closed, so it has no exact inertia; say inertia convex or shell")
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(across, axis=1) / 2.0
        if not areas.sum() > _THINNEST * size**2:
            raise self._fail("its faces have no area")
        middle = areas @ corners.mean(axis=1) / areas.sum()
        share = 3.0 if self.way == "shell" else 4.0
        rough = self._weights(corners - middle, areas)
        least = _THINNEST * size ** (share - 1.0)
        if not rough.sum() > least:
            raise self._fail(f"its volume is {rough.sum():.3g} m³; the faces should look outwards around a solid")
        com = middle + rough @ (corners - middle).sum(axis=1) / share / rough.sum()
        arms = corners - com
        weights = self._weights(arms, areas)
        sums = arms.sum(axis=1)
        second = np.einsum("f,fvi,fvj->ij", weights, arms, arms) + np.einsum("f,fi,fj->ij", weights, sums, sums)
        second /= share * (share + 1.0)
        return Inertia(float(weights.sum()), com, np.trace(second) * np.eye(3) - second)

    def _weights(self, corners: Array, areas: Array) -> Array:
        """The faces' areas, or the volumes of the tetrahedra they span with the origin: signed but for "legacy"."""
        if self.way == "shell":
            return areas
        volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        return np.asarray(np.abs(volumes) if self.way == "legacy" else volumes)

    def _corners(self) -> tuple[Array, bool]:
        """The triangles' corners (faces, 3, 3) in the geom's frame, and whether they close a surface."""
        mesh = self._written() if self.said.text("vertex") else self._from_file()
        try:
            mesh.merge_vertices(merge_tex=True, merge_norm=True)
            mesh = mesh.convex_hull if self.way == "convex" or not len(mesh.faces) else mesh
            corners, closed = np.array(mesh.triangles, dtype=np.float64), bool(mesh.is_watertight)
        except MemoryError:
            raise
        except Exception as error:  # Qhull raises whatever it does
            raise self._unreadable(error) from None
        if corners.size == 0 or not np.isfinite(corners).all():
            raise self._fail("it holds no triangles, or corners that are no numbers")
        corners = corners @ self.matrix.T + self.shift
        return (corners[:, ::-1] if np.linalg.det(self.matrix) < 0.0 else corners), closed

    def _from_file(self) -> Any:
        """A trimesh of the file; one without faces stands for its convex hull."""
        import trimesh

        file = Path(self.file)
        if file.suffix.lower() not in _READABLE:
            raise self._fail(f"its inertia can be read from {' and '.join(_READABLE)} files only")
        if not _is_file(file):
            raise self._fail("there is no such file")
        try:
            if file.stat().st_size > LARGEST:
                raise self._fail(f"it has more than {LARGEST / 1e6:.0f} MB")
            if file.suffix.lower() == ".msh":
                return trimesh.Trimesh(*_msh(file.read_bytes()), process=False)
            if file.suffix.lower() == ".obj" and not re.search(rb"^\s*f\s", content := file.read_bytes(), re.MULTILINE):
                corners = [line.split()[1:4] for line in content.splitlines() if line.split()[:1] == [b"v"]]
                return trimesh.Trimesh(np.array(corners, dtype=np.float64).reshape(-1, 3), process=False)
            return trimesh.load(file, force="mesh", process=False, skip_materials=True)
        except MemoryError:
            raise
        except Exception as error:  # trimesh's loaders raise whatever their parsers do
            raise self._unreadable(error) from None

    def _written(self) -> Any:
        """A trimesh of the vertices and faces written into the model."""
        import trimesh

        vertices, faces = (self.said.some_numbers(name, _MOST_NUMBERS) for name in ("vertex", "face"))
        if len(vertices) % 3 or len(faces) % 3:
            raise self._fail("its vertex and face should come in threes")
        corners = np.array(faces).reshape(-1, 3)
        if not (np.all(corners >= 0) and np.all(corners < len(vertices) // 3) and np.all(corners % 1.0 == 0.0)):
            raise self._fail(f"its faces should be whole numbers from 0 to {len(vertices) // 3 - 1}")
        return trimesh.Trimesh(np.array(vertices).reshape(-1, 3), corners.astype(np.int64), process=False)

    def _unreadable(self, error: Exception) -> Exception:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        return self._fail(f"it cannot be read: {reason[:120]}")

    def _fail(self, reason: str) -> Exception:
        name = Path(self.file).name or self.said.text("name") or ""
        return self.said.fail(f"mesh {name[:120]!r}: {reason}; or give the body an <inertial> element")


def _msh(content: bytes) -> tuple[Array, NDArray[np.int32]]:
    """Vertices and faces of MuJoCo's own binary format: four counts, then 32-bit floats and face indices.

    Raises:
        ValueError: The counts and the size disagree, or a face names no vertex.
    """
    counts = np.frombuffer(content[:16], dtype="<i4")
    vertices, normals, texcoords, faces = (int(count) for count in counts)
    floats = 3 * vertices + 3 * normals + 2 * texcoords
    if min(counts) < 0 or len(content) != 16 + 4 * (floats + 3 * faces):
        raise ValueError("its counts of vertices and faces disagree with its size")
    corners = np.frombuffer(content, dtype="<f4", count=3 * vertices, offset=16).reshape(-1, 3)
    indices = np.frombuffer(content, dtype="<i4", count=3 * faces, offset=16 + 4 * floats).reshape(-1, 3)
    if faces and not (indices.min() >= 0 and indices.max() < vertices):
        raise ValueError("a face names a vertex that is not there")
    return corners.astype(np.float64), indices


def read_mesh(said: Element, file: str, compiler: Compiler) -> MeshAsset:
    """Resolve the file; MuJoCo's vertices are S Rᵀ (v − p) with reference pose (R, p) and scale S.

    Raises:
        DescriptionError: A number or the word for the inertia is wrong.
    """
    path = Path(Path(file).name if compiler.strip_path else file)
    found = Path(source_of(said.xml) or "").parent / compiler.mesh_folder / path
    turn = said.quaternion(said.vector("refquat", 4, (1.0, 0.0, 0.0, 0.0)), "refquat").T
    scale = said.vector("scale", 3, (1.0, 1.0, 1.0))
    place = said.vector("refpos", 3, ZERO)
    shift = -scale * (turn @ place)
    rigid = bool(np.all(scale == scale[0]) or np.allclose(turn, np.eye(3), atol=1e-12, rtol=0.0))
    return MeshAsset(
        said=said,
        file=str(found.resolve()) if file and _is_file(found) else file,
        scale=tuple(scale.tolist()),
        placement=frame(shift, turn) if rigid else None,
        matrix=np.diag(scale) @ turn,
        shift=shift,
        way=said.choice("inertia", _WAYS, compiler.mesh_inertia),
    )


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
