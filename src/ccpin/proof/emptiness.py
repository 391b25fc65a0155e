"""Cells of q-space in which no closed configuration exists.

Two theorems say so: the triangle inequality (`ccpin/proof/theorems/reach.md`), and Theorem E (`platform.md`) where legs
of known lengths meet in one platform.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask
from ccpin.proof.chains import Chain, ClosureSystem, stack_chains
from ccpin.proof.rounding import widened
from ccpin.proof.tips import move

_SAME = 1e-12  # how far rows may be from orthonormal: far below `_SLACK`
_SLACK = 1e-9  # of the sums: far above rounding
_LEAST_VALUE = 1e-12  # of S: any positive one makes a true bound
_LEAST = 3  # legs


class _Anchor(NamedTuple):
    """A chain cut at its first dependent joint: the head (its tip a_c), and indices in θ of slides in the rest.

    `length` is that of the rest without its slides.
    """

    head: Chain
    length: float
    slides: Indices


class _Group(NamedTuple):
    """The chains of one closure's point rows, and d in those rows."""

    rows: Indices
    anchors: tuple[_Anchor, ...]
    offset: Array


def groups_of(system: ClosureSystem) -> tuple[_Group, ...]:
    """The point closures of a system that can prove a cell empty."""
    by_rows: dict[bytes, list[Chain]] = {}
    for chain in system.chains:
        by_rows.setdefault(np.any(chain.weights != 0.0, axis=1).tobytes(), []).append(chain)
    groups = []
    for key, chains in by_rows.items():
        rows = np.flatnonzero(np.frombuffer(key, dtype=np.bool_))
        anchors = [_anchor(system, chain) for chain in chains]
        plain = not any(chain.direction for chain in chains) and not np.any(system.couplings[rows])
        if plain and None not in anchors and not np.any(system.moduli[rows]):
            kept = tuple(anchor for anchor in anchors if anchor is not None)
            groups.append(_Group(rows, kept, system.offset[rows]))
    return tuple(groups)


def _anchor(system: ClosureSystem, chain: Chain) -> _Anchor | None:
    """A chain cut at its first dependent joint; ``None`` where the rest slides freely."""
    free = np.isin(chain.joints, system.dependent)
    k = int(np.argmax(free)) if np.any(free) else len(chain.joints)
    rest = chain.joints[k:]
    if np.any(chain.prismatic[k:] & free[k:]):
        return None
    lengths = np.linalg.norm(chain.translations[k + 1 :], axis=1).sum() + np.linalg.norm(chain.tip)
    tip, length = (chain.translations[k], float(lengths)) if k < len(chain.joints) else (chain.tip, 0.0)
    above = {name: getattr(chain, name)[:k] for name in ("joints", "rotations", "translations", "axes", "prismatic")}
    head = chain._replace(tip=tip, **above)
    return _Anchor(head, length, rest[chain.prismatic[k:]])


def empty_cells(system: ClosureSystem, groups: tuple[_Group, ...], centre: Array, half: Array) -> Mask:
    """Which boxes of q-space, centres and half widths (B, n), are proved to hold no closed configuration."""
    theta, width = np.zeros((len(centre), system.n_free)), np.zeros((len(centre), system.n_free))
    theta[:, system.independent], width[:, system.independent] = centre, widened(centre, half)
    travel = np.abs(theta) + width
    empty = np.zeros(len(centre), dtype=np.bool_)
    margin = 4.0 * system.rounding * system.magnitude(travel)
    for group in groups:
        gap = np.broadcast_to(group.offset, (len(centre), len(group.rows)))
        reach = margin.copy()
        for anchor in group.anchors:
            weights = anchor.head.weights[group.rows]
            gap = gap + (move(stack_chains((anchor.head,), system.n_free, system.m), theta).x @ weights.T)[:, 0]
            norm = float(np.linalg.norm(weights, 2))
            rest = anchor.length + travel[:, anchor.slides].sum(axis=1)
            reach += norm * (rest + drift(anchor.head, width, travel)[0])
        empty |= np.linalg.norm(gap, axis=1) > reach * (1.0 + 1e-10)
    return empty


def drift(head: Chain, width: Array, travel: Array) -> tuple[Array, Array]:
    """How far a chain's tip can move over boxes of half widths (B, n′) within |θ| ≤ travel, and miss its linearization.

    From the tip to the root, f being what a joint that turns by ω moves what it carries: Y′ + f, and half of
    Y″ + 2ωY′ + ωf, a bound of the second derivative along a step; both of shape (B,).
    """
    length, moved, second = np.full(len(width), np.linalg.norm(head.tip)), *np.zeros((2, len(width)))
    for j in reversed(range(len(head.joints))):
        joint = head.joints[j]
        if head.prismatic[j]:
            moved = moved + width[:, joint]
            length = length + travel[:, joint]
        else:
            own = length * width[:, joint]
            second = second + width[:, joint] * (2.0 * moved + own)
            moved = moved + own
        length = length + np.linalg.norm(head.translations[j])
    return moved, 0.5 * second


# Legs that meet in one platform.


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
        rigid = dependent[k:].all() and not leg.prismatic[k:].any() and not np.any(behind)
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


def ends_over(system: ClosureSystem, platform: Platform, centre: Array, half: Array) -> Ends:
    """Where the legs of a platform begin over boxes of q-space, centres and half widths (B, n)."""
    theta, width = np.zeros((2, len(centre), system.n_free))
    theta[:, system.independent], width[:, system.independent] = centre, widened(centre, half)
    travel = np.abs(theta) + width
    margin = 4.0 * system.rounding * system.magnitude(travel)
    ends = Ends.none(len(centre), platform, system)
    for k, (head, weights, offset) in enumerate(zip(platform.heads, platform.weights, platform.offset, strict=True)):
        motion = move(stack_chains((head,), system.n_free, system.m), theta)
        ends.places[:, k] = motion.x[:, 0] @ weights.T + offset
        for at, joint in enumerate(head.joints):
            column = np.flatnonzero(system.independent == joint)
            ends.slopes[:, k, :, column[0]] += motion.b[:, 0, at] @ weights.T * width[:, joint, None]
        moved, missed = drift(head, width, travel)
        ends.moves[:, k], ends.bends[:, k] = moved + margin, missed + margin
    return ends


class Ends(NamedTuple):
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
    def none(cls, count: int, platform: Platform, system: ClosureSystem) -> Ends:
        """All zero."""
        shape = (count, *platform.places.shape)
        return cls(np.zeros(shape), np.zeros((*shape, system.n)), np.zeros(shape[:2]), np.zeros(shape[:2]))


def empty_by(platform: Platform, ends: Ends, weights: Array) -> tuple[Mask, Array]:
    """Whether weights λ (B, K), Σ λ ≈ 1, prove cells empty (Theorem E), and the best turns R at their centres."""
    a, r = ends.places, ends.moves
    spread = a - np.sum(weights[..., None] * a, axis=1, keepdims=True)
    aside = platform.places - np.sum(weights[..., None] * platform.places, axis=1, keepdims=True)
    W = weights[..., None] * aside
    C = np.swapaxes(spread, 1, 2) @ W
    left, values, right = np.linalg.svd(np.where(np.isfinite(C), C, 0.0))  # else `scale` below is not finite either
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
