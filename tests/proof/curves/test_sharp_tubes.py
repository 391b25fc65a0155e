"""Theorem R's bounds against the sums that it states, and its inequality at equality."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof.curves import tubes as module
from ccpin.proof.curves.curve_equations import Drift, Values
from ccpin.proof.curves.tubes import Frames, TubeBounds, _room, bounds_of, certify_tubes

SIZE, M, ALONG = 3, 2, 1  # n′, m and the coordinate j that a tube runs along
N, ROWS = SIZE + M, 2 * M


def case(rng):
    values = Values(
        rng.normal(size=(1, SIZE)), rng.normal(size=(1, M)), rng.normal(size=(1, M)), rng.normal(size=(1, ROWS)),
        rng.normal(size=(1, ROWS, N)), rng.normal(size=(1, ROWS, N, N)), np.zeros((1, 1, 1)), np.array([0.05]),
    )  # fmt: skip
    bend = values.bend + np.swapaxes(values.bend, 2, 3)
    tangent, gain = rng.uniform(-1, 1, (1, N)), rng.normal(size=(1, N, ROWS))
    tangent[0, ALONG], gain[0, ALONG] = -1.0, 0.0
    radius = rng.uniform(0.1, 0.5, (1, N))
    radius[0, ALONG] = 0.0
    off = Drift(rng.uniform(0.1, 1, (1, ROWS)), rng.uniform(0.1, 1, (1, ROWS)))
    return values._replace(bend=bend), Frames(np.array([ALONG]), tangent, gain), np.array([0.4]), radius, off


@pytest.mark.parametrize("seed", range(4))
def test_tubes_bounds_are_the_sums_that_the_theorem_states(monkeypatch, seed):
    values, frames, half, radius, off = case(np.random.default_rng(seed))
    boxes = []
    monkeypatch.setattr(module, "drift", lambda problem, values, box: boxes.append(box) or off)
    problem = SimpleNamespace(system=SimpleNamespace(n_free=SIZE))
    found = bounds_of(problem, values, frames, half, radius)
    P, t, R, d = frames.gain[0], frames.tangent[0], radius[0], half[0]
    L, C = np.abs(t) * d, np.einsum("ij,jab->iab", P, values.bend[0])
    X, noise = L + R, np.abs(P).sum(axis=1) * 0.05
    turn, spread = L[:SIZE].sum(), L[SIZE:].sum()
    D_LL = off.turned[0] * turn**2 + 2 * off.mixed[0] * turn * spread
    y = np.abs(P @ values.value[0]) + np.abs(P @ values.slope[0] @ t) * d
    y += 0.5 * np.abs(np.einsum("iab,a,b->i", C, t, t)) * d**2
    y += 0.5 * np.abs(P) @ D_LL + noise * (1 + L.sum()) ** 2
    z = np.abs(np.eye(N) - P @ values.slope[0]) + np.abs(np.einsum("iab,a->ib", C, t)) * d
    z += np.einsum("a,iab->ib", R, np.abs(C)) + noise[:, None] * (1 + X.sum())
    by_theta = off.turned[0] * X[:SIZE].sum() + off.mixed[0] * X[SIZE:].sum()
    z[:, :SIZE] += (np.abs(P) @ by_theta)[:, None]
    z[:, SIZE:] += (np.abs(P) @ (off.mixed[0] * X[:SIZE].sum()))[:, None]
    z[ALONG], z[:, ALONG], y[ALONG] = 0.0, 0.0, 0.0
    np.testing.assert_allclose(found.y[0], y, rtol=1e-11)
    np.testing.assert_allclose(found.z[0], z, rtol=1e-11)
    np.testing.assert_allclose(boxes[0][0], X, rtol=1e-11)


def test_tubes_are_bounded_as_widened(monkeypatch):
    """L, X and δ are taken 1e-13 (1 + |x|) larger, and 4 roundings of δ."""
    values, frames, _, _, off = case(np.random.default_rng(0))
    zero = {name: np.zeros_like(getattr(values, name)) for name in ("value", "slope", "bend", "rounding")}
    values = values._replace(theta=np.array([[0.0, 0.0, 3.0]]), kernel=np.zeros((1, M)), **zero)
    slope = np.zeros((1, ROWS, N))
    gain = np.zeros((1, N, ROWS))
    slope[0, 0, 0], gain[0, 2, 0], frames.tangent[0, 0] = 1.0, 1.0, 1.0
    boxes = []
    off = Drift(np.zeros((1, ROWS)), np.zeros((1, ROWS)))
    monkeypatch.setattr(module, "drift", lambda problem, values, box: boxes.append(box) or off)
    problem, frames = SimpleNamespace(system=SimpleNamespace(n_free=SIZE)), frames._replace(gain=gain)
    for half in (0.0, 2.0**20):
        found = bounds_of(problem, values._replace(slope=slope), frames, np.array([half]), np.zeros((1, N)))
        more = found.y[0, 2] - half
        assert more == pytest.approx(4e-13 + half * 2.0**-50, rel=0.05 if half == 0.0 else 0.3, abs=0.0)
    np.testing.assert_allclose(_room(np.array([0.0, -3.0])), [1e-13, 4e-13], rtol=1e-12)
    assert boxes[0][0, 2] == pytest.approx(4e-13 * (1 + abs(frames.tangent[0, 2])), rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("y", "z", "proved"),
    [
        (0.5 * (1 - 3e-10), 0.5, True),
        (0.5, 0.5, False),
        (0.5 * (1 - 1e-10), 0.5, False),
        (0.0, 0.999, True),
        (-1.0, 1.001, False),
        (-1.0, 1 - 0.5e-10, False),
        (0.1, np.nan, False),
    ],
)
def test_theorem_r_is_checked_at_equality(monkeypatch, y, z, proved):
    """Y + ZR < R in all rows but j, and what is left of the radii is the hull."""
    bounds = TubeBounds(np.array([[y, 9.0]]), np.array([[[z, 0.0], [0.0, 9.0]]]))
    monkeypatch.setattr(module, "bounds_of", lambda *_: bounds)
    values = Values(*(np.zeros((1, 1)) for _ in Values._fields))
    frames = Frames(np.array([1]), np.ones((1, 2)), np.zeros((1, 2, 1)))
    found = certify_tubes(None, values, frames, np.ones(1), np.array([[1.0, 0.0]]))
    assert found.proved[0] == proved
    if proved and y > 0:
        assert found.tubes.kappa[0] == pytest.approx(z * (1 + 1e-10), rel=1e-14)
        hull = 1.0
        for _ in range(4):
            hull = min(hull, y + z * hull)
        assert found.tubes.hull[0, 0] == pytest.approx(hull, rel=1e-9)
        assert found.tubes.hull[0, 0] >= hull
