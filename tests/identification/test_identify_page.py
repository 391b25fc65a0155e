"""`ccpin identify` and its page: what was found, what was not seen, clocks, and residuals as figures."""

import json

import numpy as np
import pytest

from ccpin.cli import main
from ccpin.identification.estimates.explained_efforts import Explained
from ccpin.identification.estimates.residual_figures import autocorrelations, efforts_figure
from ccpin.identification.logs.log import Log


def test_autocorrelations_are_those_of_a_first_order_process():
    draw, x = np.random.default_rng(0), np.zeros(20000)
    for k in range(1, len(x)):
        x[k] = 0.8 * x[k - 1] + draw.normal()
    found = autocorrelations(x)
    assert len(found) == 60
    assert np.allclose(found[:10], 0.8 ** np.arange(1, 11), atol=0.05)
    assert np.abs(autocorrelations(draw.normal(size=20000))).max() < 5.0 / np.sqrt(20000.0)


def test_an_outlier_hides_no_other_sample():
    """Axes hold all samples within twenty standard deviations, whole, and end far below one that is 300 off."""
    draw, t = np.random.default_rng(0), np.linspace(0.0, 1.0, 400)
    told = np.sin(6.0 * t)[:, None]
    measured = told + draw.normal(0.0, 0.01, (400, 1))
    measured[[7, 8], 0] = told[[7, 8], 0] + [3.0, 0.15]
    both = Explained(t, told, measured, told, ("hip",))
    efforts, residuals = efforts_figure(both._replace(told=0.9 * told), both).axes
    near, left = np.delete(measured[:, 0], 7), np.delete(both.left[:, 0], 7)
    assert efforts.get_ylim()[0] < near.min() < near.max() < efforts.get_ylim()[1] < 1.3
    assert residuals.get_ylim()[0] < left.min() < left.max() < residuals.get_ylim()[1] < 0.3


@pytest.mark.slow
def test_the_command_tells_what_was_not_seen_clocks_and_outliers(bench, tmp_path, capsys):
    pytest.importorskip("cvxpy")
    log, path, page = bench.log(1), tmp_path / "run.csv", tmp_path / "page.html"
    u = np.array(log.columns["u_joint2"])
    u[250] += 1.0
    Log(log.t, dict(log.columns) | {"u_joint2": u}).delayed({"u": -0.004}).save(path)
    asked = ["identify", "rpdr", "--logs", str(path), "--prior", "inertia=10%", "friction=0.05"]
    assert main([*asked, "--align", "--report", str(page), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert abs(told["delays"][0]["seconds"] - 0.004) < 5.0 * told["delays"][0]["deviation"]
    assert [each["column"] for each in told["outliers"]] == ["u_joint2"]
    assert len(told["held_out"]) == 5
    assert all(np.less(each["found"], each["stated"]).all() for each in told["held_out"])
    text = page.read_text(encoding="utf-8")
    for words in ("Held-out samples", "Clocks", "95 % of white noise", "u_joint2", "run.csv"):
        assert words in text


def test_a_prior_that_says_nothing_is_told(bench, tmp_path, capsys):
    path = tmp_path / "run.csv"
    bench.log(0).save(path)
    assert main(["identify", "rpdr", "--logs", str(path), "--prior", "mass=heavy"]) == 1
    assert "neither a number nor a share" in capsys.readouterr().err
    assert main(["identify", "rpdr", "--logs", str(path), "--noise", "q_joint1=abc"]) == 1
    assert "the noise of 'q_joint1' = 'abc' must be a positive number" in capsys.readouterr().err


def test_the_example_of_columns_names_all_that_count(bench, tmp_path, capsys):
    """A file with other names, positions in degrees and currents, read as the help says."""
    with pytest.raises(SystemExit):
        main(["identify", "--help"])
    (line,) = [each.split() for each in capsys.readouterr().out.splitlines() if " --columns q_" in each]
    named = dict(each.split("=") for each in line if each[:2] in ("q_", "u_"))
    log = bench.log(0)
    scale = {"q": np.degrees(1.0), "u": 1.0 / 0.35}
    table = np.column_stack([log.t, *(log.columns[name] * scale[name[0]] for name in named)])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=",".join(["t", *named.values()]), comments="")
    read = Log.read(tmp_path / "run.csv", columns=named, units={"q": "deg", "u": 0.35})
    assert all(np.allclose(read.columns[name], log.columns[name], rtol=1e-12) for name in named)
    assert {f"u_{name}" for name in bench.model.mechanism.actuated} <= set(named)
    assert {f"q_{name}" for name in bench.model.mechanism.independent} <= set(named)


def test_what_is_no_table_is_told_before_motions_are_tried(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("ccpin.cli.excite.excitation", None)
    box = ["--lower-deg", "-110", "-110", "--upper-deg", "-70", "-70"]
    assert main(["excite", "rpdr", *box, "--speed", "3", "--out", str(tmp_path / "m.txt")]) == 1
    assert "must end in .csv or .parquet" in capsys.readouterr().err
    assert main(["identify", "rpdr", "--logs", "none.csv", "--out", "learnt.txt"]) == 1
    assert "the suffix of 'learnt.txt' names none of urdf" in capsys.readouterr().err
