"""All singular curves of a mechanism over a region, with a proof that none was missed, or where one may have been."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from ccpin.covering.region import Corners
from ccpin.covering.runner import Work
from ccpin.domain.closures.searchable import check_searchable, region_about, searched_ranges
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.domain.singular.cover import SearchDomain
from ccpin.domain.singular.curves import SingularCover, effort_of, searched
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.equations import BoundsName


def certify_singularities(
    mechanism: Mechanism | HasMechanism,
    region: Corners | None = None,
    *,
    resolution: float = 1e-4,
    budget: int = 1_000_000,
    seconds: float | None = None,
    bounds: BoundsName = "auto",
    workers: int | None = None,
    executor: Executor | None = None,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SingularCover:
    """Enclose all parallel singular curves over a region, of every assembly mode, so that none is missed.

    The curves are followed in tubes that are proved to hold one each, and the whole region is covered with boxes of
    all coordinates, each proved to hold no singular configuration but those in tubes; what cannot be settled is listed.
    That is done twice: to find the curves, and by the kernel of proof, which knows their tubes and believes nobody.

    Args:
        mechanism: A mechanism (or its model) with two scalar independent coordinates and revolute, prismatic,
            universal, cylindrical or planar joints; hold joints still with ``load(locked=…)`` for a slice of others.
        region: (lower, upper), the bounds of the coordinates, each of shape (2,); default as for `certify`.
        resolution: Boxes no wider than this either way (rad, m) are listed where they cannot be settled.
        budget: How many boxes of all coordinates may be tried to find the curves; those that wait then are listed.
        seconds: When to stop, measured by the clock. What is proved by then is kept, as after Ctrl-C.
        bounds: Of φ over boxes: ``"auto"`` (planar where the mechanism is), ``"planar"`` or ``"reach"``.
        workers: How many to share the search's boxes among, as for `certify_sheets`; curves are followed in this
            thread. The result is the same whoever does the work.
        executor: In place of `workers` anything with ``submit``, as for `certify`.
        checkpoint: A folder in which finished chunks of boxes and whole curves are kept; the same call finds them again
            after an interrupt or a crash.
        progress: Called before every wave of boxes with the number of tubes and of boxes that wait; what it raises
            ends the search.

    Raises:
        UnsupportedMechanismError: n ≠ 2, more than eight dependent coordinates, ball joints, distance closures,
            couplings of continuous joints, redundant rows, closures that cannot be bounded or whose rows vanish with
            their ends turned over too, or a slide or a coupled joint that limits, lengths and couplings do not bound.
        InvalidInputError: The region, resolution, budget, seconds or workers is malformed.
    """
    mechanism = mechanism_of(mechanism)
    reading = _reading(mechanism)
    effort = effort_of(resolution, budget, seconds, progress)
    area = region_about(mechanism, reading, region)
    place = SearchDomain(area, searched_ranges(mechanism, reading, area))
    work = Work(workers, executor, checkpoint)
    return searched(reading.bounded(bounds), tuple(mechanism.independent), place, effort, work)


def _reading(mechanism: Mechanism) -> Reading:
    """The closures, if their singular configurations are curves that can be searched for."""
    if mechanism.n != 2:
        raise UnsupportedMechanismError(
            f"singular curves are those of two independent coordinates; '{mechanism.name}' has {mechanism.n}"
            + (": hold joints still with load(locked=…) for a slice" if mechanism.n > 2 else "")
        )
    reading = reading_of(mechanism, mechanism.q_reference)
    check_searchable(mechanism, reading, "singular curves cannot all be found")
    return reading
