"""One box: existence and uniqueness of σ by a parametric Krawczyk operator (averaged Newton–Kantorovich).

Theorem K and the corollary of gluing are stated and proved in `ccpin/proof/theorems/boxes.md`. Here boxes are made and
its inequalities checked: Y, Z and Z̄ from `bounds`, (K1) and (K2) in `verify`.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, choice, rows_of
from ccpin.domain.bounds import Bounds, Frame
from ccpin.domain.bounds_planar import Phasors, phasor_values, phasors_of, planar_bounds
from ccpin.domain.bounds_reach import reach_bounds
from ccpin.domain.chain_stack import ChainStack, Derivatives, derivatives, first_order, stack_chains
from ccpin.domain.chains import ClosureSystem
from ccpin.domain.in_core import certifier
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.rounding import SLACK, widened

BoundsName = Literal["auto", "reach", "planar"]

_INFLATION = 1e-4
_SETTLED = 1.0 + 1e-6
_ROUNDS = 30
_POWERS = 8
_LEAST, _ROOM = 1e-11, 16.0
_LARGEST = 1e6
_ROUNDED = 1e-9  # room in κ for bounds computed in another order (the compiled core's)


class Demands(NamedTuple):
    """What boxes are to meet besides Theorem K (`ccpin.domain.demands`).

    Attributes:
        lower, upper: Limits of θ, of shape (n′,) each, ±∞ where there is none.
        driven: Indices in θ of the coordinates that motors drive; none: they are not looked at.
        units: What a unit of each parameter counts as where dexterity is measured: 1, or a length for turns, (n,).
        dexterity: The least 1/κ; 0: that the motors determine the motion is all that is asked.
    """

    lower: Array
    upper: Array
    driven: Indices
    units: Array
    dexterity: float


class Problem(NamedTuple):
    """What is to be proved, picklable.

    Attributes:
        system: The closures.
        stack: Their chains side by side.
        phasors: Their phasor form, where planar bounds are used.
        demands: What is asked besides, if anything.
    """

    system: ClosureSystem
    stack: ChainStack
    phasors: Phasors | None
    demands: Demands | None = None


class Boxes(NamedTuple):
    """B certified boxes, exactly the data of Theorem K.

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


class Tried(NamedTuple):
    """Boxes tried, and which of them satisfy Theorem K (the others' numbers mean nothing)."""

    boxes: Boxes
    proved: Mask


def problem_of(system: ClosureSystem, bounds: BoundsName = "auto") -> Problem:
    """Choose the bounds: planar where every chain is planar (``"auto"``), or as told.

    Raises:
        UnsupportedMechanismError: Planar bounds were asked for and the mechanism is not planar.
    """
    choice(bounds, "bounds", ("auto", "reach", "planar"))
    phasors = None if bounds == "reach" else phasors_of(system)
    if bounds == "planar" and phasors is None:
        raise UnsupportedMechanismError(
            "planar bounds need closures whose turning axes are parallel, with slides before the turns; "
            'use bounds="reach"'
        )
    return Problem(system, stack_chains(system.chains, system.n_free, system.m), phasors)


def closure_values(problem: Problem, theta: Array) -> tuple[Array, Array]:
    """φ (B, m) and φ_θ (B, m, n′) at θ (B, n′)."""
    if problem.phasors is not None:
        found = phasor_values(problem.phasors, theta)
        return found.phi, found.jacobian
    return first_order(problem.system, problem.stack, theta)[:2]


def closure_derivatives(problem: Problem, theta: Array) -> Derivatives:
    """φ, φ_θ and φ_θθ at θ (B, n′), each entry within γ · magnitude."""
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        return Derivatives(*core.derivatives(theta))
    return derivatives(problem.system, problem.stack, theta)


def bounds_of(problem: Problem, boxes: Boxes, modes: Array | None = None) -> Bounds:
    """The bounds that Theorem K needs, for boxes as given (h is widened here), or with another E (B, n′, m)."""
    system, theta = problem.system, boxes.centre
    if modes is None:
        modes = np.zeros((*theta.shape, system.m))
        modes[:, system.dependent] = boxes.modes
    half = widened(measured_from(system, boxes), boxes.half)
    frame = Frame(boxes.preconditioner, boxes.directions, modes, half, system.rounding * system.magnitude(theta))
    if problem.phasors is not None:
        return planar_bounds(problem.phasors, phasor_values(problem.phasors, theta), frame)
    return reach_bounds(problem.stack, theta, derivatives(system, problem.stack, theta), frame)


def measured_from(system: ClosureSystem, boxes: Boxes) -> Array:
    """What the parameters δ are measured from, for `widened`: q_c, of shape (B, n), where they are those of q-space.

    Else |θ_c| at most, of shape (B, 1).
    """
    if boxes.half.shape[1] == system.n:
        return np.asarray(boxes.centre[:, system.independent])
    return np.asarray(np.abs(boxes.centre).max(axis=1, keepdims=True))


def verify(problem: Problem, boxes: Boxes) -> Mask:
    """Check (K1) and (K2) for boxes as they are, from scratch; of shape (B,)."""
    with np.errstate(all="ignore"):
        return _holds(bounds_of(problem, boxes), boxes)


def _holds(bounds: Bounds, boxes: Boxes) -> Mask:
    radius, weight = boxes.radius, boxes.weight
    image = bounds.y + bounds.mean(radius).of(radius)
    shrunk = bounds.contraction(radius, weight).of(weight)
    inside = np.all(image * SLACK < radius, axis=1)
    contracts = np.all(shrunk * SLACK <= boxes.kappa[:, None] * weight, axis=1)
    finite = np.isfinite(image + shrunk).all(axis=1) & (boxes.kappa < 1.0)
    return np.asarray(inside & contracts & finite & np.all(weight > 0.0, axis=1))


def certify_boxes(problem: Problem, centre: Array, half: Array, across: Array) -> Tried:
    """Try to prove boxes about approximate solutions, with V = I and, where that fails, singular vectors.

    Singular vectors help where one direction alone is weak, so they are tried there only (`_one_weak`).

    Args:
        problem: The closures.
        centre: θ_c with φ(θ_c) ≈ 0, of shape (B, n′).
        half: h, of shape (B, p).
        across: The independent rows of D, of shape (n, p) or (B, n, p): I for boxes of q-space.
    """
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        columns, proved = core.certify_boxes(centre, half, across)
        return Tried(Boxes(*columns), proved)
    with np.errstate(all="ignore"):
        jacobian = closure_values(problem, centre)[1]
        first = _attempt(problem, _parametrize(problem.system, centre, half, across, jacobian, False), True)
        failed = np.flatnonzero(~first.proved)
        retry = failed[_one_weak(first.boxes.preconditioner[failed])]
        if not retry.size or problem.system.m == 1:
            return first
        rows = across if across.ndim == 2 else across[retry]
        frames = _parametrize(problem.system, centre[retry], half[retry], rows, jacobian[retry], True)
        second = _attempt(problem, frames, True)
    better = retry[second.proved]
    for array, new in zip(first.boxes, second.boxes, strict=True):
        array[better] = new[second.proved]
    first.proved[better] = True
    return first


def certify_points(problem: Problem, theta: Array) -> Tried:
    """Enclose a solution at fixed q near each θ (B, n′): boxes with p = 0 and V the right singular vectors of φ_y."""
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        columns, proved = core.certify_points(theta)
        return Tried(Boxes(*columns), proved)
    count, system = len(theta), problem.system
    with np.errstate(all="ignore"):
        jacobian = closure_values(problem, theta)[1]
        empty = np.zeros((count, 0))
        boxes = _parametrize(system, theta, empty, np.zeros((system.n, 0)), jacobian, True)
        return _attempt(problem, boxes, False)


def _parametrize(
    system: ClosureSystem, centre: Array, half: Array, across: Array, jacobian: Array, singular: bool
) -> Boxes:
    """D, V and Ã from the Jacobian at the centre; R and w still to be found.

    Right singular vectors of φ_y are eigenvectors of φ_y⁻¹φ_y⁻ᵀ, the weakest direction the most accurate.
    """
    count, m = len(centre), system.m
    dependent = jacobian[:, :, system.dependent]
    inverse = inverses(dependent)
    directions = np.zeros((count, system.n_free, half.shape[1]))
    directions[:, system.independent] = across
    directions[:, system.dependent] = -inverse @ (jacobian[:, :, system.independent] @ across)
    modes = np.broadcast_to(np.eye(m), (count, m, m)).copy()
    if singular:
        usable = np.asarray(np.isfinite(inverse).all(axis=(1, 2)))
        modes[usable] = np.linalg.eigh(_gram(inverse[usable]))[1]
    return Boxes(
        centre=centre.copy(),
        half=half.copy(),
        directions=directions,
        modes=modes,
        preconditioner=np.swapaxes(modes, 1, 2) @ inverse,
        radius=np.zeros((count, m)),
        weight=np.ones((count, m)),
        kappa=np.ones(count),
    )


def _gram(inverse: Array) -> Array:
    """φ_y⁻¹φ_y⁻ᵀ, of shape (B, m, m): its eigenvalues are 1/σ² for the singular values σ of φ_y."""
    return np.asarray(inverse @ np.swapaxes(inverse, 1, 2))


def _one_weak(inverse: Array) -> Mask:
    """Whether one singular value of φ_y is well below all others: Σ 1/σ⁴ ≥ 0.6 (Σ 1/σ²)², of shape (B,)."""
    gram = _gram(inverse)
    return np.asarray(np.sum(gram**2, axis=(1, 2)) >= 0.6 * np.trace(gram, axis1=1, axis2=2) ** 2)


def _attempt(problem: Problem, boxes: Boxes, roomy: bool) -> Tried:
    """Find R and w, then check strictly; a `roomy` R is well above rounding, so that boxes can be glued."""
    bounds = bounds_of(problem, boxes)
    radius = _radius(bounds)
    if roomy:
        rounding = problem.system.rounding * problem.system.magnitude(boxes.centre)
        noise = rounding[:, None] * np.abs(boxes.preconditioner).sum(axis=2)
        radius = np.maximum(radius + noise, np.maximum(_LEAST, _ROOM * noise))
    candidates = np.flatnonzero(np.isfinite(radius).all(axis=1))
    proved = np.zeros(len(radius), dtype=np.bool_)
    boxes.radius[:] = radius
    if candidates.size:
        bounds = bounds.take(candidates)
        boxes.weight[candidates], boxes.kappa[candidates] = weights_for(bounds, radius[candidates])
        proved[candidates] = _holds(bounds, boxes.take(candidates))
    return Tried(boxes, proved)


def _radius(bounds: Bounds) -> Array:
    """An R with Y + Z̄(R)R < R, near the least; NaN where none is found.

    With Z̄(R)R ≤ M(R)R + t(R) the iteration R ← R′ = (I − M(R))⁻¹(Y + t(R)) from R = Y grows towards the least solution
    and never passes it, as M and t grow with R; a negative entry or one beyond any joint's range says that there
    is none. So does a step that has grown in every entry: the iteration's slope, which grows with R, has reached 1.
    Every other round tries the limit that two steps extrapolate to, a little enlarged. Where
    Y + M(R)R + t(R) < R, the same holds all the way down to R′.
    """
    found = np.full(bounds.y.shape, np.nan)
    active = np.flatnonzero(np.isfinite(bounds.y).all(axis=1))
    here = bounds.take(active)
    base, trial, step = here.y, here.y * (1.0 + _INFLATION), here.y
    for round_number in range(_ROUNDS):
        if not active.size:
            break
        mean = here.mean(trial)
        solved = solve_many(np.eye(base.shape[1]) - mean.matrix, here.y + mean.rest)
        alive: Mask = np.asarray(np.all((solved >= 0.0) & (solved < _LARGEST), axis=1))
        inside: Mask = np.asarray(alive & np.all((here.y + mean.of(trial)) * _SETTLED < trial, axis=1))
        found[active[inside]] = (solved + 0.1 * (trial - solved))[inside]
        if round_number % 2:
            going, trial = np.flatnonzero(~inside), base
        else:
            last, base, step = step, solved, np.maximum(solved - trial, 0.0)
            growing = (round_number > 0) & np.all(step >= last, axis=1)
            going = np.flatnonzero(alive & ~inside & ~growing)
            rate = np.clip(np.max(step / np.maximum(last, 1e-300), axis=1, keepdims=True), 0.0, 0.98)
            trial = base + step * (rate / (1.0 - rate)) * 1.05 + _INFLATION * base
        active, here = active[going], here.take(going)
        base, trial, step = base[going], trial[going], step[going]
    return found


def weights_for(bounds: Bounds, radius: Array) -> tuple[Array, Array]:
    """A w > 0 with Zw ≤ κw, κ < 1 where the spectral radius allows it, from w = (I − M)⁻¹(1 + t(1)) by power steps.

    The inequality is checked with the factors that (K2) is, so where κ < 1 the spectral radius of Z is proved to be.

    Returns:
        w, of shape (B, m), and κ, of shape (B,).
    """
    image = bounds.contraction(radius, np.ones_like(radius))
    weight = np.abs(solve_many(np.eye(radius.shape[1]) - image.matrix, 1.0 + image.rest))
    best, kappa = np.ones_like(radius), np.full(len(radius), np.inf)
    active = np.arange(len(radius))
    for _ in range(_POWERS):
        weight = weight / weight.max(axis=1, keepdims=True)
        shrunk = bounds.contraction(radius[active], weight).of(weight)
        best[active], kappa[active] = weight, (shrunk / weight).max(axis=1) * SLACK * SLACK + _ROUNDED
        going = np.flatnonzero(~(kappa[active] < 1.0))
        if not going.size:
            break
        weight, active, bounds = 0.5 * (weight + shrunk)[going], active[going], bounds.take(going)
    return best, kappa


# Inverses and solutions of many small matrices, NaN instead of an exception where one is singular.


def inverses(matrices: Array) -> Array:
    """Inverses of a batch; where there is none, NaN."""
    result = np.full_like(matrices, np.nan)
    usable = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    try:
        result[usable] = np.linalg.inv(matrices[usable])
    except np.linalg.LinAlgError:
        for k in np.flatnonzero(usable):
            with suppress(np.linalg.LinAlgError):
                result[k] = np.linalg.inv(matrices[k])
    return result


def solve_many(matrices: Array, right: Array) -> Array:
    """Solve a batch of m×m systems; NaN where singular."""
    if matrices.shape[1] == 2:
        a, b, c, d = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
        det = a * d - b * c
        x, y = right[:, 0], right[:, 1]
        return np.stack([(d * x - b * y) / det, (a * y - c * x) / det], axis=1)
    try:
        return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return apply(inverses(matrices), right)
