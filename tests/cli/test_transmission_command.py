"""`ccpin transmission`: the table's numbers are the package's, and a picture is written."""

import json

import numpy as np
import pytest

from ccpin.cli import main
from tests.support.linkage_models import FORMS, ROTORS, places, transmission_of
from tests.support.places import ROOT

ANKLE = str(ROOT / "docs" / "howto" / "ankle.urdf")


def test_it_tells_what_the_closed_form_says(capsys, tmp_path):
    """Rates and felt inertias at the reference, ranges that hold those of random postures on the grid's box."""
    out = tmp_path / "limits.png"
    assert main(["transmission", ANKLE, "--rotor", "0.02", "--shortcuts", "2", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    J = FORMS["ankle"].jacobian(np.zeros(2))
    np.testing.assert_allclose(told["jacobian"], J, rtol=0, atol=1e-10)
    np.testing.assert_allclose(told["rotor_inertia"]["reference"], ROTORS["ankle"] * np.diag(J.T @ J), atol=1e-10)
    assert told["effort"]["share"] == pytest.approx(0.5)
    assert [row["shortcut"] for row in told["shortcuts"]] == ["static_map", "constant_armature", "serial"]
    assert out.stat().st_size > 10_000
    for q in places("ankle", np.random.default_rng(1), 20):
        polygon = transmission_of("ankle").at(q).torque_polytope()
        alone = polygon.bounds[1]
        assert (alone <= np.array(told["effort"]["alone"]["most"]) * 1.01).all()


def test_in_words(capsys):
    """Names and units, limits that are not stated, and sides that are not evident."""
    assert main(["transmission", str(ROOT / "docs" / "howto" / "neck.xml")]) == 0
    said = capsys.readouterr().out
    assert said.startswith("neck: left_motor, right_motor → pitch, roll\n")
    assert "give speed=" in said
    assert "largest box inside ±(6 × 5)" in said
    assert main(["transmission", "rpdr"]) == 1
    assert "candidates: joint3, joint4" in capsys.readouterr().err
