"""The vector environment: Gymnasium's rules, the simulator's motion, refusals, and each row's own parameters."""

import numpy as np
import pytest

pytest.importorskip("gymnasium")

from dataclasses import replace

import ccpin
from ccpin import Simulator
from ccpin.errors import InvalidInputError
from ccpin.gym import MechanismVectorEnv
from ccpin.programs import lanes
from ccpin.programs.compiling import NoCompilerError


def five_bars(count=6, **options):
    """Some five-bars."""
    return MechanismVectorEnv("rpdr", count, **options)


def test_spaces_seeds_and_shapes():
    """What Gymnasium asks of a vector environment; one seed, one history."""
    envs = five_bars(horizon=4)
    envs.action_space.seed(3)
    actions = [envs.action_space.sample() for _ in range(9)]
    told = []
    for _ in range(2):
        observed, info = envs.reset(seed=11)
        history = [observed]
        assert envs.observation_space.contains(observed)
        assert info["parameters"].shape == (6, 0)
        for action in actions:
            observed, reward, over, late, info = envs.step(action)
            assert envs.observation_space.contains(observed)
            assert (reward.shape, over.dtype, late.dtype) == ((6,), np.bool_, np.bool_)
            history += [observed, reward]
        told.append(history)
    for first, second in zip(*told, strict=True):
        np.testing.assert_array_equal(first, second)
    assert not np.array_equal(envs.reset(seed=12)[0], told[0][0])


def test_the_motion_is_the_simulators():
    """A step of every row, without friction."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    envs = MechanismVectorEnv(model, 3, period=0.02)
    observed, _ = envs.reset(seed=1)
    q, v = envs._q.copy(), envs._v.copy()
    u = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 2))
    for _ in range(3):
        observed, *_ = envs.step(u)
    for row in range(3):
        simulator = Simulator(model, friction={}, method="DOP853")
        simulator.reset(q[row], v[row])
        sample = simulator.step(u[row], 0.06)
        np.testing.assert_allclose(envs._q[row], sample.q, rtol=0, atol=1e-7)
        np.testing.assert_allclose(envs._v[row], sample.v, rtol=0, atol=1e-6)
        np.testing.assert_allclose(observed[row, :2], sample.q, rtol=0, atol=1e-6)


def test_the_end_of_an_episode():
    """Truncated after the horizon, in the same step anew; what was last seen is told."""
    envs = five_bars(horizon=3, goal=lambda rng, count: np.tile([1.0, 2.0], (count, 1)))
    first, _ = envs.reset(seed=2)
    np.testing.assert_array_equal(first[:, 4:], np.tile(np.float32([1.0, 2.0]), (6, 1)))
    still = np.zeros((6, 2))
    for k in range(3):
        before = envs._q.copy()
        observed, _, over, late, info = envs.step(still)
        assert not over.any()
        assert late.all() == (k == 2) == ("final_obs" in info)
    assert info["_final_obs"].all()
    assert np.abs(info["final_obs"][:, :2] - before).max() < 0.2  # where the motion had come to
    np.testing.assert_array_equal(observed[:, 2:4], np.zeros((6, 2)))  # at rest again
    assert not np.allclose(observed[:, :2], info["final_obs"][:, :2])


def test_a_refused_state_ends_its_episode_alone():
    """Far beyond what a step can follow one row is refused; it starts anew, and the others go on as if alone."""
    start = lambda rng, count: (np.tile(np.radians([-90.0, -90.0]), (count, 1)), np.zeros((count, 2)))  # noqa: E731
    envs, others = five_bars(4, start=start, horizon=50), five_bars(4, start=start, horizon=50)
    envs.reset(seed=0)
    others.reset(seed=0)
    envs._v[2] = [4000.0, -4000.0]
    u = np.zeros((4, 2))
    observed, reward, over, late, info = envs.step(u)
    alone, *_ = others.step(u)
    np.testing.assert_array_equal(over, [False, False, True, False])
    np.testing.assert_array_equal(info["refused"], over)
    assert not late.any()
    assert np.isfinite(reward).all()
    assert np.isfinite(observed).all()
    np.testing.assert_array_equal(observed[[0, 1, 3], :4], alone[[0, 1, 3], :4])
    np.testing.assert_array_equal(observed[2, 2:4], [0.0, 0.0])


def test_rewards_and_ends_of_the_callers_own():
    """They see what moved, row by row."""
    seen = []

    def reward(moves):
        seen.append(moves)
        return moves.q[:, 0]

    envs = five_bars(5, reward=reward, done=lambda moves: moves.goal[:, 0] > moves.q[:, 0])
    envs.reset(seed=4)
    aim, u = envs._aim.copy(), 1e9 * np.ones((5, 2))
    _, rewards, over, _, info = envs.step(u)
    last = info["final_obs"][:, 0] if over.any() else envs._q[:, 0]
    np.testing.assert_allclose(rewards, last, rtol=1e-6)
    np.testing.assert_array_equal(over, aim[:, 0] > rewards)
    np.testing.assert_array_equal(seen[0].u, np.tile(envs._bounds[1], (5, 1)))  # no more than the motors give


def test_parameters_of_each_row():
    """Drawn anew for every episode, within their range, and each row moves as a mechanism made with them."""
    mechanism = ccpin.load("rpdr")
    link = next(each for each in mechanism.description.links if each.inertia is not None and each.inertia.mass)
    model = ccpin.ReducedModel(mechanism)
    names = {f"mass:{link.name}": (1.0, 3.0), "gravity": (5.0, 15.0)}
    envs = MechanismVectorEnv(model, 4, parameters=names, horizon=2)
    _, info = envs.reset(seed=9)
    drawn, q = info["parameters"], envs._q.copy()
    assert np.all((drawn >= [1.0, 5.0]) & (drawn <= [3.0, 15.0]))
    assert len(np.unique(drawn[:, 0])) == 4
    u = np.zeros((4, 2))
    envs.step(u)
    for row, (mass, gravity) in enumerate(drawn):
        inertia = link.inertia
        other = replace(inertia, mass=mass, rotational=inertia.rotational * (mass / inertia.mass))
        links = tuple(
            replace(each, inertia=other) if each.name == link.name else each for each in mechanism.description.links
        )
        down = model.gravity_vector / np.linalg.norm(model.gravity_vector)
        changed = ccpin.ReducedModel(ccpin.load(replace(mechanism.description, links=links)), gravity=gravity * down)
        simulator = Simulator(changed, friction={}, method="DOP853")
        simulator.reset(q[row], np.zeros(2))
        np.testing.assert_allclose(envs._q[row], simulator.step(u[row], 0.02).q, rtol=0, atol=1e-8)
    envs.step(u)
    assert not np.isclose(envs._p, drawn).any()


def test_lengths_of_each_row():
    """Starts are closed with each row's own lengths."""
    mechanism = ccpin.load("rpdr")
    joint = next(j for j in mechanism.tree.joints if j.parent and np.linalg.norm(j.placement[:3, 3]) > 0)
    length = float(np.linalg.norm(joint.placement[:3, 3]))
    envs = MechanismVectorEnv(mechanism, 5, parameters={f"length:{joint.name}": (0.97 * length, 1.03 * length)})
    _, info = envs.reset(seed=3)
    program = ccpin.programs.record(envs.model, "closure", parameters=[f"length:{joint.name}"])
    told = program(q=envs._q, y=envs._y, p=info["parameters"])
    assert np.abs(told["closure"]).max() < 1e-9
    assert np.ptp(info["parameters"]) > 0.0


def test_without_a_compiler(monkeypatch):
    """NumPy steps the same."""
    found = []
    for fail in (False, True):
        if fail:

            def refuse(*_):
                raise NoCompilerError("none")

            monkeypatch.setattr(lanes, "loaded", refuse)
        envs = five_bars(3)
        assert envs.backend == "numpy" or not fail
        envs.reset(seed=1)
        found.append(envs.step(np.full((3, 2), 0.2))[0])
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-6)


def test_wrong_arguments():
    """They are told."""
    for options in (
        {"count": 0},
        {"parameters": {"size": (1, 2)}},
        {"parameters": {"gravity": (2, 1)}},
        {"parameters": {"gravity": 3}},
        {"horizon": 0},
        {"period": -1.0},
    ):
        with pytest.raises(InvalidInputError):
            five_bars(**options)
    envs = five_bars(2)
    envs.reset(seed=0)
    with pytest.raises(InvalidInputError, match="actions"):
        envs.step(np.zeros(2))
