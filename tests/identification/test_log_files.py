"""Logs from files of all kinds, and what is wrong with them."""

from contextlib import suppress

import numpy as np
import pytest
from scipy.io import savemat

import ccpin
from ccpin.errors import InvalidInputError
from ccpin.identification import Log

T = np.linspace(0.0, 1.0, 11)
Q, U = np.sin(T), np.where(np.arange(11) == 4, np.nan, T**2)


def same(log, q=Q, u=U):
    assert np.array_equal(log.t, T)
    assert np.array_equal(log.columns["q_hip"], q)
    assert np.array_equal(log.columns["u_hip"], u, equal_nan=True)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_saved_is_read_again_to_the_bit(tmp_path, suffix):
    log = Log(T, {"q_hip": Q, "u_hip": U, 'q_"left", knee': 2.0 * Q})
    log.save(tmp_path / f"log{suffix}")
    again = Log.read(tmp_path / f"log{suffix}")
    same(again)
    assert np.array_equal(again.columns['q_"left", knee'], 2.0 * Q)


def test_columns_units_and_separators_are_as_the_file_has_them(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{t};{q};{'' if np.isnan(u) else u}\n" for t, q, u in np.c_[T, Q, U].tolist())
    path.write_text(f"\ufeffseconds; left ;amps\n{rows}", encoding="utf-8")
    log = Log.read(path, columns={"q_hip": "left", "u_hip": "amps"}, time="seconds", units={"q": "deg", "u_hip": 0.5})
    same(log, Q * (np.pi / 180), U * 0.5)


def test_matlab_vectors_and_structures_with_time(tmp_path):
    savemat(tmp_path / "plain.mat", {"t": T, "q_hip": Q, "u_hip": U})
    same(Log.read(tmp_path / "plain.mat"))
    signals = [{"values": Q, "label": "q_hip"}, {"values": U, "label": "u_hip"}]
    savemat(tmp_path / "scope.mat", {"scope": {"time": T, "signals": signals}})
    same(Log.read(tmp_path / "scope.mat"))
    savemat(tmp_path / "out.mat", {"yout": {"time": T, "signals": {"values": np.c_[Q, U]}}})
    same(Log.read(tmp_path / "out.mat", columns={"q_hip": "yout.0", "u_hip": "yout.1"}))


def test_spans_of_time_are_no_seconds(tmp_path):
    pd = pytest.importorskip("pandas")
    pd.DataFrame({"t": pd.to_timedelta(T, unit="s"), "q_hip": Q}).to_parquet(tmp_path / "a.parquet")
    with pytest.raises(InvalidInputError, match="no column of times"):
        Log.read(tmp_path / "a.parquet")


def test_arrays_of_a_simulator(tmp_path):
    np.savez(tmp_path / "run.npz", time=T, qpos=np.c_[T, Q], ctrl=U[:, None])
    same(Log.read(tmp_path / "run.npz", columns={"q_hip": "qpos.1", "u_hip": "ctrl"}))


def test_joint_states_of_a_bag_by_their_stamps(tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    stamp, header = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]
    state = kinds["sensor_msgs/msg/JointState"]
    for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        folder = tmp_path / plugin.name
        with Writer(folder, version=9, storage_plugin=plugin) as writer:
            topic = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
            for k, (q, u) in enumerate(zip(Q, U, strict=True)):
                effort = np.array([] if np.isnan(u) else [u, 2.0 * u])
                at = header(stamp(1_700_000_000, 100_000_000 * k), "")
                message = state(at, ["hip", "knee"], np.array([q, -q]), np.array([]), effort)
                writer.write(topic, 5 * k, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        for path in (folder, next(folder.glob("*.mcap" if plugin is StoragePlugin.MCAP else "*.db3"))):
            log = Log.read(path)
            assert np.allclose(log.t, T, rtol=0, atol=1e-12)
            assert np.array_equal(log.columns["q_hip"], Q)
            assert np.array_equal(log.columns["u_knee"], 2.0 * U, equal_nan=True)
            assert "v_hip" not in log.columns
        whole, damaged = path.read_bytes(), tmp_path / f"damaged{path.suffix}"
        for place in np.random.default_rng(0).integers(len(whole), size=(12, 3)):
            spoilt = np.frombuffer(whole, np.uint8).copy()
            spoilt[place] ^= 255
            damaged.write_bytes(spoilt.tobytes())
            with suppress(InvalidInputError):
                Log.read(damaged)
    with pytest.raises(InvalidInputError, match="no bag"):
        Log.read(tmp_path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "empty"),
        ("1,2\n3,4\n", "name each column"),
        ("t,q_hip\n0,1\n1,2,3\n", "row 3 has 3 fields"),
        ("t,q_hip\n0,one\n", "row 2, 'q_hip': 'one' is no number"),
        ("x,q_hip\n0,1\n1,2\n", "no column of times"),
        ("t,hip\n0,1\n1,2\n", "no column q_"),
        ("t,q_hip\n0,1\n0,2\n", "two samples at one time"),
        ("t,q_hip\n0,1\n,2\n", "time that is not finite"),
        ("t,q_hip\n0,1\n2,2\n1.5,3\n3,4\n", "goes back after 2 s, to 1.5 s"),
        ("t,q_hip\n0,1\n1,inf\n", "infinite"),
        ("t,q_hip\n0,1\n", "two finite times"),
    ],
)
def test_a_damaged_table_is_told_with_its_place(tmp_path, text, told):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=told) as error:
        Log.read(path)
    assert str(path) in str(error.value)


def test_what_is_no_log_is_refused(tmp_path):
    for name, content in (("a.mat", b"no"), ("a.npz", b"PK"), ("a.parquet", b"PAR1"), ("a.txt", b"t,q_hip")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InvalidInputError, match=name):
            Log.read(tmp_path / name)
    for name in ("absent.csv", "absent.mcap"):
        with pytest.raises(InvalidInputError, match=name):
            Log.read(tmp_path / name)
    (tmp_path / "a.csv").write_text("t,q_hip\n0,1\n1,2\n")
    for wrong in (
        {"columns": {"q_hip": "hop"}},
        {"units": {"q": "furlong"}},
        {"units": {"q": "rpm"}},
        {"units": {"q_hpi": "deg"}},
        {"units": {"u": 0.35}},
        {"units": {"q": 0.0}},
        {"time": "clock"},
        {"columns": {"hip": "q_hip"}},
    ):
        with pytest.raises(InvalidInputError):
            Log.read(tmp_path / "a.csv", **wrong)


def test_objects_in_arrays_are_never_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", t=T, q_hip=np.array([{}] * 11, dtype=object))
    with pytest.raises(InvalidInputError):
        Log.read(tmp_path / "a.npz")


def test_a_delay_of_one_column_moves_it_alone():
    log = Log(T, {"q_hip": Q, "u_hip": T})
    moved = log.delayed({"u": 0.05})
    there = ~np.isnan(moved.columns["u_hip"])
    assert np.allclose(moved.t[there] + 0.05, moved.columns["u_hip"][there], rtol=0, atol=1e-15)
    assert np.array_equal(moved.t[~np.isnan(moved.columns["q_hip"])], T)
    assert moved.between(0.2, 0.4).t.min() >= 0.2
    with pytest.raises(InvalidInputError, match="no column 'knee'"):
        log.delayed({"knee": 0.1})
    with pytest.raises(InvalidInputError, match="no column 'u_left'"):
        Log(T, {"u_left_hip": T}).delayed({"u_left": 0.1})


def test_a_log_cannot_be_written_to_and_keeps_no_arrays_of_callers():
    mine = Q.copy()
    log = Log(T, {"q_hip": mine})
    mine[0] = 9.0
    assert log.columns["q_hip"][0] == Q[0]
    with pytest.raises(ValueError, match="read-only"):
        log.columns["q_hip"][0] = 1.0
    with pytest.raises((TypeError, AttributeError)):
        log.columns["q_hip"] = Q
    assert len({log, Log(T, {"q_hip": Q})}) == 2


@pytest.mark.parametrize("columns", [{"hip": Q}, {"q_hip": Q[:-1]}, {"q_hip": np.full(11, np.inf)}, {"q_hip": Q * 1j}])
def test_columns_that_are_none_are_refused(columns):
    with pytest.raises(InvalidInputError):
        Log(T, columns)


def test_a_simulated_motion_is_a_log(tmp_path):
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    motion = ccpin.simulate(model, None, model.alpha(model.mechanism.q_reference), duration=0.05)
    log = Log.of(motion, model, sensors=["joint3"])
    assert np.array_equal(log.columns["q_joint1"], motion.q[:, 0])
    joint = model.mechanism.tree.joint("joint3")
    assert np.array_equal(log.columns["q_joint3"], motion.q_free[:, joint.q.start])
    motion.save(tmp_path / "motion.csv")
    read = Log.read(tmp_path / "motion.csv")
    assert np.array_equal(read.columns["u_joint2"], motion.u[:, 1])
    with pytest.raises(InvalidInputError, match="joint9"):
        Log.of(motion, model, sensors=["joint9"])
