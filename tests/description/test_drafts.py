"""What `ccpin new` draws up: closed by Pinocchio's reckoning, of the lengths asked for, as heavy as its shapes."""

import json

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import ccpin
from ccpin.cli import main
from ccpin.description.drafts import DENSITY, DRAFTS, drafted
from ccpin.errors import InvalidInputError
from tests.support.urdf_gaps import pinocchio_gaps, posed

ASKED = {
    "five-bar": ({}, {"base": 0.05, "arm": 0.4, "forearm": 0.42}, {"base": 0.6, "arm": 0.2, "forearm": 0.25}),
    "delta": ({}, {"arm": 0.524, "forearm": 1.244}, {"base": 0.05, "platform": 0.1, "width": 0.2}),
    "stewart": ({}, {"base": 0.3, "platform": 0.3, "height": 0.2}, {"platform": 0.15, "height": 0.6}),
    "ankle": ({}, {"crank": 0.04, "heel": 0.06}, {"crank": 0.08, "heel": 0.05, "shank": 0.4, "width": 0.12}),
    "knee": ({}, {"crank": 0.04, "lever": 0.07}, {"thigh": 0.5, "crank": 0.05}),
}
FREEDOMS = {"five-bar": 2, "delta": 3, "stewart": 6, "ankle": 2, "knee": 1}
every_draft = pytest.mark.parametrize(("kind", "asked"), [(kind, one) for kind in ASKED for one in ASKED[kind]])


def written(kind, asked, tmp_path):
    """The file that the command writes."""
    path = tmp_path / "new.urdf"
    lengths = [f"{name}={value}" for name, value in asked.items()]
    assert main(["new", kind, "--out", str(path), *(["--lengths", *lengths] if lengths else [])]) == 0
    return path


@every_draft
def test_a_draft_loads_closes_and_is_sound(kind, asked, tmp_path, capsys):
    """With as many freedoms as the textbooks give it, each driven by its motor, and nothing to be said against it."""
    path = written(kind, asked, tmp_path)
    assert max(pinocchio_gaps(path).values()) < 1e-9
    capsys.readouterr()
    assert main(["check", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["mobility"] == facts["driven"] == len(facts["motors"]) == FREEDOMS[kind]
    assert all(gap["length"] < 1e-9 for gap in facts["stated"])
    assert not [one for one in facts["findings"] if one["weight"] != "note"]


@every_draft
def test_a_draft_moves(kind, asked, tmp_path):
    """Every motor a quarter radian (a twelfth of a leg's way) either way, with motors that hold the weight there."""
    mechanism = ccpin.load(written(kind, asked, tmp_path))
    model = ccpin.ReducedModel(mechanism)
    home = model.at(model.alpha(mechanism.q_reference))
    for k, name in enumerate(mechanism.independent):
        stated = mechanism.tree.joint(name).stated
        for side in (-1.0, 1.0):
            step = side * np.eye(model.n)[k] * min(0.25, 0.25 * stated.upper)
            state = model.at(home.q + step, near=home)
            assert np.linalg.norm(mechanism.constraints().residual(state.q_free)) < 1e-10
            assert (np.abs(state.g) < 0.5 * mechanism.motors.limits[:, 1]).all()
    motion = ccpin.simulate(model, None, home.q, duration=0.05)
    assert motion.status == "finished"


@every_draft
def test_masses_are_those_of_the_shapes_drawn(kind, asked):
    """Aluminium; trimesh integrates over the shapes' surfaces (of 256 sides: one part in a thousand)."""
    for link in drafted(kind, asked).links:
        if link.inertia is None:
            assert link.visuals == ()
            continue
        (visual,) = link.visuals
        radius, length = visual.shape.size
        solid = trimesh.creation.cylinder(radius, length, sections=256, transform=visual.placement)
        solid.density = DENSITY
        assert link.inertia.mass == pytest.approx(solid.mass, rel=1e-3)
        assert link.inertia.com == pytest.approx(solid.center_mass, abs=1e-9)
        largest = float(np.abs(solid.moment_inertia).max())
        assert np.abs(link.inertia.rotational - solid.moment_inertia).max() < 2e-3 * largest


def lengths_of(kind, path, stated):
    """What the file's frames measure at the reference, by Pinocchio."""
    model, data = posed(path)

    def at(joint):
        return data.oMi[model.getJointId(joint)].translation

    if kind == "five-bar":
        tip = data.oMi[model.getJointId("left_elbow")].act(np.array([stated["forearm"], 0, 0]))
        arm = np.linalg.norm(at("left_elbow") - at("left_motor"))
        forearm = np.linalg.norm(at("right_elbow") - tip)
        return {"base": np.linalg.norm(at("left_motor") - at("right_motor")), "arm": arm, "forearm": forearm}
    if kind == "delta":
        pose = data.oMi[model.getJointId("platform_pose")]
        elbows = [at(f"rod2{side}_pitch") for side in "ab"]
        return {"base": np.hypot(*at("motor2")[:2]), "width": np.linalg.norm(elbows[0] - elbows[1])} | {
            "arm": np.linalg.norm(np.mean(elbows, axis=0) - at("motor2")),
            "depth": -pose.translation[2],
        }
    if kind == "stewart":
        return {"base": np.hypot(*at("leg3_roll")[:2]), "height": at("platform_pose")[2]}
    if kind == "knee":
        rod = data.oMi[model.getJointId("rod_swing")].translation
        return {"thigh": at("motor")[2] - at("knee")[2], "crank": at("motor")[0] - rod[0]}
    return {"shank": at("left_motor")[2], "crank": at("left_motor")[0] - at("left_swing")[0]} | {
        "width": at("left_motor")[1] - at("right_motor")[1]
    }


@every_draft
def test_lengths_are_those_asked_for(kind, asked, tmp_path):
    """Distances between joints; the five-bar's other forearm, the Delta's depth by Pythagoras."""
    stated = {**DRAFTS[kind].lengths, **asked}
    if kind == "delta":
        stated["depth"] = np.sqrt(stated["forearm"] ** 2 - (stated["base"] + stated["arm"] - stated["platform"]) ** 2)
    for name, value in lengths_of(kind, written(kind, asked, tmp_path), stated).items():
        assert value == pytest.approx(stated[name], abs=1e-9), name


@pytest.mark.parametrize(
    ("kind", "asked", "words"),
    [
        ("five-bar", {"base": 1.0, "arm": 0.2, "forearm": 0.25}, "arm \\+ forearm > base / 2"),
        ("delta", {"forearm": 0.3}, "forearm > "),
        ("delta", {"forarm": 0.3}, "did you mean 'forearm'"),
        ("stewart", {"height": -1.0}, "height = -1 m"),
        ("stewart", {"height": float("nan")}, "height = nan m"),
        ("hexapod", {}, "there are five-bar, delta"),
    ],
)
def test_what_cannot_be_is_refused(kind, asked, words):
    """Lengths that do not close, that do not exist, or are none; kinds that there are not."""
    with pytest.raises(InvalidInputError, match=words):
        drafted(kind, asked)


def test_without_a_name_the_file_has_the_kinds(tmp_path, capsys, monkeypatch):
    """In the current folder, and only once."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "ankle"]) == 0
    assert capsys.readouterr().out.startswith("ankle.urdf written: n = 2")
    before = (tmp_path / "ankle.urdf").read_bytes()
    assert main(["new", "ankle", "--lengths", "crank=0.04"]) == 1
    said = capsys.readouterr().err
    assert said == "ccpin: InvalidInputError: 'ankle.urdf' is there already: name another file by --out\n"
    assert (tmp_path / "ankle.urdf").read_bytes() == before


def test_no_file_is_written_over(tmp_path, capsys):
    """Nor anything but a URDF, nor where a length is no number."""
    path = tmp_path / "mine.urdf"
    path.write_text("mine", encoding="utf-8")
    for more in (["--out", str(path)], ["--out", str(tmp_path / "x.sdf")], ["--lengths", "arm", "-o", "x.urdf"]):
        assert main(["new", "delta", *more]) == 1
    assert path.read_text(encoding="utf-8") == "mine"
    assert list(tmp_path.iterdir()) == [path]
    said = capsys.readouterr().err
    assert "there already" in said
    assert "name=metres" in said


def test_pinocchio_reads_a_draft(tmp_path):
    """As the free system that ccpin has, mass for mass."""
    path = written("stewart", {}, tmp_path)
    model = pin.buildModelFromUrdf(str(path))
    mechanism = ccpin.load(path)
    assert model.nv == mechanism.n_free
    assert pin.computeTotalMass(model) == pytest.approx(pin.computeTotalMass(mechanism.pin_model), rel=1e-12)
