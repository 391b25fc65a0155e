"""The moves of a supervised motion, in memory or on disk.

On disk they are the records of a `ccpin.files.Journal`, whose header is the task: each has the arrays of one move and
of what the simulator carries after it, as npz in base 64. A record is on the
disk before the next move begins.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.containers import told_of
from ccpin.errors import InvalidInputError
from ccpin.files import Journal, OneByOne
from ccpin.schemas import Field
from ccpin.simulation.results import saving
from ccpin.simulation.results.trajectory import Trajectory

_SCHEMA = saving.TRAJECTORY._replace(
    name="a move",
    format="ccpin-move-1",
    header=saving.TRAJECTORY.header | {"start": float, "settled": [float], "end": float},
    fields=saving.TRAJECTORY.fields | {"goal": Field("f", "c", "rad or m")},
)
"""Its trajectory, and the times and the goal of `Move`; ``settled`` is empty or one time."""


class Move(NamedTuple):
    """One move of a supervised motion.

    Attributes:
        goal: q_d, of shape (model.nq,).
        start: Time at which q_d was set, s. settled: since when the motion is settled, ``None`` if it never was.
        end: Time at which the wait was over, or the motion ended.
        trajectory: The motion from start to end.
    """

    goal: Array
    start: float
    settled: float | None
    end: float
    trajectory: Trajectory


class Stored(OneByOne[Move]):
    """The whole moves in a journal, read when they are asked for.

    Args:
        journal: It; it may be closed once no more are appended.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def __len__(self) -> int:
        return len(self._journal)

    def _one(self, number: int) -> Move:
        with told_of(self._journal.path):
            header, arrays = _SCHEMA.read_npz(self._bytes(number, "move"))
            return Move(
                goal=arrays["goal"],
                start=header["start"],
                settled=header["settled"][0] if header["settled"] else None,
                end=header["end"],
                trajectory=Trajectory(**saving.unpacked(header, arrays)),
            )

    def __iter__(self) -> Iterator[Move]:
        return (self[k] for k in range(len(self)))

    def carried(self) -> dict[str, Array]:
        """What the simulator carries after the last move."""
        with told_of(self._journal.path), np.load(self._bytes(-1, "carried"), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}

    def append(self, move: Move, carried: Mapping[str, Array]) -> None:
        """Write one move and what the simulator carries after it."""
        header, arrays = saving.packed(move.trajectory._asdict())
        settled = [] if move.settled is None else [float(move.settled)]
        header |= {"start": float(move.start), "settled": settled, "end": float(move.end)}
        whole, after = io.BytesIO(), io.BytesIO()
        _SCHEMA.write_npz(whole, header, arrays | {"goal": np.asarray(move.goal, dtype=np.float64)})
        np.savez(after, **carried)  # type: ignore[arg-type]
        self._journal.append({"move": _in_text(whole), "carried": _in_text(after)})

    def _bytes(self, place: int, part: str) -> io.BytesIO:
        record = self._journal[place]
        if part not in record:
            raise InvalidInputError(f"record {place} has no '{part}': it is damaged, or of an older format")
        return io.BytesIO(base64.b64decode(record[part], validate=True))


def _in_text(data: io.BytesIO) -> str:
    return base64.b64encode(data.getbuffer()).decode("ascii")


class Unfinished(OneByOne[Move]):
    """Whole moves, and the one that ended the motion early behind them.

    Args:
        whole: The whole moves.
        last: The other one.
    """

    def __init__(self, whole: Sequence[Move], last: Move) -> None:
        self._whole, self._last = whole, last

    def __len__(self) -> int:
        return len(self._whole) + 1

    def _one(self, number: int) -> Move:
        return self._last if number == len(self._whole) else self._whole[number]
