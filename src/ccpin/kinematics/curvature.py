"""How much the rows of ψ bend: bounds of their second and third derivatives over a box of displacements.

A configuration near x is written x ⊕ e, with e_i a number for each velocity component: the change of a plain number, or
an exponential coordinate of a circle, a quaternion or a floating pose. A box is |e_i| ≤ r_i.

Between a loop's ancestor C and one of its ends stands a chain of turns and slides. A derivative of the end's point p in
which joints i ≤ j ≤ … ≤ k of the chain take part is z_i × (z_j × … (z_k × (p − o_k))), so no longer than d_k, the
distance of p from the last joint's axis; a derivative of a direction fixed in the end is no longer than the direction.
(For a ball joint in exponential coordinates the same follows from Duhamel's formula, with the distance from its centre;
a floating joint turns first and slides then.) Rows are sums of products of such vectors, so the product rule bounds
them. d_k is exact at x, and within the box it grows by no more than the joints after k move the point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.description.closure_kinds import Fixed, Vector
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.coordinates import Coordinate, IndependentCoordinates
from ccpin.kinematics.loops import ResolvedTerm
from ccpin.kinematics.tree import TreeJoint

_CODES = {"A": 0, "B": 1, "C": 2}
_GAP = 3


class Levers(NamedTuple):
    """At one configuration: distances of the ends' points from the joints of their chains (2 L, S), and gaps (L,)."""

    distances: Array
    gaps: Array


class Curvature:
    """Bounds of ψ″ and ψ‴ of one mechanism.

    Args:
        constraints: φ.
        coordinates: α.
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates) -> None:
        self._constraints, self._coordinates = constraints, coordinates
        joints, loops = coordinates.tree.joints, constraints.loops
        paths = [*(loop.path_a for loop in loops), *(loop.path_b for loop in loops)]
        chains = [[step for number in path for step in _steps(joints[number - 1])] for path in paths]
        shape = len(chains), max((len(chain) for chain in chains), default=0)
        self._columns, self._turns = np.full(shape, constraints.model.nv), np.zeros(shape)
        self._shared = np.tile(np.eye(shape[1]), (shape[0], 1, 1))
        for k, chain in enumerate(chains):
            for i, step in enumerate(chain):
                self._columns[k, i], self._turns[k, i] = step.column, not step.slides
                if step.ball:  # |p − o|² is half the sum of the squared distances from three axes through o
                    self._shared[k, i, : len(chain)] = [0.5 * (other.ball == step.ball) for other in chain]
        rows = [(k, row) for k, loop in enumerate(loops) for row in loop.rows.rows]
        products = [(k, product) for k, row in rows for product in row]
        weights = [abs(product.weight) for _, product in products]
        self._sums = np.repeat(np.eye(len(rows)), [len(row) for _, row in rows], axis=1) * weights
        self._left = _Sides([(k, product.left) for k, product in products])
        self._right = _Sides([(k, product.right) for k, product in products])
        self._bent = [part for part in coordinates.parts if part.component is not None]

    def levers(self, at: ConstraintValue) -> Levers:
        """What the bounds need to know of a configuration."""
        spatial = np.concatenate([at.placed.spatial, np.zeros((6, 1))], axis=1).T[self._columns]
        points = self._constraints.points(at)
        moved = spatial[..., :3] + cross(spatial[..., 3:], points[:, None])
        squares = np.einsum("kij,kj->ki", self._shared, (moved**2).sum(axis=-1))
        start, end = points.reshape(2, -1, 3)
        return Levers(np.sqrt(squares), np.sqrt(((end - start) ** 2).sum(axis=-1)))

    def bounds(self, at: ConstraintValue, levers: Levers, box: Array, r: Array, w: Array) -> tuple[Array, Array]:
        """|ψ″[a, b]| and |ψ‴[a, a, b]| along any |a| ≤ r and |b| ≤ w, anywhere in the box; each of shape (k, m + n).

        Args:
            at: ψ at the centre of the box.
            levers: Of that configuration.
            box: Half-widths, of shape (n′,).
            r: Half-widths of a, of shape (k, n′).
            w: Half-widths of b, of shape (k, n′).
        """
        size, rows = self._constraints.size, len(self._sums)
        second, third = np.zeros((2, len(r), size + self._coordinates.n))
        if rows:
            padded = np.zeros((1 + 2 * len(r), len(box) + 1))
            padded[0, :-1], padded[1 : 1 + len(r), :-1], padded[1 + len(r) :, :-1] = box, r, w
            chains = padded[:, self._columns]
            table = self._vectors(levers, chains[0], chains[1 : 1 + len(r)], chains[1 + len(r) :])
            (x, x_r, x_w, x_rr, x_rw, x_rrw), (y, y_r, y_w, y_rr, y_rw, y_rrw) = (
                side.of(table) for side in (self._left, self._right)
            )
            second[:, :rows] = (x_rw * y + x_r * y_w + x_w * y_r + x * y_rw) @ self._sums.T
            mixed = 2.0 * (x_rw * y_r + x_r * y_rw) + x_rr * y_w + x_w * y_rr
            third[:, :rows] = (x_rrw * y + mixed + x * y_rrw) @ self._sums.T
        for k, coupling in enumerate(self._constraints.couplings, start=rows):
            for term in coupling.terms:
                i = term.idx_v
                slopes = _slopes(term, at.q_free, box[i])
                second[:, k] += slopes[0] * r[:, i] * w[:, i]
                third[:, k] += slopes[1] * r[:, i] ** 2 * w[:, i]
        for part in self._bent:
            k = size + part.v.start
            widths = box[part.v_free], r[:, part.v_free], w[:, part.v_free]
            second[:, k], third[:, k] = self._component(part, at.q_free, *widths)
        return second, third

    def _vectors(self, levers: Levers, box: Array, r: Array, w: Array) -> Array:
        """Sizes of the vectors of A, B, C and the gap, and of their derivatives along r, w, rr, rw, rrw: (6, k, 4, L).

        Half-widths are given by chain, of shape (2 L, S), (k, 2 L, S) and (k, 2 L, S).
        """
        turns, reach, distances = self._turns, np.zeros(len(box)), levers.distances.copy()
        for i in reversed(range(box.shape[1])):
            distances[:, i] += turns[:, i] * reach
            reach += box[:, i] * distances[:, i]
        turned_r, turned_w = turns * r, turns * w
        slide_r, slide_w = r - turned_r, w - turned_w
        after_r, after_w = turned_r.cumsum(axis=-1), turned_w.cumsum(axis=-1)
        before_r, before_w = after_r - turned_r, after_w - turned_w
        far = turns * distances
        moved = np.empty((6, *r.shape))
        moved[0] = 0.0
        moved[1], moved[2] = r * distances, w * distances
        moved[3] = far * (after_r**2 - before_r**2) + 2.0 * before_r * slide_r
        moved[4] = far * (after_r * after_w - before_r * before_w) + before_r * slide_w + before_w * slide_r
        moved[5] = far * (after_r**2 * after_w - before_r**2 * before_w)
        moved[5] += before_r * (2.0 * before_w * slide_r + before_r * slide_w)
        ends = moved.sum(axis=-1).reshape(6, len(r), 2, -1).sum(axis=2)
        ends[0] += levers.gaps + reach.reshape(2, -1).sum(axis=0)
        all_r, all_w = (each[..., -1].reshape(len(r), 2, -1) for each in (after_r, after_w))
        table = np.zeros((6, len(r), 4, len(levers.gaps)))
        table[0, :, :3] = 1.0
        table[1, :, :2], table[2, :, :2], table[3, :, :2] = all_r, all_w, all_r**2
        table[4, :, :2], table[5, :, :2] = all_r * all_w, all_r**2 * all_w
        table[:, :, _GAP] = ends
        return table

    def _component(self, part: Coordinate, q_free: Array, box: Array, r: Array, w: Array) -> tuple[Array, Array]:
        """The same for a row of α that reads one component of a joint's pose."""
        slides = np.array(part.kind.slides)
        far = float(box[slides].sum())
        turn_r, turn_w, slide_r, slide_w = (
            each.sum(axis=1) for each in (r[:, ~slides], w[:, ~slides], r[:, slides], w[:, slides])
        )
        if part.slides[0]:
            second = turn_r * slide_w + turn_w * slide_r + turn_r * turn_w * far
            return second, turn_r * (2.0 * turn_w * slide_r + turn_r * slide_w + turn_r * turn_w * far)
        if part.kind.unit != 4:
            return np.zeros(len(r)), np.zeros(len(r))
        vector = part.kind.rotation_vector(q_free[part.q_free], self._coordinates.q_reference[part.q_free])
        second, third = _logarithm_bounds(float(np.linalg.norm(vector) + box[~slides].sum()))
        return second * turn_r * turn_w, third * turn_r**2 * turn_w


class _Step(NamedTuple):
    """One velocity component of a chain: its column, whether it slides, and the ball it is a part of (0: none)."""

    column: int
    slides: bool
    ball: int


def _steps(joint: TreeJoint) -> list[_Step]:
    """A joint's steps, root side first; those on a circle or a quaternion turn before they slide."""
    steps = zip(range(joint.v.start, joint.v.stop), joint.kind.slides, strict=True)
    ball = joint.number if joint.kind.unit == 4 else 0
    found = [_Step(column, slides, 0 if slides else ball) for column, slides in steps]
    return sorted(found, key=lambda step: step.slides) if joint.kind.unit else found


class _Sides:
    """One side of every product: which loop's vector it is, of which frame, and how long."""

    def __init__(self, vectors: list[tuple[int, Vector]]) -> None:
        self._loops = np.array([loop for loop, _ in vectors], dtype=np.intp)
        fixed = [vector if isinstance(vector, Fixed) else None for _, vector in vectors]
        self._codes = np.array([_GAP if each is None else _CODES[each.frame] for each in fixed], dtype=np.intp)
        self._lengths = np.array([1.0 if each is None else float(np.linalg.norm(each.local)) for each in fixed])

    def of(self, table: Array) -> Array:
        """The vectors' sizes and those of their derivatives, of shape (6, k, T)."""
        return np.asarray(table[:, :, self._codes, self._loops] * self._lengths)


def _slopes(term: ResolvedTerm, q_free: Array, box: float) -> tuple[float, float]:
    """Largest second and third derivative of a coupling's polynomial within `box` of a configuration."""
    if len(term.coefficients) <= 2:
        return 0.0, 0.0
    far, sizes = abs(term.angle(q_free)) + box, np.abs(term.coefficients)
    derivatives = (np.polynomial.polynomial.polyder(sizes, order) for order in (2, 3))
    second, third = (float(np.polynomial.polynomial.polyval(far, each)) for each in derivatives)
    return second, third


def _logarithm_bounds(angle: float) -> tuple[float, float]:
    """Of the second and third derivative of w ↦ log(R exp(w)) while its length stays below `angle`; infinite from π on.

    Its first is J⁻¹(r) J(w), and the norms of J⁻¹ and its derivatives are no larger than G(|r|), G′, G″ with the series
    G(t) = Σ |B_k| t^k/k! = 2 + t/2 − (t/2) cot(t/2) of Bernoulli numbers; those of J are at most 1, 1/2 and 1/3.
    """
    if angle >= math.pi:
        return math.inf, math.inf
    t = max(angle, 0.5)  # G and its derivatives grow with t
    cot, csc = 1.0 / math.tan(0.5 * t), 1.0 / math.sin(0.5 * t)
    g = 2.0 + 0.5 * t - 0.5 * t * cot
    g_1 = 0.5 - 0.5 * cot + 0.25 * t * csc**2
    g_2 = 0.5 * csc**2 - 0.25 * t * csc**2 * cot
    second = g_1 * g + 0.5 * g
    return second, g_2 * g * g + g_1 * second + g_1 * g + g / 3.0
