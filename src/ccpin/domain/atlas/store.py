"""Atlases on disk: one npz file of plain arrays (no pickles), written whole or not at all."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import frozen
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.domain.boxes import Problem, problem_of
from ccpin.domain.chains import Chain, ClosureSystem
from ccpin.domain.chart import Chart, ChartJoint
from ccpin.errors import InvalidInputError
from ccpin.files import write_atomically

FORMAT = "ccpin-atlas-1"
NamedArrays = dict[str, NDArray[np.generic]]
_SYSTEM_ARRAYS = ("couplings", "offset", "moduli", "independent", "dependent", "periodic")


def write(path: str | Path, header: dict[str, Any], arrays: NamedArrays) -> None:
    """Write arrays and a JSON header to a file.

    Raises:
        InvalidInputError: It cannot be written.
    """
    text = json.dumps({"format": FORMAT, **header})
    header_bytes = np.frombuffer(text.encode(), dtype=np.uint8)
    write_atomically(path, "wb", lambda file: np.savez(file, header=header_bytes, **arrays))  # type: ignore[arg-type]


def read(path: str | Path) -> tuple[dict[str, Any], NamedArrays]:
    """The header and the arrays of a file.

    Raises:
        InvalidInputError: It is not an atlas, or cannot be read.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(arrays.pop("header").tobytes().decode())
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidInputError(f"{path}: not a readable atlas ({error})") from error
    if header.get("format") != FORMAT:
        raise InvalidInputError(f"{path}: the format is {header.get('format')!r}, not {FORMAT!r}")
    return header, arrays


def pack_problem(problem: Problem) -> tuple[dict[str, Any], NamedArrays]:
    """A problem as a header and arrays."""
    system = problem.system
    arrays: NamedArrays = {f"system_{name}": getattr(system, name) for name in _SYSTEM_ARRAYS}
    for k, chain in enumerate(system.chains):
        for name, value in chain._asdict().items():
            arrays[f"chain{k}_{name}"] = np.asarray(value)
    for k, joint in enumerate(system.chart.joints):
        arrays[f"joint{k}_reference"] = joint.reference
    header = {
        "chains": len(system.chains),
        "scale": system.scale,
        "depth": system.depth,
        "nq": system.chart.nq,
        "n_free": system.chart.n_free,
        "joints": [[j.name, j.kind.name, j.q.start, j.q.stop, j.v.start, j.v.stop] for j in system.chart.joints],
        "planar": problem.phasors is not None,
    }
    return header, arrays


def unpack_problem(header: dict[str, Any], arrays: NamedArrays) -> Problem:
    """The problem that `pack_problem` packed."""
    chains = []
    for k in range(header["chains"]):
        fields = {name: arrays[f"chain{k}_{name}"] for name in Chain._fields}
        chains.append(Chain(**{**fields, "direction": bool(fields["direction"])}))  # type: ignore[arg-type]
    joints = tuple(
        ChartJoint(name, JOINT_KINDS[kind], slice(q0, q1), slice(v0, v1), frozen(arrays[f"joint{k}_reference"]))
        for k, (name, kind, q0, q1, v0, v1) in enumerate(header["joints"])
    )
    named: dict[str, Any] = {name: arrays[f"system_{name}"] for name in _SYSTEM_ARRAYS}
    system = ClosureSystem(
        chains=tuple(chains),
        scale=header["scale"],
        depth=header["depth"],
        chart=Chart(joints, header["nq"], header["n_free"]),
        **named,
    )
    return problem_of(system, "planar" if header["planar"] else "reach")
