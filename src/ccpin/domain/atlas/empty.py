"""Cells in which no closed configuration exists, by the triangle inequality (`ccpin/proof/theorems/reach.md`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask
from ccpin.domain.chain_stack import move, stack_chains
from ccpin.domain.chains import Chain, ClosureSystem
from ccpin.proof.rounding import widened


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
