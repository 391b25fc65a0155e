"""Design under a certificate: dimensions of a mechanism chosen so that a certified figure is as large as possible.

A search proposes dimensions; each proposal is built and its figure certified, so the answer comes with its certificate
and nothing rests on the search, which is SciPy's and local. A proposal that cannot be built, closed or certified is
worth less than any that can: it is told to the search as `figure` = 0, and is kept among the trials with its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from threading import Event
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import minimize

from ccpin.arrays import Array, instance, listener, number, numbers, whole
from ccpin.description import read_description, scaled
from ccpin.description.model import MechanismDescription
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.workspaces.largest import LargestWorkspace
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.mechanism.loading.loader import load
from ccpin.mechanism.mechanism import Mechanism
from ccpin.work import Flag, Stopped, stoppable

T = TypeVar("T")
Range = tuple[float, float]
_STEP = 0.15  # of a dimension's range: the first change


class Trial(NamedTuple):
    """One proposal: its dimensions, its certified figure (0 where there is none) and why there is none."""

    dimensions: dict[str, float]
    figure: float
    reason: str


class Design(NamedTuple, Generic[T]):
    """The best dimensions found.

    Attributes:
        dimensions: By name.
        figure: What is certified of them.
        certificate: What the figure function returned for them: an `Atlas`, a `LargestWorkspace` or a number.
        subject: What was built of them.
        trials: Every proposal, in order; the first is the start.
        complete: False where Ctrl-C ended the search.
    """

    dimensions: dict[str, float]
    figure: float
    certificate: Any
    subject: T
    trials: tuple[Trial, ...]
    complete: bool


def design(
    build: Callable[[dict[str, float]], T],
    ranges: Mapping[str, Range],
    figure: Callable[[T], Atlas | LargestWorkspace | float],
    *,
    start: Mapping[str, float] | None = None,
    evaluations: int = 60,
    progress: Callable[[Trial], None] | None = None,
) -> Design[T]:
    """Vary dimensions between bounds so that a certified figure grows, by SciPy's Nelder–Mead method.

    Args:
        build: Makes the mechanism (or its model, or an end effector of it) from dimensions by name; `scaled_links`
            makes such a function, ``load`` with ``xacro_arguments`` another.
        ranges: (lower, upper) by name, in whatever units `build` takes.
        figure: What is to be large, certified: an `Atlas` counts as its radius, a `LargestWorkspace` as its half width
            or radius, a number as itself (a `SetPointCertificate`'s margin, a worst 1/κ kept).
        start: Dimensions to start from; default the middle of the ranges.
        evaluations: How many proposals are tried.
        progress: Called after each.

    Raises:
        InvalidInputError: Ranges or start are malformed, or no proposal could be certified.
    """
    for name, given in (("build", build), ("figure", figure)):
        if not callable(given):
            raise InvalidInputError(f"{name} must be a function; it is {given!r:.80}")
    names, lower, upper = _box(instance(ranges, "ranges", Mapping, "a mapping of names to (lower, upper)"))
    first = 0.5 * (lower + upper) if start is None else _started(instance(start, "start", Mapping), names, lower, upper)
    search = _Objective(build, figure, names, whole(evaluations, "evaluations"), listener(progress))
    inward = np.where(first > 0.5 * (lower + upper), -_STEP, _STEP)  # SciPy's own would be clipped to the bounds
    simplex = np.vstack([first, first + np.diag(inward * (upper - lower))])
    with stoppable() as flag, suppress(Stopped):
        search.flag = flag
        minimize(
            search,
            first,
            method="Nelder-Mead",
            bounds=list(zip(lower, upper, strict=True)),
            options={"initial_simplex": simplex, "maxfev": evaluations, "xatol": 1e-4, "fatol": 1e-6},
        )
    complete = not flag.is_set()
    if search.best is None:
        last = search.trials[-1] if search.trials else Trial({}, 0.0, "interrupted")
        raise InvalidInputError(
            f"none of {len(search.trials)} proposals could be certified; the last, {last.dimensions}: {last.reason}"
        )
    dimensions, value, certificate, subject = search.best
    return Design(dimensions, value, certificate, subject, tuple(search.trials), complete)


class _Objective(Generic[T]):
    """The function that SciPy minimizes, and what it found."""

    def __init__(
        self,
        build: Callable[[dict[str, float]], T],
        figure: Callable[[T], Atlas | LargestWorkspace | float],
        names: Sequence[str],
        most: int,
        progress: Callable[[Trial], object],
    ) -> None:
        self.build, self.figure, self.names, self.most, self.progress = build, figure, names, most, progress
        self.trials: list[Trial] = []
        self.flag: Flag = Event()
        self.best: tuple[dict[str, float], float, Any, T] | None = None

    def __call__(self, x: Array) -> float:
        dimensions = dict(zip(self.names, x.tolist(), strict=True))
        if self.flag.is_set():
            raise Stopped
        trial = self._tried(dimensions)
        self.trials.append(trial)
        self.progress(trial)
        return -trial.figure

    def _tried(self, dimensions: dict[str, float]) -> Trial:
        try:
            subject = self.build(dict(dimensions))
            certificate = self.figure(subject)
            value = figure_of(certificate)
        except CcpinError as error:
            return Trial(dimensions, 0.0, f"{type(error).__name__}: {error}")
        if self.flag.is_set():
            return Trial(dimensions, 0.0, "interrupted: its certificate is not whole")
        if value > 0.0 and (self.best is None or value > self.best[1]):
            self.best = dimensions, value, certificate, subject
        return Trial(dimensions, value, "" if value > 0.0 else "nothing was certified")


def figure_of(certificate: Atlas | LargestWorkspace | float) -> float:
    """What a certificate counts as."""
    if isinstance(certificate, Atlas):
        return certificate.radius
    if isinstance(certificate, LargestWorkspace):
        return certificate.half
    return number(certificate, "figure")


def scaled_links(
    source: str | MechanismDescription, links: Mapping[str, Sequence[str]], **options: Any
) -> Callable[[dict[str, float]], Mechanism]:
    """A `build` for `design` whose dimensions are factors of the lengths of links.

    Args:
        source: The mechanism as it is: a file, an installed model's name or a description.
        links: The links that each dimension stretches, `ccpin.description.scaled` says how.
        options: For `ccpin.load`.

    Raises:
        DescriptionError: The source cannot be read.
    """
    description = source if isinstance(source, MechanismDescription) else read_description(source)
    links = instance(links, "links", Mapping, "a mapping of dimensions to links")
    stretched = {name: tuple(instance(chosen, f"links of '{name}'", Sequence)) for name, chosen in links.items()}

    def build(dimensions: dict[str, float]) -> Mechanism:
        factors = {link: dimensions[name] for name, chosen in stretched.items() for link in chosen}
        return load(scaled(description, lengths=factors), **options)

    return build


def _box(ranges: Mapping[str, Range]) -> tuple[tuple[str, ...], Array, Array]:
    names = tuple(ranges)
    bounds = numbers(list(ranges.values()), "ranges")
    if bounds.shape != (len(names), 2) or not names or not np.all(np.isfinite(bounds)):
        raise InvalidInputError("ranges are (lower, upper) by name, for one dimension at least")
    for name, (low, high) in zip(names, bounds, strict=True):
        if not low < high:
            raise InvalidInputError(f"the range of '{name}' must be (lower, upper) with lower below upper")
    return names, bounds[:, 0].copy(), bounds[:, 1].copy()


def _started(start: Mapping[str, float], names: Sequence[str], lower: Array, upper: Array) -> Array:
    if set(start) != set(names):
        raise InvalidInputError(
            f"start must give each of {', '.join(names)} and nothing else; it has {', '.join(start)}"
        )
    first = numbers([start[name] for name in names], "start")
    if not np.all((first >= lower) & (first <= upper)):
        raise InvalidInputError(f"start = {dict(start)!r} lies outside of the ranges")
    return first
