"""Trajectories in files: npz with everything, CSV and Parquet with named columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError
from ccpin.files import write_atomically
from ccpin.proof.digests import Digests
from ccpin.schemas import Choice, Field, Schema
from ccpin.simulation.events.samples import SAMPLED, ColumnNames, EventRecord, Status

if TYPE_CHECKING:
    import pandas as pd

_EVENT_ARRAYS = ("t", "q", "v", "q_free")

_SAMPLES = {
    "t": Field("f", "T", "s"),
    "q": Field("f", "T c", "rad or m"),
    "v": Field("f", "T n", "rad/s or m/s"),
    "a": Field("f", "T n", "rad/s² or m/s²", finite=False),
    "u": Field("f", "T u", "N m or N", finite=False),
    "q_free": Field("f", "T p", "rad or m"),
    "v_free": Field("f", "T w", "rad/s or m/s"),
    "friction": Field("f", "T w", "N m or N", finite=False),
    "limits": Field("f", "T w", "N m or N", finite=False),
    "closure_error": Field("f", "T", "m or rad", 0),
}
_EVENTS = {name: _SAMPLES[name]._replace(shape=_SAMPLES[name].shape.replace("T", "E")) for name in _EVENT_ARRAYS}
_CALLED = {"c": "q", "n": "v", "u": "u", "p": "q_free", "w": "v_free"}
"""T samples and E events; q of c numbers, n velocities, u motors; q′ of p numbers, q̇′ of w: fields of `ColumnNames`."""

TRAJECTORY = Schema(
    "a trajectory",
    "ccpin-trajectory-1",
    {
        "status": Choice(get_args(Status)),
        "message": str,
        "evaluations": int,
        "wall_time": float,
        "names": {field: [str] for field in ColumnNames._fields},
        "events": [str],
        "origin": dict.fromkeys(Digests._fields, str),
        "notes": [str],
    },
    _SAMPLES | {f"event_{name}": field for name, field in _EVENTS.items()},
)


def save(motion: Mapping[str, Any], path: Path) -> None:
    """Write a motion, a trajectory's fields by name; `Trajectory.save` says how."""
    if path.suffix == ".npz":
        TRAJECTORY.write(path, *packed(motion))
    elif path.suffix == ".csv":
        header, table = ",".join(columns(motion)), np.column_stack(list(columns(motion).values()))
        write_atomically(
            path, "w", lambda file: np.savetxt(file, table, delimiter=",", header=header, comments="", fmt="%.17g")
        )
    elif path.suffix == ".parquet":
        write_parquet(to_pandas(motion), path)
    else:
        raise InvalidInputError(f"'{path}' must end in .npz, .csv or .parquet")


_INSTALL = "pip install 'ccpin[tables]'"


def columns(motion: Mapping[str, Any]) -> dict[str, Array]:
    """The samples column by column, by name: ``t``, ``q_joint1``, ``friction_joint3``, and so on."""
    found = {}
    for name, field in _SAMPLES.items():
        block, called = motion[name], _CALLED.get(field.shape[-1])
        if called is None:
            found[name] = block
            continue
        symbol, names = name.replace("_free", "free"), getattr(motion["names"], called)
        found |= {f"{symbol}_{each}": column for each, column in zip(names, block.T, strict=True)}
    return found


def to_pandas(motion: Mapping[str, Any]) -> pd.DataFrame:
    """A data frame; `Trajectory.to_pandas` says how."""
    frame = data_frame(columns(motion))
    frame.attrs = {name: motion[name] for name in ("status", "message", "evaluations", "wall_time")}
    frame.attrs["events"] = [{"name": event.name, "t": event.t} for event in motion["events"]]
    return frame


def data_frame(table: Mapping[str, Any]) -> pd.DataFrame:
    """Columns by name as a data frame.

    Raises:
        InvalidInputError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise InvalidInputError(f"a data frame needs pandas; {_INSTALL}") from None
    return pd.DataFrame(table)


def write_parquet(frame: pd.DataFrame, path: Path) -> None:
    """Write a data frame, whole or not at all.

    Raises:
        InvalidInputError: pyarrow is not installed, or the file cannot be written.
    """
    try:
        write_atomically(path, "wb", frame.to_parquet)
    except ImportError as error:
        raise InvalidInputError(f"'{path}': Parquet needs pandas and pyarrow ({error}); {_INSTALL}") from None


def packed(motion: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A trajectory as the header and the arrays of `TRAJECTORY`, without the cause; `unpacked` undoes it."""
    events = motion["events"]
    header = {
        **{name: motion[name] for name in ("status", "message")},
        "evaluations": int(motion["evaluations"]),
        "wall_time": float(motion["wall_time"]),
        "names": {field: list(names) for field, names in motion["names"]._asdict().items()},
        "events": [str(event.name) for event in events],
        "origin": motion["origin"]._asdict(),
        "notes": list(motion["notes"]),
    }
    arrays: dict[str, Any] = {name: motion[name] for name in SAMPLED}
    for field in _EVENT_ARRAYS:
        rows = [getattr(event, field) for event in events]
        arrays[f"event_{field}"] = np.array(rows, dtype=np.float64).reshape(-1, *np.shape(motion[field])[1:])
    return header, arrays


def unpacked(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a trajectory from what `packed` made.

    Raises:
        InvalidInputError: Times go backwards, or there are not as many names as columns.
    """
    names = ColumnNames(**{field: tuple(called) for field, called in header["names"].items()})
    for field, called in names._asdict().items():
        if len(called) != arrays[field].shape[1]:
            raise InvalidInputError(f"'names' has {len(called)} of {field}, which has {arrays[field].shape[1]} columns")
    if np.any(np.diff(arrays["t"]) < 0.0):
        raise InvalidInputError("t goes backwards")
    if len(header["events"]) != len(arrays["event_t"]):
        raise InvalidInputError("'events' has not as many names as event_t times")
    records = zip(header["events"], *(arrays[f"event_{field}"] for field in _EVENT_ARRAYS), strict=True)
    plain = {name: header[name] for name in ("status", "message", "evaluations", "wall_time")}
    return (
        {name: arrays[name] for name in SAMPLED}
        | plain
        | {
            "cause": None,
            "events": tuple(EventRecord(name, float(t), *rest) for name, t, *rest in records),
            "names": names,
            "origin": Digests(**header["origin"]),
            "notes": tuple(header["notes"]),
        }
    )
