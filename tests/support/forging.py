"""Documents changed field by field, and what such a document says against what is true.

A change takes an array or a field of the header, or all arrays that list the same things, and does one of many things
to it. What is true is found without ccpin: closures are evaluated from the document's own chains by products of
rotations, and all closed configurations over a q by Newton's method from many starts.
"""

import copy
import json
from typing import Any, NamedTuple

import numpy as np

from ccpin.auditing import reading
from ccpin.auditing.declared import ATLAS, CURVES, SHEETS
from ccpin.containers import checksum
from ccpin.covering.cells import CellStatus
from ccpin.domain import Atlas, SheetAtlas, SingularCover
from ccpin.errors import CcpinError

GROUPS = ("box_", "glued_", "members_", "left_", "singular_", "tube_", "uncovered_", "curve_", "tree_")
# Newton's starts and steps; how far apart configurations are two, and how far from zero φ is none (rad, m).
STARTS, STEPS, SEEN, CLOSED = 24, 20, 1e-6, 1e-9


class Forgery(NamedTuple):
    """A document: its header and arrays."""

    header: dict[str, Any]
    arrays: dict[str, Any]

    @classmethod
    def of(cls, path):
        """That in an npz file."""
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        return cls(json.loads(arrays.pop("header").tobytes().decode()), arrays)

    def save(self, path):
        """Write it as npz, its fingerprint and checksum made right."""
        header = self.header | {"fingerprint": reading.fingerprint(self.arrays)}
        header["checksum"] = checksum(header, self.arrays)
        text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
        np.savez(path, header=text, **self.arrays)


def forged(rng, original, others, count):
    """A document with so many changes, and what they are."""
    made = copy.deepcopy(original)
    told = [_changed(rng, made, others) for _ in range(count)]
    return made, "; ".join(told)


def _changed(rng, made, others):
    """One change in place, told."""
    way = rng.random()
    if way < 0.15:
        return _header(rng, made, others)
    if way < 0.3:
        return _group(rng, made)
    name = str(rng.choice(sorted(made.arrays)))
    other = others[int(rng.integers(len(others)))].arrays.get(name)
    array = made.arrays[name]
    kinds = [kind for kind, (fits, _) in KINDS.items() if fits(array)]
    kind = str(rng.choice([*kinds, "another's"]))
    if kind == "another's":
        made.arrays[name] = array if other is None else other.copy()
    else:
        with np.errstate(all="ignore"):
            made.arrays[name] = KINDS[kind][1](rng, array.copy())
    return f"{name} {kind}"


def _at(rng, array, change):
    """A change of one entry, or one time in four of all."""
    rows = array.reshape(-1)
    at = slice(None) if rng.random() < 0.25 else int(rng.integers(rows.size))
    rows[at] = change(rows[at])
    return rows.reshape(array.shape)


def _rows(order):
    return lambda rng, array: array[order(rng, len(array))]


def _swapped(rng, count):
    order = np.arange(count)
    pair = rng.choice(count, 2, replace=count < 2)
    order[pair] = order[pair[::-1]]
    return order


def some(array):
    """Whether there is an entry."""
    return array.size > 0


def numbers(array):
    """Whether there are floating-point numbers."""
    return array.size > 0 and array.dtype.kind == "f"


def whole(array):
    """Whether there are integers."""
    return array.size > 0 and array.dtype.kind == "i"


def flags(array):
    """Whether there are truth values."""
    return array.size > 0 and array.dtype.kind == "b"


def listed(array):
    """Whether there are rows."""
    return array.ndim > 0 and len(array) > 0


KINDS = {
    "sign": (lambda a: some(a) and a.dtype.kind != "b", lambda r, a: _at(r, a, lambda x: -x)),
    "twice": (lambda a: some(a) and a.dtype.kind != "b", lambda r, a: _at(r, a, lambda x: x * 2)),
    "half": (numbers, lambda r, a: _at(r, a, lambda x: 0.5 * x)),
    "ulp up": (numbers, lambda r, a: _at(r, a, lambda x: np.nextafter(x, np.inf))),
    "ulp down": (numbers, lambda r, a: _at(r, a, lambda x: np.nextafter(x, -np.inf))),
    "1e-9 more": (numbers, lambda r, a: _at(r, a, lambda x: x + 1e-9)),
    "1e-3 more": (numbers, lambda r, a: _at(r, a, lambda x: x + 1e-3)),
    "1 % more": (numbers, lambda r, a: _at(r, a, lambda x: 1.01 * x)),
    "a turn more": (numbers, lambda r, a: _at(r, a, lambda x: x + 2.0 * np.pi)),
    "1e300": (numbers, lambda r, a: _at(r, a, lambda x: x * 0.0 + 1e300)),
    "1e18": (numbers, lambda r, a: _at(r, a, lambda x: x * 0.0 + 1e18)),
    "infinite": (numbers, lambda r, a: _at(r, a, lambda x: x * 0.0 + np.inf)),
    "no number": (numbers, lambda r, a: _at(r, a, lambda x: x * np.nan)),
    "zero": (some, lambda r, a: _at(r, a, lambda x: x & False if a.dtype.kind == "b" else x * 0)),
    "one more": (whole, lambda r, a: _at(r, a, lambda x: x + 1)),
    "one less": (whole, lambda r, a: _at(r, a, lambda x: x - 1)),
    "a status": (whole, lambda r, a: _at(r, a, lambda x: x * 0 + int(r.integers(7)))),
    "huge": (whole, lambda r, a: _at(r, a.astype(np.int64), lambda x: x * 0 + 2**40)),
    "flipped": (flags, lambda r, a: _at(r, a, lambda x: ~x)),
    "swapped rows": (listed, _rows(_swapped)),
    "a row dropped": (listed, _rows(lambda r, count: np.delete(np.arange(count), r.integers(count)))),
    "a row twice": (listed, _rows(lambda r, count: np.append(np.arange(count), r.integers(count)))),
    "a row for another": (
        listed,
        _rows(lambda r, count: np.where(np.arange(count) == r.integers(count), r.integers(count), np.arange(count))),
    ),
    "permuted": (listed, _rows(lambda r, count: r.permutation(count))),
    "rolled": (listed, _rows(lambda r, count: np.roll(np.arange(count), 1))),
    "emptied": (listed, lambda r, a: a[:0]),
    "of another dtype": (some, lambda r, a: a.astype(np.float32)),
    "flat": (lambda a: a.ndim > 1, lambda r, a: a.reshape(-1)),
}


def _group(rng, made):
    """The same rows of all arrays that list the same things."""
    groups = [g for g in GROUPS if any(name.startswith(g) for name in made.arrays)]
    group = str(rng.choice(groups))
    names = [name for name, array in made.arrays.items() if name.startswith(group) and array.ndim]
    names += ["count"] if group == "tree_" and "count" in made.arrays else []
    count = len(made.arrays[names[0]])
    if not count:
        return f"{group} as it was"
    kind = str(rng.choice(["swapped rows", "a row dropped", "a row twice", "a row for another", "permuted", "emptied"]))
    order = np.arange(0) if kind == "emptied" else KINDS[kind][1](rng, np.arange(count))
    for name in names:  # of which another change may have left fewer
        made.arrays[name] = made.arrays[name][order[order < len(made.arrays[name])]]
    sizes = made.arrays.get("curve_tubes")
    if group == "tube_" and sizes.dtype.kind == "i":
        if len(sizes):
            sizes[int(rng.integers(len(sizes)))] += len(order) - count
        if kind == "a row twice" and rng.random() < 0.5:
            made.arrays["curve_tubes"] = np.append(np.delete(sizes, 0) if len(sizes) > 1 else sizes - 1, [1])
            made.arrays["curve_closed"] = np.append(made.arrays["curve_closed"], False)
    return f"{group} {kind}"


def _header(rng, made, others):
    name = str(rng.choice(sorted(made.header)))
    value = made.header[name]
    other = others[int(rng.integers(len(others)))].header.get(name)
    choices = [None, -1, 0, 3.0, 1e18, True, False, "x", [], {}, other]
    if type(value) in (int, float):
        choices += [2 * value, 0.5 * value, value + 1, value * (1 + 1e-10)]
    if isinstance(value, list) and value:
        choices += [value[1:], value[::-1], [*value, value[0]]]
    made.header[name] = choices[int(rng.integers(len(choices)))]
    return f"header '{name}' {made.header[name]!r:.40}"


# What is true.


class Closures:
    """φ of a document, and its solutions over a q."""

    def __init__(self, made):
        a = made.arrays
        self.chains = [
            {n: a[f"chain{k}_{n}"] for n in reading.SerialChain._fields} for k in range(made.header["chains"])
        ]
        self.couplings, self.offset, self.moduli = (a[f"system_{n}"] for n in ("couplings", "offset", "moduli"))
        self.q, self.y, self.periodic = (a[f"system_{n}"] for n in ("independent", "dependent", "periodic"))

    def phi(self, theta):
        """φ of θ (K, n′), (K, m)."""
        found = theta @ self.couplings.T + self.offset
        rows = self.moduli > 0.0
        found[:, rows] -= self.moduli[rows] * np.round(found[:, rows] / self.moduli[rows])
        for chain in self.chains:
            x = np.broadcast_to(chain["tip"], (len(theta), 3))
            for k in reversed(range(len(chain["joints"]))):
                axis, value = chain["axes"][k], theta[:, [chain["joints"][k]]]
                if chain["prismatic"][k]:
                    x = x if chain["direction"] else x + value * axis
                else:
                    along, across = np.outer(x @ axis, axis), np.cross(np.broadcast_to(axis, x.shape), x)
                    x = along + np.cos(value) * (x - along) + np.sin(value) * across
                x = x @ chain["rotations"][k].T + (0.0 if chain["direction"] else chain["translations"][k])
            found = found + x @ chain["weights"].T
        return found

    def slope(self, theta):
        """φ_y by central differences, (K, m, m)."""
        steps = [np.zeros(theta.shape[1]) for _ in self.y]
        for step, j in zip(steps, self.y, strict=True):
            step[j] = 1e-6
        return np.stack([(self.phi(theta + s) - self.phi(theta - s)) / 2e-6 for s in steps], axis=2)

    def solutions(self, rng, q, near, reach):
        """All closed configurations over q (n,) that are found from many starts, y as given or within a reach of it."""
        theta = np.tile(near, (STARTS, 1))
        theta[:, self.q] = q
        theta[1:, self.y] += rng.uniform(-1.0, 1.0, (STARTS - 1, len(self.y))) * reach
        for _ in range(STEPS):
            try:
                step = np.linalg.solve(self.slope(theta), self.phi(theta)[..., None])[..., 0]
            except np.linalg.LinAlgError:
                step = 1e-3 * rng.normal(size=(len(theta), len(self.y)))
            size = np.abs(step).max(axis=1, keepdims=True)
            theta[:, self.y] -= step * np.minimum(1.0, 0.5 / np.maximum(size, 1e-300))
        theta = theta[np.abs(self.phi(theta)).max(axis=1) < CLOSED]
        found = []
        for t in theta:
            if not any(self.same(t, other) for other in found):
                found.append(t)
        return np.array(found).reshape(-1, theta.shape[1])

    def same(self, one, other):
        """Whether two are the same, angles modulo 2π."""
        gap = one - other
        gap = gap - np.where(self.periodic, 2.0 * np.pi * np.round(gap / (2.0 * np.pi)), 0.0)
        return np.abs(gap).max() < SEEN


def falsehood(rng, made, original, path, points=3):
    """What a document says that is not true, as far as random points show it; ``None``: nothing.

    What is asked is the object that is loaded. Where ccpin refuses to load it (its own bounds no longer prove a box or
    a tube, or a number that the auditor has no use for is none), boxes and tubes are looked at as they stand.
    """
    kind = {ATLAS: Atlas, SHEETS: SheetAtlas, CURVES: SingularCover}[made.header["format"]]
    try:
        found = kind.load(path)
    except CcpinError:
        return _of_tubes(rng, made, Closures(made)) if kind is SingularCover else _of_boxes(rng, made, Closures(made))
    if list(found.names) != original.header["names"] and made.header["joints"] == original.header["joints"]:
        return "names of other coordinates"
    closures = Closures(made)
    if kind is Atlas:
        return _of_atlas(rng, found, made, closures, points)
    if kind is SheetAtlas:
        return _of_sheets(rng, found, made, original, closures, points)
    return _of_cover(rng, found, made, original, closures, points)


def _of_boxes(rng, made, closures, count=6):
    """Whether over random places of random boxes one closed configuration is in the tube."""
    a = made.arrays
    for k in rng.integers(len(a["box_half"]), size=count):
        delta = rng.uniform(-1.0, 1.0, a["box_half"].shape[1]) * a["box_half"][k]
        start = a["box_centre"][k] + a["box_directions"][k] @ delta
        found = closures.solutions(rng, start[closures.q], start, np.abs(a["box_modes"][k]) @ a["box_radius"][k])
        gap = found - start
        gap = gap - np.where(closures.periodic, 2.0 * np.pi * np.round(gap / (2.0 * np.pi)), 0.0)
        zeta = np.linalg.solve(a["box_modes"][k], gap[:, closures.y].T).T
        if np.count_nonzero(np.all(np.abs(zeta) <= a["box_radius"][k], axis=1)) != 1:
            return "a box without one solution"
    return None


def _of_tubes(rng, made, closures, count=6):
    """Whether over random places of random tubes a singular closed configuration is in the tube."""
    a, size = made.arrays, len(closures.periodic)

    def values(x, pairing):
        phi, slope = closures.phi(x[None, :size])[0], closures.slope(x[None, :size])[0]
        return np.concatenate([phi, slope @ x[size:], [pairing @ x[size:] - 1.0]])

    for k in rng.integers(len(a["tube_half"]), size=count):
        place = rng.uniform(-1.0, 1.0) * a["tube_half"][k] * a["tube_tangent"][k]
        start = np.concatenate([a["tube_theta"][k], a["tube_kernel"][k]]) + place
        x, others = start.copy(), np.delete(np.arange(len(start)), a["tube_along"][k])
        for _ in range(8):
            steps = 1e-5 * np.eye(len(x))[others]
            slope = [(values(x + s, a["tube_pairing"][k]) - values(x - s, a["tube_pairing"][k])) / 2e-5 for s in steps]
            x[others] -= np.linalg.lstsq(np.array(slope).T, values(x, a["tube_pairing"][k]), rcond=None)[0]
        if np.abs(values(x, a["tube_pairing"][k])).max() > 1e-6:
            return "a tube without a singular configuration"
        if np.any(np.abs(x - start) > a["tube_radius"][k] + SEEN):
            return "a tube beside its curve"
    return None


def _of_atlas(rng, found, made, closures, points):
    reach = np.where(closures.periodic[closures.y], np.pi, 0.6)
    turn = 2.0 * np.pi * found.region.wrapped
    seed = found.seed
    if np.abs(closures.phi(seed[None])).max() > 1e-6:
        return "an open seed"
    sign = np.sign(np.linalg.det(closures.slope(seed[None])))[0]
    for q in rng.uniform(found.region.lower - 0.1, found.region.upper + 0.1, (points, len(found.names))):
        held = np.where(found.region.held, found.region.lower, q)
        inside = np.all((held >= found.region.lower) & (held <= found.region.upper) | (turn > 0.0))
        if found.contains(held):
            if not inside:
                return "certified beyond the region"
            theta = _theta(found, found.sigma(held), held)
            if np.abs(closures.phi(theta[None])).max() > CLOSED:
                return "σ is open"
            if np.sign(np.linalg.det(closures.slope(theta[None])))[0] != sign:
                return "σ on another branch"
        elif inside and found.status(held[None])[0] == CellStatus.EMPTY:
            closed = closures.solutions(rng, held, seed, reach)
            if len(closed):
                return "an empty cell that is not"
    width = found.radius * (1.0 - 1e-9) * np.where(found.region.held, 0.0, 1.0)
    square = found.q0 + rng.uniform(-1.0, 1.0, (points, len(found.names))) * width
    return None if np.all(found.contains(square)) else "a radius that is not certified"


def _theta(found, q_free, q):
    theta = np.zeros(found.problem.system.n_free)
    theta[: found.reading.chart.n_free] = found.reading.chart.theta(q_free)
    theta[found.problem.system.independent] = q
    return theta


def _of_sheets(rng, found, made, original, closures, points):
    low, high = made.arrays["ranges_lower"], made.arrays["ranges_upper"]
    slides = ~closures.periodic[closures.y]
    near, reach = np.zeros(len(closures.periodic)), np.where(slides, 0.5 * (high - low), np.pi)
    near[closures.y] = np.where(slides, 0.5 * (low + high), 0.0)
    for q in rng.uniform(found.region.lower, found.region.upper, (points, len(found.names))):
        said = found.number_of_solutions(q)
        if said < 0:
            continue
        theta = closures.solutions(rng, q, near, reach)
        y = theta[:, closures.y]
        theta = theta[np.all(~slides | ((y >= low - SEEN) & (y <= high + SEEN)), axis=1)]
        if len(theta) != said:
            return f"{said} configurations, not {len(theta)}"
        cell = found.tree.status[found.tree.locate(found.region.cell_coordinates(q[None]))[0]]
        if cell in (CellStatus.CERTIFIED, CellStatus.EMPTY):
            told = [_theta(found, c, q) for c in found.solutions(q)[0]]
            if len(told) != said or not all(any(closures.same(t, other) for other in theta) for t in told):
                return "solutions that are none"
    same = all(np.array_equal(made.arrays[n], original.arrays[n]) for n in ("lower", "upper", "tree_status"))
    if same and len(found.sheets) != _sheets(original):
        return "another number of sheets"
    return None


def _sheets(original):
    """How many sheets an original has, by its own gluing."""
    parent = list(range(len(original.arrays["box_centre"])))

    def root(k):
        while parent[k] != k:
            k = parent[k]
        return k

    for a, b in zip(original.arrays["glued_first"].tolist(), original.arrays["glued_second"].tolist(), strict=True):
        parent[root(a)] = root(b)
    return len({root(k) for k in range(len(parent))})


def _of_cover(rng, found, made, original, closures, points):
    sizes = original.arrays["curve_tubes"]
    tubes = original.arrays["tube_theta"]
    unmoved = reading.fingerprint(made.arrays) == reading.fingerprint(original.arrays)
    chosen, region = tubes[rng.integers(len(tubes), size=points)], found.region
    q = chosen[:, closures.q]
    inside = np.all((q >= region.lower) & (q <= region.upper), axis=1)
    known = found.reading.configuration(chosen[inside])
    if unmoved and len(known) and not np.all((found.curve_of(known) >= 0) | found.is_uncovered(known)):
        return "a singular configuration on no curve"
    if unmoved and len(found.curves) > len(sizes):
        return "more curves than there are"
    for q in rng.uniform(found.region.lower, found.region.upper, (points, len(found.names))):
        for theta in closures.solutions(rng, q, chosen[0], np.pi):
            regular = np.linalg.svd(closures.slope(theta[None]))[1][0, -1] > 0.02
            if regular and found.curve_of(found.reading.configuration(theta[None]))[0] >= 0:
                return "a regular configuration on a curve"
    return None
