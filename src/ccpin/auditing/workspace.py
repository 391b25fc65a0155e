"""What a workspace's boxes are to meet besides Theorem N: limits, motors that determine the motion, dexterity.

A box of `boxes` has θ(δ) = θ_c + Dδ + Eζ(δ), |δ| ≤ h, |ζ| ≤ R, with the task's coordinates x independent and all
others, y, dependent. Some of θ, q_d, are driven.

**Limits.** |θ − θ_c| ≤ |D|h + |E|R.

**Lemma.** Over a cell of the parameters, for any real matrices Ã, Ã″ (m×m), X (m×n), K_c, U, V, S (n×n, S diagonal):

1. Let y″ be all of θ but q_d. Where |I − Ã″φ_y″|w < w for a w > 0, φ_y″ is nonsingular: φ = 0 holds as many smooth
   functions of q_d as there are coordinates, and the motors determine the motion.
2. Let |Ãφ_yV − I| ≤ M, |Ã(φ_x + φ_yX)| ≤ F, Mw < w for a w > 0, and F + MT ≤ T. Then |∂y/∂x − X| ≤ T, for V = I.
3. Let ‖UᵀU − I‖_F ≤ u < 1, ‖VᵀV − I‖_F ≤ v < 1, ‖UᵀK_cV − S‖_F ≤ g, ‖K − K_c‖_F ≤ e. The singular values of K are
   at least (min |S| − g)/√((1 + u)(1 + v)) − e and at most (max |S| + g)/√((1 − u)(1 − v)) + e.

With K = ∂q_d/∂x, rows of [I; ∂y/∂x], each column divided by what a unit of x counts as, J = K⁻¹ is the end effector's
Jacobian, and 1/κ(J) = 1/κ(K), the least of K's singular values by the greatest.

*Proof.* 1: Ã″φ_y″ is nonsingular as |I − Ã″φ_y″| contracts; then so is φ_y″, and the implicit function theorem
applies. 2: φ_x + φ_y ∂y/∂x = 0, so Z = ∂y/∂x − X has Z = (I − Ãφ_y)Z − Ã(φ_x + φ_yX), |Z| ≤ M|Z| + F, hence |Z| ≤
(I − M)⁻¹F ≤ T as the inverse is nonnegative. 3: the singular values of UᵀK_cV are those of S to g (Weyl), and those of
K_c times a number between the products of the least and of the greatest of U and V; Weyl again. ∎

For any real matrix B, Ã φ_θ(θ) B lies in Ã φ_θ(θ₀) B + Σ_j Ã H_j B [−w_j, w_j] over a cell, with H_j holding the
derivatives of φ_θ along the j-th column of D or E as in `boxes`, w_j that parameter's half width; and in Ã[φ_θ]B as
evaluated over the cell. Of the two the narrower is taken, entry by entry.

Where a carriage has x, φ's own rows do not depend on x: φ_y″ is block triangular with the matrix ψ_q′ of the mechanism
among the square blocks on its diagonal.
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import Box, Cell, box_of, contracts, defect, embedded, moves_of, unproved
from ccpin.auditing.closures import BallClosures, columns, exact, floats, inverse_of
from ccpin.auditing.gluing import in_tube, near
from ccpin.auditing.lengths import size_of
from ccpin.auditing.reach import above
from ccpin.auditing.reading import Array, ClaimedDocument, ClaimedRequirements, Integers

_ROOM = 1.0 + 1e-6  # on T as computed, which is then tried: 2 needs it no smaller than (I − M)⁻¹F
_LEAST = 1e-300  # above zero, where F is zero: T > 0


def met(closures: BallClosures, document: ClaimedDocument, k: int, cuts: int) -> bool | None:
    """Whether the k-th box was proved to meet the demands, cut in two so many times one after another.

    ``False``: σ over its middle was proved to be beyond a limit, or motors to be too many or few; ``None``: neither.
    """
    demands = document.demands
    if demands is None:
        return True
    box = box_of(document, k)
    if not _within(demands, _reached(box, -box.half, box.half)):
        return False if _beyond(closures, document, k) else None
    if not demands.driven.size:
        return True
    if len(demands.driven) != len(document.independent):
        return False
    weight = np.abs(floats(box.directions)).max(axis=0)  # what moves θ most is cut
    left = unproved(box.half, cuts, lambda cell, _: _holds(_Slopes(closures, document, box, cell), demands), weight)
    return True if left is None else None


def _beyond(closures: BallClosures, document: ClaimedDocument, k: int) -> bool:
    """Whether σ over a box's middle is beyond a limit."""
    demands, still = document.demands, np.zeros(len(document.independent))
    found = near(closures, document.dependent, document.centre[k])
    if demands is None or found is None or not in_tube(document, k, *found, still):
        return False
    theta, radius = found[0][document.dependent], found[1]
    low, high = demands.lower[document.dependent], demands.upper[document.dependent]
    return any(
        arb(float(x)) + radius < float(a) or arb(float(x)) - radius > float(b)
        for x, a, b in zip(theta, low, high, strict=True)
    )


def _reached(box: Box, low: Array, high: Array) -> list[arb]:
    """θ over a cell of a box's parameters."""
    delta = [arb(float(a)).union(arb(float(b))) for a, b in zip(low, high, strict=True)]
    along = (box.directions * arb_mat(len(delta), 1, delta)).entries()
    tube = embedded(box, arb_mat(len(box.radius), 1, [arb(0, float(r)) for r in box.radius]))
    return [c + d + e for c, d, e in zip(box.centre, along, tube, strict=True)]


def _within(demands: ClaimedRequirements, theta: list[arb]) -> bool:
    """Whether limits are kept; the largest number stands for no limit."""
    return all(
        x >= arb(float(low)) and x <= arb(float(high))
        for x, low, high in zip(theta, demands.lower, demands.upper, strict=True)
    )


class _Slopes:
    """φ_θ over a cell of a box's parameters and its tube."""

    def __init__(self, closures: BallClosures, document: ClaimedDocument, box: Box, cell: Cell) -> None:
        self.document, self.size = document, closures.n_free
        middle = 0.5 * (cell[0] + cell[1])
        start = (box.directions * exact(middle)).entries()
        theta = [x + d for x, d in zip(box.centre, start, strict=True)]
        around = closures.motions(_reached(box, *cell))
        self.middle, self.plain = closures.jacobian(closures.motions(theta)), closures.jacobian(around)
        ends = zip(middle, *cell, strict=True)
        widths = [arb(0, float(np.nextafter(max(b - x, x - a), np.inf))) for x, a, b in ends]
        widths += [arb(0, float(r.upper())) for r in box.radius]
        self.bends = [(closures.variation(around, move), w) for move, w in zip(moves_of(box), widths, strict=True)]

    def between(self, gain: arb_mat, right: arb_mat) -> arb_mat:
        """Ã φ_θ B."""
        total = gain * self.middle * right
        for bend, width in self.bends:
            total = total + gain * bend * right * width
        plain = gain * self.plain * right
        entries = [a if a.rad() <= b.rad() else b for a, b in zip(total.entries(), plain.entries(), strict=True)]
        return arb_mat(total.nrows(), total.ncols(), entries)

    def chosen(self, which: Integers) -> arb_mat:
        """B that chooses columns."""
        return exact(np.eye(self.size)[:, which])


def _holds(slopes: _Slopes, demands: ClaimedRequirements) -> bool:
    """1 and, where it is asked for, dexterity, over a cell."""
    others = np.setdiff1d(np.arange(slopes.size), demands.driven)
    gain = inverse_of(floats(columns(slopes.middle, others)))
    if gain is None or not contracts(defect(slopes.between(gain, slopes.chosen(others)))):
        return False
    if demands.dexterity == 0.0:
        return True
    found = _derivative(slopes)
    return found is not None and _dexterous(demands, slopes.document, *found)


def _derivative(slopes: _Slopes) -> tuple[Array, Array] | None:
    """X and T of 2."""
    document = slopes.document
    gain = inverse_of(floats(columns(slopes.middle, document.dependent)))
    if gain is None:
        return None
    shrunk = defect(slopes.between(gain, slopes.chosen(document.dependent)))
    if not contracts(shrunk):
        return None
    X = floats(-(gain * columns(slopes.middle, document.independent)))
    along = np.zeros((slopes.size, X.shape[1]))
    along[document.independent], along[document.dependent] = np.eye(X.shape[1]), X
    residual = slopes.between(gain, exact(along)).entries()
    first = np.array([above(abs(x)) for x in residual]).reshape(X.shape)
    rough = np.array([[above(abs(x)) for x in row] for row in shrunk])
    T = np.linalg.solve(np.eye(len(rough)) - rough, first) * _ROOM + _LEAST
    if not (np.all(np.isfinite(T)) and np.all(T > 0.0)):
        return None
    carried = exact(first) + exact(rough) * exact(T)
    if not all(carried[i, j] <= arb(float(T[i, j])) for i in range(T.shape[0]) for j in range(T.shape[1])):
        return None
    return X, T


def _dexterous(demands: ClaimedRequirements, document: ClaimedDocument, X: Array, T: Array) -> bool:
    """Whether 1/κ is what is asked for, by 3."""
    n_free = len(document.independent) + len(document.dependent)
    whole, spread = np.zeros((2, n_free, len(document.independent)))
    whole[document.independent], whole[document.dependent] = np.eye(len(document.independent)), X
    spread[document.dependent] = T
    per = [arb(1) / arb(float(unit)) for unit in demands.units]
    K, error = (_scaled(part[demands.driven], per) for part in (whole, spread))
    U, S, Vt = np.linalg.svd(floats(K))
    u, v = (size_of(exact(Q.T) * exact(Q) - exact(np.eye(len(S)))) for Q in (U, Vt.T))
    g, e = size_of(exact(U.T) * K * exact(Vt.T) - exact(np.diag(S))), size_of(error)
    if not (u < 1 and v < 1):
        return False
    least = (arb(float(S.min())) - g) / ((1 + u) * (1 + v)).sqrt() - e
    most = (arb(float(S.max())) + g) / ((1 - u) * (1 - v)).sqrt() + e
    return bool(least >= arb(demands.dexterity) * most)


def _scaled(matrix: Array, per: list[arb]) -> arb_mat:
    """A matrix, each column multiplied by a number."""
    rows, cols = matrix.shape
    return arb_mat(rows, cols, [arb(float(matrix[i, j])) * per[j] for i in range(rows) for j in range(cols)])
