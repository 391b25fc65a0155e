"""An auditor of its own: certified boxes of the RPDR judged in ball arithmetic from the closed form (31) alone."""

from copy import copy
from itertools import product

import numpy as np
import pytest

from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.domain import certify
from ccpin.domain.closures.system import reading_of
from tests.oracles import rpdr as oracle

flint = pytest.importorskip("flint")
arb = flint.arb

LINKS = (
    (oracle.A1, (1, 0, 0, 0), 1),
    (oracle.A3, (1, 1, 0, 0), 1),
    (oracle.A2, (0, 0, 1, 0), -1),
    (oracle.A4, (0, 0, 1, 1), -1),
)


def ball(low, high):
    """The ball that holds [low, high], floats taken exactly."""
    low, high = arb(low), arb(high)
    return (low + high) / 2 + arb(0, 1) * (high - low) / 2


class Box:
    """Ãφ over balls of (δ, ζ), each link's angle formed as one affine function so that joints may cancel."""

    def __init__(self, boxes, k):
        self.radius, self.half = boxes.radius[k], boxes.half[k]
        self.modes, self.weight = boxes.modes[k], boxes.weight[k]
        self.preconditioner = boxes.preconditioner[k]
        self.angles = []
        lift = np.zeros((4, 2))
        lift[[1, 3]] = self.modes
        for length, sign, side in LINKS:
            row = [arb(0)] * 4
            centre = sum((arb(c) for c, s in zip(boxes.centre[k], sign, strict=True) if s), arb(0))
            for j in range(2):
                row[j] = sum((arb(boxes.directions[k, i, j]) for i in range(4) if sign[i]), arb(0))
                row[2 + j] = sum((arb(lift[i, j]) for i in range(4) if sign[i]), arb(0))
            self.angles.append((arb(length), side, centre, row))

    def preconditioned(self, point):
        """The same box with the inverse of φ_yV at a point for Ã."""
        slope = self.weighted(point)[1]
        middle = np.array([[float(slope[i][2 + j].mid()) for j in range(2)] for i in range(2)])
        other = copy(self)
        other.preconditioner = np.linalg.inv(middle) @ self.preconditioner
        return other

    def weighted(self, variables):
        """Ãφ and its derivatives by (δ, ζ) over balls."""
        phi, slope = [-arb(oracle.C), arb(0)], [[arb(0)] * 4, [arb(0)] * 4]
        for length, side, centre, row in self.angles:
            angle = centre + sum((a * x for a, x in zip(row, variables, strict=True)), arb(0))
            cosine, sine = length * angle.cos() * side, length * angle.sin() * side
            phi = [phi[0] + cosine, phi[1] + sine]
            slope[0] = [entry - sine * a for entry, a in zip(slope[0], row, strict=True)]
            slope[1] = [entry + cosine * a for entry, a in zip(slope[1], row, strict=True)]
        a = [[arb(entry) for entry in row] for row in self.preconditioner]
        f = [a[i][0] * phi[0] + a[i][1] * phi[1] for i in range(2)]
        return f, [[a[i][0] * slope[0][j] + a[i][1] * slope[1][j] for j in range(4)] for i in range(2)]

    def enclosed(self, variables):
        """Ãφ over balls by the mean value theorem, in which first-order terms cancel."""
        middle = [x.mid() for x in variables]
        f, slope = self.weighted(middle)[0], self.weighted(variables)[1]
        return [f[i] + sum((slope[i][j] * (variables[j] - middle[j]) for j in range(4)), arb(0)) for i in range(2)]

    def defect(self, variables):
        """‖I − Ãφ_yV‖ in the box's norm, an upper bound."""
        slope = self.weighted(variables)[1]
        rows = []
        for i in range(2):
            total = sum((abs(arb(int(i == j)) - slope[i][2 + j]) * arb(self.weight[j]) for j in range(2)), arb(0))
            rows.append(total / arb(self.weight[i]))
        return max(float(row.upper()) for row in rows)


def audit(box, depth=9):
    """Whether, for every δ, the tube holds exactly one solution of the closed form (δ is cut in cells where needed)."""
    cells = [(-box.half, box.half, depth)]
    while cells:
        low, high, left = cells.pop()
        if holds_one(box, [ball(a, b) for a, b in zip(low, high, strict=True)]):
            continue
        if not left:
            return False
        middle = 0.5 * (low + high)
        for side in product((False, True), repeat=2):
            corner = np.where(side, middle, low), np.where(side, high, middle)
            cells.append((*corner, left - 1))
    return True


def holds_one(box, delta, grid=8):
    """One solution in the tube for all δ in a cell.

    Parts of the tube where 0 ∉ φ are ruled out. On a ball about the hull of the rest Krawczyk's operator must contract
    (one solution at most) and map the ball into itself (one at least); its repeated image, where that solution is,
    must lie in the tube.
    """
    steps = 2 * box.radius / grid
    kept = []
    for part in product(range(grid), repeat=2):
        zeta = [ball(-r + d * k, -r + d * (k + 1)) for r, d, k in zip(box.radius, steps, part, strict=True)]
        if all(entry.contains(0) for entry in box.enclosed(delta + zeta)):
            kept.append(part)
    if not kept:
        return False
    low, high = -box.radius + steps * (np.min(kept, axis=0) - 1), -box.radius + steps * (np.max(kept, axis=0) + 2)
    hull = [ball(a, b) for a, b in zip(low, high, strict=True)]
    box = box.preconditioned([x.mid() for x in delta + hull])
    image = krawczyk(box, delta, hull)
    inside = all(h.contains_interior(entry) for h, entry in zip(hull, image, strict=True))
    one = inside and box.defect(delta + hull) < 1
    for _ in range(4):
        image = krawczyk(box, delta, image)
    within = all(ball(-r, r).contains(entry) for r, entry in zip(box.radius, image, strict=True))
    return one and within


def krawczyk(box, delta, hull):
    """K = z − Ãφ(z) + (I − Ãφ_yV)(ζ − z) over a hull, z its middle."""
    middle = [entry.mid() for entry in hull]
    f, slope = box.enclosed(delta + middle), box.weighted(delta + hull)[1]
    result = []
    for i in range(2):
        spread = ((arb(int(i == j)) - slope[i][2 + j]) * (hull[j] - middle[j]) for j in range(2))
        result.append(middle[i] - f[i] + sum(spread, arb(0)))
    return result


@pytest.mark.parametrize("depth", [6])
def test_auditor_agrees_with_a_sample_of_the_atlas(rpdr, depth):
    """Boxes of all sizes, drawn from the torus and from the square at a singularity, stand up in ball arithmetic."""
    atlas = certify(rpdr, np.radians((-108.0, -48.0)), max_depth=depth)
    order = np.argsort(atlas.boxes.half.max(axis=1), kind="stable")  # many are alike, and machines sort otherwise
    chosen = order[np.linspace(0, len(order) - 1, 4).astype(int)]
    for k in chosen:
        assert audit(Box(atlas.boxes, int(k))), f"box {k} of half widths {atlas.boxes.half[k]}"


def test_auditor_rejects_wrong_claims(rpdr):
    """A tube moved off σ, and one that holds both assembly modes, do not pass the auditor either."""
    problem = reading_of(rpdr, rpdr.q_reference).problem
    q1, q2, q3, q4 = oracle.sigma(np.radians((-108.0, -72.0)), 1.0)
    boxes = certify_boxes(problem, np.array([[q1, q3, q2, q4]]), np.full((1, 2), np.radians(6.0)), np.eye(2)).boxes
    assert audit(Box(boxes, 0))
    moved = boxes._replace(centre=boxes.centre + np.array([0.0, 3.0 * boxes.radius[0].max(), 0.0, 0.0]))
    assert not audit(Box(moved, 0))
    assert not audit(Box(boxes._replace(radius=boxes.radius * 0 + 2.8), 0))
