"""The benchmark of bridges runs at its smallest; no timing is judged here."""

import pytest

from benchmarks.bridges import main

for package in ("casadi", "jax", "crocoddyl"):
    pytest.importorskip(package, reason="what is measured is a bridge to it")


@pytest.mark.slow
def test_every_bridge_is_measured(capsys):
    main(["rpdr"], rows=16, repeats=1)
    told = capsys.readouterr().out
    assert all(word in told for word in ("nodes", "ns a row", "ms an iteration"))
