"""The experiment with the whole bench on, as a script and from the command line."""

import json

import numpy as np
import pytest

from ccpin.cli import main
from ccpin.paper.study import BENCH
from tests.support.loading import script
from tests.support.paper import MOVE_OPTIONS

MOVE = ("rpdr", *MOVE_OPTIONS)
FRICTION = ["--friction-coulomb", "0.2", "--friction-viscous", "0.02", "0.02"]
SAMPLED = ["--sample-rate", "1000", "--encoder-counts", "4096", "--velocity-cutoff-hz", "100"]
MOTORS = ["--saturation", "12", "12", "--delay-samples", "1"]


@pytest.mark.slow
def test_the_hardware_experiment(tmp_path, capsys):
    """Every run reaches its goal in about the paper's 0.3 s; friction leaves the error it explains, the ideal none."""
    script("hardware").main(tmp_path)
    assert "friction alone explains" in capsys.readouterr().out
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert set(metrics) == {"ideal", "bench", "bench_towards_goal", "bench_by_error"}
    for name, metric in metrics.items():
        assert metric["settling_time"] == pytest.approx(0.3, abs=0.05)
        assert metric["largest_closure_error"] <= 1e-10
        assert (tmp_path / f"fig9_{name}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    left = {name: np.max(metric["steady_state_error"]) for name, metric in metrics.items()}
    assert left["ideal"] < 1e-4 < left["bench_by_error"] < left["bench"]
    assert np.all(np.max(metrics["bench"]["peak_torque"]) <= BENCH["sampling"].saturation)


@pytest.mark.slow
def test_the_bench_from_the_command_line(capsys):
    """Every option of the bench reaches the simulation: delayed, limited, and stuck short of the goal."""
    assert main(["simulate", *MOVE, *FRICTION, *SAMPLED, "--saturation", "5", "--delay-samples", "1", "--json"]) == 0
    (move,) = json.loads(capsys.readouterr().out)["moves"]
    assert move["peak_torque"] == [5.0, 5.0]
    assert np.radians(0.05) < np.max(move["steady_state_error"]) < 0.2 / 11 * 1.5


@pytest.mark.slow
def test_cycles_with_the_bench(capsys):
    """The supervisor takes --band-deg for settled, as friction leaves an error."""
    assert (
        main(["simulate", *MOVE, *FRICTION, *SAMPLED, *MOTORS, "--cycles", "1", "--wait", "0.1", "--rtol", "1e-7"]) == 0
    )
    assert "move 2: within ±2°" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--encoder-counts", "4096"], "--sample-rate"),
        (["--delay-samples", "1"], "--sample-rate"),
        (["--motor-lag", "0.002"], "--sample-rate"),
        (["--sample-rate", "1000", "--saturation", "1", "2", "3"], "--saturation takes one number or 2, not 3"),
        (["--friction-viscous", "1", "2", "3"], "--friction-viscous takes one number or 2, not 3"),
    ],
)
def test_bad_options_are_sentences(options, words, capsys):
    """What does not fit the mechanism is an error with its option's name and exit code 1."""
    assert main(["simulate", *MOVE, *options]) == 1
    assert words in capsys.readouterr().err
