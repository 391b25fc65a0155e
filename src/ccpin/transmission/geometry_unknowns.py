"""The numbers of a linkage's geometry that measured angles may tell: which there are, and how φ changes with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, records
from ccpin.description.model import Coupling, Joint, LoopClosure, MechanismDescription
from ccpin.errors import InvalidInputError
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.geometry_slopes import Origin, OriginSlopes
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.mechanism import Mechanism

_TURNING = 2  # numbers of q′ that an angle on the circle has: a ratio of it is a fraction, nothing to be fitted


class Unknown(NamedTuple):
    """A number of the geometry.

    Attributes:
        name: `"JOINT:x"` (y, z: the origin of its frame on its parent link), `"CLOSURE/A:x"` and `"CLOSURE/B:x"` (that
            of a closure's frame on its link), `"CLOSURE:length"`, `"COUPLING/JOINT:ratio"`, `"offset:JOINT"`.
        kind, of: What it is of.
        part: Of an origin the axis; of a ratio the number of the term.
        value: As the file has it; m, rad or a ratio.
    """

    name: str
    kind: Literal["joint", "A", "B", "length", "ratio", "offset"]
    of: str
    part: int
    value: float

    @property
    def owner(self) -> str:
        """The name without its last part."""
        return self.name if self.kind == "offset" else self.name.rpartition(":")[0]

    @property
    def is_length(self) -> bool:
        """Whether it is in metres."""
        return self.kind in ("joint", "A", "B", "length")


def unknowns_of(
    mechanism: Mechanism,
    asked: Sequence[str] | None,
    known: Sequence[str],
    offsets: Sequence[str],
    sides: Sequence[str],
) -> tuple[Unknown, ...]:
    """The unknowns of those names, or of all; an owner's name stands for all that are its own.

    Raises:
        InvalidInputError: There is none of a name, or none is left.
    """
    every = _geometry(mechanism)
    chosen = every if asked is None else _named(every, records(asked, "parameters", str), "parameters")
    held = _named(every, records(known, "known", str), "known")
    told = records(offsets, "offsets", str)
    for joint in told:
        if joint not in sides:
            raise InvalidInputError(f"offsets: '{joint}' is none of {', '.join(sides)}")
    free = [each for each in chosen if each not in held]
    found = (*free, *(Unknown(f"offset:{joint}", "offset", joint, 0, 0.0) for joint in dict.fromkeys(told)))
    if not found:
        raise InvalidInputError("nothing is unknown: parameters, known and offsets leave nothing to identify")
    return found


def _geometry(mechanism: Mechanism) -> list[Unknown]:
    """Of joints on loops, of closures, of couplings but for the first term, which says what the row counts."""
    tree, stated = mechanism.tree, mechanism.held or mechanism.description
    loops = mechanism.constraints().loops
    looped = {number for loop in loops for number in (*loop.path_a, *loop.path_b)}
    joints = {joint.name: joint for joint in stated.joints}
    found = [
        Unknown(f"{joint.name}:{axis}", "joint", joint.name, k, float(joints[joint.name].placement[k, 3]))
        for joint in tree.joints
        if joint.number in looped and joint.name in joints
        for k, axis in enumerate("xyz")
    ]
    for closure in mechanism.closures:
        for end, (_, placement) in zip(("A", "B"), closure.ends, strict=True):
            for k, axis in enumerate("xyz"):
                found.append(Unknown(f"{closure.name}/{end}:{axis}", end, closure.name, k, float(placement[k, 3])))  # type: ignore[arg-type]
        if closure.length is not None:
            found.append(Unknown(f"{closure.name}:length", "length", closure.name, 0, closure.length))
    for coupling in mechanism.couplings:
        if any(tree.joint(term.joint).kind.unit == _TURNING for term in coupling.terms):
            continue
        for k, term in enumerate(coupling.terms[1:], start=1):
            if len(term.coefficients) > 1:
                name = f"{coupling.name}/{term.joint}:ratio"
                found.append(Unknown(name, "ratio", coupling.name, k, term.coefficients[1]))
    return found


def _named(every: Sequence[Unknown], names: Sequence[str], argument: str) -> list[Unknown]:
    for name in names:
        if not any(name in (each.name, each.owner, each.of) for each in every):
            raise InvalidInputError(
                f"{argument}: there is no '{name}' among {', '.join(dict.fromkeys(each.owner for each in every))}"
            )
    return [each for each in every if {each.name, each.owner, each.of} & set(names)]


def with_geometry(
    description: MechanismDescription, unknowns: Sequence[Unknown], values: Array
) -> MechanismDescription:
    """The description with these numbers."""
    told = {(each.kind, each.of, each.part): float(value) for each, value in zip(unknowns, values, strict=True)}

    def moved(placement: Array, kind: str, of: str) -> Array:
        found = placement.copy()
        for axis in range(3):
            found[axis, 3] = told.get((kind, of, axis), found[axis, 3])  # type: ignore[arg-type]
        return found

    def joint(each: Joint) -> Joint:
        return replace(each, placement=moved(each.placement, "joint", each.name))

    def closure(each: LoopClosure) -> LoopClosure:
        ends = (moved(frame, end, each.name) for end, (_, frame) in zip(("A", "B"), each.ends, strict=True))
        return replace(
            each,
            **dict(zip(("placement_a", "placement_b"), ends, strict=True)),
            length=told.get(("length", each.name, 0), each.length),
        )

    def coupling(each: Coupling) -> Coupling:
        terms = list(each.terms)
        for k, term in enumerate(terms):
            if ("ratio", each.name, k) in told:
                first, _, *others = term.coefficients
                terms[k] = replace(term, coefficients=(first, told["ratio", each.name, k], *others))
        return replace(each, terms=tuple(terms))

    return replace(
        description,
        joints=tuple(joint(each) for each in description.joints),
        closures=tuple(closure(each) for each in description.closures),
        couplings=tuple(coupling(each) for each in description.couplings),
    )


class GeometrySlopes:
    """φ_p: how φ changes with unknowns; 0 of encoders' offsets, of which φ knows nothing.

    Args:
        mechanism: The mechanism, of the geometry at which slopes are asked for.
        unknowns: p.
    """

    def __init__(self, mechanism: Mechanism, unknowns: Sequence[Unknown]) -> None:
        self._unknowns, self._constraints = unknowns, mechanism.constraints()
        self._rows = self._constraints.row_slices()
        self._ratios = {
            (each.coupling.name, k): term for each in self._constraints.couplings for k, term in enumerate(each.terms)
        }
        self._moved = [k for k, each in enumerate(unknowns) if each.kind in ("joint", "A", "B")]
        origins = [_origin(mechanism.tree, self._constraints, unknowns[k]) for k in self._moved]
        self._origins = OriginSlopes(mechanism.tree, self._constraints, origins)

    def at(self, point: ConstraintValue) -> Array:
        """φ_p at a configuration, of shape (m, k)."""
        slopes = np.zeros((self._constraints.size, len(self._unknowns)))
        if self._moved:
            slopes[:, self._moved] = self._origins.at(point)
        for k, each in enumerate(self._unknowns):
            if each.kind == "length":
                slopes[self._rows[each.of], k] = -1.0  # of (|gap|² − L²)/2L, where |gap| = L
            elif each.kind == "ratio":
                slopes[self._rows[each.of], k] = self._ratios[each.of, each.part].angle(point.q_free)
        return slopes


def _origin(tree: Tree, constraints: Constraints, unknown: Unknown) -> Origin:
    if unknown.kind == "joint":
        joint = tree.joint(unknown.of)
        ends = ((n, end, path) for n, each in enumerate(constraints.loops) for end, path in _paths(each))
        return Origin(
            joint.stated.parent, unknown.part, tuple((n, end) for n, end, path in ends if joint.number in path)
        )
    number = [loop.closure.name for loop in constraints.loops].index(unknown.of)
    link = dict(zip("AB", (end for end, _ in constraints.loops[number].closure.ends), strict=True))[unknown.kind]
    return Origin(link, unknown.part, ((number, unknown.kind),))


def _paths(loop: ResolvedClosure) -> tuple[tuple[str, tuple[int, ...]], ...]:
    return ("A", loop.path_a), ("B", loop.path_b)
