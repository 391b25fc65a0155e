"""What to tell MuJoCo's solver so that its loops stay closed and its motion is the mechanism's."""

from __future__ import annotations

import math
from dataclasses import replace

from ccpin.description.elements.xml import written
from ccpin.description.model import MechanismDescription, SolverWords

LONGEST_STEP, LONGEST_ROD_STEP = 1e-3, 1e-4  # s, of a step of MuJoCo's; of one with rods
_STIFF = written([0.9999, 0.9999, 0.001, 0.5, 2.0])  # solimp: of a constraint's acceleration that is met, at any gap
_OPTIONS = {"integrator": "RK4", "solver": "Newton", "iterations": "100", "tolerance": "1e-14"}


def tightened(description: MechanismDescription) -> MechanismDescription:
    """The description with the words that make MuJoCo's loops as tight as a step allows, in place of the file's.

    Runge-Kutta steps of the file's time step, of a millisecond at most; every equality with a time constant of two of
    them, the shortest that MuJoCo takes, and solimp near 1; dry friction and limits likewise. Of a tendon's length
    MuJoCo leaves out how its direction turns, which makes motions with rods (closures of kind distance) wrong to the
    first order of the step: it is a tenth as long there.
    """
    rods = any(closure.kind == "distance" for closure in description.closures)
    step = min(_step(description.solver), LONGEST_ROD_STEP if rods else LONGEST_STEP)
    soft = {"solref": written([2.0 * step, 1.0]), "solimp": _STIFF}
    held = [closure.name for closure in description.closures] + [each.name for each in description.couplings]
    joints = {
        joint.name: {f"{word}{what}": value for word, value in soft.items() for what in ("limit", "friction")}
        for joint in description.joints
        if joint.friction or math.isfinite(joint.upper - joint.lower)
    }
    options = {"timestep": written(step), **_OPTIONS}
    return replace(description, solver=SolverWords(options, {}, dict.fromkeys(held, soft), joints))


def _step(solver: SolverWords) -> float:
    """The time step that is stated, s."""
    try:
        stated = float(solver.options.get("timestep", LONGEST_STEP))
    except ValueError:
        return LONGEST_STEP
    return stated if stated > 0.0 else LONGEST_STEP
