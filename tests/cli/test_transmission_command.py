"""`ccpin transmission`: the table's numbers are the package's, and a picture is written."""

import json
import re

import numpy as np
import pytest

from ccpin.cli import main
from tests.support.linkage_models import FORMS, ROTORS, places, transmission_of
from tests.support.measured_pairs import LINKAGES
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


@pytest.mark.slow
def test_a_page_has_the_polygons_of_its_postures(capsys, tmp_path):
    """Corners as the closed form's J maps those of the motors' box; nothing is loaded from elsewhere."""
    out = tmp_path / "ankle.html"
    assert main(["transmission", ANKLE, "--effort", "10", "20", "--out", str(out)]) == 0
    assert capsys.readouterr().out.endswith(f"wrote {out}\n")
    page = out.read_text(encoding="utf-8")
    told = json.loads(re.search(r'<script type="application/json" id="postures">(.*?)</script>', page)[1])
    assert told["joints"] == ["pitch", "roll"]
    assert len(told["postures"]) > 50
    for one in told["postures"]:
        corners = np.array([[-10, -20], [-10, 20], [10, 20], [10, -20]]) @ FORMS["ankle"].jacobian(one["q"])
        np.testing.assert_allclose(one["corners"], corners, rtol=0, atol=1e-8)
    assert re.findall(r"https?://(?!www\.w3\.org)", page) == []
    assert main(["transmission", "four_bar", "--out", str(tmp_path / "one.html")]) == 0
    assert 'id="postures"' not in (tmp_path / "one.html").read_text(encoding="utf-8")


def test_lengths_from_a_table(capsys, tmp_path):
    """Pairs in degrees of another crank and rod: numbers, the file written, and tables that are none."""
    linkage = LINKAGES["ankle"]()
    truth = linkage.stated + [0.002, -0.003, 0.0, 0.0, 0.0, -0.001, 0.002, 0.0, 0.0, 0.0]
    motors, joints = linkage.measured(truth, 12, np.random.default_rng(4), noise=0.0)
    table, out = tmp_path / "pairs.csv", tmp_path / "found.urdf"
    header = "roll, pitch, left_motor, note, right_motor"
    rows = np.degrees(np.hstack([joints[:, ::-1], motors]))
    table.write_text("\n".join([header, *(f"{a!r}, {b!r}, {c!r}, x, {d!r}" for a, b, c, d in rows.tolist())]))
    asked = ["transmission", ANKLE, "--identify", str(table), "--unknown", *(linkage.numbers[k] for k in (0, 1, 5, 6))]
    assert main([*asked, "--degrees", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose([each["value"] for each in told["numbers"]], truth[[0, 1, 5, 6]], rtol=0, atol=1e-8)
    assert (told["pairs"], told["rank"], told["unobservable"], told["written"]) == (12, 4, [], str(out))
    assert re.search(r'<joint name="left_ball"[^$]*?<origin xyz="(\S+) ', out.read_text(encoding="utf-8"))[
        1
    ].startswith("-0.04")
    for text, word in (
        ("motor,knee\n", "no column 'crank'"),
        ("crank,rocker\n1,x", "float"),
        ("crank,rocker", "no pairs"),
        ("", "is no table"),
    ):
        table.write_text(text)
        assert main(["transmission", "four_bar", "--identify", str(table)]) == 1
        assert word in capsys.readouterr().err
    assert main(["transmission", "four_bar", "--identify", str(tmp_path / "none.csv")]) == 1
    assert "is no table: [Errno 2]" in capsys.readouterr().err


def test_a_package_is_written(capsys, tmp_path):
    """Its files are told, and are there."""
    neck = str(ROOT / "docs" / "howto" / "neck.xml")
    asked = [
        "transmission",
        neck,
        "--ros2",
        str(tmp_path),
        "--ros2-name",
        "my_neck",
        "--maintainer",
        "Ada <ada@lab.org>",
    ]
    assert main([*asked, "--json"]) == 0
    told = set(json.loads(capsys.readouterr().out)["ros2"])
    assert told == {str(path) for path in tmp_path.rglob("*") if path.is_file()}
    assert str(tmp_path / "include" / "my_neck" / "my_neck_joints.h") in told


def test_in_words(capsys):
    """Names and units, limits that are not stated, and sides that are not evident."""
    assert main(["transmission", str(ROOT / "docs" / "howto" / "neck.xml")]) == 0
    said = capsys.readouterr().out
    assert said.startswith("neck: left_motor, right_motor → pitch, roll\n")
    assert "give speed=" in said
    assert "largest box inside ±(6 × 5)" in said
    assert main(["transmission", "rpdr"]) == 1
    assert "candidates: joint3, joint4" in capsys.readouterr().err


def test_limits_are_proved_within(capsys, tmp_path):
    """The neck's J is constant: what is proved is what is largest there; what is not stated is told."""
    pytest.importorskip("flint")
    neck, out = str(ROOT / "docs" / "howto" / "neck.xml"), tmp_path / "neck.png"
    assert main(["transmission", neck, "--within", "0.2", "0.1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [(row["of"], row["form"], row["verdict"]) for row in told["proved"]] == [
        ("effort", "box", "proven"), ("effort", "ellipsoid", "proven"),
        ("speed", "box", "undecided"), ("speed", "ellipsoid", "undecided"),
    ]  # fmt: skip
    np.testing.assert_allclose(np.diag(told["proved"][0]["size"]), told["effort"]["box"], rtol=1e-5)
    assert main(["transmission", neck, "--within", "0.2", "--speed", "9", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "at all postures within ±(0.2 × 0.2) of the reference:\n  proven: motors hold pitch ±6, roll ±5 over" in said
    assert "motors have speeds" in said
    assert out.stat().st_size > 10_000
    assert main(["transmission", neck, "--within", "0.2", "0.1", "0.3"]) == 1
    assert "--within" in capsys.readouterr().err
