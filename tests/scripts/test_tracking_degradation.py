"""How tracking degrades on line: in first order of the period and of the error in σ."""

import json

import numpy as np
import pytest

from tests.support.loading import script


@pytest.mark.slow
def test_tracking_degradation(tmp_path, monkeypatch, capsys):
    """Four times the period, four times the error; ten times σ's error, ten times, below the bound; σ is never held."""
    tracking = script("tracking_degradation")
    monkeypatch.setattr(tracking, "CASES", [tracking.CASES[0]._replace(cells=48)])
    monkeypatch.setattr(tracking, "PERIODS", (1e-3, 4e-3))
    monkeypatch.setattr(tracking, "SIGMA_ERRORS", (1e-4, 1e-3))
    tracking.main(tmp_path)
    assert "σ held 0 times" in capsys.readouterr().out
    assert (tmp_path / "curves.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    curves = json.loads((tmp_path / "curves.json").read_text())["rpdr"]
    assert set(curves) == {"computed torque", "PD+"}
    for found in curves.values():
        sampled, off = ([row["error"] for row in found[kind]] for kind in ("sampled", "sigma"))
        assert sampled[1] / sampled[0] == pytest.approx(4.0, rel=0.05)
        assert off[1] / off[0] == pytest.approx(10.0, rel=0.02)
        proved = [row["error"] for row in found["bound"]]
        assert all(measured < bound < 8.0 * measured for measured, bound in zip(off, proved, strict=True))
        assert found["bound_ends"] == ""
        assert np.radians(0.01) < sampled[0] < np.radians(0.2)
        assert all(row["held"] == 0 and row["steps"] <= tracking.MAX_NEWTON_STEPS for row in found["sampled"])
