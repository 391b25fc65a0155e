"""Boxes of joint efforts over regions: attacked by closed forms, forged, and searched for wrongly."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.description.model import frame
from ccpin.errors import InvalidInputError
from ccpin.proof.facts import NotProvedError, prove
from ccpin.transmission import Transmission, certify_effort_box, effort_box
from tests.support.linkage_models import FORMS, transmission_of

pytest.importorskip("flint")
REGIONS = {"ankle": ([-0.15, -0.1], [0.15, 0.1]), "knee": ([-0.5], [0.5]), "neck": ([-0.5, -0.4], [0.5, 0.4])}


def test_efforts_of_several_joints_add_up():
    """Teeth: u = J⁻ᵀτ with a constant J, so that |u| is at most |J⁻ᵀ| b, and no more is asked for."""
    found = transmission_of("neck")
    made = certify_effort_box(found, REGIONS["neck"], [2.0, 1.0])
    used = made.held.found["used"][0]
    expected = np.abs(np.linalg.inv(FORMS["neck"].jacobian(None).T)) @ [2.0, 1.0]
    np.testing.assert_allclose(used, expected, rtol=1e-5)
    assert (used >= expected * (1 - 1e-12)).all()


def test_more_cells_than_are_looked_at_at_a_time():
    """Each of 512 has its own bound: above what the closed form asks for at its ends, and not far above."""
    found, (lower, upper) = transmission_of("knee"), map(np.array, REGIONS["knee"])
    search = effort_box._BoxSearch(found, found.reference, lower, upper, np.array([1e3]))
    fact, _ = search.cut(512, np.array([3.0]), fixed=True)
    used, ends = fact.found["used"][:, 0], np.linspace(lower, upper, 513)
    asked = np.array([3.0 / abs(FORMS["knee"].jacobian(q)[0, 0]) for q in ends])
    assert (used >= np.maximum(asked[1:], asked[:-1])).all()
    np.testing.assert_allclose(used, np.maximum(asked[1:], asked[:-1]), rtol=5e-3)


# Forged claims.


def forged():
    """Claims that are false, or malformed, each a change of one that is proved."""
    return {
        "a larger box": {"box": lambda x: 1.01 * x},
        "no box": {"box": lambda x: 0.0 * x},
        "a negative box": {"box": lambda x: -x},
        "a box of no number": {"box": lambda x: np.nan * x},
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
    return certify_effort_box(transmission_of("ankle"), REGIONS["ankle"], max_cells=256)


@pytest.mark.parametrize("name", forged())
def test_a_forged_claim_becomes_no_fact(held, name):
    claim, (branch,) = held.held.claim, held.held.premises
    change = {field: made(getattr(claim, field)) for field, made in forged()[name].items()}
    with pytest.raises(NotProvedError):
        prove(replace(claim, **change), branch)


def test_a_box_rests_on_its_branch(held):
    claim, (branch,) = held.held.claim, held.held.premises
    other = certify_effort_box(transmission_of("knee"), REGIONS["knee"], max_cells=64).held
    for premises in ((), (branch, branch), other.premises, (held.held,)):
        with pytest.raises(NotProvedError):
            prove(claim, *premises)
    assert held.held.replay().found["used"].max() == held.held.found["used"].max()


# The search, and what it answers.


@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("count", [200, pytest.param(250_000, marks=pytest.mark.slow)])
def test_no_posture_of_the_region_asks_more(name, count):
    """All corners of the box at random postures and at the region's corners, by the closed form: a million points."""
    region = REGIONS[name]
    made = certify_effort_box(transmission_of(name), region, max_cells=256)
    assert made.verdict == "proven", made.reason
    rng, form, n = np.random.default_rng(1), FORMS[name], len(made.box)
    corners = np.stack(np.meshgrid(*zip(*region, strict=True), indexing="ij"), axis=-1).reshape(-1, n)
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * n, indexing="ij"), axis=-1).reshape(-1, n)
    most = 0.0
    for q in [*corners, *rng.uniform(*region, (count, n))]:
        asked = np.abs(np.linalg.solve(form.jacobian(q).T, (signs * made.box).T))
        most = max(most, float((asked.max(axis=1) / made.room).max()))
    assert 0.9 < most <= 1.0  # nor is it far from what is so


def test_a_box_that_is_too_large_is_refuted_by_a_posture():
    found = transmission_of("knee")
    known = certify_effort_box(found, REGIONS["knee"])
    made = certify_effort_box(found, REGIONS["knee"], 1.5 * known.box, max_cells=16)
    assert made.verdict == "refuted"
    q = made.witness.q_joint
    asked = np.abs(np.linalg.solve(FORMS["knee"].jacobian(q).T, made.box))
    assert (asked > made.room).any()
    assert "asks too much" in repr(made)
    wide = certify_effort_box(found, REGIONS["knee"], 1.0001 * known.box, max_cells=4)
    assert wide.verdict == "undecided"
    assert "raise max_cells" in wide.reason


def test_what_was_pickled_or_altered_is_not_known(held):
    assert held.verdict == "proven"
    assert pickle.loads(pickle.dumps(held.held.claim)).box.tolist() == held.box.tolist()
    for change in ({"box": 1.1 * held.box}, {"lower": held.lower - 0.1}, {"room": 0.5 * held.room}, {"held": None}):
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
    right, cells = effort_box._BoxSearch._matrices, 32
    assert certify_effort_box(transmission_of("knee"), REGIONS["knee"], max_cells=cells).verdict == "proven"
    for spoil in (lambda x: np.zeros_like(x), lambda x: -x, lambda x: np.swapaxes(x, 1, 2), lambda x: 3.0 * x):
        monkeypatch.setattr(
            effort_box._BoxSearch, "_matrices", lambda self, branch, spoil=spoil: spoil(right(self, branch))
        )
        assert certify_effort_box(transmission_of("knee"), REGIONS["knee"], max_cells=cells).verdict == "undecided"


def test_regions_and_boxes_that_are_none_are_refused():
    found = transmission_of("knee")
    for region, more in (
        (([0.1], [0.1]), {}),
        (None, {}),
        (([0.0], [0.1]), {"box": [0.0]}),
        (([0.0], [0.1]), {"shape": [-1.0]}),
        (([0.0], [0.1]), {"effort": 0.0}),
        (([0.0], [0.1]), {"max_cells": 0}),
    ):
        with pytest.raises(InvalidInputError):
            certify_effort_box(found, region, **more)
