"""Small arrays: the aliases for them, what every room does with them, and records that cannot be written to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from numbers import Real
from operator import index
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.errors import InvalidInputError

Array = NDArray[np.float64]
Placement = Array
"""A 4×4 frame; the records of a description take it in other spellings too."""
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Columns = TypeVar("Columns", bound=tuple[Any, ...])  # a named tuple of arrays with a common leading axis
K = TypeVar("K")
T = TypeVar("T")
P = ParamSpec("P")
V_co = TypeVar("V_co", covariant=True)


def frozen(value: object) -> Array:
    """A float64 copy of an array-like that can never be made writable (the array itself if it is such a copy)."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and isinstance(value.base, bytes):
        return value
    array = np.asarray(value, dtype=np.float64)
    return np.ndarray(array.shape, np.float64, buffer=array.tobytes())


class FrozenMapping(Mapping[K, V_co]):
    """A mapping that cannot be written to: ordered as given, equal to any mapping of the same items, picklable."""

    __slots__ = ("_items",)
    _items: dict[K, V_co]

    def __init__(self, items: Mapping[K, V_co] | Iterable[tuple[K, V_co]] = ()) -> None:
        object.__setattr__(self, "_items", dict(items))

    def __getitem__(self, key: K) -> V_co:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __hash__(self) -> int:
        return hash(frozenset(self._items))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a FrozenMapping cannot be written to: '{name}'")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a FrozenMapping cannot be written to: '{name}'")

    def __reduce__(self) -> tuple[type, tuple[dict[K, V_co]]]:
        return FrozenMapping, (self._items,)

    def __repr__(self) -> str:
        return f"FrozenMapping({self._items!r})"


_CONTAINERS = (list, tuple, np.ndarray, Mapping)


class Record:
    """The base of frozen dataclasses that hold nothing that can be written to, also after a pickle.

    A field annotated ``Array`` (or ``Placement``) becomes a read-only copy of what is given; in any other field lists
    become tuples (of what they hold, frozen likewise), arrays tuples of numbers, and mappings `FrozenMapping`s.

    Raises:
        InvalidInputError: Something else than numbers where an array belongs.
    """

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            is_array = field.type in ("Array", "Placement")
            if not is_array and not isinstance(value, _CONTAINERS):
                continue
            try:
                value = frozen(value) if is_array else _immutable(value)
            except (TypeError, ValueError):
                owner = f"{type(self).__name__}.{field.name}"
                raise InvalidInputError(f"{owner} must be an array of numbers, not {value!r:.80}") from None
            object.__setattr__(self, field.name, value)

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]


def _immutable(value: Any) -> Any:
    """A tuple for a list or an array, a `FrozenMapping` for a mapping; everything else as it is."""
    if isinstance(value, np.ndarray):
        return _immutable(value.tolist())
    if type(value) in (list, tuple):
        return tuple([_immutable(item) if isinstance(item, _CONTAINERS) else item for item in value])
    if isinstance(value, Mapping) and not isinstance(value, FrozenMapping):
        return FrozenMapping((key, _immutable(item)) for key, item in value.items())
    return value


_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
_FEW = 1500  # entries: of arrays of that size both ways to form a cross product take about as long


def rows_of(record: Columns, rows: Indices | Mask | slice) -> Columns:
    """The chosen rows of every array of a named tuple (and of the named tuples in it)."""
    if isinstance(rows, slice):
        return type(record)(*(rows_of(part, rows) if isinstance(part, tuple) else part[rows] for part in record))
    index = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
    return type(record)(*(rows_of(part, index) if isinstance(part, tuple) else part.take(index, 0) for part in record))


def joined(records: Iterable[Columns]) -> Columns:
    """Named tuples of arrays (and of named tuples of them) one below the other."""
    first, *others = records
    columns = zip(first, *others, strict=True)
    return type(first)(*(joined(parts) if isinstance(parts[0], tuple) else np.concatenate(parts) for parts in columns))


def apply(matrices: Array, vectors: Array) -> Array:
    """Matrices (…, m, n) times vectors (…, n), of shape (…, m)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def cross(a: Array, b: Array) -> Array:
    """a × b over the last axis of arrays (…, 3), with broadcasting."""
    if a.size < _FEW and b.size < _FEW:  # four calls where the views below take fifteen
        return np.asarray(a.take(_YZX, -1) * b.take(_ZXY, -1) - a.take(_ZXY, -1) * b.take(_YZX, -1))
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    product[..., 0], product[..., 1], product[..., 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return product


def skew(vectors: Array) -> Array:
    """The matrices [v]× of vectors (…, 3), of shape (…, 3, 3): [v]× x = v × x."""
    matrix = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def inverses(matrices: Array) -> Array:
    """Inverses of a batch; where there is none, NaN."""
    result = np.full_like(matrices, np.nan)
    usable = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    try:
        result[usable] = np.linalg.inv(matrices[usable])
    except np.linalg.LinAlgError:
        for k in np.flatnonzero(usable):
            with suppress(np.linalg.LinAlgError):
                result[k] = np.linalg.inv(matrices[k])
    return result


def solve_many(matrices: Array, right: Array) -> Array:
    """Solve a batch of m×m systems; NaN where singular."""
    if matrices.shape[1] == 2:
        a, b, c, d = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
        det = a * d - b * c
        x, y = right[:, 0], right[:, 1]
        return np.stack([(d * x - b * y) / det, (a * y - c * x) / det], axis=1)
    try:
        return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return apply(inverses(matrices), right)


def vector(value: ArrayLike, name: str, size: int) -> Array:
    """Return a finite float64 vector of the given size (not a copy where it is one already).

    Raises:
        InvalidInputError: It is not that.
    """
    return _checked(value, name, (size,))


def matrix(value: ArrayLike, name: str, shape: tuple[int, int]) -> Array:
    """Return a finite float64 matrix of the given shape (not a copy where it is one already).

    Raises:
        InvalidInputError: It is not that.
    """
    return _checked(value, name, shape)


def one_each(value: ArrayLike, name: str, count: int, *, positive: bool = False) -> Array:
    """Return numbers of at least zero (positive ones), one for each or one for all, as a copy of shape (count,).

    Raises:
        InvalidInputError: They are not that.
    """
    array = numbers(value, name)
    fit = np.isfinite(array) & (array > 0.0 if positive else array >= 0.0)
    if array.shape not in ((), (count,)) or not fit.all():
        what = "positive number" if positive else "number, 0 or more,"
        raise InvalidInputError(f"{name} must be a {what} or {count} of them; it is {value!r:.80}")
    return np.array(np.broadcast_to(array, (count,)))


def corners(value: object, name: str, size: int) -> tuple[Array, Array]:
    """Return the lower and the upper numbers of a box, of the given size each.

    Raises:
        InvalidInputError: They are not that, or a lower one is not below the upper one.
    """
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or len(value) != 2:
        raise InvalidInputError(f"{name} must be lower and upper numbers")
    lower, upper = (vector(end, f"{name}[{k}]", size) for k, end in enumerate(value))
    if not np.all(lower < upper):
        raise InvalidInputError(f"{name}: every lower number must be below the upper one")
    return lower, upper


def matrix_rows(value: ArrayLike, name: str, columns: int) -> Array:
    """Return finite float64 vectors of the given size, one a row, of shape (N, columns).

    Raises:
        InvalidInputError: They are not that.
    """
    return _checked(value, name, (None, columns))


def numbers(value: object, name: str) -> Array:
    """Return a float64 array of any shape, whatever numbers are in it (not a copy where it is one already).

    Raises:
        InvalidInputError: It holds something else than real numbers.
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind in "cSUmM":  # NumPy would drop what is imaginary, and read texts and dates
            raise TypeError
        return found.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInputError(f"{name} is not an array of numbers") from None


def number(value: object, name: str, what: str = "a finite number", above: float = -np.inf) -> float:
    """Return a finite number above a bound.

    Raises:
        InvalidInputError: It is not that; `what` says what it must be.
    """
    if isinstance(value, np.ndarray) and not value.ndim:
        value = value.item()
    try:
        if isinstance(value, Real) and not isinstance(value, bool) and np.isfinite(float(value)):
            found = float(value)
            if found > above:
                return found
    except OverflowError:  # an integer beyond all doubles
        pass
    raise InvalidInputError(f"{name} = {value!r:.80} must be {what}")


def positive(value: object, name: str, what: str = "a positive number") -> float:
    """Return a positive, finite number; errors as for `number`."""
    return number(value, name, what, 0.0)


def step_or_infinite(value: object, name: str) -> float:
    """Return a positive number, ∞ allowed; errors as for `number`."""
    return np.inf if isinstance(value, float) and value == np.inf else positive(value, name)


def whole(value: object, name: str, least: int = 1) -> int:
    """Return a whole number, at least `least`.

    Raises:
        InvalidInputError: It is not that.
    """
    try:
        found = least - 1 if isinstance(value, bool) else index(value)  # type: ignore[arg-type]
    except TypeError:
        found = least - 1
    if not least <= found < 2**63:
        raise InvalidInputError(f"{name} = {value!r:.80} must be a whole number, {least} or more")
    return found


def choice(value: object, name: str, known: Sequence[str]) -> str:
    """Return one of the words known.

    Raises:
        InvalidInputError: It is none of them.
    """
    if not isinstance(value, str) or value not in known:
        raise InvalidInputError(f"{name} {value!r:.80} is not one of {', '.join(known)}")
    return value


def instance(value: object, name: str, kind: type[T], what: str | None = None) -> T:
    """Return a thing of one class; `what` says where one is got, beside its class's name.

    Raises:
        InvalidInputError: It is something else.
    """
    if not isinstance(value, kind):
        raise InvalidInputError(f"{name} must be {what or f'a {kind.__name__}'}, not {type(value).__name__}")
    return value


def records(value: object, name: str, kind: type[T]) -> tuple[T, ...]:
    """Return things of one class as a tuple.

    Raises:
        InvalidInputError: They are no sequence, or one is something else: it is told by its place.
    """
    given = instance(value, name, Iterable, f"a sequence of {kind.__name__}")
    return tuple(instance(one, f"{name}[{place}]", kind) for place, one in enumerate(given))


def listener(progress: Callable[P, object] | None, name: str = "progress") -> Callable[P, object]:
    """Return what is called as work goes on; ``None``: nobody is told.

    Raises:
        InvalidInputError: It cannot be called.
    """
    if progress is None:
        return _nobody
    if not callable(progress):
        raise InvalidInputError(f"{name} must be a function, not {type(progress).__name__}")
    return progress


def _nobody(*_: object, **__: object) -> None:
    """Is told, and does nothing."""


def heading(title: object, default: str) -> str:
    """Return a title, or what stands there by default.

    Raises:
        InvalidInputError: It is neither a text nor ``None``.
    """
    return default if title is None else instance(title, "title", str, "a text")


def _checked(value: ArrayLike, name: str, shape: tuple[int | None, ...]) -> Array:
    array = numbers(value, name)
    if array.shape != shape and (shape[0] is not None or array.ndim != len(shape) or array.shape[1:] != shape[1:]):
        wanted = str(shape).replace("None", "N")
        raise InvalidInputError(f"{name} has shape {array.shape}; it must be {wanted}")
    if not np.isfinite(array).all():
        raise InvalidInputError(f"{name} has entries that are not finite")
    return array


def least_eigenvalue(matrix: Array) -> float:
    """A lower bound of the least eigenvalue of a symmetric matrix (n, n); exact where it is diagonal.

    Computed eigenvalues are those of a matrix off by a modest multiple of n u ‖K‖₂, and ‖K‖₂ ≤ n max|K_ij|.
    """
    diagonal = np.diag(matrix)
    if np.array_equal(matrix, np.diag(diagonal)):
        return float(diagonal.min(initial=np.inf))
    n = len(matrix)
    return float(np.linalg.eigvalsh(matrix)[0] - 16.0 * np.finfo(np.float64).eps * n * n * np.abs(matrix).max())
