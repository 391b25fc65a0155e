"""The numbers of a mechanism's geometry that measures may tell: which there are, and descriptions with others."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from dataclasses import replace

from ccpin.arrays import Array, records
from ccpin.description.closure_kinds import Fixed
from ccpin.description.model import Coupling, Joint, LoopClosure, MechanismDescription, frame_from_rpy
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import ROOT_JOINT, build_tree
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.recording.constants import Parameter, geometry_of

_ALONG = 1e-9  # of 1, a cosine: so near an axis is along a plane's normal


def numbers_on_loops(model: ReducedModel) -> tuple[Parameter, ...]:
    """Of joints on loops, of closures, and of couplings but for the first term, which says what the row counts."""
    return _numbers(model, frozenset())


def numbers_that_count(model: ReducedModel, links: Iterable[str]) -> tuple[Parameter, ...]:
    """Those on loops and on the ways to links, but for what nothing or only bending bodies would show.

    Turns of closures' ends whose axes no row has (a ball's); of loops that stay in a plane origins across it and turns
    about axes within it, which would open them.
    """
    mechanism = model.mechanism
    tree, poses = mechanism.tree, joint_poses(mechanism.tree.scratch, mechanism.q_reference)
    ways = set[str]()
    for link in links:
        number = tree.attachments[link].joint
        while number:
            ways.add(tree.joints[number - 1].name)
            number = tree.joints[number - 1].parent
    bearers, normals = {joint.name: joint.stated.parent for joint in tree.joints}, dict[str, Array]()
    blunt = set[str]()
    for loop in mechanism.constraints().loops:
        ends = {f"{loop.closure.name}/{end}": link for end, (link, _) in zip("AB", loop.closure.ends, strict=True)}
        bearers |= ends
        vectors = (each for row in loop.rows.rows for product in row for each in product[1:])
        turning = {each.frame for each in vectors if isinstance(each, Fixed)}
        blunt |= {f"{loop.closure.name}/{end}" for end in "AB" if end not in turning}
        if loop.normal is not None:
            named = [tree.joints[n - 1].name for n in (*loop.path_a, *loop.path_b)]
            normals |= dict.fromkeys((*named, *ends), poses[loop.ancestor][:3, :3] @ loop.normal)

    def kept(each: Parameter) -> bool:
        owner, _, axis = each.of.rpartition("/")
        if each.kind not in ("origin", "turn") or owner not in normals:
            return each.kind != "turn" or owner not in blunt
        attached = tree.attachments[bearers[owner]]
        way = (poses[attached.joint] @ attached.placement)[:3, "xyz".index(axis)]
        along = abs(float(way @ normals[owner])) > 1.0 - _ALONG
        return along == (each.kind == "turn") and not (along and owner in blunt)

    return tuple(each for each in _numbers(model, ways) if kept(each))


def _numbers(model: ReducedModel, ways: Set[str]) -> tuple[Parameter, ...]:
    mechanism = model.mechanism
    loops = [loop for loop in mechanism.constraints().loops if loop.closure not in mechanism.locks]
    owners = {mechanism.tree.joints[n - 1].name for loop in loops for n in (*loop.path_a, *loop.path_b)} | ways
    owners &= {joint.name for joint in mechanism.description.joints}
    owners |= {f"{loop.closure.name}/{end}" for loop in loops for end in "AB"}
    first = {f"{each.name}/{each.terms[0].joint}" for each in mechanism.couplings}
    return tuple(
        each
        for each in geometry_of(model)
        if (each.of.rpartition("/")[0] in owners if each.kind in ("origin", "turn") else each.of not in first)
    )


def unknown_numbers(
    every: Sequence[Parameter], asked: Sequence[str] | None, known: Sequence[str]
) -> tuple[Parameter, ...]:
    """The numbers asked for (default all but turns), without those known.

    Raises:
        InvalidInputError: There is none of a name.
    """
    chosen = (
        [each for each in every if each.kind != "turn"] if asked is None else named_numbers(every, asked, "parameters")
    )
    held = named_numbers(every, known, "known")
    return tuple(each for each in chosen if each not in held)


def offset_of(joint: str, unit: str) -> Parameter:
    """What an encoder says where its joint is at zero."""
    return Parameter(f"offset:{joint}", "offset", joint, 0.0, unit)


def named_numbers(every: Sequence[Parameter], names: Iterable[str], argument: str) -> tuple[Parameter, ...]:
    """Those of these names.

    A joint's, a closure's or a coupling's name (`"rod"`, `"heel/B"`) stands for all its own but turns, `"turn:rod"` for
    its turns, and a kind (`"turn"`) for all of that kind.

    Raises:
        InvalidInputError: There is none of a name.
    """
    found = dict[Parameter, None]()
    for name in records(names, argument, str):
        own = [
            each
            for each in every
            if name in (each.kind, each.name)
            or each.name.startswith(f"{name}/")
            or (each.kind != "turn" and (name == each.of or each.of.startswith(f"{name}/")))
        ]
        if not own:
            there = ", ".join(each.name for each in every)
            raise InvalidInputError(f"{argument}: there is no '{name}' among {there}")
        found |= dict.fromkeys(own)
    return tuple(found)


def with_geometry(description: MechanismDescription, told: dict[tuple[str, str], float]) -> MechanismDescription:
    """The description with other numbers, by their kinds and what they are of."""

    def moved(placement: Array, of: str) -> Array:
        found = placement.copy()
        for k, axis in enumerate("xyz"):
            found[k, 3] = told.get(("origin", f"{of}/{axis}"), found[k, 3])
        turns = [told.get(("turn", f"{of}/{axis}"), 0.0) for axis in "xyz"]
        found[:3, :3] = frame_from_rpy((0.0, 0.0, 0.0), turns)[:3, :3] @ found[:3, :3]
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
