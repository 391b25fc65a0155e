"""Taylor bounds where they are attained: cubic maps, of which every bound's sharp value is known.

G = −(c + Jx + ½ Hxx + ⅙ Txxx) + x_M, its coefficients nonnegative and x_M the last M unknowns, E its columns. Then
f(δ, 0) and I − f_ζ are sums of nonnegative terms that are largest at the corner δ = h, ζ = R: Y, Z(R)w and Z̄(R)R are
values of the map there, neither more nor less.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof import taylor
from ccpin.proof.bounds import Frame
from ccpin.proof.newton import Boxes, holds
from ccpin.proof.taylor import Pattern, Point, selected, taylor_bounds

N, M, P = 5, 2, 3


class Exact:
    """T(x, y, z) = |A|T[x, y, z] of a cubic's third derivative, whatever the box."""

    def __init__(self, gain, third):
        self.third = np.abs(np.einsum("bij,jklm->biklm", gain, third))

    def over(self, box):
        assert np.all(box >= 0.0)
        return lambda x, y, z: np.einsum("biklm,bk,bl,bm->bi", self.third, x, y, z)

    def take(self, rows):
        other = Exact.__new__(Exact)
        other.third = self.third[rows]
        return other


class Cubic:
    """The map, with coefficients symmetric in what they are multiplied with."""

    def __init__(self, rng):
        self.c, self.J = rng.uniform(0.0, 0.1, M), rng.uniform(0.0, 0.1, (M, N))
        H, T = rng.uniform(0.0, 0.1, (M, N, N)), rng.uniform(0.0, 0.1, (M, N, N, N))
        self.H = H + np.swapaxes(H, 1, 2)
        self.T = sum(
            np.transpose(T, (0, *order)) for order in ((1, 2, 3), (1, 3, 2), (2, 1, 3), (2, 3, 1), (3, 1, 2), (3, 2, 1))
        )

    def __call__(self, x):
        H, T = self.H, self.T
        total = self.c + self.J @ x + 0.5 * np.einsum("ijk,j,k", H, x, x) + np.einsum("ijkl,j,k,l", T, x, x, x) / 6.0
        return x[N - M :] - total

    def slope(self, x):
        """∂G/∂ζ."""
        return np.eye(M) - (self.J + self.H @ x + 0.5 * np.einsum("ijkl,k,l", self.T, x, x))[:, N - M :]

    def point(self, rounding=0.0, off=0.0):
        """G and its derivatives at 0, every entry off by so much."""
        first, other = np.triu_indices(N)
        second = -self.H[:, first, other].reshape(-1, 1)
        pattern = Pattern(np.repeat(np.arange(M), len(first)), np.tile(np.arange(len(first)), M), first, other, N)
        slope = np.eye(N)[N - M :] - self.J
        return Point(-self.c[None] + off, slope[None] + off, second + off, pattern, np.array([rounding]))


def frame_of(half, modes=None):
    """A = I, D the first P unknowns, E the last M ones."""
    E = np.eye(N)[None, :, P:] if modes is None else modes
    return Frame(np.eye(M)[None], np.eye(N)[None, :, :P], E, half[None], np.zeros(1))


def bounds_of(cubic, half, rounding=0.0, off=0.0):
    frame = frame_of(half)._replace(rounding=np.array([rounding]))
    return taylor_bounds(cubic.point(rounding, off), frame, Exact(frame.preconditioner, cubic.T))


@pytest.fixture(params=range(4))
def drawn(request):
    rng = np.random.default_rng(request.param)
    return Cubic(rng), rng.uniform(0.1, 1.0, P), rng.uniform(0.1, 1.0, M), rng.uniform(0.1, 1.0, M)


def test_every_bound_is_attained(drawn):
    """At the corner, to rounding, and not below it."""
    cubic, half, radius, weight = drawn
    bounds = bounds_of(cubic, half)
    base, corner = np.append(half, np.zeros(M)), np.append(half, radius)
    np.testing.assert_allclose(bounds.y[0], -cubic(base), rtol=1e-13)
    shrunk = bounds.contraction(radius[None]).of(weight[None])[0]
    np.testing.assert_allclose(shrunk, (np.eye(M) - cubic.slope(corner)) @ weight, rtol=1e-13)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    mean = sum(
        0.5 * w * (np.eye(M) - cubic.slope(np.append(half, 0.5 * (1 + t) * radius)))
        for t, w in zip(nodes, weights, strict=True)
    )
    np.testing.assert_allclose(bounds.mean(radius[None]).of(radius[None])[0], mean @ radius, rtol=1e-13)
    change = np.einsum("ijk,j,k", cubic.H[:, P:, P:], weight, weight)
    change += np.einsum("ijkl,j,k,l", cubic.T[:, :, P:, P:], corner, weight, weight)
    np.testing.assert_allclose(bounds.curvature(radius[None], weight[None])[0], change, rtol=1e-13)


def test_modes_of_any_kind_are_bounded_as_selected_ones_are(drawn):
    """The same columns, told apart by one entry that hardly matters; some of the boxes are some of the bounds."""
    cubic, half, radius, weight = drawn
    modes = np.tile(np.eye(N)[None, :, P:], (2, 1, 1))
    modes[1, 0, 0] = 1e-300
    frame = Frame(*(np.tile(array, (2,) + (1,) * (array.ndim - 1)) for array in frame_of(half)))._replace(modes=modes)
    assert selected(modes) is None
    assert selected(modes[:1]).tolist() == [3, 4]
    point = cubic.point()
    twice = point._replace(
        value=np.tile(point.value, (2, 1)),
        slope=np.tile(point.slope, (2, 1, 1)),
        second=np.tile(point.second, (1, 2)),
        rounding=np.zeros(2),
    )
    other, one = taylor_bounds(twice, frame, Exact(frame.preconditioner, cubic.T)), bounds_of(cubic, half)
    for k in range(2):
        some = other.take(np.array([k]))
        np.testing.assert_allclose(some.y, one.y, rtol=1e-13)
        for name in ("mean", "contraction"):
            np.testing.assert_allclose(
                getattr(some, name)(radius[None]).of(weight[None]),
                getattr(one, name)(radius[None]).of(weight[None]),
                rtol=1e-13,
            )
        np.testing.assert_allclose(
            some.curvature(radius[None], weight[None]), one.curvature(radius[None], weight[None]), rtol=1e-13
        )
    np.testing.assert_allclose(
        one.take(np.array([0])).contraction(radius[None]).matrix,
        one.contraction(radius[None]).matrix,
    )


@pytest.mark.parametrize("swapped", [[3, 3], [4, 3]])
def test_selected_modes_may_be_in_any_order_but_not_twice(drawn, swapped):
    """Columns that are the same coordinate select nothing."""
    modes = np.eye(N)[None][:, :, swapped]
    found = selected(modes)
    assert (None if found is None else found.tolist()) == (None if swapped == [3, 3] else swapped)


@pytest.mark.parametrize("rounding", [1e-3, 0.1])
def test_what_a_jet_may_be_off_by_is_bounded(drawn, rounding):
    """The map that is told is off by exactly its rounding in every entry, to the side where it hides most."""
    cubic, half, radius, weight = drawn
    bounds = bounds_of(cubic, half, rounding, off=rounding)
    base, corner = np.append(half, np.zeros(M)), np.append(half, radius)
    assert np.all(bounds.y[0] >= -cubic(base) * (1 - 1e-13))
    shrunk = bounds.contraction(radius[None]).of(weight[None])[0]
    assert np.all(shrunk >= ((np.eye(M) - cubic.slope(corner)) @ weight) * (1 - 1e-13))


def test_at_a_point_the_rounding_is_attained():
    """No parameters: Y = |AG| + |A|1 ρ."""
    cubic = Cubic(np.random.default_rng(9))
    frame = Frame(
        2.0 * np.eye(M)[None], np.zeros((1, N, 0)), np.eye(N)[None, :, P:], np.zeros((1, 0)), np.array([1e-3])
    )
    bounds = taylor_bounds(cubic.point(1e-3), frame, Exact(frame.preconditioner, cubic.T))
    np.testing.assert_allclose(bounds.y[0], 2.0 * (cubic.c + 1e-3), rtol=1e-14)


def test_theorem_n_at_equality():
    """x = c + ½x² in one unknown: |ζ| ≤ R holds a zero by (N1) if c + ½R² < R, and but one by (N2) if Rw ≤ κw."""
    pattern = Pattern(np.zeros(1, int), np.zeros(1, int), np.zeros(1, int), np.zeros(1, int), 1)
    point = Point(np.array([[-0.375]]), np.eye(1)[None], np.array([[-1.0]]), pattern, np.zeros(1))
    frame = Frame(np.eye(1)[None], np.zeros((1, 1, 0)), np.eye(1)[None], np.zeros((1, 0)), np.zeros(1))
    bounds = taylor_bounds(point, frame, SimpleNamespace(over=lambda box: lambda x, y, z: 0.0 * x))
    one = np.ones((1, 1))

    def box(radius, kappa):
        return Boxes(
            np.zeros((1, 1)),
            np.zeros((1, 0)),
            np.zeros((1, 1, 0)),
            one[None],
            one[None],
            radius * one,
            one,
            np.array([kappa]),
        )

    for radius, kappa, proved in (
        (0.5, 0.75, False),  # c + ½R² = R
        (0.5 + 1e-9, 0.75, True),
        (0.5 - 1e-9, 0.75, False),
        (0.75, 0.75 + 1e-9, True),
        (0.75, 0.75, False),  # Rw = κw, and the slack
        (0.75, 0.75 - 1e-9, False),
        (1.5, 1.0, False),
    ):
        assert holds(bounds, box(radius, kappa)).proved[0] == proved
    assert holds(bounds, box(0.75, 0.8)).image[0, 0] == 0.5 * 0.75**2


@pytest.mark.parametrize("chosen", [(0, 1), (1, 0), (2, 1), (2, 0)])
def test_selected_coordinates_are_as_any_modes(chosen):
    """Wherever among the unknowns they are: what pairs one of them with another coordinate is left out."""
    rng = np.random.default_rng(9)
    first, other = np.triu_indices(3)
    pattern = Pattern(np.repeat(np.arange(2), 6), np.tile(np.arange(6), 2), first, other, 3)
    point = Point(np.zeros((1, 2)), np.zeros((1, 2, 3)), rng.normal(size=(12, 1)), pattern, np.zeros(1))
    modes = np.eye(3)[:, list(chosen)][None]
    frame = Frame(rng.normal(size=(1, 2, 2)), np.zeros((1, 3, 1)), modes, np.zeros((1, 1)), np.zeros(1))
    radius = rng.uniform(1.0, 2.0, (1, 2))
    found = taylor._selected(point, frame, selected(modes)).times(radius)
    np.testing.assert_allclose(found, taylor._mixed(point, frame).times(radius), rtol=1e-13)
