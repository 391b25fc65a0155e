"""One page's side of a studio: the state that messages move. Pure Python; knows nothing of browsers or servers."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from typing import Any

from ccpin.arrays import whole
from ccpin.dynamics.assembly import ModeSearch, assembly_modes
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError, SingularConfigurationError, UnreachableError
from ccpin.studio import export, recorded_run
from ccpin.studio.jobs import Job, Jobs, Message
from ccpin.studio.maps import Maps
from ccpin.studio.modes_here import Branches
from ccpin.studio.recorded_run import Recording, RunPlan
from ccpin.studio.subject import Subject, Tap, Told
from ccpin.visualization.annotations import draw_ghosts

LONGEST_RECORD = 600.0  # s of a motion by hand that are kept: bounds memory
MODES_BUDGET = 30.0
"""Seconds, of a recording and of a search for modes."""


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
        self._maps = Maps(self, self._jobs, self._keep, self._withdraw)
        self._motion: Recording | None = None
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
            **self._maps.orders,
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
        return {"kind": "frame", "commands": export.encoded(self._tap.take())}

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
        self.here = self._branches.take(message.get("mode"), self.here)
        self._maps.forget()
        self._withdraw("chart", "slice", "square", "sublevel")
        return self._pose()

    # Experiments.

    def _set_goal(self, message: Message) -> Message:
        """The goal: where the mechanism is, or a q on its branch."""
        given = message.get("q")
        model = self.subject.model
        self.goal = self.here if given is None else model.at(self.subject.dials.q(given), self.here)
        self._withdraw("sublevel")
        draw_ghosts(self._scene, {"goal": self.goal.q_free})
        values = self.subject.dials.values(self.goal.q).tolist()
        return self._keep({"kind": "goal", "q": values, "commands": export.encoded(self._tap.take())})

    def _offer_gains(self, message: Message) -> Message:
        K_p, K_v = recorded_run.offered_gains(self.subject.model, self.goal, message.get("law", "simple"))
        return {"kind": "gains", "K_p": K_p.tolist(), "K_v": K_v.tolist()}

    def _simulate(self, message: Message) -> None:
        model, plan, start = self.subject.model, RunPlan.of(message, self.goal), self.here
        self._perform("simulate", lambda job: recorded_run.run(model, plan, start, job))

    def _perform(self, name: str, make: Callable[[Job], Recording]) -> None:
        """Make a motion, and what plots and picture need of it, in a thread."""

        def work(job: Job) -> Callable[[], Message]:
            motion = make(job)
            told = export.told_motion(motion, self.subject)
            return lambda: self._show(motion, told)

        self._jobs.start(name, work)

    def _show(self, motion: Recording, told: Message) -> Message:
        self._motion = motion
        return self._keep(told)

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
        times, states, model = [at for at, _ in record], [state for _, state in record], self.subject.model
        self._perform("record", lambda job: recorded_run.recorded(model, times, states))
        return {"kind": "recording", "on": False}

    def _save(self, message: Message) -> Message:
        if self._motion is None:
            raise InvalidInputError("there is no motion to save: simulate or record one")
        return export.saved(self._motion, message.get("format"))

    def _export(self, message: Message) -> Message:
        """The page as it is, as one file that needs no server."""
        self._scene.place(self.here.q_free)
        self._tap.take()
        shown = [*sorted(self._shown.values(), key=lambda message: message["kind"] != "chart"), self._pose()]
        return export.exported(self.subject, self._scene, self._tap.commands, shown)

    def _cancel(self, message: Message) -> Message:
        job = str(message.get("job"))
        self._jobs.cancel(job)
        return {"kind": "cancelled", "job": job}

    def _withdraw(self, *kinds: str) -> None:
        """What holds no longer."""
        for kind in kinds:
            self._shown.pop(kind, None)

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
