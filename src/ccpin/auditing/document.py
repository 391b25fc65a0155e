"""A certificate's document as plain arrays: a JSON file, or an npz file with a JSON header."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ccpin.errors import InvalidInputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
ATLAS, SHEETS, CURVES = "ccpin-atlas-4", "ccpin-sheets-1", "ccpin-curves-1"
_UNITS = 2.0**32
_CERTIFIED, _EMPTY, _SINGULAR = 2, 4, 6
_SYSTEM = ("couplings", "offset", "moduli", "independent", "dependent", "periodic")
_BOXES = ("centre", "half", "directions", "modes", "radius")
_CHAIN = ("joints", "rotations", "translations", "axes", "prismatic", "tip", "direction", "weights")


class Chain(NamedTuple):
    """A serial chain: joint numbers, frames before each joint moves, axes, the tip, and how it enters φ (m, 3)."""

    joints: Integers
    rotations: Array
    translations: Array
    axes: Array
    prismatic: NDArray[np.bool_]
    tip: Array
    direction: bool
    weights: Array


class HasClosures(Protocol):
    """What closures are made of: φ(θ) = Σ B x(θ) + Gθ + d, rows of `moduli` modulo these."""

    @property
    def chains(self) -> tuple[Chain, ...]:
        """Those of the x."""

    @property
    def couplings(self) -> Array:
        """G."""

    @property
    def offset(self) -> Array:
        """The d of φ."""

    @property
    def moduli(self) -> Array:
        """What rows count modulo; 0: nothing."""


class Cells(NamedTuple):
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


class Counts(NamedTuple):
    """Cells over which a number of closed configurations is said, and the boxes that lie over cells.

    Attributes:
        cells: The cells.
        said: How many each has, (K,).
        certified: Whether each of them is said to be in a box, (K,).
        of, boxes: The numbers of cells and of boxes over them, side by side.
        range_lower, range_upper: Between what those counted have their dependent coordinates, (m,); a full turn of
            those that turn.
    """

    cells: Cells
    said: Integers
    certified: NDArray[np.bool_]
    of: Integers
    boxes: Integers
    range_lower: Array
    range_upper: Array


class Demands(NamedTuple):
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


class Document(NamedTuple):
    """What a certificate claims, and of which closures φ(θ) = Σ B x(θ) + Gθ + d (rows of `moduli` modulo these).

    Attributes:
        header: What the JSON says, the theorem's text and the fingerprint with it.
        chains, couplings, offset, moduli: x and B; G (m, n′); d (m,); (m,).
        independent, dependent, periodic: Indices of q and y in θ; whether θ_j counts modulo 2π.
        centre, half, directions, modes, radius: θ_c, h, D, V and R of Theorem K, by box.
        lower, upper, wrapped: The region, and which coordinates close on themselves.
        seed: θ on the branch, of an atlas; of sheets none.
        unglued: Pairs of boxes of which no gluing is claimed, of an atlas.
        faces: Where gluing is claimed, of sheets; of an atlas everywhere else.
        empty: Cells said to hold no closed configuration.
        singular: Cells said to hold the q of a singular one.
        witnesses: θ of one over each of these, to rounding, (K, n′).
        counts: How many closed configurations there are, of sheets.
        demands: What is asked of boxes besides, of a workspace.
    """

    header: dict[str, Any]
    chains: tuple[Chain, ...]
    couplings: Array
    offset: Array
    moduli: Array
    independent: Integers
    dependent: Integers
    periodic: NDArray[np.bool_]
    centre: Array
    half: Array
    directions: Array
    modes: Array
    radius: Array
    lower: Array
    upper: Array
    wrapped: NDArray[np.bool_]
    seed: Array | None
    unglued: Integers
    faces: Faces | None
    empty: Cells
    singular: Cells
    witnesses: Array
    counts: Counts | None = None
    demands: Demands | None = None


class Tube(NamedTuple):
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


class Curves(NamedTuple):
    """What a certificate claims of all singular curves over a region, and of which closures (as `Document`).

    Attributes:
        header, chains, couplings, offset, moduli, independent, dependent, periodic: As for a `Document`.
        lower, upper: The region.
        range_lower, range_upper: What is claimed of the dependent coordinates that do not turn, (m,).
        tubes: All tubes.
        sizes, closed: How many of them each curve has, in their order, and whether it closes on itself.
        uncovered_lower, uncovered_upper: Boxes of θ in which nothing is claimed, angles modulo 2π, (K, n′).
    """

    header: dict[str, Any]
    chains: tuple[Chain, ...]
    couplings: Array
    offset: Array
    moduli: Array
    independent: Integers
    dependent: Integers
    periodic: NDArray[np.bool_]
    lower: Array
    upper: Array
    range_lower: Array
    range_upper: Array
    tubes: tuple[Tube, ...]
    sizes: Integers
    closed: NDArray[np.bool_]
    uncovered_lower: Array
    uncovered_upper: Array

    def free(self, joint: int) -> bool:
        """Whether a coordinate is an angle that φ knows modulo 2π: one that only turns chains, in no coupling."""
        slides = any(np.any(chain.prismatic[chain.joints == joint]) for chain in self.chains)
        return bool(self.periodic[joint]) and not slides and not np.any(self.couplings[:, joint])


def read(path: str | Path) -> Document | Curves:
    """The document in a file.

    Raises:
        InvalidInputError: It cannot be read, is of another kind, or its fingerprint is not that of its closures.
    """
    header, arrays = _contents(Path(path))
    if header.get("format") not in (ATLAS, SHEETS, CURVES):
        raise InvalidInputError(
            f"{path}: the format is {header.get('format')!r}, not {ATLAS!r}, {SHEETS!r} or {CURVES!r}"
        )
    try:
        chains = []
        for k in range(header["chains"]):
            fields = {name: arrays[f"chain{k}_{name}"] for name in _CHAIN}
            fields["direction"] = bool(fields["direction"])
            chains.append(Chain(**fields))
        own = {name: arrays[f"system_{name}"] for name in _SYSTEM}
        rest = {name: arrays[name] for name in ("lower", "upper")}
        if header["format"] == CURVES:
            document: Document | Curves = Curves(
                header=header, chains=tuple(chains), **own, **rest, **_of_curves(arrays)
            )
        else:
            rest |= {"wrapped": arrays["wrapped"]} | {name: arrays[f"box_{name}"] for name in _BOXES}
            rest |= _claimed(arrays) | (_of_sheets(arrays) if header["format"] == SHEETS else _of_atlas(arrays))
            document = Document(header=header, chains=tuple(chains), **own, **rest)
        stated = header["fingerprint"]
    except KeyError as error:
        raise InvalidInputError(f"{path}: the document lacks {error}") from error
    if fingerprint(arrays) != stated:
        raise InvalidInputError(f"{path}: the closures are not those of which the document's fingerprint was taken")
    return document


def _of_atlas(arrays: dict[str, Any]) -> dict[str, Any]:
    return {"seed": arrays["seed"], "unglued": arrays["unglued"], "faces": None, "demands": _demands(arrays)}


def _demands(arrays: dict[str, Any]) -> Demands | None:
    if not any(name.startswith("demand_") for name in arrays):
        return None
    said = {name: arrays[f"demand_{name}"] for name in Demands._fields}
    _among(said["driven"], len(said["lower"]), "demand_driven")
    return Demands(**said | {"dexterity": float(said["dexterity"])})


def _among(places: Integers, count: int, name: str) -> None:
    """Refuse places that are none of so many."""
    if np.any((places < 0) | (places >= count)):
        raise InvalidInputError(f"{name} names places outside of the {count} there are")


def _of_sheets(arrays: dict[str, Any]) -> dict[str, Any]:
    faces = Faces(*(arrays[f"glued_{name}"] for name in Faces._fields))
    return {"seed": None, "unglued": np.zeros((0, 2), dtype=np.int64), "faces": faces, "counts": _counts(arrays)}


def _counts(arrays: dict[str, Any]) -> Counts:
    """What is said of how many there are; of cells called empty only where that is not 0."""
    status, said = arrays["tree_status"], arrays["count"]
    certified, empty = status == _CERTIFIED, status == _EMPTY
    _among(arrays["members_box"], len(arrays["box_centre"]), "members_box")
    cells = np.flatnonzero((arrays["tree_child"] < 0) & np.where(empty, said > 0, certified | (said >= 0)))
    ranges = arrays["ranges_lower"], arrays["ranges_upper"]
    members = arrays["members_cell"], arrays["members_box"]
    return Counts(_cells(arrays, cells), said[cells], certified[cells], *members, *ranges)


def _of_curves(arrays: dict[str, Any]) -> dict[str, Any]:
    given = {name: arrays[f"tube_{name}"] for name in Tube._fields}
    rest = {name: arrays[name] for name in ("range_lower", "range_upper", "uncovered_lower", "uncovered_upper")}
    m, size = arrays["system_couplings"].shape
    widths = {"theta": size, "kernel": m, "pairing": m, "tangent": size + m, "radius": size + m}
    count, sizes, closed = len(given["half"]), arrays["curve_tubes"], arrays["curve_closed"]
    shaped = all(given[name].shape == (count, width) for name, width in widths.items())
    shaped &= given["half"].shape == given["along"].shape == (count,) and sizes.shape == closed.shape == (len(sizes),)
    n = len(arrays["system_independent"])
    shaped &= all(rest[f"range_{end}"].shape == (m,) and arrays[end].shape == (n,) for end in ("lower", "upper"))
    shaped &= rest["uncovered_lower"].shape == rest["uncovered_upper"].shape == (len(rest["uncovered_lower"]), size)
    shaped &= all(np.all(np.isfinite(array)) for array in (*given.values(), *rest.values()))
    if not shaped or int(sizes.sum()) != count or np.any(sizes < 1):
        raise InvalidInputError(
            "the tubes or boxes of the document are not as many, or not of the shapes, that it says"
        )
    rows = zip(*given.values(), strict=True)
    tubes = tuple(Tube(a, b, c, int(j), t, float(half), r) for a, b, c, j, t, half, r in rows)
    return rest | {"tubes": tubes, "sizes": sizes, "closed": closed}


def _claimed(arrays: dict[str, Any]) -> dict[str, Any]:
    """What is said of cells."""
    leaf = arrays["tree_child"] < 0
    singular, seen = arrays["singular_cell"], arrays["tree_status"]
    missing = np.setdiff1d(np.flatnonzero(leaf & (seen == _SINGULAR)), singular)
    if missing.size:
        raise InvalidInputError(f"cell {missing[0]} is called singular without a singular configuration")
    empty = np.flatnonzero(leaf & (seen == _EMPTY))
    cells = {"empty": _cells(arrays, empty), "singular": _cells(arrays, singular)}
    return cells | {"witnesses": arrays["singular_theta"]}


def _cells(arrays: dict[str, Any], numbers: Integers) -> Cells:
    lower, size = arrays["tree_lower"][numbers] / _UNITS, arrays["tree_size"][numbers] / _UNITS
    return Cells(numbers, lower, lower + size)


def corners(document: Document, cells: Cells, k: int) -> tuple[Array, Array]:
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


def _contents(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        if path.suffix == ".json":
            header = json.loads(path.read_text(encoding="utf-8"))
            listed = header.pop("arrays")
            arrays = {name: np.array(a["data"], dtype=a["dtype"]).reshape(a["shape"]) for name, a in listed.items()}
            return header, arrays
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return json.loads(arrays.pop("header").tobytes().decode()), arrays
    except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidInputError(f"{path}: not a readable certificate ({error})") from error
