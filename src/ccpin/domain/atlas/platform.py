"""Cells in which no closed configuration exists, where legs of known lengths meet in one platform.

Theorem E and its bound over a cell are stated and proved in `ccpin/proof/theorems/platform.md`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, rows_of
from ccpin.domain.atlas.empty import drift
from ccpin.domain.chain_stack import move, stack_chains
from ccpin.domain.chains import Chain, ClosureSystem
from ccpin.proof.rounding import widened

_SAME = 1e-12
_SLACK = 1e-9  # of the sums: far above rounding
_LEAST_VALUE = 1e-12
_RIDGES = (1e-2, 1e-3)
_TURNS = 8
_CHUNK = 20_000
_LEAST = 3  # legs


class Platform(NamedTuple):
    """K legs that meet in a platform, in the r coordinates of their closures' rows.

    Attributes:
        heads: Of each leg the joints that q moves; their tips are where what has a fixed length begins.
        weights: Of these tips in the rows, of shape (K, r, 3).
        offset: What is added, of shape (K, r).
        places: b, of shape (K, r).
        lengths: l, of shape (K,).
    """

    heads: tuple[Chain, ...]
    weights: Array
    offset: Array
    places: Array
    lengths: Array


def platform_of(system: ClosureSystem) -> Platform | None:
    """The legs of a system all of whose closures join a leg to one platform; ``None`` where it is not so."""
    by_rows: dict[bytes, list[Chain]] = {}
    for chain in system.chains:
        by_rows.setdefault(np.any(chain.weights != 0.0, axis=1).tobytes(), []).append(chain)
    if len(by_rows) < _LEAST or any(len(pair) != 2 for pair in by_rows.values()) or np.any(system.couplings):
        return None
    for side in (0, 1):
        legs = [(np.frombuffer(key, dtype=np.bool_), pair[side], pair[1 - side]) for key, pair in by_rows.items()]
        if _one_body([body for _, body, _ in legs], [rows for rows, _, _ in legs]):
            return _legs(system, legs)
    return None


def _one_body(bodies: list[Chain], rows: list[Mask]) -> bool:
    """Whether chains lead to points of one body, each seen by its rows alike."""
    first = bodies[0]
    return all(
        not body.direction
        and all(
            np.array_equal(getattr(first, name), getattr(body, name))
            for name in ("joints", "rotations", "translations", "axes", "prismatic")
        )
        and np.array_equal(first.weights[rows[0]], body.weights[mine])
        for body, mine in zip(bodies, rows, strict=True)
    ) and _seen_whole(first, first.weights[rows[0]])


def _seen_whole(chain: Chain, weights: Array) -> bool:
    """Whether rows see lengths behind a chain's joints as they are: W is orthonormal, and turns keep what it sees."""
    if np.abs(weights @ weights.T - np.eye(len(weights))).max() > _SAME:
        return False
    turn = np.eye(3)
    for rotation, axis, slides in zip(chain.rotations, chain.axes, chain.prismatic, strict=True):
        turn = turn @ rotation
        if len(weights) < 3 and not slides and np.abs(weights @ turn @ axis).max() > _SAME:
            return False
    return len(weights) >= 2


def _legs(system: ClosureSystem, legs: list[tuple[Mask, Chain, Chain]]) -> Platform | None:
    """What each leg is; ``None`` where one is no segment of a fixed length behind joints that q moves."""
    heads, weights, offset, places, lengths = [], [], [], [], []
    for rows, body, leg in legs:
        dependent = np.isin(leg.joints, system.dependent)
        k = int(np.argmax(dependent))
        behind = leg.translations[k + 1 :]
        rigid = dependent.any() and dependent[k:].all() and not leg.prismatic[k:].any() and not np.any(behind)
        if leg.direction or not rigid or not _seen_whole(leg, leg.weights[rows]):
            return None
        above = {name: getattr(leg, name)[:k] for name in ("joints", "rotations", "translations", "axes", "prismatic")}
        heads.append(leg._replace(tip=leg.translations[k], **above))
        weights.append(-leg.weights[rows])
        offset.append(-system.offset[rows])
        places.append(body.weights[rows] @ _at_rest(body, body.tip))
        lengths.append(np.linalg.norm(leg.weights[rows] @ _at_rest(leg, leg.tip)))
    return Platform(tuple(heads), np.array(weights), np.array(offset), np.array(places), np.array(lengths))


def _at_rest(chain: Chain, vector: Array) -> Array:
    """A vector of a chain's last frame in root axes where all joints are at zero."""
    for rotation in chain.rotations[::-1]:
        vector = rotation @ vector
    return vector


def platform_empty(system: ClosureSystem, platform: Platform, centre: Array, half: Array) -> Mask:
    """Which boxes of q-space, centres and half widths (B, n), are proved to hold no closed configuration."""
    if len(centre) > _CHUNK:
        parts = [slice(k, k + _CHUNK) for k in range(0, len(centre), _CHUNK)]
        return np.concatenate([platform_empty(system, platform, centre[part], half[part]) for part in parts])
    theta, width = np.zeros((2, len(centre), system.n_free))
    theta[:, system.independent], width[:, system.independent] = centre, widened(centre, half)
    travel = np.abs(theta) + width
    margin = 4.0 * system.rounding * system.magnitude(travel)
    ends = _Ends.none(len(centre), platform, system)
    for k, (head, weights, offset) in enumerate(zip(platform.heads, platform.weights, platform.offset, strict=True)):
        motion = move(stack_chains((head,), system.n_free, system.m), theta)
        ends.places[:, k] = motion.x[:, 0] @ weights.T + offset
        for at, joint in enumerate(head.joints):
            column = np.flatnonzero(system.independent == joint)
            ends.slopes[:, k, :, column[0]] += motion.b[:, 0, at] @ weights.T * width[:, joint, None]
        moved, missed = drift(head, width, travel)
        ends.moves[:, k], ends.bends[:, k] = moved + margin, missed + margin
    return _violated(platform, ends)


class _Ends(NamedTuple):
    """Where K legs begin, over B cells.

    Attributes:
        places: a at the cells' centres, of shape (B, K, r).
        slopes: J_kj h_j, of shape (B, K, r, n).
        moves: r, of shape (B, K).
        bends: s, of shape (B, K).
    """

    places: Array
    slopes: Array
    moves: Array
    bends: Array

    @classmethod
    def none(cls, count: int, platform: Platform, system: ClosureSystem) -> _Ends:
        """All zero."""
        shape = (count, *platform.places.shape)
        return cls(np.zeros(shape), np.zeros((*shape, system.n)), np.zeros(shape[:2]), np.zeros(shape[:2]))


def _violated(platform: Platform, ends: _Ends) -> Mask:
    """Theorem E for B cells.

    The theorem's gap between its sides is min over R of g(λ, R), concave in λ and linear in R. λ is sought as the best
    answer to the mean of the turns R that were the best answers to the λ before.
    """
    count, _, size = ends.places.shape
    empty, rows = np.zeros(count, dtype=np.bool_), np.arange(count)
    turned = np.broadcast_to(np.eye(size), (count, size, size))
    for turn in range(1, _TURNS + 1):
        here = rows_of(ends, rows)
        weights = _weights(here.places, platform.places, turned, platform.lengths, _RIDGES[turn % 2])
        found, best = _gap_left(platform, here, weights)
        empty[rows[found]] = True
        rows, turned = rows[~found], (turned + (best - turned) / (turn + 1))[~found]
        if not rows.size:
            break
    return empty


def _gap_left(platform: Platform, ends: _Ends, weights: Array) -> tuple[Mask, Array]:
    """Whether weights λ (B, K) prove cells empty, and the turns R that are best for them at the cells' centres."""
    a, r = ends.places, ends.moves
    spread = a - np.sum(weights[..., None] * a, axis=1, keepdims=True)
    aside = platform.places - np.sum(weights[..., None] * platform.places, axis=1, keepdims=True)
    W = weights[..., None] * aside
    left, values, right = np.linalg.svd(np.swapaxes(spread, 1, 2) @ W)
    along = W @ np.swapaxes(right, 1, 2)
    S = np.maximum(np.hypot(values, np.sum(np.abs(along) * r[..., None], axis=1)), _LEAST_VALUE)
    far, near = np.linalg.norm(spread, axis=2), np.linalg.norm(aside, axis=2)
    least = np.sum(weights * (far**2 + near**2 - platform.lengths**2), axis=1) - np.sum(S + values**2 / S, axis=1)
    scaled = along / S[:, None]
    P = weights[..., None] * spread - (scaled * values[:, None]) @ np.swapaxes(left, 1, 2)
    diagonal = weights[:, :, None] * np.eye(weights.shape[1])
    N = diagonal - weights[:, :, None] * weights[:, None] - scaled @ np.swapaxes(along, 1, 2)
    falls = 2.0 * np.abs(np.einsum("bkr,bkrj->bj", P, ends.slopes)).sum(axis=1)
    falls += 2.0 * np.sum(np.linalg.norm(P, axis=2) * ends.bends, axis=1)
    falls += np.einsum("bkl,bk,bl->b", np.abs(N), r, r)
    scale = np.sum(np.abs(weights) * (far + near + platform.lengths + 1.0) ** 2, axis=1)
    unsure = _SLACK * (1.0 + np.abs(weights.sum(axis=1) - 1.0) * 2.0**40) * scale
    return least > falls + unsure, left @ right


def _weights(a: Array, b: Array, turned: Array, lengths: Array, ridge: float) -> Array:
    """Weights λ (B, K), Σ λ = 1, about best for turns R (B, r, r), those of points that lie together alike.

    With R they maximise Σ λ(|a|² + |b|² − 2aᵀRb − l²) − |ā|² − |b̄|² + 2āᵀRb̄ less a ridge, which keeps them small.
    """
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=0)
    count, crossed = a.shape[1], a @ turned @ b.T
    gram = a @ np.swapaxes(a, 1, 2) + b @ b.T - crossed - np.swapaxes(crossed, 1, 2)
    system = np.zeros((len(a), count + 1, count + 1))
    scale = np.trace(gram, axis1=1, axis2=2)[:, None, None] + 1e-9
    system[:, :count, :count] = 2.0 * (gram + ridge * scale * np.eye(count))
    system[:, :count, count] = system[:, count, :count] = 1.0
    right = np.ones((len(a), count + 1))
    right[:, :count] = np.diagonal(gram, axis1=1, axis2=2) - lengths**2
    found = np.linalg.solve(system, right[..., None])[:, :count, 0]
    return np.asarray(found / found.sum(axis=1, keepdims=True))
