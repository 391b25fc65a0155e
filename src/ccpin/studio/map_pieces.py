"""The map of Ω in two of the coordinates: certified cells, singular curves, sampled slices, sublevel sets of 𝒱."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array
from ccpin.control.laws import PDSimpleGravity
from ccpin.covering.runner import Progress
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.certifying import certify
from ccpin.domain.closures.searchable import region_of
from ccpin.domain.closures.seeds import scalar_coordinates_at, seed_at_coordinates
from ccpin.domain.singular.sampled import singularities
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError, ConvergenceError, SingularConfigurationError, UnsupportedMechanismError
from ccpin.studio.cache import Cache, fingerprint
from ccpin.studio.dials import Dials
from ccpin.studio.jobs import Job

MOST = 3
"""Coordinates up to which atlases are made."""
GRID = 61
"""Points along an edge of what is sampled."""


class MapCells(NamedTuple):
    """An atlas as far as it is drawn.

    Attributes:
        lower, upper: Corners of the cells, of shape (K, n).
        status: A `CellStatus` each, of shape (K,).
        region: The lower and the upper corner of all, of shape (2, n).
        certified: The certified share of the region.
    """

    lower: NDArray[np.float32]
    upper: NDArray[np.float32]
    status: NDArray[np.uint8]
    region: Array
    certified: Array

    def across(self, axes: tuple[int, ...], values: Array) -> MapCells:
        """The cells that a slice along `axes` through `values` (n,) meets, in those axes alone."""
        low, high = self.region
        others = [k for k in range(self.lower.shape[1]) if k not in axes]
        turns = np.where(high - low >= 2 * np.pi - 1e-9, np.floor((values - low) / (high - low)), 0.0)
        at = (values - turns * (high - low))[others]
        met = np.all((self.lower[:, others] <= at) & (at < self.upper[:, others]), axis=1)
        chosen = list(axes)
        flat = (self.lower[met][:, chosen], self.upper[met][:, chosen], self.status[met])
        return MapCells(*flat, self.region[:, chosen], self.certified)


def cells_of(atlas: Atlas) -> MapCells:
    """The leaves of an atlas."""
    leaves = atlas.tree.leaves()
    ends = [atlas.tree.lower[leaves], atlas.tree.lower[leaves] + atlas.tree.size[leaves]]
    lower, upper = (atlas.region.position(end).astype(np.float32) for end in ends)
    region = np.array([atlas.region.lower, atlas.region.upper])
    status = atlas.tree.status[leaves].astype(np.uint8)
    return MapCells(lower, upper, status, region, np.array(atlas.certified_fraction))


class Charted(NamedTuple):
    """What is proved of a branch: cells to draw, and (up to two coordinates) the atlas they are of."""

    cells: MapCells
    atlas: Atlas | None
    cached: bool


def charted(model: ReducedModel, here: State, cache: Cache, job: Job) -> Charted:
    """The atlas of the branch that `here` is on, from the cache where it is there.

    Its seed is the reference's q if that branch goes there, so that it is the same atlas from wherever it is asked for.

    Raises:
        UnsupportedMechanismError: As for `ccpin.domain.certify`.
        Cancelled: Nobody waits any more.
    """
    mechanism = model.mechanism
    if mechanism.n > MOST:
        raise UnsupportedMechanismError(f"atlases are made of up to {MOST} coordinates; this slice is sampled")
    reference = scalar_coordinates_at(mechanism, mechanism.q_reference)
    q_free = _over_reference(model, here)
    q0 = scalar_coordinates_at(mechanism, q_free)
    first = seed_at_coordinates(mechanism, reference)
    area = region_of(mechanism, first, None)
    seed = seed_at_coordinates(mechanism, q0, q_free)
    asked = np.array([area.lower, area.upper]), np.round(seed.theta, 6)
    key = fingerprint(first.reading, *asked, kind="atlas")
    with cache.alone(key, job.check):
        kept = _kept(cache, key, mechanism.n)
        if kept is not None:
            return kept
        atlas = certify(mechanism, q0, None, q_free, progress=lambda done: _tell(job, done))
        cells = cells_of(atlas)
        if mechanism.n < MOST:
            cache.keep_atlas(key, atlas)
        else:
            cache.save(key, cells._asdict())
    return Charted(cells, atlas if mechanism.n < MOST else None, False)


def _kept(cache: Cache, key: str, n: int) -> Charted | None:
    if n < MOST:
        atlas = cache.load_atlas(key)
        return None if atlas is None else Charted(cells_of(atlas), atlas, True)
    arrays = cache.load(key)
    if arrays is None or set(arrays) != set(MapCells._fields):
        return None
    return Charted(MapCells(**arrays), None, True)  # type: ignore[arg-type]


def _tell(job: Job, done: Progress) -> None:
    job.progress(None, f"proving: {done.boxes} cells, {100 * done.certified:.1f} % of the region")


def _over_reference(model: ReducedModel, here: State) -> Array:
    try:
        return model.at(model.alpha(model.mechanism.q_reference), here).q_free
    except (ConvergenceError, SingularConfigurationError):
        return here.q_free


class Line(NamedTuple):
    """A singular curve as far as it is drawn: its kind, and its image in q, of shape (k, 2)."""

    kind: str
    q: Array


def curves(model: ReducedModel, cache: Cache, job: Job) -> tuple[Line, ...]:
    """The singular curves of a mechanism with two coordinates, from the cache where they are there; else none.

    Raises:
        Cancelled: Nobody waits any more.
    """
    mechanism = model.mechanism
    if mechanism.n != 2:
        return ()
    try:
        first = seed_at_coordinates(mechanism, scalar_coordinates_at(mechanism, mechanism.q_reference))
        key = fingerprint(first.reading, kind="curves")
    except CcpinError:
        return ()
    with cache.alone(key, job.check):
        kept = cache.load(key)
        if kept is not None:
            kinds = enumerate(kept["kind"])
            return tuple(Line(str(kind), np.asarray(kept[f"q{k}"], dtype=np.float64)) for k, kind in kinds)
        try:
            found = singularities(
                mechanism,
                progress=lambda done, starts: job.progress(done / starts, f"singular curves: start {done} of {starts}"),
            )
        except UnsupportedMechanismError:
            return ()
        packed = {f"q{k}": np.asarray(curve.q) for k, curve in enumerate(found)}
        cache.save(key, {"kind": np.array([curve.kind for curve in found], dtype="U12"), **packed})
    return tuple(Line(curve.kind, curve.q) for curve in found)


class SampledSlice(NamedTuple):
    """Samples over two coordinates: NaN where the flood from its start did not come.

    Attributes:
        x, y: The coordinates of columns and rows.
        value: Of shape (len(y), len(x)).
    """

    x: Array
    y: Array
    value: Array


def flood(
    model: ReducedModel,
    dials: Dials,
    here: State,
    axes: tuple[int, ...],
    window: Array,
    read: Callable[[State], float],
    job: Job,
    grid: int = GRID,
) -> SampledSlice:
    """Follow σ from `here` over a grid in two coordinates, the others held, from neighbour to neighbour.

    Sampled: nothing between the points is proved.

    Args:
        model: The reduced model.
        dials: Its coordinates as numbers.
        here: Where to start, and the values of the others.
        axes: The two coordinates' numbers.
        window: Their lower and upper ends, of shape (2, 2).
        read: What to sample.
        job: Asked whether to go on.
        grid: Points along an edge.
    """
    x, y = (np.linspace(window[0, k], window[1, k], grid) for k in range(2))
    values = dials.values(here.q)
    start = tuple(int(np.abs(line - values[axis]).argmin()) for line, axis in zip((x, y), axes, strict=True))
    found = np.full((grid, grid), np.nan)
    seen, front = {start}, deque([(start, here)])
    while front:
        (i, j), near = front.popleft()
        job.check()
        point = values.copy()
        point[list(axes)] = x[i], y[j]
        try:
            state = model.at(dials.q(point), near)
        except (ConvergenceError, SingularConfigurationError):
            seen.discard((i, j))  # another neighbour may lead there
            continue
        if np.isfinite(found[j, i]):
            continue
        found[j, i] = read(state)
        for cell in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if cell not in seen and all(0 <= c < grid for c in cell):
                seen.add(cell)
                front.append((cell, state))
    return SampledSlice(x, y, found)


def sublevel(
    law: PDSimpleGravity, dials: Dials, axes: tuple[int, ...], window: Array, level: float, job: Job
) -> list[Array]:
    """The edge of {𝒱(q, 0) < level} around q_d in two coordinates, the others at q_d: closed lines of shape (k, 2)."""
    from contourpy import contour_generator

    stiffness = np.linalg.eigvalsh(law.K_p + law.model.gravity_derivative(law.q_d, law.q_free_d))[0]
    reach = 1.6 * np.sqrt(2.0 * level / max(float(stiffness), 1e-9))
    centre = dials.values(law.q_d)[list(axes)]
    near = np.array([np.maximum(window[0], centre - reach), np.minimum(window[1], centre + reach)])
    rest = np.zeros(law.model.n)
    well = flood(law.model, dials, law.near, axes, near, lambda state: law.lyapunov(state, rest), job)
    lines = contour_generator(well.x, well.y, np.ma.masked_invalid(well.value)).lines(level)
    around = [np.asarray(line) for line in lines if _encloses(np.asarray(line), centre)]
    return sorted(around, key=len)[-1:]


def _encloses(line: Array, point: Array) -> bool:
    """Whether a polygon's edge winds around a point."""
    angles = np.arctan2(*(line - point).T[::-1])
    turns = np.diff(angles)
    return abs(float(np.sum(np.remainder(turns + np.pi, 2 * np.pi) - np.pi))) > np.pi
