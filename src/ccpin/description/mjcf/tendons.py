"""MJCF's ``<fixed>`` tendons, whose lengths are sums of joint displacements, and those straight from site to site."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ccpin.description.elements.xml import XmlElement, fail
from ccpin.description.mjcf.defaults import MAIN, Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.joints import WorldBody, displacement
from ccpin.description.model import Coupling, CouplingTerm


class StraightTendon(NamedTuple):
    """A spatial tendon straight from one site to another."""

    first: str
    second: str


Tendons = dict[str, Mapping[str, float] | StraightTendon | None]
"""The coefficients of each fixed tendon by joint, the ends of a straight one; ``None`` for any other spatial tendon."""

_PHYSICS = ("stiffness", "damping", "frictionloss", "armature", "range", "actuatorfrcrange")


def read_tendons(sections: Iterable[XmlElement], tree: WorldBody) -> Tendons:
    """Read the tendons that have names, which equalities refer to.

    Raises:
        DescriptionError: A name comes twice, or a fixed tendon's joint or coefficient is wrong.
    """
    tendons: Tendons = {}
    for xml in (xml for section in sections for xml in section.iterchildren("*")):
        if xml.tag not in ("fixed", "spatial"):
            raise fail(xml, "a tendon is <fixed> or <spatial>")
        said = Element.of(xml)
        name = said.text("name")
        if name in tendons:
            raise said.fail("the tendon name is used twice")
        length = _coefficients(said, tree) if xml.tag == "fixed" else _rod(said, tree)
        if name:
            tendons[name] = length
    return tendons


def _rod(said: Element, tree: WorldBody) -> StraightTendon | None:
    """The ends of a tendon of two sites and nothing else.

    Raises:
        DescriptionError: One does not exist.
    """
    parts = [Element.of(xml) for xml in said.xml.iterchildren("*")]
    if [part.xml.tag for part in parts] != ["site", "site"]:
        return None
    ends = [part.required("site") for part in parts]
    for part, site in zip(parts, ends, strict=True):
        if site not in tree.sites:
            raise part.fail(f"there is no site '{site}'; there are: {', '.join(tree.sites) or 'none'}")
    return StraightTendon(*ends)


def _coefficients(said: Element, tree: WorldBody) -> dict[str, float]:
    coefficients: dict[str, float] = {}
    for xml in said.xml.iterchildren("*"):
        if xml.tag != "joint":
            raise fail(xml, "a fixed tendon holds <joint> elements only")
        part = Element.of(xml)
        joint = part.required("joint")
        displacement(part, joint, tree)
        if joint in coefficients:
            raise part.fail(f"joint '{joint}' comes twice in the tendon")
        coefficients[joint] = float(part.vector("coef", 1)[0])
    if not any(coefficients.values()):
        raise said.fail("a fixed tendon needs a <joint> whose coef is not zero")
    return coefficients


def left_out(sections: Iterable[XmlElement], defaults: Defaults, equated: frozenset[str]) -> bool:
    """Whether the file's tendons are more than the sides of the equalities that were read (names in `equated`)."""
    for xml in (xml for section in sections for xml in section.iterchildren("*")):
        said = defaults.resolve(xml, MAIN, "tendon")
        if (
            xml.tag not in ("fixed", "spatial")
            or said.text("name") not in equated
            or any(said.text(word) for word in _PHYSICS)
        ):
            return True
    return False


def tendon_coupling(
    said: Element, name: str, polynomial: tuple[float, ...], tendons: Tendons, tree: WorldBody
) -> Coupling | str:
    """Return L₁ − L₁⁰ − Σ aₖ (L₂ − L₂⁰)ᵏ = 0 of the lengths L = Σ c q, with L⁰ at qpos0, as a coupling.

    Without a second tendon that is L₁ − L₁⁰ = a₀. A power of a sum of several joints is no sum of polynomials in
    each of them: for that, and for spatial tendons, the answer says why the equality is left out.

    Raises:
        DescriptionError: There is no such tendon, both are the same one, or nothing is left of the sum.
    """
    first, second = said.required("tendon1"), said.text("tendon2")
    for tendon in filter(None, (first, second)):
        if tendon not in tendons:
            raise said.fail(f"there is no tendon '{tendon}'; there are: {', '.join(tendons) or 'none'}")
    if first == second:
        raise said.fail(f"it couples tendon '{first}' to itself")
    length, driver = tendons[first], tendons[second] if second else {}
    if not isinstance(length, Mapping) or not isinstance(driver, Mapping):
        return "ccpin does not model spatial tendons"
    if len(driver) > 1 and any(polynomial[2:]):
        return "its polynomial is of a higher degree than one in a sum of several joints"
    terms = {joint: [0.0, coefficient, 0.0, 0.0, 0.0] for joint, coefficient in length.items()}
    for joint, coefficient in driver.items():
        of_joint = terms.setdefault(joint, [0.0] * 5)
        for power in range(1, 5):
            of_joint[power] -= polynomial[power] * coefficient**power
    kept = {joint: powers for joint, powers in terms.items() if any(powers)}
    if not kept:
        raise said.fail("the two tendons cancel each other, so that it says nothing")
    next(iter(kept.values()))[0] -= polynomial[0]
    return Coupling(name, tuple(_term(said, joint, powers, tree) for joint, powers in kept.items()))


def _term(said: Element, joint: str, powers: list[float], tree: WorldBody) -> CouplingTerm:
    """A term without the zeros of powers that it lacks."""
    while len(powers) > 2 and powers[-1] == 0.0:
        powers = powers[:-1]
    return CouplingTerm(joint, tuple(powers), displacement(said, joint, tree))
