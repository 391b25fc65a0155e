"""φ and its derivatives against numbers of 50 digits: chains by products of matrices, derivatives by differences."""

from dataclasses import replace
from itertools import product

import mpmath as mp
import numpy as np
import pytest

from ccpin.errors import UnsupportedMechanismError
from ccpin.proof import balls
from ccpin.proof.balls import Affine
from ccpin.proof.bounds import Frame
from ccpin.proof.chains import Chain, ClosureSystem, stack_chains
from ccpin.proof.equations import Closures, closures_of, derivatives, problem_of
from ccpin.proof.facts import NotProvedError
from ccpin.proof.phasors import PlanarBounds, phasors_of
from ccpin.proof.taylor import TaylorBounds
from ccpin.proof.tips import move, turns_of
from tests.support.straight import circles, straight

U = 2.0**-53
mp.mp.dps = 50


def rotation(rng, axis=None):
    """A random rotation, or one about an axis, orthonormal to a few roundings."""
    axis = rng.normal(size=3) if axis is None else np.array(axis, dtype=float)
    x, y, z = axis / np.linalg.norm(axis)
    cross, angle = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), rng.uniform(-3, 3)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def chain(rng, joints, slides, rows, direction=False, planar=False):
    k, m = len(joints), 3
    flat = np.array([1.0, 1.0, 0.0]) if planar else np.ones(3)
    axes = rng.normal(size=(k, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    turns = [rotation(rng, [0, 0, 1] if planar else None) for _ in joints]
    if planar:
        axes = np.array([[0.0, 0.0, s] for s in rng.choice([-1.0, 1.0], k)])
        axes[list(slides)] = [0.6, 0.8, 0.0]
    weights = np.zeros((m, 3))
    weights[rows] = rng.normal(size=(len(rows), 3))
    weights[rows[0], 1] = 0.0
    translations = rng.normal(size=(k, 3))
    translations[-1] *= 0.0
    prismatic = np.array(slides, dtype=bool)
    return Chain(
        np.array(joints), np.array(turns), translations, axes, prismatic, rng.normal(size=3) * flat, direction, weights
    )


def system_of(rng, planar=False):
    """Three chains of unlike lengths in six coordinates, with slides and a direction, and a row that is coupled."""
    if planar:
        slides = ((True, False, False, False), (False, False), (True, False, False))
    else:
        slides = ((False, True, False, False), (False, False), (True, False, True))
    chains = tuple(
        chain(rng, joints, own, rows, direction, planar)
        for joints, own, rows, direction in zip(
            ((0, 1, 2, 3), (4, 2), (0, 3, 4)), slides, ([0, 1], [1, 2], [0, 2]), (False, False, True), strict=True
        )
    )
    couplings = np.zeros((3, 6))
    couplings[1, [1, 5]] = 0.5, -2.0
    return ClosureSystem(
        chains, couplings, rng.normal(size=3), np.zeros(3), np.arange(3), np.arange(3, 6), np.zeros(6, dtype=bool)
    )


def exact(value):
    return mp.matrix(np.asarray(value, dtype=float).tolist())


def tip_of(chain, theta):
    """By products of matrices, from the root."""
    turn, at = mp.eye(3), mp.matrix(3, 1)
    for k, joint in enumerate(chain.joints):
        at += turn * exact(chain.translations[k])
        turn = turn * exact(chain.rotations[k])
        axis = exact(chain.axes[k])
        if chain.prismatic[k]:
            at += turn * axis * theta[joint]
        else:
            x, y, z = axis
            cross = mp.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            cosine = mp.cos(theta[joint])
            turn = turn * (cosine * mp.eye(3) + mp.sin(theta[joint]) * cross + (1 - cosine) * axis * axis.T)
    return turn * exact(chain.tip) + (0 if chain.direction else 1) * at


def phi_of(system, theta):
    value = exact(system.couplings) * mp.matrix(theta) + exact(system.offset)
    for own in system.chains:
        value += exact(own.weights) * tip_of(own, theta)
    return value


def numbers(matrix):
    return np.array([[float(x) for x in matrix[i, :]] for i in range(matrix.rows)])


def oracle(system, theta):
    """φ, φ_θ, φ_θθ and |∂x_c/∂θ_j| by differences of 10⁻¹²."""
    theta, h, N = [mp.mpf(x) for x in theta], mp.mpf(10) ** -12, len(theta)

    def at(function, *moves):
        return function([t + sum(h * s for j, s in moves if j == i) for i, t in enumerate(theta)])

    def phi(angles):
        return phi_of(system, angles)

    value, slope, second = numbers(phi(theta))[:, 0], np.zeros((3, N)), np.zeros((3, N, N))
    for i in range(N):
        slope[:, i] = numbers((at(phi, (i, 1)) - at(phi, (i, -1))) / (2 * h))[:, 0]
        for j in range(i, N):
            corners = sum((a * b * at(phi, (i, a), (j, b)) for a, b in product((1, -1), repeat=2)), mp.matrix(3, 1))
            second[:, i, j] = second[:, j, i] = numbers(corners / (4 * h * h))[:, 0]
    arms = [
        [
            float(
                mp.norm((at(lambda x, c=c: tip_of(c, x), (j, 1)) - at(lambda x, c=c: tip_of(c, x), (j, -1))) / (2 * h))
            )
            for j in c.joints
        ]
        for c in system.chains
    ]
    return value, slope, second, arms


RNG = np.random.default_rng(12)
SPACE, FLAT = system_of(RNG), system_of(RNG, planar=True)
THETA = RNG.normal(size=6)


@pytest.fixture(scope="module")
def known():
    """What the oracle says of each."""
    return {id(system): oracle(system, THETA) for system in (SPACE, FLAT)}


@pytest.mark.parametrize("system", [SPACE, FLAT], ids=["in space", "in the plane"])
def test_values_and_derivatives_are_those_of_products_of_matrices(system, known):
    """As the chains are swept, from the tips, and as phasors where there are any; many at once as one."""
    value, slope, second, arms = known[id(system)]
    theta, close = np.array([THETA, 0.0 * THETA, THETA]), {"rtol": 1e-12, "atol": 1e-13}
    for planar in (False, True):
        equations = Closures(system, planar)
        assert (equations.phasors is not None) == (planar and system is FLAT)
        for row in (0, 2):
            np.testing.assert_allclose(equations.values(theta)[row], value, **close)
            np.testing.assert_allclose(equations.first(theta)[0][row], value, **close)
            np.testing.assert_allclose(equations.first(theta)[1][row], slope, **close)
    found = derivatives(problem_of(system, "reach"), theta)
    for row in (0, 2):
        np.testing.assert_allclose(found.phi[row], value, **close)
        np.testing.assert_allclose(found.jacobian[row], slope, **close)
        np.testing.assert_allclose(found.hessian[row], second, **close)
        for c, stated in enumerate(arms):
            np.testing.assert_allclose(found.arms[row, c, 4 - len(stated) :], stated, **close)
    motion = move(stack_chains(system.chains, 6, 3), theta)
    for c, own in enumerate(system.chains):
        np.testing.assert_allclose(motion.x[0, c], numbers(tip_of(own, [mp.mpf(x) for x in THETA]))[:, 0], **close)


def test_rows_modulo_a_turn_are_within_half_of_it():
    """Of two couplings the one that has a modulus."""
    system = straight([[1.0], [1.0]]).system
    system = replace(system, moduli=np.array([0.0, 2.0 * np.pi]))
    found = Closures(system).values(np.array([[0.0, 7.0, 7.0], [0.0, 3.0, -3.5]]))
    np.testing.assert_allclose(found, [[7.0, 7.0 - 2 * np.pi], [3.0, 2 * np.pi - 3.5]], rtol=1e-14)
    assert phasors_of(replace(circles().system, moduli=np.ones(1))) is None
    assert phasors_of(replace(FLAT, moduli=np.array([0.0, 1.0, 0.0]))) is None


def test_padding_is_no_joint():
    """Chains of four, two and three joints side by side."""
    stack = stack_chains(SPACE.chains, 6, 3)
    assert stack.joints.tolist() == [[0, 1, 2, 3], [6, 6, 4, 2], [6, 0, 3, 4]]
    assert stack.placement.shape == (12, 6)
    assert np.flatnonzero(stack.placement.sum(axis=1)).tolist() == [0, 1, 2, 3, 6, 7, 9, 10, 11]
    assert stack.points.tolist() == [1.0, 1.0, 0.0]
    assert stack_chains((), 2, 1).joints.shape == (0, 0)
    assert (turns_of(stack).turning[:, 1, 0].tolist(), turns_of(stack).sliding[:, 2, 0].tolist()) == (
        [0, 0, 1, 1],
        [0, 1, 0, 1],
    )


# What rounding may do.


def test_what_rounding_is_measured_in():
    """1 + |d| + |G| + all lengths as the rows see them; slides; and angles beyond four."""
    turns = np.tile(np.eye(3), (2, 1, 1))
    links, weights = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]]), np.array([[0.0, 3.0, 4.0], [0.5, 0.0, 0.0]])
    axes = np.tile([0.0, 0.0, 1.0], (2, 1))
    long = Chain(
        np.array([0, 1]), turns, links, axes, np.array([False, True]), np.array([0.0, 6.0, 8.0]), False, weights
    )
    short = long._replace(
        weights=0.1 * weights,
        joints=np.array([0]),
        rotations=turns[:1],
        translations=links[:1],
        axes=axes[:1],
        prismatic=np.array([False]),
    )
    couplings = np.array([[0.0, 0.0, -0.25], [0.0, 0.0, 0.0]])
    system = ClosureSystem(
        (long, short),
        couplings,
        np.array([0.5, -1.5]),
        np.zeros(2),
        np.arange(1),
        np.arange(1, 3),
        np.zeros(3, dtype=bool),
    )
    lengths = (5.0 + 2.0 + 10.0) * 5.0 + (5.0 + 10.0) * 1.0
    assert system.scale == pytest.approx(1.0 + 2.0 + 0.25 + lengths, rel=1e-15)
    assert system.depth == 2
    assert system.rounding == pytest.approx((128 * (2 + 2) + 4 * 3) * U, rel=1e-15, abs=0.0)
    theta = np.array([[0.0, 0.0, 0.0], [3.0, -2.0, 4.0], [-8.0, 1.0, 2.0], [1.0, 0.5, -2.0]])
    stated = (system.scale + 5.0 * np.array([0.0, 2.0, 1.0, 0.5])) * np.array([1.0, 1.0, 2.0, 1.0])
    np.testing.assert_allclose(system.magnitude(theta), stated, rtol=1e-15)


@pytest.mark.parametrize(("axes", "turns", "sound"), [
    (0.95, 0.0, True), (1.05, 0.0, False), (-0.95, 0.0, True), (-1.05, 0.0, False), (0.0, 0.475, True),
    (0.0, 0.525, False),
])  # fmt: skip
def test_axes_and_placements_are_orthonormal_to_a_part_in_1e12(axes, turns, sound):
    """The worst of them."""
    system = circles().system
    own = system.chains[0]
    axes = own.axes * np.array([[1.0], [1.0 + axes * 1e-12]])
    turned = own.rotations * np.array([1.0, 1.0 + turns * 1e-12])[:, None, None]
    changed = replace(system, chains=(own._replace(axes=axes, rotations=turned),))
    if sound:
        Closures(changed)
    else:
        with pytest.raises(NotProvedError):
            Closures(changed)


def test_circles_are_what_only_turns():
    """Not what slides in a chain, nor what is coupled in some row."""
    periodic = np.zeros(6, dtype=bool)
    for k, sound in enumerate([False, False, True, True, False, False]):
        periodic[:] = np.arange(6) == k
        if sound:
            Closures(replace(SPACE, periodic=periodic.copy()))
        else:
            with pytest.raises(NotProvedError):
                Closures(replace(SPACE, periodic=periodic.copy()))


def test_closures_are_made_once_for_each_kind_of_bound():
    problem = problem_of(FLAT)
    assert problem.phasors is not None
    assert closures_of(problem) is closures_of(problem)
    assert closures_of(problem) is not closures_of(problem_of(FLAT, "reach"))
    assert problem_of(FLAT, "reach").phasors is None
    assert problem_of(SPACE).phasors is None
    assert problem_of(FLAT, "planar").phasors is not None
    with pytest.raises(UnsupportedMechanismError):
        problem_of(SPACE, "planar")


def test_bounds_are_of_the_kind_that_is_asked_for():
    """Lengths' gains are |AB_c| by rows."""
    rng = np.random.default_rng(7)
    gain = rng.normal(size=(1, 3, 3))
    frame = Frame(gain, np.eye(6)[None], np.eye(6)[None, :, 3:], np.full((1, 6), 0.1), np.full(1, 1e-12))
    flat, space = Closures(FLAT, planar=True), Closures(SPACE, planar=True)
    assert type(flat.bounds(THETA[None], frame)) is PlanarBounds
    for equations, reach in ((flat, True), (space, False), (space, True)):
        found = equations.bounds(THETA[None], frame, reach)
        assert type(found) is TaylorBounds
        stated = [[np.linalg.norm(row @ c.weights) for c in equations.system.chains] for row in gain[0]]
        np.testing.assert_allclose(found.drift.gains[0], stated, rtol=1e-13)


# Phasors.


@pytest.mark.parametrize(("tilt", "planar"), [(0.0, True), (61.0, True), (67.0, False), (1e6, False)])
def test_turns_are_parallel_to_64_roundings(tilt, planar):
    system = circles().system
    own = system.chains[0]
    axes = own.axes + np.array([[0.0, 0.0, 0.0], [tilt * U, 0.0, 0.0]])
    assert (phasors_of(replace(system, chains=(own._replace(axes=axes),))) is not None) == planar


def test_what_has_no_phasors():
    """No turn, or a slide behind one."""
    assert phasors_of(straight([[1.0]]).system) is None
    own = FLAT.chains[0]
    late = own._replace(prismatic=own.prismatic[::-1].copy(), axes=own.axes[::-1].copy())
    assert phasors_of(replace(FLAT, chains=(late,))) is None


# What is left of forms.


def test_forms_are_subtracted_stacked_and_crossed():
    """Each at corners of its parameters, where it is exact."""
    rng = np.random.default_rng(3)
    a, b = (Affine(rng.normal(size=3), rng.normal(size=(2, 3)), np.zeros(3), 1) for _ in range(2))
    short = Affine(rng.normal(size=3), np.zeros((0, 3)), np.zeros(3), 0)
    for e in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0)):

        def at(form, e=e):
            return form.mid + np.tensordot(np.array(e)[: len(form.lin)], form.lin, axes=1)

        np.testing.assert_allclose(at(a - b), at(a) - at(b), rtol=1e-14)
        assert np.all(np.abs(at(balls.cross(a, b)) - np.cross(at(a), at(b))) <= balls.cross(a, b).rad)
    for axis in (0, 1):
        found = balls.stacked([a, short], axis)
        np.testing.assert_array_equal(found.mid, np.stack([a.mid, short.mid], axis))
        np.testing.assert_array_equal(found.lin[1], np.stack([a.lin[1], 0.0 * short.mid], axis))
        assert found.boxed == 1
    exact = (
        Affine(np.eye(3)[0], np.zeros((0, 3)), np.zeros(3), 0),
        Affine(np.eye(3)[1], np.zeros((0, 3)), np.zeros(3), 0),
    )
    np.testing.assert_array_equal(balls.cross(*exact).mid, np.eye(3)[2])
    np.testing.assert_array_equal(balls.cross(*exact[::-1]).mid, -np.eye(3)[2])
