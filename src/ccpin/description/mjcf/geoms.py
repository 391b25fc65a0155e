"""MJCF geoms: the solids bodies are made of, as shapes to draw and as masses."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.xml import Colour, XmlElement
from ccpin.description.mjcf.defaults import Compiler, Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.meshes import MeshAsset, read_mesh
from ccpin.description.model import Inertia, Shape, Visual

Kind = Literal["sphere", "capsule", "cylinder", "ellipsoid", "box"]
Axes = tuple[float, float, float]
_SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}  # numbers of `size` that a solid needs
_SURFACES = ("plane", "hfield")
_MESHES = ("mesh", "sdf")
_TYPES = (*_SIZES, *_SURFACES, *_MESHES)
_LEAST = 1e-30  # m, whose third power is a volume yet
_ELONGATED = ("capsule", "cylinder", "ellipsoid", "box")


@dataclass(frozen=True)
class Assets:
    """Meshes by name (``None`` for one without a file), and colours of materials by name."""

    meshes: dict[str, MeshAsset | None]
    materials: dict[str, Colour | None]


@dataclass(frozen=True, eq=False)
class Geom:
    """A geom as read.

    Attributes:
        kind: The primitive, or ``None`` where a mesh file decides the shape or there is no volume.
        size: The primitive's half sizes in MuJoCo's order.
        placement: Its frame (4, 4) in the body's frame.
        mesh: Name of the mesh asset it refers to.
        drawn_mesh: Whether it is that mesh, rather than a primitive fitted to it.
    """

    element: Element
    kind: Kind | None
    size: tuple[float, ...]
    placement: Array
    mesh: str | None
    drawn_mesh: bool


def read_assets(sections: Iterable[XmlElement], defaults: Defaults, compiler: Compiler) -> Assets:
    """Read the meshes and materials of the ``<asset>`` sections.

    Raises:
        DescriptionError: An asset has no name, or a number in it is wrong.
    """
    assets = Assets({}, {})
    for section in sections:
        for xml in section.iterchildren("mesh"):
            said = defaults.resolve(xml)
            file = said.text("file")
            name = said.text("name") or (Path(file).stem if file else None)
            if name is None:
                raise said.fail("a mesh needs a name or a file")
            known = file or said.text("vertex")
            assets.meshes[name] = read_mesh(said, file or "", compiler) if known else None
        for xml in section.iterchildren("material"):
            said = defaults.resolve(xml)
            assets.materials[said.required("name")] = _rgba(said)
    return assets


def _rgba(said: Element) -> Colour | None:
    if "rgba" not in said.values:
        return None
    return cast(Colour, tuple(np.clip(said.vector("rgba", 4), 0.0, 1.0).tolist()))


def read_geom(said: Element, offset: Array, compiler: Compiler, assets: Assets) -> Geom:
    """Read one geom; `offset` (4, 4) is the frame its pose refers to, in the body's frame.

    Raises:
        DescriptionError: Its type, its sizes, its pose or the mesh it names is wrong.
    """
    kind = said.choice("type", _TYPES, "sphere")
    mesh = said.text("mesh")
    if mesh is not None and mesh not in assets.meshes:
        raise said.fail(f"there is no mesh '{mesh}' among the assets")
    if kind in _MESHES and mesh is None:
        raise said.fail(f"a geom of type {kind} needs the attribute 'mesh'")
    solid = kind in _SIZES and mesh is None
    if not solid:
        return Geom(said, None, (), offset @ said.pose(compiler.angles), mesh, kind in _MESHES)
    size, placement = _size_and_pose(said, kind, compiler)
    return Geom(said, cast(Kind, kind), size, offset @ placement, None, False)


def _size_and_pose(said: Element, kind: str, compiler: Compiler) -> tuple[tuple[float, ...], Array]:
    sizes = said.some_numbers("size", 3)
    spans = "fromto" in said.values
    if spans and kind not in _ELONGATED:
        raise said.fail(f"fromto goes with {', '.join(_ELONGATED)}, not with {kind}")
    needed = 1 if spans else _SIZES[kind]
    if len(sizes) < needed or min(sizes[:needed]) < _LEAST:
        raise said.fail(f"size of a {kind} should be {needed} positive number(s) here, {_LEAST:g} or more")
    if not spans:
        return sizes[:needed], said.pose(compiler.angles)
    placement, half = said.span()
    return (sizes[0],) * (_SIZES[kind] - 1) + (half,), placement


def geom_inertia(geom: Geom, assets: Assets) -> Inertia:
    """Return mass, centre and inertia of a solid or mesh geom in the body's frame (MuJoCo's formulas).

    Raises:
        DescriptionError: The mass or density is negative, the geom is a shell, or its mesh gives no inertia.
    """
    said, turn = geom.element, geom.placement[:3, :3]
    if said.flag("shellinertia", False):
        raise said.fail("shellinertia is not supported; give the body an <inertial> element")
    if geom.kind is not None:
        volume, diagonal = _PRIMITIVES[geom.kind](*geom.size)
        about, com = np.diag(diagonal), np.zeros(3)
    else:
        solid = _solid(geom, assets)
        volume, about, com = solid.mass, solid.rotational / solid.mass, solid.com
    mass = said.number("mass", said.number("density", 1000.0) * volume)
    if mass < 0.0:
        raise said.fail("mass and density should not be negative")
    return Inertia(mass, turn @ com + geom.placement[:3, 3], mass * turn @ about @ turn.T)


def _solid(geom: Geom, assets: Assets) -> Inertia:
    """What a mesh encloses; ccpin does not fit primitives to meshes, nor make MuJoCo's own."""
    asset = assets.meshes[geom.mesh] if geom.mesh else None
    if asset is None or not geom.drawn_mesh:
        what = "a primitive fitted to" if asset else "what MuJoCo makes for"
        raise geom.element.fail(
            f"its inertia would come from {what} the mesh '{geom.mesh}', which ccpin does not make; give the body "
            "an <inertial> element"
        )
    return asset.solid


def weighs_nothing(geom: Geom) -> bool:
    """Whether the geom says itself that it has no mass, so that its shape does not matter."""
    said = geom.element
    return said.number("mass", said.number("density", 1000.0)) == 0.0


def _capsule(radius: float, half: float) -> tuple[float, Axes]:
    """A cylinder of length h and two half spheres; each part weighted by its share of the volume."""
    length = 2.0 * half
    ball, tube = 4.0 / 3.0 * np.pi * radius**3, np.pi * radius**2 * length
    w_ball, w_tube = ball / (ball + tube), tube / (ball + tube)
    across = w_tube * (3.0 * radius**2 + length**2) / 12.0
    across += w_ball * (0.4 * radius**2 + 0.375 * radius * length + 0.25 * length**2)
    return ball + tube, (across, across, (0.5 * w_tube + 0.4 * w_ball) * radius**2)


def _cylinder(radius: float, half: float) -> tuple[float, Axes]:
    length = 2.0 * half
    across = (3.0 * radius**2 + length**2) / 12.0
    return np.pi * radius**2 * length, (across, across, 0.5 * radius**2)


def _squares(a: float, b: float, c: float, share: float) -> Axes:
    return (b**2 + c**2) / share, (a**2 + c**2) / share, (a**2 + b**2) / share


_PRIMITIVES: dict[str, Callable[..., tuple[float, Axes]]] = {
    "sphere": lambda radius: (4.0 / 3.0 * np.pi * radius**3, (0.4 * radius**2,) * 3),
    "capsule": _capsule,
    "cylinder": _cylinder,
    "ellipsoid": lambda a, b, c: (4.0 / 3.0 * np.pi * (a * b * c), _squares(a, b, c, 5.0)),
    "box": lambda a, b, c: (8.0 * (a * b * c), _squares(a, b, c, 3.0)),
}
"""Volume and principal moments per unit mass, from the half sizes."""


def geom_visual(geom: Geom, assets: Assets) -> Visual | None:
    """Return what to draw; ``None`` for planes, height fields and meshes without a file of their own."""
    said = geom.element
    material = said.text("material")
    if material is not None and material not in assets.materials:
        raise said.fail(f"there is no material '{material}' among the assets")
    rgba = _rgba(said) or (assets.materials[material] if material else None) or Visual.rgba
    if geom.kind is not None:
        return Visual(Shape(geom.kind, _drawn_size(geom.kind, geom.size)), geom.placement, rgba)
    asset = assets.meshes[geom.mesh] if geom.mesh else None
    if not geom.drawn_mesh or asset is None or not asset.file or asset.placement is None:
        return None
    return Visual(Shape("mesh", asset.scale, asset.file), geom.placement @ asset.placement, rgba)


def _drawn_size(kind: Kind, size: tuple[float, ...]) -> tuple[float, ...]:
    if kind == "box":
        return tuple(2.0 * half for half in size)
    return (size[0], 2.0 * size[1]) if kind in ("capsule", "cylinder") else size
