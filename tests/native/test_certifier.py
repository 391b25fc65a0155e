"""Certificates of the compiled core: the reference's boxes, and margins that hold in ball arithmetic."""

import threading
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin import backend
from ccpin.covering.cells import CellTree
from ccpin.covering.faces import contacts_of
from ccpin.covering.proposals.krawczyk import certify_boxes, certify_points
from ccpin.covering.proposals.solving import glued, newton
from ccpin.covering.region import Region
from ccpin.domain import certify
from ccpin.domain.closures.system import reading_of
from ccpin.native.certifier import certifier, numbers_of
from ccpin.proof.equations import Derivatives, closure_values, closures_of, derivatives, problem_of
from ccpin.proof.newton import Boxes, bounds_of, check
from tests.support.closures import ARMS, KINDS, PLANAR, SPATIAL, closed_problem, open_problem, two_arms
from tests.support.long_cases import later

if backend().name != "native":
    pytest.skip(backend().reason, allow_module_level=True)

PROBLEMS = [(n, "planar") for n in PLANAR] + [(n, "reach") for n in ("rpdr", *SPATIAL)]
both = pytest.mark.parametrize(("name", "bounds"), PROBLEMS)


def by_numpy(monkeypatch, function, *arguments):
    """What the reference says."""
    with monkeypatch.context() as patch:
        patch.setenv("CCPIN_BACKEND", "numpy")
        return function(*arguments)


def close(first, second, tolerance=1e-9):
    """Whether arrays agree relative to the larger of 1 and their size."""
    return np.allclose(first, second, rtol=tolerance, atol=tolerance)


def squares(problem, theta, widths):
    """Boxes of many sizes about one configuration."""
    n = problem.system.n
    return np.tile(theta, (len(widths), 1)), np.repeat(widths[:, None], n, 1), np.eye(n)


def skewed(problem, theta, widths, seed=1):
    """Boxes of many sizes about θ with modes that are no rotation, and radii and weights at random."""
    rng, m = np.random.default_rng(seed), problem.system.m
    boxes = certify_boxes(problem, *squares(problem, theta, widths)).boxes
    skew = rng.standard_normal((len(widths), m, m)) * 0.2 + np.eye(m)
    return boxes._replace(
        modes=boxes.modes @ skew,
        preconditioner=np.linalg.inv(skew) @ boxes.preconditioner,
        radius=widths[:, None] * rng.uniform(0.1, 1, (len(widths), m)),
        weight=rng.uniform(0.5, 1, (len(widths), m)),
    )


def assert_same_bounds(problem, theta):
    core = certifier(problem.system, problem.phasors)
    phi, jacobian = core.values(theta[None])
    for found, expected in zip((phi, jacobian), closure_values(problem, theta[None]), strict=True):
        assert close(found, expected, 1e-13)
    plain = certify_boxes(problem, *squares(problem, theta, np.geomspace(1e-3, 0.3, 5))).boxes
    plain = plain._replace(radius=plain.half[:, :1] + 0 * plain.radius, weight=np.ones_like(plain.weight))
    for boxes in (plain, skewed(problem, theta, np.geomspace(1e-3, 0.3, 5))):
        expected = bounds_of(problem, boxes)
        y, image, shrunk = core.bounds(tuple(boxes))
        assert np.allclose(y, expected.y, rtol=1e-9)
        assert np.allclose(image, expected.mean(boxes.radius).of(boxes.radius), rtol=1e-9)
        assert np.allclose(shrunk, expected.contraction(boxes.radius).of(boxes.weight), rtol=1e-9)


@both
def test_bounds_are_the_reference_s(name, bounds):
    """φ, φ_θ, Y, Z̄R and Zw of boxes with V = I and with any V."""
    assert_same_bounds(*closed_problem(name, bounds))


@pytest.mark.parametrize("arms", ARMS.values(), ids=ARMS)
@pytest.mark.parametrize("kind", KINDS)
def test_bounds_are_the_reference_s_for_every_kind_of_closure(arms, kind):
    """The same with directions, offsets, couplings, slides after turns and many-axis joints, at open points."""
    assert_same_bounds(*open_problem(arms, kind))


@both
def test_boxes_are_the_reference_s(monkeypatch, name, bounds):
    """The same boxes are proved, with the same numbers, and the reference's check accepts each."""
    problem, theta = closed_problem(name, bounds)
    cells = squares(problem, theta, np.geomspace(1e-6, 1.0, 40))
    found, expected = certify_boxes(problem, *cells), by_numpy(monkeypatch, certify_boxes, problem, *cells)
    assert np.array_equal(found.proved, expected.proved)
    assert np.count_nonzero(found.proved) > 20
    assert np.all(check(closures_of(problem), found.boxes.take(found.proved)).proved)
    for field in ("directions", "radius", "weight", "kappa"):
        mine, theirs = getattr(found.boxes, field), getattr(expected.boxes, field)
        assert close(mine[found.proved], theirs[found.proved])


@both
def test_points_newton_and_gluing_are_the_reference_s(monkeypatch, name, bounds):
    """Newton, enclosed points and which boxes carry the same σ at common and at other points."""
    problem, theta = closed_problem(name, bounds)
    rng, dependent = np.random.default_rng(4), problem.system.dependent
    starts = np.tile(theta, (12, 1))
    starts[:, dependent] += rng.uniform(-0.05, 0.05, (12, len(dependent)))
    found, expected = newton(problem, starts, 8), by_numpy(monkeypatch, newton, problem, starts, 8)
    assert np.array_equal(found.settled, expected.settled)
    assert close(found.theta[found.settled], expected.theta[found.settled])
    points, reference = (
        certify_points(problem, found.theta),
        by_numpy(monkeypatch, certify_points, problem, found.theta),
    )
    assert np.array_equal(points.proved, reference.proved)
    tried = certify_boxes(problem, *squares(problem, theta, np.geomspace(1e-6, 1e-3, 12)))
    boxes = tried.boxes.take(tried.proved)
    assert len(boxes.kappa) > 6
    far = boxes._replace(centre=boxes.centre + 0.5 * boxes.radius.max() * np.isin(np.arange(len(theta)), dependent))
    for other in (boxes, far):
        case = boxes, 0.3 * boxes.half, other, 0.3 * boxes.half
        assert np.array_equal(glued(problem, *case), by_numpy(monkeypatch, glued, problem, *case))
    assert np.all(glued(problem, boxes, 0.3 * boxes.half, boxes, 0.3 * boxes.half))


@pytest.mark.slow
def test_the_atlas_is_the_reference_s(monkeypatch, rpdr):
    """Every cell of the torus and of a box of the Delta's, with its fate; each certified box passes NumPy's check."""
    cube = np.full(3, -0.2), np.full(3, 0.3)
    cases = ((rpdr, np.radians((-108.0, -48.0)), None, 5), (ccpin.load("delta"), np.zeros(3), cube, 3))
    for mechanism, q0, region, depth in cases:
        found = certify(mechanism, q0, region, max_depth=depth)
        expected = by_numpy(monkeypatch, lambda m=mechanism, q=q0, r=region, d=depth: certify(m, q, r, max_depth=d))
        assert all(np.array_equal(*pair) for pair in zip(found.tree.cells, expected.tree.cells, strict=True))
        assert np.array_equal(found.unglued, expected.unglued)
        assert close(found.boxes.centre, expected.boxes.centre)
        assert np.all(found.verify())


def test_contacts_are_the_reference_s(monkeypatch):
    """Shared faces in trees halved at random, across the seam too: the same, in the same order."""
    rng = np.random.default_rng(0)
    for n in (1, 2, 3):
        tree, region = CellTree.whole(n), Region(np.zeros(n), np.ones(n), np.arange(n) % 2 == 0)
        for _ in range(8):
            leaves = tree.leaves()
            chosen = rng.choice(leaves, 1 + len(leaves) // 2, replace=False)
            tree.split(chosen, rng.integers(0, n, len(chosen)))
        cells = tree.leaves()[::3]
        found, expected = contacts_of(tree, region, cells), by_numpy(monkeypatch, contacts_of, tree, region, cells)
        assert all(np.array_equal(*pair) for pair in zip(found, expected, strict=True))


def test_threads_share_a_certifier(rpdr):
    """Many threads at once get what one alone gets."""
    problem, theta = closed_problem("rpdr", "planar")
    cells = squares(problem, theta, np.geomspace(1e-4, 0.3, 200))
    expected, found = certify_boxes(problem, *cells), []
    threads = [threading.Thread(target=lambda: found.append(certify_boxes(problem, *cells))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    for tried in found:
        assert np.array_equal(tried.proved, expected.proved)
        assert all(np.array_equal(*pair) for pair in zip(tried.boxes, expected.boxes, strict=True))


def test_what_the_core_cannot_answer_for_is_left_to_numpy(rpdr):
    """Axes that are not unit vectors to rounding are outside of the margins' proof; wrong shapes are refused."""
    system = reading_of(rpdr, rpdr.q_reference).system
    first = system.chains[0]
    loose = replace(system, chains=(first._replace(axes=first.axes * (1.0 + 1e-12)), *system.chains[1:]))
    assert certifier(system, None) is not None
    assert certifier(loose, None) is None
    core = certifier(system, None)
    with pytest.raises(ValueError, match="shape"):
        core.newton(np.zeros((2, 3)), 1, 1e-9)
    with pytest.raises(ValueError, match="shape"):
        core.certify_boxes(np.zeros((2, 4)), np.zeros((3, 2)), np.eye(2))
    assert core.newton(np.full((1, 4), np.nan), 5, 1e-9)[1].tolist() == [False]


# In ball arithmetic, from the chains alone.

flint = pytest.importorskip("flint")
arb = flint.arb


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def exact(values):
    return [arb(float(x)) for x in values]


def turned(axis, angle, vector):
    """E(θ)v and E′(θ)v of a turn about an axis (Rodrigues)."""
    c, s, across, along = angle.cos(), angle.sin(), cross(axis, vector), dot(axis, vector)
    value = [v * c + w * s + a * along * (1 - c) for v, w, a in zip(vector, across, axis, strict=True)]
    rate = [-v * s + w * c + a * along * s for v, w, a in zip(vector, across, axis, strict=True)]
    return value, rate


def tip_of(chain, theta):
    """The tip of a chain and its derivatives by its joints, from the tip up to the root."""
    tip, rates = exact(chain.tip), {}
    for k in reversed(range(len(chain.joints))):
        axis, rotation = exact(chain.axes[k]), [exact(row) for row in chain.rotations[k]]
        angle, sliding = theta[chain.joints[k]], bool(chain.prismatic[k])
        if sliding:
            own = [arb(0)] * 3 if chain.direction else axis
            tip = [x + angle * a for x, a in zip(tip, own, strict=True)]
        else:
            rates = {j: turned(axis, angle, rate)[0] for j, rate in rates.items()}
            tip, own = turned(axis, angle, tip)
        rates = {j: [dot(row, rate) for row in rotation] for j, rate in (rates | {chain.joints[k]: own}).items()}
        tip = [dot(row, tip) for row in rotation]
        if not chain.direction:
            tip = [x + t for x, t in zip(tip, exact(chain.translations[k]), strict=True)]
    return tip, rates


def exact_values(system, theta):
    """φ and φ_θ at θ given in balls."""
    phi = [dot(exact(row), theta) + arb(float(d)) for row, d in zip(system.couplings, system.offset, strict=True)]
    jacobian = [exact(row) for row in system.couplings]
    for chain in system.chains:
        tip, rates = tip_of(chain, theta)
        for r in np.flatnonzero(np.any(chain.weights != 0.0, axis=1)):
            weight = exact(chain.weights[r])
            phi[r] += dot(weight, tip)
            for j, rate in rates.items():
                jacobian[r][j] += dot(weight, rate)
    return phi, jacobian


def exceeded(problem, boxes, bounds, trials=4):
    """How many of Y, Z̄R and Zw are exceeded in ball arithmetic, at corners and inside of boxes."""
    system, rng, count = problem.system, np.random.default_rng(8), 0
    for k in range(len(boxes.kappa)):
        box = Boxes(*(array[k] for array in boxes))
        y, image, shrunk = (part[k] for part in bounds)
        for trial in range(trials):
            sides = [
                rng.choice([-1.0, 1.0], size) if trial % 2 else rng.uniform(-1, 1, size)
                for size in (system.n, system.m)
            ]
            delta, zeta = exact(box.half * sides[0]), exact(box.radius * sides[1])
            base = [arb(float(c)) + dot(exact(row), delta) for c, row in zip(box.centre, box.directions, strict=True)]
            moved = list(base)
            for row, j in zip(box.modes, system.dependent, strict=True):
                moved[j] += dot(exact(row), zeta)
            preconditioner = [exact(row) for row in box.preconditioner]
            phi, (whole, jacobian) = exact_values(system, base)[0], exact_values(system, moved)
            modes = [exact(column) for column in box.modes.T]
            for i, row in enumerate(preconditioner):
                f, moved_f = dot(row, phi), dot(row, whole)
                weighted = [dot(row, [line[j] for line in jacobian]) for j in system.dependent]
                defect = sum(
                    (
                        abs(arb(int(i == e)) - dot(weighted, mode)) * float(w)
                        for e, (mode, w) in enumerate(zip(modes, box.weight, strict=True))
                    ),
                    arb(0),
                )
                holds = abs(f) <= y[i], abs(zeta[i] - moved_f + f) <= image[i], defect <= shrunk[i]
                count += sum(not bool(h) for h in holds)
    return count


@pytest.fixture
def precise():
    """200 bits."""
    before, flint.ctx.prec = flint.ctx.prec, 200
    yield
    flint.ctx.prec = before


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("rpdr", "planar"),
        pytest.param("planar_3rrr", "planar", marks=pytest.mark.slow),
        ("rpdr", "reach"),
        ("delta", "reach"),
    ],
)
def test_margins_hold_in_ball_arithmetic(precise, name, bounds):
    """Y, Z̄R and Zw as computed are above the exact ones in boxes of any size, most of all where rounding decides.

    Without the margin they would not be: with γ = 0 the same audit finds them exceeded.
    """
    problem, theta = closed_problem(name, bounds)
    core, few = certifier(problem.system, problem.phasors), 3 if name == "delta" else 8
    careless = type(core)(numbers_of(problem.system, problem.phasors) | {"gamma": 0.0})
    tiny, some = np.full(few, 1e-18), np.geomspace(1e-13, 0.2, few)
    for widths in (tiny, some):
        boxes = skewed(problem, theta, widths)
        assert exceeded(problem, boxes, core.bounds(tuple(boxes))) == 0
    boxes = skewed(problem, theta, tiny)
    assert exceeded(problem, boxes, careless.bounds(tuple(boxes))) > 0


@pytest.mark.parametrize("arms", ARMS.values(), ids=ARMS)
@pytest.mark.parametrize("kind", ["revolute", "fixed", "cylindrical", "planar"])
def test_values_are_within_their_margin(precise, arms, kind):
    """φ and φ_θ of every kind of chain are within γ · magnitude of the exact ones, at hundreds of radians too."""
    mechanism = two_arms(arms, kind)
    system = reading_of(mechanism, mechanism.q_reference).system
    core, rng = certifier(system, None), np.random.default_rng(6)
    theta = np.concatenate([rng.uniform(-3, 3, (2, mechanism.n_free)), rng.uniform(-500, 500, (1, mechanism.n_free))])
    margin = system.rounding * system.magnitude(theta)
    for k, found in enumerate(zip(*core.values(theta), strict=True)):
        phi, jacobian = exact_values(system, exact(theta[k]))
        for computed, true in zip(found, (phi, jacobian), strict=True):
            pairs = zip(np.ravel(computed), np.ravel(np.array(true, dtype=object)), strict=True)
            assert all(abs(arb(float(c)) - t) <= margin[k] for c, t in pairs)


@pytest.mark.parametrize("arms", ARMS.values(), ids=ARMS)
@pytest.mark.parametrize("kind", ["revolute", *later("cylindrical", "fixed", "planar")])
@pytest.mark.parametrize("states", later(1, 2))
def test_second_derivatives_are_within_their_margin(precise, arms, kind, states):
    """φ_θθ is within γ · magnitude of the exact difference quotient of φ_θ (steps of 2⁻⁶⁰); the rest is NumPy's."""
    mechanism = two_arms(arms, kind)
    system = reading_of(mechanism, mechanism.q_reference).system
    problem, rng = problem_of(system, "reach"), np.random.default_rng(7)
    theta = rng.uniform(-3, 3, (states, mechanism.n_free))
    found = Derivatives(*certifier(system, None).derivatives(theta))
    for computed, reference in zip(found, derivatives(problem, theta), strict=True):
        np.testing.assert_allclose(computed, reference, atol=1e-12)
    margin, step = system.rounding * system.magnitude(theta), arb(2) ** -60
    for k, hessian in enumerate(found.hessian):
        for column in range(mechanism.n_free):
            ends = []
            for side in (-1, 1):
                moved = exact(theta[k])
                moved[column] = moved[column] + side * step
                ends.append(np.ravel(np.array(exact_values(system, moved)[1], dtype=object)))
            for computed, low, high in zip(np.ravel(hessian[:, :, column]), *ends, strict=True):
                assert abs(arb(float(computed)) - (high - low) / (2 * step)) <= margin[k]


def test_angles_of_many_turns_have_wider_margins(precise):
    """Planar closures add angles up, so that large ones cost accuracy: the margin grows with them and still holds."""
    problem, theta = closed_problem("planar_3rrr", "planar")
    system, core = problem.system, certifier(problem.system, problem.phasors)
    turned = theta + 2.0 * np.pi * np.random.default_rng(3).integers(-20_000, 20_000, (6, system.n_free))
    margin = system.rounding * system.magnitude(turned)
    worst = 0.0
    for k, phi in enumerate(core.values(turned)[0]):
        errors = [abs(arb(float(c)) - t) for c, t in zip(phi, exact_values(system, exact(turned[k]))[0], strict=True)]
        assert all(error <= margin[k] for error in errors)
        worst = max(worst, *(float(error.mid()) for error in errors))
    assert worst > system.rounding * system.scale
