"""Legs of known lengths that cannot meet in one body, over boxes of q.

**Lemma.** Let R be orthogonal, and let a_k + p + Rβ_k, k = 1 … K, have the lengths l_k, in two or three dimensions. For
real λ_k that add up to 1, of any sign, W with the rows λ_k(β_k − Σλβ), any invertible T, N = diag λ − λλᵀ − W TᵀT Wᵀ,
and A with the rows a_k

    tr AᵀNA + Σλ_k|β_k|² − |Σλβ|² − ‖T⁻¹‖² ≤ Σλ_k l_k².

*Proof.* With x_k = a_k + Rβ_k the right side is |Σλx + p|² + Σλ_k|x_k|² − |Σλx|². In the last two terms what is mixed
in a and β is 2 Σ a_kᵀRw_k = 2 tr RT⁻¹TWᵀA, w_k the rows of W, and that is at least −‖T⁻¹‖² − ‖TWᵀA‖², ‖·‖ being the
root of the sum of all squares; ‖TWᵀA‖² = tr AᵀWTᵀTWᵀA. ∎

Here a closure's two rows or three see a leg, whose head is moved by q alone and followed by what has a length that is
known, and a body common to some closures: p is where it stands, and β_k a point of it. That R turns what B sees holds
where BBᵀ = I and, for two rows, all turns of the body are about what B does not see: both to 1e-13, which lengths that
are 1e-11 uncertain, of the vectors' own sizes, allow for. Over a box the left side is what it is at the middle and, by
the mean value theorem, 2 Σ_j tr (N A)ᵀ∂_jA δ_j, A and ∂_jA as they are over the box.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat
from scipy.optimize import minimize

from ccpin.auditing.closures import Path, exact, floats
from ccpin.auditing.lengths import PARALLEL, TILT, is_identity, size_of
from ccpin.auditing.reach import ChainGroup, CornerBox, Reach, head_of
from ccpin.auditing.reading import Array

_LEGS = 2  # at least: one leg alone has none to meet
_TRIES = 150  # values of λ for each of its numbers


class _Leg(NamedTuple):
    """One closure: its rows, the number of the chain that is the leg, where that is cut, β as a column, and its length.

    That length is the point's from the body's last joint, which for two rows may be more than |β|.
    """

    rows: tuple[int, ...]
    number: int
    cut: int
    beta: arb_mat
    far: arb


class Legs:
    """The legs of one body."""

    def __init__(self, reach: Reach, legs: list[_Leg]) -> None:
        self.reach, self.legs = reach, legs
        self.size = len(legs[0].rows)
        self.independent = [int(j) for j in reach.document.independent]
        self.betas = _rows([leg.beta for leg in legs])

    @staticmethod
    def of(reach: Reach) -> Legs | None:
        """The body that most legs meet in; ``None`` where there is none."""
        found = dict[bytes, list[_Leg]]()
        for group in reach.groups:
            for side in (0, 1) if len(group.chains) == 2 else ():
                leg = _leg(reach, group, side)
                if leg is not None:
                    found.setdefault(_body(reach, group.rows, group.chains[1 - side]), []).append(leg)
        most = max(found.values(), key=len, default=[])
        return Legs(reach, most) if len(most) >= _LEGS else None

    def cannot_meet(self, box: CornerBox) -> bool:
        """Whether the lemma was proved to be violated for all q of a box."""
        ends = self._ends(box)
        if ends is None:
            return False
        weights = _best(ends, floats(self.betas))
        return self._violated(weights, ends)

    def _ends(self, box: CornerBox) -> _EndBalls | None:
        """Where the legs' heads are; ``None`` where what is behind one has no length that is known."""
        middle, balls = [arb(float(x)) for x in box.middle], box.balls()
        at, over, squares = [], [], []
        slopes = [arb_mat(len(self.legs), self.size) for _ in self.independent]
        for k, leg in enumerate(self.legs):
            behind = self.reach.behind(leg.number, leg.cut, balls)
            if behind is None:
                return None
            path = self.reach.closures.paths[leg.number]
            weights = _chosen(path.weights, leg.rows)
            offset = _chosen(self.reach.closures.offset, leg.rows)
            at.append(_blurred(offset + weights * head_of(path, leg.cut, middle).x))
            moved = head_of(path, leg.cut, balls)
            over.append(_blurred(offset + weights * moved.x))
            for joint, _, along, _ in moved.joints:
                slope = _blurred(weights * along)
                for i in range(self.size):
                    slopes[self.independent.index(joint)][k, i] += slope[i, 0]
            squares.append(_square(behind, leg.far))
        deltas = [balls[j] - middle[j] for j in self.independent]
        return _EndBalls(_rows(at), _rows(over), slopes, deltas, squares)

    def _violated(self, weights: Array, ends: _EndBalls) -> bool:
        """Whether the lemma was proved to be violated by weights, of which the last is what the others leave of 1."""
        given = [arb(float(x)) for x in weights[:-1]]
        lam, beta = [*given, 1 - sum(given, arb(0))], self.betas
        count, size = len(lam), self.size
        mean = [sum((lam[k] * beta[k, i] for k in range(count)), arb(0)) for i in range(size)]
        W = arb_mat(count, size, [lam[k] * (beta[k, i] - mean[i]) for k in range(count) for i in range(size)])
        T = _spread(floats(W).T @ floats(ends.at), ends.moves() @ np.abs(floats(W)))
        if not np.all(np.isfinite(T)):
            return False
        T_ball = exact(T)
        try:
            inverse = T_ball.inv()
        except ZeroDivisionError:
            return False
        TW = T_ball * W.transpose()
        N = -(TW.transpose() * TW)
        for k in range(count):
            for i in range(count):
                N[k, i] += (lam[k] if i == k else arb(0)) - lam[k] * lam[i]
        least = _paired(ends.at, N * ends.at) - _paired(inverse, inverse)
        for k in range(count):
            least += lam[k] * (sum((beta[k, i] ** 2 for i in range(size)), arb(0)) - ends.squares[k])
        least -= sum((x * x for x in mean), arb(0))
        along = N * ends.over
        for slope, delta in zip(ends.slopes, ends.deltas, strict=True):
            least += 2 * _paired(along, slope) * delta
        return bool(least > 0)


class _EndBalls(NamedTuple):
    """Where K legs begin, over a box of q.

    Attributes:
        at, over: A at the middle, and over the box.
        slopes: ∂_jA over the box, of each coordinate.
        deltas: The box less its middle.
        squares: The l_k².
    """

    at: arb_mat
    over: arb_mat
    slopes: list[arb_mat]
    deltas: list[arb]
    squares: list[arb]

    def moves(self) -> Array:
        """About how far each of the a_k is from where it is at the middle, of shape (K,)."""
        apart = self.over - self.at
        rows, columns = apart.nrows(), apart.ncols()
        sizes = [[float(abs(apart[k, i]).upper()) for i in range(columns)] for k in range(rows)]
        return np.asarray(np.linalg.norm(np.array(sizes), axis=1))


def _leg(reach: Reach, group: ChainGroup, side: int) -> _Leg | None:
    """A group's chain as a leg and the other as the body; ``None`` where they are not what the lemma speaks of."""
    number, other = group.chains[side], group.chains[1 - side]
    body = reach.closures.paths[other]
    weights = _chosen(body.weights, group.rows)
    dependent = np.isin(reach.document.chains[number].joints, reach.document.dependent)
    cut = int(np.argmax(dependent)) if np.any(dependent) else len(dependent)
    if not is_identity(weights * weights.transpose()) or not _turns_as_seen(body, weights):
        return None
    rotation = exact(np.eye(3))
    for turn in body.turns:
        rotation = rotation * turn.rotation
    return _Leg(group.rows, number, cut, weights * (rotation * body.tip), size_of(body.tip))


def _turns_as_seen(body: Path, weights: arb_mat) -> bool:
    """Whether turns of a body turn what three rows or two see of it."""
    if weights.nrows() == 3:
        return True
    rotation = exact(np.eye(3))
    for turn in body.turns:
        rotation = rotation * turn.rotation
        if not (turn.prismatic or size_of(weights * (rotation * turn.axis)) < PARALLEL):
            return False
    return bool(weights.nrows() == 2)


def _body(reach: Reach, rows: tuple[int, ...], number: int) -> bytes:
    """What is the same for chains that lead to points of one body, which rows see alike."""
    chain = reach.document.chains[number]
    parts = (chain.joints, chain.rotations, chain.translations, chain.axes, chain.prismatic, chain.weights[list(rows)])
    return b"".join(np.ascontiguousarray(part).tobytes() for part in parts) + bytes([len(rows), len(chain.joints)])


def _chosen(matrix: arb_mat, rows: tuple[int, ...]) -> arb_mat:
    columns = matrix.ncols()
    return arb_mat(len(rows), columns, [matrix[i, j] for i in rows for j in range(columns)])


def _rows(columns: list[arb_mat]) -> arb_mat:
    """Columns as rows of one matrix."""
    return arb_mat(len(columns), columns[0].nrows(), [x for column in columns for x in column.entries()])


def _blurred(vector: arb_mat) -> arb_mat:
    """A vector, uncertain by `TILT` of its size."""
    room = arb(0, TILT) * size_of(vector)
    return arb_mat(vector.nrows(), 1, [x + room for x in vector.entries()])


def _square(behind: list[tuple[arb, arb]], far: arb) -> arb:
    """l² of segments of which the most and the least are known, uncertain by `TILT` of them and of what is `far`."""
    total = sum((most for most, _ in behind), arb(0))
    least = max((low + high - total for high, low in behind), key=lambda x: float(x.lower()), default=arb(0))
    length = total.union(least if least > 0 else arb(0)) + arb(0, TILT) * (total + far)
    return length * length


def _paired(one: arb_mat, other: arb_mat) -> arb:
    """tr XᵀY."""
    return sum((x * y for x, y in zip(one.entries(), other.entries(), strict=True)), arb(0))


def _spread(crossed: Array, moved: Array) -> Array:
    """T with about the least ‖T⁻¹‖² + ‖TX‖² where X is known, each of its directions, to a size."""
    left, values, _ = np.linalg.svd(crossed)
    room = np.abs(left.T) @ moved
    return np.asarray(left.T / np.sqrt(np.hypot(values, room) + 1e-12)[:, None])


def _best(ends: _EndBalls, beta: Array) -> Array:
    """λ with about the most of what the lemma then has on its left, over the box, less what it has on its right."""
    at, moves = floats(ends.at), ends.moves()
    slopes = np.array([floats(slope) for slope in ends.slopes])
    half = np.array([float(abs(delta).upper()) for delta in ends.deltas])
    squares = np.array([float(x.mid()) for x in ends.squares])
    count = len(at)

    def lost(some: Array) -> float:
        lam = np.append(some, 1.0 - some.sum())
        W = lam[:, None] * (beta - lam @ beta)
        T = _spread(W.T @ at, moves @ np.abs(W))
        N = np.diag(lam) - np.outer(lam, lam) - W @ T.T @ T @ W.T
        along = N @ at
        value = np.sum(at * along) + lam @ (np.sum(beta**2, axis=1) - squares) - np.sum((lam @ beta) ** 2)
        value -= np.sum(np.linalg.inv(T) ** 2)
        falls = 2.0 * np.abs(np.einsum("ki,jki->j", along, slopes)) @ half + 2.0 * moves @ np.abs(N) @ moves
        return float(falls - value)

    start = np.full(count - 1, 1.0 / count)
    found = minimize(lost, start, method="Nelder-Mead", options={"maxfev": _TRIES * (count - 1), "fatol": 1e-9})
    return np.append(found.x, 1.0 - found.x.sum())
