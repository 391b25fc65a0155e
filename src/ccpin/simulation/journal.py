"""A supervised motion on disk: an append-only file of whole moves, good to go on from after any kind of end.

The file is a row of records, each b"ccpinmv1", the length and the CRC-32 of what follows, and that: the first one
the task as JSON, each other one the arrays of one move and of what the simulator carries after it, as npz. A record
is written and synchronised before the next move begins. What a killed process left half written is cut off.
"""

from __future__ import annotations

import abc
import io
import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, overload

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError
from ccpin.files import writable_target
from ccpin.simulation import saving
from ccpin.simulation.trajectory import Trajectory

_MAGIC = b"ccpinmv1"
_HEAD = struct.Struct("<8sQI")
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


class Journal(_Moves):
    """The moves in a file, read when they are asked for.

    Args:
        path: The file; made where it is absent, gone on with where it is there.
        task: What the moves belong to, as JSON; a file of another task is refused.

    Raises:
        InvalidInputError: The file is no journal, or one of another task, or cannot be written.
    """

    def __init__(self, path: str | Path, task: Mapping[str, Any]) -> None:
        self._path = writable_target(path)
        self._offsets: list[int] = []
        self._end = 0
        wanted = json.dumps(task, sort_keys=True).encode()
        if not self._path.exists() or not self._path.stat().st_size:
            self._append(wanted)
            return
        with self._path.open("rb") as file:
            found = _record(file)
            if found is None:
                raise InvalidInputError(f"'{path}' is no journal of a supervised motion")
            if found != wanted:
                raise InvalidInputError(f"'{path}' is the journal of another task: {_difference(found, wanted)}")
            self._end = file.tell()
            while _record(file) is not None:
                self._offsets.append(self._end)
                self._end = file.tell()
        os.truncate(self._path, self._end)

    def __len__(self) -> int:
        return len(self._offsets)

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
        start = self._end
        self._append(payload.getvalue())
        self._offsets.append(start)

    def _arrays(self, place: int) -> dict[str, Array]:
        with self._path.open("rb") as file:
            file.seek(self._offsets[place])
            payload = _record(file)
        if payload is None:
            raise InvalidInputError(f"'{self._path}' was changed while it was in use")
        with np.load(io.BytesIO(payload)) as stored:
            return {name: stored[name] for name in stored.files}

    def _append(self, payload: bytes) -> None:
        """Write a record behind the last one, and have it on the disk."""
        try:
            with self._path.open("ab") as file:
                if file.tell() != self._end:
                    raise InvalidInputError(f"'{self._path}' is written to by another process")
                file.write(_HEAD.pack(_MAGIC, len(payload), zlib.crc32(payload)) + payload)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InvalidInputError(f"cannot write '{self._path}': {error}") from None
        self._end += _HEAD.size + len(payload)


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


def _record(file: io.BufferedReader) -> bytes | None:
    """The next record whole, or ``None``; the file is then where it was."""
    place = file.tell()
    head = file.read(_HEAD.size)
    if len(head) == _HEAD.size:
        magic, length, checksum = _HEAD.unpack(head)
        if magic == _MAGIC and length <= os.fstat(file.fileno()).st_size - place:
            payload = file.read(length)
            if len(payload) == length and zlib.crc32(payload) == checksum:
                return payload
    file.seek(place)
    return None


def _difference(found: bytes, wanted: bytes) -> str:
    """Which entries two tasks differ in."""
    there, here = (json.loads(task) for task in (found, wanted))
    names = sorted(name for name in {*there, *here} if there.get(name) != here.get(name))
    return "; ".join(f"{name} is {there.get(name)} there and {here.get(name)} here" for name in names)
