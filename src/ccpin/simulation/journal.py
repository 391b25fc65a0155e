"""The moves of a supervised motion, in memory or on disk.

On disk they are the records of a `ccpin.files.Journal`, whose header is the task: each has the arrays of one move and
of what the simulator carries after it, as npz in base 64. A record is on the disk before the next move begins.
"""

from __future__ import annotations

import abc
import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, overload

import numpy as np

from ccpin.arrays import Array
from ccpin.files import Journal
from ccpin.simulation import saving
from ccpin.simulation.trajectory import Trajectory

_MOVE, _CARRIED = "move_", "carried_"


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


class _Moves(Sequence[Move], abc.ABC):
    """Moves that are got one by one by their number."""

    @overload
    def __getitem__(self, place: int) -> Move: ...

    @overload
    def __getitem__(self, place: slice) -> list[Move]: ...

    def __getitem__(self, place: int | slice) -> Move | list[Move]:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        return self._move(range(len(self))[place])

    @abc.abstractmethod
    def _move(self, number: int) -> Move:
        """Move 0 ≤ number < len(self)."""


class Stored(_Moves):
    """The whole moves in a journal, read when they are asked for.

    Args:
        journal: It; it may be closed once no more are appended.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def __len__(self) -> int:
        return len(self._journal)

    def _move(self, number: int) -> Move:
        arrays = self._arrays(number)
        settled = float(arrays[f"{_MOVE}settled"])
        return Move(
            goal=arrays[f"{_MOVE}goal"],
            start=float(arrays[f"{_MOVE}start"]),
            settled=None if np.isnan(settled) else settled,
            end=float(arrays[f"{_MOVE}end"]),
            trajectory=Trajectory(**saving.from_arrays(arrays)),
        )

    def __iter__(self) -> Iterator[Move]:
        return (self[k] for k in range(len(self)))

    def carried(self) -> dict[str, Array]:
        """What the simulator carries after the last move."""
        arrays = self._arrays(-1)
        return {name.removeprefix(_CARRIED): array for name, array in arrays.items() if name.startswith(_CARRIED)}

    def append(self, move: Move, carried: Mapping[str, Array]) -> None:
        """Write one move and what the simulator carries after it."""
        arrays = saving.as_arrays(move.trajectory._asdict())
        arrays |= {f"{_CARRIED}{name}": array for name, array in carried.items()}
        settled = np.nan if move.settled is None else move.settled
        numbers = {"goal": move.goal, "start": move.start, "settled": settled, "end": move.end}
        arrays |= {f"{_MOVE}{name}": np.array(number) for name, number in numbers.items()}
        payload = io.BytesIO()
        np.savez_compressed(payload, **arrays)  # type: ignore[arg-type]
        self._journal.append({"npz": base64.b64encode(payload.getbuffer()).decode("ascii")})

    def _arrays(self, place: int) -> dict[str, Array]:
        with np.load(io.BytesIO(base64.b64decode(self._journal[place]["npz"]))) as stored:
            return {name: stored[name] for name in stored.files}


class Unfinished(_Moves):
    """Whole moves, and the one that ended the motion early behind them.

    Args:
        whole: The whole moves.
        last: The other one.
    """

    def __init__(self, whole: Sequence[Move], last: Move) -> None:
        self._whole, self._last = whole, last

    def __len__(self) -> int:
        return len(self._whole) + 1

    def _move(self, number: int) -> Move:
        return self._last if number == len(self._whole) else self._whole[number]
