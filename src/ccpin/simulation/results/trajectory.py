"""What a simulation returns: immutable samples, what happened between them, how it ended and why."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, instance
from ccpin.containers import told_of
from ccpin.displays import curves, table
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.digests import Digests, Part, require_same
from ccpin.simulation.events.samples import CHANGED, SAMPLED, ColumnNames, EventRecord, Status
from ccpin.simulation.results import saving

if TYPE_CHECKING:
    import pandas as pd


class Energies(NamedTuple):
    """Energy along a motion, J: kinetic and potential (of gravity and springs), of shape (T,) each."""

    kinetic: Array
    potential: Array


class Trajectory(NamedTuple):
    """A motion: samples at regular times and, last, where it ended; what happened; how it ended.

    Attributes:
        t: Times in seconds, of shape (T,).
        q: Independent coordinates, of shape (T, model.nq). v: velocities, of shape (T, n). a: accelerations, alike.
        u: Efforts of the actuated joints, of shape (T, motors).
        q_free: Closed configurations σ(q), of shape (T, nq). v_free: velocities q̇′ of all joints, of shape (T, n′).
        friction: Friction on the free system's joints, of shape (T, n′). limits: forces of stops and contacts, alike.
        closure_error: ‖φ(q′)‖ at each sample, metres (and radians), of shape (T,).
        status: finished (the time asked for), settled, event (a terminal one), singular, outside (of the region),
            exhausted (the budget), failed or interrupted (Ctrl-C).
        message: The status in a sentence.
        cause: The exception that ended a motion that failed, was interrupted or became singular, else ``None``. A
            caller who wants Ctrl-C to end more than the motion says ``if motion.cause: raise motion.cause``.
        events: What happened along the motion, in order.
        evaluations: Number of evaluations of the equations of motion.
        wall_time: Seconds that the simulation took.
        names: What the columns are called.
        origin: What moved, under which law (`ccpin.proof.digests`).
        notes: What computed it, and why not the compiled core where that did not; motors that gave all they have,
            whether they can hold start and goal at all, and stated limits that it is beyond.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    u: Array
    q_free: Array
    v_free: Array
    friction: Array
    limits: Array
    closure_error: Array
    status: Status
    message: str
    cause: BaseException | None
    events: tuple[EventRecord, ...]
    evaluations: int
    wall_time: float
    names: ColumnNames
    origin: Digests
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        beyond = [note for note in self.notes if not note.startswith(("stepped ", "integrated "))]  # how it was done
        told = [f"{self.status} at {self.t[-1]:.6g} s, {len(self.t)} samples, n = {self.v.shape[1]}", *beyond[:1]]
        return f"Trajectory({'; '.join(told)}{f' (and {len(beyond) - 1} more notes)' if len(beyond) > 1 else ''})"

    def _repr_html_(self) -> str:
        """A small table and the curves of q and u for notebooks."""
        rows = [
            ("motion", f"{self.message} ({self.status})"),
            ("samples", f"{len(self.t)}, {self.evaluations} evaluations in {self.wall_time:.3g} s"),
            ("q at the end", np.array2string(self.q[-1], precision=6)),
            ("largest |u|", np.array2string(np.abs(self.u).max(axis=0, initial=0.0), precision=4)),
            ("largest closure error", f"{self.closure_error.max():.1e}"),
            *((f"at {event.t:.6g} s", event.name) for event in self.events),
            *(("note", note) for note in self.notes),
        ]
        drawn = [
            curves(self.t, columns, [f"{symbol} {name}" for name in names])
            for symbol, columns, names in (("q", self.q, self.names.q), ("u", self.u, self.names.u))
            if columns.size
        ]
        return table(rows) + "".join(drawn)

    @property
    def changes(self) -> int:
        """How often the motion went on in other coordinates (`coordinate_switching`); q, v, a are the model's."""
        return sum(event.name.startswith(CHANGED) for event in self.events)

    def then(self, other: Trajectory) -> Trajectory:
        """This trajectory followed by another, whose first sample repeats this one's last and is dropped.

        The other's times are shifted to begin where this one ends.

        Raises:
            DifferentSubjectsError: It is a motion of another mechanism.
        """
        instance(other, "other", Trajectory)
        require_same("a motion that goes on", self.origin, other.origin, "closures", "dynamics")
        shift = self.t[-1] - other.t[0]
        events = tuple(event._replace(t=event.t + shift) for event in other.events)
        return joined([self, other._replace(t=other.t + shift, events=events)])

    def states(self, model: ReducedModel | Mechanism) -> Iterator[tuple[State, Array, Array]]:
        """(the State at q, v, u) of every sample, for reading the reduced model along the motion.

        Raises:
            DifferentSubjectsError: The trajectory is of other closures or coordinates.
        """
        model = self.of("reading a motion", model, "closures")
        for q, v, u, q_free in zip(self.q, self.v, self.u, self.q_free, strict=True):
            yield model.at(q, q_free), v, u

    def of(self, task: str, model: ReducedModel | Mechanism, *parts: Part) -> ReducedModel:
        """The model, if this is a motion of it as far as a task asks.

        Raises:
            DifferentSubjectsError: It is not.
        """
        model = model_of(model)
        require_same(task, model.digests, self.origin._replace(name=f"the motion of {self.origin.name}"), *parts)
        return model

    def energy(self, model: ReducedModel | Mechanism) -> Energies:
        """Kinetic and potential energy at every sample, J, from q′ and q̇′: also where q does not measure the motion.

        Raises:
            DifferentSubjectsError: The trajectory is of another mechanism.
        """
        model = self.of("the energy of a motion", model, "closures", "dynamics")
        free = model.free_system
        found = [free.energy(q_free, v_free) for q_free, v_free in zip(self.q_free, self.v_free, strict=True)]
        return Energies(*np.array(found).reshape(-1, 2).T)

    def to_pandas(self) -> pd.DataFrame:
        """A data frame with one row a sample, columns ``t``, ``q_joint1``, …; ``attrs`` has how the motion ended.

        Raises:
            InvalidInputError: pandas is not installed.
        """
        return saving.to_pandas(self._asdict())

    def save(self, path: str | Path) -> None:
        """Write the motion to a file, whole or not at all; the suffix decides.

        ``.npz``: everything, read again by `Trajectory.load`. ``.csv`` and ``.parquet``: a table with named columns, as
        `to_pandas` makes it (Parquet needs the extra ``tables``).

        Raises:
            InvalidInputError: Another suffix, the file cannot be written, or pandas is not installed for Parquet.
        """
        if not isinstance(path, str | Path):
            raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
        saving.save(self._asdict(), Path(path))

    @classmethod
    def load(cls, path: str | Path) -> Trajectory:
        """Read a motion that `save` wrote to an .npz file.

        Raises:
            InvalidInputError: The file is none, damaged, or of an older format; the file and the field are named.
        """
        header, arrays = saving.TRAJECTORY.read(path)
        with told_of(path):
            return cls(**saving.unpacked(header, arrays))


def joined(parts: list[Trajectory]) -> Trajectory:
    """Trajectories that follow each other in time as one, in linear time; it ends as the last one does.

    The first sample of each repeats the last one of the one before and is dropped. Of several laws it says none.
    """
    first, last = parts[0], parts[-1]
    if len(parts) == 1:
        return first
    columns: dict[str, Any] = {}
    for name in SAMPLED:
        pieces = [getattr(first, name), *(getattr(part, name)[1:] for part in parts[1:])]
        columns[name] = np.concatenate(pieces)
    one_law = all(part.origin.law == last.origin.law for part in parts)
    return last._replace(
        **columns,
        origin=last.origin if one_law else last.origin._replace(law=""),
        events=tuple(event for part in parts for event in part.events),
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
        evaluations=sum(part.evaluations for part in parts),
        wall_time=sum(part.wall_time for part in parts),
    )
