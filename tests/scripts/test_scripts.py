"""The experiments' scripts run and write what they promise."""

import json
from pathlib import Path

import pytest

from ccpin.paper import study
from tests.support.loading import script


def _is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_point_to_point(tmp_path, capsys):
    """Figs. 8 and 9, data, metrics and animation."""
    script("point_to_point").main(tmp_path)
    assert "within ±2° of the goal" in capsys.readouterr().out
    assert _is_picture(tmp_path / "fig8.png")
    assert _is_picture(tmp_path / "fig9.png")
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["settling_time"] == pytest.approx(0.3, abs=0.05)
    assert metrics["largest_closure_error"] <= 1e-10
    assert (tmp_path / "animation.html").stat().st_size > 100_000


@pytest.mark.slow
def test_repetitive(tmp_path, capsys, monkeypatch):
    """Fig. 10 on the bench, every move into 5 % of it in under 0.3 s; the ideal way back takes 0.45 s into ±2°."""
    monkeypatch.setattr(study, "CYCLES", 1)
    script("repetitive").main(tmp_path)
    said = capsys.readouterr().out
    assert "2 moves" in said
    assert "damping ratio of 0.40" in said
    assert _is_picture(tmp_path / "fig10.png")
    moves = json.loads((tmp_path / "times.json").read_text())
    assert max(move["bench"] for move in moves) < 0.3
    assert [move["ideal_narrow"] for move in moves] == pytest.approx([0.280, 0.452], abs=2e-3)


@pytest.mark.slow
def test_fig6(tmp_path, capsys):
    """The singular curves of both kinds, drawn."""
    script("fig6").main(tmp_path)
    assert "isolated, n even: (56.9443°, 123.0557°)" in capsys.readouterr().out
    assert _is_picture(tmp_path / "fig6.png")


@pytest.mark.slow
def test_fig7(tmp_path, capsys):
    """The corners of the certified squares at the four centres, drawn."""
    script("fig7").main(tmp_path)
    assert capsys.readouterr().out.count("r = ") == 4
    assert _is_picture(tmp_path / "fig7.png")


def test_table1(tmp_path):
    """No certificate claims more than the exact radius; the atlas reaches 99.9 % of it."""
    script("table1").main(tmp_path)
    rows = json.loads((tmp_path / "table1.json").read_text())
    assert [row["exact"] for row in rows] == pytest.approx([15.056, 3.467, 40.737, 13.056], abs=1e-3)
    for row in rows:
        for name in ("theorem2", "closest", "reach", "planar", "atlas"):
            assert 0 < row[name] <= row["exact"]
        assert row["atlas"] >= 0.999 * row["exact"]


@pytest.mark.parametrize(("words", "code"), [(["--help"], 0), (["--folder"], 2), (["one", "two"], 2)])
def test_words_that_are_no_folder_write_nothing(words, code, monkeypatch, tmp_path, capsys):
    """A request for help is answered, and what is no folder refused, before an experiment begins."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["script.py", *words])
    with pytest.raises(SystemExit) as ended:
        script("arguments").run(lambda *_: pytest.fail("it ran"), "What it is about.")
    assert ended.value.code == code
    assert not list(tmp_path.iterdir())
    assert "usage" in "".join(capsys.readouterr())


@pytest.mark.parametrize("words", [[], ["there"]])
def test_the_folder_named_is_the_one_written_to(words, monkeypatch):
    """None named: the experiment's own."""
    given = []
    monkeypatch.setattr("sys.argv", ["script.py", *words])
    script("arguments").run(lambda *folder: given.append(folder), None)
    assert given == [tuple(Path(word) for word in words)]
