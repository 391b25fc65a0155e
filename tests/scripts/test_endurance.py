"""The endurance study on few cycles."""

import json

import pytest

from tests.support.loading import script


@pytest.mark.slow
def test_the_endurance_study(tmp_path, capsys, monkeypatch):
    """Moves stream to disk, stay closed and repeat; a second call goes on behind the last, with nothing left to do."""
    study = script("endurance")
    short = {"rpdr": 3.0, "delta": 3.0}
    monkeypatch.setattr(study, "TASKS", {name: (short[name], *study.TASKS[name][1:]) for name in short})
    study.main(tmp_path)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" in ")[0].split(":")[0] for line in lines] == ["rpdr", "delta"]
    assert all("ms of CPU a simulated second" in line for line in lines)
    assert (tmp_path / "endurance.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    records = json.loads((tmp_path / "endurance.json").read_text(encoding="utf-8"))
    for name, record in records.items():
        moves = 2 * round(0.5 * short[name] / (study.MOVE + study.WAIT))
        assert len(record["end"]) == len(record["cost"]) == moves
        assert max(record["closure"]) <= 1e-10
        assert max(record["change"][4:]) <= 1e-9
    size = {name: (tmp_path / f"{name}.moves").stat().st_size for name in short}
    study.main(tmp_path)
    again = json.loads((tmp_path / "endurance.json").read_text(encoding="utf-8"))
    for name in short:
        assert (tmp_path / f"{name}.moves").stat().st_size == size[name]
        assert again[name]["closure"] == records[name]["closure"]
        assert again[name]["cost"] == []
