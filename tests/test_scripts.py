"""The experiments' scripts run and write what they promise."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"


def _script(name):
    specification = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def _is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_point_to_point(tmp_path, capsys):
    """Figs. 8 and 9, data, metrics and animation."""
    _script("point_to_point").main(tmp_path)
    assert "within ±2° of the goal" in capsys.readouterr().out
    assert _is_picture(tmp_path / "fig8.png")
    assert _is_picture(tmp_path / "fig9.png")
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["settling_time"] == pytest.approx(0.3, abs=0.05)
    assert metrics["largest_closure_error"] <= 1e-10
    assert (tmp_path / "animation.html").stat().st_size > 100_000


def test_repetitive(tmp_path, capsys):
    """Fig. 10 with its four moves, each settled before the next begins."""
    _script("repetitive").main(tmp_path)
    assert "4 moves" in capsys.readouterr().out
    assert _is_picture(tmp_path / "fig10.png")
    moves = json.loads((tmp_path / "metrics.json").read_text())
    assert [move["settling_time"] is not None for move in moves] == [True] * 4
    assert np.max([move["steady_state_error"] for move in moves]) < 1e-4
