"""Theorem R, Lemma W and Proposition B, each bound against what it bounds at random places."""

import numpy as np
import pytest

import ccpin
from ccpin.arrays import apply
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular.following import follow, onto_curves
from ccpin.proof.curves.curve_equations import drift, first_order, values_at
from ccpin.proof.curves.settled_boxes import kernels, settled
from ccpin.proof.curves.tubes import Points, bounds_of, certify_tubes, frames_at, glued, places_in, zeros_in
from ccpin.proof.narrowing import Candidates
from tests.support.legs import load_slice

NAMES = ("rpdr", "3-RPR", "planar_3rrr")


def problem(name):
    """With reach bounds."""
    mechanism = load_slice() if name == "3-RPR" else ccpin.load(name)
    return reading_of(mechanism, mechanism.q_reference).bounded("reach").problem


def random_points(at, count, seed):
    """θ, unit w and l anywhere."""
    rng, system = np.random.default_rng(seed), at.system
    theta = rng.uniform(-1.0, 1.0, (count, system.n_free)) * np.where(system.periodic, np.pi, 0.3)
    kernel, pairing = rng.normal(size=(2, count, system.m))
    return theta, kernel / np.linalg.norm(kernel, axis=1, keepdims=True), pairing


def on_curves(at, count, seed):
    """Singular configurations and their kernels."""
    theta, kernel, settled_there = onto_curves(at, *random_points(at, count, seed)[:2], 60)
    return theta[settled_there], kernel[settled_there]


def in_boxes(rng, radius, count=40):
    """Points of boxes |x| ≤ radius, corners among them, of shape (count, *radius.shape)."""
    found = rng.uniform(-1.0, 1.0, (count, *radius.shape))
    found[::2] = np.sign(found[::2])
    return found * radius


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_against_differences(name):
    """G′ is the derivative of G, and G″ that of G′."""
    at, step = problem(name), 1e-6
    theta, kernel, pairing = random_points(at, 5, 1)
    found, size = values_at(at, theta, kernel, pairing), theta.shape[1]
    for k, unit in enumerate(np.eye(found.x.shape[1])):
        ends = [
            first_order(at, theta + side * unit[:size], kernel + side * unit[size:], pairing)[:2]
            for side in (step, -step)
        ]
        value, slope = ((one - other) / (2.0 * step) for one, other in zip(*ends, strict=True))
        assert np.abs(value - found.slope[:, :, k]).max() < 1e-8
        assert np.abs(slope - found.bend[..., k]).max() < 1e-8


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("width", [1e-3, 0.1, 0.6])
def test_the_drift_of_second_derivatives(name, width):
    """No entry of G″ changes by more than the drift says, anywhere in boxes."""
    at, rng = problem(name), np.random.default_rng(2)
    found = values_at(at, *random_points(at, 6, 2))
    size, m = found.theta.shape[1], at.system.m
    box = width * rng.uniform(0.0, 1.0, found.x.shape)
    off = drift(at, found, box)
    for move in in_boxes(rng, box):
        x = found.x + move
        change = np.abs(values_at(at, x[:, :size], x[:, size:], found.pairing).bend - found.bend) - 1e-12
        assert np.all(change[:, :, :size, :size] <= off.turned[:, :, None, None])
        assert np.all(change[:, :, :size, size:] <= off.mixed[:, :, None, None])
        assert np.all(change[:, 2 * m] <= 0.0)


@pytest.mark.parametrize("name", NAMES[:2])
@pytest.mark.parametrize("width", [1e-9, 1e-2, 0.3])
def test_bounds_of_tubes(name, width):
    """|P G| ≤ Y on the segment and |1 − P G′| ≤ Z all over the tube, at corners and within."""
    at, rng = problem(name), np.random.default_rng(3)
    theta, kernel = on_curves(at, 40, 3)
    found = values_at(at, theta, kernel, kernel)
    frames, size = frames_at(found.slope), theta.shape[1]
    half, radius = width * rng.uniform(0.3, 1.0, len(theta)), width * rng.uniform(0.0, 1.0, found.x.shape)
    rows, identity = np.arange(len(theta)), np.eye(found.x.shape[1])
    radius[rows, frames.along] = 0.0
    bounds = bounds_of(at, found, frames, half, radius)
    for s, e in zip(in_boxes(rng, half), in_boxes(rng, radius), strict=True):
        x = found.x + frames.tangent * s[:, None]
        value = first_order(at, x[:, :size], x[:, size:], kernel)[0]
        assert np.all(np.abs(apply(frames.gain, value)) <= bounds.y)
        slope = first_order(at, (x + e)[:, :size], (x + e)[:, size:], kernel)[1]
        left = np.abs(identity - frames.gain @ slope)
        left[rows, :, frames.along], left[rows, frames.along] = 0.0, 0.0
        assert np.all(left <= bounds.z)


@pytest.fixture(scope="module")
def chain():
    """A piece of a curve of the 3-RPR."""
    at = problem("3-RPR")
    theta, kernel = on_curves(at, 40, 4)
    left = iter(range(60))
    return at, follow(at, theta[0], kernel[0], lambda _: next(left, 60) % 30 < 29).tubes


def test_curves_stay_in_their_hulls(chain):
    """Newton's method at any s ends on the segment's neighbourhood that the hull is, and where `zeros_in` says."""
    at, tubes = chain
    for share in (-1.0, -0.4, 0.0, 0.7, 1.0):
        s = share * tubes.half
        found = zeros_in(at, tubes, s)
        off = found.x - tubes.x - tubes.tangent * s[:, None]
        assert np.all(np.abs(off) <= tubes.hull + found.error)
        x, size = found.x.copy(), tubes.theta.shape[1]
        for _ in range(60):
            x -= apply(tubes.gain, first_order(at, x[:, :size], x[:, size:], tubes.pairing)[0])
        assert np.all(np.abs(x - found.x) <= found.error + 1e-15)


def test_gluing_needs_the_same_curve_and_way(chain):
    """Each tube is glued to the next; not to one farther on, nor to the next turned round or moved aside."""
    at, tubes = chain
    here, following = tubes.take(np.arange(len(tubes.half) - 5)), tubes.take(np.arange(1, len(tubes.half) - 4))
    assert glued(at, here, following).all()
    assert not glued(at, here, tubes.take(np.arange(5, len(tubes.half)))).any()
    assert not glued(at, here, following._replace(tangent=-following.tangent)).any()
    beside = following._replace(theta=following.theta + 0.5)
    with np.errstate(all="ignore"):
        assert not glued(at, here, beside).any()


def test_places_do_not_depend_on_the_kernels_length(chain):
    """w and −3w say the same; a turn of 2π too."""
    at, tubes = chain
    found = zeros_in(at, tubes, 0.5 * tubes.half)
    size = tubes.theta.shape[1]
    scaled = found.x.copy()
    scaled[:, size:] *= -3.0
    scaled[:, :size] += 2.0 * np.pi * at.system.periodic
    error = found.error * np.where(np.arange(found.x.shape[1]) < size, 1.0, 3.0) + 1e-14
    for points in (found, Points(scaled, error)):
        places = places_in(at, points, tubes)
        assert places.inside.all()
        assert np.all(np.abs(places.s - 0.5 * tubes.half) <= places.error + 1e-12)


def test_too_long_a_tube_is_not_proved(chain):
    """Beyond ten times its length no tube holds."""
    at, tubes = chain
    values = values_at(at, tubes.theta, tubes.kernel, tubes.pairing)
    frames = frames_at(values.slope)
    assert not certify_tubes(at, values, frames, 10.0 * tubes.half, 10.0 * tubes.radius).proved.any()


@pytest.mark.parametrize("name", NAMES[:2])
@pytest.mark.parametrize("width", [1e-3, 0.03, 1.0])
def test_kernels_over_boxes(name, width):
    """Lemma W: of boxes about singular configurations the kernel is enclosed; wide boxes claim nothing."""
    at, rng = problem(name), np.random.default_rng(5)
    theta, kernel = on_curves(at, 60, 5)
    half = width * rng.uniform(0.2, 1.0, theta.shape)
    slopes = rng.normal(size=(len(theta), at.system.m, at.system.n))
    inside = rng.uniform(-1.0, 1.0, theta.shape) * half
    moved = inside.copy()
    moved[:, at.system.dependent] += apply(slopes, inside[:, at.system.independent])
    boxes = Candidates(np.zeros(len(theta), dtype=np.intp), theta - moved, half, slopes)
    pairing = kernel + 0.1 * rng.normal(size=kernel.shape)
    middle, spread = kernels(at, boxes, pairing)
    known = np.isfinite(spread).all(axis=1)
    assert known.mean() > 0.9 if width < 0.01 else width < 0.1 or not known.any()
    exact = kernel / np.sum(pairing * kernel, axis=1, keepdims=True)
    assert np.all(np.abs(exact - middle)[known] <= spread[known])


def test_settled_boxes_hold_nothing_else(chain):
    """Small boxes on a tube's curve are settled by it; boxes about singular configurations elsewhere never are."""
    at, tubes = chain
    half = np.full_like(tubes.theta, 1e-3)
    none = np.zeros((len(half), at.system.m, at.system.n))
    here = Candidates(np.zeros(len(half), dtype=np.intp), tubes.theta, half, none)
    assert settled(at, here, tubes).all()
    for far in (3, 8, 20):
        assert not settled(at, here, tubes.take(np.roll(np.arange(len(half)), far))).any()
    wide = here._replace(half=np.full_like(half, 2.0))
    assert not settled(at, wide, tubes).any()
