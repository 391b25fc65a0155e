"""Tubes said to hold one singular curve each, and curves said to lead from tube to tube.

With x = (θ, w) and any vector l the equations

    G(x) = (φ(θ),  φ_y(θ) w,  lᵀw − 1) = 0

say that θ is a singular closed configuration and that w spans part of the kernel of φ_y. A tube is
x = x₀ + st + e, |s| ≤ δ, |e| ≤ R, e_j = 0, with t_j = ±1. Claimed: for every such s exactly one e has G = 0, and G′
without its column j is nonsingular there; so what of {G = 0} is in it is one smooth arc from end to end.
That is the claim of a box of Theorem N (`boxes`) for G in place of φ, s in place of δ and e in place of ζ, and proved
as that is.

**Lemma (gluing).** Of two proved tubes A and B let two zeros of B's arc, at s₁ < s₂ = 0, lie in A at a₁ < a₂, a₂ > 0,
their w divided by A's lᵀw; or else two of A's, at a₁ = 0 < a₂, in B at s₁ < s₂, s₁ < 0. Then both arcs are of one
curve, and if that is not closed they run the same way along it, B's middle behind A's. Where each tube of a ring is so
glued to the next the curve is closed.

*Proof.* A zero of B's equations is one of A's with w divided by lᵀw, and in A there are none but A's arc. On a curve
that is not closed one arc leads from the one zero to the other, and is passed the same way by A and B; B's
middle, s = 0, is the zero at a₂ > 0 (or A's middle the one at s₁ < 0). In a ring on such a curve a middle would
come after itself. ∎
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import Box, box_proved
from ccpin.auditing.closures import BallClosures, TipMotion, columns, exact, floats
from ccpin.auditing.gluing import near
from ccpin.auditing.reading import Array, Curves, CurveTube, Integers, free_angles

if TYPE_CHECKING:
    from ccpin.auditing.exclusion import Exclusion

_CUTS = 12  # halvings of a cell one after another, before its tube is left undecided
_BACK = (0.4, 0.1)  # of a half length: where the other zero of a gluing is


class Moved(NamedTuple):
    """What G is made of: the chains and the kernel w."""

    motions: list[TipMotion]
    kernel: list[arb]


class Singular:
    """G of closures with a vector l."""

    def __init__(self, closures: BallClosures, dependent: Integers, pairing: Array) -> None:
        self.closures, self.dependent = closures, dependent
        self.pairing = [arb(float(x)) for x in pairing]
        self.m, self.n_free = 2 * closures.m + 1, closures.n_free + closures.m

    def motions(self, x: list[arb]) -> Moved:
        """The chains at θ, and w."""
        return Moved(self.closures.motions(x[: self.closures.n_free]), x[self.closures.n_free :])

    def value(self, x: list[arb], moved: Moved) -> arb_mat:
        """G."""
        inner = columns(self.closures.jacobian(moved.motions), self.dependent)
        turned = inner * arb_mat(len(moved.kernel), 1, moved.kernel)
        paired = sum((w * p for w, p in zip(moved.kernel, self.pairing, strict=True)), arb(-1))
        phi = self.closures.value(x[: self.closures.n_free], moved.motions)
        return arb_mat(self.m, 1, [*phi.entries(), *turned.entries(), paired])

    def jacobian(self, moved: Moved) -> arb_mat:
        """G′."""
        slope, m, size = self.closures.jacobian(moved.motions), self.closures.m, self.closures.n_free
        bent = self.closures.variation(moved.motions, self.lifted(moved.kernel))
        found = self._stacked(slope, bent, columns(slope, self.dependent))
        for k, weight in enumerate(self.pairing):
            found[2 * m, size + k] = weight
        return found

    def variation(self, moved: Moved, direction: list[arb]) -> arb_mat:
        """G″ along a direction."""
        turn, spread = direction[: self.closures.n_free], direction[self.closures.n_free :]
        first = self.closures.variation(moved.motions, turn)
        second = self.closures.second_variation(moved.motions, self.lifted(moved.kernel), turn)
        second = second + self.closures.variation(moved.motions, self.lifted(spread))
        return self._stacked(first, second, columns(first, self.dependent))

    def at(self, x: Array) -> tuple[Array, Array]:
        """G and G′ in plain floating point."""
        balls = [arb(float(v)) for v in x]
        moved = self.motions(balls)
        return floats(self.value(balls, moved))[:, 0], floats(self.jacobian(moved))

    def lifted(self, kernel: list[arb]) -> list[arb]:
        """w as a direction of θ."""
        whole = [arb(0)] * self.closures.n_free
        for w, index in zip(kernel, self.dependent, strict=True):
            whole[int(index)] = w
        return whole

    def _stacked(self, upper: arb_mat, lower: arb_mat, beside: arb_mat) -> arb_mat:
        """[upper 0; lower beside; 0 0]."""
        found, m, size = arb_mat(self.m, self.n_free), self.closures.m, self.closures.n_free
        for i in range(m):
            for j in range(size):
                found[i, j], found[m + i, j] = upper[i, j], lower[i, j]
            for j in range(m):
                found[m + i, size + j] = beside[i, j]
        return found


class TubeEquations(NamedTuple):
    """A tube with its equations, x₀, t and R in balls, and the coordinates beside j."""

    tube: CurveTube
    system: Singular
    centre: list[arb]
    tangent: list[arb]
    radius: list[arb]
    others: Integers


def placed(closures: BallClosures, document: Curves, k: int) -> TubeEquations:
    """The k-th tube of a document."""
    tube = document.tubes[k]
    system = Singular(closures, document.dependent, tube.pairing)
    centre, tangent, radius = (
        [arb(float(x)) for x in values]
        for values in (np.concatenate([tube.theta, tube.kernel]), tube.tangent, tube.radius)
    )
    others = np.delete(np.arange(system.n_free), tube.along)
    return TubeEquations(tube, system, centre, tangent, radius, others)


def one_curve(closures: BallClosures, document: Curves, k: int) -> bool | None:
    """Whether the k-th tube was proved to hold one curve from end to end, and nothing else of {G = 0}.

    ``False``: it is no tube, or has no zero over a place; ``None``: neither.
    """
    at = placed(closures, document, k)
    tube, j = at.tube, at.tube.along
    if not (0 <= j < at.system.n_free and abs(tube.tangent[j]) == 1.0 and tube.radius[j] == 0.0 and tube.half > 0.0):
        return False
    radius = [at.radius[i] for i in at.others]
    box = Box(at.centre, exact(tube.tangent), exact(np.eye(len(at.others))), radius, np.array([tube.half]), at.others)
    return box_proved(at.system, box, _CUTS)


def goes_on(closures: BallClosures, document: Curves, first: int, second: int) -> bool | None:
    """Whether the second tube was proved to be glued to the first; ``None``: it was not."""
    one, other = (placed(closures, document, k) for k in (first, second))
    turning = turns(closures, document)
    return _begins_in(other, one, turning, 1.0) or _begins_in(one, other, turning, -1.0) or None


def listed_once(cover: Exclusion, k: int) -> bool | None:
    """Whether the zero in the middle of the k-th tube was proved to be in no tube of another curve.

    Of a curve that is in two tubes of others somewhere, a middle is in one (``False``), or ends overlap. ``None``: it
    is not decided for a tube.
    """
    mine, own = cover.tubes[k], cover.curve[k]
    x = np.concatenate([mine.tube.theta, mine.tube.kernel])
    found = near(mine.system, mine.others, x)
    if found is None:
        return None
    balls = [arb(float(v), 0.0 if j == mine.tube.along else found[1]) for j, v in enumerate(found[0])]
    undecided = False
    for other in cover.beside(found[0][: mine.system.closures.n_free]):
        if cover.curve[other] == own:
            continue
        if place(balls, cover.tubes[other], cover.turning) is not None:
            return False
        undecided |= not _apart(balls, cover.tubes[other], cover.turning)
    return None if undecided else True


def _apart(x: list[arb], tube: TubeEquations, turning: list[bool]) -> bool:
    """Whether θ of balls was proved to lie beyond a tube in one coordinate, angles modulo 2π."""
    size = tube.system.closures.n_free
    for k, (a, b) in enumerate(zip(x[:size], tube.centre[:size], strict=True)):
        gap = without_turns(a - b) if turning[k] else a - b
        reach = abs(tube.tangent[k]) * tube.tube.half + tube.radius[k]
        if abs(gap) > reach and (not turning[k] or abs(gap) + reach < 2 * arb.pi()):
            return True
    return _beyond(x, tube, turning)


def _beyond(x: list[arb], tube: TubeEquations, turning: list[bool]) -> bool:
    """The same along the tube's own axes, where its reach is so small that other turns lead elsewhere."""
    size, j = tube.system.closures.n_free, tube.tube.along
    if j >= size or any(abs(t) * tube.tube.half + r > 1 for t, r in zip(tube.tangent, tube.radius, strict=True)):
        return False
    gaps = [a - b for a, b in zip(x[:size], tube.centre[:size], strict=True)]
    gaps = [without_turns(gap) if turn else gap for gap, turn in zip(gaps, turning[:size], strict=True)]
    s = gaps[j] * tube.tangent[j]
    return any(abs(gap - t * s) > r for gap, t, r in zip(gaps, tube.tangent[:size], tube.radius[:size], strict=True))


def _begins_in(inner: TubeEquations, outer: TubeEquations, turning: list[bool], sign: float) -> bool:
    """The lemma: the middle zero of a tube, and one before it (`sign` −1: after it), in the other."""
    last = _place_of(inner, 0.0, outer, turning)
    if last is None or not sign * last > 0:
        return False
    for part in _BACK:
        first = _place_of(inner, -sign * part * inner.tube.half, outer, turning)
        if first is not None and sign * (last - first) > 0:
            return True
    return False


def _place_of(inner: TubeEquations, s: float, outer: TubeEquations, turning: list[bool]) -> arb | None:
    """Where the zero of a tube at s lies in another; ``None`` where that is not proved."""
    on_line = np.concatenate([inner.tube.theta, inner.tube.kernel]) + s * inner.tube.tangent
    found = near(inner.system, inner.others, on_line)
    if found is None:
        return None
    zero, radius = found
    balls = [arb(float(v), 0.0 if k == inner.tube.along else radius) for k, v in enumerate(zero)]
    return None if place(balls, inner, turning) is None else place(balls, outer, turning)


def place(x: list[arb], tube: TubeEquations, turning: list[bool]) -> arb | None:
    """s of balls that lie in a tube, w divided by its lᵀw, angles modulo 2π; ``None`` where not all of them do."""
    size = tube.system.closures.n_free
    paired = sum((w * p for w, p in zip(x[size:], tube.system.pairing, strict=True)), arb(0))
    if paired.contains(0):
        return None
    gaps = [a - b for a, b in zip([*x[:size], *(w / paired for w in x[size:])], tube.centre, strict=True)]
    gaps = [without_turns(gap) if turn else gap for gap, turn in zip(gaps, turning, strict=True)]
    s = gaps[tube.tube.along] * tube.tangent[tube.tube.along]
    inside = abs(s) <= tube.tube.half and all(
        abs(gaps[k] - tube.tangent[k] * s) <= tube.radius[k] for k in map(int, tube.others)
    )
    return s if inside else None


def turns(closures: BallClosures, document: Curves) -> list[bool]:
    """Which coordinates of x are angles that φ knows modulo 2π."""
    return [*free_angles(document), *[False] * closures.m]


def without_turns(angle: arb) -> arb:
    """An angle less the whole turns nearest to it."""
    return angle - 2 * arb.pi() * round(float(angle.mid()) / (2.0 * np.pi))
