"""Trajectories in files: npz with everything, CSV and Parquet with named columns."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError
from ccpin.files import write_atomically
from ccpin.simulation.samples import SAMPLED, Happening, Names

if TYPE_CHECKING:
    import pandas as pd

_EVENT_ARRAYS = ("t", "q", "v", "q_free")


def save(motion: Mapping[str, Any], path: Path) -> None:
    """Write a motion, a trajectory's fields by name; `Trajectory.save` says how."""
    if path.suffix == ".npz":
        arrays: dict[str, Any] = as_arrays(motion)
        write_atomically(path, "wb", lambda file: np.savez_compressed(file, **arrays))
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
    names = motion["names"]
    blocks = (
        ("q", names.q, motion["q"]),
        ("v", names.v, motion["v"]),
        ("a", names.v, motion["a"]),
        ("u", names.u, motion["u"]),
        ("qfree", names.q_free, motion["q_free"]),
        ("vfree", names.v_free, motion["v_free"]),
        ("friction", names.v_free, motion["friction"]),
        ("limits", names.v_free, motion["limits"]),
    )
    found = {"t": motion["t"]}
    for symbol, called, block in blocks:
        found |= {f"{symbol}_{name}": column for name, column in zip(called, block.T, strict=True)}
    return found | {"closure_error": motion["closure_error"]}


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


def as_arrays(motion: Mapping[str, Any]) -> dict[str, Any]:
    """A trajectory as arrays by name, without the cause; `from_arrays` undoes it."""
    arrays: dict[str, Any] = {name: motion[name] for name in SAMPLED}
    names = ("status", "message", "evaluations", "wall_time")
    arrays |= {name: np.array(motion[name]) for name in names}
    arrays["names"] = np.array(json.dumps(motion["names"]._asdict()))
    arrays["event_name"] = np.array([event.name for event in motion["events"]], dtype=np.str_)
    for field, like in zip(_EVENT_ARRAYS, ((), motion["q"], motion["v"], motion["q_free"]), strict=True):
        shape = (0, *np.shape(like)[1:])
        rows = [getattr(event, field) for event in motion["events"]]
        arrays[f"event_{field}"] = np.array(rows, dtype=np.float64) if rows else np.empty(shape)
    return arrays


def from_arrays(arrays: Any) -> dict[str, Any]:
    """The fields of a trajectory from what `as_arrays` made.

    Raises:
        KeyError, ValueError, TypeError: It is not one.
    """
    names = Names(**{field: tuple(called) for field, called in json.loads(str(arrays["names"])).items()})
    records = zip(*(arrays[f"event_{field}"] for field in _EVENT_ARRAYS), strict=True)
    events = [
        Happening(str(name), float(t), *rest) for name, (t, *rest) in zip(arrays["event_name"], records, strict=True)
    ]
    return {name: arrays[name] for name in SAMPLED} | {
        "status": str(arrays["status"]),
        "message": str(arrays["message"]),
        "cause": None,
        "events": tuple(events),
        "evaluations": int(arrays["evaluations"]),
        "wall_time": float(arrays["wall_time"]),
        "names": names,
    }
