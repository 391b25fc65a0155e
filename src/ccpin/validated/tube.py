"""A tube round one enclosed motion that holds all motions from a set of starts.

Setting. ξ = (q, q̇) ∈ ℝᴺ obeys ξ′ = F(ξ), F = (q̇, q̈) on one branch of σ. ξ̄(t) is one solution, enclosed
(`ccpin.validated.enclose`). On a slice of time |τ| ≤ h/2, τ = t − t_m, the tube is

    ξ = ξ̄(t) + A(t)z,  |z| ≤ u,    A(t) = A_m P(τ),    P = I + τL + ½τ²M,

A_m, L, M matrices of doubles, chosen so that A′ ≈ F′(ξ̄)A: the tube moves with the linearised flow (any choice is
allowed). Let E = (h/2)|L| + (h²/8)|M|, with all row sums at most δ < 1, so that |P| ≤ I + E and
|P⁻¹| ≤ I + E + δ²/(1 − δ). Let X = A_m⁻¹F′(ξ̄(t_m))A_m, Y = A_m⁻¹(d/dt F′(ξ̄))A_m over the slice, with
d/dt F′(ξ̄) = F″(ξ̄)[F(ξ̄)], and, with H the range of F″ on a box Ξ about the tube over the slice,
η(p)_ij = Σ_k |A_m⁻¹H[A_m]_k A_m|_ij p_k.

Theorem (tube). Suppose Ξ = Q × V is a box on which σ is proven (`ccpin.validated.branch`; the branch through ξ̄) and D
nonsingular, and let by component

    G ≥ |P⁻¹|(|X − L| + (h/2)|XL − M + Y| + (h²/4)|½XM + YL| + (h³/16)|YM| + ½η(|P|u)|P|),    z₀ + hGu < u.

Then every motion that at the slice's beginning lies in ξ̄ + Az, |z| ≤ z₀, exists over the slice, is closed and
nonsingular, stays in ξ̄ + Az with |z| < u, and ends with |z| ≤ z₀ + hGu. At the next slice, with its own A⁺, |z⁺| ≤
|A⁺⁻¹A|(z₀ + hGu) at the time they share.

Proof. Let e = ξ − ξ̄ = Az. While |z| ≤ u, the segment from ξ̄ to ξ lies in the convex Ξ, so e′ = J̄e with
J̄ = ∫₀¹F′(ξ̄ + se)ds, and z′ = A⁻¹(J̄A − A′)z. By the mean value theorem F′(ξ̄(t)) lies in F′(ξ̄(t_m)) + τ d/dt F′(ξ̄), and
J̄ in F′(ξ̄(t)) + ½H[e], as the weights s have the mean ½. With e = A_m P z,
A⁻¹(J̄A − A′) = P⁻¹(XP + τYP − L − τM + ½A_m⁻¹H[e]A_m P), whose size is at most G. So |z(t)| ≤ z₀ + (t − t₀)Gu < u for
as long as |z| ≤ u holds: it does not cease to, and the compact tube lies where F is analytic. q′ = σ(q) follows one
branch: at the time two slices share, the values of q make up a convex set, on which the σ of either slice is continuous
and the two agree at q̄; where φ_y is nonsingular two continuous solutions that agree at a point of a connected set agree
on it. ∎

Sampled loops. Where a law reads q and q̇ at samples and its efforts u are held, ξ = (q, q̇, u) and F = (q̇, q̈, 0)
between them, N = 2n and the number of motors, and the theorem holds as it is; at a sample the deviation's part in u
becomes Ke, K a mean of the law's ∂u/∂(q, q̇) (`ccpin.validated.growing.sampled_section`), which is one more change of
frame.

The tube's cross-section is cut into pieces to bound H: F″ along the segments lies in the hull of its ranges over the
pieces, each with its σ in the interior of the box on which σ is unique.

All of this is computed in doubles rounded outwards (`ccpin.validated.wide`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.curvature import Curvature, Instants, UnboundedError, at_middles, boxes, curvature
from ccpin.validated.dynamics import ClosedLoop
from ccpin.validated.wide import Wide, exactly, inverse, raised

_TIGHT = 1e-7
_TRIES = 60


class Frames(NamedTuple):
    """What the tube is written in: A_m, L, M of each slice, doubles, and F′ at its middle, of shape (B, N, N)."""

    frame: Array
    rate: Array
    curve: Array
    slope: Wide


class Slice(NamedTuple):
    """A slice of the tube, proven.

    Attributes:
        instant: The slice, alone (B = 1).
        frame, rate, curve: A_m, L, M, of shape (N, N).
        end: A at the slice's end, of shape (N, N).
        bound: u, of shape (N,).
        kept: z₀ + hGu, of shape (N,).
        reach: Half-widths |A_m||P|u of the tube about ξ̄, of shape (N,).
    """

    instant: Instants
    frame: Array
    rate: Array
    curve: Array
    end: Wide
    bound: Array
    kept: Array
    reach: Array

    @property
    def time(self) -> float:
        """t_m in seconds."""
        return float(self.instant.time[0])


class _Terms(NamedTuple):
    """G = constant + Σ_k quadratic_k u_k by slices; A at their beginnings and ends; |P|."""

    constant: Array
    quadratic: Array
    begin: Wide
    end: Wide
    stretch: Array


def frames(loop: ClosedLoop, instants: Instants, begin: Array) -> Frames:
    """Frames that follow the linearised flow from a frame at the first slice's beginning: chosen, not proven.

    Raises:
        UnboundedError: The closed loop is not proven regular at the middles.
    """
    middle = at_middles(loop, instants)
    curve = np.einsum("bijk,bk->bij", middle.bend.mid, middle.value.mid) + middle.slope.mid @ middle.slope.mid
    found, identity = [], np.eye(begin.shape[0])
    for half, first, second in zip(instants.half, middle.slope.mid, curve, strict=True):
        before, after = (identity + t * first + 0.5 * t**2 * second for t in (-half, half))
        frame = np.linalg.solve(before, begin)
        back = np.linalg.inv(frame)
        found.append((frame, back @ first @ frame, back @ second @ frame))
        begin = after @ frame
    chosen = (np.array(part) for part in zip(*found, strict=True))
    return Frames._make([*chosen, middle.slope])


def advance(
    loop: ClosedLoop, instants: Instants, moving: Frames, before: tuple[Wide, Array], room: Array, pieces: int
) -> list[Slice]:
    """The slices proven, in order, up to the first whose tube does not fit into the room for it.

    Args:
        loop: The closed loop.
        instants: B slices.
        moving: Their frames.
        before: A and the bound of |z| at the first slice's beginning.
        room: The bounds of |z| for which σ and F″ are bounded on the slices, of shape (B, N).
        pieces: Into how many intervals each coordinate of a cross-section is cut.

    Raises:
        UnboundedError: σ, ψ_q′ or D is not proven regular on boxes with that room.
    """
    stretch = _stretch(instants.half, moving)
    wide = raised(np.abs(moving.frame) @ (stretch @ room[:, :, None]))[:, :, 0]
    around = boxes(loop, instants, wide, pieces)
    terms = _terms(instants.half, moving, curvature(loop, instants, moving.slope, around), stretch)
    last, bound, found = *before, list[Slice]()
    for k in range(len(room)):
        turned = inverse(terms.begin.at(k))
        if turned is None:
            break
        start = raised((turned @ last).size @ bound)
        fitting = _fitting(terms.constant[k], terms.quadratic[k], 2 * instants.half[k], start, room[k])
        if fitting is None:
            break
        inside, bound = fitting
        last, (frame, rate, curve) = terms.end.at(k), (x[k] for x in moving[:3])
        reach = raised(np.abs(frame) @ (stretch[k] @ inside))
        found.append(Slice(instants.part(np.s_[k : k + 1]), frame, rate, curve, last, inside, bound, reach))
    return found


def _fitting(constant: Array, quadratic: Array, h: float, start: Array, room: Array) -> tuple[Array, Array] | None:
    """u ≤ room with z₀ + hGu < u, and z₀ + hGu; ``None`` where none was found."""
    inside = start
    for _ in range(_TRIES):
        kept = raised(start + h * raised(raised(constant + quadratic @ inside) @ inside))
        if not np.all(kept < room):  # NaN too
            return None
        if np.all(kept < inside):
            return inside, kept
        inside = np.minimum(kept * (1.0 + _TIGHT) + 1e-300, room)
    return None


def _stretch(half: Array, moving: Frames) -> Array:
    """Bounds I + E of |P|, of shape (B, N, N)."""
    time = half[:, None, None]
    off = time * np.abs(moving.rate) + 0.5 * time**2 * np.abs(moving.curve)
    return raised(np.eye(off.shape[-1]) + raised(off))


def _terms(half: Array, moving: Frames, known: Curvature, stretch: Array) -> _Terms:
    """The parts of G.

    Raises:
        UnboundedError: A slice is too long for its frame, or the frame nearly singular.
    """
    time, size = half[:, None, None], moving.frame.shape[-1]
    frame, rate, curve, t = (exactly(x) for x in (*moving[:3], time))
    back = inverse(frame)
    off = stretch - np.eye(size)
    delta = off.sum(axis=2).max(axis=1) * (1.0 + 1e-12)
    if back is None or not np.all(delta < 0.9):
        raise UnboundedError("the tube's cross-section is too thin in some direction for the arithmetic")
    unstretch = raised(stretch + (delta**2 / (1.0 - delta))[:, None, None])
    x = back @ known.slope @ frame
    y = back @ known.change @ frame
    first = (x @ rate - curve + y).size
    second = (exactly(np.array(0.5)) * (x @ curve) + y @ rate).size
    third = (y @ curve).size
    constant = (x - rate).size + raised(time * first + time**2 * second + 0.5 * time**3 * third)
    constant = raised(unstretch @ raised(constant))
    turned = known.bend @ frame.at(np.s_[:, None])  # H[·, A_m]
    turned = turned.swapped(2, 3) @ frame.at(np.s_[:, None])
    flat = Wide(*(z.reshape(len(half), size, size * size) for z in turned))
    bilinear = raised((back @ flat).size).reshape(len(half), size, size, size)
    quadratic = np.einsum("bia,bacd,bcj,bdk->bijk", unstretch, bilinear, stretch, stretch, optimize=True)
    steps = exactly(np.eye(size)) + t * rate, exactly(0.5 * time**2) * curve
    begin = exactly(np.eye(size)) - t * rate + steps[1]
    return _Terms(constant, raised(0.5 * quadratic), frame @ begin, frame @ (steps[0] + steps[1]), stretch)
