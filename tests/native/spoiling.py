"""Wrong arguments for the compiled core: arrays and nested plain numbers, spoilt in one place each."""

from __future__ import annotations

from typing import Any

import numpy as np


def spoilt_array(array: np.ndarray, rng: np.random.Generator) -> Any:
    """An array of another size, with NaN in it, of another kind, or none at all."""
    poisoned = array.copy()
    if poisoned.size:
        poisoned.flat[int(rng.integers(poisoned.size))] = rng.choice([np.nan, np.inf, 1e300])
    with np.errstate(over="ignore"):
        shorter = array.astype(np.float32)
    others = [poisoned, array[:-1], np.append(array, 1.0), array[None], array.astype(str), None, "text", [], 3.0,
              np.zeros((2, 2, 2, 2)), array[..., ::-1], shorter, np.empty((0, 0))]  # fmt: skip
    return others[int(rng.integers(len(others)))]


def spoil(thing: Any, rng: np.random.Generator) -> None:
    """Change one place in nested dicts, lists, tuples and arrays, in place: gone, longer, shorter, or another value."""
    holder, key = _place(thing, rng)
    value = holder[key]
    wrong: list[Any] = [None, -1, 10**6, 2**40, "text", [], {}, np.nan, np.zeros((2, 2)), [0, 0, 0], -0.5]
    if isinstance(value, list | tuple):
        wrong += [type(value)(list(value)[:-1]), type(value)([*value, *value])]
    if isinstance(value, int | float) and not isinstance(value, bool):
        wrong += [value + 1, value - 1, -value]
    if isinstance(holder, dict) and rng.random() < 0.1:
        del holder[key]
    else:
        holder[key] = wrong[int(rng.integers(len(wrong)))]


def _place(thing: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """A random place within: what holds it, made writable, and its key there."""
    keys = list(thing) if isinstance(thing, dict) else list(range(len(thing)))
    key = keys[int(rng.integers(len(keys)))]
    value = thing[key]
    if isinstance(value, list | tuple | dict) and len(value) and rng.random() < 0.85:
        if isinstance(value, tuple):
            inner = list(value)
            holder, place = _place(inner, rng)
            return _Through(thing, key, inner, holder), place
        return _place(value, rng)
    return thing, key


class _Through:
    """A place within a tuple: a change there makes the tuple anew."""

    def __init__(self, outer: Any, key: Any, inner: list[Any], holder: Any) -> None:
        self._outer, self._key, self._inner, self._holder = outer, key, inner, holder

    def __getitem__(self, place: Any) -> Any:
        return self._holder[place]

    def __setitem__(self, place: Any, value: Any) -> None:
        self._holder[place] = value
        self._outer[self._key] = tuple(self._inner)
