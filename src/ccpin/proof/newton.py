"""One interval Newton: existence and uniqueness of σ over boxes, and of points (a parametric Krawczyk operator).

Theorem N and lemma G are stated and proved in `ccpin/proof/theorems/theorem_n.md`. Boxes are proposed elsewhere;
their inequalities are checked here: Y, Z and Z̄ from `bounds`, (N1) and (N2) in `check`.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, inverses, rows_of, solve_many
from ccpin.errors import ConvergenceError
from ccpin.proof.bounds import Bounds, Frame
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.equations import Closures, Problem, closure_values, closures_of
from ccpin.proof.rounding import SLACK, TURN, UNIT_ROUNDOFF, blur, widened
from ccpin.work import side_by_side

_PART = 256  # boxes at once: bounds memory
_POWERS = 8  # steps: more find a w where κ is nearly 1, and none is believed without its inequality
_ROUNDED = 1e-9  # room in κ for bounds computed in another order (the compiled core's)


class Boxes(NamedTuple):
    """B certified boxes, exactly the data of Theorem N.

    Attributes:
        centre: θ_c, of shape (B, n′).
        half: h, of shape (B, p).
        directions: D, of shape (B, n′, p).
        modes: V, of shape (B, m, m).
        preconditioner: Ã, of shape (B, m, m).
        radius: R, of shape (B, m).
        weight: w, of shape (B, m).
        kappa: κ, of shape (B,).
    """

    centre: Array
    half: Array
    directions: Array
    modes: Array
    preconditioner: Array
    radius: Array
    weight: Array
    kappa: Array

    def take(self, index: Indices | Mask) -> Boxes:
        """The boxes chosen by an index or a mask; these themselves where a mask has all."""
        return self if index.dtype == np.bool_ and index.all() else rows_of(self, index)

    def without_rows(self, p: int) -> Boxes:
        """No boxes (B = 0), with p parameters."""
        none = rows_of(self, slice(0))
        return none._replace(half=np.zeros((0, p)), directions=np.zeros((0, self.centre.shape[1], p)))


class Checked(NamedTuple):
    """Which of B boxes fulfil (N1) and (N2), (B,), and Z̄(R)R of these, (B, m)."""

    proved: Mask
    image: Array


def check(equations: Closures, boxes: Boxes) -> Checked:
    """(N1) and (N2) of boxes from their numbers alone: with phasors, where there are any, or else with reach bounds."""
    found = Checked(np.zeros(len(boxes.kappa), dtype=np.bool_), np.zeros_like(boxes.radius))
    plain = np.all(boxes.modes == np.eye(equations.system.m), axis=(1, 2))
    for reach in (False, True) if equations.phasors is not None else (True,):
        each = [np.flatnonzero(alike & ~found.proved) for alike in (plain, ~plain)]
        parts = [rows[first : first + _PART] for rows in each for first in range(0, len(rows), _PART)]
        for part, done in zip(parts, side_by_side(partial(_checked, equations, boxes, reach), parts), strict=True):
            found.proved[part], found.image[part] = done
    return found


def _checked(equations: Closures, boxes: Boxes, reach: bool, rows: Indices) -> Checked:
    """The same of some of the boxes, with one kind of bounds."""
    some = boxes.take(rows)
    with np.errstate(all="ignore"):
        return holds(equations.bounds(some.centre, frame_of(equations, some), reach), some)


def holds(bounds: Bounds, boxes: Boxes) -> Checked:
    """Whether (N1) Y + Z̄(R)R < R and (N2) Z(R)w ≤ κw, κ < 1, w > 0 hold, given bounds of B boxes."""
    radius, weight = boxes.radius, boxes.weight
    image, shrunk = bounds.mean(radius).of(radius), bounds.contraction(radius).of(weight)
    inside = np.all((bounds.y + image) * SLACK < radius, axis=1)
    contracts = np.all(shrunk * SLACK <= boxes.kappa[:, None] * weight, axis=1)
    finite = np.isfinite(bounds.y + image + shrunk).all(axis=1) & (boxes.kappa < 1.0)
    return Checked(np.asarray(inside & contracts & finite & np.all(weight > 0.0, axis=1)), image)


def bounds_of(problem: Problem, boxes: Boxes, modes: Array | None = None) -> Bounds:
    """The bounds that Theorem N needs, for boxes as given (h is widened here), or with another E (B, n′, m)."""
    equations = closures_of(problem)
    return equations.bounds(boxes.centre, frame_of(equations, boxes, modes))


def frame_of(equations: Closures, boxes: Boxes, modes: Array | None = None) -> Frame:
    """Boxes as Theorem N has them: E = [0; V] if no other is given, h widened."""
    system, theta = equations.system, boxes.centre
    if modes is None:
        modes = np.zeros((*theta.shape, system.m))
        modes[:, system.dependent] = boxes.modes
    return Frame(boxes.preconditioner, boxes.directions, modes, reached(system, boxes), equations.rounding(theta))


def reached(system: ClosureSystem, boxes: Boxes) -> Array:
    """h as the theorem has it, widened: by what δ is measured from, q_c where the parameters are q, else |θ_c|."""
    if boxes.half.shape[1] == system.n:
        return widened(boxes.centre[:, system.independent], boxes.half)
    return widened(np.abs(boxes.centre).max(axis=1, initial=0.0, keepdims=True), boxes.half)


def noise_of(equations: Closures, boxes: Boxes) -> Array:
    """What f may be off by in the boxes, of shape (B, m)."""
    size = np.abs(boxes.centre) + apply(np.abs(boxes.directions), boxes.half)
    size[:, equations.system.dependent] += apply(np.abs(boxes.modes), boxes.radius)
    return np.asarray(np.abs(boxes.preconditioner).sum(axis=2) * equations.rounding(size)[:, None])


def weights_for(bounds: Bounds, radius: Array) -> tuple[Array, Array]:
    """A w > 0 with Zw ≤ κw, κ < 1 where the spectral radius allows it, from w = (I − M)⁻¹(1 + t(1)) by power steps.

    The inequality is checked with the factors that (N2) is, so where κ < 1 the spectral radius of Z is proved to be.

    Returns:
        w, of shape (B, m), and κ, of shape (B,).
    """
    image, going = bounds.contraction(radius), np.ones(len(radius), dtype=np.bool_)
    weight = np.abs(solve_many(np.eye(radius.shape[1]) - image.matrix, 1.0 + image.rest(np.ones_like(radius))))
    kappa = np.full(len(radius), np.inf)
    for _ in range(_POWERS):
        weight[going] /= weight[going].max(axis=1, keepdims=True)
        shrunk = image.of(weight)
        kappa[going] = ((shrunk / weight).max(axis=1) * SLACK * SLACK + _ROUNDED)[going]
        going = ~(kappa < 1.0)
        if not going.any():
            break
        weight[going] = 0.5 * (weight + shrunk)[going]
    return weight, kappa


_MOST_STEPS = 20000  # for a κ of nearly 1; what has not come to rounding by then raises


class EnclosedSolution(NamedTuple):
    """A solution at fixed q of each of B proved boxes: |ζ* − ζ| ≤ error in the box's modes.

    Attributes:
        theta: The configuration at ζ, of shape (B, n′).
        zeta: ζ, of shape (B, m).
        error: Of shape (B, m).
    """

    theta: Array
    zeta: Array
    error: Array


def predict(problem: Problem | Closures, boxes: Boxes, delta: Array, zeta: Array | None = None) -> Array:
    """θ_c + Dδ + Eζ, of shape (B, n′), for parameters δ (B, p) and modes ζ (B, m; default 0)."""
    theta = boxes.centre + apply(boxes.directions, delta)
    if zeta is not None:
        theta[:, problem.system.dependent] += apply(boxes.modes, zeta)
    return theta


def solve_in_boxes(problem: Problem | Closures, boxes: Boxes, delta: Array) -> EnclosedSolution:
    """σ at parameters |δ| ≤ h of B proved boxes; it cannot fail.

    A Newton step is taken where it stays in the tube and lowers ‖f‖ (in the box's norm) at least by κ, the step
    ζ ← K(ζ) where it does not. K keeps the tube and contracts by κ (Theorem N), so ‖f(ζ)‖ = ‖ζ − K(ζ)‖ falls by κ at
    least in every step, until rounding; then ‖ζ − ζ*‖ ≤ ‖f(ζ)‖/(1 − κ).
    """
    active = np.arange(len(delta))
    zeta, size = np.zeros_like(boxes.radius), np.empty(len(delta))
    margin = np.max(noise_of(closures_of(problem), boxes) / boxes.weight, axis=1)
    here, at = boxes, zeta
    now = _evaluate(problem, here, delta, at)
    for _ in range(_MOST_STEPS):
        size[active], zeta[active] = now.size, at
        going = now.size > margin[active]
        if not np.any(going):
            error = (SLACK * (size + margin) / (1.0 - boxes.kappa))[:, None] * boxes.weight
            return EnclosedSolution(predict(problem, boxes, delta, zeta), zeta, error)
        active, here, at = active[going], here.take(going), at[going]
        now = rows_of(now, going)
        at, now = _step(problem, here, delta[active], at, now)
    raise ConvergenceError("the certified iteration did not reach rounding: a box was altered since it was proved")


class _Evaluation(NamedTuple):
    """f (B, m), ‖f‖ (B,) and the Newton step in ζ (B, m)."""

    residual: Array
    size: Array
    step: Array


def _evaluate(problem: Problem | Closures, boxes: Boxes, delta: Array, zeta: Array) -> _Evaluation:
    phi, jacobian = closure_values(problem, predict(problem, boxes, delta, zeta))
    residual = apply(boxes.preconditioner, phi)
    slope = boxes.preconditioner @ jacobian[:, :, problem.system.dependent] @ boxes.modes
    return _Evaluation(residual, np.max(np.abs(residual) / boxes.weight, axis=1), -solve_many(slope, residual))


def _step(
    problem: Problem | Closures, boxes: Boxes, delta: Array, zeta: Array, now: _Evaluation
) -> tuple[Array, _Evaluation]:
    trial = zeta + now.step
    inside = np.all(np.abs(trial) <= boxes.radius, axis=1)
    trial = np.where(inside[:, None], trial, zeta - now.residual)
    after = _evaluate(problem, boxes, delta, trial)
    worse = np.flatnonzero(inside & ~(after.size <= boxes.kappa * now.size))
    if worse.size:
        trial[worse] = zeta[worse] - now.residual[worse]
        again = _evaluate(problem, boxes.take(worse), delta[worse], trial[worse])
        for array, new in zip(after, again, strict=True):
            array[worse] = new
    return trial, after


def without_turns(gap: Array, periodic: Mask) -> Array:
    """Differences (…, k) without the whole turns of those of the k coordinates that are periodic."""
    return np.asarray(gap - np.where(periodic, TURN * np.round(gap / TURN), 0.0))


def within(problem: Problem, boxes: Boxes, delta: Array) -> Mask:
    """Whether parameters δ (B, p) are of the boxes that their theorem is about, of shape (B,)."""
    return np.asarray(np.all(np.abs(delta) <= reached(problem.system, boxes), axis=1))


def encloses(
    problem: Problem | Closures, boxes: Boxes, delta: Array, theta: Array, error: Array, modes: Array | None = None
) -> Mask:
    """Whether solutions known as θ + modes · [−error, error] (dependent coordinates) lie in the boxes' tubes at δ.

    Near singularities an error is large in one direction and must be small in the others, so it may be given (B, m) in
    modes (B, m, m; default I).
    """
    dependent = problem.system.dependent
    blurred = apply(np.abs(boxes.directions[:, dependent]), blur(delta))
    plain = np.array_equal(boxes.modes, np.broadcast_to(np.eye(len(dependent)), boxes.modes.shape))
    tubes = TubesAt(predict(problem, boxes, delta), boxes.radius, None if plain else boxes.modes)
    return in_tubes(problem.system, tubes, blurred, SolutionBall(theta, error, modes))


class SolutionBall(NamedTuple):
    """What solutions are known to: θ (B, n′) and V · [−error, error] (B, m) in the dependent coordinates."""

    theta: Array
    error: Array
    modes: Array | None


class TubesAt(NamedTuple):
    """θ_c + Dδ (B, n′) of boxes, their R (B, m), and their V (B, m, m), where it is not I."""

    base: Array
    radius: Array
    modes: Array | None


def in_tubes(system: ClosureSystem, tubes: TubesAt, blurred: Array, ball: SolutionBall) -> Mask:
    """Whether what balls hold lies in tubes, whose q and so θ_c + Dδ may be off by `blurred` (B, m); of shape (B,).

    Periodic coordinates are compared modulo 2π; 1e-13 is allowed for rounding.
    """
    gap = without_turns((ball.theta - tubes.base)[:, system.dependent], system.periodic[system.dependent])
    blurred = blurred + 1e-13 * (1.0 + np.abs(ball.theta[:, system.dependent]))
    if tubes.modes is None and ball.modes is None:
        return np.asarray(np.all((np.abs(gap) + blurred + ball.error) * SLACK <= tubes.radius, axis=1))
    unit, roundings = np.eye(system.m), (system.m + 2) * UNIT_ROUNDOFF
    modes = np.broadcast_to(unit, (len(gap), *unit.shape)) if tubes.modes is None else tubes.modes
    inverse, turned = inverses(modes), unit if ball.modes is None else ball.modes
    size = np.abs(inverse)
    wrong = np.abs(unit - inverse @ modes) + roundings * (unit + size @ np.abs(modes))
    spread = np.abs(inverse @ turned) + roundings * (size @ np.abs(turned))
    reach = np.abs(apply(inverse, gap)) + apply(size, blurred) + apply(spread, ball.error)
    defect = wrong.sum(axis=2).max(axis=1)
    reach += (2.0 * defect * reach.max(axis=1))[:, None]  # Vζ = x has |ζ| ≤ |Mx| + X|ζ|, M the inverse as computed
    return np.asarray((defect < 0.5) & np.all(reach * SLACK <= tubes.radius, axis=1))
