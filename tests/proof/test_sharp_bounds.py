"""Bounds where they are sharp: against the sums their theorems state, added up one by one, and at equality.

No robot is solved here. The numbers are random, so that every term counts, roundings are taken as large as the rest,
and a bound that is a part in 1e12 off, to either side, is noticed.
"""

from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof.bounds import Contraction, Image
from ccpin.proof.chains import ChainStack
from ccpin.proof.equations import Derivatives, Problem, third_bound
from ccpin.proof.newton import Boxes, encloses, frame_of, holds, noise_of, without_turns
from ccpin.proof.reach_bounds import ChainLengths, ReachDrift, chain_reach
from ccpin.proof.rounding import blur, widened
from ccpin.proof.taylor import Pattern, Point, taylor_bounds
from ccpin.proof.tips import by_joint
from tests.support.straight import assert_bounds_are, random_frame

N, M, P = 5, 2, 3  # n′, m and the parameters of a box


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def stack_of(rng):
    """Two chains in five coordinates: a point's, with a slide, and a direction's, padded on the root side."""
    joints = np.array([[0, 1, 2, 3], [N, 0, 3, 4]])
    turning = np.array([[1.0, 0, 1, 1], [0, 1, 1, 1]])
    sliding = np.array([[0.0, 1, 0, 0], [0, 0, 0, 0]])
    return ChainStack(
        joints=joints,
        placement=np.eye(N + 1)[joints.ravel(), :N],
        rotations=np.tile(np.eye(3), (2, 4, 1, 1)),
        translations=rng.normal(size=(2, 4, 3)),
        axes=rng.normal(size=(2, 4, 3)),
        turning=turning,
        sliding=sliding,
        tips=rng.normal(size=(2, 3)),
        points=np.array([1.0, 0.0]),
        weights=rng.normal(size=(2, M, 3)),
    )


def case(rng, size=0.3):
    """A stack, a centre, derivatives there and a frame, all of random numbers, for one box."""
    stack = stack_of(rng)
    theta = rng.normal(size=(1, N))
    hessian = rng.normal(size=(1, M, N, N))
    values = Derivatives(
        rng.normal(size=(1, M)),
        rng.normal(size=(1, M, N)),
        hessian + np.swapaxes(hessian, 2, 3),
        rng.uniform(0.2, 3.0, (1, 2, 4)),
    )
    return stack, theta, values, random_frame(rng, N, P, M, size)


def taylor(stack, theta, values, frame):
    """The bounds of `case`: all entries of φ_θθ, and third derivatives from the chains' lengths."""
    first, other = np.triu_indices(N)
    pattern = Pattern(np.repeat(np.arange(M), len(first)), np.tile(np.arange(len(first)), M), first, other, N)
    second = values.hessian[0][:, first, other].reshape(-1, 1)
    point = Point(values.phi, values.jacobian, second, pattern, frame.rounding)
    lengths, arms = ChainLengths.of(stack), np.transpose(values.arms, (2, 1, 0))
    gains = np.swapaxes(np.linalg.norm(frame.preconditioner[:, None] @ stack.weights, axis=3), 1, 2)
    drift = ReachDrift(lengths, gains, by_joint(lengths.joints, np.abs(theta)), arms, frame.rounding)
    return taylor_bounds(point, frame, drift)


def lengths_of(stack, values, theta, box, rounding):
    """ρ of every joint, by its definition: of the lengths deeper than it, and of its arm with what those may move."""
    reach = np.zeros((2, 4))
    for c in range(2):
        tip = np.linalg.norm(stack.tips[c])
        for j in reversed(range(4)):
            deeper = range(j + 1, 4)
            at = [stack.joints[c, k] for k in range(4)]
            travel = {k: stack.sliding[c, k] * (abs(theta[at[k]]) + box[at[k]]) for k in range(j, 4) if at[k] < N}
            links = sum(np.linalg.norm(stack.translations[c, k]) for k in deeper)
            whole = tip + stack.points[c] * (links + sum(travel.values()))
            drift = sum(reach[c, k] * box[at[k]] for k in deeper)
            if stack.turning[c, j]:
                reach[c, j] = min(whole, values.arms[0, c, j] + rounding + drift)
            else:
                reach[c, j] = stack.sliding[c, j] * stack.points[c]
    return reach


def third(stack, reach, x, y, z):
    """T_c(x, y, z) = Σ ρ_l x_i y_j z_k, l the deepest, the other two turning."""
    total = np.zeros(2)
    for c, (i, j, k) in product(range(2), product(range(4), repeat=3)):
        first, second, deepest = sorted((i, j, k))
        at = stack.joints[c]
        if max(at[[i, j, k]]) < N and stack.turning[c, first] * stack.turning[c, second]:
            total[c] += reach[c, deepest] * x[at[i]] * y[at[j]] * z[at[k]]
    return total


class Stated:
    """Y, Z and Z̄ as `bounds` states them, entry by entry."""

    def __init__(self, stack, theta, values, frame):
        self.stack, self.theta, self.values, self.frame = stack, theta[0], values, frame
        self.A, self.D, self.E, self.h = (a[0] for a in frame[:4])
        self.u = frame.rounding[0]
        self.moves = np.abs(self.D) @ self.h
        self.gains = np.array([[np.linalg.norm(self.A[i] @ w) for w in stack.weights] for i in range(M)])
        self.bent = np.einsum("ij,jab->iab", self.A, values.hessian[0])
        self.margin = np.abs(self.A).sum(axis=1) * self.u

    def third(self, box, x, y, z):
        reach = lengths_of(self.stack, self.values, self.theta, box, self.u)
        return self.gains @ third(self.stack, reach, x, y, z)

    def y(self):
        A, D, h, L = self.A, self.D, self.h, self.moves
        line = np.abs(A @ self.values.phi[0]) + np.abs(A @ self.values.jacobian[0] @ D) @ h
        square = 0.5 * np.einsum("k,ikl,l->i", h, np.abs(np.einsum("ak,iab,bl->ikl", D, self.bent, D)), h)
        return line + square + self.third(L, L, L, L) / 6 + self.margin * (1 + L.sum()) ** 2

    def line(self, radius, share):
        """|I − Ãφ_θE| with its rounding, and |N|(h, share R)."""
        E, widths = self.E, np.abs(self.E) @ radius
        plain = np.abs(np.eye(M) - self.A @ self.values.jacobian[0] @ E)
        size = 1 + (self.moves + widths).sum()
        rounding = np.outer(self.margin, np.abs(E).sum(axis=0)) * size
        N_ = np.abs(np.einsum("ak,iab,bl->ikl", E, self.bent, np.column_stack([self.D, E])))
        return plain + rounding + N_ @ np.concatenate([self.h, share * radius])

    def contraction(self, radius, weight):
        box = self.moves + np.abs(self.E) @ radius
        return self.line(radius, 1.0) @ weight + 0.5 * self.third(box, box, box, np.abs(self.E) @ weight)

    def mean(self, radius):
        L, r = self.moves, np.abs(self.E) @ radius
        cubic = self.third(L + r, L, L, r) + self.third(L + r, L, r, r) + self.third(L + r, r, r, r) / 3
        return self.line(radius, 0.5) @ radius + 0.5 * cubic

    def curvature(self, radius, weight):
        box, turn = self.moves + np.abs(self.E) @ radius, np.abs(self.E) @ weight
        second = np.abs(np.einsum("ak,iab,bl->ikl", self.E, self.bent, self.E)) @ weight @ weight
        return second + self.third(box, box, turn, turn) + self.margin * turn.sum() ** 2


@pytest.mark.parametrize("size", [0.03, 0.3, 2.0])
def test_reach_bounds_are_the_sums_that_the_theorem_states(rng, size):
    for _ in range(4):
        given = case(rng, size)
        bounds, stated = taylor(*given), Stated(*given)
        assert_bounds_are(bounds, stated, size * rng.uniform(0.1, 1, M), rng.uniform(0.1, 1, M), 1e-12)


def test_reach_is_attained_by_a_stretched_chain():
    """Three unit links in a line: the tip is 3, 2 and 1 m from their joints, and no further wherever they turn."""
    stack = stack_of(np.random.default_rng(0))._replace(
        joints=np.array([[0, 1, 2]]),
        rotations=np.tile(np.eye(3), (1, 3, 1, 1)),
        axes=np.tile([0.0, 0, 1], (1, 3, 1)),
        turning=np.ones((1, 3)),
        sliding=np.zeros((1, 3)),
        translations=np.array([[[0.0, 0, 0], [1, 0, 0], [1, 0, 0]]]),
        tips=np.array([[1.0, 0, 0]]),
        points=np.array([1.0]),
    )
    found = chain_reach(stack, np.array([[[3.0, 2, 1]]]), np.zeros((1, 1, 3)), np.ones((1, 1, 3)), np.array([0.1]))
    np.testing.assert_allclose(found, [[[3.0, 2, 1]]], rtol=1e-15)


class Fixed:
    """Bounds that are told: Y, and Z̄ and Z that are multiples of I."""

    def __init__(self, y, mean, slope):
        self.y, self._mean, self._slope = np.array([[y]]), mean, slope

    def mean(self, radius):
        return Image(np.array([[[self._mean]]]), np.zeros((1, 1)))

    def contraction(self, radius):
        return Contraction(np.array([[[self._slope]]]), np.zeros_like)


def box_of(radius=1.0, weight=1.0, kappa=0.5):
    one = np.ones((1, 1, 1))
    return Boxes(
        np.zeros((1, 2)), np.full((1, 1), 0.5), np.ones((1, 2, 1)), one, one,
        np.array([[radius]]), np.array([[weight]]), np.array([kappa]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("y", "mean", "slope", "kappa", "proved"),
    [
        (0.25, 0.5, 0.1, 0.5, True),
        (0.5 - 2e-10, 0.5, 0.1, 0.5, True),
        (0.5 - 0.5e-10, 0.5, 0.1, 0.5, False),  # within the room for rounding
        (0.5, 0.5, 0.1, 0.5, False),  # the image touches the tube's end
        (0.1, 0.2, 0.5 * (1 - 2e-10), 0.5, True),
        (0.1, 0.2, 0.5 * (1 - 0.5e-10), 0.5, False),
        (0.1, 0.2, 0.9, 1.0, False),
        (0.1, 0.2, 0.9, 0.95, True),
        (0.1, np.nan, 0.1, 0.5, False),
        (0.1, 0.2, np.nan, 0.5, False),
        (-np.inf, 0.2, 0.1, 0.5, False),
    ],
)
def test_theorem_n_is_checked_at_equality(y, mean, slope, kappa, proved):
    checked = holds(Fixed(y, mean, slope), box_of(kappa=kappa))
    assert checked.proved[0] == proved
    np.testing.assert_array_equal(checked.image, [[mean]])


@pytest.mark.parametrize(("weight", "slope"), [(0.0, -1.0), (0.0, 0.0), (-1.0, 0.6)])
def test_theorem_n_asks_for_positive_weights(weight, slope):
    assert not holds(Fixed(0.1, 0.2, slope), box_of(weight=weight)).proved[0]


@pytest.fixture
def alone():
    """A system of one row and two coordinates, y = q, as far as tubes and gluing look at it."""
    system = SimpleNamespace(
        dependent=np.array([1]), independent=np.array([0]), periodic=np.array([False, True]), m=1, n=1, rounding=1e-3,
        magnitude=lambda theta: 2.0 + np.abs(theta).sum(axis=1),
    )  # fmt: skip
    return Problem(system, None, None)


@pytest.mark.parametrize("turns", [0, 1, -3])
@pytest.mark.parametrize(
    ("gap", "error", "modes", "held"),
    [
        (0.5, 0.4999, None, True),
        (0.5, 0.5001, None, False),
        (-0.5, 0.4999, None, True),
        (-0.5, 0.5001, None, False),
        (0.999, 0.0, None, True),
        (1.001, 0.0, None, False),
        (0.0, 0.999, None, True),
        (0.0, 1.001, None, False),
        (0.0, 2.001, 0.5, False),
        (0.0, 1.999, 0.5, True),
        (1.0 - 1e-10, 0.0, None, False),
        (1.0 - 2e-10, 0.0, None, True),
    ],
)
def test_a_ball_that_just_touches_the_end_of_a_tube(alone, turns, gap, error, modes, held):
    """A solution is in a tube only with all of its error: |ζ| + error ≤ R, modulo a turn."""
    theta = np.array([[0.25, 0.25 + gap + 2 * np.pi * turns]])
    if turns and abs(gap) > 0.9999 and abs(gap) < 1.0001:
        return  # a turn's own rounding is more than what is asked here
    modes = None if modes is None else np.full((1, 1, 1), modes)
    found = encloses(alone, box_of(), np.array([[0.25]]), theta, np.array([[error]]), modes)
    assert found[0] == held


def test_a_tube_of_other_modes_is_measured_in_them(alone):
    """Modes of length 4: |ζ| is a quarter of the gap, and so is the error."""
    box = box_of()._replace(modes=np.full((1, 1, 1), 4.0))
    for gap, error, held in ((2.0, 1.999, True), (2.0, 2.001, False), (0.0, 3.999, True), (0.0, 4.001, False)):
        assert encloses(alone, box, np.zeros((1, 1)), np.array([[0.0, gap]]), np.array([[error]]))[0] == held


def test_gluing_keeps_room_for_the_rounding_of_far_coordinates(alone):
    """1e-13 (1 + |θ|), in the tube's modes: at 1e6 that is 1e-7 of what a tube of radius 1 may be filled with."""
    system = SimpleNamespace(**{**vars(alone.system), "periodic": np.array([False, False])})
    box = box_of()._replace(centre=np.array([[0.0, 1e6]]))
    for error, held in ((1 - 1.002e-7, True), (1 - 0.998e-7, False)):
        got = encloses(Problem(system, None, None), box, np.zeros((1, 1)), np.array([[0.0, 1e6]]), np.array([[error]]))
        assert got[0] == held


def test_gluing_keeps_room_for_the_rounding_of_near_coordinates(alone):
    """At 0 it is 1e-13: a tenth of a tube of radius 1e-12."""
    box = box_of(radius=1e-12)
    for error, held in ((0.899e-12, True), (0.901e-12, False)):
        assert encloses(alone, box, np.zeros((1, 1)), np.zeros((1, 2)), np.array([[error]]))[0] == held


def test_gluing_keeps_room_for_what_a_point_of_q_may_be_off_by(alone):
    """4u |D| at δ = 0: with a slope of 1000 that is 4.4e-13."""
    box = box_of(radius=1e-12)._replace(directions=np.array([[[1.0], [-1e3]]]))
    for error, held in ((0.45e-12, True), (0.46e-12, False)):
        assert encloses(alone, box, np.zeros((1, 1)), np.zeros((1, 2)), np.array([[error]]))[0] == held


def test_gaps_without_turns_are_at_most_half_a_turn():
    gap = np.array([[3.0, 3.0], [3.2, 3.2], [2 * np.pi, 2 * np.pi], [-10.0, -10.0]])
    found = without_turns(gap, np.array([True, False]))
    np.testing.assert_allclose(found[:, 0], [3.0, 3.2 - 2 * np.pi, 0.0, -10.0 + 4 * np.pi], atol=1e-14)
    np.testing.assert_array_equal(found[:, 1], gap[:, 1])


def equations_of(system):
    """As far as frames and roundings ask."""
    return SimpleNamespace(system=system, rounding=lambda theta: system.rounding * system.magnitude(theta))


def test_the_rounding_of_f_is_that_of_the_farthest_point_of_the_tube(alone):
    """|Ã| γ magnitude(|θ_c| + |D|h + |E|R): here 3 · 1e-3 · (2 + (1 + 0.5) + (2 + 0.5 + 4))."""
    box = box_of(radius=4.0)._replace(centre=np.array([[1.0, -2.0]]), preconditioner=np.full((1, 1, 1), -3.0))
    np.testing.assert_allclose(noise_of(equations_of(alone.system), box), [[3e-3 * 10.0]], rtol=1e-14)


def test_boxes_are_bounded_as_widened():
    """h is widened by more than a corner's rounding before anything is bounded."""
    system = SimpleNamespace(
        dependent=np.array([1]), independent=np.array([0]), m=1, n=1, rounding=1e-3, magnitude=lambda t: np.full(1, 7.0)
    )
    box = box_of()._replace(centre=np.array([[-1e3, 5.0]]))
    frame = frame_of(equations_of(system), box)
    np.testing.assert_array_equal(frame.half, widened(np.array([[1e3]]), box.half))
    assert frame.rounding[0] == 7.0e-3
    np.testing.assert_array_equal(frame.modes[0], [[0.0], [1.0]])
    np.testing.assert_array_equal(frame.preconditioner, box.preconditioner)


@pytest.mark.parametrize(("centre", "half"), [(0.0, 2.0**-60), (1024.0, 2.0**-60), (-1024.0, 2.0**-60), (0.0, 64.0)])
def test_boxes_are_widened_by_the_roundings_that_the_lemma_counts(centre, half):
    """1e-14 + 4u(|c| + h), within the rounding of the sum."""
    more = Fraction(float(widened(np.array(centre), np.array(half)))) - Fraction(half)
    stated = Fraction(1e-14) + 4 * Fraction(1, 2**53) * (abs(Fraction(centre)) + Fraction(half))
    assert abs(more - stated) <= Fraction(np.spacing(half)) + stated / 1000


@pytest.mark.parametrize("x", [0.0, 3.0, -1e6])
def test_a_point_asked_about_may_be_off_by_its_roundings(x):
    np.testing.assert_allclose(blur(np.array(x)), 2.0**-51 * (1 + abs(x)), rtol=1e-12)


def test_third_derivatives_are_bounded_by_the_longest_reach_of_each_chain(rng):
    stack, theta, values, _ = case(rng)
    box = rng.uniform(0.1, 1, N)
    system = SimpleNamespace(rounding=1e-2, magnitude=lambda t: 1 + t.sum(axis=1))
    found = third_bound(Problem(system, stack, None), theta, values.arms, box[None])
    reach = lengths_of(stack, values, theta[0], box, 1e-2 * (1 + (np.abs(theta[0]) + box).sum()))
    stated = sum(np.linalg.norm(stack.weights[c], axis=1) * reach[c].max() for c in range(2))
    np.testing.assert_allclose(found[0], stated, rtol=1e-12)
