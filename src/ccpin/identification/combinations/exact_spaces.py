"""Linear algebra over the rationals: spans, null spaces, and what is invariant under operators. Vectors are rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.recording.recorded_tree import Table
from ccpin.validated.arithmetic.balls import flint


class EchelonForm(NamedTuple):
    """A span's reduced echelon form: rows that are independent, and the columns of their leading ones."""

    rows: Table
    pivots: tuple[int, ...]


def rational(value: Any) -> Any:
    """A whole number or fraction as flint's."""
    return flint().fmpq(value.numerator, value.denominator)


def reduced(rows: Sequence[Any] | Table, width: int) -> EchelonForm:
    """The reduced echelon form of rows of flint's rationals or whole numbers."""
    if not len(rows):
        return EchelonForm(np.zeros((0, width), dtype=object), ())
    form, rank = flint().fmpq_mat([list(row) for row in rows]).rref()
    table = np.array([form[i, j] for i in range(rank) for j in range(width)], dtype=object).reshape(rank, width)
    return EchelonForm(table, tuple(next(j for j in range(width) if row[j] != 0) for row in table))


def null_space(rows: Sequence[Any] | Table, width: int) -> Table:
    """A basis of all x with rows · x = 0, of shape (width − rank, width)."""
    form = reduced(rows, width)
    others = [j for j in range(width) if j not in form.pivots]
    basis = np.zeros((len(others), width), dtype=object)
    for vector, j in zip(basis, others, strict=True):
        vector[j] = 1
        vector[list(form.pivots)] = -form.rows[:, j]
    return basis


def invariant_span(rows: Table, operators: Iterable[Table]) -> Table:
    """The least span that has these rows and is mapped into itself by square matrices."""
    width, maps = rows.shape[1], list(operators)
    span = reduced(rows, width).rows
    while True:
        more = reduced(np.vstack([span, *(span @ each.T for each in maps)]), width).rows
        if len(more) == len(span):
            return span
        span = more


def doubles(rows: Table) -> Array:
    """Rationals, each as the double nearest to it."""
    return np.array([[int(x.p) / int(x.q) if x else 0.0 for x in row] for row in rows]).reshape(rows.shape)
