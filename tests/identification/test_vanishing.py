"""Combinations that structure shows: the regressor itself, in floating point, knows none of their proof."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin.dynamics.parameters import KINDS
from ccpin.errors import CcpinError
from tests.support.strategies import mechanisms

pytest.importorskip("flint")
from ccpin.identification.combinations.exact_spaces import doubles, invariant_span, null_space, reduced
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.identification.combinations.vanishing import JoinedBody, identities
from ccpin.validated.arithmetic.balls import flint
from tests.support.long_cases import later

ANKLE = "docs/howto/ankle.urdf"
BY_STRUCTURE = {"rpdr": 31, "four_bar": 24, "slider_crank": 26, "planar_3rrr": 76, ANKLE: 42}
"""How many there are at most: the columns of Y at random states have no more (the lower bound of `base_parameters`)."""


def combinations(model):
    """z in doubles, each of length 1, of shape (s, p)."""
    with flint().ctx.workprec(100):
        equations, _ = recorded_motions(model)
    rows = doubles(identities(equations.bodies, equations.ends, equations.gravity))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def forces(model, rng):
    """Y at a state near the reference."""
    start = model.alpha(model.mechanism.q_reference)
    step = 0.2 * rng.normal(size=model.n)
    for _ in range(20):
        try:
            state = model.at(model.coordinates.integrate(start, step))
            return state.regressor(*(rng.normal(size=(2, model.n)) / np.linalg.norm(state.rho)))
        except CcpinError:
            step = 0.5 * step
    raise AssertionError("σ does not exist even next to the reference")


def assert_without_effect(model, rng, states=3):
    z = combinations(model)
    for _ in range(states):
        Y = forces(model, rng)
        assert np.abs(Y @ z.T).max(initial=0.0) <= 1e-9 * (np.abs(Y) @ np.abs(z.T) + 1.0).max(initial=1.0)
    return np.linalg.matrix_rank(z, tol=1e-9) if len(z) else 0


@pytest.mark.parametrize("name", ["rpdr", "four_bar", *later("slider_crank", "planar_3rrr", ANKLE)])
def test_combinations_are_without_effect(name):
    """Y z = 0, of as many as there can be, in any gravity."""
    mechanism, rng = ccpin.load(name), np.random.default_rng(1)
    assert assert_without_effect(ccpin.ReducedModel(mechanism), rng) == BY_STRUCTURE[name]
    for gravity in ((0.0, 0.0, 0.0), (1.0, 2.0, -3.0)):
        assert_without_effect(ccpin.ReducedModel(mechanism, gravity), rng)


@pytest.mark.parametrize("name", later("bennett", "sarrus", "delta"))
def test_combinations_of_others_are_without_effect(name):
    """Y z = 0 where structure does not show all."""
    assert_without_effect(ccpin.ReducedModel(ccpin.load(name)), np.random.default_rng(2))


@pytest.mark.slow
@settings(max_examples=4, phases=[Phase.generate])
@given(mechanisms(), st.integers(0, 2**32 - 1))
def test_combinations_of_random_mechanisms_are_without_effect(drawn, seed):
    """Y z = 0 whatever the joints and closures."""
    model = ccpin.ReducedModel(ccpin.load(drawn.description, free=["all"]))
    assert_without_effect(model, np.random.default_rng(seed), 1)


@pytest.mark.slow
@settings(max_examples=60)
@given(mechanisms(), st.integers(0, 2**32 - 1))
def test_combinations_of_many_random_mechanisms_are_without_effect(drawn, seed):
    """The same of more."""
    model = ccpin.ReducedModel(ccpin.load(drawn.description, free=["all"]))
    assert_without_effect(model, np.random.default_rng(seed), 1)


def test_spans():
    """An echelon form, a null space and an invariant span that can be written down."""
    form = reduced([[0, 2, 4], [0, 1, 2], [3, 0, 3]], 3)
    assert form.pivots == (0, 1)
    assert form.rows.tolist() == [[1, 0, 1], [0, 1, 2]]
    assert null_space([[1, 0, 1], [0, 1, 2]], 3).tolist() == [[-1, -2, 1]]
    assert len(null_space([], 3)) == 3
    shift = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0]], dtype=object)
    assert invariant_span(np.array([[1, 0, 0]], dtype=object), [shift]).tolist() == [[1, 0, 0], [0, 1, 0]]


UPRIGHT = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))


def lifted(length, slides, kinds):
    """z of a body on a joint along the vertical with an axis of a length, in 3 m/s²: ten numbers, the joint's own."""
    axis = (Fraction(0), Fraction(0), Fraction(length))
    body = JoinedBody(0, (axis,) * len(slides), slides, UPRIGHT, KINDS[10 : 10 + kinds])
    return reduced(identities((body,), (), (Fraction(0), Fraction(0), Fraction(-3))), 10 + kinds).rows


def test_a_weight_is_a_constant_effort():
    """m on a vertical slide is a rotor m and an effort 3 m: (m, J, o) = (1, −1, 3), where its axis has length 1."""
    (held,) = [row for row in lifted(1, (True,), 5) if row[0]]
    assert [held[k] for k in (0, 10, 14)] == [1, -1, 3]
    assert not [row for row in lifted(2, (True,), 5) if row[0] or row[14]]
    assert not [row for row in (*lifted(1, (True,), 3), *lifted(1, (True, False), 3)) if row[0]]
