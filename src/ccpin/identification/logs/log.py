"""What was measured: times, and positions, velocities and efforts of joints beside them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, FrozenMapping, Record, frozen, instance, number, numbers
from ccpin.containers import told_of
from ccpin.description.names import choices
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.identification.logs.log_files import UNITS, on_one_clock, recorded, write_table
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.results.trajectory import Trajectory

T = TypeVar("T")
QUANTITIES = {"q": "rad or m", "v": "rad/s or m/s", "u": "N m or N"}
"""What a column's name begins with, and its unit: ``q_hip`` is the position of the joint ``hip``."""


@dataclass(frozen=True, eq=False, repr=False)
class Log(Record):
    """Measured positions, velocities and efforts of joints, at times that all of them share.

    Attributes:
        t: Times in seconds, rising, of shape (T,).
        columns: Numbers by name, of shape (T,) each, in SI units, NaN where there is no sample: ``q_JOINT`` positions
            (rad or m; of a continuous joint an angle), ``v_JOINT`` velocities, ``u_JOINT`` efforts (N m or N). Any
            joint may be there, also one that nothing drives: an encoder on a passive joint.
        source: Where it is from, for messages.

    Raises:
        InvalidInputError: Fewer than two times, times that do not rise, an infinite number, a column of another length
            or another kind of name.
    """

    t: Array
    columns: Mapping[str, Array]
    source: str = "a log"

    def __post_init__(self) -> None:
        times = frozen(numbers(self.t, "t"))
        if times.ndim != 1 or len(times) < 2 or not np.all(np.isfinite(times)):
            raise InvalidInputError(f"{self.source}: t must be two finite times or more, not of shape {times.shape}")
        if not np.all(np.diff(times) > 0.0):
            row = int(np.argmin(np.diff(times) > 0.0)) + 1
            raise InvalidInputError(f"{self.source}: t[{row}] = {times[row]:.9g} s is not after the time before it")
        kept = {
            name: frozen(numbers(column, name)) for name, column in instance(self.columns, "columns", Mapping).items()
        }
        for name, column in kept.items():
            if name[:2] not in {f"{quantity}_" for quantity in QUANTITIES}:
                raise InvalidInputError(f"{self.source}: '{name}' must begin with q_, v_ or u_, then a joint's name")
            if column.shape != times.shape:
                raise InvalidInputError(f"{self.source}: '{name}' has shape {column.shape}; t has {times.shape}")
            if np.any(np.isinf(column)):
                raise InvalidInputError(f"{self.source}: '{name}' has an infinite number")
        object.__setattr__(self, "columns", FrozenMapping(kept.items()))
        super().__post_init__()

    def __repr__(self) -> str:
        rate = (len(self.t) - 1) / (self.t[-1] - self.t[0])
        missing = sum(int(np.isnan(column).sum()) for column in self.columns.values())
        told = f"{self.source}: {len(self.t)} samples in {self.t[-1] - self.t[0]:.6g} s, {rate:.4g} Hz"
        return f"Log({told}{f', {missing} numbers missing' if missing else ''}; {', '.join(self.columns)})"

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        columns: Mapping[str, str] | None = None,
        units: Mapping[str, str | float] | None = None,
        time: str | None = None,
    ) -> Log:
        """Read a log; the suffix says how.

        ``.csv`` (a line of names, then numbers; an empty field is missing), ``.parquet``, ``.npz`` (named arrays; a
        trajectory's is one), ``.mat`` up to version 7 (vectors, and Simulink's *Structure With Time*), ``.mcap``,
        ``.db3``, ``.bag`` and folders of rosbag2 (``sensor_msgs/JointState`` of every topic, by the header's stamp).
        Quantities recorded at times of their own are put on all these times together, NaN between.

        Args:
            path: The file, or a rosbag2 folder.
            columns: Which of the file's columns each of the log's is, ``{"q_hip": "left/position"}``, others being
                left out; by default those that are called ``q_…``, ``v_…``, ``u_…``.
            units: In what unit a column of the log, or a quantity (``"q"``), is written, where that is not SI: one of
                deg, rev, mm, deg/s, rpm, rev/s, mm/s, N mm, or a factor (N m per ampere, say).
            time: The column of times, seconds; by default ``t``, ``time`` or ``tout``.

        Raises:
            InvalidInputError: The file is none of these, damaged, or has no such column; a table's times do not rise; a
                unit is unknown, 0, of another quantity, or of no column; a package for it is not installed.
        """
        if not isinstance(path, str | Path):
            raise InvalidInputError(f"a log to read must be a path, not {type(path).__name__}")
        if columns is not None:
            instance(columns, "columns", Mapping)
        if units is not None:
            instance(units, "units", Mapping)
        with nullcontext() if Path(path).is_dir() else told_of(path):
            found = recorded(Path(path), time)
            named = (
                dict(columns)
                if columns is not None
                else {name: name for name in found if name[:2] in ("q_", "v_", "u_")}
            )
            missing = sorted(set(named.values()) - set(found))
            if missing or not named:
                said = f"no column {', '.join(map(repr, missing))}" if missing else "no column q_…, v_… or u_…"
                raise InvalidInputError(f"{path}: {said}; there are {', '.join(found) or 'none'}")
            _known(units or {}, named)
            factors = {name: _factor(name, dict(units or {})) for name in named}
            t, kept = on_one_clock({name: found[theirs] for name, theirs in named.items()})
            return cls(t, {name: column * factors[name] for name, column in kept.items()}, Path(path).name)

    @classmethod
    def of(cls, motion: Trajectory, model: ReducedModel | Mechanism, sensors: Iterable[str] = ()) -> Log:
        """A simulated motion as what its motors' encoders and drives would have told.

        Args:
            motion: The motion.
            model: What moved.
            sensors: Names of further joints whose positions are measured.

        Raises:
            DifferentSubjectsError: The motion is of another mechanism.
            InvalidInputError: A sensor is no joint with one position, or the motion has fewer than two samples.
        """
        model = instance(motion, "motion", Trajectory).of("a log of a motion", model, "closures")
        rows = np.r_[True, np.diff(motion.t) > 0.0]
        parts = {part.name: part for part in model.coordinates.parts}
        plain = {name: motion.q[:, part.q.start] for name, part in parts.items() if part.q.stop - part.q.start == 1}
        measured = dict.fromkeys([*parts, *sensors])
        found = {name: plain[name] if name in plain else position(model, name, motion.q_free) for name in measured}
        columns = {f"q_{name}": column[rows] for name, column in found.items()}
        columns |= {f"v_{name}": column[rows] for name, column in zip(motion.names.v, motion.v.T, strict=True)}
        columns |= {f"u_{name}": column[rows] for name, column in zip(motion.names.u, motion.u.T, strict=True)}
        return cls(motion.t[rows], columns, f"a motion of {model.mechanism.name}")

    def save(self, path: str | Path) -> None:
        """Write a ``.csv`` or ``.parquet`` that `read` reads again, whole or not at all.

        Raises:
            InvalidInputError: Another suffix, or the file cannot be written.
        """
        if not isinstance(path, str | Path):
            raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
        write_table({"t": self.t, **self.columns}, Path(path))

    def between(self, begin: float, end: float) -> Log:
        """The samples with begin ≤ t ≤ end, seconds."""
        rows = (self.t >= number(begin, "begin")) & (self.t <= number(end, "end"))
        return Log(self.t[rows], {name: column[rows] for name, column in self.columns.items()}, self.source)

    def delayed(self, seconds: Mapping[str, float]) -> Log:
        """The log with some columns' clocks set right: a column whose stamps are late by τ is what was τ earlier.

        Args:
            seconds: τ of a column (``"u_hip"``), or of all of a quantity (``"u"``).

        Raises:
            InvalidInputError: There is no such column.
        """
        instance(seconds, "seconds", Mapping)
        _known(seconds, self.columns)
        late = {name: number(_said(name, seconds, 0.0), f"the delay of '{name}'") for name in self.columns}
        there = {name: ~np.isnan(column) for name, column in self.columns.items()}
        shifted = {name: (self.t[there[name]] - late[name], each[there[name]]) for name, each in self.columns.items()}
        t, columns = on_one_clock(shifted)
        return Log(t, columns, self.source)


def same(log: Log, other: Log) -> bool:
    """Whether two logs have the same times and numbers."""
    mine, theirs = ({"t": each.t, **each.columns} for each in (log, other))
    return mine.keys() == theirs.keys() and all(
        np.array_equal(column, theirs[name], equal_nan=True) for name, column in mine.items()
    )


def position(model: ReducedModel, name: str, q_free: ArrayLike) -> Array:
    """The positions of a joint with one, along configurations (T, nq): an angle goes on over whole turns.

    Raises:
        InvalidInputError: It is no joint, or has several positions.
    """
    joint = one_position(model, name)
    values = np.asarray(q_free)[:, joint.q]
    return np.unwrap(np.arctan2(values[:, 1], values[:, 0])) if joint.kind.unit else values[:, 0]


def one_position(model: ReducedModel, name: str) -> TreeJoint:
    """The joint of a name, which has one position.

    Raises:
        InvalidInputError: It is no joint, or has several positions.
    """
    tree = model.mechanism.tree
    if name not in tree.names:
        raise InvalidInputError(f"'{name}' is not a movable joint; {choices(name, tree.names)}")
    if tree.joint(name).kind.nv != 1:
        raise InvalidInputError(f"'{name}' is a {tree.joint(name).kind.name} joint, which has no single position")
    return tree.joint(name)


def require_plain(model: ReducedModel, what: str) -> None:
    """Check that every coordinate is a plain number.

    Raises:
        UnsupportedMechanismError: One is a ball or a circle.
    """
    if not model.coordinates.scalar:
        named = ", ".join(part.name for part in model.coordinates.parts if part.whole is not None)
        raise UnsupportedMechanismError(f"{what} takes coordinates that are plain numbers, which {named} is not")


def _said(name: str, given: Mapping[str, T], default: T) -> T:
    """What is said of a column by its name, else by its quantity."""
    return given.get(name, given.get(name[0], default))


def _known(given: Mapping[str, object], columns: Mapping[str, object]) -> None:
    there = {*columns, *(name[0] for name in columns if name[1:2] == "_")}
    if unknown := [name for name in given if name not in there]:
        raise InvalidInputError(f"no column '{unknown[0]}'; there are {', '.join(columns)}")


def _factor(name: str, units: Mapping[str, str | float]) -> float:
    unit = _said(name, units, 1.0)
    if isinstance(unit, str):
        known = UNITS.get(name[0], {})
        if unit not in known:
            raise InvalidInputError(f"'{name}' is in no unit {unit!r}; known are {', '.join(known)}, or a factor")
        return known[unit]
    factor = number(unit, f"the unit of '{name}'")
    if not factor:
        raise InvalidInputError(f"the unit of '{name}' must not be 0")
    return factor
