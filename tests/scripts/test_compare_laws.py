"""The two scripts on tracking run, on the RPDR alone, and what they write says what it should."""

import json

import numpy as np
import pytest

from tests.support.loading import script


def is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_compare_laws(tmp_path, monkeypatch, capsys):
    """Six rows; the exact laws track exactly, no law of the model overshoots, and the model-free one is cheapest."""
    module = script("compare_laws")
    monkeypatch.setattr(module, "CASES", [module.CASES[0]._replace(cells=16)])
    monkeypatch.setattr(module, "PASSES", 1)
    module.main(tmp_path)
    rows = {row["law"]: row for row in json.loads((tmp_path / "table.json").read_text())}
    assert len(rows) == 6
    for name in ("PD+, quintic", "computed torque, quintic"):
        assert rows[name]["tracking_error"] < 1e-5
        assert max(rows[name]["overshoot"]) < 1e-5
    assert rows["PD, on-line gravity, quintic"]["tracking_error"] > 1e-2
    assert all(row["settling_time"] < 0.5 for row in rows.values())
    assert min(rows, key=lambda name: rows[name]["cost_us"]) == "PD, simple gravity (28), step"
    text = (tmp_path / "table.txt").read_text()
    assert text in capsys.readouterr().out
    assert text.count("\n") == 7
    assert is_picture(tmp_path / "laws.png")


def test_tracking_degradation(tmp_path, monkeypatch, capsys):
    """The error grows in proportion to the period and to the error in σ, and σ is always found within the cap."""
    module = script("tracking_degradation")
    monkeypatch.setattr(module, "CASES", module.CASES[:1])
    monkeypatch.setattr(module, "PERIODS", (2e-3, 4e-3))
    monkeypatch.setattr(module, "SIGMA_ERRORS", (1e-3, 1e-2))
    module.main(tmp_path)
    curves = json.loads((tmp_path / "curves.json").read_text())["rpdr"]
    for found in curves.values():
        periods, sizes = ([row["error"] for row in found[key]] for key in ("sampled", "sigma"))
        assert np.divide(*periods[::-1]) == pytest.approx(2.0, rel=0.1)
        assert np.divide(*sizes[::-1]) == pytest.approx(10.0, rel=0.1)
        assert all(row["held"] == 0 and row["steps"] <= module.MAX_NEWTON_STEPS for row in found["sampled"])
    assert "σ held 0 times" in capsys.readouterr().out
    assert is_picture(tmp_path / "curves.png")
