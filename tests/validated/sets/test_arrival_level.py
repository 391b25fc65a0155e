"""A level of 𝒱 is about the V(q_d) it was counted from, a double; proofs of arrival count from the exact one."""

import numpy as np
import pytest

pytest.importorskip("flint")

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.validated.arithmetic.balls import flint
from ccpin.validated.model.closed_loop import recorded_loop
from ccpin.validated.sets.arrival import goal_of


def test_a_level_below_the_rounding_of_the_potential_is_lowered_by_it():
    """Under a gravity of 1e12 m/s² V(q_d) is off by more than a level of a microjoule, which proves nothing then."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"), gravity=[0.3e12, 0.0, -0.7e12])
    law = PDSimpleGravity(model, model.alpha(model.mechanism.q_reference) + 0.1, [1.0], [1.0])
    with flint().ctx.workprec(128):
        goal = goal_of(recorded_loop(model, law), law, 1e-6)
        told = model.energy(law.q_d, np.zeros(1), law.q_free_d).potential
        off = abs(float((goal.potential - flint().arb(told)).mid()))
    assert off > 1e-6
    assert goal.level < 0.0
    assert -1.01 * off < goal.level - 1e-6 < -off
