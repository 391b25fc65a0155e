"""Base parameters: how many, against what is known of the mechanisms, and what regrouping leaves of the forces."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin

pytest.importorskip("flint")
from ccpin.identification import base_parameters
from tests.support.long_cases import later

ANKLE = "docs/howto/ankle.urdf"


@pytest.fixture(scope="module")
def five_bar():
    """Of the five-bar."""
    return base_parameters(ccpin.load("rpdr"))


def test_the_five_bar(five_bar):
    """11 of bodies and rotors of driven joints, two rotors within, and four constants of each of four joints.

    With (36) and (38) of the paper: of each arm m₁l₁ + m₃a₁ and its like across, I₁ + m₁l₁² + m₃a₁² + J, m₃l₃ and its
    like across, I₃ + m₃l₃²: twelve numbers, of which the closure takes one, as a mass may sit on either tip.
    """
    told = five_bar
    assert told.proved
    assert (told.lower, told.upper, len(told.base)) == (29, 29, 29)
    inertial = told.parameters.of("inertia")
    assert len(set(inertial.tolist()) & set(told.base.tolist())) == 11
    assert "proved from both sides" in told.reason
    assert "armature:joint1" in told.words[2]
    assert repr(told) == f"BaseParameters({told.reason})"


def test_what_is_told_is_what_facts_say(five_bar):
    """Facts of another mechanism, or none, say nothing; one that was pickled is proved again first."""
    read = pickle.loads(pickle.dumps(five_bar))
    assert not read.proved
    assert (read.lower, read.upper) == (0, 60)
    assert "not replayed" in read.reason
    again = read.replay()
    assert again.reason == five_bar.reason
    np.testing.assert_array_equal(again.base, five_bar.base)
    np.testing.assert_array_equal(again.grouping, five_bar.grouping)
    other = base_parameters(ccpin.load("four_bar"), states=1, box=None)
    for facts in ((), other.facts, (five_bar.facts[0], other.facts[1])):
        forged = replace(five_bar, facts=facts)
        assert (forged.lower, forged.upper) == (0, 60)
    with pytest.raises(ValueError, match="read-only"):
        five_bar.base[0] = 3


def random_forces(model, rng):
    start = model.alpha(model.mechanism.q_reference)
    state = model.at(model.coordinates.integrate(start, 0.1 * rng.normal(size=model.n)))
    return state.regressor(*rng.normal(size=(2, model.n)))


@pytest.mark.parametrize("name", later("rpdr", "planar_3rrr"))
def test_regrouped_constants_make_the_same_forces(name):
    """Y π = Y_base (grouping π) for any π, and the columns of Y_base are independent in floating point, too."""
    model, rng = ccpin.ReducedModel(ccpin.load(name)), np.random.default_rng(1)
    told = base_parameters(model)
    assert told.proved
    Y = np.vstack([random_forces(model, rng) for _ in range(60)])
    for pi in (model.parameters.values, rng.normal(size=len(model.parameters))):
        np.testing.assert_allclose(Y[:, told.base] @ (told.grouping @ pi), Y @ pi, rtol=0, atol=1e-10 * np.abs(Y).max())
    np.testing.assert_array_equal(told.values, told.grouping @ model.parameters.values)
    size = np.linalg.svd(Y[:, told.base], compute_uv=False)
    assert size[-1] > 1e-9 * size[0]


def test_what_is_not_proved_is_told():
    """Sarrus' plates mirror each other, which is no part of the structure that is looked at."""
    told = base_parameters(ccpin.load("sarrus"), states=8, precision=200, box=None)
    assert not told.proved
    assert told.lower < told.upper == told.within
    assert "not proved" in told.reason
    assert told.states == 8


def test_too_few_states_prove_less(five_bar):
    """One state has a form for each entry of D, g, B and f: ten of them."""
    told = base_parameters(ccpin.load("rpdr"), states=1)
    assert told.lower <= 10
    assert told.upper == five_bar.upper


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "lower", "upper"),
    [
        ("four_bar", 21, 21),
        ("slider_crank", 19, 19),
        (ANKLE, 58, 58),
        ("stewart", 193, 193),
        ("hexa", 195, 195),
        ("delta", 90, 174),
    ],
)
def test_the_others(name, lower, upper):
    """What is proved of the models that come with ccpin, exactly."""
    told = base_parameters(ccpin.load(name), box=None)
    assert (told.lower, told.upper) == (lower, upper)
