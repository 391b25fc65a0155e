"""Where a free motion crosses a singularity: the sign of the determinant is proved at both ends that are told."""

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.flow import crossing as module
from ccpin.validated.flow import regularity
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.step import ProvenStep, start_of
from tests.support.parabola import equations, linear


def line(begin, length, error):
    """A step of x = t − 1, of which an error is known."""
    polynomial = [[ball(begin - 1.0), ball(1.0)]]
    end = start_of([ball(begin + length - 1.0)])
    return ProvenStep(length, polynomial, 0.0, [ball(error)], [], 0.0, end)


@pytest.fixture
def on_a_line(monkeypatch):
    """det = −x, told as it is on the box."""
    monkeypatch.setattr(module, "signed_determinant", lambda loop, box: -box[0])


@pytest.mark.usefixtures("on_a_line")
def test_a_sign_that_was_not_proved_where_a_step_begins():
    """Three steps; after the first two the sign is not known: the crossing at t = 1 is after the first one begins."""
    steps = [line(0.5, 0.375, 0.25), line(0.875, 0.25, 0.25), line(1.125, 0.375, 0.25)]
    number, after, before = module._located(None, steps, 0)
    assert (number, after) == (-1, 0.0)
    assert 0.125 <= before <= 0.375
    assert module._located(None, [line(0.25, 0.25, 0.125), *steps], 1)[:2] == (0, 0.25)


@pytest.mark.usefixtures("on_a_line")
def test_a_sign_that_is_proved_again_in_the_last_step():
    """Halving finds a time of the first sign in the last step: what came before does not matter any more."""
    steps = [line(0.5, 0.25, 0.5), line(0.75, 0.4375, 2.0**-20)]
    number, after, before = module._located(None, steps, 0)
    assert number == 1
    assert 0.0 < after < 0.25 < before
    assert before - after < 0.1


def test_all_that_programs_count_within_half_a_turn_is_asked_for(monkeypatch):
    """Of every step of a closed loop, whatever it is for."""
    monkeypatch.setattr(regularity, "too_far_turned", lambda loop, box: "turned")
    loop = equations(linear(np.array([[4.0]]), np.array([[0.5]])))
    start = start_of([ball(0.5), ball(0.25)])
    found = ProvedSteps(loop, 128).attempt(start, [[0] * 9], 0.01, 2)
    assert found == "turned"
