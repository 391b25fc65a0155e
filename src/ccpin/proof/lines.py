"""Curves of closed configurations over a line of q, with a dependent coordinate as the parameter, and where they lead.

Proposition L of `ccpin/proof/theorems/branch.md` says when a singular configuration lies on σ's branch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices, apply
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.equations import Closures, Problem, closures_of
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.newton import Boxes, check, encloses, solve_in_boxes
from ccpin.proof.paths import Followed
from ccpin.proof.rounding import SLACK, blur
from ccpin.proof.solutions import Met, boxes_of
from ccpin.proof.zeros import SingularPoints

_ROOM = 4.0  # times what the singular configuration is uncertain by: how much wider a box's tube may be made


def line_system(system: ClosureSystem, q: Array, direction: Array, parameter: int) -> ClosureSystem:
    """The closures and the rows Nᵀ(q − q_r) = 0, with one entry of θ as the only independent coordinate."""
    n = system.n
    across = np.linalg.svd(direction[None])[2][1:]
    rows = np.zeros((n - 1, system.n_free))
    rows[:, system.independent] = across
    chains = tuple(
        chain._replace(weights=np.concatenate([chain.weights, np.zeros((n - 1, 3))])) for chain in system.chains
    )
    return replace(
        system,
        chains=chains,
        couplings=np.concatenate([system.couplings, rows]),
        offset=np.concatenate([system.offset, -across @ q]),
        moduli=np.concatenate([system.moduli, np.zeros(n - 1)]),
        independent=np.array([parameter]),
        dependent=np.setdiff1d(np.arange(system.n_free), [parameter]),
        periodic=system.periodic
        & ~np.any(rows != 0.0, axis=0),  # of these coordinates the rows know more than an angle
    )


@provable
@dataclass(frozen=True, eq=False)
class SingularOnSegment(ProvableClaim):
    """σ, continued along q_r + s d, 0 ≤ s ≤ 1, from the solution that a point encloses, meets a singular configuration.

    Premises: the fact that the point's solution is that of a box of q-space, the only one (`Met`); the curve over the
    line, whose equations are `line_system`'s (`Followed`); the singular points, on lines from q_r.

    Attributes:
        singular: Which of the singular points, with d its direction, of shape (1,).
        box: Which of the curve's boxes holds it, of shape (1,).
    """

    singular: Annotated[Indices, Form("1", "i", 0)]
    box: Annotated[Indices, Form("1", "i", 0)]
    theorem = "branch"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The second is about the closures and the line's rows."""
        kinds = [type(premise.claim) for premise in premises]
        require(kinds == [Met, Followed, SingularPoints], "a box, a curve and singular points are needed")
        require([number < len(premises[2].claim.x) for number in self.singular], "no such singular point")
        q, direction = self._line(premises[2])
        parameter = int(premises[1].claim.equations.system.independent[0])
        line = Closures(line_system(self.equations.system, q, direction, parameter))
        return self.equations.digest, line.digest, self.equations.digest

    def _line(self, points: Fact) -> tuple[Array, Array]:
        """q_r and d."""
        (row,) = self.singular
        return points.claim.origin[row], points.claim.directions[row, :, 0]

    def examined(self, *premises: Fact) -> Examined:
        """1, 2 and 3."""
        join, curve, points = premises
        (row,), (number,), system = self.singular, self.box, self.equations.system
        q, direction = self._line(points)
        point, carriers, boxes = (
            boxes_of(facts) for facts in (join.premises[:1], join.premises[1:], curve.premises[:1])
        )
        require(
            len(join.claim.point) == 1 and carriers.half.shape[1] == system.n, "no box of q-space that holds the point"
        )
        require(number < len(boxes.kappa), "a number of no box")
        require(np.array_equal(point.centre[join.claim.point[0], system.independent], q), "lines from elsewhere")
        carrier, held = carriers.take(join.claim.first), boxes.take(np.arange(number + 1))
        room = carrier.half[0] - np.abs(q - carrier.centre[0, system.independent])
        delta = np.min(room / np.maximum(np.abs(direction), 1e-300))
        low, high = _range_along(curve.claim.equations, held, system.independent, q, direction)
        theta = points.claim.system.theta(points.claim.x)[row]
        error = float(points.found["error"][row] * np.maximum(1.0, np.abs(direction).max()))
        proved = (
            np.all(room >= 0.0)
            and low >= -delta
            and high <= 1.0
            and lies_in(self.equations, carrier, curve.claim.equations, held.take(np.array([0])), -1.0)
            and holds(curve.claim.equations, held.take(np.array([number])), theta, error)
        )
        return Examined(np.array([bool(proved)]), {"theta": theta[None], "error": np.array([error])})


def holds(line: Problem | Closures, box: Boxes, singular: Array, error: float) -> bool:
    """Whether the exact singular configuration, within `error` of the computed one, lies in a box's tube."""
    independent = line.system.independent
    along = float(box.directions[0, independent[0], 0])
    s = (singular[independent] - box.centre[0, independent]) / along
    spread = error / abs(along)
    if not abs(s[0]) + spread <= 1.0:
        return False
    reach = error + np.abs(box.directions[0, :, 0][line.system.dependent]) * spread
    room = _ROOM * np.abs(np.linalg.inv(box.modes[0])) @ reach
    wide = box._replace(radius=box.radius + room, kappa=np.full(1, 0.999))
    box = wide if check(closures_of(line), wide).proved[0] else box
    return bool(encloses(line, box, np.array([[s[0], 0.0]]), singular[None], reach[None])[0])


def lies_in(problem: Problem | Closures, join: Boxes, line: Problem | Closures, box: Boxes, side: float) -> bool:
    """Whether the end of a box of the curve (−1: its first point, 1: its last) lies over the join and in its tube."""
    found = solve_in_boxes(line, box, np.array([[side, 0.0]]))
    error = np.zeros(problem.system.n_free)
    error[line.system.dependent] = (np.abs(box.modes[0]) @ found.error[0]) + 1e-15 * (
        1.0 + np.abs(found.theta[0][line.system.dependent])
    )
    theta, independent, dependent = found.theta[0], problem.system.independent, problem.system.dependent
    offset = theta[independent] - join.centre[0, independent]
    if not np.all(np.abs(offset) + error[independent] <= join.half[0]):
        return False
    reach = error[dependent] + np.abs(join.directions[0][dependent]) @ error[independent]
    return bool(encloses(problem, join, offset[None], theta[None], reach[None])[0])


def _range_along(line: Closures, boxes: Boxes, rows: Indices, q: Array, direction: Array) -> tuple[float, float]:
    """Bounds of s on the boxes' tubes, rounding with them; `rows` are the places of q in θ."""
    modes = np.zeros((len(boxes.kappa), line.system.n_free, line.system.m))
    modes[:, line.system.dependent] = boxes.modes
    along = direction / (direction @ direction)
    middle = (boxes.centre[:, rows] - q) @ along
    spread = (
        apply(np.abs(along @ boxes.directions[:, rows])[:, None], boxes.half)[:, 0]
        + apply(np.abs(along @ modes[:, rows])[:, None], boxes.radius)[:, 0]
        + blur(np.abs(boxes.centre[:, rows]) + np.abs(q)) @ np.abs(along)
    ) * SLACK
    return float((middle - spread).min()), float((middle + spread).max())
