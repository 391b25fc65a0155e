"""The firmware benchmark: float programs on a Cortex-M4F in qemu give the same bits, and stay near double's numbers."""

import numpy as np
import pytest

import ccpin
from benchmarks import firmware
from ccpin.programs.same_bits import c_answers
from ccpin.programs.sine_cosine import FLOAT

TOLERANCE = 5e-6  # of an output's largest entry


@pytest.fixture(autouse=True)
def _tools():
    if gone := firmware.absent():
        pytest.skip(
            f"not here: {', '.join(gone)} (Debian: gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm)"
        )


@pytest.mark.parametrize("name", ["rpdr", pytest.param(str(firmware.ANKLE), marks=pytest.mark.slow)])
def test_sigma_and_the_laws_fit_an_interrupt(name):
    """Below 168 MHz · 1 ms / 10 at an instruction a cycle; the instructions are at least the operations; bits alike."""
    for _, program in firmware.controllers(ccpin.ReducedModel(ccpin.load(name))):
        cost, own = firmware.counted(program), c_answers(program, firmware.states(program), FLOAT)
        assert (cost.status == 0).all()
        np.testing.assert_array_equal(cost.status, own.status)
        np.testing.assert_array_equal(cost.outputs, own.outputs)
        assert sum(program.operations.values()) < cost.instructions < 16_800
        assert firmware.float_error(program, cost.outputs) < TOLERANCE
        assert firmware.counted(program).instructions == cost.instructions
