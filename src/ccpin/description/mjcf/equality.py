"""MJCF's ``<equality>`` section as loop closures and couplings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.closing_frames import closing_pairs
from ccpin.description.elements.hinges import make_hinges
from ccpin.description.elements.xml import ZERO, XmlElement, fail
from ccpin.description.mjcf.defaults import MAIN, Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.joints import NameGiver, WorldBody, displacement
from ccpin.description.mjcf.schema import SOFT, WORLD
from ccpin.description.mjcf.tendons import StraightTendon, Tendons, tendon_coupling
from ccpin.description.model import Coupling, CouplingTerm, LoopClosure, frame

_KINDS: dict[str, str] = {"connect": "spherical", "weld": "fixed"}
_LEFT_OUT = ("flex", "flexvert", "flexstrain", "distance")
_POLYNOMIAL = (0.0, 1.0, 0.0, 0.0, 0.0)  # MuJoCo's own polycoef: y = x


@dataclass(frozen=True)
class Equalities:
    """The active constraints: closures, couplings, the joints couplings determine, and what was left out.

    `tendons` names the tendons whose equalities are among them, `softness` tells solref and solimp as written, by name.
    """

    closures: list[LoopClosure] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    dependent: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    tendons: set[str] = field(default_factory=set)
    softness: dict[str, dict[str, str]] = field(default_factory=dict)


def read_equalities(
    sections: Iterable[XmlElement], tree: WorldBody, defaults: Defaults, tendons: Tendons
) -> Equalities:
    """Read connect, weld, joint and tendon constraints; the others and inactive ones become notes.

    Raises:
        DescriptionError: A constraint names what does not exist, or says too little or too much.
    """
    found = Equalities()
    elements = [xml for section in sections for xml in section.iterchildren("*")]
    names, count = NameGiver("equality", elements), Counter[str]()
    for xml in elements:
        count[xml.tag] += 1
        name = xml.get("name") or names.fresh(f"{xml.tag}_{count[xml.tag]}")
        if xml.tag in _LEFT_OUT:
            found.notes.append(f"The {xml.tag} equality '{name}' is left out: ccpin does not model it.")
            continue
        if xml.tag not in ("connect", "weld", "joint", "tendon"):
            raise fail(xml, "no such equality constraint")
        said = defaults.resolve(xml, MAIN, "equality")
        constraint = _constraint(said, name, tree, tendons)
        soft = {word: said.values[word] for word in SOFT if word in said.values}
        if not said.flag("active", True):
            found.notes.append(f"The {xml.tag} equality '{name}' is left out: the file says it is not active.")
        elif isinstance(constraint, str):
            found.notes.append(f"The {xml.tag} equality '{name}' is left out: {constraint}.")
        else:
            found.tendons.update(filter(None, (said.text("tendon1"), said.text("tendon2"))))
            if soft:
                found.softness[name] = soft
            if isinstance(constraint, LoopClosure):
                found.closures.append(constraint)
            else:
                found.couplings.append(constraint)
                found.dependent.append(constraint.terms[0].joint)
    make_hinges(found.closures, found.notes, "connects")
    if not found.closures:
        sites = {name: (site.body, site.placement) for name, site in tree.sites.items() if name}
        found.closures.extend(closing_pairs(sites, found.notes))
    return found


def _constraint(said: Element, name: str, tree: WorldBody, tendons: Tendons) -> LoopClosure | Coupling | str:
    """A closure, a coupling, or why it is left out."""
    if said.xml.tag == "joint":
        return _coupling(said, name, tree)
    if said.xml.tag == "tendon":
        rod = tendons.get(said.required("tendon1"))
        if isinstance(rod, StraightTendon) and not said.text("tendon2"):
            return _distance(name, rod, _polynomial(said)[0], tree)
        return tendon_coupling(said, name, _polynomial(said), tendons, tree)
    return _closure(said, name, tree)


def _closure(said: Element, name: str, tree: WorldBody) -> LoopClosure:
    """Return a connect or weld; a weld whose torquescale is zero leaves the bodies free to turn."""
    by_site = bool(said.text("site1") or said.text("site2"))
    by_body = bool(said.text("body1") or said.text("body2"))
    if by_site == by_body:
        raise said.fail("either body1 (and body2) or site1 and site2 should be given")
    if by_site:
        first, second = _site(said, "site1", tree), _site(said, "site2", tree)
    else:
        bodies = _body(said, "body1", tree), _body(said, "body2", tree)
        read = _connected if said.xml.tag == "connect" else _welded
        first, second = zip(bodies, read(said, bodies, tree), strict=True)
    if first[0] == second[0]:
        raise said.fail(f"it joins body '{first[0]}' to itself")
    turns = said.xml.tag == "weld" and said.number("torquescale", 1.0) == 0.0
    kind = "spherical" if turns else _KINDS[said.xml.tag]
    return LoopClosure(name, kind, first[0], second[0], first[1], second[1])


def _distance(name: str, rod: StraightTendon, longer: float, tree: WorldBody) -> LoopClosure | str:
    """Two sites as far apart as at qpos0, and `longer`."""
    (link_a, a), (link_b, b) = ((tree.sites[site].body, tree.sites[site].placement) for site in rod)
    length = float(np.linalg.norm((tree.pose_between(link_a, link_b) @ b - a)[:3, 3])) + longer
    if length <= 0.0:
        return "two points that are to coincide are a <connect>, and a tendon has a length"
    return LoopClosure(name, "distance", link_a, link_b, a, b, length)


def _site(said: Element, attribute: str, tree: WorldBody) -> tuple[str, Array]:
    name = said.required(attribute)
    if name not in tree.sites:
        raise said.fail(f"there is no site '{name}'; there are: {', '.join(tree.sites) or 'none'}")
    return tree.sites[name].body, tree.sites[name].placement


def _body(said: Element, attribute: str, tree: WorldBody) -> str:
    name = said.required(attribute) if attribute == "body1" else said.text(attribute) or WORLD
    if name not in tree.poses:
        raise said.fail(f"there is no body '{name}'; there are: {', '.join(tree.poses)}")
    return name


def _connected(said: Element, bodies: tuple[str, str], tree: WorldBody) -> tuple[Array, Array]:
    """Return the frames of a connect: the anchor in body 1, and the same point at qpos0 in body 2."""
    anchor = frame(said.vector("anchor", 3))
    return anchor, frame((tree.pose_between(bodies[1], bodies[0]) @ anchor)[:3, 3])


def _welded(said: Element, bodies: tuple[str, str], tree: WorldBody) -> tuple[Array, Array]:
    """Return the frames of a weld: the anchor in body 2, and where it belongs in body 1.

    The position in relpose is the anchor's, its quaternion (w, x, y, z) is body 2's; a zero quaternion means
    the pose at qpos0.
    """
    anchor = frame(said.vector("anchor", 3, ZERO))
    relpose = said.vector("relpose", 7, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    if not np.any(relpose[3:]):
        return tree.pose_between(bodies[0], bodies[1]) @ anchor, anchor
    turn = said.quaternion(relpose[3:], "the quaternion of relpose")
    return frame(relpose[:3], turn), anchor


def _coupling(said: Element, name: str, tree: WorldBody) -> Coupling:
    """Return y − y₀ − Σ aₖ (x − x₀)ᵏ = 0, with the references y₀, x₀ of joints 1 and 2."""
    polynomial = _polynomial(said)
    dependent = said.required("joint1")
    y0 = displacement(said, dependent, tree)
    if said.text("joint2") is None:
        return Coupling(name, (CouplingTerm(dependent, (-polynomial[0], 1.0), y0),))
    driver = said.required("joint2")
    x0 = displacement(said, driver, tree)
    if driver == dependent:
        raise said.fail(f"it couples joint '{driver}' to itself")
    negated = tuple(-coefficient for coefficient in polynomial)
    return Coupling(name, (CouplingTerm(dependent, (0.0, 1.0), y0), CouplingTerm(driver, negated, x0)))


def _polynomial(said: Element) -> tuple[float, ...]:
    """The five coefficients, MuJoCo's own where the file is silent."""
    written = said.some_numbers("polycoef", 5)
    return (*written, *_POLYNOMIAL[len(written) :])
