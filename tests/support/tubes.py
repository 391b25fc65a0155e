"""Motions and tubes of closed loops small enough to know everything of, as facts."""

import numpy as np

from ccpin.proof.facts import prove
from ccpin.validated.arithmetic.balls import flint
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.motion_claim import MotionEnclosed
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import ClosedStart, state_of
from ccpin.validated.flow.step import start_box
from ccpin.validated.flow.step_claim import StepEnclosed, step_of
from ccpin.validated.sets.motion_tube_claim import TubeHeld
from ccpin.validated.sets.propagation import Cut, first_section, grow, sampled_section
from ccpin.validated.sets.slices_claim import last_section

BITS = np.array([64])
OPTIONS = StepOptions(order=12, tolerance=1e-12, pieces=2, longest=2.0**-5)
ONE_CELL = Cut(1, np.inf)


def resting(one, length, order=4):
    """A step of the motion that rests at 0."""
    size = one.field.inputs
    numbers = np.array([length]), np.array([order]), np.array([1]), BITS
    return step_of(prove(StepEnclosed(one, np.zeros((size, 1)), np.zeros(size), *numbers)))


def motion_of(one, q, y, v, duration, period=np.inf):
    """The fact about a motion from (q, y, v), efforts of a sampled law read every period."""
    q, y, v = (np.array(x, dtype=float) for x in (q, y, v))
    radius = np.full(len(y), 1e-9)
    start = prove(ClosedStart(one, q[:, None], 0.0 * q, y[:, None], radius, radius, y, v, BITS))
    steps, sampled, since = [], [], 0.0
    with flint().ctx.workprec(64):
        state = state_of(start).balls()
        while since < duration:
            read, state = one.efforts is not None, one.at_a_sample(state)
            for step in march(ProvedSteps(one, 64), state, min(period, duration - since), OPTIONS):
                sampled.append(read)
                steps.append(step.fact)
                read, since, state = False, since + step.length, start_box(step.end)
    return prove(MotionEnclosed(one, np.array(sampled, dtype=bool), BITS), start, *steps)


def slices_about(motion, spread, cut=ONE_CELL):
    """Facts about slices of a tube round a motion."""
    one, found, section = motion.claim.equations, [], None
    with flint().ctx.workprec(64):
        for fact, read in zip(motion.premises[1:], motion.claim.sampled, strict=True):
            step = step_of(fact)
            section = first_section(one, step, np.array(spread)) if section is None else section
            section = sampled_section(one, step, section, cut) if read else section
            for part in grow(one, step, section, cut, 64):
                found.append(part)
                section = last_section(part)
    return found


def tube_about(motion, spread, cut=ONE_CELL):
    """The fact about a tube round a motion."""
    claim = TubeHeld(motion.claim.equations, np.array(spread), np.array([cut.pieces]), BITS)
    return prove(claim, motion, *slices_about(motion, spread, cut))
