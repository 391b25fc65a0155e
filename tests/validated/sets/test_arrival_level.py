"""A level of 𝒱 is about the V(q_d) it was counted from, a double; proofs of arrival count from the exact one."""

import numpy as np
import pytest

pytest.importorskip("flint")

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.validated.arithmetic.balls import ball, flint, upper
from ccpin.validated.flow.marching import StepOptions
from ccpin.validated.flow.motion_task import task_of
from ccpin.validated.sets.arrival import goal_of
from ccpin.validated.sets.arrival_reading import arrival_equations_of


def test_a_level_below_the_rounding_of_the_potential_is_lowered_by_it():
    """Under a gravity of 1e12 m/s² V(q_d) is off by more than a level of 0.1 μJ, which proves nothing then."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"), gravity=[0.3e12, 0.0, -0.7e12])
    law = PDSimpleGravity(model, model.alpha(model.mechanism.q_reference) + 0.1, [1.0], [1.0])
    options = StepOptions(30, 1e-18, 16)
    with flint().ctx.workprec(128):
        equations = arrival_equations_of(task_of(model, law, law.q_d, None, 1.0, options, 128), law)
        goal = goal_of(equations, 1e-7, None, options, 128)
        told = model.energy(law.q_d, np.zeros(1), law.q_free_d).potential
        assert equations.potential_d == told
        off = abs(float((goal.well.potential - ball(told)).mid()))
    assert off > 1e-7
    assert goal.lowered < 0
    assert -1.01 * off < upper(goal.lowered) - 1e-7 < -off
