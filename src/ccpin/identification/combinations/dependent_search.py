"""Combinations that depend to a share on others, looked for over a box about the reference: proposals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.identification.combinations.dependent_columns import DependentColumns, reach
from ccpin.identification.combinations.identification_equations import IdentificationEquations
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.validated.arithmetic.balls import Ball, ball, flint
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.arithmetic.polydisc import ring
from ccpin.validated.arithmetic.series import values
from ccpin.validated.flow.analytic_branch import AnalyticBranch, branch_over, followed
from ccpin.validated.flow.closing import assembled

SHARE = 1e-12
_RHO = (4.0, 8.0, 10.0)  # Bernstein's ellipses, by the number of q
_ORDERS = ((16, 30), (10, 20), (9, 19))  # of σ's polynomials and of the series, alike
_NONE = 1e-14  # of a coefficient: what is smaller is there by rounding
_TUBES = (1e-3, 1e-4, 1e-5)  # rad or m
_BITS = 128
_CLOSED = 2.0**-100  # of φ, to which points are closed
_STEPS = 40
_HALVINGS = 6


def combinations_of(forms: Sequence[Sequence[Ball]], base: Indices, others: Indices) -> Array | None:
    """G with F_others = F_base G, by least squares in the current precision, of shape (base, others)."""
    mine, theirs = (
        flint().arb_mat([[form[k].mid() for k in places.tolist()] for form in forms]) for places in (base, others)
    )
    try:
        found = (mine.transpose() * mine).solve(mine.transpose() * theirs)
    except ZeroDivisionError:
        return None
    rows = np.array([[float(x.mid()) for x in row] for row in found.tolist()]).reshape(len(base), len(others))
    return np.where(np.abs(rows) > _NONE, rows, 0.0)


def depend(
    equations: IdentificationEquations, x: Array, half: float, columns: Indices, combinations: Array
) -> Fact | None:
    """The fact about combinations over |q − c| ≤ h about a configuration x; h is halved until there is one."""
    loop, n = equations.loop, len(equations.loop.independent)
    if not loop.scalar or not loop.dependent or not 0 < n <= len(_RHO):
        return None
    rho, (degree, last) = _RHO[n - 1], _ORDERS[n - 1]
    points = points_of(n, last)
    for _ in range(_HALVINGS):
        branch = _followed(equations, x, reach(np.full(n, half), rho), degree)
        closed = None if branch is None else _closed(branch, np.full(n, half), points)
        if branch is not None and closed is not None:
            centre, polynomials = x[list(loop.independent)], branch.inputs.mid[list(loop.dependent)]
            claim = DependentColumns(
                equations, centre, np.full(n, half), np.array([rho]), polynomials, branch.radius,
                np.array([degree, last]), points, closed, columns, combinations, np.array([SHARE]), np.array([_BITS]),
            )  # fmt: skip
            try:
                return prove(claim)
            except NotProvedError:
                pass
        half *= 0.5
    return None


def points_of(n: int, degree: int) -> Array:
    """Points of [−1, 1]ⁿ that decide a polynomial of total degree N, as many as it has terms: Leja's, (K, n)."""
    grid = np.cos(np.linspace(0.0, np.pi, 40 * degree + 1))
    line = [1.0]
    while len(line) <= degree:
        line.append(float(grid[np.argmax(np.abs(np.subtract.outer(grid, line)).prod(axis=1))]))
    return np.array(line)[ring(n, degree).exponents]


def _followed(equations: IdentificationEquations, x: Array, about: Array, degree: int) -> AnalyticBranch | None:
    loop = equations.loop
    centre = x[list(loop.independent)]
    y = followed(loop, centre, about, x[list(loop.dependent)], degree)
    if y is None:
        return None
    tried = (branch_over(loop, centre, about, y, np.full(len(y), tube), degree) for tube in _TUBES)
    return next((branch for branch in tried if branch is not None and branch.proved), None)


def _closed(branch: AnalyticBranch, half: Array, points: Array) -> Array | None:
    """y at points of the box by Newton's method with B for the inverse, sums of doubles, of shape (K, Y, m)."""
    loop = branch.loop
    polynomials = branch.inputs.mid[list(loop.dependent)]
    powers = np.prod((points * (half / branch.reach))[:, None] ** branch.near.ring.exponents, axis=2)
    starts, found = powers @ polynomials.T, list[Array]()
    with flint().ctx.workprec(_BITS):
        for xi, power, start in zip(points, powers, starts, strict=True):
            q = [
                ball(c) + ball(h) * ball(t)
                for c, h, t in zip(branch.centre.tolist(), half.tolist(), xi.tolist(), strict=True)
            ]
            y = [ball(value) for value in start.tolist()]
            near = flint().arb_mat((branch.near.mid @ power).tolist())
            for _ in range(_STEPS):
                left = values(loop.closure, loop.at_rest(assembled(loop, q, y)))
                y = [
                    (a - b).mid()
                    for a, b in zip(y, (near * flint().arb_mat([[e] for e in left])).entries(), strict=True)
                ]
                if all(abs(e) < _CLOSED for e in left):
                    break
            else:
                return None
            found.append(boxed(y, _BITS).parts)
    return np.array(found)
