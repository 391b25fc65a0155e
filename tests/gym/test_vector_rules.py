"""The vector environment beside Gymnasium's own vectoriser, under its wrappers, and its arrays shared by DLPack."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("gymnasium")

import gymnasium
from gymnasium.utils.performance import benchmark_vector_step
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

import ccpin
from ccpin.errors import InvalidInputError
from ccpin.gym import MechanismVectorEnv, vector

MODES = [mode.value for mode in AutoresetMode]
ANKLE = "docs/howto/ankle.urdf"


five_bar = cache(lambda: ccpin.ReducedModel(ccpin.load("rpdr")))


@pytest.fixture(autouse=True, scope="module")
def _recorded_once():
    """What environments of one model record is the same."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("record", "fastest"):
            patch.setattr(vector, name, cache(getattr(vector, name)))
        yield


def settled(count, **options):
    """Environments whose starts and goals are not drawn: what differs between rows is their actions'."""
    model = five_bar()
    q0 = model.alpha(model.mechanism.q_reference)

    def start(rng, rows):
        return np.tile(q0, (rows, 1)), np.zeros((rows, 2))

    def done(moves):
        return np.abs(moves.q[:, 0] - q0[0]) > 0.15

    made = {"start": start, "goal": lambda rng, rows: np.tile(q0 + 0.1, (rows, 1)), "done": done, "horizon": 4}
    return MechanismVectorEnv(model, count, **made | options)


class Single(gymnasium.Env):
    """One of them as a plain environment."""

    def __init__(self):
        self.row = settled(1, autoreset_mode="Disabled")
        self.observation_space, self.action_space = self.row.single_observation_space, self.row.single_action_space

    def reset(self, *, seed=None, options=None):
        """As one row is."""
        return self.row.reset(seed=seed)[0][0], {}

    def step(self, action):
        """As one row does."""
        observed, reward, over, late, info = self.row.step(action[None])
        return observed[0], reward[0], bool(over[0]), bool(late[0]), {"refused": bool(info["refused"][0])}


@pytest.mark.parametrize("mode", MODES)
def test_it_starts_anew_as_gymnasiums_own_do(mode):
    """Bit for bit what `SyncVectorEnv` makes of single ones, through ends and cut-off episodes."""
    own, theirs = settled(3, autoreset_mode=mode), SyncVectorEnv([Single] * 3, autoreset_mode=mode)
    assert own.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    for name in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
        assert getattr(own, name) == getattr(theirs, name)
    np.testing.assert_array_equal(own.reset(seed=0)[0], theirs.reset(seed=0)[0])
    largest, seen = own.single_action_space.high, np.zeros(2, dtype=int)
    actions = np.float32([0.0, 0.2, 1.0])[:, None] * largest  # the last one goes too far, the others are cut off
    for _ in range(11):
        found, wanted = own.step(actions), theirs.step(actions)
        for a, b in zip(found[:4], wanted[:4], strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
        seen += [found[2].sum(), found[3].sum()]
        assert ("final_obs" in found[4]) == ("final_obs" in wanted[4])
        if "final_obs" in wanted[4]:
            ended = wanted[4]["_final_obs"]
            np.testing.assert_array_equal(found[4]["_final_obs"], ended)
            np.testing.assert_array_equal(found[4]["final_obs"][ended], np.stack(wanted[4]["final_obs"][ended]))
            for key in ("refused", "_refused"):
                np.testing.assert_array_equal(found[4]["final_info"][key][ended], wanted[4]["final_info"][key][ended])
        if mode == "Disabled" and (ended := found[2] | found[3]).any():
            with pytest.raises(InvalidInputError, match="reset first"):
                own.step(actions)
            options = {"reset_mask": ended}
            again, info = own.reset(options=options)
            np.testing.assert_array_equal(again, theirs.reset(options=dict(options))[0])
            np.testing.assert_array_equal(info["_parameters"], ended)
    assert seen.all()


@pytest.mark.parametrize("mode", MODES)
def test_gymnasiums_wrappers_take_it(mode):
    """Statistics, actions, rewards, infos and observations, as far as each takes a mode."""
    envs = wrappers.RecordEpisodeStatistics(settled(3, autoreset_mode=mode))
    envs = wrappers.ClipReward(wrappers.RescaleAction(envs, np.float32(-1), np.float32(1)), -0.5, 0.5)
    if mode == "NextStep":
        envs = wrappers.NormalizeObservation(envs)
    envs = wrappers.DictInfoToList(envs)
    envs.reset(seed=1)
    lengths, actions = [], np.float32([[0, 0], [0.2, 0.2], [1, 1]])
    for _ in range(6):
        _, rewards, over, late, info = envs.step(actions)
        assert len(info) == 3
        assert (np.abs(rewards) <= 0.5).all()
        lengths += [each["episode"]["l"] for each in info if "episode" in each]
        if mode == "Disabled" and (over | late).any():
            envs.reset(options={"reset_mask": over | late})
    assert lengths
    assert max(lengths) == 4


def test_gymnasium_measures_it():
    """Its own benchmark steps and resets it in every mode."""
    for mode in MODES:
        assert benchmark_vector_step(settled(2, autoreset_mode=mode), target_duration=0, seed=3) > 0.0


def test_it_is_made_by_its_name():
    """`gymnasium.make_vec` with an entry point."""
    name = "ccpin-five-bar-v0"
    gymnasium.register(name, vector_entry_point="ccpin.gym:MechanismVectorEnv", kwargs={"model": "rpdr"})
    try:
        envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point", horizon=7)
        assert (envs.num_envs, envs.spec.id) == (2, name)
        assert envs.observation_space.contains(envs.reset(seed=0)[0])
    finally:
        del gymnasium.registry[name]


def test_arrays_are_shared_by_dlpack():
    """No copy, and a step does not write into what was handed out."""
    envs = settled(4)
    observed, _ = envs.reset(seed=0)
    shared = np.from_dlpack(observed)
    assert np.shares_memory(shared, observed)
    kept = observed.copy()
    later, rewards, over, late, _ = envs.step(np.zeros((4, 2), dtype=np.float32))
    np.testing.assert_array_equal(shared, kept)
    assert not np.shares_memory(later, observed)
    for array in (later, rewards, over, late):
        assert np.shares_memory(np.from_dlpack(array), array)


@pytest.mark.slow
def test_pytorch_shares_them_too():
    """No copy."""
    torch = pytest.importorskip("torch", reason="what shares arrays is PyTorch")
    envs = settled(4)
    envs.reset(seed=0)
    later, rewards, over, late, _ = envs.step(np.zeros((4, 2), dtype=np.float32))
    for array in (later, rewards, over, late):
        tensor = torch.from_dlpack(array)
        assert tensor.data_ptr() == array.ctypes.data
        assert tuple(tensor.shape) == array.shape


def test_parameters_are_told_when_they_are_drawn():
    """At a start, in whichever mode, by a mask; those of the episode that ended are in its last info."""
    drawn = {"gravity": (5.0, 15.0), "damping:joint1": (0.0, 0.2)}
    for mode in ("SameStep", "NextStep"):
        envs = settled(3, parameters=drawn, autoreset_mode=mode, done=None)
        _, first = envs.reset(seed=5)
        assert first["_parameters"].all()
        told = [envs.step(np.zeros((3, 2)))[4] for _ in range(5)]
        at = 3 if mode == "SameStep" else 4  # the fourth step is the last
        assert ["parameters" in info for info in told] == [k == at for k in range(5)]
        again = told[at]["parameters"]
        assert not np.isclose(again, first["parameters"]).any()
        np.testing.assert_array_equal(again, envs._p)
        if mode == "SameStep":
            np.testing.assert_array_equal(told[at]["final_info"]["parameters"], first["parameters"])


@pytest.mark.parametrize(("horizon", "steps"), [(14, 30), pytest.param(30, 65, marks=pytest.mark.slow)])
def test_the_ankle_runs_on(horizon, steps):
    """Balls depend there: steps of random actions, all of them sound or begun anew."""
    envs = MechanismVectorEnv(ANKLE, 8, horizon=horizon, effort=2.0, parameters={"gravity": (9.0, 10.0)})
    envs.reset(seed=2)
    envs.action_space.seed(2)
    ends = 0
    for _ in range(steps):
        observed, rewards, over, late, _ = envs.step(envs.action_space.sample())
        assert envs.observation_space.contains(observed)
        assert np.isfinite(rewards).all()
        ends += int((over | late).sum())
    assert ends >= 16
    program = envs._close.program
    found = program(**{"q": envs._q, "y": envs._y} | ({"p": envs._p} if envs._takes else {}))
    assert np.abs(found["sigma"] - envs._y).max() < 1e-12


def test_what_cannot_be_is_told():
    """Steps before a start, options and masks that are none, rewards of another shape, modes."""
    envs = settled(3)
    with pytest.raises(InvalidInputError, match="reset first"):
        envs.step(np.zeros((3, 2)))
    wrong = (
        {"q": [0, 0]},
        {"reset_mask": [True, False]},
        {"reset_mask": [1, 0, 1]},
        {"reset_mask": [True, False, True]},
    )
    for options in wrong:
        with pytest.raises(InvalidInputError, match=r"reset_mask|options"):
            envs.reset(options=options)
    envs.reset(options={"reset_mask": np.ones(3, dtype=np.bool_)})
    with pytest.raises(InvalidInputError, match="autoreset_mode"):
        settled(3, autoreset_mode="later")
    for name in ("reward", "done"):
        envs = settled(3, **{name: lambda moves: 1.0})
        envs.reset()
        with pytest.raises(InvalidInputError, match=name):
            envs.step(np.zeros((3, 2)))
