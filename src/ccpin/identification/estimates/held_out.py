"""Cross-validation: what constants found from some of the samples make of the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.identification.estimates.robust_fit import EffortRows

_PARTS = 5
_NOTHING = 1e-10  # of the largest singular value: what the other samples do not show stays as stated


class HeldOut(NamedTuple):
    """Samples that were held out, and what was made of them; root mean squares of rows of ρᵀSᵀu, N m or N, (n,) each.

    Attributes:
        where: Which they are, in words.
        samples: How many.
        found: What the constants that all other samples tell miss of them.
        stated: What the model's own constants miss.
        measured: Of the generalised forces themselves.
        coulomb: What constants found without a Stribeck effect miss, where one was found (its speeds from all samples).
    """

    where: str
    samples: int
    found: Array
    stated: Array
    measured: Array
    coulomb: Array | None = None


def parts_of(times: Sequence[Array], names: Sequence[str]) -> list[tuple[str, Indices]]:
    """What is held out in turn: each of several logs, or fifths of a single one; names, and samples by number."""
    if len(times) > 1:
        begins = np.cumsum([0, *map(len, times)])
        parts = [(name, np.arange(a, b)) for name, a, b in zip(names, begins[:-1], begins[1:], strict=True)]
    else:
        chosen = np.array_split(np.arange(len(times[0])), _PARTS)
        parts = [(f"{times[0][k[0]]:.4g} s to {times[0][k[-1]]:.4g} s", k) for k in chosen if len(k)]
    return [(name, chosen) for name, chosen in parts if len(chosen)]


def cross_validated(
    rows: EffortRows,
    deviation: Array,
    stated: Array,
    missed: Array,
    measured: Array,
    parts: Sequence[tuple[str, Indices]],
) -> tuple[HeldOut, ...]:
    """Each part beside constants found from all others.

    Args:
        rows: Of all samples that count.
        deviation: Of each of the n rows of a sample.
        stated: β as the model states it: what the others do not show stays so.
        missed: What the stated constants miss, of shape (N, n).
        measured: ρᵀSᵀu, alike.
        parts: Names, and samples by number.
    """
    found, short = [], [rows.of(chosen).condensed() for _, chosen in parts]
    for k, (where, chosen) in enumerate(parts):
        others = short[:k] + short[k + 1 :]
        if not others:
            continue
        r = rows.W.shape[2]
        A = np.concatenate([*((each.W / deviation[:, None]).reshape(-1, r) for each in others), rows.P])
        b = np.concatenate([*((each.left(stated) / deviation).ravel() for each in others), rows.p - rows.P @ stated])
        q, triangle = np.linalg.qr(A)
        beta = stated + np.linalg.lstsq(triangle, q.T @ b, rcond=_NOTHING)[0]
        sizes = (rows.left(beta)[chosen], missed[chosen], measured[chosen])
        found.append(HeldOut(where, len(chosen), *(np.sqrt((each**2).mean(axis=0)) for each in sizes)))
    return tuple(found)
