"""What is proved of motions can be sent to other processes, kept and copied."""

import copy
import pickle

import pytest

from ccpin import control, validated
from ccpin.validated.arithmetic.balls import flint
from tests.support.long_cases import later

COPIES = pytest.mark.parametrize(
    "again", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy], ids=["pickle", "copy"]
)


@COPIES
def test_balls_hold_what_they_held(again):
    """And hardly more, at any precision; what is not finite is everything."""
    arb = flint().arb
    with flint().ctx.workprec(300):
        third, wide = arb(1) / 3, arb(2, 1e-5)
    for x in (third, wide, arb(0), arb(-3), third**40, arb(1e300), arb(0, 1e-200)):
        found = again(x)
        assert found.contains(x)
        assert found.mid().man_exp() == x.mid().man_exp()
        assert float(found.rad()) <= float(x.rad()) * (1.0 + 1e-8)
    for x in (arb("nan"), arb("inf"), arb(0, float("inf"))):
        assert not again(x).is_finite()


QUICK = {"order": 12, "tolerance": 1e-12, "pieces": 4, "precision": 64}


@pytest.fixture(scope="module", params=later((QUICK, QUICK | {"cells": 1}), ({}, {})), ids=["quick", "sharp"])
def certificates(rpdr_model, request):
    """An enclosure, one of a set, and a certificate of a move."""
    q = rpdr_model.alpha(rpdr_model.mechanism.q_reference)
    law = control.PDSimpleGravity(rpdr_model, q, 50.0, 5.0)
    of_one, of_a_set = request.param
    motion = validated.enclose(rpdr_model, law, q, None, 0.002, **of_one)
    tube = validated.enclose_set(rpdr_model, law, q, None, 0.002, spread=1e-6, **of_a_set)
    return motion, tube, validated.certify_move(rpdr_model, law, q, arrival=0.1, **of_one)


@pytest.mark.parametrize("again", later(lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy), ids=["pickle", "copy"])
def test_certificates_of_motions_are_copied(again, certificates):
    """Enclosures, those of sets and certificates of moves; a motion that was pickled is proved once it is replayed."""
    motion, tube, move = certificates
    for one in (motion, tube, move):
        assert str(again(one).replay()) == str(one)
    assert again(tube).verdict == ("proven" if again(tube).covered is tube.covered else "undecided")
    assert again(move).verdict == ("proven" if again(move).proved is move.proved else "undecided")
    same = again(motion)
    box = motion.box(0.001)
    assert all(after.contains(before) for before, after in zip(box, same.box(0.001), strict=True))
    assert same.verdict == ("proven" if same.motion is motion.motion else "undecided")
    assert same.replay().motion.digest == motion.motion.digest
