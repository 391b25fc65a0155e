"""Trajectories in files: everything in npz, named columns in CSV, Parquet and data frames."""

import numpy as np
import pytest

import ccpin
from ccpin.errors import InvalidInputError
from ccpin.simulation import Event
from ccpin.simulation.events.samples import SAMPLED
from tests.support.backends import same_on_both
from tests.support.paper import FRICTION, START


@pytest.fixture(scope="module")
def motion(rpdr_model):
    """A motion with friction and events."""
    passing = Event(lambda t, state, v: v[0], "turns")
    return ccpin.simulate(
        rpdr_model, None, START, duration=0.3, friction=FRICTION, events=[passing], sample_period=0.01
    )


def test_npz_holds_everything(motion, tmp_path):
    """All fields come back but the cause."""
    motion.save(tmp_path / "m.npz")
    again = ccpin.Trajectory.load(tmp_path / "m.npz")
    for name, ours, theirs in zip(motion._fields, motion, again, strict=True):
        if isinstance(ours, np.ndarray):
            assert np.array_equal(ours, theirs), name
        elif name != "events":
            assert ours == theirs, name
    assert [(event.name, event.t) for event in again.events] == [(event.name, event.t) for event in motion.events]


def test_csv_names_its_columns(motion, tmp_path):
    """q, q̇, q̈, u, q′, friction, limits by joint."""
    motion.save(tmp_path / "m.csv")
    table = np.genfromtxt(tmp_path / "m.csv", delimiter=",", names=True)
    assert np.array_equal(table["a_joint1"], motion.a[:, 0])
    assert np.array_equal(table["friction_joint2"], motion.friction[:, motion.names.v_free.index("joint2")])
    assert np.array_equal(table["qfree_joint3"], motion.q_free[:, motion.names.q_free.index("joint3")])
    assert set(table.dtype.names) >= {"t", "q_joint1", "v_joint2", "u_joint1", "limits_joint4", "closure_error"}


@pytest.mark.parametrize("name", ["stewart", "slider_crank"])
def test_joints_of_several_freedoms_have_columns_too(name, tmp_path):
    """As many names as columns, each once."""
    model = ccpin.ReducedModel(ccpin.load(name))
    motion = ccpin.simulate(model, None, model.alpha(model.mechanism.q_reference), duration=2e-3, friction={})
    motion.save(tmp_path / "m.csv")
    header = (tmp_path / "m.csv").read_text().splitlines()[0].split(",")
    assert len(header) == len(set(header))
    assert len(header) == 2 + sum(np.ndim(x[0]) and x.shape[1] for x in (getattr(motion, name) for name in SAMPLED))


@same_on_both
def test_data_frames_and_parquet(motion, tmp_path):
    """The same table; how the motion ended is with it."""
    pandas = pytest.importorskip("pandas")
    frame = motion.to_pandas()
    assert np.array_equal(frame["q_joint1"], motion.q[:, 0])
    assert frame.attrs["status"] == "finished"
    pytest.importorskip("pyarrow")
    motion.save(tmp_path / "m.parquet")
    again = pandas.read_parquet(tmp_path / "m.parquet")
    assert again.equals(frame)
    assert again.attrs == frame.attrs


def test_what_cannot_be_saved_is_told(motion, tmp_path, monkeypatch):
    """An unknown suffix, and Parquet without pandas; nothing is left behind."""
    with pytest.raises(InvalidInputError, match="must end in"):
        motion.save(tmp_path / "m.xlsx")
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(InvalidInputError, match=r"ccpin\[tables\]"):
        motion.save(tmp_path / "m.parquet")
    assert list(tmp_path.iterdir()) == []
