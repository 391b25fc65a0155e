"""One sample of an adaptive law as a straight-line program, which C and lanes evaluate as they do any other."""

from __future__ import annotations

from typing import Any

import numpy as np

from ccpin.arrays import choice, whole
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.identification.adaptive.regressor_on_tape import recorded_regressor
from ccpin.programs.program import Port, Program
from ccpin.programs.quantities import taped_model
from ccpin.programs.recording.constants import Parameter
from ccpin.programs.recording.recorded_laws import efforts, transmission
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recording.recorded_tree import exact, rational
from ccpin.programs.recordings import law_notes, program_of
from ccpin.programs.tape import Expression, Tape


def adaptive_program(law: Any, about: State, given: str, steps: int) -> Program:
    """The program of `AdaptiveTracking.program`, recorded about a State of the law's model."""
    model: ReducedModel = law.model
    given_as = zip(law.adapted, law.initial.tolist(), law.units, strict=True)
    symbols = tuple(Parameter(name, "estimate", name, value, unit) for name, value, unit in given_as)
    newton = whole(steps, "steps") if choice(given, "given", ("closed", "near")) == "near" else 0
    own = numbering(model, about.q_free)
    scene = taped_model(model, own, about.q_free, None, {}, symbols, moving=True)
    estimate, (q_d, v_d, a_d) = scene.inputs["p"], (scene.inputs[name] for name in ("q_d", "v_d", "a_d"))
    v, slope = scene.inputs["v"], exact(law.slope)
    e, e_rate = scene.inputs["x"][list(own.q.places)] - q_d, v - v_d
    s = e_rate + slope @ e
    Y = recorded_regressor(scene, v_d - slope @ e, a_d - slope @ e_rate)
    learnt = Y @ exact(law.basis)
    force = Y @ exact(law.known) + learnt @ estimate - exact(law.K) @ s
    change = exact(law.period * law.gain) * (learnt.T @ s)
    after = [
        _between(scene.tape, *bound)
        for bound in zip(estimate - change, exact(law.lower), exact(law.upper), strict=True)
    ]
    u = efforts(scene.tape, transmission(model, scene.recorded.motion.rho), force)
    outputs = {"torque": u, "estimate": np.array(after, dtype=object)}
    motors = model.mechanism.actuated
    shown = (Port("torque", u.shape, "N m or N", motors), Port("estimate", (len(after),), "", law.adapted))
    name = f"{model.mechanism.name}: adaptive tracking"
    return program_of(scene, about, name, outputs, shown, newton, symbols, law_notes(scene, ("torque",)))


def _between(tape: Tape, x: Expression, lower: Expression, upper: Expression) -> Expression:
    """The nearest number to x between two: ½(lower + upper + |x − lower| − |x − upper|)."""
    below, above = x - lower, x - upper
    return (tape.root(below * below) - tape.root(above * above) + (lower + upper)) * rational(0.5)
