"""Cells without closed configurations at equality: stretched chains, and Theorem E of legs told by numbers."""

from dataclasses import replace

import numpy as np
import pytest

from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.emptiness import (
    Ends,
    Platform,
    _seen_whole,
    drift,
    empty_by,
    empty_cells,
    ends_over,
    groups_of,
    platform_of,
)

X, Y, Z = np.eye(3)


class Told(ClosureSystem):
    """Closures whose roundings are told: so much, of 1 + what coordinates travel."""

    rounding = 0.0

    def magnitude(self, theta):
        """1 + Σ |θ|."""
        return 1.0 + np.abs(theta).sum(axis=1)


class Rough(Told):
    """Roundings of a four-hundredth."""

    rounding = 1.0 / 400.0


def chain(joints, weights, tip=(0.0, 0.0, 0.0), direction=False):
    """Of (coordinate, link before it, axis, whether it slides)."""
    numbers, links, axes, slides = zip(*joints, strict=True) if joints else ((), np.zeros((0, 3)), np.zeros((0, 3)), ())
    turns = np.tile(np.eye(3), (len(joints), 1, 1))
    slides = np.array(slides, dtype=bool)
    return Chain(
        np.array(numbers, dtype=int), turns, np.array(links, dtype=float).reshape(-1, 3), np.array(axes).reshape(-1, 3),
        slides, np.array(tip, dtype=float), direction, weights,
    )  # fmt: skip


def system_of(chains, size, independent, offset, kind=Told, couplings=None, moduli=None):
    m = len(offset)
    return kind(
        tuple(chains), np.zeros((m, size)) if couplings is None else couplings, np.array(offset, dtype=float),
        np.zeros(m) if moduli is None else np.array(moduli), np.array(independent),
        np.setdiff1d(np.arange(size), independent), np.zeros(size, dtype=bool),
    )  # fmt: skip


# The triangle inequality.

W = np.array([X, Y])
ARM = [(0, 0 * X, X, True), (2, X, Z, False), (1, 0.25 * Y, X, True)]  # a slide, a link to a turn, a link to a slide


def reached(less=0.0, scale=1.0, kind=Told, tip=(0.0, 0.5, 0.0), offset=0.0):
    """|2 + 1 − 5| against ¾, |q₁| up to 1 and q₀'s own ¼: it is empty where that is less than 2."""
    arm = chain(ARM, scale * W, tip)
    anchor = chain([(0, 0 * X, Y, True)], -scale * W, (5.0 + offset, 0.0, 0.0))
    still = system_of([arm._replace(weights=scale * W)], 4, [0, 1], scale * np.array([-5.0 - less, 0.0]), kind)
    both = system_of([arm, anchor], 4, [0, 1], scale * np.array([-less, 0.0]), kind)
    centre, half = np.array([[2.0, -0.5]]), np.array([[0.25, 0.5]])
    return still, both, centre, half


@pytest.mark.parametrize(("less", "empty"), [(1.9e-10, False), (2.1e-10, True), (-1e-9, False), (1.0, True)])
@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_a_stretched_chain_ends_where_cells_begin_to_be_empty(less, empty, scale):
    """By a part in 10¹⁰, whatever the rows' own size."""
    still, _, centre, half = reached(less, scale)
    groups = groups_of(still)
    assert (len(groups), groups[0].rows.tolist()) == (1, [0, 1])
    assert groups[0].anchors[0].length == 0.75
    assert empty_cells(still, groups, centre, half).tolist() == [empty]


@pytest.mark.parametrize("less", [1e-8, -1e-8])
def test_both_chains_and_their_own_moves_count(less):
    """The other's tip slides with q₀ across: at (5, 2), by ¼ more."""
    _, both, centre, half = reached()
    groups = groups_of(both)
    most = np.hypot(2.0, 2.0) - 2.25
    arm = both.chains[0]._replace(tip=np.array([0.0, 0.5 + most - less, 0.0]))
    both = replace(both, chains=(arm, both.chains[1]))
    assert empty_cells(both, groups_of(both), centre, half).tolist() == [less > 0]
    assert len(groups) == 1


@pytest.mark.parametrize(("less", "empty"), [(0.0425 + 1e-6, True), (0.0425 - 1e-6, False)])
def test_roundings_count_four_times(less, empty):
    """4γ (1 + 2 + ½ + ¾): a hundredth of 4¼."""
    still, _, centre, half = reached(less, kind=Rough)
    assert empty_cells(still, groups_of(still), centre, half).tolist() == [empty]


def test_which_closures_say_something():
    """Points, of rows that nothing else enters, with no dependent slide behind a dependent turn."""
    still, both, _, _ = reached()
    assert len(groups_of(both)) == 1
    towards = both.chains[1]._replace(direction=True)
    coupled, moduli = np.zeros((2, 4)), np.array([0.0, 1.0])
    coupled[1, 3] = 1.0
    free = chain([*ARM, (3, 0 * X, X, True)], W)
    for system in (
        replace(both, chains=(both.chains[0], towards)),
        replace(both, couplings=coupled),
        replace(both, moduli=moduli),
        replace(both, chains=(free, both.chains[1])),
        replace(both, chains=(both.chains[1], free)),
    ):
        assert len(groups_of(system)) == 0
    other = chain(ARM, np.array([0 * X, 0 * X, Z]))
    three = [replace_rows(c, 3) for c in still.chains]
    assert [g.rows.tolist() for g in groups_of(system_of([*three, other], 4, [0, 1], [0.0, 0.0, 0.0]))] == [[0, 1], [2]]


def replace_rows(own, rows):
    return own._replace(weights=np.vstack([own.weights, np.zeros((rows - len(own.weights), 3))]))


def test_a_chain_is_cut_at_its_first_dependent_joint():
    """What is before it moves with q; the links behind it are as long as they are, and their slides told."""
    long = chain(
        [(0, X, Z, False), (1, 2 * X, X, True), (2, 4 * Y, Z, False), (3, 8 * Z, Z, False), (1, 16 * X, Y, True)],
        W,
        32 * X,
    )
    system = system_of([long], 4, [0, 1], [0.0, 0.0])
    anchor = groups_of(system)[0].anchors[0]
    assert (anchor.head.joints.tolist(), anchor.head.tip.tolist(), anchor.length) == ([0, 1], [0.0, 4.0, 0.0], 56.0)
    assert anchor.slides.tolist() == [1]
    whole = chain([(0, X, Z, False), (1, 2 * X, X, True)], W, 4 * X)
    anchor = groups_of(system_of([whole], 4, [0, 1], [0.0, 0.0]))[0].anchors[0]
    assert (anchor.head.joints.tolist(), anchor.head.tip.tolist(), anchor.length) == ([0, 1], [4.0, 0.0, 0.0], 0.0)


def test_a_tip_moves_by_what_its_joints_sweep():
    """Σ w l over turns, Σ w over slides; half of Σ w² l + 2 Σ w_j (what is deeper), l up to the tip with its slides."""
    rng = np.random.default_rng(1)
    slides, links, tip = [True, False, True, False, False], rng.normal(size=(5, 3)), rng.normal(size=3)
    head = chain([(j, links[j], X, slides[j]) for j in range(5)], W, tip)
    width, travel = rng.uniform(0.1, 1.0, (2, 3, 5))
    moved, missed = drift(head, width, travel)
    for b in range(3):
        steps, second = [], 0.0
        for j in reversed(range(5)):
            length = np.linalg.norm(tip) + sum(
                np.linalg.norm(links[k]) + slides[k] * travel[b, k] for k in range(j + 1, 5)
            )
            own = width[b, j] if slides[j] else length * width[b, j]
            second += 0.0 if slides[j] else width[b, j] ** 2 * length + 2.0 * width[b, j] * sum(steps)
            steps.append(own)
        assert moved[b] == pytest.approx(sum(steps), rel=1e-13)
        assert missed[b] == pytest.approx(0.5 * second, rel=1e-13)


# Legs that meet in one platform.


def platform(count=3, first=0, **changes):
    """Legs of unlike lengths about turns at unlike places, with a link each, to a platform that slides and turns."""
    size = 2 * count + 3
    chains, offset = [], np.arange(1.0, 2 * count + 1)
    for k in range(count):
        rows = np.zeros((2 * count, 3))
        rows[2 * k : 2 * k + 2] = W
        body = [(2 * count, 0 * X, X, True), (2 * count + 1, 0 * X, Y, True), (2 * count + 2, 0 * X, Z, False)]
        leg = [(k, [k, -k, 0.0], Z, False), (count + k, [1.0 + k, 0.5, 0.0], Z, False)]
        pair = [chain(body, rows, [0.1 * k, 0.2, 0.0]), chain(leg, -rows, [0.0, 2.0 + k, 0.0])]
        chains += pair if first == 0 else pair[::-1]
    system = system_of(chains, size, np.arange(count), offset, couplings=np.zeros((2 * count, size)))
    return replace(system, **changes)


def changed(system, number, **parts):
    """With one chain changed."""
    return replace(system, chains=tuple(c._replace(**parts) if k == number else c for k, c in enumerate(system.chains)))


@pytest.mark.parametrize("first", [0, 1])
def test_legs_are_what_is_left_behind_what_q_moves(first):
    """Whichever chain of a closure is the platform's."""
    found = platform_of(platform(first=first))
    np.testing.assert_allclose(found.lengths, [2.0, 3.0, 4.0])
    np.testing.assert_allclose(found.places, [[0.0, 0.2], [0.1, 0.2], [0.2, 0.2]])
    np.testing.assert_allclose(found.offset, [[-1.0, -2.0], [-3.0, -4.0], [-5.0, -6.0]])
    np.testing.assert_allclose(found.weights, [W, W, W])
    assert [head.joints.tolist() for head in found.heads] == [[0], [1], [2]]
    np.testing.assert_allclose([head.tip for head in found.heads], [[1.0, 0.5, 0.0], [2.0, 0.5, 0.0], [3.0, 0.5, 0.0]])


def test_what_is_no_platform():
    """Two legs, three chains of one closure, couplings, other bodies, legs that bend, slide or turn with q."""
    system = platform()
    body, leg = system.chains[2], system.chains[3]
    tilted = np.array([0.0, 0.6, 0.8])
    extra = chain([(0, 0 * X, Z, False)], body.weights)
    coupled = system.couplings.copy()
    coupled[0, 0] = 1.0
    longer = chain(
        [(1, [1.0, -1.0, 0.0], Z, False), (4, [2.0, 0.5, 0.0], Z, False), (3, X, Z, False)],
        leg.weights,
        [0.0, 3.0, 0.0],
    )
    straight = longer.translations.copy()
    straight[2] = 0.0
    assert platform_of(changed(system, 3, **longer._replace(translations=straight)._asdict())) is not None
    for other in (
        platform(count=2),
        replace(system, chains=(*system.chains, extra)),
        replace(system, couplings=coupled),
        changed(system, 2, joints=np.array([7, 6, 8])),
        changed(system, 2, rotations=np.array([np.eye(3), np.eye(3), np.diag([-1.0, -1.0, 1.0])])),
        changed(system, 2, translations=body.translations + [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]),
        changed(system, 2, axes=body.axes * [[1.0], [1.0], [-1.0]]),
        changed(system, 2, direction=True),
        changed(system, 0, direction=True),
        changed(system, 2, weights=body.weights[:, [1, 0, 2]]),
        changed(system, 2, weights=-body.weights),
        changed(system, 3, direction=True),
        changed(system, 3, axes=np.array([tilted, Z])),
        changed(system, 3, weights=1.1 * leg.weights),
        changed(system, 3, prismatic=np.array([False, True]), axes=np.array([Z, X])),
        changed(system, 3, **longer._asdict()),
        changed(system, 3, **longer._replace(joints=np.array([1, 4, 2]), translations=straight)._asdict()),
        changed(
            system, 3, **longer._replace(prismatic=np.array([False, False, True]), translations=straight)._asdict()
        ),
        replace(
            system,
            chains=tuple(
                c._replace(axes=c.axes[:, [0, 2, 1]]) if k % 2 == 0 else c for k, c in enumerate(system.chains)
            ),
        ),
    ):
        assert platform_of(other) is None


@pytest.mark.parametrize(("off", "whole"), [(0.95e-12, True), (1.05e-12, False), (-0.95e-12, True), (0.1, False)])
def test_lengths_are_seen_as_they_are_to_a_part_in_1e12(off, whole):
    """W orthonormal in its worst entry, and axes that it does not see; three rows see all, one sees no length."""
    turn = chain([(0, 0 * X, Z, False), (1, X, X, True)], W)
    assert _seen_whole(turn, W)
    assert _seen_whole(turn, W * np.array([[1.0], [1.0 + 0.5 * off]])) == whole
    assert _seen_whole(turn._replace(axes=np.array([Z + off * X, X])), W) == whole
    assert not _seen_whole(turn, W[:1])
    assert _seen_whole(turn._replace(axes=np.array([X, X])), np.eye(3))


def test_legs_begin_where_q_takes_them():
    """a, its slopes times the half widths, how far it moves and misses its slope, each with 4γ of what travels."""
    system = platform()
    rough = Rough(**{name: getattr(system, name) for name in system.__dataclass_fields__})
    where = platform_of(system)
    centre, half = np.array([[0.3, -0.4, 0.5], [1.0, 2.0, 3.0]]), np.array([[0.1, 0.2, 0.3], [0.01, 0.02, 0.03]])
    found = ends_over(rough, where, centre, half)
    for b in range(2):
        margin = 0.01 * (1.0 + (np.abs(centre[b]) + half[b]).sum())
        for k in range(3):
            c, s = np.cos(centre[b, k]), np.sin(centre[b, k])
            turned = np.array([[c, -s], [s, c]]) @ [1.0 + k, 0.5]
            np.testing.assert_allclose(found.places[b, k], [k, -k] + turned + where.offset[k], rtol=1e-13)
            slope = np.zeros((2, 3))
            slope[:, k] = np.array([-turned[1], turned[0]]) * half[b, k]
            np.testing.assert_allclose(found.slopes[b, k], slope, rtol=1e-12, atol=1e-15)
            length = np.hypot(1.0 + k, 0.5)
            np.testing.assert_allclose(found.moves[b, k], length * half[b, k] + margin, rtol=1e-12)
            np.testing.assert_allclose(found.bends[b, k], 0.5 * length * half[b, k] ** 2 + margin, rtol=1e-12)


def room(legs, ends, weights):
    """How much more Theorem E's left side is than its right one over a cell, and what is kept for roundings."""
    a, b, lam, r = ends.places[0], legs.places, weights[0], ends.moves[0]
    mean_a, mean_b = lam @ a, lam @ b
    A, B = a - mean_a, b - mean_b
    W_ = lam[:, None] * B
    _, sizes, right = np.linalg.svd(A.T @ W_)
    d = np.array([sum(abs(W_[k] @ v) * r[k] for k in range(len(lam))) for v in right])
    S = sum(np.sqrt(s**2 + e**2) * np.outer(v, v) for s, e, v in zip(sizes, d, right, strict=True))
    C, inverse = A.T @ W_, np.linalg.inv(S)
    sums = sum(lam[k] * (A[k] @ A[k] + B[k] @ B[k] - legs.lengths[k] ** 2) for k in range(len(lam)))
    least = sums - np.trace(S) - np.trace(C @ inverse @ C.T)
    N = np.diag(lam) - np.outer(lam, lam) - W_ @ inverse @ W_.T
    P = lam[:, None] * A - W_ @ inverse @ C.T
    falls = 2 * sum(
        abs(sum(P[k] @ ends.slopes[0, k, :, j] for k in range(len(lam)))) for j in range(ends.slopes.shape[3])
    )
    falls += 2 * sum(np.linalg.norm(P[k]) * ends.bends[0, k] for k in range(len(lam))) + r @ np.abs(N) @ r
    far, near = np.linalg.norm(A, axis=1), np.linalg.norm(B, axis=1)
    scale = np.abs(lam) @ (far + near + legs.lengths + 1.0) ** 2
    return least - falls - 1e-9 * (1.0 + abs(lam.sum() - 1.0) * 2.0**40) * scale, scale


@pytest.mark.parametrize("number", range(8))
def test_weights_prove_cells_empty_where_theorem_e_says_so(number):
    """To a part in 10¹¹ of its sums, for lengths that just reach, cells of a size, weights that add up badly."""
    rng = np.random.default_rng(number)
    r = 2 + number % 2
    K = r + 2
    weights = rng.uniform(0.1, 1.0, (1, K)) * np.array([1.0] * (K - 1) + [-0.2])
    weights /= weights.sum()
    weights *= 1.0 + 2.0**-41 * (number % 3)
    size = 0.02 * (number > 1)
    ends = Ends(
        5.0 * rng.normal(size=(1, K, r)),
        size * rng.normal(size=(1, K, r, 2)),
        size * rng.uniform(size=(1, K)),
        size**2 * rng.uniform(size=(1, K)),
    )
    legs = Platform((), np.zeros((K, r, 3)), np.zeros((K, r)), rng.normal(size=(K, r)), rng.uniform(0.1, 0.2, K))

    def longer(s):
        return legs._replace(lengths=np.sqrt(np.maximum(legs.lengths**2 + s / weights[0] * (np.arange(K) == 0), 0.0)))

    for share, empty in ((3e-11, True), (-3e-11, False)):
        low, high = 0.0, 1e3
        assert room(longer(low), ends, weights)[0] > 0.0 > room(longer(high), ends, weights)[0]
        for _ in range(100):
            middle = 0.5 * (low + high)
            more, scale = room(longer(middle), ends, weights)
            low, high = (middle, high) if more > share * scale else (low, middle)
        assert empty_by(longer(low), ends, weights)[0].tolist() == [empty]
