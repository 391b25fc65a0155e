"""The benchmarks of identification at their smallest: logs that go on where they ended, and peers beside ccpin."""

import re

import pytest

from benchmarks import identification, identification_peers, motors, stribeck

SHARES = re.compile(r"([\w., ()]*?) ([\d.e+-]+) %")


@pytest.mark.slow
def test_a_second_run_goes_on_where_the_first_one_ended(tmp_path, capsys, monkeypatch):
    """Lines of both are those of one run; what is found misses less than what is stated."""
    monkeypatch.setattr(identification, "RATE", 200.0)
    path = tmp_path / "found.jsonl"
    identification.main(["four_bar", "--runs", "1", "--into", str(path)])
    first = path.read_text()
    identification.main(["four_bar", "--runs", "3", "--into", str(path)])
    assert path.read_text().startswith(first)
    lines = identification.read(path)
    assert [line["run"] for line in lines] == [0, 1, 2]
    assert all(found < 0.2 * stated for found, stated in (line["missed"] for line in lines))
    assert "3 robots" in capsys.readouterr().out


@pytest.mark.slow
def test_stribecks_friction_is_told_where_it_is(capsys):
    """It misses less than without, and tells of no joint where there is none."""
    stribeck.main(["rpdr", "--runs", "1"])
    told = capsys.readouterr().out
    with_it, without = (float(x) for x in re.findall(r"([\d.]+) % with", told))
    assert with_it < 0.2 * without
    stribeck.main(["rpdr", "--runs", "1", "--none"])
    assert "an effect told of 0 of 4 joints" in capsys.readouterr().out


@pytest.mark.slow
def test_with_motors_constants_less_is_missed(tmp_path, capsys):
    motors.main(["rpdr", "--runs", "2", "--into", str(tmp_path / "found.jsonl")])
    with_them, without, stated = missed(capsys.readouterr().out).values()
    assert with_them < 0.7 * without < 0.7 * stated
    motors.main(["rpdr", "--runs", "1", "--load"])
    with_them, without, stated = missed(capsys.readouterr().out).values()
    assert with_them < 0.2 * without < 0.2 * stated


def missed(told):
    """Percent by who missed them."""
    return {who.strip(" ,:"): float(share) for who, share in SHARES.findall(told.split("unseen:")[1])}


@pytest.mark.slow
def test_an_arm_by_figaroh(capsys):
    """It finds what ccpin finds of a tree, and not of a loop."""
    pytest.importorskip("figaroh")
    identification_peers.main(["figaroh"])
    arm, loop = (missed(line) for line in capsys.readouterr().out.splitlines())
    assert arm["ccpin"] < 1.0 < arm["stated"]
    assert arm["FIGAROH"] < 0.2 * arm["stated"]
    assert loop["ccpin"] < 1.0 < loop["FIGAROH, arms not joined"]


@pytest.mark.slow
def test_a_loop_by_mujoco(capsys, monkeypatch):
    """A step of its search makes the stated constants better."""
    pytest.importorskip("mujoco.sysid.report.defaults")
    monkeypatch.setattr(identification_peers, "ITERATIONS", 1)
    identification_peers.main(["mujoco"])
    ours, theirs, stated = missed(capsys.readouterr().out).values()
    assert ours < 1.0
    assert theirs < stated


def test_a_peer_that_is_absent_is_told_of(capsys, monkeypatch):
    monkeypatch.setitem(identification_peers.PEERS, "nobody", ("nobody_at_all", None))
    identification_peers.main(["nobody"])
    assert "nobody: skipped" in capsys.readouterr().out
