"""Motors' limits over regions: attacked by closed forms, forged, and searched for wrongly."""

import pickle
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import ccpin
from ccpin.description.model import frame
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.facts import NotProvedError, prove
from ccpin.simulation import MotorModel
from ccpin.transmission import Transmission, certify_limits
from ccpin.transmission.limits_search import LimitsSearch, Sought
from tests.support.linkage_models import FORMS, MOTORS, ROTORS, loaded, transmission_of
from tests.support.long_cases import later

pytest.importorskip("flint")
REGIONS = {"ankle": ([-0.15, -0.1], [0.15, 0.1]), "knee": ([-0.5], [0.5]), "neck": ([-0.5, -0.4], [0.5, 0.4])}
SLANTED = np.array([[2.0, 0.5], [-0.3, 1.0]])


def by_joints(name, of, q):
    """J⁻ᵀ, or J, by the closed form."""
    J = FORMS[name].jacobian(q)
    return np.linalg.inv(J).T if of == "effort" else J


@pytest.mark.parametrize("of", ["effort", "speed"])
@pytest.mark.parametrize("form", ["box", "ellipsoid"])
def test_what_several_joints_ask_adds_up(of, form):
    """Teeth: J is constant, so that sums and roots of squares of rows of J⁻ᵀL (JL) are all that is asked."""
    found = transmission_of("neck")
    made = certify_limits(found, REGIONS["neck"], of, [2.0, 1.0], form=form, speed=20.0 if of == "speed" else None)
    rows = by_joints("neck", of, None) @ np.diag([2.0, 1.0])
    expected = np.abs(rows).sum(axis=1) if form == "box" else np.linalg.norm(rows, axis=1)
    asked = made.held.found["asked"][0]
    np.testing.assert_allclose(asked, expected, rtol=1e-5)
    assert (asked >= expected * (1 - 1e-12)).all()
    assert not made.held.found["lost"].any()


@pytest.mark.parametrize("of", ["effort", "speed"])
def test_an_ellipsoid_may_lie_aslant(of):
    """Signs count: rows of J⁻ᵀL, not of |J⁻ᵀ||L|; so of a box about slanted axes, as the theorem has it."""
    found = transmission_of("neck")
    size = SLANTED if of == "effort" else 0.5 * SLANTED
    made = certify_limits(found, REGIONS["neck"], of, size, form="ellipsoid", speed=9.0 if of == "speed" else None)
    rows = by_joints("neck", of, None) @ size
    np.testing.assert_allclose(made.held.found["asked"][0], np.linalg.norm(rows, axis=1), rtol=1e-5)
    np.testing.assert_allclose(made.half_widths, np.linalg.norm(size, axis=1), rtol=1e-14)
    claim, branch = made.held.claim, made.held.premises
    boxed = prove(replace(claim, rounded=np.array([False])), *branch)
    np.testing.assert_allclose(boxed.found["asked"][0], np.abs(rows).sum(axis=1), rtol=1e-5)


def test_of_a_shape_it_is_the_largest():
    found = transmission_of("neck")
    for form, norm in (("box", 1), ("ellipsoid", 2)):
        made = certify_limits(found, REGIONS["neck"], shape=[1.0, 3.0], form=form)
        np.testing.assert_allclose(made.size / made.size[0, 0], np.diag([1.0, 3.0]), rtol=1e-12)
        used = np.linalg.norm(by_joints("neck", "effort", None) @ made.size, norm, axis=1)
        np.testing.assert_allclose((used / made.room).max(), 1.0, rtol=1e-5)


def test_more_cells_than_are_looked_at_at_a_time():
    """Each of 512 has its own bound: above what the closed form asks for at its ends, and not far above."""
    found, (lower, upper) = transmission_of("knee"), map(np.array, REGIONS["knee"])
    ends = np.linspace(lower, upper, 513)
    rates = np.array([abs(FORMS["knee"].jacobian(q)[0, 0]) for q in ends])
    for of, at in (("effort", 3.0 / rates), ("speed", 3.0 * rates)):
        sought = Sought(of, "box", np.array([1e3]), np.zeros(1))
        fact, _ = LimitsSearch(found, found.reference, lower, upper, sought).cut(512, np.array([[3.0]]), fixed=True)
        asked = fact.found["asked"][:, 0]
        assert (asked >= np.maximum(at[1:], at[:-1])).all()
        np.testing.assert_allclose(asked, np.maximum(at[1:], at[:-1]), rtol=5e-3)


# Friction, and speeds at which efforts are to be there.


def rubbing(name, **levels):
    """A transmission whose joints state dry friction."""
    stated = {motor: {"armature": ROTORS[name]} for motor in MOTORS[name]}
    for joint, level in levels.items():
        stated[joint] = stated.get(joint, {}) | {"friction": level}
    return Transmission(loaded(name, joints=stated))


def test_friction_takes_what_its_work_says():
    """Of a rod's joint k its level times |∂q_k/∂q_m| everywhere; of the motor its level; of the knee nothing."""
    region = ([-0.05], [0.05])
    found = rubbing("knee", motor=1.5, rod_swing=2.0, knee=9.0)
    rates = [np.abs(found.at([q]).state.rho[:, 0] / found.at([q]).jacobian[0, 0]) for q in np.linspace(-0.05, 0.05, 9)]
    names = found.joint_model.mechanism.joints.names
    lost = 1.5 + 2.0 * max(rate[names.index("rod_swing")] for rate in rates)
    made = certify_limits(found, region, size=[1.0], max_cells=64)
    assert made.held.found["lost"].max() >= lost
    np.testing.assert_allclose(made.held.found["lost"].max(), lost, rtol=0.05)
    assert made.friction.tolist() == [1.5]
    other = certify_limits(found, region, size=[1.0], friction=0.25, max_cells=64)
    np.testing.assert_allclose(made.held.found["lost"] - other.held.found["lost"], 1.25, rtol=1e-5)
    for change in (
        {"friction": np.array([1.4])},
        {"transmission": rubbing("knee", motor=1.5, rod_swing=1.9, knee=9.0)},
    ):
        assert replace(made, **change).verdict == "undecided"
    whole = certify_limits(found, region, max_cells=64)
    used = whole.held.found["asked"] + whole.held.found["lost"]
    np.testing.assert_allclose(used.max(), whole.room[0], rtol=1e-6)


def test_what_motors_give_at_speed():
    """A line from 30 at rest to 10 at 20 rad/s, dampers of 0.1: at most 20 − 1 up to 10 rad/s."""
    found = transmission_of("knee")
    line = MotorModel(speeds=(0.0, 20.0), efforts=(30.0, 10.0))
    made = [
        certify_limits(found, ([-0.01], [0.01]), speed=speed, motors=line, effort=100.0, max_cells=1)
        for speed in (None, 10.0, 40.0)
    ]
    gear = abs(found.joint_model.mechanism.motors.gears[0])
    np.testing.assert_allclose([each.room[0] for each in made], np.multiply([30.0, 20.0, 10.0], gear), rtol=1e-14)
    stated = {"motor": {"armature": 0.1, "damping": 0.5}}
    damped = Transmission(loaded("knee", joints=stated))
    made = certify_limits(damped, ([-0.01], [0.01]), speed=10.0, effort=100.0, max_cells=1)
    np.testing.assert_allclose(made.room, [95.0], rtol=1e-14)
    bent = MotorModel(speeds=(0.0, 5.0, 20.0), efforts=(30.0, 8.0, 25.0))
    made = certify_limits(found, ([-0.01], [0.01]), speed=15.0, motors=bent, effort=100.0, max_cells=1)
    np.testing.assert_allclose(made.room, [8.0 * gear], rtol=1e-14)


def test_friction_of_a_ball_is_refused():
    with pytest.raises(UnsupportedMechanismError, match="several axes"):
        certify_limits(rubbing("ankle", left_ball=0.1), REGIONS["ankle"], max_cells=1)
    assert certify_limits(rubbing("ankle", left_ball=0.1), REGIONS["ankle"], "speed", max_cells=1).of == "speed"


# Forged claims.


def forged():
    """Claims that are false, or malformed, each a change of one that is proved."""
    return {
        "a larger box": {"size": lambda x: 1.01 * x},
        "a larger box, the other way round": {"size": lambda x: -1.01 * x},
        "a box of no number": {"size": lambda x: np.nan * x},
        "a box of one joint": {"size": lambda x: x[:1]},
        "friction that no motor has room for": {"friction": lambda x: x + 0.1},
        "friction that helps": {"friction": lambda x: x - 1.0},
        "friction of fewer": {"friction": lambda x: x[:-1]},
        "neither box nor ellipsoid": {"rounded": lambda x: np.array([False, True])},
        "weaker motors": {"room": lambda x: 0.99 * x},
        "motors that give nothing": {"room": lambda x: 0.0 * x},
        "a motor twice": {"motors": lambda x: x[[0, 0]]},
        "another number's place": {"motors": lambda x: np.array([x[0], x[1] + 1])},
        "a place that is none": {"motors": lambda x: x + 100},
        "a negative place": {"motors": lambda x: x - 100},
        "a joint for a motor": {"motors": lambda x: np.array([0, x[1]])},
        "no preconditioner": {"preconditioner": lambda x: 0.0 * x},
        "another preconditioner": {"preconditioner": lambda x: x[::-1]},
        "a smaller one": {"preconditioner": lambda x: x[:, :-1, :-1]},
        "too few": {"preconditioner": lambda x: x[:-1]},
        "no numbers": {"preconditioner": lambda x: np.nan * x},
        "huge ones": {"preconditioner": lambda x: 1e300 * x},
    }


@pytest.fixture(scope="module")
def held():
    return certify_limits(transmission_of("ankle"), REGIONS["ankle"], max_cells=256)


@pytest.mark.parametrize("name", forged())
def test_a_forged_claim_becomes_no_fact(held, name):
    claim, (branch,) = held.held.claim, held.held.premises
    change = {field: made(getattr(claim, field)) for field, made in forged()[name].items()}
    with pytest.raises(NotProvedError):
        prove(replace(claim, **change), branch)


def test_a_box_rests_on_its_branch(held):
    claim, (branch,) = held.held.claim, held.held.premises
    other = certify_limits(transmission_of("knee"), REGIONS["knee"], max_cells=64).held
    for premises in ((), (branch, branch), other.premises, (held.held,)):
        with pytest.raises(NotProvedError):
            prove(claim, *premises)
    assert held.held.replay().found["asked"].max() == held.held.found["asked"].max()


# The search, and what it answers.


@pytest.mark.parametrize("of", ["effort", "speed"])
@pytest.mark.parametrize("form", ["box", "ellipsoid"])
@pytest.mark.parametrize("name", ["knee", *later("neck", "ankle")])
@pytest.mark.parametrize(
    ("count", "part", "cells"), [(100, 0.4, 64), pytest.param(100_000, 1.0, 256, marks=pytest.mark.slow)]
)
def test_no_posture_of_the_region_asks_more(name, of, form, count, part, cells):
    """By the closed form at random postures and the region's corners, of corners of the box, or all round.

    A million points and more, slowly.
    """
    region = tuple(part * np.array(REGIONS[name]))
    made = certify_limits(
        transmission_of(name), region, of, form=form, max_cells=cells, speed=20.0 if of == "speed" else None
    )
    assert made.verdict == "proven", made.reason
    rng, n = np.random.default_rng(1), transmission_of(name).n
    ends = np.array(list(product(*zip(*region, strict=True))))
    signs = np.array(list(product([-1.0, 1.0], repeat=n)))
    most = 0.0
    for q in [*ends, *rng.uniform(*region, (count, n))]:
        ways = signs if form == "box" else rng.normal(size=(16, n))
        units = ways if form == "box" else ways / np.linalg.norm(ways, axis=1)[:, None]
        asked = np.abs(by_joints(name, of, q) @ made.size @ units.T)
        most = max(most, float((asked.max(axis=1) / made.room).max()))
    assert 0.8 < most <= 1.0  # nor is it far from what is so


@pytest.mark.parametrize("of", ["effort", "speed"])
def test_what_is_too_large_is_refuted_by_a_posture(of):
    found, more = transmission_of("knee"), {"speed": 20.0} if of == "speed" else {}
    known = certify_limits(found, REGIONS["knee"], of, **more)
    made = certify_limits(found, REGIONS["knee"], of, 1.5 * known.half_widths, max_cells=16, **more)
    assert made.verdict == "refuted"
    asked = np.abs(by_joints("knee", of, made.witness.q_joint) @ made.size)
    assert (asked > made.room).any()
    assert "asks too much" in repr(made)
    wide = certify_limits(found, REGIONS["knee"], of, 1.0001 * known.half_widths, max_cells=4, **more)
    assert wide.verdict == "undecided"
    assert "raise max_cells" in wide.reason


def test_what_was_pickled_or_altered_is_not_known(held):
    assert held.verdict == "proven"
    assert pickle.loads(pickle.dumps(held.held.claim)).size.tolist() == held.size.tolist()
    for change in (
        {"size": 1.1 * held.size}, {"lower": held.lower - 0.1}, {"upper": held.upper + 0.1}, {"room": 0.5 * held.room},
        {"held": None}, {"of": "speed"}, {"form": "ellipsoid"}, {"friction": held.friction + 1.0}, {"of": "power"},
    ):  # fmt: skip
        assert replace(held, **change).verdict == "undecided"
    assert pickle.loads(pickle.dumps(held)).verdict == "undecided"


def test_a_certificate_of_another_linkage_says_nothing(held):
    """A rod by a millimetre longer, the motors in another order: the fact is about neither."""
    description = held.transmission.joint_model.mechanism.settled()
    moved = [
        replace(one, placement_a=one.placement_a @ frame([0, 0, -1e-3])) if one.name == "left_heel" else one
        for one in description.closures
    ]
    longer = Transmission(ccpin.load(replace(description, closures=moved)), ["pitch", "roll"])
    turned = Transmission(held.transmission.joint_model, ["pitch", "roll"], ["right_motor", "left_motor"])
    for other in (longer, turned):
        assert replace(held, transmission=other).verdict == "undecided"
    assert (
        replace(held, transmission=Transmission(held.transmission.joint_model, ["pitch", "roll"])).verdict == "proven"
    )


def test_matrices_that_are_wrong_cost_the_proof(monkeypatch):
    """Proposals are trusted by nobody."""
    right, cells = LimitsSearch._matrices, 32
    assert certify_limits(transmission_of("knee"), REGIONS["knee"], max_cells=cells).verdict == "proven"
    for spoil in (lambda x: np.zeros_like(x), lambda x: -x, lambda x: np.swapaxes(x, 1, 2), lambda x: 3.0 * x):
        monkeypatch.setattr(LimitsSearch, "_matrices", lambda self, branch, spoil=spoil: spoil(right(self, branch)))
        assert certify_limits(transmission_of("knee"), REGIONS["knee"], max_cells=cells).verdict == "undecided"


def test_regions_and_boxes_that_are_none_are_refused():
    found = transmission_of("knee")
    for region, more in (
        (([0.1], [0.1]), {}),
        (None, {}),
        (([0.0], [0.1]), {"size": [0.0]}),
        (([0.0], [0.1]), {"size": [[0.0]], "form": "ellipsoid"}),
        (([0.0], [0.1]), {"size": [[1.0]]}),
        (([0.0], [0.1]), {"form": "ball"}),
        (([0.0], [0.1]), {"of": "power"}),
        (([0.0], [0.1]), {"of": "speed", "speed": 1.0, "friction": 0.0}),
        (([0.0], [0.1]), {"effort": 1.0, "friction": 1.0}),
        (([0.0], [0.1]), {"speed": -1.0}),
        (([0.0], [0.1]), {"motors": 1.0}),
        (([0.0], [0.1]), {"shape": [-1.0]}),
        (([0.0], [0.1]), {"effort": 0.0}),
        (([0.0], [0.1]), {"max_cells": 0}),
    ):
        with pytest.raises(InvalidInputError):
            certify_limits(found, region, **more)
