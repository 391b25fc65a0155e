"""Mass and inertia of MJCF bodies: as written, from their geoms, bounded, balanced and scaled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.xml import ZERO
from ccpin.description.mjcf.defaults import Compiler
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.geoms import Assets, Geom, geom_inertia, weighs_nothing
from ccpin.description.mjcf.schema import ORIENTATIONS
from ccpin.description.model import Inertia, Link

_SLACK = 1e-9  # relative: rounding of principal moments
_NOTHING = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))  # of a body without mass


def body_inertia(
    body: Element,
    inertial: Element | None,
    stands: Array,
    geoms: Sequence[Geom],
    assets: Assets,
    compiler: Compiler,
    moves: bool,
) -> Inertia | None:
    """Return a body's inertia in its frame, from its ``<inertial>`` or its geoms as the compiler settings decide.

    It is ``None`` where the body has neither mass nor inertia. `stands` is the frame (4, 4) in the body that the
    ``<inertial>`` is stated in; `moves` says whether the body can move: the mass of one that cannot matters to nobody.

    Raises:
        DescriptionError: The numbers are no inertia of a solid, or a mesh that has to give them cannot.
    """
    if compiler.inertia_from_geom == "true" or (compiler.inertia_from_geom == "auto" and inertial is None):
        summed = _from_geoms(geoms, assets, compiler, moves)
        if summed.mass > 0.0 or inertial is None:
            return _conditioned(body, summed, compiler)
    if inertial is None:
        return _conditioned(body, _NOTHING, compiler)
    return _conditioned(inertial, _from_inertial(inertial, stands, compiler), compiler)


def _from_inertial(said: Element, offset: Array, compiler: Compiler) -> Inertia:
    """Read mass, pos and diaginertia (about the rotated axes), fullinertia (xx yy zz xy xz yz) or neither."""
    mass = float(said.vector("mass", 1)[0])
    if mass < 0.0:
        raise said.fail("the mass should not be negative")
    com = said.vector("pos", 3)
    if "fullinertia" not in said.values:
        turn = said.orientation(compiler.angles)
        rotational = turn @ np.diag(said.vector("diaginertia", 3, ZERO)) @ turn.T
    else:
        if said.values.keys() & {"diaginertia", *ORIENTATIONS}:
            raise said.fail("fullinertia excludes diaginertia and an orientation")
        xx, yy, zz, xy, xz, yz = said.vector("fullinertia", 6)
        rotational = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertia(mass, offset[:3, :3] @ com + offset[:3, 3], offset[:3, :3] @ rotational @ offset[:3, :3].T)


def _from_geoms(geoms: Sequence[Geom], assets: Assets, compiler: Compiler, moves: bool) -> Inertia:
    """Add up the geoms: I = Σ Iₖ + mₖ (|rₖ|² 1 − rₖ rₖᵀ) with rₖ from the common centre."""
    first, last = compiler.inertia_groups
    parts = []
    for geom in geoms:
        if not first <= geom.element.number("group", 0.0) <= last or weighs_nothing(geom):
            continue
        if geom.kind is not None or (geom.mesh is not None and (moves or compiler.total_mass > 0.0)):
            parts.append(geom_inertia(geom, assets))
    mass = sum(part.mass for part in parts)
    if mass == 0.0:
        return _NOTHING
    com = sum((part.mass * part.com for part in parts), np.zeros(3)) / mass
    rotational = np.zeros((3, 3))
    for part in parts:
        arm = part.com - com
        rotational += part.rotational + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertia(mass, com, rotational)


def _conditioned(said: Element, found: Inertia, compiler: Compiler) -> Inertia | None:
    """Apply boundmass, boundinertia and balanceinertia to the principal moments, then check them."""
    mass = max(found.mass, compiler.bound_mass)
    moments, axes = np.linalg.eigh(found.rotational)
    scale = max(float(np.abs(moments).max()), 1e-300)
    if moments[0] < -_SLACK * scale and compiler.bound_inertia == 0.0:
        raise said.fail(f"the inertia should be positive; its smallest principal moment is {moments[0]:.6g}")
    bounded = np.maximum(moments, compiler.bound_inertia)
    ordered = np.sort(bounded)
    if ordered[0] + ordered[1] < ordered[2] * (1.0 - _SLACK):
        if not compiler.balance_inertia:
            raise said.fail(
                "no solid has this inertia: the largest principal moment exceeds the sum of the others "
                f"({', '.join(f'{moment:.6g}' for moment in ordered)})"
            )
        bounded = np.full(3, bounded.mean())
    if mass == 0.0 and not np.any(bounded):
        return None
    if np.array_equal(bounded, moments):
        return Inertia(mass, found.com, found.rotational)
    return Inertia(mass, found.com, axes @ np.diag(bounded) @ axes.T)


def scaled_to_total(links: Sequence[Link], total: float) -> tuple[Link, ...]:
    """Return the links with all masses and inertias scaled so that the masses add up to `total`."""
    present = sum(link.inertia.mass for link in links if link.inertia)
    if total <= 0.0 or present == 0.0:
        return tuple(links)
    factor, scaled = total / present, []
    for link in links:
        i = link.inertia
        scaled.append(
            link if i is None else replace(link, inertia=Inertia(factor * i.mass, i.com, factor * i.rotational))
        )
    return tuple(scaled)
