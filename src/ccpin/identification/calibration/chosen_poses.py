"""Poses for a calibration, so chosen that what is measured there tells a geometry best (D-optimal).

With Z_i the rows that a pose adds to the equations of numbers (`geometry_fit`: Q₂ᵀB in scales, along the directions
that all candidates together show), N poses know them with the information M = Σ Z_iᵀ Z_i. What is made large is det M,
and with it Borm and Menq's O₁ = (det M)^{1/2r}/√N: a pose is exchanged for the candidate that makes

    det(M + Z_cᵀ Z_c) = det M · det(I + Z_c M⁻¹ Z_cᵀ)

largest, until no exchange gains (V. V. Fedorov, Theory of Optimal Experiments, 1972; T. J. Mitchell, DETMAX,
Technometrics 16, 1974); from a set grown pose by pose, and from random ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr

from ccpin.arrays import Array, Indices, corners, positive, records, whole
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.identification.calibration.calibrating import measured_model, sensors_at, unknown_geometry
from ccpin.identification.calibration.geometry_equations import coordinates_at
from ccpin.identification.calibration.geometry_fit import GeometryFit, observable_directions
from ccpin.identification.calibration.identified_geometry import ROUNDING
from ccpin.identification.calibration.sensors import Sensor
from ccpin.mechanism.mechanism import Mechanism

_STARTS = 4  # random sets from which exchanges begin, beside the one that is grown
_GAIN = 1e-9  # of log det: less is rounding
_RIDGE = 1e-9  # of the mean information: what a growing set begins with
_MOST_CORNERS = 6  # coordinates of which all corners are candidates


class CalibrationPoses(NamedTuple):
    """Poses for a calibration.

    Attributes:
        q: Displacements of the encoders' joints, rad or m, of shape (count, n).
        joints: Their names.
        observability: O₁ at the file's geometry.
        condition: The largest singular value over the least of an observable direction.
        rank: How many directions of the numbers are observable.
        base: As many numbers of the geometry as these poses determine each by itself, the best determined first, beside
            the sensors' own: what to name as `parameters` where single numbers are wanted.
        candidates: How many closed candidates they were chosen from.
    """

    q: Array
    joints: tuple[str, ...]
    observability: float
    condition: float
    rank: int
    base: tuple[str, ...]
    candidates: int


def calibration_poses(
    model: ReducedModel | Mechanism,
    count: int,
    *,
    measure: Iterable[Sensor],
    within: tuple[ArrayLike, ArrayLike],
    parameters: Sequence[str] | None = None,
    known: Sequence[str] = (),
    candidates: int = 300,
    coarsest: float = 5e-3,
    seed: int = 0,
) -> CalibrationPoses:
    """Poses at which sensors tell a geometry best; with encoders of motors and joints those for `identify_geometry`.

    Candidates are drawn within a box, its corners among them; those count at which the mechanism closes on the
    reference's branch.

    Args:
        model: The mechanism.
        count: How many poses.
        measure: What is to measure them, encoders among it.
        within: Least and greatest displacements of the joints that encoders measure and that are independent (or, where
            these are not, of the motors), of shape (n,) each.
        parameters: What is unknown, as of `calibrate`.
        known: What of these is right in the file.
        candidates: How many are drawn.
        coarsest: As of `calibrate`.
        seed: Of the candidates, and of sets from which exchanges begin.

    Raises:
        InvalidInputError: A wrong argument; nothing is observable; or too few poses, or candidates, for the numbers.
        UnsupportedMechanismError: Rows of φ that are redundant.
    """
    sensors = [each.kind for each in records(measure, "measure", Sensor)]
    model, count = measured_model(model_of(model), sensors), whole(count, "count")
    limit = positive(coarsest, "coarsest")
    q = _candidates(model, corners(within, "within", model.n), whole(candidates, "candidates"), whole(seed, "seed", 0))
    if len(q) < count:
        raise InvalidInputError(f"{len(q)} candidates within these limits close, and {count} poses are wanted")
    sensors = sensors_at(model, sensors)
    numbers = unknown_geometry(model, sensors, parameters, known)
    fit = GeometryFit(model, numbers, sensors, q, None, {}, limit)
    W = fit.reduced(fit.first).W.reshape(len(q), -1, len(fit.unknowns))
    s, V = np.linalg.svd(W.reshape(-1, W.shape[2]), full_matrices=False)[1:]
    rank = observable_directions(s * np.sqrt(count / len(q)), limit)
    if not rank:
        raise InvalidInputError("nothing is observable by what is to measure")
    if count * W.shape[1] <= rank:
        least = rank // max(W.shape[1], 1) + 1
        raise InvalidInputError(
            f"{rank} directions of numbers are observable: {count} poses are too few, {least} least"
        )
    chosen = best_set(W @ V[:rank].T, count, np.random.default_rng(seed))
    rows = W[chosen].reshape(-1, W.shape[2])
    s = np.linalg.svd(rows @ V[:rank].T, compute_uv=False)
    return CalibrationPoses(
        q[chosen],
        model.mechanism.independent,
        float(np.exp(np.log(s).mean()) / np.sqrt(count)),
        float(s[0] / s[-1]),
        rank,
        tuple(fit.unknowns[k].name for k in _base(rows, len(numbers), limit)),
        len(q),
    )


def best_set(Z: Array, count: int, rng: np.random.Generator) -> Indices:
    """Of rows Z (C, e, r) of candidates the set of `count` that exchanges lead to with the largest det M."""
    ridge = _RIDGE * count / len(Z) * float((Z**2).sum()) / Z.shape[2]
    grown = list[int]()
    for _ in range(count):
        grown.append(_added(Z, grown, ridge))
    starts = [grown, *(rng.permutation(len(Z))[:count].tolist() for _ in range(_STARTS))]
    found = [_exchanged(Z, start, ridge) for start in starts]
    return np.sort(max(found, key=lambda each: information(Z[each])))


def information(Z: Array) -> float:
    """Log det Σ Zᵀ Z of poses' rows of shape (N, e, r); −∞ where some direction is not seen."""
    s = np.linalg.svd(Z.reshape(-1, Z.shape[2]), compute_uv=False)
    return float(2.0 * np.log(s).sum()) if len(s) == Z.shape[2] and s[-1] > 0.0 else -np.inf


def _exchanged(Z: Array, start: list[int], ridge: float) -> list[int]:
    """The set after exchanges, each of which gains."""
    chosen, best = list(start), -np.inf
    while True:
        for place in range(len(chosen)):
            chosen[place] = _added(Z, chosen[:place] + chosen[place + 1 :], ridge)
        now = information(Z[chosen])
        if now <= best + _GAIN:
            return chosen
        best = now


def _added(Z: Array, chosen: list[int], ridge: float) -> int:
    """The candidate that adds most to a set that it is not in: of the largest det(I + Z_c M⁻¹ Z_cᵀ)."""
    rows = Z[chosen].reshape(-1, Z.shape[2])
    inverse = np.linalg.inv(rows.T @ rows + ridge * np.eye(Z.shape[2]))
    gains = np.linalg.slogdet(np.eye(Z.shape[1]) + Z @ inverse @ Z.transpose(0, 2, 1))[1]
    gains[chosen] = -np.inf
    return int(np.argmax(gains))


def _base(rows: Array, k: int, coarsest: float) -> list[int]:
    """Of k numbers those that pivoting finds independent of one another and of the sensors' own."""
    U, s, _ = np.linalg.svd(rows[:, k:], full_matrices=False)
    own = U[:, s > ROUNDING * s.max(initial=0.0)]
    order = qr(rows[:, :k] - own @ (own.T @ rows[:, :k]), mode="r", pivoting=True)[1].tolist()

    def known(numbers: list[int]) -> int:
        chosen = rows[:, [*numbers, *range(k, rows.shape[1])]]
        s = np.asarray(np.linalg.svd(chosen, compute_uv=False), dtype=np.float64)
        return observable_directions(s, coarsest)

    found: list[int] = order[: min(rows.shape)]
    while found and known(found) < known([]) + len(found):
        found = found[:-1]
    return found


def _candidates(model: ReducedModel, box: tuple[Array, Array], count: int, seed: int) -> Array:
    """Displacements within the box at which the mechanism closes, of shape (C, n)."""
    (lower, upper), n = box, model.n
    drawn = np.random.default_rng(seed).uniform(lower, upper, (count, n))
    if n <= _MOST_CORNERS:
        drawn = np.vstack([list(product(*zip(lower, upper, strict=True))), drawn])
    failures: dict[int, str] = {}
    model.sigma_many(coordinates_at(model, drawn), failures=failures)
    return np.delete(drawn, list(failures), axis=0)
