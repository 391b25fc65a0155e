"""What tests of enclosures share: the paper's law, exact starts, balls and their centres."""

import numpy as np

import ccpin
from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.arithmetic.series import all_series
from ccpin.validated.flow.marching import StepOptions
from ccpin.validated.flow.motion_task import task_of
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import WatchedField, attempt
from tests.support.paper import GOAL, K_V, START

FREE = [0, 2, 1, 3]  # the paper's (q1, q2, q3, q4) in ccpin's order (q1, q3, q2, q4)


class MarchedField(WatchedField):
    """Any field, to be marched: its steps are those of `attempt`, no facts."""

    def series(self, start, order):
        return all_series(self.program, start.centre, order)

    def attempt(self, start, series, length, pieces):
        return attempt(self, start, series, length, pieces)


def paper_law(model, K_p=(11.0, 11.0)):
    return ccpin.control.PDSimpleGravity(model, GOAL, K_p, K_V)


def accurately(model, controller, q0, v0, duration):
    return ccpin.simulate(model, controller, q0, v0, duration=duration, method="DOP853", rtol=1e-12, atol=1e-13)


def started(model, law, v0):
    """The loop's programs, and their exact start at the paper's."""
    task = task_of(model, law, START, None, 0.1, StepOptions(30, 1e-18, 16), 128)
    return task.loop.equations, state_of(task.start(task.from_doubles(START, v0))).balls()


def balls(*arrays):
    return [ball(float(x)) for x in np.concatenate(arrays)]


def numbers(box):
    return np.array([float(x.mid()) for x in box])
