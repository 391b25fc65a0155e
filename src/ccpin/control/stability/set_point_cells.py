"""The cells that a flood starts from: a lattice laid around q_d, or the boxes of an atlas."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.cells import CellStore, holding
from ccpin.control.stability.flood import Budget
from ccpin.control.stability.well import Well, wells
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cells import contacts_of
from ccpin.domain.boxes import Boxes, Problem, certify_boxes, problem_of
from ccpin.domain.chains import Seed, seed_at_coordinates
from ccpin.domain.gravity_bounds import Potential, gravity_bounds, potential_of
from ccpin.domain.newton import encloses
from ccpin.errors import InvalidInputError, SingularConfigurationError

_SHRINK = 0.85
_TRIES = 90
_LARGEST = 0.5
_LATTICE = 0.7


def cells_of_atlas(law: PDSimpleGravity, atlas: Atlas) -> CellStore:
    """An atlas's boxes; neighbours are those that share a face at which σ was shown to agree.

    Raises:
        InvalidInputError: The atlas is another mechanism's, or q_d is not in it, or on another branch.
    """
    mechanism = law.model.mechanism
    if atlas.names != tuple(mechanism.independent) or atlas.problem.system.chart.n_free != mechanism.n_free:
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
    theta = np.tile(system.theta(law.q_free_d), (len(around), 1))
    theta[:, system.independent] = law.q_d
    delta = law.q_d - boxes.centre[:, system.independent]
    if not np.all(encloses(atlas.problem, boxes, delta, theta, np.zeros((len(around), system.m)))):
        raise InvalidInputError("the set point's configuration is on another branch (assembly mode) than the atlas")
    store = CellStore(atlas.problem, potential_of(mechanism, system, law.model.gravity_vector), law, None)
    store.add_proved(atlas.boxes, atlas.lower, atlas.upper, _glued_pairs(atlas))
    return store


def _glued_pairs(atlas: Atlas) -> set[tuple[int, int]]:
    """Boxes (i < j) that share a face at which σ was shown to agree."""
    contacts = contacts_of(atlas.tree, atlas.region, np.flatnonzero(atlas.tree.box >= 0))
    pairs = np.sort(atlas.tree.box[np.column_stack([contacts.cell, contacts.leaf])], axis=1)
    apart = {(int(min(pair)), int(max(pair))) for pair in atlas.unglued}
    return {(int(i), int(j)) for i, j in pairs[pairs[:, 0] >= 0]} - apart


def cells_around(law: PDSimpleGravity, gain: float, budget: Budget) -> CellStore:
    """One cell centred at q_d, beside which others can be laid.

    Its edges are in the proportions of the ellipsoid q̃ᵀ(K_p + ∂g/∂q)q̃ ≤ 1, so that the well rises equally to all
    its faces. With one cell allowed it is the one with the highest level; else somewhat smaller than the largest that
    can be proved with ‖∂g/∂q‖ below the gains (or at all, where there is none).

    Raises:
        SingularConfigurationError: No cell around q_d can be proved.
    """
    model = law.model
    seed = seed_at_coordinates(model.mechanism, law.q_d, law.q_free_d)
    problem = problem_of(seed.system)
    potential = potential_of(model.mechanism, seed.system, model.gravity_vector)
    trials = _Trials(law, seed, problem, potential)
    single = budget.cells <= 1
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
    half = best.half[0]
    store = CellStore(problem, potential, law, (law.q_d - half, 2.0 * half))
    store.add_first(best, law.q_d - half, law.q_d + half)
    return store


class _Trials:
    """Boxes of one shape around q_d."""

    def __init__(self, law: PDSimpleGravity, seed: Seed, problem: Problem, potential: Potential) -> None:
        self._law, self._seed, self._problem, self._potential = law, seed, problem, potential
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
