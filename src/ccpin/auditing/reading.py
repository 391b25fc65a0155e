"""A certificate's document: what `container` reads and `declared` knows, and what `structure` and `cells` let pass."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.auditing.container import Arrays, contents
from ccpin.auditing.declared import CURVES, SHEETS, refuse_others
from ccpin.auditing.structure import (
    ContradictionError,
    check_chart,
    check_closures,
    check_demands,
    check_region,
    in_range,
    require,
)
from ccpin.auditing.tiling import (
    CERTIFIED,
    EMPTY,
    SINGULAR,
    WHOLE,
    Over,
    check_atlas,
    check_boxes,
    check_sheets,
    check_tree,
)
from ccpin.errors import InvalidInputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
WIDEN = (1e-14, 2.0**-51)  # what Theorem N adds to h, so that boxes of rounded corners overlap: least, of |c| + h
_SYSTEM = ("couplings", "offset", "moduli", "independent", "dependent", "periodic")
_BOXES = ("centre", "half", "directions", "modes", "radius")
_CHAIN = ("joints", "rotations", "translations", "axes", "prismatic", "tip", "direction", "weights")


class SerialChain(NamedTuple):
    """A serial chain: joint numbers, frames before each joint moves, axes, the tip, and how it enters φ (m, 3)."""

    joints: Integers
    rotations: Array
    translations: Array
    axes: Array
    prismatic: NDArray[np.bool_]
    tip: Array
    direction: bool
    weights: Array


@dataclass(frozen=True, eq=False)
class StatedClosures:
    """Of which closures φ(θ) = Σ B x(θ) + Gθ + d (rows of `moduli` modulo these) a document is, and over which region.

    Attributes:
        header: What the JSON says, the theorem's text and the fingerprint with it.
        chains, couplings, offset, moduli: x and B; G (m, n′); d (m,); (m,), 0: modulo nothing.
        independent, dependent, periodic: Indices of q and y in θ; whether θ_j counts modulo 2π.
        lower, upper: The region.
    """

    header: dict[str, Any]
    chains: tuple[SerialChain, ...]
    couplings: Array
    offset: Array
    moduli: Array
    independent: Integers
    dependent: Integers
    periodic: NDArray[np.bool_]
    lower: Array
    upper: Array


class ClaimedCells(NamedTuple):
    """Cells of the region of which something is claimed: their numbers (K,), and corners as shares of it, (K, n)."""

    number: Integers
    lower: Array
    upper: Array


class Faces(NamedTuple):
    """Faces at which two boxes are said to carry the same σ: the boxes (K,), the middle as each has it (K, n)."""

    first: Integers
    second: Integers
    at_first: Array
    at_second: Array


class StatedRanges(NamedTuple):
    """What is searched of the dependent coordinates, as stated.

    Attributes:
        lower, upper: Ranges, (m,).
        reasons: Why each of their ends is one, (m, 2): 0 a whole turn, 1 a limit, 2 a coupling, 3 lengths.
        limits: Within which configurations are meant, the largest number where there is none, (m, 2).
    """

    lower: Array
    upper: Array
    reasons: Integers
    limits: Array


class Counts(NamedTuple):
    """Cells over which a number of closed configurations is said, and the boxes that lie over cells.

    Attributes:
        cells: The cells.
        said: How many each has, (K,).
        certified: Whether each of them is said to be in a box, (K,).
        of, boxes: The numbers of cells and of boxes over them, side by side.
    """

    cells: ClaimedCells
    said: Integers
    certified: NDArray[np.bool_]
    of: Integers
    boxes: Integers


class ClaimedRequirements(NamedTuple):
    """What boxes of a workspace are said to keep.

    Attributes:
        lower, upper: Limits of θ, (n′,), the largest number where there is none.
        driven: Indices in θ of what motors drive; none: nothing is said of motors and dexterity.
        units: What a unit of each parameter counts as where dexterity is measured, (n,).
        dexterity: The least 1/κ.
    """

    lower: Array
    upper: Array
    driven: Integers
    units: Array
    dexterity: float


@dataclass(frozen=True, eq=False)
class ClaimedDocument(StatedClosures):
    """What a certificate claims of boxes and cells.

    Attributes:
        centre, half, directions, modes, radius: θ_c, h, D, V and R of Theorem N, by box.
        wrapped: Which coordinates of the region close on themselves.
        seed: θ on the branch, of an atlas; of sheets none.
        unglued: Pairs of boxes of which no gluing is claimed, of an atlas.
        faces: Where gluing is claimed, of sheets; of an atlas everywhere else.
        over: Which box lies over which cell.
        place, size: The cells under boxes, by box, in units of 2⁻³² of the region: lower corners and edges, (B, n).
        empty: Cells said to hold no closed configuration.
        singular: Cells said to hold the q of a singular one.
        witnesses: θ of one over each of these, to rounding, (K, n′).
        shares: What share of the region is certified, empty and singular, and of sheets counted.
        counts: How many closed configurations there are, of sheets.
        ranges: What of the dependent coordinates is claimed to be all there is, of sheets.
        demands: What is asked of boxes besides, of a workspace.
    """

    centre: Array
    half: Array
    directions: Array
    modes: Array
    radius: Array
    wrapped: NDArray[np.bool_]
    seed: Array | None
    unglued: Integers
    faces: Faces | None
    over: Over
    place: Integers
    size: Integers
    empty: ClaimedCells
    singular: ClaimedCells
    witnesses: Array
    shares: dict[str, float]
    counts: Counts | None = None
    ranges: StatedRanges | None = None
    demands: ClaimedRequirements | None = None


class CurveTube(NamedTuple):
    """A tube x = x₀ + st + e of x = (θ, w), |s| ≤ δ, |e| ≤ R, e_j = 0, and l, the pairing of w: lᵀw = 1.

    Attributes:
        theta, kernel, pairing: x₀ in two parts, (n′,) and (m,); l, (m,).
        along: j.
        tangent, half, radius: t (N,), δ, R (N,).
    """

    theta: Array
    kernel: Array
    pairing: Array
    along: int
    tangent: Array
    half: float
    radius: Array


@dataclass(frozen=True, eq=False)
class Curves(StatedClosures):
    """What a certificate claims of all singular curves over a region.

    Attributes:
        ranges: What of the dependent coordinates is claimed to be all there is.
        tubes: All tubes.
        sizes, closed: How many of them each curve has, in their order, and whether it closes on itself.
        uncovered_lower, uncovered_upper: Boxes of θ in which nothing is claimed, angles modulo 2π, (K, n′).
    """

    ranges: StatedRanges
    tubes: tuple[CurveTube, ...]
    sizes: Integers
    closed: NDArray[np.bool_]
    uncovered_lower: Array
    uncovered_upper: Array


def free_angles(document: ClaimedDocument | Curves) -> list[bool]:
    """Which coordinates are angles that φ knows modulo 2π: those that only turn chains, in no coupling."""
    slides = {int(j) for chain in document.chains for j in chain.joints[chain.prismatic]}
    bound = np.any(document.couplings != 0.0, axis=0)
    return [bool(document.periodic[j]) and j not in slides and not bound[j] for j in range(len(bound))]


def read(path: str | Path) -> ClaimedDocument | Curves:
    """The document in a file.

    Raises:
        InvalidInputError: It cannot be read, is of another kind or format, contradicts itself, or its fingerprint is
            not that of its closures; the file and the field are named.
    """
    header, arrays = contents(Path(path))
    refuse_others(header, arrays, path)
    if fingerprint(arrays) != header["fingerprint"]:
        raise InvalidInputError(f"{path}: the closures are not those of which the document's fingerprint was taken")
    try:
        check_closures(header, arrays)
        check_chart(header, arrays)
        check_region(arrays)
        check_demands(arrays)
        return _curves(header, arrays) if header["format"] == CURVES else _of_cells(header, arrays)
    except ContradictionError as fault:
        raise InvalidInputError(f"{path}: {fault}") from fault


def _closures(header: dict[str, Any], arrays: Arrays) -> dict[str, Any]:
    """What every kind holds."""
    chains = []
    for k in range(header["chains"]):
        fields: dict[str, Any] = {name: arrays[f"chain{k}_{name}"] for name in _CHAIN}
        chains.append(SerialChain(**fields | {"direction": bool(fields["direction"])}))
    own = {name: arrays[f"system_{name}"] for name in _SYSTEM}
    return {"header": header, "chains": tuple(chains), "lower": arrays["lower"], "upper": arrays["upper"], **own}


def _of_cells(header: dict[str, Any], arrays: Arrays) -> ClaimedDocument:
    """An atlas or sheets."""
    check_tree(arrays)
    sheets = header["format"] == SHEETS
    over = check_sheets(arrays) if sheets else check_atlas(header, arrays)
    check_boxes(arrays, over, widened(arrays["box_centre"][:, arrays["system_independent"]], arrays["box_half"]))
    cell = over.cell[np.argsort(over.box)]
    rest: dict[str, Any] = {name: arrays[f"box_{name}"] for name in _BOXES}
    rest |= {"place": arrays["tree_lower"][cell], "size": arrays["tree_size"][cell], "over": over}
    rest |= _claimed(arrays) | (_of_sheets(arrays) if sheets else _of_atlas(arrays))
    return ClaimedDocument(**_closures(header, arrays), **rest, wrapped=arrays["wrapped"])


def widened(centre: Array, half: Array) -> Array:
    """The h of which Theorem N is claimed, 1e-14 + 4u(|c| + h) more than the h that is stated beside q_c."""
    return np.asarray(half + (WIDEN[0] + WIDEN[1] * (np.abs(centre) + half)))


def _of_atlas(arrays: Arrays) -> dict[str, Any]:
    return {"seed": arrays["seed"], "unglued": arrays["unglued"], "faces": None, "demands": _demands(arrays)}


def _demands(arrays: Arrays) -> ClaimedRequirements | None:
    if "demand_driven" not in arrays:
        return None
    said: dict[str, Any] = {name: arrays[f"demand_{name}"] for name in ClaimedRequirements._fields}
    return ClaimedRequirements(**said | {"dexterity": float(said["dexterity"])})


def _of_sheets(arrays: Arrays) -> dict[str, Any]:
    faces = Faces(*(arrays[f"glued_{name}"] for name in Faces._fields))
    return {"seed": None, "unglued": np.zeros((0, 2), dtype=np.int64), "faces": faces, "counts": _counts(arrays)} | {
        "ranges": _stated(arrays, "ranges")
    }


def _counts(arrays: Arrays) -> Counts:
    """What is said of how many there are, of cells that are not called empty."""
    status, said = arrays["tree_status"], arrays["count"]
    cells = np.flatnonzero((arrays["tree_child"] < 0) & (status != EMPTY) & (said >= 0))
    members = arrays["members_cell"], arrays["members_box"]
    return Counts(_cells(arrays, cells), said[cells], status[cells] == CERTIFIED, *members)


def _stated(arrays: Arrays, part: str) -> StatedRanges:
    """The ranges stated.

    Raises:
        ContradictionError: A lower end is above the upper one.
    """
    found = StatedRanges(*(arrays[f"{part}_{name}"] for name in StatedRanges._fields))
    for name, ends in (("", (found.lower, found.upper)), ("_limits", found.limits.T)):
        require(np.all(ends[0] <= ends[1]), f"{part}{name}: a lower end is above the upper one")
    return found


def _curves(header: dict[str, Any], arrays: Arrays) -> Curves:
    """Singular curves.

    Raises:
        ContradictionError: The tubes or boxes are not as many, or not of the sizes, that it says.
    """
    given = {name: arrays[f"tube_{name}"] for name in CurveTube._fields}
    rest: dict[str, Any] = {name: arrays[name] for name in ("uncovered_lower", "uncovered_upper")}
    sizes, closed = arrays["curve_tubes"], arrays["curve_closed"]
    require(
        np.all(sizes >= 1) and int(sizes.sum()) == len(given["half"]), "curve_tubes: not as many tubes as there are"
    )
    require(in_range(given["along"], given["tangent"].shape[1]), "tube_along names coordinates that are none")
    require(np.all(given["half"] > 0.0) and np.all(given["radius"] >= 0.0), "tube_half, tube_radius: no sizes")
    require(np.all(rest["uncovered_lower"] <= rest["uncovered_upper"]), "uncovered_lower is above uncovered_upper")
    rest["ranges"] = _stated(arrays, "range")
    rows = zip(*given.values(), strict=True)
    tubes = tuple(CurveTube(a, b, c, int(j), t, float(half), r) for a, b, c, j, t, half, r in rows)
    return Curves(**_closures(header, arrays), **rest, tubes=tubes, sizes=sizes, closed=closed)


def _claimed(arrays: Arrays) -> dict[str, Any]:
    """What is said of cells."""
    empty = np.flatnonzero((arrays["tree_child"] < 0) & (arrays["tree_status"] == EMPTY))
    cells = {"empty": _cells(arrays, empty), "singular": _cells(arrays, arrays["singular_cell"])}
    return cells | {"witnesses": arrays["singular_theta"], "shares": _shares(arrays)}


def _shares(arrays: Arrays) -> dict[str, float]:
    """Shares of the region, of leaves by what is said of them."""
    leaf, status = arrays["tree_child"] < 0, arrays["tree_status"]
    share = np.where(leaf, np.prod(arrays["tree_size"] / WHOLE, axis=1), 0.0)
    told = {"certified": status == CERTIFIED, "empty": status == EMPTY, "singular": status == SINGULAR}
    told |= {"counted": arrays["count"] >= 0} if "count" in arrays else {}
    return {name: float(share[rows].sum()) for name, rows in told.items()}


def _cells(arrays: Arrays, numbers: Integers) -> ClaimedCells:
    lower, size = arrays["tree_lower"][numbers] / WHOLE, arrays["tree_size"][numbers] / WHOLE
    return ClaimedCells(numbers, lower, lower + size)


def corners(document: ClaimedDocument, cells: ClaimedCells, k: int) -> tuple[Array, Array]:
    """A cell's corners in q-space, outward by some roundings where it has a width."""
    width = document.upper - document.lower
    low, high = document.lower + width * cells.lower[k], document.lower + width * cells.upper[k]
    room = np.where(width > 0.0, 1e-15 * (1.0 + np.abs(document.lower) + np.abs(document.upper)), 0.0)
    return low - room, high + room


def fingerprint(arrays: dict[str, Any]) -> str:
    """SHA-256 of the closures: every array whose name begins with ``chain`` or ``system``, in the order of names."""
    digest = hashlib.sha256()
    for name in sorted(name for name in arrays if name.startswith(("chain", "system"))):
        array = np.asarray(arrays[name], dtype=np.float64)
        digest.update(f"{name}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
