"""Mesh assets of MJCF files: where they are, and the mass properties of the solids or shells they enclose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ccpin.arrays import Array
from ccpin.description.mjcf.defaults import Compiler
from ccpin.description.mjcf.element import Element
from ccpin.description.model import Inertia, frame
from ccpin.description.xml import ZERO, source_of

_READABLE = (".obj", ".stl")
_LARGEST = 500_000_000  # bytes of a mesh file
_THINNEST = 1e-9  # volume or area by the mesh's size to the third or second power
_WAYS = ("legacy", "exact", "convex", "shell")


@dataclass(frozen=True, eq=False)
class MeshAsset:
    """A mesh file and how its vertices v become those of the geom, A v + b.

    Attributes:
        file: The file found, or as written where there is none.
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
        weights, share = self._weights(corners - middle, areas), 3.0 if self.way == "shell" else 4.0
        least = _THINNEST * size ** (share - 1.0)
        if not weights.sum() > least:
            raise self._fail(f"its volume is {weights.sum():.3g} m³; the faces should look outwards around a solid")
        com = middle + weights @ (corners - middle).sum(axis=1) / share / weights.sum()
        corners = corners - com
        weights = self._weights(corners, areas)
        sums = corners.sum(axis=1)
        second = np.einsum("f,fvi,fvj->ij", weights, corners, corners) + np.einsum("f,fi,fj->ij", weights, sums, sums)
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
        import trimesh

        file = Path(self.file)
        if file.suffix.lower() not in _READABLE:
            raise self._fail(f"its inertia can be read from {' and '.join(_READABLE)} files only")
        if not _is_file(file):
            raise self._fail("there is no such file")
        try:
            if file.stat().st_size > _LARGEST:
                raise self._fail(f"it has more than {_LARGEST / 1e6:.0f} MB")
            mesh = trimesh.load(file, force="mesh", process=False, skip_materials=True)
            mesh.merge_vertices(merge_tex=True, merge_norm=True)
            mesh = mesh.convex_hull if self.way == "convex" else mesh
            corners, closed = np.array(mesh.triangles, dtype=np.float64), bool(mesh.is_watertight)
        except MemoryError:
            raise
        except Exception as error:  # trimesh's loaders and Qhull raise whatever their parsers do
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise self._fail(f"it cannot be read: {reason[:120]}") from None
        if corners.size == 0 or not np.isfinite(corners).all():
            raise self._fail("it holds no triangles, or corners that are no numbers")
        corners = corners @ self.matrix.T + self.shift
        return (corners[:, ::-1] if np.linalg.det(self.matrix) < 0.0 else corners), closed

    def _fail(self, reason: str) -> Exception:
        return self.said.fail(f"mesh {Path(self.file).name[:120]!r}: {reason}; or give the body an <inertial> element")


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
        file=str(found.resolve()) if _is_file(found) else file,
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
