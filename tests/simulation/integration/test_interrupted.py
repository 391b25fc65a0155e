"""Ctrl-C while a motion is computed: it is answered, and what was computed is kept and says so."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import ccpin
from ccpin import Simulator, control
from ccpin.cli import main, simulate
from ccpin.errors import InvalidInputError
from ccpin.simulation import Budget
from tests.support.backends import same_on_both

START, GOAL = np.radians((-118.0, -62.0)), np.radians((-108.0, -72.0))


def press(after):
    """Ctrl-C in a while, and until it is heard."""
    timer = threading.Timer(after, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    return timer


@pytest.mark.parametrize("friction", [{}, {"joint1": (0.05, 0.01)}], ids=["core", "reference"])
@pytest.mark.parametrize("held", [True, False])
def test_a_long_step_is_interrupted(rpdr_model, friction, held):
    """It returns where it has come to; the next call raises the interrupt, the one after that goes on from there."""
    simulator = Simulator(rpdr_model, lambda t, q, v: np.zeros(2), friction=friction)
    simulator.reset(START)
    timer = press(0.1)
    reached = simulator.step([0.0, 0.0], 1e5) if held else simulator.advance(1e5)
    timer.join()
    assert 0.0 < reached.t < 1e5
    assert simulator.stop.status == "interrupted"
    with pytest.raises(KeyboardInterrupt):
        simulator.step([0.0, 0.0], 1e-3)
    assert simulator.t == reached.t
    np.testing.assert_array_equal(simulator.state.q_free, reached.q_free)
    on = simulator.step([0.0, 0.0], 1e-3)
    assert on.t == pytest.approx(reached.t + 1e-3)
    assert simulator.stop is None
    assert on.closure_error < 1e-9


def test_other_threads_run_beside_a_long_step(rpdr_model):
    """The core held the interpreter as long as the step took."""
    simulator, seen = Simulator(rpdr_model), []
    simulator.reset(START)
    other = threading.Thread(target=lambda: [seen.append(time.monotonic()) or time.sleep(0.01) for _ in range(10)])
    timer = press(0.6)
    other.start()
    simulator.step([0.0, 0.0], 1e5)
    timer.join()
    other.join()
    assert max(np.diff(seen)) < 0.4


def test_a_motion_that_would_fill_the_memory_is_refused(rpdr_model):
    """By what its samples would take; the same motion in few samples is none such."""
    with pytest.raises(InvalidInputError, match=r"would take .* GB: ask for a longer sample_period"):
        ccpin.simulate(rpdr_model, None, START, duration=1e9)
    law = control.PDSimpleGravity(rpdr_model, GOAL, 11.0, 0.6)
    few = ccpin.simulate(rpdr_model, law, START, duration=1e9, sample_period=1e8, budget=Budget(evaluations=100))
    assert few.status == "exhausted"


@same_on_both
def test_cycles_on_the_command_line_keep_what_was_computed(monkeypatch, capsys):
    """Ctrl-C in the middle: the moves made are told, and the exit code is that of an interrupt."""
    begun, law = [], simulate.law_of

    def law_to(*of):
        begun.append(of)
        if len(begun) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return law(*of)

    monkeypatch.setattr(simulate, "law_of", law_to)
    arguments = ["simulate", "rpdr", "--start-deg", "-118", "-62", "--goal-deg", "-108", "-72", "--cycles", "5000"]
    assert main([*arguments, "--wait", "0.1"]) == 130
    said = capsys.readouterr().out
    assert "interrupted" in said
    assert "move 3: within ±2°" in said
    assert "move 4" not in said
