"""Where in a box of θ φ_y may be singular at a closed configuration, as a box that leans along the curve of these.

With any vector l, x = (θ, w) and G as in `curves`:

**Lemma B.** Let A hold [φ_y; lᵀ] over a box of θ, P be a matrix with last column p, and u > 0 have
|p| + |1 − PA|u ≤ u, |1 − PA|u < u. Then each w ≠ 0 with φ_y w = 0 in the box is a multiple of one with lᵀw = 1, and
that has |w − p| ≤ |1 − PA|u.

*Proof.* Where lᵀw = 0, w = (1 − PA)w with |1 − PA| of spectral radius below 1, so w = 0. Else lᵀw = 1 may be had:
w = p + (1 − PA)w, hence |w| ≤ Σ |1 − PA|ᵏ|p| ≤ u. ∎

**Lemma C.** Let x_c + st + e, |s| ≤ σ, |e| ≤ r, e_j = 0, and a box B both hold all (θ, w) of Lemma B, and X be a box
that holds x_c and what of x_c + st + e is in B. Let ball matrices G″d hold G″(ξ)d for all ξ in X, and P be a matrix
with row j zero. Each zero of G among the (θ, w) has e in

    −PG(x_c) − PG′(x_c)t s − ½ (PG″t)t s² + (1 − PG′(x_c) − (PG″t)s − ½ PG″e)e,

which may be cut with |e| ≤ r again and again. Where that, or what of it is in B, is nothing, none of the box is
singular; where all of it lies in a proved tube with the same l, all that are lie on its curve.

*Proof.* X is convex: it holds x_c + τd, d = st + e, for 0 ≤ τ ≤ 1, and 0 = G(x_c) + G′(x_c)d + ∫(1 − τ)(G″d)d dτ. As
(G″t)e = (G″e)t at each ξ, (G″d)d = (G″t)t s² + 2(G″t)e s + (G″e)e; the balls are convex, and ∫(1 − τ)dτ = ½. P times
that is 0, and e is added on both sides. ∎

Bends along t are summed with their signs before they are multiplied by s: along a self-motion they cancel, although
several joints turn there by as much as s. The axis-parallel box of θ about what is left of a slanted one, cut with the
first, is the box that is halved next; the slant is found anew in each half.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import defect
from ccpin.auditing.closures import columns, exact, floats, inverse_of
from ccpin.auditing.reach import CornerBox, above, below
from ccpin.auditing.reading import Array
from ccpin.auditing.singular_curves import Singular, TubeEquations, without_turns

_PASSES = 5  # narrowings of one slanted box, at most
_GAIN = 0.8  # of an edge: narrowed again where one is left with less
_HALF = arb(1) / 2  # Lemma C's ½, exact


class SlantedBox(NamedTuple):
    """x_c + st + e, |s| ≤ σ, e between the bounds (0 in row j)."""

    centre: list[arb]
    along: int
    tangent: Array
    half: float
    low: Array
    high: Array

    def balls(self) -> list[arb]:
        """A box about it."""
        s = arb(0, self.half)
        return [
            x + float(t) * s + arb(float(a)).union(arb(float(b)))
            for x, t, a, b in zip(self.centre, self.tangent, self.low, self.high, strict=True)
        ]


def cut_down(box: CornerBox, system: Singular, tube: TubeEquations | None, turning: list[bool]) -> CornerBox | None:
    """What of a box of θ may hold singular configurations (Lemmas B and C); ``None``: none but those of a tube.

    The tube has the system's l, if one is given.
    """
    motions = system.closures.motions(box.balls())
    kernel = _kernel(system, columns(system.closures.jacobian(motions), system.dependent))
    if kernel is None:
        return box
    within = [*box.balls(), *(arb(float(p), float(r)) for p, r in zip(*kernel, strict=True))]
    x = np.concatenate([box.middle, kernel[0]])
    half = np.nextafter(np.maximum(box.high - box.middle, box.middle - box.low), np.inf)
    extent = np.concatenate([half, kernel[1]])
    slope = system.at(x)[1]
    tangent = np.linalg.svd(slope)[2][-1]
    along = int(np.argmax(np.abs(tangent)))
    tangent = tangent / tangent[along]
    others = np.delete(np.arange(system.n_free), along)
    P = inverse_of(slope[:, others])
    if P is None:
        return box
    reach = (extent + np.abs(tangent) * extent[along]) * (1.0 + 1e-12)
    reach[along] = 0.0
    slanted = SlantedBox([arb(float(v)) for v in x], along, tangent, float(extent[along]), -reach, reach)
    for _ in range(_PASSES):
        smaller = _narrowed(system, slanted, P, within)
        if smaller is None or (tube is not None and _inside(smaller, tube, turning)):
            return None
        gained = np.any((smaller.high - smaller.low)[others] < _GAIN * (slanted.high - slanted.low)[others])
        slanted = smaller
        if not gained:
            break
    hull = slanted.balls()[: len(box.low)]
    low = np.maximum(box.low, [below(ball) for ball in hull])
    high = np.minimum(box.high, [above(ball) for ball in hull])
    return None if np.any(low > high) else CornerBox(low, high)


def _kernel(system: Singular, inner: arb_mat) -> tuple[Array, Array] | None:
    """p and |1 − PA|u of Lemma B, φ_y in balls."""
    m = system.closures.m
    A = arb_mat(m + 1, m, [*inner.entries(), *system.pairing])
    left = np.asarray(np.linalg.pinv(floats(A)), dtype=np.float64)
    rest = defect(exact(left) * A)
    rough = np.array([[float(x.upper()) for x in row] for row in rest])
    if not np.all(np.isfinite(rough)) or np.abs(rough).sum(axis=1).max() >= 10.0:
        return None
    u = np.linalg.solve(np.eye(m) - rough, np.abs(left[:, -1]) + 1e-12) if m else np.zeros(0)
    if not np.all(u > 0.0):
        return None
    u = u * (1.0 + 1e-6)
    image = [sum((x * arb(float(v)) for x, v in zip(row, u, strict=True)), arb(0)) for row in rest]
    sound = all(
        abs(arb(float(p))) + y <= float(v) and y < float(v) for p, y, v in zip(left[:, -1], image, u, strict=True)
    )
    return (left[:, -1], np.array([above(y) for y in image])) if sound else None


def _narrowed(system: Singular, box: SlantedBox, P: arb_mat, within: list[arb]) -> SlantedBox | None:
    """What Lemma C leaves, B = `within`; ``None``: nothing."""
    middle, others = 0.5 * (box.low + box.high), [k for k in range(system.n_free) if k != box.along]
    centre = [x + arb(float(d)) for x, d in zip(box.centre, middle, strict=True)]
    half = np.nextafter(np.maximum(box.high - middle, middle - box.low), np.inf)
    half[box.along] = 0.0
    around = box._replace(centre=centre, low=-half, high=half).balls()
    if not all(x.overlaps(y) for x, y in zip(around, within, strict=True)):
        return None
    moved = system.motions([x.intersection(y).union(c) for x, y, c in zip(around, within, centre, strict=True)])
    tangent, e = [arb(float(t)) for t in box.tangent], [arb(0, float(r)) for r in half]
    along, beside = P * system.variation(moved, tangent), P * system.variation(moved, e)
    here = system.motions(centre)
    value, slope = P * system.value(centre, here), P * system.jacobian(here)
    run, bend = slope * exact(box.tangent), along * exact(box.tangent)
    s = arb(0, box.half)
    square = arb(0).union(arb(box.half) * arb(box.half))
    low, high = np.zeros_like(half), np.zeros_like(half)
    for row, k in enumerate(others):
        found = -value[row, 0] - run[row, 0] * s - _HALF * bend[row, 0] * square
        for c in others:
            found = found + (int(c == k) - slope[row, c] - along[row, c] * s - _HALF * beside[row, c]) * e[c]
        low[k], high[k] = max(-half[k], below(found)), min(half[k], above(found))
        if low[k] > high[k]:
            return None
    return box._replace(centre=centre, low=low, high=high)


def _inside(box: SlantedBox, tube: TubeEquations, turning: list[bool]) -> bool:
    """Whether all of it lies in a tube with the same l."""
    j, s = tube.tube.along, arb(0, box.half)
    gap = [x - y for x, y in zip(box.centre, tube.centre, strict=True)]
    gap = [without_turns(g) if turn else g for g, turn in zip(gap, turning, strict=True)]
    e = [arb(float(a)).union(arb(float(b))) for a, b in zip(box.low, box.high, strict=True)]
    t = [arb(float(x)) for x in box.tangent]
    sign = tube.tangent[j]
    reach = (gap[j] + t[j] * s + e[j]) * sign
    if not abs(reach) <= tube.tube.half:
        return False
    for k in map(int, tube.others):
        way = tube.tangent[k] * sign
        off = gap[k] - way * gap[j] + (t[k] - way * t[j]) * s + e[k] - way * e[j]
        if not abs(off) <= tube.radius[k]:
            return False
    return True
