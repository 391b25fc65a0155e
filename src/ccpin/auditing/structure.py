"""What a document's closures, coordinates and region must be before anything of them is proved.

Nothing here is a theorem: these are the hypotheses that all theorems share. Where the document could say something that
follows from the rest (which coordinates close on themselves, which is which, what they are called), it must say that.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.auditing.container import Arrays

_TURN = 2.0 * np.pi  # rad: a range closes on itself where its ends differ by just this, in doubles
_UNIT = 1e-12  # how far rotations and axes may be from orthogonal and of unit length: they are so to rounding
_LARGEST = 1e9  # m or rad: of no mechanism, and squares of it are far from overflowing


class ContradictionError(Exception):
    """What contradicts itself in a document, in words; `document.read` names the file."""


def require(holds: bool | np.bool_, fault: str) -> None:
    """Raise `ContradictionError` where something does not hold."""
    if not holds:
        raise ContradictionError(fault)


def check_closures(header: dict[str, Any], arrays: Arrays) -> None:
    """The coordinates are divided into q and y, chains are of rotations and unit axes, and periods are periods.

    Raises:
        ContradictionError: Not so.
    """
    size = arrays["system_couplings"].shape[1]
    both = np.concatenate([arrays["system_independent"], arrays["system_dependent"]])
    require(
        np.array_equal(np.sort(both), np.arange(size)), "system_independent and system_dependent overlap or leave out"
    )
    moduli, slides = arrays["system_moduli"], np.zeros(size, dtype=np.bool_)
    require(np.all(moduli >= 0.0), "system_moduli holds a negative number")
    for name in ("system_couplings", "system_offset", "system_moduli"):
        _require_moderate(arrays, name)
    for k in range(header["chains"]):
        chain = f"chain{k}_"
        joints = arrays[chain + "joints"]
        require(
            len(joints) > 0 and len({*joints.tolist()}) == len(joints), f"{chain}joints names a joint twice, or none"
        )
        require(np.all((joints >= 0) & (joints < size)), f"{chain}joints names coordinates that are none")
        rotations, axes = arrays[chain + "rotations"], arrays[chain + "axes"]
        for name in ("rotations", "axes", "translations", "tip", "weights"):
            _require_moderate(arrays, chain + name)
        off = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max()
        require(off <= _UNIT and np.all(np.linalg.det(rotations) > 0.0), f"{chain}rotations are no rotations")
        require(np.all(np.abs(np.linalg.norm(axes, axis=1) - 1.0) <= _UNIT), f"{chain}axes are not of unit length")
        require(
            not np.any(arrays[chain + "weights"][moduli > 0.0]), f"{chain}weights enter a row known modulo something"
        )
        slides[joints[arrays[chain + "prismatic"]]] = True
    bound = slides | np.any(arrays["system_couplings"] != 0.0, axis=0)
    if "demand_lower" in arrays:
        limits = np.minimum(np.abs(arrays["demand_lower"]), np.abs(arrays["demand_upper"]))
        bound |= limits < np.finfo(np.float64).max
    require(
        not np.any(arrays["system_periodic"] & bound), "system_periodic: a slide, a coupled or a limited coordinate"
    )


def _require_moderate(arrays: Arrays, name: str) -> None:
    require(np.all(np.abs(arrays[name]) <= _LARGEST), f"{name} holds numbers beyond {_LARGEST:g}")


def check_chart(header: dict[str, Any], arrays: Arrays) -> None:
    """Joints and rods share the coordinates among them in their order, and names are those of the independent ones.

    Raises:
        ContradictionError: Not so.
    """
    size, places = arrays["system_couplings"].shape[1], [0, 0]
    owner: dict[int, tuple[str, bool]] = {}
    require(len({joint[0] for joint in header["joints"]}) == len(header["joints"]), "'joints': two have one name")
    for name, _, q_start, q_stop, v_start, v_stop in header["joints"]:
        numbers, rates = q_stop - q_start, v_stop - v_start
        fits = [q_start, v_start] == places and 1 <= rates <= 6 and numbers in (rates, rates + 1)
        require(fits, f"'joints': '{name:.40}' does not follow the joint before it")
        places = [q_stop, v_stop]
        owner |= {v_start + k: (name, rates == 1) for k in range(rates)}
    require(places == [header["nq"], header["n_free"]], "'nq' and 'n_free' are not what the joints have together")
    place = header["n_free"]
    for rod in header["rods"]:
        require(rod["place"][0] == place and rod["place"][1] - place in (1, 2), "'rods' do not follow one another")
        place = rod["place"][1]
        inside = all(step[1] < header["n_free"] for end in "ab" for step in rod[f"steps_{end}"])
        require(inside and rod["length"] > 0.0, "'rods' hold a length or coordinates that are none")
    for k, rod in enumerate(header["rods"]):
        steps = [len(rod[f"steps_{end}"]) == len(arrays[f"rod{k}_axes_{end}"]) for end in "ab"]
        require(all(steps), f"'rods': the steps are not those of rod{k}_axes")
    require(place <= size, "'n_free' and 'rods' are more coordinates than there are")
    independent = arrays["system_independent"].tolist()
    require(len(header["names"]) == len(independent), "'names' are not as many as independent coordinates")
    for name, index in zip(header["names"], independent, strict=True):
        joint, alone = owner.get(index, ("", False))
        said = name == joint if alone else name.startswith(f"{joint}:") if joint else index >= place
        require(said, f"'names': '{name:.40}' is not what the independent coordinate {index} is called")


def check_region(arrays: Arrays) -> None:
    """The region is a box, and so are ranges, and what closes on itself is a full turn of a periodic coordinate.

    Raises:
        ContradictionError: Not so.
    """
    lower, upper = arrays["lower"], arrays["upper"]
    for name in ("lower", "upper", "ranges_lower", "ranges_upper", "range_lower", "range_upper"):
        if name in arrays:
            _require_moderate(arrays, name)
    require(np.all(lower <= upper) and np.any(lower < upper), "lower and upper are no region")
    turns = arrays["system_periodic"][arrays["system_independent"]] & (upper == lower + _TURN)
    require(not np.any(arrays["wrapped"] & ~turns), "wrapped: a coordinate closes on itself that has no full turn")


def check_demands(arrays: Arrays) -> None:
    """Limits are intervals, motors drive coordinates, one each, and 1/κ is below 1.

    Raises:
        ContradictionError: Not so.
    """
    if "demand_driven" not in arrays:
        return
    driven = arrays["demand_driven"]
    require(np.all(arrays["demand_lower"] <= arrays["demand_upper"]), "demand_lower is above demand_upper")
    require(in_range(driven, arrays["system_couplings"].shape[1]), "demand_driven names coordinates that are none")
    require(len({*driven.tolist()}) == len(driven), "demand_driven names a coordinate twice")
    units = arrays["demand_units"]
    require(np.all((units > 0.0) & (units <= _LARGEST)), "demand_units are lengths, and positive")
    require(0.0 <= float(arrays["demand_dexterity"]) < 1.0, "demand_dexterity is no number from 0 to below 1")


def in_range(places: NDArray[Any], count: int) -> bool:
    """Whether all of some places are among so many."""
    return bool(np.all((places >= 0) & (places < count)))
