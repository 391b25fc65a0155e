"""Geometry from what sensors say at poses that nobody knows exactly: Gauss–Newton with errors in all that is measured.

Let p be the unknown numbers (of the geometry, and the sensors' own), q the coordinates of a pose, and m = h(q; p) + ε
what is measured of it, where φ(q′; p) = 0 and ε has the standard deviations stated. What is minimised is Σ |ε/s|² over
p and the true q of every pose (maximum likelihood, errors in all variables). With A = ∂h/∂q, B = ∂h/∂p and r = m − h in
units of s, and A = [Q₁ Q₂] [R; 0],

    Q₂ᵀ r = Q₂ᵀ B δp,        R δq = Q₁ᵀ (r − B δp),

the first of all poses at once, hold no q any more: Gauss–Newton's step. It starts at the file's geometry and where the
encoders say, and no step is taken on which the sum of squares grows. What a prior states of a number is one more row.

**What is observable.** Lengths count in the mechanism's extent, angles in radians, and W, the rows Q₂ᵀB in these units,
is taken apart, W = U diag(σ) Vᵀ: along V's columns p is known to 1/σ. Where that is more than the coarsest error that
counts (of the extent, or rad), or σ within rounding of 0, nothing is known: gauge freedoms, which change nothing
measured (the size of a linkage that only turns, the origin of a hinge along its axis, a robot moved in the tracker's
view), and what these poses do not show. Such directions stay as the file has them: every step is the shortest that
solves the equations. The covariance is that of the others, V σ⁻² Vᵀ, and a number that unobservable directions change
has none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, FrozenMapping, positive
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.identification.calibration.geometry_equations import ClosedPoses, GeometryEquations, OpenGeometry
from ccpin.identification.calibration.geometry_numbers import changed_mechanism, named_numbers
from ccpin.identification.calibration.identified_geometry import ROUNDING, IdentifiedGeometry
from ccpin.identification.calibration.sensor_kinds import SensorKind, Tracker
from ccpin.programs.recording.constants import Parameter
from ccpin.programs.tape import Expression

_SETTLED = 1e-6  # of standard deviations: a step this short ends the iteration
_FAR = 0.25  # of the extent, or rad: a file whose numbers are farther off is of another mechanism
_UNFIT = 10.0  # of the noise stated: larger residuals are no noise
_MOST_STEPS = 50
_MOST_HALVINGS = 12


class PoseEstimate(NamedTuple):
    """An estimate of numbers and poses; rows are in standard deviations, 0 where nothing was measured.

    Attributes:
        values: p, of shape (k,).
        poses: The poses, closed.
        left: r, of shape (N, d).
        by_q: A, of shape (N, d, n).
        by_numbers: B, of shape (N, d, k).
    """

    values: Array
    poses: ClosedPoses
    left: Array
    by_q: Array
    by_numbers: Array


class NumberEquations(NamedTuple):
    """The equations of numbers alone.

    Attributes:
        W: Of numbers in their scales, of shape (rows, k), the priors' rows last.
        w: Their right side, of shape (rows,).
        Q: [Q₁ Q₂] of every pose, of shape (N, d, d).
        R: Of shape (N, n, n).
    """

    W: Array
    w: Array
    Q: Array
    R: Array


class GeometryFit:
    """What the iteration reads, and what it does at an estimate.

    Args:
        model: The mechanism as its file states it, in coordinates that encoders measure.
        geometry: The numbers of its geometry that are unknown.
        sensors: What is measured, at this mechanism.
        q: About where the independent joints are at the poses, of shape (N, n).
        measured: What the sensors said, `SensorKind.values` of N poses each; ``None``: what they would say.
        priors: Standard deviations of what the file states, by names of numbers.
        coarsest: What is known no better than this, of the extent or rad, counts as not known.

    Raises:
        InvalidInputError: Nothing is unknown, or a prior of nothing.
        ConvergenceError: The stated mechanism cannot be moved to the poses.
        UnsupportedMechanismError: Rows of φ that are redundant: other geometry would not close.
    """

    def __init__(
        self,
        model: ReducedModel,
        geometry: Sequence[Parameter],
        sensors: Sequence[SensorKind],
        q: Array,
        measured: Sequence[Array] | None,
        priors: Mapping[str, float],
        coarsest: float,
    ) -> None:
        mechanism = model.mechanism
        if mechanism.constraints().size != mechanism.n_free - mechanism.n:
            raise UnsupportedMechanismError(
                f"'{mechanism.name}' has more closure rows than it has dependent motions: with other lengths it would "
                "not close, so that single lengths cannot be identified; state closures that are not redundant "
                "(spherical)"
            )
        self.model, self.geometry, self.coarsest = model, tuple(geometry), coarsest
        self._watched = list[slice]()
        self.equations = GeometryEquations(model, self.geometry, self._watching(sensors))
        stated = np.array([each.value for each in self.geometry])
        first = self.equations.closed(self.equations.start(q), stated)
        seen = [first.seen[:, where] for where in self._watched]
        if measured is None:
            measured = [each.shown(what) for each, what in zip(sensors, seen, strict=True)]
        self.measured = tuple(measured)
        self.sensors = tuple(
            each.placed(what, said) for each, what, said in zip(sensors, seen, self.measured, strict=True)
        )
        own = [each.unknowns(model) for each in self.sensors]
        self.unknowns = (*self.geometry, *(number for each in own for number in each))
        if not self.unknowns:
            raise InvalidInputError("nothing is unknown: parameters, known and sensors leave nothing to identify")
        ends = len(self.geometry) + np.cumsum([0, *map(len, own)])
        self.own_places = [slice(*pair) for pair in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
        extent = mechanism.constraints().extent
        self.scales = np.array([extent if each.unit == "m" else 1.0 for each in self.unknowns])
        self.start = np.array([each.value for each in self.unknowns])
        self.noise = np.concatenate([each.noise for each in self.sensors])
        self.said = np.concatenate(
            [
                np.outer(np.isfinite(values).all(axis=1), np.ones(len(each.noise), dtype=bool))
                for each, values in zip(self.sensors, self.measured, strict=True)
            ],
            axis=1,
        )
        spreads = {
            each.name: positive(spread, f"priors[{name!r}]")
            for name, spread in priors.items()
            for each in named_numbers(self.unknowns, [name], "priors")
        }
        told = [k for k, each in enumerate(self.unknowns) if each.name in spreads]
        self._told = told, np.array([1.0 / spreads[self.unknowns[k].name] for k in told])
        self.first = self.at(self.start, first.x, first.signs)

    @property
    def equations_left(self) -> int:
        """How many equations numbers have once the poses have theirs."""
        return int(self.said.sum()) - len(self.said) * self.model.n + len(self._told[0])

    def at(self, values: Array, x: Array, signs: Array | None = None) -> PoseEstimate:
        """An estimate at configurations near by.

        Raises:
            ConvergenceError: The mechanism does not close there.
        """
        poses = self.equations.closed(x, values[: len(self.geometry)], signs)
        left, by_q, by_numbers = list[Array](), list[Array](), list[Array]()
        for each, where, own, said in zip(self.sensors, self._watched, self.own_places, self.measured, strict=True):
            found = each.compared(said, poses.seen[:, where], values[own])
            slopes = np.zeros((*found.left.shape, len(values)))
            slopes[:, :, : len(self.geometry)] = found.by_seen @ poses.by_numbers[:, where]
            slopes[:, :, own] += found.by_own
            left.append(found.left)
            by_q.append(found.by_seen @ poses.by_q[:, where])
            by_numbers.append(slopes)
        weights = self.said / self.noise
        rows = np.where(self.said, np.concatenate(left, axis=1), 0.0) * weights
        A, B = (
            np.where(self.said[:, :, None], np.concatenate(each, axis=1), 0.0) * weights[:, :, None]
            for each in (by_q, by_numbers)
        )
        return PoseEstimate(values, poses, rows, A, B)

    def reduced(self, here: PoseEstimate) -> NumberEquations:
        """The equations of numbers alone."""
        n, (told, weights) = self.model.n, self._told
        Q, R = np.linalg.qr(here.by_q, mode="complete")
        rest = Q[:, :, n:].transpose(0, 2, 1)
        W = (rest @ here.by_numbers).reshape(-1, len(self.unknowns))
        w = np.einsum("Nij,Nj->Ni", rest, here.left).ravel()
        W = np.vstack([W, weights[:, None] * np.eye(len(self.unknowns))[told]]) * self.scales
        return NumberEquations(W, np.concatenate([w, weights * (self.start - here.values)[told]]), Q, R[:, :n])

    def size(self, here: PoseEstimate) -> float:
        """√S, S the weighted sum of squares, priors among them."""
        told, weights = self._told
        return float(np.hypot(np.linalg.norm(here.left), np.linalg.norm(weights * (self.start - here.values)[told])))

    def stepped(self, here: PoseEstimate, step: Array, moves: Array) -> PoseEstimate:
        """The estimate after a step of p and q, or after a part of it on which the sum of squares does not grow.

        Raises:
            ConvergenceError: There is none.
        """
        before, blocked, part = self.size(here), "", 1.0
        along = np.einsum("Nij,Nj->Ni", here.poses.x_by_q, moves)
        along += here.poses.x_by_numbers @ step[: len(self.geometry)]
        for _ in range(_MOST_HALVINGS):
            try:
                there = self.at(here.values + part * step, here.poses.x + part * along, here.poses.signs)
                if self.size(there) <= before * (1.0 + _SETTLED):
                    return there
            except ConvergenceError as error:
                blocked = f" ({error})"
            part *= 0.5
        raise ConvergenceError(f"no step from the geometry reached makes residuals smaller{blocked}; {_doubts(here)}")

    def _watching(self, sensors: Sequence[SensorKind]) -> Callable[[OpenGeometry], list[Expression]]:
        def watch(recorded: OpenGeometry) -> list[Expression]:
            found = list[Expression]()
            for each in sensors:
                seen = each.watched(recorded)
                self._watched.append(slice(len(found), len(found) + len(seen)))
                found += seen
            return found

        return watch


class SettledFit(NamedTuple):
    """Where Gauss–Newton settled, how many directions are observable, and how many steps were taken."""

    estimate: PoseEstimate
    rank: int
    steps: int


def settled(fit: GeometryFit) -> SettledFit:
    """Gauss–Newton's iteration.

    Raises:
        InvalidInputError: Nothing is observable, or there are no more equations than numbers that they determine.
        ConvergenceError: It does not settle.
    """
    here, rank = fit.first, len(fit.unknowns)
    for steps in range(_MOST_STEPS):
        W, w, Q, R = fit.reduced(here)
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        rank = min(rank, _observable(fit, s))
        along = U[:, :rank].T @ w
        step = Vt[:rank].T @ (along / s[:rank]) * fit.scales
        toward = np.einsum("Nji,Nj->Ni", Q[:, :, : fit.model.n], here.left - here.by_numbers @ step)
        if np.hypot(np.linalg.norm(along), np.linalg.norm(toward)) <= _SETTLED * np.sqrt(fit.said.sum()):
            return SettledFit(here, rank, steps)
        here = fit.stepped(here, step, np.linalg.solve(R, toward[:, :, None])[:, :, 0])
    raise ConvergenceError(f"the geometry did not settle in {_MOST_STEPS} steps; {_doubts(here)}")


def observable_directions(s: Array, coarsest: float) -> int:
    """How many of singular values, the largest first, are of directions that are known better."""
    return int((s > max(1.0 / coarsest, ROUNDING * s.max(initial=0.0))).sum())


def _observable(fit: GeometryFit, s: Array) -> int:
    rank, count, equations = observable_directions(s, fit.coarsest), len(fit.said), fit.equations_left
    if not rank:
        names = ", ".join(each.name for each in fit.unknowns)
        raise InvalidInputError(f"nothing of {names} is observable at these {count} poses")
    if rank >= equations:
        raise InvalidInputError(
            f"{count} poses give {equations} equations, and {rank} numbers would be determined by them: measure more "
            "poses, or name what is known"
        )
    return rank


def identified(fit: GeometryFit, found: SettledFit, residuals: Array) -> IdentifiedGeometry:
    """The result, with what is to be told as what is left.

    Raises:
        ConvergenceError: It is no geometry that what was measured and the file speak for.
    """
    here, rank, steps = found
    W = fit.reduced(here).W
    _, s, Vt = np.linalg.svd(W)
    V = Vt[:rank].T / s[:rank] * fit.scales[:, None]
    misfit = fit.size(here) / float(np.sqrt(fit.equations_left - rank))
    moved = (np.abs(here.values - fit.start) / fit.scales)[: len(fit.geometry)]
    if misfit > _UNFIT or moved.max(initial=0.0) > _FAR:
        far = f", and {fit.unknowns[int(np.argmax(moved))].name} is {moved.max():.2g} of its size (or rad) away"
        raise ConvergenceError(
            f"no geometry near the file's explains what was measured: residuals are {misfit:.3g} times the noise "
            f"stated{far if len(moved) else ''}; {_doubts(here)}"
        )
    told = {(each.kind, each.of): float(x) for each, x in zip(fit.geometry, here.values, strict=False)}
    try:
        changed = changed_mechanism(fit.model.mechanism, told)
    except CcpinError as error:
        raise ConvergenceError(f"the identified mechanism does not close at the reference: {error}") from error
    frames = {
        each.name: each.frame(here.values[own])
        for each, own in zip(fit.sensors, fit.own_places, strict=True)
        if isinstance(each, Tracker) and each.free
    }
    return IdentifiedGeometry(
        parameters=tuple(each.name for each in fit.unknowns),
        units=tuple(each.unit for each in fit.unknowns),
        stated=fit.start,
        values=here.values,
        covariance=V @ V.T,
        singular_values=np.concatenate([s, np.zeros(len(fit.start) - len(s))]),
        directions=Vt[rank:] * fit.scales,
        residuals=residuals,
        off=_off(here),
        misfit=misfit,
        iterations=steps,
        description=changed.settled(),
        frames=FrozenMapping(frames),
    )


def _off(here: PoseEstimate) -> Array:
    """Of each pose the largest residual, in standard deviations."""
    return np.asarray(np.abs(here.left).max(axis=1))


def _doubts(here: PoseEstimate) -> str:
    """What to look at where no geometry is found."""
    pose = int(np.argmax(_off(here)))
    return (
        f"the largest residual is that of pose {pose}; is what was measured of this mechanism and branch, in the same "
        "order, units and signs?"
    )
