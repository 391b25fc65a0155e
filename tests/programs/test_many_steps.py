"""The benchmark of many steps at its smallest; no timing is judged here, but where everybody's steps lead to is."""

import numpy as np
import pytest

from benchmarks import many_steps
from benchmarks.peers import NotForThisError
from ccpin.programs.compiling import NoCompilerError, compiler

try:
    compiler()
except NoCompilerError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.fixture(scope="module")
def held():
    return many_steps.swinging("rpdr", 3)


def test_all_lead_to_the_same(held):
    """Runge and Kutta's steps of lanes, core and MuJoCo, in MuJoCo's order of joints and ours."""
    found = many_steps.lanes(held, 1)(20)
    np.testing.assert_allclose(many_steps.core(held, 1)(20), found, rtol=0, atol=1e-11)
    np.testing.assert_allclose(many_steps.rollout(held, "RK4", 1)(20), found, rtol=0, atol=1e-8)
    assert np.abs(found - held.q_free).max() > 1e-4  # they moved
    assert many_steps.opened(held, found) < 1e-13
    assert many_steps.opened(held, found + [0.0, 0.0, 1e-3, 0.0]) > 1e-5


@pytest.mark.slow
def test_the_command_prints_everybody(capsys):
    """A line each, those that are not installed with a word; rollout on two threads as well."""
    many_steps.main(["rpdr", "--rows", "2", "--steps", "2"])
    told = capsys.readouterr().out
    assert all(who in told for who in many_steps.ENGINES)


def test_a_ball_is_not_for_mujocos_line():
    """Its quaternion is in another order: the mechanism is refused with a word."""
    with pytest.raises(NotForThisError, match="hinges and slides"):
        many_steps.placed(many_steps.swinging("docs/howto/ankle.urdf", 1), "Euler")
