"""What is read off a law and its mechanism for Theorem A: the set point, V there, and whether 𝒱 is one function."""

from __future__ import annotations

import numpy as np

from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.flow.motion_task import MotionTask, exact_q
from ccpin.validated.model.closed_loop import ClosedLoop
from ccpin.validated.sets.arrival_equations import ArrivalEquations


def arrival_equations_of(
    task: MotionTask, law: PDSimpleGravity, set_point: SetPointEquations | None = None
) -> ArrivalEquations:
    """What is claimed of a law over its recorded loop; a set point is what a level of the law is proved of."""
    model, loop = law.model, task.loop
    q_d = boxed(exact_q(model, loop, law.q_d), task.precision)
    potential = float(model.energy(law.q_d, np.zeros(model.n), law.q_free_d).potential)
    return ArrivalEquations(
        loop.equations, q_d, loop.own.numbers(law.q_free_d), potential, single_valued(loop, law), set_point
    )


def single_valued(loop: ClosedLoop, law: PDSimpleGravity) -> bool:
    """Whether 𝒱 is one continuous function of configuration and velocity, whatever turns a motion has made.

    Then it never rises along any motion, and is 0 at the set point however that is reached. The theorem's text lists
    where it may not be: angles that the law reads on circles, rotation vectors of balls, springs of joints that turn.
    """
    stated = law.model.mechanism.tree.joints
    sprung = (joint for joint in loop.own.joints if stated[joint.number - 1].stated.stiffness)
    for joint in sprung:
        turns = "r" in {step[0] for step in joint.kind.steps}
        if turns and (joint.kind.unit or joint.x.start not in loop.equations.independent):
            return False
    smooth = True
    for angle in loop.equations.wrapped:
        j = loop.equations.independent.index(angle.place)
        smooth &= bool(law.gravity_d[j] == 0.0 and not np.delete(law.K_p[j], j).any())
    return smooth and not loop.equations.upright
