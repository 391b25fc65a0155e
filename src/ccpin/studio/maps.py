"""The map's part of a session: what is proved or sampled of Ω about where the mechanism is, each piece in a thread."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.flood import Flooded
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.domain.theorem2.radius import theorem2
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.studio import map_pieces
from ccpin.studio.jobs import Job, Jobs, Message
from ccpin.studio.map_pieces import Charted, Line, MapCells
from ccpin.studio.recorded_run import RunPlan
from ccpin.studio.subject import Subject


class MapSource(Protocol):
    """Whose map it is: what it reads of a session."""

    subject: Subject
    here: State
    goal: State


class Maps:
    """The orders about the map.

    Args:
        place: Where the mechanism and its goal are.
        jobs: Runs what takes long.
        keep: Notes a message for who exports the page, and returns it.
        withdraw: Forgets the message of a kind.

    Attributes:
        charted: What is proved of the mechanism's branch, as soon as it is.
        orders: What to do at which word.
    """

    def __init__(
        self, place: MapSource, jobs: Jobs, keep: Callable[[Message], Message], withdraw: Callable[[str], None]
    ) -> None:
        self._place, self._jobs, self._keep, self._withdraw = place, jobs, keep, withdraw
        self.charted: Charted | None = None
        self.orders: dict[str, Callable[[Message], Message | None]] = {
            "chart": self._chart,
            "slice": self._slice,
            "square": self._square,
            "sublevel": self._sublevel,
        }

    def forget(self) -> None:
        """The mechanism is on another branch now."""
        self._jobs.cancel("chart")
        self.charted = None

    def _chart(self, message: Message) -> None:
        here, subject = self._place.here, self._place.subject

        def work(job: Job) -> Callable[[], Message]:
            try:
                charted = map_pieces.charted(subject.model, here, subject.cache, job)
            except CcpinError as error:
                words = str(error)
                return lambda: self._keep({"kind": "chart", "cells": None, "curves": [], "words": words, "done": True})
            job.hand_over(lambda: self._take_chart(charted))
            curves = map_pieces.curves(subject.model, subject.cache, job)
            return lambda: self._keep({**_told_chart(charted, curves), "done": True})

        self._jobs.start("chart", work)

    def _take_chart(self, charted: Charted) -> Message:
        """The cells at once, in place of samples; the singular curves take longer."""
        self._jobs.cancel("slice")
        self._withdraw("slice")
        self.charted = charted
        return self._keep({**_told_chart(charted, ()), "done": False})

    def _slice(self, message: Message) -> Message | None:
        """The map in two of more coordinates: cells of an atlas at once, samples from a thread."""
        axes, here = self._axes(message), self._place.here
        subject, values = self._place.subject, self._place.subject.dials.values(self._place.here.q)
        if self.charted is not None and len(self.charted.cells.region[0]) == len(values):
            cells = self.charted.cells.across(axes, values)
            return self._keep({"kind": "slice", "axes": axes, "cells": _packed(cells), "samples": None})
        window = self._window(axes)

        def work(job: Job) -> Callable[[], Message]:
            job.progress(None, "sampling the slice")
            found = map_pieces.flood(subject.model, subject.dials, here, axes, window, lambda state: state.rcond, job)
            value = [[None if np.isnan(one) else float(one) for one in row] for row in found.value]
            samples = {"x": found.x.tolist(), "y": found.y.tolist(), "value": value}
            return lambda: self._keep({"kind": "slice", "axes": axes, "cells": None, "samples": samples})

        self._jobs.start("slice", work)
        return None

    def _axes(self, message: Message) -> tuple[int, ...]:
        given, n = message.get("axes"), len(self._place.subject.dials.each)
        axes = tuple(given) if isinstance(given, list) else ()
        good = all(isinstance(k, int) and not isinstance(k, bool) and 0 <= k < n for k in axes)
        if len(axes) != 2 or not good or axes[0] == axes[1]:
            raise InvalidInputError(f"'axes' must be two different numbers from 0 to {n - 1}")
        return axes

    def _window(self, axes: tuple[int, ...]) -> Array:
        each = self._place.subject.dials.each
        return np.array([[each[k].lower for k in axes], [each[k].upper for k in axes]])

    def _square(self, message: Message) -> None:
        """Theorem 2's square about where the mechanism is."""
        here, subject = self._place.here, self._place.subject

        def work(job: Job) -> Callable[[], Message]:
            try:
                radius, words = theorem2(subject.mechanism, here.q_free).radius, ""
            except CcpinError as error:
                radius, words = 0.0, str(error)
            radius = radius if np.isfinite(radius) else 0.0
            centre = subject.dials.values(here.q).tolist()
            return lambda: self._keep({"kind": "square", "centre": centre, "radius": radius, "words": words})

        self._jobs.start("square", work)

    def _sublevel(self, message: Message) -> None:
        """Theorem 3's 𝒱 < c about the goal under (28): c certified, its edge sampled."""
        plan = RunPlan.of({**message, "law": "simple"}, self._place.goal)
        axes = self._axes(message)
        subject, window = self._place.subject, self._window(axes)
        atlas = None if self.charted is None else self.charted.atlas

        def work(job: Job) -> Callable[[], Message]:
            job.progress(None, "Theorem 3: how far 𝒱 < c is proved")
            law = PDSimpleGravity(subject.model, plan.goal, plan.K_p, plan.K_v)
            own = atlas if atlas is not None and atlas.contains(subject.dials.values(law.q_d)) else None
            found = certify_law(law, own, progress=lambda done: _tell(job, done))
            lines: list[Array] = []
            if found.level > 0:
                lines = map_pieces.sublevel(law, subject.dials, axes, window, found.level, job)
            edge = [line.tolist() for line in lines]
            words = f"{found.verdict}: {found.reason}"
            told = {"kind": "sublevel", "axes": axes, "level": found.level, "lines": edge, "words": words}
            return lambda: self._keep({**told, "verdict": found.verdict})

        self._jobs.start("sublevel", work)


def _tell(job: Job, done: Flooded) -> None:
    job.progress(None, f"Theorem 3: 𝒱 < {done.level:.3g} J is proved, {done.cells} cells")


def _told_chart(charted: Charted, curves: tuple[Line, ...]) -> Message:
    told = [{"kind": curve.kind, "q": curve.q.tolist()} for curve in curves]
    cells = charted.cells
    flat = cells if cells.lower.shape[1] <= 2 else None
    share = f"{len(cells.status):,} cells, {100 * float(cells.certified):.1f} % certified"
    words = f"{share}, from the cache" if charted.cached else share
    region = cells.region.tolist()
    return {"kind": "chart", "cells": _packed(flat), "curves": told, "words": words, "region": region}


def _packed(cells: MapCells | None) -> Message | None:
    """Cells as base64 of float32 (lower, upper) and bytes (status)."""
    if cells is None:
        return None

    def text(array: NDArray[Any]) -> str:
        return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")

    corners = np.concatenate([cells.lower, cells.upper], axis=1).astype(np.float32)
    return {"corners": text(corners), "status": text(cells.status), "region": cells.region.tolist()}
