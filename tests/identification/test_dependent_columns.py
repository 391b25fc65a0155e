"""Columns of the regressor that depend on others to 1e-12 over a box: regressors there, and claims that are false."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.proof.facts import NotProvedError, prove

pytest.importorskip("flint")
from ccpin.identification import base_parameters
from ccpin.identification.combinations.dependent_columns import branch_of, fastest_of, reach, rubbing_of
from ccpin.identification.combinations.dependent_search import depend
from ccpin.identification.combinations.identification_equations import Seen
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.validated.arithmetic.balls import ball, flint, upper
from ccpin.validated.arithmetic.exact_numbers import centres


def model_of(name):
    return ccpin.ReducedModel(ccpin.load(name))


@pytest.fixture(scope="module")
def loop():
    """Bennett's, of which structure does not show that opposite joints turn alike."""
    model = model_of("bennett")
    return model, base_parameters(model, precision=200)


@pytest.fixture
def claim(loop):
    return loop[1].facts[2].claim


def at(model, q):
    """The state of the reference's branch where q are the numbers."""
    start = model.alpha(model.mechanism.q_reference)
    return model.at(model.coordinates.integrate(start, q - start))


def test_all_others_are_made_of_as_many_as_are_independent(loop):
    """11 for which structure has no reason; the number is proved, and what it is over is told."""
    _, told = loop
    assert told.proved
    assert (told.lower, told.within, told.upper) == (15, 15, 26)
    assert told.box.tolist() == [0.05]
    assert told.grouping.shape == (15, 45)
    assert np.array_equal(told.grouping[:, told.base], np.eye(15))
    assert "1e-12 of their size over ±0.05" in told.reason
    assert "at most 26" in told.reason
    assert len(told.words) == len(told.values) == 15


def test_regrouped_constants_make_the_same_forces_in_the_box(loop):
    """Y π = Y_base (grouping π) for any π at random states of the box."""
    model, told = loop
    rng, start = np.random.default_rng(5), model.alpha(model.mechanism.q_reference)
    for _ in range(20):
        state = at(model, start + told.box * rng.uniform(-1.0, 1.0, model.n))
        Y = state.regressor(*rng.normal(size=(2, model.n)))
        pi = rng.normal(size=len(told.parameters))
        assert np.abs(Y[:, told.base] @ (told.grouping @ pi) - Y @ pi) <= 1e-12 * (np.abs(Y) @ np.abs(pi))


def test_what_is_found_is_what_is_left(loop, claim):
    """Shares are above the forms of combinations at states of the box, by the largest that bodies do there."""
    model, told = loop
    equations, left = claim.equations, told.facts[2].found["left"][0]
    assert left.shape == (11,)
    with flint().ctx.workprec(128):
        y = centres(claim.closed[3])
        box = branch_of(claim).closed(
            [ball(claim.q[0]) + ball(claim.half[0]) * ball(claim.points[3, 0])],
            claim.points[3] * claim.half / reach(claim.half, claim.rho[0]),
            y,
        )
        seen = equations.seen(box)
        forms = flint().arb_mat(equations.smooth_forms(seen)) * flint().arb_mat(claim.combinations.T.tolist())
        size = flint().arb_mat(equations.smooth_forms(fastest_of(equations, [seen]))).tolist()
    sizes = np.array([[upper(abs(x)) for x in row] for row in size]) @ np.abs(claim.combinations).T
    values = np.array([[upper(abs(x)) for x in row] for row in forms.tolist()])
    assert np.all(values <= left * sizes * 1.5 + 1e-290)
    state = at(model, claim.q + claim.half * claim.points[3])
    assert float(seen.rho[1][0].mid()) == pytest.approx(state.rho[1, 0], rel=1e-12)


def test_it_is_proved_again(loop):
    """From its data alone."""
    fact = loop[1].facts[2]
    assert fact.replay().digest == fact.digest


def forged(claim, match, **arrays):
    with pytest.raises(NotProvedError, match=match):
        prove(replace(claim, **{name: np.asarray(array) for name, array in arrays.items()}))


def test_other_combinations_are_refused(claim):
    """A coefficient that is off by 1e-6, of any kind of constant."""
    places = [(s, k) for s, k in zip(*np.nonzero(claim.combinations), strict=True) if k not in claim.columns]
    kinds = {}
    for s, k in places:
        kinds.setdefault((int(claim.columns[s]) >= 30, k), s)
    for (_, k), s in list(kinds.items())[:8]:
        wrong = claim.combinations.copy()
        wrong[s, k] *= 1.0 + 1e-6
        forged(claim, "more than this share", combinations=wrong)
    forged(claim, "more than this share", share=[1e-20])
    forged(claim, "depend on each other", columns=[claim.columns[1], *claim.columns[1:]])
    forged(claim, "constant that is none", columns=[45, *claim.columns[1:]])


def test_friction_of_joints_that_do_not_turn_alike_is_refused(claim):
    """Joint 2's for joint 3's; the other sign; a third joint."""
    names = [place for place, _ in claim.equations.frictions]
    row = next(s for s, k in enumerate(claim.columns) if k in names)
    (partner,) = [k for k in names if claim.combinations[row, k] and k != claim.columns[row]]
    third = next(k for k in names if not claim.combinations[row, k])
    for change, match in (
        ({partner: 0.0, third: -1.0}, "more than"),
        ({partner: 0.0}, "more than"),
        ({partner: 1.0}, "adds up"),
        ({third: 1e-9}, "more than two"),
    ):
        wrong = claim.combinations.copy()
        for k, value in change.items():
            wrong[row, k] = value
        forged(claim, match, combinations=wrong)


def test_signs_of_friction_are_those_of_rates(claim):
    """ρ_k and ρ_b alike: what one has is taken from the other, whichever way it turns."""
    equations = claim.equations
    first, second = (place for place, _ in equations.frictions[:2])
    z = np.zeros((2, equations.sizes["P"]))
    z[0, first], z[0, second], z[1, second] = 1.0, -2.0, 3.0
    own = len(equations.frictions) - 2
    with flint().ctx.workprec(64):
        for turned in (1.0, -1.0):
            rho = [[ball(2.0)], [ball(turned)], *[[ball(0.5)]] * own]
            seen = _seen_with(claim, rho)
            found = rubbing_of(equations, z, seen)
            assert found.owners.tolist() == [0, 1]
            assert found.weights[:, :2].tolist() == [[1.0, -2.0 * turned], [0.0, 3.0]]


def _seen_with(claim, rho):
    bodies = len(claim.equations.bodies)
    nothing = [[ball(0)] * 6] * claim.equations.loop.n
    return Seen([nothing] * bodies, [[ball(0)] * 3] * bodies, rho, [])


def test_other_boxes_are_refused(claim):
    """A wider one, another, ellipses that σ does not reach, polynomials that are not σ, and of too low a degree."""
    forged(claim, r"analytic|another sheet", half=30.0 * claim.half)
    forged(claim, r"analytic|another sheet", half=1.01 * claim.half)
    forged(claim, r"analytic|another sheet", q=claim.q + 0.05)
    forged(claim, "analytic", rho=[40.0])
    forged(claim, "analytic", y=claim.y + 0.1)
    forged(claim, "analytic", radius=1e-12 * claim.radius)
    forged(claim, "analytic", radius=1e4 * claim.radius)
    forged(claim, "series of other degrees", orders=[16, 29])
    forged(claim, "series of other degrees", y=claim.y[:, :-1])
    forged(claim, "series of other degrees", points=claim.points[1:], closed=claim.closed[1:])
    forged(claim, "out of its range", points=1.2 * claim.points)
    forged(
        claim, "more than this share", points=np.ones_like(claim.points), closed=np.tile(claim.closed[:1], (31, 1, 1))
    )


def test_points_elsewhere_are_refused(claim):
    """y of another sheet, and y that is nearly σ: what is left is as large as that is off."""
    forged(claim, "another sheet", closed=claim.closed + 0.5)
    off = claim.closed.copy()
    off[:, :, 0] += 1e-9
    forged(claim, "more than this share", closed=off)


def test_what_rests_on_others_is_refused(loop, claim):
    with pytest.raises(NotProvedError, match=r"other equations|rests on nothing"):
        prove(claim, loop[1].facts[1])
    with pytest.raises(NotProvedError, match=r"other equations|rests on nothing"):
        prove(claim, loop[1].facts[0])


def test_another_mechanism_is_refused(claim):
    """The same numbers, of Bennett's loop with a link a little longer: opposite joints do not turn alike."""
    described = ccpin.load("bennett").description
    moved = described.joints[1].placement.copy()
    moved[:3, 3] *= 1.0 + 1e-7
    joints = (described.joints[0], replace(described.joints[1], placement=moved), *described.joints[2:])
    with flint().ctx.workprec(128):
        other, _ = recorded_motions(model_of(replace(described, joints=joints)))
    with pytest.raises(NotProvedError, match=r"more than this share|another sheet"):
        prove(replace(claim, equations=other))


def test_no_box_is_no_claim():
    """Without a box structure's combinations are told; of chains without closures nothing is looked for."""
    told = base_parameters(ccpin.load("bennett"), precision=120, states=9, box=None)
    assert told.box is None
    assert len(told.facts) == 2
    assert told.within == told.upper == len(told.base) == 26


def test_a_box_is_halved_until_sigma_is_there(loop, claim):
    """Over half a radian about the reference it does not go through at once."""
    x = np.concatenate([claim.q, claim.y[:, 0]])
    order = np.argsort([*claim.equations.loop.independent, *claim.equations.loop.dependent])
    fact = depend(claim.equations, x[order], 0.8, claim.columns, claim.combinations)
    assert 0.05 <= fact.claim.half[0] < 0.8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count", "base"),
    [("sarrus", 9, False), ("four_bar", 30, True), ("planar_3rrr", 81, True), ("delta", 90, False)],
)
def test_those_of_others(name, count, base):
    """As many as are independent make all others, where structure does not say so."""
    model = model_of(name)
    told = base_parameters(model, base=base)
    assert told.lower == told.within == count < told.upper
    rng, start = np.random.default_rng(5), model.alpha(model.mechanism.q_reference)
    for _ in range(5):
        state = at(model, start + told.box * rng.uniform(-1.0, 1.0, model.n))
        Y = state.regressor(*rng.normal(size=(2, model.n)))
        pi = rng.normal(size=len(told.parameters))
        assert np.all(
            np.abs(Y[:, told.base] @ (told.grouping @ pi) - Y @ pi) <= 1e-12 * (np.abs(Y) @ np.abs(pi)) + 1e-12
        )


def test_numbers_of_the_claim_are_sharp(loop, claim):
    """R is half the ellipses' longer axis, and the share the largest that is left of any combination."""
    half = np.array([0.5, 2.0])
    exact = half * (3.0 + 1.0 / 3.0) / 2.0
    assert np.all(exact <= reach(half, 3.0))
    assert np.all(reach(half, 3.0) <= exact * (1 + 1e-5))
    most = loop[1].facts[2].found["left"].max()
    forged(claim, "more than this share", share=[0.7 * most])
    assert prove(replace(claim, share=np.array([1.0001 * most])))
