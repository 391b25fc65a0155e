"""How much the rows of ψ bend: constants that bound their second and third derivatives, cluster by cluster.

A configuration near x is written x ⊕ e, with e_i a number for each velocity component: the change of a plain number, or
an exponential coordinate of a circle, a quaternion or a floating pose. Between a loop's ancestor C and one of its ends
stands a chain of turns and slides. A derivative of the end's point p in which the steps i ≤ j ≤ … ≤ k of the chain take
part is z_i × (z_j × … (z_k × (p − o_k))), no longer than the lever d_k of p about step k (1 where k slides), and zero
where a step above it slides; a derivative of a direction fixed in the end is no longer than the direction. For a ball
joint, a turn with three components, in exponential coordinates the same follows from Duhamel's formula with the sizes
of its angular velocities; a floating joint turns first and slides then.

Levers are sums of link lengths, and of what slides on the way have moved from the reference: Δ. So |p″[a, b]| is at most
|a|ᵀM|b| with M_ij = d_max(i,j), a row Σ w (x·y) obeys the product rule, and with one matrix M_l, or tensor T_l, for each
row (or set of rows e·gap, e along several directions)

    |ψ″[a, b]| ≤ √λ_max(Σ M_l M_lᵀ) |a||b|,    |ψ‴[a, b, c]| ≤ √λ_max(Σ T_l T_lᵀ) |a||b||c|,

T_l unfolded to a matrix: Euclidean norms throughout, in which lengths are counted in the cluster's own unit ℓ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.description.closure_kinds import Fixed, Gap, Product, Row, Vector
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.tree import Tree

_DEGREES = 3  # of polynomials in Δ: 1, Δ, Δ²
_Step = tuple[int, bool]  # the joint's number, and whether it slides: all of a joint's turns are one step, and slides


class Bending(NamedTuple):
    """Bounds for one cluster, in units of its ℓ; Euclidean norms over all its components and rows.

    Attributes:
        unit: ℓ, metres: the longest lever.
        second, third: Coefficients of 1, Δ, Δ² in bounds of |ψ″| and |ψ‴| of the loops' rows, of shape (3,) each.
        slides: By loop: where the slides that lengthen its levers stand in q′.
        spread: Δ grows by at most `spread` times the size of a displacement.
    """

    unit: float
    second: Array
    third: Array
    slides: tuple[Indices, ...]
    spread: float

    def bounds(self, moved: float) -> tuple[float, float]:
        """Of |ψ″| and |ψ‴| where slides have moved by Δ, in units of ℓ."""
        powers = np.array([1.0, moved, moved**2])
        return float(self.second @ powers), float(self.third @ powers)

    def moved(self, q_free: Array, q_reference: Array) -> float:
        """Δ: how far the slides of one loop are from the reference, at most, in units of ℓ."""
        gone = np.abs(q_free - q_reference)
        return max((float(gone[slides].sum()) for slides in self.slides), default=0.0) / self.unit


def bending(tree: Tree, q_reference: Array, loops: Sequence[ResolvedClosure]) -> Bending:
    """The bounds of a cluster's loops."""
    chains = [_Chains.of(tree, q_reference, loop) for loop in loops]
    unit = max((chain.longest for chain in chains), default=0.0) or 1.0
    steps = sorted({step for chain in chains for step in chain.steps})
    place = {step: k for k, step in enumerate(steps)}
    second, third = np.zeros((2, _DEGREES, len(steps), len(steps)))
    for chain in chains:
        at = np.array([place[step] for step in chain.steps], dtype=np.intp)
        for matrix, tensor in chain.bent(unit):
            unfolded = tensor.reshape(_DEGREES, len(at), -1)
            second[:, at[:, None], at] += matrix @ matrix.transpose(0, 2, 1)
            third[:, at[:, None], at] += unfolded @ unfolded.transpose(0, 2, 1)
    slides = tuple(chain.slides for chain in chains)
    spread = max((chain.spread for chain in chains), default=0.0)
    return Bending(unit, _root(second), _root(third), slides, spread)


def _root(squares: Array) -> Array:
    """√λ_max of symmetric matrices, rounded up."""
    if not squares.shape[-1]:
        return np.zeros(len(squares))
    return np.sqrt(np.maximum(np.linalg.eigvalsh(squares)[:, -1], 0.0)) * (1.0 + 1e-9)


class _Jet(NamedTuple):
    """Bounds of a vector and of its first, second and third derivatives by steps, each a polynomial in Δ."""

    size: Array
    first: Array
    second: Array
    third: Array

    @classmethod
    def fixed(cls, turns: Array) -> _Jet:
        """A unit vector fixed in a frame that the steps given turn."""
        parts = (np.ones(()), turns, np.multiply.outer(turns, turns), _outer(turns, turns, turns))
        return cls(*(np.stack([part, *(np.zeros_like(part) for _ in range(_DEGREES - 1))]) for part in parts))

    def times(self, other: _Jet, weight: float) -> tuple[Array, Array]:
        """Second and third derivatives of weight (x·y)."""
        x, y = self, other
        second = _product(x.second, y.size) + _product(x.size, y.second)
        second = second + _product(x.first, y.first) + _product(y.first, x.first)
        mixed = _product(x.second, y.first) + _product(y.second, x.first)
        third = _product(x.third, y.size) + _product(x.size, y.third)
        for last in range(3):  # the derivative that stands alone
            third = third + np.moveaxis(mixed, 3, 1 + last)
        return abs(weight) * second, abs(weight) * third


def _outer(*vectors: Array) -> Array:
    return np.einsum("i,j,k->ijk", *vectors)


def _product(x: Array, y: Array) -> Array:
    """The outer product of two arrays of polynomials in Δ."""
    result = np.zeros((_DEGREES, *x.shape[1:], *y.shape[1:]))
    for i in range(_DEGREES):
        for j in range(_DEGREES - i):
            result[i + j] += np.multiply.outer(x[i], y[j])
    return result


class _Side(NamedTuple):
    """The chain from a loop's ancestor to one of its ends.

    Attributes:
        steps: Root first.
        levers: d of each turn while Δ = 0, and 1 for slides, metres.
        grows: 1.0 for turns whose levers Δ lengthens.
        reach: No more than this is the distance of the end from the ancestor while Δ = 0, metres.
        within: Where slides below a turn of another joint stand in q′. slides: All of them.
        sliding: How many steps slide.
    """

    steps: list[_Step]
    levers: list[float]
    grows: list[float]
    reach: float
    within: list[int]
    slides: list[int]
    sliding: int

    @classmethod
    def of(cls, tree: Tree, q_reference: Array, path: Sequence[int], point: Array) -> _Side:
        """Measure a chain that ends in a point of its last joint's frame."""
        joints = [tree.joints[number - 1] for number in path]
        offsets = [*(joint.placement[:3, 3] for joint in joints), point]
        steps, levers, grows, within, slides = list[_Step](), list[float](), list[float](), list[int](), list[int]()
        beyond = 0.0  # of the frame after this joint's
        for joint, after in zip(reversed(joints), reversed(offsets[1:]), strict=True):
            axes = joint.kind.directions(joint.axis)
            turning = [axis for axis, slide in zip(axes, joint.kind.slides, strict=True) if not slide]
            own = [joint.q.start + k for k, slide in enumerate(joint.kind.slides) if slide]
            if turning:
                within = list(slides)
            if own:
                steps.append((joint.number, True))
                levers.append(1.0)
                grows.append(0.0)
                slides += own
            if turning:
                across = after - (after @ turning[0]) * turning[0] if len(turning) == 1 else after
                steps.append((joint.number, False))
                levers.append(float(np.linalg.norm(across)) + beyond)
                grows.append(1.0 if slides else 0.0)
            beyond += float(np.linalg.norm(after)) + float(np.abs(q_reference[own]).sum())
        reach = beyond + float(np.linalg.norm(offsets[0]))
        sliding = sum(slide for _, slide in steps)
        return cls(steps[::-1], levers[::-1], grows[::-1], reach, within, slides, sliding)


class _Chains(NamedTuple):
    """The two chains of one loop, A's before B's.

    Attributes:
        rows: Of the loop.
        sides: The chains.
        measured: Whether the size of the gap matters to a row.
    """

    rows: tuple[Row, ...]
    sides: tuple[_Side, _Side]
    measured: bool

    @classmethod
    def of(cls, tree: Tree, q_reference: Array, loop: ResolvedClosure) -> _Chains:
        """Measure a loop."""
        ends = (loop.path_a, loop.frame_a[:3, 3]), (loop.path_b, loop.frame_b[:3, 3])
        a, b = (_Side.of(tree, q_reference, *end) for end in ends)
        rows = loop.rows.rows
        frames = {_frame(vector) for row in rows for p in row for vector in (p.left, p.right) if _gaps(p)}
        return cls(rows, (a, b), any(_gaps(p) == 2 for row in rows for p in row) or not frames <= {"C", "gap"})

    @property
    def steps(self) -> list[_Step]:
        """Of both chains."""
        return [step for side in self.sides for step in side.steps]

    @property
    def longest(self) -> float:
        """The longest lever of a turn, metres."""
        turns = [d for side in self.sides for d, (_, slides) in zip(side.levers, side.steps, strict=True) if not slides]
        return max(turns, default=0.0)

    @property
    def slides(self) -> Indices:
        """Where the slides that count in Δ stand in q′."""
        found = [q for side in self.sides for q in (side.slides if self.measured else side.within)]
        return np.array(found, dtype=np.intp)

    @property
    def spread(self) -> float:
        """How fast Δ grows with a displacement, at most."""
        return float(np.sqrt(sum(side.sliding for side in self.sides)))

    def bent(self, unit: float) -> Iterator[tuple[Array, Array]]:
        """M and T of every row, or set of rows, lengths in the unit given."""
        vectors = self._vectors(unit)
        together: dict[str, list[Array]] = {}
        for row in self.rows:
            first = row[0]
            if len(row) == 1 and _gaps(first) == 1:
                fixed = first.left if isinstance(first.left, Fixed) else first.right
                assert isinstance(fixed, Fixed)
                together.setdefault(fixed.frame, []).append(first.weight * fixed.local)
                continue
            longest = max(_gaps(product) for product in row)
            scaled = [(p, _size(p) * unit ** (_gaps(p) - min(longest, 1))) for p in row]
            parts = [vectors[_frame(p.left)].times(vectors[_frame(p.right)], size) for p, size in scaled]
            yield sum((part[0] for part in parts), np.zeros(())), sum((part[1] for part in parts), np.zeros(()))
        for frame, directions in together.items():
            yield vectors[frame].times(vectors["gap"], float(np.linalg.norm(directions, 2)))

    def _vectors(self, unit: float) -> dict[str, _Jet]:
        """Unit vectors of A, B and C, and the gap."""
        counts = [len(side.steps) for side in self.sides]
        of_b = np.repeat([False, True], counts)
        slides = np.array([slides for _, slides in self.steps], dtype=bool)
        levers = np.array([d for side in self.sides for d in side.levers])
        levers = np.stack([np.where(slides, 1.0, levers / unit), [g for side in self.sides for g in side.grows]])
        turns = np.where(slides, 0.0, 1.0)
        gap = _Jet(*(np.zeros((_DEGREES, *[len(turns)] * order)) for order in range(4)))
        gap.size[:2] = sum(side.reach for side in self.sides) / unit, 1.0
        gap.first[:2] = levers
        for start, stop in ((0, counts[0]), (counts[0], len(turns))):
            for k in range(start, stop):  # the deepest step that takes part
                above = turns.copy()
                above[:start], above[k + (not slides[k]) :] = 0.0, 0.0
                only = np.zeros(len(turns))
                only[k] = 1.0
                pair = _outermost(above, only)
                triple = _outermost(above, above, only)
                for degree in range(2):
                    gap.second[degree] += levers[degree, k] * pair
                    gap.third[degree] += levers[degree, k] * triple
        return {
            "A": _Jet.fixed(np.where(of_b, 0.0, turns)),
            "B": _Jet.fixed(np.where(of_b, turns, 0.0)),
            "C": _Jet.fixed(np.zeros_like(turns)),
            "gap": gap,
        }


def _outermost(*vectors: Array) -> Array:
    """1 where some order of the indices has all vectors' entries not zero, of nonnegative 0-1 vectors."""
    letters = "ijk"[: len(vectors)]
    outer = np.einsum(",".join(letters) + "->" + letters, *vectors)
    result = outer
    for axis in range(len(vectors) - 1):
        result = np.maximum(result, np.swapaxes(outer, axis, len(vectors) - 1))
    return np.asarray(result)


def _gaps(product: Product) -> int:
    return isinstance(product.left, Gap) + isinstance(product.right, Gap)


def _frame(vector: Vector) -> str:
    return vector.frame if isinstance(vector, Fixed) else "gap"


def _size(product: Product) -> float:
    """|w| times the lengths of the vectors that are fixed."""
    fixed = [v for v in (product.left, product.right) if isinstance(v, Fixed)]
    return abs(product.weight) * float(np.prod([np.linalg.norm(vector.local) for vector in fixed]))
