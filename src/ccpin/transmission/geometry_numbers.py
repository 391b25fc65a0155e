"""The numbers of a linkage's geometry that measured angles may tell: which there are, and descriptions with others."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ccpin.arrays import Array, records
from ccpin.description.model import Coupling, Joint, LoopClosure, MechanismDescription
from ccpin.errors import InvalidInputError
from ccpin.kinematics.tree import ROOT_JOINT, build_tree
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.recording.constants import Parameter, geometry_of
from ccpin.transmission.transmission import Transmission


def numbers_on_loops(transmission: Transmission) -> tuple[Parameter, ...]:
    """Of joints on loops, of closures, and of couplings but for the first term, which says what the row counts."""
    mechanism = transmission.joint_model.mechanism
    loops = [loop for loop in mechanism.constraints().loops if loop.closure not in mechanism.locks]
    looped = {mechanism.tree.joints[n - 1].name for loop in loops for n in (*loop.path_a, *loop.path_b)}
    looped &= {joint.name for joint in mechanism.description.joints}
    owners = looped | {f"{loop.closure.name}/{end}" for loop in loops for end in "AB"}
    first = {f"{each.name}/{each.terms[0].joint}" for each in mechanism.couplings}
    every = geometry_of(transmission.joint_model)
    return tuple(
        each
        for each in every
        if (each.of.rpartition("/")[0] in owners if each.kind == "origin" else each.of not in first)
    )


def unknown_numbers(
    transmission: Transmission, asked: Sequence[str] | None, known: Sequence[str], offsets: Sequence[str]
) -> tuple[Parameter, ...]:
    """The numbers asked for (default all) but those known, then offsets of encoders.

    Raises:
        InvalidInputError: There is none of a name, or none is left.
    """
    every = numbers_on_loops(transmission)
    chosen = every if asked is None else named_numbers(every, asked, "parameters")
    held, told = named_numbers(every, known, "known"), dict.fromkeys(records(offsets, "offsets", str))
    sides = transmission.joint_side, transmission.motor_side
    units = {name: unit for side in sides for name, unit in zip(side.names, side.units, strict=True)}
    for name in told:
        if name not in units:
            raise InvalidInputError(f"offsets: '{name}' is none of {', '.join(units)}")
    found = [each for each in chosen if each not in held]
    found += [Parameter(f"offset:{name}", "offset", name, 0.0, units[name]) for name in told]
    if not found:
        raise InvalidInputError("nothing is unknown: parameters, known and offsets leave nothing to identify")
    return tuple(found)


def named_numbers(every: Sequence[Parameter], names: Iterable[str], argument: str) -> tuple[Parameter, ...]:
    """Those of these names; a joint's, a closure's or a coupling's name (`"rod"`, `"heel/B"`) stands for all its own.

    Raises:
        InvalidInputError: There is none of a name.
    """
    found = dict[Parameter, None]()
    for name in records(names, argument, str):
        own = [each for each in every if name in (each.name, each.of) or each.of.startswith(f"{name}/")]
        if not own:
            raise InvalidInputError(f"{argument}: there is no '{name}' among {', '.join(each.of for each in every)}")
        found |= dict.fromkeys(own)
    return tuple(found)


def with_geometry(description: MechanismDescription, told: dict[tuple[str, str], float]) -> MechanismDescription:
    """The description with other numbers, by their kinds and what they are of."""

    def moved(placement: Array, of: str) -> Array:
        found = placement.copy()
        for k, axis in enumerate("xyz"):
            found[k, 3] = told.get(("origin", f"{of}/{axis}"), found[k, 3])
        return found

    def joint(each: Joint) -> Joint:
        return replace(each, placement=moved(each.placement, each.name))

    def closure(each: LoopClosure) -> LoopClosure:
        a, b = (moved(frame, f"{each.name}/{end}") for end, (_, frame) in zip("AB", each.ends, strict=True))
        return replace(each, placement_a=a, placement_b=b, length=told.get(("distance", each.name), each.length))

    def coupling(each: Coupling) -> Coupling:
        terms = list(each.terms)
        for k, term in enumerate(terms):
            if (ratio := told.get(("ratio", f"{each.name}/{term.joint}"))) is not None:
                first, _, *others = term.coefficients
                terms[k] = replace(term, coefficients=(first, ratio, *others))
        return replace(each, terms=tuple(terms))

    return replace(
        description,
        joints=tuple(joint(each) for each in description.joints),
        closures=tuple(closure(each) for each in description.closures),
        couplings=tuple(coupling(each) for each in description.couplings),
    )


def changed_mechanism(mechanism: Mechanism, told: dict[tuple[str, str], float]) -> Mechanism:
    """The mechanism of another geometry, its reference closed anew at the same independent coordinates.

    Raises:
        CcpinError: It does not close there.
    """
    held = None if mechanism.held is None else with_geometry(mechanism.held, told)
    whole = with_geometry(mechanism.description, told)
    tree = build_tree(held or whole, ROOT_JOINT in mechanism.tree.names)
    open_one = replace(mechanism, description=whole, held=held, tree=tree)
    alpha, near = open_one.parametrization().coordinates.alpha, mechanism.q_reference
    return replace(open_one, q_reference=open_one.parametrization().sigma(alpha(near), near).q_free)
