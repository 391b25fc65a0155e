"""The cells that a flood starts from: a lattice laid around q_d, or the boxes of an atlas.

**Turns.** A spring on a turning joint makes V a function on the line, ½ k (θ − θ₀)², while an atlas glues its boxes
modulo 2π in every periodic coordinate. So V over an atlas is V over its boxes turned into the law's own lift: the boxes
that hold q_d such that the law's configuration is in them as it is, every further box by the whole turns that bring it
to the one it is reached from. Turned boxes are proved again (2πk is rounded), and every face is glued again with the
spring-loaded coordinates compared on the line (`Problem` of `on_the_line`); where that fails it is a boundary.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.certified_cells import CellStore, holding
from ccpin.control.stability.set_point.flood import FloodLimits
from ccpin.control.stability.set_point.potential import Potential, gravity_bounds, potential_of
from ccpin.control.stability.set_point.set_point_reading import masses_of, set_point_of, theta_of
from ccpin.control.stability.set_point.well import Well, wells
from ccpin.covering.faces import contacts_of
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import glued
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.closures.seeds import Seed, seed_at_coordinates
from ccpin.domain.closures.system import Reading
from ccpin.errors import InvalidInputError, SingularConfigurationError
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.newton import Boxes, check, encloses, predict

_SHRINK = 0.85  # of the size before: the next one tried
_TRIES = 90  # sizes, the least of them 5e-7 of the largest
_LARGEST = 0.5  # the size tried first: half edges, of the cell's proportions
_LATTICE = 0.7  # of the best single cell's size: that of a lattice's cells
_SEAM = 1e-9  # of an edge: rounding between two cells that touch; a full turn is more


def cells_of_atlas(law: PDSimpleGravity, atlas: Atlas, radii: Array | None = None) -> CellStore:
    """An atlas's boxes; neighbours are those that share a face at which σ was shown to agree.

    The model's constants may be off by radii (p,).

    Raises:
        InvalidInputError: The atlas is another mechanism's, or q_d is not in it, or on another branch.
    """
    mechanism = law.model.mechanism
    if atlas.names != tuple(mechanism.independent) or atlas.reading.chart.n_free != mechanism.n_free:
        raise InvalidInputError(
            f"the atlas is over {', '.join(atlas.names)}; the law's coordinates are {', '.join(mechanism.independent)}"
        )
    if np.any(atlas.region.held):
        raise InvalidInputError("the atlas is a slice, which is no neighbourhood of the set point; certify a region")
    system = atlas.problem.system
    around = holding(atlas.lower, atlas.upper, law.q_d)
    if not around.size:
        raise InvalidInputError(f"the set point {law.q_d} is not in the atlas; certify one around it")
    boxes = atlas.boxes.take(around)
    theta = np.tile(atlas.reading.theta(law.q_free_d), (len(around), 1))
    theta[:, system.independent] = law.q_d
    delta = law.q_d - boxes.centre[:, system.independent]
    if not np.all(encloses(atlas.problem, boxes, delta, theta, np.zeros((len(around), system.m)))):
        raise InvalidInputError("the set point's configuration is on another branch (assembly mode) than the atlas")
    potential = _potential(law, atlas.reading, radii)
    reading = on_the_line(atlas.reading, potential)
    boxes, kept, pairs = atlas.boxes, np.arange(len(atlas.lower)), _glued_pairs(atlas)
    if reading is not atlas.reading:
        boxes, kept, pairs = _turned_to_the_law(reading.problem, atlas, pairs, around, law)
    store = CellStore(reading, potential, set_point_of(law), None)
    store.add_proved(boxes, atlas.lower[kept], atlas.upper[kept], pairs)
    store.whole = len(kept) == len(atlas.lower) and len(pairs) == len(_glued_pairs(atlas))
    return store


def _potential(law: PDSimpleGravity, reading: Reading, radii: Array | None) -> Potential:
    masses = masses_of(law.model.mechanism, reading, law.model.gravity_vector, radii)
    return potential_of(masses, theta_of(law, reading))


def on_the_line(reading: Reading, potential: Potential) -> Reading:
    """The closures, with only those dependent coordinates periodic in which V′ is: no spring acts on them.

    (Independent ones are compared on the line everywhere, as q̃ is.)
    """
    system = reading.system
    sprung = system.periodic & (potential.stiffness != 0.0)
    sprung[system.independent] = False
    if not sprung.any():
        return reading
    problem = reading.problem._replace(system=replace(system, periodic=system.periodic & ~sprung))
    return reading._replace(problem=problem)


class _Turned(NamedTuple):
    """Boxes in the law's lift, the numbers (K,) of the atlas's they are, and the pairs of them that are glued there."""

    boxes: Boxes
    kept: Indices
    pairs: set[tuple[int, int]]


def _turned_to_the_law(
    problem: Problem, atlas: Atlas, pairs: set[tuple[int, int]], around: Indices, law: PDSimpleGravity
) -> _Turned:
    turns, reached = _turns(problem, atlas, pairs, around, law)
    moved = np.any(turns != 0.0, axis=1)
    boxes = atlas.boxes._replace(centre=atlas.boxes.centre + 2.0 * np.pi * turns)
    rows = np.flatnonzero(reached & moved)
    reached[rows] = check(closures_of(problem), boxes.take(rows)).proved
    kept = np.flatnonzero(reached)
    place = np.full(len(reached), -1)
    place[kept] = np.arange(len(kept))
    both = np.array([(i, j) for i, j in sorted(pairs) if reached[i] and reached[j]], dtype=np.intp).reshape(-1, 2)
    first, second = boxes.take(both[:, 0]), boxes.take(both[:, 1])
    points = _between(atlas, both)
    independent = problem.system.independent
    same = glued(problem, first, points - first.centre[:, independent], second, points - second.centre[:, independent])
    return _Turned(boxes.take(kept), kept, {(int(i), int(j)) for i, j in place[both[same]]})


def _turns(
    problem: Problem, atlas: Atlas, pairs: set[tuple[int, int]], around: Indices, law: PDSimpleGravity
) -> tuple[Array, Mask]:
    """Whole turns (B, n′) that bring boxes into the law's lift, first those around q_d, and which were reached."""
    boxes, system = atlas.boxes, problem.system
    on_line = atlas.problem.system.periodic & ~system.periodic
    turns, reached = np.zeros_like(boxes.centre), np.zeros(len(boxes.kappa), dtype=np.bool_)

    def turn(rows: Indices, points: Array, theta: Array) -> None:
        near = boxes.take(rows)
        gap = theta - predict(problem, near, points - near.centre[:, system.independent])
        turns[rows], reached[rows] = np.where(on_line, np.round(gap / (2.0 * np.pi)), 0.0), True

    turn(around, np.tile(law.q_d, (len(around), 1)), atlas.reading.theta(law.q_free_d)[None])
    ends = np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)
    ends = np.concatenate([ends, ends[:, ::-1]])
    while (front := ends[reached[ends[:, 0]] & ~reached[ends[:, 1]]]).size:
        front = front[np.unique(front[:, 1], return_index=True)[1]]
        points, parents = _between(atlas, front), boxes.take(front[:, 0])
        theta = predict(problem, parents, points - parents.centre[:, system.independent])
        turn(front[:, 1], points, theta + 2.0 * np.pi * turns[front[:, 0]])
    return turns, reached


def _between(atlas: Atlas, pairs: Indices) -> Array:
    """The middles of the faces that pairs (K, 2) of an atlas's boxes share, of shape (K, n)."""
    first, second = pairs.T
    low = np.maximum(atlas.lower[first], atlas.lower[second])
    return np.asarray(0.5 * (low + np.minimum(atlas.upper[first], atlas.upper[second])))


def _glued_pairs(atlas: Atlas) -> set[tuple[int, int]]:
    """Boxes (i < j) that share a face at which σ was shown to agree."""
    contacts = contacts_of(atlas.tree, atlas.region, np.flatnonzero(atlas.tree.box >= 0))
    pairs = np.sort(atlas.tree.box[np.column_stack([contacts.cell, contacts.leaf])], axis=1)
    apart = {(int(min(pair)), int(max(pair))) for pair in atlas.unglued}
    pairs = pairs[pairs[:, 0] >= 0]
    return {(int(i), int(j)) for i, j in pairs[_touch_on_the_line(atlas, pairs)]} - apart


def _touch_on_the_line(atlas: Atlas, pairs: Indices) -> Mask:
    """Which pairs share a face as they lie, not only across the seam of a full turn: q̃ is no function on the circle."""
    first, second = pairs.T
    low = np.maximum(atlas.lower[first], atlas.lower[second])
    high = np.minimum(atlas.upper[first], atlas.upper[second])
    edges = np.minimum(atlas.upper[first] - atlas.lower[first], atlas.upper[second] - atlas.lower[second])
    return np.asarray(np.all(high - low >= -_SEAM * edges, axis=1))


def cells_around(law: PDSimpleGravity, gain: float, limits: FloodLimits, radii: Array | None = None) -> CellStore:
    """One cell centred at q_d, beside which others can be laid; the model's constants may be off by radii (p,).

    Its edges are in the proportions of the ellipsoid q̃ᵀ(K_p + ∂g/∂q)q̃ ≤ 1, so that the well rises equally to all
    its faces. With one cell allowed it is the one with the highest level; else somewhat smaller than the largest that
    can be proved with ‖∂g/∂q‖ below the gains (or at all, where there is none).

    Raises:
        SingularConfigurationError: No cell around q_d can be proved.
    """
    model = law.model
    seed = seed_at_coordinates(model.mechanism, law.q_d, law.q_free_d)
    potential = _potential(law, seed.reading, radii)
    trials = _Trials(law, seed, potential)
    single = limits.cells <= 1
    best, level, factor = None, -np.inf, _LARGEST
    for _ in range(_TRIES):
        boxes = trials.box(factor)
        well = trials.well(boxes) if boxes is not None else None
        if boxes is not None and well is not None:
            good = well.beta < gain and well.effort > 0.0
            height = _height(well, boxes.half[0]) if good else -1.0
            if best is None or height > level:
                best, level = boxes, height
            if (not single and good) or 0.0 < height < 0.5 * level:
                break
        factor *= _SHRINK
    if best is None:
        raise SingularConfigurationError(
            f"no box around q_d = {law.q_d} could be certified: it is singular or too close to it",
            q_free=law.q_free_d,
            rcond=0.0,
        )
    if not single:
        best = trials.box(_LATTICE * float(np.max(best.half[0] / trials.proportions))) or best
    corner, edges = law.q_d - best.half[0], 2.0 * best.half[0]
    store = CellStore(on_the_line(seed.reading, potential), potential, set_point_of(law), (corner, edges))
    store.add_first(best, corner, corner + edges)
    return store


class _Trials:
    """Boxes of one shape around q_d."""

    def __init__(self, law: PDSimpleGravity, seed: Seed, potential: Potential) -> None:
        self._law, self._seed, self._problem, self._potential = set_point_of(law), seed, seed.reading.problem, potential
        stiffness = law.K_p + law.model.gravity_derivative(law.q_d, law.q_free_d)
        slopes = np.linalg.norm(law.model.rho(law.q_free_d), axis=0)
        softness = np.diag(np.linalg.inv(stiffness)) if np.linalg.eigvalsh(stiffness)[0] > 0.0 else slopes**-2
        reach = np.sqrt(softness)
        self.proportions = reach / np.max(reach * slopes)

    def box(self, factor: float) -> Boxes | None:
        """The box of half-widths factor · proportions, where it can be proved."""
        half = factor * self.proportions
        attempt = certify_boxes(self._problem, self._seed.theta[None], half[None], np.eye(len(half)))
        return attempt.boxes if attempt.proved[0] else None

    def well(self, boxes: Boxes) -> Well:
        """U over a box."""
        bounds = gravity_bounds(self._problem, self._potential, boxes)
        return wells(self._law, self._law.q_d[None], boxes.half, boxes.directions, bounds)[0]


def _height(well: Well, half: Array) -> float:
    """The least U on the faces of a box around q_d."""
    lower, upper, faces = well.centre - half, well.centre + half, np.diag(np.ones(len(half), dtype=np.bool_))
    ends = [(lower, np.where(face, lower, upper)) for face in faces]
    ends += [(np.where(face, upper, lower), upper) for face in faces]
    return min(well.range_over(*corners).lower for corners in ends)
