"""Files of measured quantities: each is read as columns with the times at which they were taken."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError
from ccpin.files import write_text
from ccpin.simulation.results.saving import data_frame, write_parquet

_DEG, _REV = math.pi / 180, 2 * math.pi
UNITS = {
    "q": {"rad": 1.0, "m": 1.0, "deg": _DEG, "rev": _REV, "mm": 1e-3},
    "v": {"rad/s": 1.0, "m/s": 1.0, "deg/s": _DEG, "rev/s": _REV, "rpm": _REV / 60, "mm/s": 1e-3},
    "u": {"N m": 1.0, "N": 1.0, "N mm": 1e-3},
}
"""Units that a file may have its positions, velocities and efforts in, and what they are in SI."""
TIMES = ("t", "time", "tout")
"""What a column of times is called, unless it is said."""


class Channel(NamedTuple):
    """One measured quantity: its times and its values, of shape (K,) each."""

    t: Array
    values: Array


Recorded = dict[str, Channel]


def recorded(path: Path, time: str | None) -> Recorded:
    """All columns of a file by name.

    Raises:
        InvalidInputError: The suffix is unknown, the file is damaged, has no times or times that go back, or a package
            is not installed.
    """
    if path.is_dir() or path.suffix in (".mcap", ".db3", ".bag"):
        return _of_ros(path)
    if path.suffix not in _READERS:
        raise InvalidInputError(f"{path}: a log is {', '.join(_READERS)}, .mcap, .db3, .bag or a rosbag2 folder")
    return _with_times(_READERS[path.suffix](path), time)


def on_one_clock(columns: Mapping[str, tuple[Array, Array]]) -> tuple[Array, dict[str, Array]]:
    """The times of all columns together, and each column at these, NaN where it has no sample.

    Raises:
        InvalidInputError: A column has two samples at one time, or a time that is not finite.
    """
    for name, (t, _) in columns.items():
        if not np.all(np.isfinite(t)):
            raise InvalidInputError(f"'{name}' has a time that is not finite")
        if len(np.unique(t)) != len(t):
            raise InvalidInputError(f"'{name}' has two samples at one time")
    times = np.unique(np.concatenate([t for t, _ in columns.values()]))
    placed = {}
    for name, (t, values) in columns.items():
        placed[name] = np.full(len(times), np.nan)
        placed[name][np.searchsorted(times, t)] = values
    return times, placed


def write_table(table: Mapping[str, Array], path: Path) -> None:
    """Write columns as ``.csv`` or ``.parquet``; NaN is an empty field.

    Raises:
        InvalidInputError: Another suffix, or the file cannot be written.
    """
    if table_target(path).suffix == ".parquet":
        write_parquet(data_frame(table), path)
    else:
        text = StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(table)
        columns = (np.asarray(column, dtype=np.float64).tolist() for column in table.values())
        rows.writerows(["" if math.isnan(value) else value for value in row] for row in zip(*columns, strict=True))
        write_text(path, text.getvalue())


def table_target(path: Path) -> Path:
    """Where columns are to be written.

    Raises:
        InvalidInputError: The suffix is another.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise InvalidInputError(f"'{path}' must end in .csv or .parquet")
    return path


def _of_csv(path: Path) -> dict[str, Array]:
    text = path.read_text(encoding="utf-8-sig")
    separator = max(",;\t", key=text.partition("\n")[0].count)
    rows = [row for row in csv.reader(text.splitlines(), delimiter=separator) if row]
    if not rows:
        raise InvalidInputError("it is empty")
    names = [name.strip() for name in rows[0]]
    if len(set(names)) != len(names) or any(map(_is_number, names)):
        raise InvalidInputError("its first line must name each column once")
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise InvalidInputError(f"row {line} has {len(row)} fields; there are {len(names)} columns")
        for name, field in zip(names, row, strict=True):
            if field.strip() and not _is_number(field):
                raise InvalidInputError(f"row {line}, '{name}': {field!r:.40} is no number")
    table = np.array([[float(field) if field.strip() else np.nan for field in row] for row in rows[1:]])
    return dict(zip(names, table.reshape(-1, len(names)).T, strict=True))


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _of_parquet(path: Path) -> dict[str, Array]:
    try:
        import pandas as pd

        frame = pd.read_parquet(path)
    except ImportError as error:
        raise InvalidInputError(f"Parquet needs pandas and pyarrow ({error}); pip install 'ccpin[tables]'") from None
    numeric = frame.select_dtypes("number", exclude="timedelta")
    return {str(name): numeric[name].to_numpy(dtype=np.float64) for name in numeric.columns}


def _of_npz(path: Path) -> dict[str, Array]:
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files if archive[name].dtype.kind in "fiu"}
    return _flat(arrays)


def _of_mat(path: Path) -> dict[str, Array]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InvalidInputError("MATLAB files of version 7.3 are not read: save with '-v7'") from None
    except MatReadError as error:
        raise InvalidInputError(f"no MATLAB file ({error})") from error
    arrays: dict[str, Any] = {}
    for name, value in found.items():
        if isinstance(value, dict) and {"time", "signals"} <= set(value):  # Simulink's Structure With Time
            signals = value["signals"] if isinstance(value["signals"], list) else [value["signals"]]
            arrays["t"] = value["time"]
            labels = [str(signal.get("label") or "") for signal in signals]
            once = len(signals) == 1
            for k, (label, signal) in enumerate(zip(labels, signals, strict=True)):
                arrays[label or (name if once else f"{name}.{k}")] = signal["values"]
        elif not name.startswith("__"):
            arrays[name] = value
    return _flat({name: np.asarray(value) for name, value in arrays.items()})


def _flat(arrays: Mapping[str, np.ndarray[Any, Any]]) -> dict[str, Array]:
    """Vectors by name; the columns of a matrix by its name and their number."""
    flat: dict[str, Array] = {}
    for name, value in arrays.items():
        if value.dtype.kind not in "fiu" or value.ndim not in (1, 2):
            continue
        table = np.asarray(value, dtype=np.float64)
        if table.ndim == 2 and 1 in table.shape:
            table = table.ravel()
        flat |= {name: table} if table.ndim == 1 else {f"{name}.{k}": column for k, column in enumerate(table.T)}
    return flat


def _with_times(table: Mapping[str, Array], time: str | None) -> Recorded:
    called = next((name for name in ((time,) if time else TIMES) if name in table), None)
    if called is None:
        raise InvalidInputError(
            f"no column of times {time or ' or '.join(TIMES)}; there are {', '.join(table) or 'none'}"
        )
    t = table[called]
    if (back := np.flatnonzero(np.diff(t) < 0.0)).size:
        raise InvalidInputError(
            f"'{called}' goes back after {t[back[0]]:.9g} s, to {t[back[0] + 1]:.9g} s: a clock was set, or these are "
            "several logs"
        )
    return {name: Channel(t, values) for name, values in table.items() if name != called and values.shape == t.shape}


def _of_ros(path: Path) -> Recorded:
    """Joint states of all topics by joint; times from the first stamp of all."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InvalidInputError("bags need rosbags; pip install 'ccpin[bags]'") from None
    samples: dict[str, list[tuple[int, float]]] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
            states = [each for each in bag.connections if each.msgtype.endswith("/JointState")]
            for connection, _, raw in bag.messages(connections=states) if states else ():
                for name, stamp, value in _joint_state(bag.deserialize(raw, connection.msgtype)):
                    samples.setdefault(name, []).append((stamp, value))
    except Exception as error:  # of its own, of YAML, of SQLite, and whatever damaged messages bring about
        raise InvalidInputError(f"no bag that can be read ({error!s:.200} {type(error).__name__})") from error
    if not samples:
        raise InvalidInputError("the bag has no sensor_msgs/JointState with numbers")
    first, found = min(at for rows in samples.values() for at, _ in rows), {}
    for name, rows in samples.items():
        stamps, values = zip(*sorted(rows), strict=True)
        found[name] = Channel(np.array([stamp - first for stamp in stamps]) * 1e-9, np.array(values))
    return found


def _joint_state(message: Any) -> Iterator[tuple[str, int, float]]:
    """(column, nanoseconds, number) of a message; a list without numbers is not measured."""
    stamp = message.header.stamp
    at = stamp.sec * 1_000_000_000 + stamp.nanosec
    for quantity, numbers in (("q", message.position), ("v", message.velocity), ("u", message.effort)):
        if len(numbers) == len(message.name):
            yield from (
                (f"{quantity}_{name}", at, float(value)) for name, value in zip(message.name, numbers, strict=True)
            )


_READERS: dict[str, Callable[[Path], dict[str, Array]]] = {
    ".csv": _of_csv,
    ".parquet": _of_parquet,
    ".npz": _of_npz,
    ".mat": _of_mat,
}
