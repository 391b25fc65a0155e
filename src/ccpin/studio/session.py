"""One page's side of a studio: the state that messages move. Pure Python; knows nothing of browsers or servers."""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, whole
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.theorem3 import certify_law
from ccpin.domain.singularities import SingularCurve
from ccpin.domain.theorem2.theorem2 import theorem2_radius
from ccpin.dynamics.modes import ModeSearch, assembly_modes
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError, SingularConfigurationError, UnreachableError
from ccpin.studio import chart, experiment, keeping
from ccpin.studio.branches import Branches
from ccpin.studio.chart import Cells, Charted
from ccpin.studio.experiment import Motion, Plan
from ccpin.studio.jobs import Job, Jobs, Message
from ccpin.studio.subject import Subject, Tap, Told
from ccpin.visualization import play
from ccpin.visualization.annotations import draw_ghosts

LONGEST_RECORD = 600.0
MODES_BUDGET = 30.0
"""Seconds, of a recording and of a search for modes."""
FPS = 30.0


class Session:
    """What one page drives.

    Each message is a JSON object with ``do``, and perhaps ``id``, which its answer carries. Answers are objects with
    ``kind``; a message that cannot be done is answered by kind ``error``, in words, and changes nothing. Slow work goes
    on in threads and answers later; a newer order for the same thing takes the older one's place.

    Args:
        subject: What is shared with other sessions.
        send: Takes answers; may be called from any thread.

    Attributes:
        here: The closed configuration shown.
    """

    def __init__(self, subject: Subject, send: Told) -> None:
        self.subject = subject
        self._lock = threading.RLock()
        self._jobs = Jobs(send, self._lock)
        self._send = send
        self._tap = Tap()
        self._scene = subject.scene(self._tap)
        self._tap.take()
        self.here: State = subject.reference
        self.goal: State = subject.reference
        self._branches = Branches.unknown()
        self._charted: Charted | None = None
        self._motion: Motion | None = None
        self._record: list[tuple[float, State]] | None = None
        self._shown: dict[str, Message] = {}
        self._orders: dict[str, Callable[[Message], Message | None]] = {
            "hello": self._hello,
            "drive": self._drive,
            "drag": self._drag,
            "modes": self._find_modes,
            "mode": self._take_mode,
            "goal": self._set_goal,
            "gains": self._offer_gains,
            "frame": self._frame,
            "chart": self._chart,
            "slice": self._slice,
            "square": self._square,
            "sublevel": self._sublevel,
            "simulate": self._simulate,
            "at": self._at,
            "record": self._recording,
            "save": self._save,
            "export": self._export,
            "cancel": self._cancel,
        }

    def hear(self, text: str | bytes) -> None:
        """Do what a message says and answer it; whatever it is, the session goes on."""
        number: Any = None
        try:
            message = _object(text)
            number = message.get("id")
            order = self._orders.get(message.get("do"))  # type: ignore[arg-type]
            if order is None:
                raise InvalidInputError(f"'do' must be one of {', '.join(self._orders)}")
            with self._lock:
                answer = order(message)
        except CcpinError as error:
            answer = {"kind": "error", "words": str(error)}
        except Exception as error:  # a defect; the page says so and stays alive
            answer = {"kind": "error", "words": f"{type(error).__name__}: {error}"}
        self._send({**({"kind": "begun"} if answer is None else answer), "id": number})

    def close(self) -> None:
        """Nobody is there any more: all work is cancelled."""
        self._jobs.close()

    def wait(self, timeout: float = 60.0) -> None:
        """Until no work is under way."""
        self._jobs.wait(timeout)

    # Moving.

    def _hello(self, message: Message) -> Message:
        return self._pose()

    def _drive(self, message: Message) -> Message:
        """Along the straight line in q, to where it is blocked."""
        wanted = self.subject.dials.q(message.get("q"))
        model = self.subject.model
        try:
            return self._moved(model.at(wanted, self.here), None)
        except UnreachableError as error:
            try:
                reached = model.at(error.q_reached, self.here)
            except (ConvergenceError, SingularConfigurationError):
                reached = self.here
            return self._moved(reached, str(error))
        except SingularConfigurationError as error:
            return self._moved(self.here, str(error))

    def _drag(self, message: Message) -> Message:
        handle = self.subject.handles.get(str(message.get("handle")))
        if handle is None:
            raise InvalidInputError(f"'handle' must be one of {', '.join(self.subject.handles)}")
        state, words = handle.drag(self.here, message.get("to"))
        return self._moved(state, words)

    def _moved(self, state: State, stopped: str | None) -> Message:
        self.here = state
        if self._record is not None and time.monotonic() - self._record[0][0] < LONGEST_RECORD:
            self._record.append((time.monotonic(), state))
        return self._pose(stopped)

    def _pose(self, stopped: str | None = None) -> Message:
        facts = self.subject.facts(self.here)
        bodies = self.subject.bodies(self._scene, self.here.q_free)
        return {"kind": "pose", "bodies": bodies, "facts": facts, "stopped": stopped, "mode": self._branches.told()}

    def _frame(self, message: Message) -> Message:
        """Views from which all of it is seen, where it has left the frame."""
        self._tap.take()
        self._scene.keep_in_frame(self.here.q_free)
        return {"kind": "frame", "commands": keeping.encoded(self._tap.take())}

    # Assembly modes.

    def _find_modes(self, message: Message) -> None:
        here, model = self.here, self.subject.model

        def work(job: Job) -> Callable[[], Message]:
            def tell(search: ModeSearch) -> None:
                share = min(search.quiet / search.patience, 1.0)
                job.progress(share, f"{search.modes} modes after {search.starts} starts")

            found = assembly_modes(model, here.q, budget=MODES_BUDGET, progress=tell)
            states = [model.at(here.q, mode.q_free) for mode in found.modes]
            return lambda: self._found_modes(Branches(self.subject.likeness, states, here), found.reason)

        self._jobs.start("modes", work)

    def _found_modes(self, branches: Branches, reason: str) -> Message:
        self._branches = branches
        return {"kind": "modes", "mode": branches.told(), "words": reason}

    def _take_mode(self, message: Message) -> Message:
        self.here, self._charted = self._branches.take(message.get("mode"), self.here), None
        return self._pose()

    # The map.

    def _chart(self, message: Message) -> None:
        here, subject = self.here, self.subject

        def work(job: Job) -> Callable[[], Message]:
            try:
                charted = chart.charted(subject.model, here, subject.cache, job)
            except CcpinError as error:
                words = str(error)
                return lambda: self._keep({"kind": "chart", "cells": None, "curves": [], "words": words, "done": True})
            self._take_chart(job, charted)
            curves = chart.curves(subject.model, subject.cache, job)
            return lambda: self._keep({**self._told_chart(charted, curves), "done": True})

        self._jobs.start("chart", work)

    def _take_chart(self, job: Job, charted: Charted) -> None:
        """The cells at once; the singular curves take longer."""
        with self._lock:
            job.check()
            self._charted = charted
            self._send({**self._told_chart(charted, ()), "done": False})

    def _told_chart(self, charted: Charted, curves: tuple[SingularCurve, ...]) -> Message:
        told = [{"kind": curve.kind, "q": curve.q.tolist()} for curve in curves]
        cells = charted.cells
        flat = cells if cells.lower.shape[1] <= 2 else None
        share = f"{len(cells.status):,} cells, {100 * float(cells.certified):.1f} % certified"
        words = f"{share}, from the cache" if charted.cached else share
        region = cells.region.tolist()
        return {"kind": "chart", "cells": _packed(flat), "curves": told, "words": words, "region": region}

    def _slice(self, message: Message) -> Message | None:
        """The map in two of more coordinates: cells of an atlas at once, samples from a thread."""
        axes, here = self._axes(message), self.here
        subject, values = self.subject, self.subject.dials.values(self.here.q)
        if self._charted is not None and len(self._charted.cells.region[0]) == len(values):
            cells = self._charted.cells.across(axes, values)
            return self._keep({"kind": "slice", "axes": axes, "cells": _packed(cells), "samples": None})
        window = self._window(axes)

        def work(job: Job) -> Callable[[], Message]:
            job.progress(None, "sampling the slice")
            found = chart.flood(subject.model, subject.dials, here, axes, window, lambda state: state.rcond, job)
            value = [[None if np.isnan(one) else float(one) for one in row] for row in found.value]
            samples = {"x": found.x.tolist(), "y": found.y.tolist(), "value": value}
            return lambda: self._keep({"kind": "slice", "axes": axes, "cells": None, "samples": samples})

        self._jobs.start("slice", work)
        return None

    def _axes(self, message: Message) -> tuple[int, ...]:
        given, n = message.get("axes"), len(self.subject.dials.each)
        axes = tuple(given) if isinstance(given, list) else ()
        good = all(isinstance(k, int) and not isinstance(k, bool) and 0 <= k < n for k in axes)
        if len(axes) != 2 or not good or axes[0] == axes[1]:
            raise InvalidInputError(f"'axes' must be two different numbers from 0 to {n - 1}")
        return axes

    def _window(self, axes: tuple[int, ...]) -> Array:
        each = self.subject.dials.each
        return np.array([[each[k].lower for k in axes], [each[k].upper for k in axes]])

    def _square(self, message: Message) -> None:
        """Theorem 2's square about where the mechanism is."""
        here, subject = self.here, self.subject

        def work(job: Job) -> Callable[[], Message]:
            try:
                radius, words = theorem2_radius(subject.mechanism, here.q_free), ""
            except CcpinError as error:
                radius, words = 0.0, str(error)
            radius = radius if np.isfinite(radius) else 0.0
            centre = subject.dials.values(here.q).tolist()
            return lambda: self._keep({"kind": "square", "centre": centre, "radius": radius, "words": words})

        self._jobs.start("square", work)

    def _sublevel(self, message: Message) -> None:
        """Theorem 3's 𝒱 < c about the goal under (28): c certified, its edge sampled."""
        plan = Plan.of({**message, "law": "simple"}, self.goal)
        axes = self._axes(message)
        subject, window = self.subject, self._window(axes)
        atlas = None if self._charted is None else self._charted.atlas

        def work(job: Job) -> Callable[[], Message]:
            job.progress(None, "Theorem 3: how far 𝒱 < c is proved")
            law = PDSimpleGravity(subject.model, plan.goal, plan.K_p, plan.K_v)
            own = atlas if atlas is not None and atlas.contains(subject.dials.values(law.q_d)) else None
            found = certify_law(law, own)
            job.check()
            lines: list[Array] = []
            if found.level > 0:
                lines = chart.sublevel(law, subject.dials, axes, window, found.level, job)
            edge = [line.tolist() for line in lines]
            words = f"{found.verdict}: {found.reason}"
            told = {"kind": "sublevel", "axes": axes, "level": found.level, "lines": edge, "words": words}
            return lambda: self._keep({**told, "verdict": found.verdict})

        self._jobs.start("sublevel", work)

    # Experiments.

    def _set_goal(self, message: Message) -> Message:
        """The goal: where the mechanism is, or a q on its branch."""
        given = message.get("q")
        model = self.subject.model
        self.goal = self.here if given is None else model.at(self.subject.dials.q(given), self.here)
        draw_ghosts(self._scene, {"goal": self.goal.q_free})
        values = self.subject.dials.values(self.goal.q).tolist()
        return self._keep({"kind": "goal", "q": values, "commands": keeping.encoded(self._tap.take())})

    def _offer_gains(self, message: Message) -> Message:
        K_p, K_v = experiment.offered_gains(self.subject.model, self.goal, message.get("law", "simple"))
        return {"kind": "gains", "K_p": K_p.tolist(), "K_v": K_v.tolist()}

    def _simulate(self, message: Message) -> None:
        model, plan, start = self.subject.model, Plan.of(message, self.goal), self.here

        def work(job: Job) -> Callable[[], Message]:
            motion = experiment.run(model, plan, start, job)
            return lambda: self._show(motion)

        self._jobs.start("simulate", work)

    def _show(self, motion: Motion) -> Message:
        """A motion for the plots, and MeshCat's commands that play it."""
        self._motion = motion
        samples = motion.trajectory
        first = next(iter(self.subject.handles), None)
        self._scene.stop()
        if len(samples.t) > 1:
            play(self._scene, samples.t, samples.q_free, fps=FPS, loop=False, trace=self._trace(first))
        return self._keep(keeping.told_motion(motion, self.subject, self._tap.take()))

    def _trace(self, name: str | None) -> str | None:
        known = {*self.subject.mechanism.tree.attachments, *(c.name for c in self.subject.mechanism.closures)}
        return name if name in known else None

    def _at(self, message: Message) -> Message:
        """Where the motion shown is at a sample: the mechanism is there from now on."""
        if self._motion is None:
            raise InvalidInputError("there is no motion to look at")
        samples = self._motion.trajectory
        k = min(whole(message.get("sample"), "sample", 0), len(samples.t) - 1)  # type: ignore[arg-type]
        state = self.subject.model.at(samples.q[k], samples.q_free[k])
        self.here = state
        return {**self._pose(), "bodies": None}

    def _recording(self, message: Message) -> Message:
        """Begin to record what is driven; asked again, end and show it."""
        if self._record is None:
            self._record = [(time.monotonic(), self.here)]
            return {"kind": "recording", "on": True}
        record, self._record = self._record, None
        self._send({"kind": "recording", "on": False})
        times, states = [at for at, _ in record], [state for _, state in record]
        return self._show(experiment.recorded(self.subject.model, times, states))

    def _save(self, message: Message) -> Message:
        if self._motion is None:
            raise InvalidInputError("there is no motion to save: simulate or record one")
        return keeping.saved(self._motion, message.get("format"))

    def _export(self, message: Message) -> Message:
        """The page as it is, as one file that needs no server."""
        self._scene.place(self.here.q_free)
        self._tap.take()
        shown = [*self._shown.values(), self._pose()]
        return keeping.exported(self.subject, self._scene, self._tap.commands, shown)

    def _cancel(self, message: Message) -> Message:
        job = str(message.get("job"))
        self._jobs.cancel(job)
        return {"kind": "cancelled", "job": job}

    def _keep(self, message: Message) -> Message:
        """A message, also for who exports the page."""
        self._shown[message["kind"]] = message
        return message


def _object(text: str | bytes) -> Message:
    """The JSON object of a message.

    Raises:
        InvalidInputError: It is none.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        raise InvalidInputError("a message must be a JSON object with 'do'")
    return message


def _packed(cells: Cells | None) -> Message | None:
    """Cells as base64 of float32 (lower, upper) and bytes (status)."""
    if cells is None:
        return None

    def text(array: NDArray[Any]) -> str:
        return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")

    corners = np.concatenate([cells.lower, cells.upper], axis=1).astype(np.float32)
    return {"corners": text(corners), "status": text(cells.status), "region": cells.region.tolist()}
