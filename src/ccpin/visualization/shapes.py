"""Shapes as points to frame and as MeshCat geometries: one entry a kind, plus meshes and tubes along a curve."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ccpin.arrays import Array, frozen
from ccpin.description.elements.meshes import LARGEST, SUFFIXES, is_mesh
from ccpin.description.model import Shape, frame

MAX_FACES_SMOOTHED = 50_000  # meshes of more keep the shading of their faces: smoothing takes long
ROUGHNESS = 0.5  # of painted metal
METALNESS = 0.15  # of the same, slightly glossy
SIDES, RINGS = 24, 12
"""Facets of a ball: around and from pole to pole."""
Z_TO_Y: Array = frozen([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # MeshCat's cylinders lie along y


class Triangles(NamedTuple):
    """A triangle mesh: vertices (V, 3) in metres, faces (F, 3) of vertex indices."""

    vertices: Array
    faces: NDArray[np.int64]


Form: TypeAlias = "Shape | Triangles"
"""What is drawn: a shape that a file describes, or triangles made here."""


class ShapePart(NamedTuple):
    """A MeshCat geometry and the 4×4 frame of its own axes in the shape's frame."""

    geometry: Any
    placement: Array


@lru_cache(maxsize=64)
def read_mesh(path: str) -> Triangles | str:
    """Read a mesh file (obj, stl, dae, …) with trimesh; a string says why it cannot be drawn.

    Vertices shared across sharp edges are doubled, so that the renderer's vertex normals keep those edges.
    """
    import trimesh

    if not is_mesh(Path(path)):
        known = f"no regular file of one of the kinds drawn ({', '.join(SUFFIXES)}; {LARGEST / 1e6:.0f} MB at most)"
        return f"mesh '{path}' is not there, or {known}; it is left out of the picture"
    try:
        mesh = trimesh.load(path, force="mesh", skip_materials=True)
        if 0 < len(mesh.faces) <= MAX_FACES_SMOOTHED:
            mesh = trimesh.graph.smooth_shade(mesh, angle=np.pi / 6)
    except Exception as error:  # trimesh's loaders raise whatever their parsers do; a picture must not fail for that
        return f"mesh '{path}' cannot be read ({type(error).__name__}: {error}); it is left out of the picture"
    if len(mesh.faces) == 0:
        return f"mesh '{path}' has no faces; it is left out of the picture"
    return Triangles(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))


def missing(shape: Form) -> str | None:
    """Why a shape cannot be drawn, in a sentence, or ``None`` if it can."""
    if isinstance(shape, Triangles) or shape.kind != "mesh":
        return None
    mesh = read_mesh(shape.mesh or "")
    return mesh if isinstance(mesh, str) else None


def corners(shape: Form) -> Array:
    """The eight corners (8, 3) of the smallest box along the shape's axes that holds it."""
    if isinstance(shape, Triangles):
        return _box(shape.vertices)
    size = shape.size
    if shape.kind == "mesh":
        mesh = read_mesh(shape.mesh or "")
        if isinstance(mesh, str):
            return np.zeros((0, 3))
        points = mesh.vertices * np.array(size)
    elif shape.kind == "box":
        points = np.array([size, np.negative(size)]) / 2
    elif shape.kind in ("cylinder", "capsule"):
        half = [size[0], size[0], size[1] / 2 + (size[0] if shape.kind == "capsule" else 0.0)]
        points = np.array([half, np.negative(half)])
    else:
        points = np.array([np.ones(3), -np.ones(3)]) * size
    return _box(points)


def _box(points: Array) -> Array:
    return np.array(list(product(*zip(points.min(axis=0), points.max(axis=0), strict=True))))


def parts(shape: Form) -> list[ShapePart]:
    """The MeshCat geometries a shape is made of (MeshCat's cylinders lie along y, a description's along z)."""
    import meshcat.geometry as g

    if isinstance(shape, Triangles):
        return [ShapePart(triangles(shape), np.eye(4))]
    size = shape.size
    if shape.kind == "box":
        return [ShapePart(g.Box(list(size)), np.eye(4))]
    if shape.kind == "cylinder":
        return [ShapePart(g.Cylinder(size[1], size[0]), Z_TO_Y)]
    if shape.kind == "capsule":
        ends = [ShapePart(g.Sphere(size[0]), frame([0.0, 0.0, sign * size[1] / 2])) for sign in (-1.0, 1.0)]
        return [ShapePart(g.Cylinder(size[1], size[0]), Z_TO_Y), *ends]
    if shape.kind == "sphere":
        return [ShapePart(g.Sphere(size[0]), np.eye(4))]
    if shape.kind == "ellipsoid":
        return [ShapePart(g.Ellipsoid(list(size)), np.eye(4))]
    mesh = read_mesh(shape.mesh or "")
    if isinstance(mesh, str):
        return []
    return [ShapePart(triangles(Triangles(mesh.vertices * np.array(size), mesh.faces)), np.eye(4))]


def triangles(mesh: Triangles) -> Any:
    """A triangle mesh as a MeshCat geometry."""
    import meshcat.geometry as g

    return g.TriangularMeshGeometry(mesh.vertices, mesh.faces)


def material(rgba: tuple[float, float, float, float]) -> Any:
    """A physically based MeshCat material of a colour with components in [0, 1]: painted metal, slightly glossy."""
    import meshcat.geometry as g

    class Standard(g.GenericMaterial):  # type: ignore[misc]
        _type = "MeshStandardMaterial"

    red, green, blue, alpha = (float(np.clip(c, 0.0, 1.0)) for c in rgba)
    colour = (round(255 * red) << 16) | (round(255 * green) << 8) | round(255 * blue)
    return Standard(color=colour, opacity=alpha, roughness=ROUGHNESS, metalness=METALNESS)


def hull(points: Array, radii: Array) -> Triangles:
    """The convex hull of balls at points (N, 3) with radii (N,): a tapered rod of two, a rounded plate of more."""
    around, along = np.meshgrid(2 * np.pi * np.arange(SIDES) / SIDES, np.pi * np.arange(1, RINGS) / RINGS)
    sphere = np.stack([np.sin(along) * np.cos(around), np.sin(along) * np.sin(around), np.cos(along)], axis=-1)
    directions = np.concatenate([sphere.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    turned = directions @ _principal(points).T
    found = ConvexHull((points[:, None] + radii[:, None, None] * turned).reshape(-1, 3))
    used, faces = np.unique(found.simplices, return_inverse=True)
    vertices, faces = found.points[used], faces.reshape(-1, 3)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Triangles(vertices, faces)


def _principal(points: Array) -> Array:
    """Orthonormal axes (columns), the last along the points' longest extent, so that rods have even facets."""
    _, _, rows = np.linalg.svd(points - points.mean(axis=0))
    return np.asarray(rows[::-1].T)


class TubeMesh(NamedTuple):
    """A tube along a polyline.

    Attributes:
        mesh: Its triangles, in the polyline's order.
        ends: How many of the mesh's vertex indices lead up to each point of the polyline, of shape (N,).
    """

    mesh: Triangles
    ends: NDArray[np.int64]


def tube(points: Array, radius: float, sides: int = 8) -> TubeMesh | None:
    """An open-ended tube of `radius` (m) along a polyline of points (N, 3); ``None`` where it has no length.

    Each ring is the previous one turned by the smallest rotation between the two tangents.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = np.concatenate([[True], steps > 1e-3 * radius])
    points = points[kept]
    if len(points) < 2:
        return None
    tangents = np.gradient(points, axis=0)
    lengths = np.linalg.norm(tangents, axis=1)
    tangents[lengths < 1e-12] = tangents[0] if lengths[0] > 1e-12 else [1.0, 0.0, 0.0]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normal = np.cross(tangents[0], np.eye(3)[int(np.argmin(np.abs(tangents[0])))])
    angles = 2 * np.pi * np.arange(sides) / sides
    rings = []
    for point, tangent in zip(points, tangents, strict=True):
        across = normal - (normal @ tangent) * tangent
        if np.linalg.norm(across) < 1e-9:
            across = np.cross(tangent, np.eye(3)[int(np.argmin(np.abs(tangent)))])
        normal = across / np.linalg.norm(across)
        binormal = np.cross(tangent, normal)
        rings.append(point + radius * (np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), binormal)))
    # two triangles to each side of each ring: its vertex, the next one round, and the same two of the next ring
    first = np.arange(sides * (len(points) - 1))
    turned = first - first % sides + (first + 1) % sides
    pairs = np.stack([first, turned, first + sides, turned, turned + sides, first + sides], 1)
    return TubeMesh(
        Triangles(np.concatenate(rings), pairs.reshape(-1, 3)), 6 * sides * np.maximum(np.cumsum(kept) - 1, 0)
    )
