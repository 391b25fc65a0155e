"""Closures as plain arrays, as files and digests have them: packed and unpacked bit for bit, and compared."""

from __future__ import annotations

import hashlib
from typing import Any, Protocol

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.containers import NamedArrays
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.domain.closures.rods import Rod
from ccpin.domain.closures.scalar_coordinates import Chart, ChartJoint, Elementary
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.errors import DifferentSubjectsError, InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.equations import BoundsName, Problem, Requirements, problem_of

_SYSTEM_ARRAYS = ("couplings", "offset", "moduli", "independent", "dependent", "periodic")


class AboutClosures(Protocol):
    """What was proved of closures: an atlas, sheets, a cover of singular curves."""

    def is_about(self, mechanism: Mechanism | HasMechanism) -> bool:
        """Whether the closures are those of a mechanism."""


def require_about(task: str, proved: AboutClosures, mechanism: Mechanism | HasMechanism) -> None:
    """Nothing, if what was proved is about a mechanism's closures, by their numbers.

    Raises:
        DifferentSubjectsError: It is about others.
    """
    if not proved.is_about(mechanism):
        name = mechanism_of(mechanism).name
        raise DifferentSubjectsError(
            f"{task}: {type(proved).__name__} and mechanism '{name}' do not belong together: they have different "
            "closures or independent coordinates"
        )


def same_closures(reading: Reading, names: tuple[str, ...], mechanism: Mechanism, theta: Array | None = None) -> bool:
    """Whether closures are those that a mechanism's file gives today, bit for bit.

    So are then how θ and q′ correspond, what joints are called, and the independent ones among them (`names`). θ is its
    charts' centre; default the mechanism's reference.

    Raises:
        InvalidInputError: It is a workspace's, whose closures hold an end effector besides, which no file names.
    """
    if reading.problem.requirements is not None:
        raise InvalidInputError(
            "the closures of a workspace also hold its end effector, which a model does not name: compare its "
            "fingerprint with that of an atlas that the same certify_workspace makes today"
        )
    chart = reading.chart
    if (chart.nq, chart.n_free, names) != (mechanism.nq, mechanism.n_free, tuple(mechanism.independent)):
        return False
    if theta is None:
        theta = reading.theta(mechanism.q_reference)
    bounds: BoundsName = "reach" if reading.problem.phasors is None else "auto"
    today = reading_of(mechanism, reading.configuration(theta[None, : chart.n_free])[0])
    return same_reading(today.bounded(bounds), reading)


def same_reading(one: Reading, other: Reading) -> bool:
    """Whether two readings are the same, bit for bit: closures, charts, bounds and demands."""
    (header, arrays), (header_two, arrays_two) = pack_reading(one), pack_reading(other)
    same = header == header_two and {*arrays} == {*arrays_two}
    return same and all(np.array_equal(arrays[name], arrays_two[name]) for name in arrays)


def fingerprint_of(problem: Problem) -> str:
    """SHA-256 of a problem's closures, as its file has it."""
    return fingerprint(_pack_system(problem.system))


def fingerprint(arrays: NamedArrays) -> str:
    """SHA-256 of the closures: every array whose name begins with ``chain`` or ``system``, in the order of names."""
    digest = hashlib.sha256()
    for name in sorted(name for name in arrays if name.startswith(("chain", "system"))):
        array = np.asarray(arrays[name], dtype=np.float64)
        digest.update(f"{name}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def pack_reading(reading: Reading) -> tuple[dict[str, Any], NamedArrays]:
    """A reading as a header and arrays."""
    problem, chart = reading.problem, reading.chart
    arrays, rods = _pack_system(problem.system), list[dict[str, Any]]()
    for k, joint in enumerate(chart.joints):
        arrays[f"joint{k}_reference"] = joint.reference
    for k, rod in enumerate(reading.rods):
        numbers, paths = _pack_rod(rod)
        arrays |= {f"rod{k}_{name}": array for name, array in numbers.items()}
        rods.append(paths)
    header = {
        "rods": rods,
        "chains": len(problem.system.chains),
        "nq": chart.nq,
        "n_free": chart.n_free,
        "joints": [[j.name, j.kind.name, j.q.start, j.q.stop, j.v.start, j.v.stop] for j in chart.joints],
        "planar": problem.phasors is not None,
    }
    if problem.requirements is not None:  # JSON has no infinity: the largest number stands for no limit
        arrays |= {f"demand_{name}": np.nan_to_num(value) for name, value in problem.requirements._asdict().items()}
    return header, arrays


def unpack_reading(header: dict[str, Any], arrays: NamedArrays) -> Reading:
    """The reading that `pack_reading` packed."""
    chains = []
    for k in range(header["chains"]):
        fields = {name: arrays[f"chain{k}_{name}"] for name in Chain._fields}
        chains.append(Chain(**{**fields, "direction": bool(fields["direction"])}))  # type: ignore[arg-type]
    joints = tuple(
        ChartJoint(name, JOINT_KINDS[kind], slice(q0, q1), slice(v0, v1), frozen(arrays[f"joint{k}_reference"]))
        for k, (name, kind, q0, q1, v0, v1) in enumerate(header["joints"])
    )
    named: dict[str, Any] = {name: arrays[f"system_{name}"] for name in _SYSTEM_ARRAYS}
    rods = tuple(
        _unpack_rod(rod, {n[len(f"rod{k}_") :]: a for n, a in arrays.items() if n.startswith(f"rod{k}_")})
        for k, rod in enumerate(header["rods"])
    )
    asked = {name[len("demand_") :]: array for name, array in arrays.items() if name.startswith("demand_")}
    problem = problem_of(ClosureSystem(tuple(chains), **named), "planar" if header["planar"] else "reach")
    if asked:
        problem = problem._replace(requirements=Requirements(**{**asked, "dexterity": float(asked["dexterity"])}))  # type: ignore[arg-type]
    return Reading(problem, Chart(joints, header["nq"], header["n_free"]), rods)


def _pack_system(system: ClosureSystem) -> NamedArrays:
    """Closures as arrays."""
    arrays: NamedArrays = {f"system_{name}": getattr(system, name) for name in _SYSTEM_ARRAYS}
    for k, chain in enumerate(system.chains):
        for name, value in chain._asdict().items():
            arrays[f"chain{k}_{name}"] = np.asarray(value)
    return arrays


def _pack_rod(rod: Rod) -> tuple[NamedArrays, dict[str, Any]]:
    """A rod as arrays and plain numbers."""
    arrays: NamedArrays = {"reference": rod.reference, "frame_a": rod.frame_a, "frame_b": rod.frame_b}
    header: dict[str, Any] = {"place": [rod.place.start, rod.place.stop], "length": rod.length}
    for end, path in (("a", rod.path_a), ("b", rod.path_b)):
        arrays[f"placements_{end}"] = np.array([step.placement for step in path]).reshape(-1, 4, 4)
        arrays[f"axes_{end}"] = np.array([step.axis for step in path]).reshape(-1, 3)
        header[f"steps_{end}"] = [[bool(step.prismatic), int(step.position)] for step in path]
    return arrays, header


def _unpack_rod(header: dict[str, Any], arrays: dict[str, Any]) -> Rod:
    """The rod that `_pack_rod` packed."""
    path_a, path_b = (
        tuple(
            Elementary(placement, axis, prismatic, position)
            for placement, axis, (prismatic, position) in zip(
                arrays[f"placements_{end}"], arrays[f"axes_{end}"], header[f"steps_{end}"], strict=True
            )
        )
        for end in ("a", "b")
    )
    frame_a, frame_b = arrays["frame_a"], arrays["frame_b"]
    return Rod(slice(*header["place"]), header["length"], arrays["reference"], path_a, path_b, frame_a, frame_b)
