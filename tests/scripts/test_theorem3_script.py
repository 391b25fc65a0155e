"""The script that asks whether Theorem 3 covers the paper's experiment."""

import pytest

from tests.support.loading import script


@pytest.mark.slow
def test_theorem3_rpdr(tmp_path, capsys):
    """It says that the gain condition holds on 𝒟 and the paper's start is outside of B₂, and draws both motions."""
    script("theorem3_rpdr").main(tmp_path)
    said = capsys.readouterr().out
    assert "13.099 J, outside of B2: Theorem 3 does not cover it" in said
    assert "sup |dg/dq| = 7.25" in said
    for name in ("paper", "inside", "sublevel"):
        assert (tmp_path / f"{name}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
