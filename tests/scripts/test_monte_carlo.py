"""The Monte Carlo study of the paper's move, on few robots."""

import csv

import numpy as np
import pytest

from tests.support.loading import script


@pytest.mark.slow
def test_the_monte_carlo_study(tmp_path, capsys):
    """Every robot settles near the paper's 0.3 s, and friction leaves at most its Coulomb level over K_p."""
    study = script("monte_carlo")
    study.main(tmp_path, 6, None)
    assert "6 robots" in capsys.readouterr().out
    assert (tmp_path / "monte_carlo.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    rows = list(csv.DictReader((tmp_path / "table.csv").open(encoding="utf-8")))
    assert [row["error"] for row in rows] == [""] * 6
    settling = [float(row["settling_time"]) for row in rows]
    assert 0.2 < min(settling) < max(settling) < 0.45
    for row in rows:
        for k in range(2):
            level = study.FRICTION[f"joint{k + 1}"][0] + sum(study.FRICTION[f"joint{j}"][0] for j in (3, 4))
            slack = np.radians(0.5)  # gravity of a robot 20 % heavier than the law's
            assert float(row[f"steady_state_error_{k}"]) <= 1.2 * level / study.K_P[k] + slack
    study.main(tmp_path, 6, None)
    assert capsys.readouterr().out.count("0 failed") == 1
