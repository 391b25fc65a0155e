"""The claim that columns of Y depend on others to a share of their size, over a box of q: Theorem I, to a share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Annotated, Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.identification.combinations.identification_equations import IdentificationEquations, Seen
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.validated.arithmetic.ball_arrays import of_balls
from ccpin.validated.arithmetic.balls import Ball, ball, flint, lower
from ccpin.validated.arithmetic.chebyshev import bounded
from ccpin.validated.arithmetic.exact_numbers import centres
from ccpin.validated.arithmetic.polydisc import evaluated
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.analytic_branch import AnalyticBranch, branch_over
from ccpin.validated.flow.start_claim import PRECISION

_OUT = 1.0 + 2.0**-20  # on what is not negative: covers the roundings in computing it, of balls' radii too
_TERMS = 4000  # of a series at most: roundings of so long sums are covered
_LEAST = 1e-200  # of a form's size, in its unit: what is 0 is known to 1e-290


class Rubbing(NamedTuple):
    """What friction leaves of combinations: z_k ρ_kc + s_c z_b ρ_bc, b the one other joint in it, for each rate c.

    Attributes:
        weights: Of all joints' rates, of shape (w, rates).
        owners: Which combination each row is of.
    """

    weights: Array
    owners: Indices


@provable
@dataclass(frozen=True, eq=False)
class DependentColumns(ProvableClaim):
    """Some constants are to a share ε combinations of others: forms of e_k − Σ G_kb e_b are ε of their size at most.

    That is over all q with |q − c| ≤ h, on the one sheet of configurations with |y − y_N(q)| ≤ r.

    Attributes:
        q, half: c and h.
        rho: Of Bernstein's ellipses about the box; they are in the polydisc |q − c| ≤ R = h (ρ + 1/ρ)/2.
        y, radius: Coefficients of y_N by (q − c)/R, and r.
        orders: Total degrees of y_N, and of the Chebyshev series.
        points: (q − c)/h of points of the box, as many as the series has terms.
        closed: y there, sums of m doubles.
        columns: The constants, of shape (s,).
        combinations: Of shape (s, p), ones at `columns`.
        share: ε.
        precision: In bits.

    Found: `left` (1, s), the share that is proved of each.
    """

    equations: IdentificationEquations
    q: Annotated[Array, Form("Q")]
    half: Annotated[Array, Form("Q", above=0.0)]
    rho: Annotated[Array, Form("1", above=1.0)]
    y: Annotated[Array, Form("Yt")]
    radius: Annotated[Array, Form("Y", above=0.0)]
    orders: Annotated[Indices, Form("2", "i", least=1, below=100)]
    points: Annotated[Array, Form("KQ", least=-1.0, below=float(np.nextafter(1.0, 2.0)))]
    closed: Annotated[Array, Form("KYm")]
    columns: Annotated[Indices, Form("s", "i", least=0)]
    combinations: Annotated[Array, Form("sP")]
    share: Annotated[Array, Form("1", above=0.0)]
    precision: Annotated[Indices, PRECISION]
    theorem = "identifiable"

    def examined(self, *premises: Fact) -> Examined:
        """σ is analytic, forms are bounded there, and small at points of the box: then they are small over it."""
        require(not premises, "a box rests on nothing else")
        require(
            self.equations.loop.scalar and self.q.size and self.radius.size,
            "no closures, or q̇ that are not the rates of q",
        )
        require(self.columns < self.equations.sizes["P"], "a constant that is none")
        own = self.combinations[:, self.columns] == np.eye(len(self.columns))
        require(own, "combinations that depend on each other")
        terms = [comb(len(self.q) + order, order) for order in self.orders.tolist()]
        require(terms == [self.y.shape[1], len(self.points)], "series of other degrees")
        require(max(terms) <= _TERMS, "more terms than roundings are counted of")
        with flint().ctx.workprec(int(self.precision[0])):
            branch = branch_of(self)
            seen = self._seen(branch)
            columns = flint().arb_mat(self.combinations.T.tolist())
            rubbing = rubbing_of(self.equations, self.combinations, seen[0])
            values = of_balls([self._left(each, columns, rubbing) for each in seen])
            bound = of_balls([self._left(everywhere(self.equations, branch), columns, rubbing)]).size[0]
        most = bounded(values, self.points, int(self.orders[1]), bound, float(self.rho[0]))
        left = self._by_size(most, seen, rubbing)
        require(left <= self.share, "more than this share is left")
        return Examined(np.ones(1, dtype=np.bool_), {"left": left[None]})

    def _seen(self, branch: AnalyticBranch) -> list[Seen]:
        """What the points show.

        Raises:
            NotProvedError: A y is far from σ.
        """
        found, centre, half = list[Seen](), *([ball(x) for x in each.tolist()] for each in (self.q, self.half))
        for xi, y in zip(self.points, self.closed, strict=True):
            q = [c + h * ball(x) for c, h, x in zip(centre, half, xi.tolist(), strict=True)]
            box = branch.closed(q, xi * (self.half / reach(self.half, float(self.rho[0]))), centres(y))
            if box is None:
                raise NotProvedError("a point of another sheet")
            try:
                found.append(self.equations.seen(box))
            except NotInvertibleError:
                raise NotProvedError("no motion is proved to be at a point") from None
        return found

    def _left(self, seen: Seen, columns: Any, rubbing: Rubbing) -> list[Ball]:
        """Forms of combinations, (forms, s) row by row, and what friction leaves of them, (w, columns)."""
        matrix = flint().arb_mat
        smooth = matrix(self.equations.smooth_forms(seen)) * columns
        rates = matrix(rubbing.weights.tolist()) * matrix(seen.rho) if len(rubbing.weights) else None
        return [*smooth.entries(), *(() if rates is None else rates.entries())]

    def _by_size(self, most: Array, seen: Sequence[Seen], rubbing: Rubbing) -> Array:
        """The largest share of each combination, of shape (s,)."""
        fastest = fastest_of(self.equations, seen)
        forms, rates = (of_balls(table).size for table in (self.equations.smooth_forms(fastest), fastest.rho))
        smooth, rubbed = forms @ np.abs(self.combinations).T, np.abs(rubbing.weights) @ rates
        shares = most / (np.concatenate([smooth.ravel(), rubbed.ravel()]) + _LEAST) * _OUT
        left = shares[: smooth.size].reshape(smooth.shape).max(axis=0)
        np.maximum.at(left, rubbing.owners, shares[smooth.size :].reshape(rubbed.shape).max(axis=1))
        return np.asarray(left)


def reach(half: Array, rho: float) -> Array:
    """R = h (ρ + 1/ρ)/2, or a little more."""
    return np.asarray(half * (0.5 * (rho + 1.0 / rho) * _OUT))


def branch_of(claim: DependentColumns) -> AnalyticBranch:
    """σ over the polydisc.

    Raises:
        NotProvedError: It is not proved to be there.
    """
    loop, degree = claim.equations.loop, int(claim.orders[0])
    branch = branch_over(loop, claim.q, reach(claim.half, float(claim.rho[0])), claim.y, claim.radius, degree)
    if branch is None or not branch.proved:
        raise NotProvedError("σ is not proved to be analytic about the box")
    return branch


def everywhere(equations: IdentificationEquations, branch: AnalyticBranch) -> Seen:
    """Balls about 0 for all complex numbers that are seen over the polydisc.

    Raises:
        NotProvedError: There are no such bounds.
    """
    try:
        size = evaluated(equations.motions, branch.inputs).values.size
    except NotInvertibleError:
        raise NotProvedError("no motion is proved to be about the box") from None
    return equations.arranged([flint().arb(0, x) for x in size.tolist()])


def fastest_of(equations: IdentificationEquations, seen: Sequence[Seen]) -> Seen:
    """Balls about 0 as large as the largest that any body or joint does at some points, told of every one."""
    slides = [slide for body in equations.bodies for slide in body.slides]
    sprung = [
        slide
        for body, count in zip(equations.bodies, equations.stretched, strict=True)
        for slide in body.slides[:count]
    ]
    twists, gravity, rho = (
        np.array([[[*map(_sure, row)] for row in table] for table in tables])
        for tables in (
            [[entry for body in each.twists for entry in body] for each in seen],
            [each.gravity for each in seen],
            [each.rho for each in seen],
        )
    )
    stretches = np.array([[_sure(x) for part in each.stretches for x in part] for each in seen])

    def of_kind(values: Array, kinds: Sequence[bool]) -> Array:
        """The largest of its kind, of shape (len(kinds), …)."""
        return np.array([values[:, np.equal(kinds, kind)].max(axis=(0, 1)) for kind in kinds]).reshape(
            len(kinds), *values.shape[2:]
        )

    bodies = len(equations.bodies)
    by_body = twists.reshape(len(seen), bodies, -1, 2, 3).max(axis=(0, 1, 4))  # (axes, 2)
    wide = np.broadcast_to(np.repeat(by_body, 3, axis=1), (bodies, len(by_body), 6))
    down = np.full((bodies, 3), gravity.max(initial=0.0))
    parts = (wide, down, of_kind(rho, slides), of_kind(stretches, sprung))
    return equations.arranged([flint().arb(0, x) for part in parts for x in part.ravel().tolist()])


def _sure(x: Ball) -> float:
    """A lower bound of |x|."""
    return max(lower(abs(x)), 0.0)


def rubbing_of(equations: IdentificationEquations, combinations: Array, seen: Seen) -> Rubbing:
    """Rows of rates that are 0 where friction cancels; signs s_c are taken where these are seen.

    Raises:
        NotProvedError: A combination has friction of more than two joints, of two with other rates, or of one sign.
    """
    rates = np.array([[float(x.mid()) for x in row] for row in seen.rho]).reshape(-1, len(seen.twists[0]))
    rows, owners = list[Array](), list[int]()
    for owner, z in enumerate(combinations):
        joints = [(z[place], own) for place, own in equations.frictions if z[place] != 0.0]
        require(len(joints) <= 2, "friction of more than two joints")
        require(len({len(own) for _, own in joints}) <= 1, "friction of two joints with other rates")
        require(len({level > 0.0 for level, _ in joints}) == len(joints), "friction that adds up")
        for number in range(len(joints[0][1]) if joints else 0):
            row = np.zeros(len(rates))
            (level, own), *others = joints
            row[own[number]] = level
            for other, its in others:
                against = other * (rates[own[number]] @ rates[its[number]])
                row[its[number]] = -other if against * level > 0.0 else other
            rows.append(row)
            owners.append(owner)
    return Rubbing(np.array(rows).reshape(-1, len(rates)), np.array(owners, dtype=np.int64))
