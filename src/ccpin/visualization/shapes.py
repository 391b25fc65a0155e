"""Shapes as points to frame and as MeshCat geometries: one entry a kind, plus meshes and tubes along a curve."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, frozen
from ccpin.description.model import Shape, frame

MAX_FACES_SMOOTHED = 50_000
Z_TO_Y: Array = frozen([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


class Triangles(NamedTuple):
    """A triangle mesh: vertices (V, 3) in metres, faces (F, 3) of vertex indices."""

    vertices: Array
    faces: NDArray[np.int64]


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

    if not Path(path).is_file():
        return f"mesh '{path}' is not there; it is left out of the picture"
    try:
        mesh = trimesh.load(path, force="mesh")
        if 0 < len(mesh.faces) <= MAX_FACES_SMOOTHED:
            mesh = trimesh.graph.smooth_shade(mesh, angle=np.pi / 6)
    except Exception as error:  # trimesh's loaders raise whatever their parsers do; a picture must not fail for that
        return f"mesh '{path}' cannot be read ({type(error).__name__}: {error}); it is left out of the picture"
    if len(mesh.faces) == 0:
        return f"mesh '{path}' has no faces; it is left out of the picture"
    return Triangles(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))


def missing(shape: Shape) -> str | None:
    """Why a shape cannot be drawn, in a sentence, or ``None`` if it can."""
    if shape.kind != "mesh":
        return None
    mesh = read_mesh(shape.mesh or "")
    return mesh if isinstance(mesh, str) else None


def corners(shape: Shape) -> Array:
    """The eight corners (8, 3) of the smallest box along the shape's axes that holds it."""
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
    return np.array(list(product(*zip(points.min(axis=0), points.max(axis=0), strict=True))))


def parts(shape: Shape) -> list[ShapePart]:
    """The MeshCat geometries a shape is made of (MeshCat's cylinders lie along y, a description's along z)."""
    import meshcat.geometry as g

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
    """A slightly glossy MeshCat material of a colour with components in [0, 1]."""
    import meshcat.geometry as g

    red, green, blue, alpha = (float(np.clip(c, 0.0, 1.0)) for c in rgba)
    colour = (round(255 * red) << 16) | (round(255 * green) << 8) | round(255 * blue)
    return g.MeshPhongMaterial(color=colour, opacity=alpha, shininess=40, specular=0x333333)


def tube(points: Array, radius: float, sides: int = 8) -> Triangles | None:
    """An open-ended tube of `radius` (m) along a polyline of points (N, 3); ``None`` where it has no length.

    Each ring is the previous one turned by the smallest rotation between the two tangents.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate([[True], steps > 1e-3 * radius])]
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
        kept = normal - (normal @ tangent) * tangent
        if np.linalg.norm(kept) < 1e-9:
            kept = np.cross(tangent, np.eye(3)[int(np.argmin(np.abs(tangent)))])
        normal = kept / np.linalg.norm(kept)
        binormal = np.cross(tangent, normal)
        rings.append(point + radius * (np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), binormal)))
    first = np.arange(sides * (len(points) - 1))
    turned = first - first % sides + (first + 1) % sides
    faces = np.concatenate(
        [np.stack([first, turned, first + sides], 1), np.stack([turned, turned + sides, first + sides], 1)]
    )
    return Triangles(np.concatenate(rings), faces)
