"""The script that compares laws runs, on the RPDR alone, and what it writes says what it should."""

import json

import pytest

from tests.support.loading import script


def is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_compare_laws(tmp_path, monkeypatch, capsys):
    """Six rows; the exact laws track exactly, no law of the model overshoots, and the model-free one is cheapest."""
    module = script("compare_laws")
    monkeypatch.setattr(module, "CASES", module.CASES[:1])
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
