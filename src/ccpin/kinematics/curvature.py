"""How much the rows of ψ bend: bounds of the sizes of their second and third derivatives in a ball of displacements.

A configuration near x is written x ⊕ e, with e_i a number for each velocity component: the change of a plain number,
or an exponential coordinate of a circle, a quaternion or a floating pose. Between a loop's ancestor C and one of its
ends stands a chain of turns and slides. A derivative of the end's point p in which the steps i ≤ j ≤ … ≤ k of the
chain take part is z_i × (z_j × … (z_k × (p − o_k))), no longer than the lever d_k of p about step k (1 where k
slides), and zero where a step above it slides; a derivative of a direction fixed in the end is no longer than the
direction. (For a ball joint, one step with three components, in exponential coordinates the same follows from
Duhamel's formula with the sizes of its angular velocities; a floating joint turns first and slides then.) So |p″[a,
b]| ≤ Σ d_max(i,j) |a_i||b_j|, and by Cauchy and Schwarz, with τ_k the number of turns down to k and b, c along some
steps i alone,

    |p′[b]|² ≤ Σ_i d_i² |b|²,    |p″[a, b]|² ≤ Σ_i (τ_i d_i² + Σ_{k below i} d_k²) |a|²|b|²,
    |p‴[a, a, c]|² ≤ Σ_i (τ_i² d_i² + Σ_{k below i} (2 τ_k − 1) d_k²) |a|⁴|c|²

(a slide has 1, τ and τ²; below a turn it counts 1 and 2 τ). A direction has √τ, √(τ n) and n √τ, n its turns. Rows
are sums of products of such vectors, and the product rule bounds them. Steps that one loop alone has move no other
loop's rows, so that the largest of the loops' bounds along their own steps, and the root of the sum of squares of
those along shared ones, make the cluster's. d_k is exact at x, and in the ball |e| ≤ r longer by r √(Σ d_j², j below
k) at most. All norms are Euclidean, lengths counted in a unit of the cluster's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.description.closure_kinds import Fixed, Gap, Product, Row, Vector
from ccpin.kinematics.constraints import ConstraintValue
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.tree import Tree, TreeJoint

_CODES = {"A": 0, "B": 1, "C": 2, "gap": 3}


class _Step(NamedTuple):
    """One step of a chain: its components of q̇′, and whether they slide; all turns of a joint are one step."""

    columns: list[int]
    slides: bool


class _Term(NamedTuple):
    """A product of a loop's row: sizes of two vectors, by code, and the weight it has once lengths are in units."""

    loop: int
    row: int
    weight: float
    left: int
    right: int


class Curvature:
    """Bounds for the rows of loops.

    Args:
        tree: The free system.
        loops: The closures.
        units: Lengths that count as 1, by loop, metres.
    """

    def __init__(self, tree: Tree, loops: Sequence[ResolvedClosure], units: Array) -> None:
        self._units = units
        paths = [*(loop.path_a for loop in loops), *(loop.path_b for loop in loops)]
        chains = [[step for number in path for step in _steps(tree.joints[number - 1])] for path in paths]
        shape = len(chains), max((len(chain) for chain in chains), default=0)
        self._columns = np.full((*shape, 3), tree.model.nv)
        self._shares, self._turns, self._slides = np.zeros((3, *shape))
        for k, chain in enumerate(chains):
            for i, step in enumerate(chain):
                self._columns[k, i, : len(step.columns)] = step.columns
                self._turns[k, i], self._slides[k, i] = not step.slides, step.slides
                self._shares[k, i] = (
                    0.5 if len(step.columns) == 3 else 1.0
                )  # |p − o|² of a ball is half the sum of three
        used = np.bincount([number for loop in loops for number in (*loop.path_a, *loop.path_b)], minlength=1)
        own = [[used[number] == 1 for number in path for _ in _steps(tree.joints[number - 1])] for path in paths]
        self._among = np.zeros((2, *shape))  # steps that the loop alone has, and those it shares
        for k, each in enumerate(own):
            self._among[0, k, : len(each)], self._among[1, k, : len(each)] = each, np.logical_not(each)
        self._count = self._turns.cumsum(axis=1)
        terms = [term for k, loop in enumerate(loops) for term in _terms(k, loop.rows.rows, float(units[k]))]
        self._terms = np.array([term[2:] for term in terms]).reshape(-1, 3)
        self._codes = self._terms[:, 1:].astype(np.intp)
        self._loop = np.array([term.loop for term in terms], dtype=np.intp)
        rows = [(term.loop, term.row) for term in terms]
        self._starts = np.array([k for k, row in enumerate(rows) if not k or row != rows[k - 1]], dtype=np.intp)

    def bounds(self, at: ConstraintValue, radii: Array) -> Array:
        """|ψ″| and |ψ‴| of each loop's rows within the ball about a configuration, r given by loop, of shape (2, 2, L).

        First those along a step that the loop alone has, then along shared ones.
        """
        loops = len(self._units)
        if not loops:
            return np.zeros((2, 2, 0))
        points = at.placed.vectors[-2 * loops :]
        levers = self._levers(at, points) / np.tile(self._units, 2)[:, None]
        below, below_2, below_3 = np.zeros((3, 2 * loops))
        rows = np.zeros((3, *levers.shape))  # what |p′|², |p″|² and |p‴|² have of each step
        for i in reversed(range(levers.shape[1])):
            turns, slides, count = self._turns[:, i], self._slides[:, i], self._count[:, i]
            squares = (levers[:, i] + np.tile(radii, 2) * np.sqrt(below)) ** 2 * turns
            rows[0, :, i] = squares + slides
            rows[1, :, i] = count * rows[0, :, i] + turns * below_2
            rows[2, :, i] = count**2 * rows[0, :, i] + turns * below_3
            below += rows[0, :, i]
            below_2 += rows[0, :, i]
            below_3 += (2 * count - turns) * rows[0, :, i]
        jets = np.zeros((2, 4, 4, loops))  # along own and along shared steps; order; vector
        along = np.einsum("skj,okj->sok", self._among, rows).reshape(2, 3, 2, loops)
        jets[:, 1, 3] = np.sqrt(along[:, 0].sum(axis=1))
        jets[:, 2:, 3] = np.sqrt(along[:, 1:].max(axis=2))
        turned = np.einsum("skj,kj->sk", self._among, self._turns).reshape(2, 2, loops)
        n = turned.sum(axis=0)
        for order in (1, 2, 3):
            jets[:, order, :2] = np.sqrt(turned * n ** (order - 1))
        jets[:, 0, :3] = 1.0
        gap = np.sqrt(((points[loops:] - points[:loops]) ** 2).sum(axis=1)) / self._units
        jets[:, 0, 3] = gap + radii * np.sqrt(along[:, 0].sum(axis=(0, 1)))
        return self._rows(jets)

    def _levers(self, at: ConstraintValue, points: Array) -> Array:
        """d of every turn in its chain, metres, of shape (2 L, S)."""
        spatial = np.concatenate([at.placed.spatial, np.zeros((6, 1))], axis=1).T[self._columns]
        moved = spatial[..., :3] + cross(spatial[..., 3:], points[:, None, None])
        return np.asarray(np.sqrt(self._shares * (moved**2).sum(axis=(-1, -2))) * self._turns)

    def _rows(self, jets: Array) -> Array:
        """The product rule: of x″y + 2 x′y′ + xy″ and the next, one factor along the steps in question."""
        whole = np.concatenate([jets[:1, 0], np.sqrt((jets[:, 1:] ** 2).sum(axis=0))])
        (x, y), (u, v) = ([each[..., self._codes[:, k], self._loop] for k in (0, 1)] for each in (jets, whole))
        second = x[:, 2] * v[0] + x[:, 1] * v[1] + u[1] * y[:, 1] + u[0] * y[:, 2]
        third = (
            x[:, 3] * v[0] + 2 * x[:, 2] * v[1] + u[2] * y[:, 1] + x[:, 1] * v[2] + 2 * u[1] * y[:, 2] + u[0] * y[:, 3]
        )
        rows = np.add.reduceat(self._terms[:, 0] * np.stack([second, third], axis=1), self._starts, axis=2) ** 2
        squares = np.zeros((jets.shape[3], 2, 2))
        np.add.at(squares, self._loop[self._starts], rows.transpose(2, 1, 0))
        return np.asarray(np.sqrt(squares).transpose(1, 2, 0))


def unit_of(tree: Tree, loops: Sequence[ResolvedClosure]) -> float:
    """Half the links' lengths around the longest loop, metres; 1 where there are none."""
    lengths = []
    for loop in loops:
        links = [tree.joints[number - 1].placement[:3, 3] for number in (*loop.path_a, *loop.path_b)]
        lengths.append(sum(float(np.linalg.norm(v)) for v in (*links, loop.frame_a[:3, 3], loop.frame_b[:3, 3])))
    return 0.5 * max(lengths, default=0.0) or 1.0


def _steps(joint: TreeJoint) -> list[_Step]:
    columns = list(zip(range(joint.v.start, joint.v.stop), joint.kind.slides, strict=True))
    both = [_Step([k for k, slide in columns if slide == slides], slides) for slides in (False, True)]
    return [step for step in both if step.columns]


def _terms(loop: int, rows: Sequence[Row], unit: float) -> list[_Term]:
    """The products of a loop's rows; those e·gap with e fixed in one frame along several directions count as one."""
    terms, along = list[_Term](), dict[int, list[Array]]()
    for row in rows:
        longest = max(_gaps(product) for product in row)
        if len(row) == 1 and longest == 1:
            fixed = row[0].left if isinstance(row[0].left, Fixed) else row[0].right
            assert isinstance(fixed, Fixed)
            along.setdefault(_CODES[fixed.frame], []).append(row[0].weight * fixed.local)
            continue
        number = len(terms)
        for product in row:
            weight = _size(product) * unit ** (_gaps(product) - min(longest, 1))
            terms.append(_Term(loop, number, weight, _code(product.left), _code(product.right)))
    for code, directions in along.items():
        terms.append(_Term(loop, len(terms), float(np.linalg.norm(directions, 2)), code, _CODES["gap"]))
    return terms


def _gaps(product: Product) -> int:
    return isinstance(product.left, Gap) + isinstance(product.right, Gap)


def _code(vector: Vector) -> int:
    return _CODES[vector.frame if isinstance(vector, Fixed) else "gap"]


def _size(product: Product) -> float:
    """|w| times the lengths of the vectors that are fixed."""
    fixed = [v for v in (product.left, product.right) if isinstance(v, Fixed)]
    return abs(product.weight) * float(np.prod([np.linalg.norm(vector.local) for vector in fixed]))
