"""The Gymnasium environment: Gymnasium's own checker, and the simulator's numbers."""

import numpy as np
import pytest

pytest.importorskip("gymnasium")

import ccpin
from ccpin import Simulator
from ccpin.errors import InvalidInputError
from ccpin.gym import MechanismEnv
from tests.support.carriage import carriage


def effort_squared(sample, u):
    """A reward."""
    return -float(sample.v @ sample.v) - 1e-3 * float(u @ u)


def shaken(rng):
    """A start drawn at random."""
    return np.radians([-150.0, -160.0]) + rng.uniform(-0.1, 0.1, 2), rng.normal(size=2)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasiums_own_checker():
    """Spaces, seeding, return types and determinism are as Gymnasium wants them."""
    from gymnasium.utils.env_checker import check_env

    check_env(MechanismEnv("rpdr", effort_squared, start=shaken), skip_render_check=True)


def test_an_episode_is_the_simulators_motion():
    """Step by step the observations are what a `Simulator` gives under the same held efforts."""
    env = MechanismEnv("rpdr", effort_squared, start=shaken, period=0.02)
    observed, info = env.reset(seed=5)
    simulator = Simulator(ccpin.load("rpdr"))
    simulator.reset(observed[:2], observed[2:], near=info["sample"].q_free)
    for u in ([1.0, -0.5], [0.3, 0.2], [40.0, 0.0]):
        observed, reward, terminated, truncated, info = env.step(np.array(u))
        sample = simulator.step(u, 0.02)
        np.testing.assert_array_equal(observed, [*sample.q, *sample.v])
        assert reward == effort_squared(sample, np.array(u))
        assert (terminated, truncated, info["stop"]) == (False, False, "")
    assert info["sample"].u[0] == 30.0


def test_episodes_end():
    """After the horizon (truncated), where `done` says so, and where the motion cannot go on (terminated)."""
    env = MechanismEnv(
        carriage(effort=5.0), effort_squared, done=lambda sample: sample.q[0] > 0.1, horizon=3, period=0.1
    )
    env.reset()
    assert [env.step([0.0])[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]
    env.reset(options={"q": [0.05], "v": [1.0]})
    assert env.step([0.0])[2:4] == (True, False)
    falling = MechanismEnv("delta", effort_squared, period=0.25)
    falling.reset()
    ends = [falling.step(np.zeros(3)) for _ in range(2)]
    assert ends[-1][2]
    assert "singular" in ends[-1][4]["stop"]


def test_motors_without_bounds_need_an_effort():
    """An action space is bounded."""
    with pytest.raises(InvalidInputError, match="the motor of 'x' states no bounds"):
        MechanismEnv(carriage(), effort_squared)
    assert MechanismEnv(carriage(), effort_squared, effort=2.0).action_space.high.tolist() == [2.0]
    with pytest.raises(InvalidInputError, match="effort must be"):
        MechanismEnv(carriage(), effort_squared, effort=[1.0, 2.0])


@pytest.mark.parametrize("name", ["rpdr", pytest.param("delta", marks=pytest.mark.slow)])
def test_pictures(name):
    """An image of the configuration, of one size, that changes with it."""
    env = MechanismEnv(name, effort_squared, render_mode="rgb_array", period=0.1)
    env.reset()
    first = env.render()
    env.step(env.action_space.high / 10)
    second = env.render()
    assert first.dtype == np.uint8
    assert first.shape == second.shape
    assert first.shape[2] == 3
    assert (first != second).any()


def test_the_viewer_follows(monkeypatch):
    """With "human" the live viewer is moved at every step, and closed with the environment."""
    monkeypatch.setattr("webbrowser.open", lambda *_: True)
    env = MechanismEnv("four_bar", effort_squared, render_mode="human")
    env.reset()
    viewer, drawn = env._viewer, []
    monkeypatch.setattr(viewer, "draw", lambda q_free: drawn.append(q_free))
    for _ in range(3):
        env.step([0.0])
    env.close()
    assert len(drawn) == 3


def test_an_unknown_render_mode():
    """Modes are named."""
    with pytest.raises(InvalidInputError, match="render_mode 'ansi'"):
        MechanismEnv("four_bar", effort_squared, render_mode="ansi")
