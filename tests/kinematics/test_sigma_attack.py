"""σ under attack: queries at random and aimed at singular sets, none of which may come back on another branch."""

import numpy as np
import pytest

import ccpin
from ccpin import native
from ccpin.errors import CcpinError
from tests.oracles import delta, four_bar, hexa, planar_3rrr, rpdr, slider_crank, stewart
from tests.oracles.geometry import wrap
from tests.support.long_cases import later
from tests.support.paper import to_free, to_paper

BATCH = 50
SIZES = [1, pytest.param(200, marks=pytest.mark.slow)]
OTHERS = {
    "planar_3rrr": planar_3rrr,
    "stewart": stewart,
    "hexa": hexa,
    "four_bar": four_bar,
    "slider_crank": slider_crank,
}


def answers(model, queries, near):
    """(index, q′) of the queries that σ answers, by the core's batch where there is a core."""
    kernel = native.kernel(model.mechanism) if ccpin.backend().name == "native" else None
    if kernel is not None:
        found, mask = kernel.sigma_many(queries, near, 1)
        return [(k, found[k]) for k in np.flatnonzero(mask)]
    answered = []
    for k, q in enumerate(queries[: BATCH // 10]):  # the reference is slower
        try:
            answered.append((k, model.sigma(q, near)))
        except CcpinError:
            continue
    return answered


def around(rng, count, size, shortest):
    """Offsets of all lengths from `shortest` to 1, one a row."""
    return rng.normal(size=(count, size)) * 10.0 ** rng.uniform(shortest, 0.0, (count, 1))


def named(mechanism, displacements):
    """q′ of joint displacements by name."""
    q_free = mechanism.q_reference.copy()
    for name, value in displacements.items():
        q_free[mechanism.tree.joint(name).q] = value
    return q_free


def numbers(mechanism, q_free, names):
    return np.array([float(q_free[mechanism.tree.joint(name).q][0]) for name in names])


@pytest.mark.parametrize("size", SIZES)
def test_five_bar_keeps_its_mode(rpdr_model, size):
    """The sign of sin(q1 + q3 − q2 − q4) is that of `near`, also aimed at the isolated singular point."""
    rng, seen = np.random.default_rng(71), 0
    for k in range(3 * size):
        mode = 1 if k % 2 else -1
        near = to_free(rpdr_model.mechanism, rpdr.random_configurations(rng, 1, mode, away=1e-6)[0])
        queries = rng.uniform(-np.pi, np.pi, (BATCH, 2))
        if k % 3 == 0:
            queries = rpdr.coincident_elbows() + around(rng, BATCH, 2, -6.0)
        for _, q_free in answers(rpdr_model, queries, near):
            assert np.sin(rpdr.fold(to_paper(rpdr_model.mechanism, q_free))) * mode > 0
            seen += 1
    assert seen >= 3 * size  # of 15 or 150 queries each


@pytest.mark.parametrize("distance", [1e-5, 1e-4, 1e-3])
def test_the_five_bar_is_followed_next_to_its_singular_point(rpdr_model, distance):
    """Where the elbows nearly coincide joints turn far on a short way: reached in the mode of `near`, not refused."""
    mechanism, rng, centre = rpdr_model.mechanism, np.random.default_rng(75), rpdr.coincident_elbows()
    for k in range(6):
        mode, angle = (1 if k % 2 else -1), rng.uniform(0.0, 2.0 * np.pi)
        start, end = (
            centre + r * np.array([np.cos(a), np.sin(a)])
            for r, a in ((0.2, angle), (distance, angle + rng.uniform(-1, 1)))
        )
        q_free = rpdr_model.sigma(end, to_free(mechanism, rpdr.sigma(start, mode)))
        assert np.abs(wrap(to_paper(mechanism, q_free) - rpdr.sigma(end, mode))).max() < 1e-8 / distance


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_open_configurations_of_the_five_bar_keep_their_mode(rpdr_model, size):
    """Next to the isolated singular point an open one is closed on its own side of det ψ_q′ = 0, or refused."""
    rng, seen = np.random.default_rng(72), 0
    for _ in range(40 * size):
        q = rpdr.coincident_elbows() + around(rng, 1, 2, -9.0)[0] * 1e-3
        near = rpdr.sigma(q, rng.choice([-1.0, 1.0])) if rpdr.elongation(q) < 1.0 else np.append(q, [0.3, 0.4])
        near[2:] += around(rng, 1, 2, -9.0)[0] * 1e-2
        try:
            q_free = rpdr_model.sigma(q + around(rng, 1, 2, -6.0)[0] * 0.1, to_free(rpdr_model.mechanism, near))
        except CcpinError:
            continue
        seen += 1
        assert np.sin(rpdr.fold(to_paper(rpdr_model.mechanism, q_free))) * np.sin(rpdr.fold(near)) > 0
    assert seen >= size


@pytest.mark.parametrize("size", SIZES)
def test_delta_keeps_its_platform_level_and_below(size):
    """The Delta stays in the component of closed configurations with a level platform, on its side."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    mechanism, rng, seen = model.mechanism, np.random.default_rng(73), 0
    for k in range(2 * size):
        start = model.sigma(rng.uniform(-0.4, 0.7, 3)) if k % 3 else mechanism.q_reference
        queries = rng.uniform(-np.pi, np.pi, (BATCH, 3)) * (3 if k % 4 == 2 else 1)
        if k % 2:  # legs alike: two singular values cross zero at once
            queries = np.repeat(rng.uniform(-3.0, 9.0, (BATCH, 1)), 3, axis=1) + around(rng, BATCH, 3, -9.0)
        for _, q_free in answers(model, queries[:6], start):
            assert np.abs(numbers(mechanism, q_free, [f"platform_{a}" for a in ("roll", "pitch", "yaw")])).max() < 1e-6
            centres = delta.sphere_centres(numbers(mechanism, q_free, delta.INDEPENDENT))
            normal = np.cross(centres[1] - centres[0], centres[2] - centres[0])
            position = numbers(mechanism, q_free, ("platform_x", "platform_y", "platform_z"))
            assert (position - centres[0]) @ normal * _side(mechanism) > 0
            swings = numbers(mechanism, q_free, [f"rod{leg}{side}_swing" for leg in (1, 2, 3) for side in "ab"])
            assert np.all(np.cos(swings) > 0)
            seen += 1
    assert seen >= size


def _side(mechanism):
    """On which side of its sphere centres the platform is at the reference."""
    centres = delta.sphere_centres(numbers(mechanism, mechanism.q_reference, delta.INDEPENDENT))
    position = numbers(mechanism, mechanism.q_reference, ("platform_x", "platform_y", "platform_z"))
    return (position - centres[0]) @ np.cross(centres[1] - centres[0], centres[2] - centres[0])


def test_a_branch_with_a_turned_platform_is_not_entered():
    """The line crosses a constraint singularity of the Delta: refused before it, or answered with a level platform."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    start = model.sigma([0.4931732, -0.24680134, 0.61743949])
    for q, near in (
        ([-0.37462138546202794, 2.856276310741155, -0.0006546219069853976], start),
        ([9.0, 9.0, 9.0], None),
    ):
        with pytest.raises(CcpinError):
            model.sigma(q, near)


def beside_the_end(model, rng, q, near, count):
    """Queries (count, n) about where σ ends along a line from q, of all distances down to 1e-9 of the way there."""
    way, least, most = rng.normal(size=len(q)), 0.0, 3.0
    for _ in range(8):
        places = np.linspace(least, most, BATCH)
        told = np.array([k for k, _ in answers(model, q + places[:, None] * way, near)])
        lost = np.setdiff1d(np.arange(BATCH), told)
        if not lost.size or lost[0] == 0:
            break
        least, most = places[lost[0] - 1], places[lost[0]]
    return q + least * (way + around(rng, count, len(q), -9.0))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", later(*OTHERS))
def test_the_way_back_ends_at_the_start(name, size):
    """A line lifted to a branch and back ends where it began, which it would not after a jump; a third end at folds."""
    model, oracle = ccpin.ReducedModel(ccpin.load(name)), OTHERS[name]
    mechanism, rng, seen = model.mechanism, np.random.default_rng(74), 0
    for k in range(2 * size):
        start = named(mechanism, oracle.configuration(rng.uniform(*oracle.BOX.T)))
        q_start = model.alpha(start)
        queries = q_start + rng.uniform(-1.0, 1.0, (BATCH, len(q_start))) * (1.0 if k % 3 else 0.1)
        if k % 3 == 1:
            queries = beside_the_end(model, rng, q_start, start, BATCH)
        for i, q_free in answers(model, queries[:4], start):
            try:
                back = model.sigma(q_start, q_free)
            except CcpinError:
                continue
            assert np.abs(wrap(back - start)).max() < 1e-6, (queries[i], q_free)
            seen += 1
    assert seen >= size
