"""Columns that depend on others to a share, of two bodies whose motions, sizes and shares can be written down."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.programs.tape import Tape
from ccpin.proof.facts import NotProvedError, prove

pytest.importorskip("flint")
from ccpin.identification.combinations.dependent_columns import DependentColumns, Rubbing, fastest_of, rubbing_of
from ccpin.identification.combinations.dependent_search import points_of
from ccpin.identification.combinations.identification_equations import IdentificationEquations, Seen
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.identification.combinations.vanishing import JoinedBody
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.loop_equations import ClosedLoopEquations

SLOPE, HALF, RHO, ORDER = 1e-9, 0.02, 40.0, 16
PLACED = tuple(tuple(Fraction(int(i == j)) for j in range(4)) for i in range(4))
SLIDE = JoinedBody(0, ((Fraction(1), Fraction(0), Fraction(0)),), (True,), PLACED, ("armature", "damping", "friction"))


def equations_of(rates, *, turning=1.0, freedoms=1, closed=True):
    """Two bodies that slide along x at two rates, and q² + y² = 1."""
    with flint().ctx.workprec(128):
        tape = Tape(2 * freedoms + closed)
        q, y, v = (*tape.inputs, *tape.inputs[-1:] * 2)[:3]
        zero = v - v
        drift = in_balls(tape, [v * turning, *[zero] * (2 * freedoms + closed - 1)])
        closure = in_balls(tape, [q * q + y * y - 1] if closed else [])
        slopes = in_balls(tape, [y * 2])
        loop = ClosedLoopEquations(
            freedoms + closed, freedoms, (0,) * freedoms, drift, closure, slopes, drift, in_balls(tape, [zero, zero])
        )
        own = [zero + rate(q, y) for rate in rates]
        twists = [x for rate in own for x in (rate, *[zero] * 5)][: 12 * freedoms]
        gravity = [x for _ in own for x in (zero + 3.0, zero, zero - 9.0)]
        motions = in_balls(tape, [*twists, *gravity, *own[: 2 * freedoms]])
        return IdentificationEquations(loop, motions, (SLIDE, SLIDE), (), (Fraction(0), Fraction(0), Fraction(-9)))


def claim_of(equations):
    """Mass and friction of the one for those of the other, over |q| ≤ 0.02."""
    points = points_of(1, ORDER)
    with flint().ctx.workprec(128):
        at = [(1 - (ball(HALF) * ball(xi)) ** 2).sqrt().mid() for xi in points[:, 0].tolist()]
        closed = np.array([boxed([y], 128).parts for y in at])
    series, term, reach = np.zeros((1, ORDER + 1)), 1.0, HALF * (RHO + 1.0 / RHO) / 2.0
    for k in range(ORDER // 2 + 1):
        series[0, 2 * k] = term
        term *= (k - 0.5) / (k + 1) * reach**2
    z = np.zeros((2, equations.sizes["P"]))
    z[[0, 0, 1, 1], [0, 10, 22, 25]] = 1.0, -1.0, 1.0, -1.0
    return DependentColumns(
        equations, np.zeros(1), np.array([HALF]), np.array([RHO]), series, np.array([1e-4]),
        np.array([ORDER, ORDER]), points, closed, np.array([0, 22]), z, np.array([1e-8]), np.array([128]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def claim():
    return claim_of(equations_of((lambda q, y: q * q + y * y, lambda q, _: q * SLOPE + 1)))


def refused(claim, match):
    with pytest.raises(NotProvedError, match=match):
        prove(claim)


def test_shares_are_what_rates_differ_by(claim):
    """1² − (1 + sq)² of 3 + 3 at a mass, and sq of 1 + 1 at a friction: σ's rate is 1 where the loop is closed."""
    (masses, frictions), s = claim.combinations, SLOPE * HALF
    exact = (2.0 * s + s**2) / (3.0 + 3.0 * (1.0 + s) ** 2), s / (2.0 + s)
    for z, share in zip((masses, frictions), exact, strict=True):
        alone = replace(claim, combinations=z[None], columns=np.array([np.argmax(z)]))
        left = prove(alone).found["left"]
        assert share <= left[0, 0] <= share * (1.0 + 1e-5)
    both = prove(claim).found["left"][0]
    np.testing.assert_allclose(both, exact, rtol=1e-5)


def test_what_the_theorem_asks_is_asked(claim):
    """q̇ the rates of q; some of them; closures; and a branch that is one."""
    rates = (lambda q, y: q, lambda q, y: q)
    z, points = np.zeros((1, 26)), np.zeros((1, 0))
    z[0, 0] = 1.0
    refused(replace(claim, equations=equations_of(rates, turning=2.0)), "no closures")
    still = replace(
        claim, equations=equations_of(rates, freedoms=0), q=np.zeros(0), half=np.zeros(0), points=points,
        closed=claim.closed[:1, :1], y=claim.y[:, :1], combinations=z, columns=np.array([0]),
    )  # fmt: skip
    refused(still, "no closures")
    free = equations_of(rates, closed=False)
    refused(replace(claim, equations=free, y=claim.y[:0], radius=claim.radius[:0], closed=claim.closed[:, :0]), "no cl")
    refused(replace(claim, y=0.0 * claim.y), "not proved to be analytic")
    refused(replace(claim, y=claim.y[:, :-1]), "other degrees")


@pytest.fixture(scope="module")
def five_bar():
    """The five-bar's: two numbers of q."""
    with flint().ctx.workprec(53):
        return recorded_motions(ccpin.ReducedModel(ccpin.load("rpdr")))[0]


def test_long_series_are_refused(five_bar):
    """Roundings of 4,000 terms are counted: C(91, 2) = 4,095 of two numbers of q are more."""
    y, p = len(five_bar.loop.dependent), five_bar.sizes["P"]
    refused(
        DependentColumns(
            five_bar, np.zeros(2), np.ones(2), np.array([4.0]), np.zeros((y, 153)), np.ones(y), np.array([16, 89]),
            np.zeros((4095, 2)), np.zeros((4095, y, 1)), np.array([0]), np.eye(1, p), np.ones(1), np.array([53]),
        ),
        "more terms",
    )  # fmt: skip


@pytest.fixture(scope="module")
def sliding():
    """The slider-crank's: joints that turn and one that slides."""
    with flint().ctx.workprec(53):
        return recorded_motions(ccpin.ReducedModel(ccpin.load("slider_crank")))[0]


def test_what_is_fastest(sliding):
    """At two points of random numbers, by kinds."""
    rng, count = np.random.default_rng(3), len(sliding.bodies)
    numbers = rng.normal(size=(2, len(sliding.motions.outputs)))
    seen = [sliding.arranged([ball(x) for x in row]) for row in numbers.tolist()]
    found = fastest_of(sliding, seen)
    sizes = np.abs(numbers)
    twists, gravity, rates = np.split(sizes, np.cumsum([6 * count, 3 * count]), axis=1)
    slides = [slide for body in sliding.bodies for slide in body.slides]
    assert len(set(slides)) == 2
    rho, stretches = rates[:, : len(slides)], rates[:, len(slides) :]
    parts = twists.reshape(2, count, 2, 3).max(axis=(0, 1, 3))

    def near(given, exact):
        found = np.array([float(x.rad()) for x in given])
        np.testing.assert_allclose(found, exact, rtol=1e-8)

    for body in range(count):
        near(found.twists[body][0], np.repeat(parts, 3))
        near(found.gravity[body], np.full(3, gravity.max()))
    for row, slide in zip(found.rho, slides, strict=True):
        near(row, [rho[:, np.equal(slides, slide)].max()])
    assert stretches.shape[1] == len(found.stretches) == len(slides)
    for row, slide in zip(found.stretches, slides, strict=True):
        near(row, [stretches[:, np.equal(slides, slide)].max()])


def test_the_largest_share_is_told(claim, five_bar):
    """Of a combination's forms, and of what friction leaves of it along either number of q, whichever is more."""
    seen = five_bar.arranged([ball(2.0)] * len(five_bar.motions.outputs))
    (first, _), (second, _), *_ = five_bar.frictions
    both = np.zeros((1, five_bar.sizes["P"]))
    both[0, [0, first, second]] = 1.0, 1.0, -1.0
    rubbing = Rubbing(np.eye(1, len(seen.rho)) - np.eye(1, len(seen.rho), 1), np.zeros(1, dtype=np.int64))
    own = replace(claim, equations=five_bar, combinations=both)
    count = len(five_bar.smooth_forms(seen))
    for place, size in ((0, 3 * 2.0**2), (count, 2 * 2.0), (count + 1, 2 * 2.0)):
        most = np.zeros(count + 2)
        most[place] = 1.0
        assert own._by_size(most, [seen], rubbing)[0] == pytest.approx(1.0 / size, rel=1e-5)


def test_friction_of_joints_of_other_kinds_is_refused():
    """A hinge's beside a ball joint's: they have no rates in common."""
    equations = SimpleNamespace(frictions=[(0, (0,)), (1, (1, 2, 3))])
    seen = Seen([[[ball(0)] * 6]], [[ball(0)] * 3], [[ball(1)]] * 4, [])
    with pytest.raises(NotProvedError, match="other rates"):
        rubbing_of(equations, np.array([[1.0, -1.0]]), seen)
    found = rubbing_of(equations, np.array([[0.0, -1.0]]), seen)
    assert found.weights.tolist() == [[0.0, *row] for row in (-np.eye(3)).tolist()]
    assert found.owners.tolist() == [0, 0, 0]


def test_where_friction_stands(sliding):
    """Beside each joint's name, and of its own rates."""
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    joints = model.mechanism.tree.joints
    for joint, (place, rates) in zip(joints, sliding.frictions, strict=True):
        assert model.parameters.names[place] == f"friction:{joint.name}"
        assert list(rates) == list(range(joint.v.start, joint.v.stop))
