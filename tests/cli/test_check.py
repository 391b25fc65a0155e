"""`ccpin check`: gaps are those of Pinocchio's own reading of the file; what is planted is found, nothing else."""

import json
import re
import shutil
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.cli import main
from ccpin.description import read_description
from ccpin.description.finding import installed_models
from ccpin.description.model import Joint, Link, LoopClosure, MechanismDescription
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.poses.closure_gaps import gaps
from tests.support.long_cases import later
from tests.support.places import MODELS, ROOT, SHARED
from tests.support.urdf_gaps import pinocchio_gaps

FOUR_BAR = (MODELS / "four_bar.urdf").read_text(encoding="utf-8")


def checked(path, capsys, *more):
    """The exit code and the facts."""
    code = main(["check", str(path), "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def written(tmp_path, *changes, text=FOUR_BAR):
    """A file with pieces of its text changed, each of which is there."""
    for old, new in changes:
        assert re.search(old, text), old
        text = re.sub(old, new, text, count=1)
    path = tmp_path / "broken.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def sentences(facts, weight):
    return [finding["sentence"] for finding in facts["findings"] if finding["weight"] == weight]


@pytest.mark.parametrize("name", sorted(installed_models()))
def test_our_models_are_sound(name, capsys):
    """And as closed at their stated poses as Pinocchio's kinematics has them."""
    code, facts = checked(name, capsys)
    assert (code, facts["verdict"], facts["closes"]) == (0, "proven", True)
    assert sentences(facts, "wrong") == sentences(facts, "doubtful") == []
    mechanism = ccpin.load(name)
    assert facts["mobility"] == facts["driven"] == mechanism.n
    assert [motor["coordinates"] for motor in facts["motors"]] == [[name] for name in mechanism.independent]
    shown = pinocchio_gaps(MODELS / f"{name}.urdf")
    assert {gap["name"]: gap["length"] for gap in facts["stated"]} == pytest.approx(shown, abs=1e-12)
    assert max(gap["length"] for gap in facts["assembled"]) < 1e-10


@pytest.mark.parametrize(("millimetres", "code"), [(3.0, 3), (0.01, 0)])
def test_a_closure_that_is_off_is_told_by_how_much(millimetres, code, tmp_path, capsys):
    """The rocker's end moved along the rocker: the gap is that; a hundredth of a millimetre is a rounded pose."""
    end = f'{0.08 + 1e-3 * millimetres:.6f} 0 0"'
    path = written(tmp_path, (r'(<successor link="rocker"><origin xyz=")0.08 0 0"', rf"\g<1>{end}"))
    ended, facts = checked(path, capsys)
    assert ended == code
    assert facts["stated"][0]["length"] == pytest.approx(1e-3 * millimetres, rel=1e-6)
    assert facts["stated"][0]["length"] == pytest.approx(pinocchio_gaps(path)["pin"], abs=1e-12)
    assert facts["assembled"][0]["length"] < 1e-10
    told = [f"loop 'pin' is open by {millimetres:.3g} mm 0° at the pose that the file states"]
    assert sentences(facts, "doubtful") == (told if code else [])


def test_a_loop_open_across_its_plane_can_never_close(tmp_path, capsys):
    """A coupler whose end is 3 mm out of the plane of motion: refuted, with the gap; no picture is written."""
    path = written(tmp_path, (r'(<predecessor link="coupler"><origin xyz="0.12 )0 0"', r'\g<1>0.003 0"'))
    out = tmp_path / "none.png"
    assert main(["check", str(path), "--out", str(out)]) == 4
    said = capsys.readouterr().out
    assert "was not closed" in said
    assert "can never close" in said
    assert not out.exists()
    assert "3 mm 0° as stated" in said


def test_a_loop_that_no_search_closes_is_undecided(tmp_path, capsys):
    """A coupler of 0.5 m between ends that are at most 0.22 m apart: 3, and the least gap is what geometry leaves."""
    path = written(tmp_path, (r'(<predecessor link="coupler"><origin xyz=")0.12 0 0"', r'\g<1>0.5 0 0"'))
    code, facts = checked(path, capsys)
    assert (code, facts["closes"]) == (3, False)
    assert facts["assembled"][0]["length"] == pytest.approx(0.5 - (0.1 + 0.04 + 0.08), abs=1e-4)


def test_an_impossible_inertia_is_wrong(tmp_path, capsys):
    """1e-6, 1e-6 and 3e-6 are no body's; 1e-6, 2e-6, 3e-6 are a plate's."""
    for moments, code in (((1e-6, 1e-6, 3e-6), 4), ((1e-6, 2e-6, 3e-6), 0)):
        xx, yy, zz = moments
        new = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
        ended, facts = checked(written(tmp_path, (r"<inertia [^>]*/>", new)), capsys)
        assert ended == code
        wrong = sentences(facts, "wrong")
        assert len(wrong) == (code == 4)
        assert all("link 'crank'" in sentence and "3e-06" in sentence for sentence in wrong)


def test_limits_that_exclude_the_reference_are_told(tmp_path, capsys):
    """The crank stands at 40° = 0.698 rad; limits from 1 rad on exclude that."""
    path = written(tmp_path, (r'lower="-12.566370614359172"', 'lower="1.0"'))
    code, facts = checked(path, capsys)
    assert code == 3
    assert any("'crank' is stated at 0.6981, outside its limits 1 … 12.57" in x for x in sentences(facts, "doubtful"))


def test_a_mechanism_without_mass_is_told(tmp_path, capsys):
    """All inertias and the rotor's gone: no equations of motion; one link's gone: a note, and the rest moves."""
    bare = re.sub(r"<inertial>.*?</inertial>|<transmission.*</transmission>", "", FOUR_BAR, flags=re.DOTALL)
    code, facts = checked(written(tmp_path, text=bare), capsys)
    assert code == 3
    assert any("moves no mass" in sentence for sentence in sentences(facts, "doubtful"))
    one = re.sub(r"<inertial>.*?</inertial>", "", FOUR_BAR, count=1, flags=re.DOTALL)
    code, facts = checked(written(tmp_path, text=one), capsys)
    assert code == 0
    assert "without mass, though a joint moves them: crank" in sentences(facts, "note")


@pytest.mark.parametrize(
    ("actuated", "code", "weight", "words"),
    [
        (["joint1"], 3, "doubtful", "the motors drive 1 of 2 freedoms: what nothing drives moves joint2"),
        (["joint1", "joint2", "joint3"], 0, "note", "3 motors for 2 freedoms"),
        (["joint3", "joint4"], 0, "note", ""),
    ],
)
def test_motors_are_counted_against_freedoms(actuated, code, weight, words, capsys):
    """Too few leave something that nothing drives; too many may work against each other; others will do."""
    ended, facts = checked("rpdr", capsys, "--actuated", *actuated)
    assert ended == code
    assert not words or any(words in sentence for sentence in sentences(facts, weight))


def test_a_floating_base_needs_no_motor_but_a_platform_does(tmp_path, capsys):
    """Six freedoms of a base are nobody's to drive; a platform that stands on six legs has one too many without one."""
    code, facts = checked("rpdr", capsys, "--floating-base")
    assert (code, facts["mobility"], facts["driven"]) == (0, 8, 2)
    assert "the motors drive 2 of 8 freedoms, and the base floats" in sentences(facts, "note")
    path = tmp_path / "hexapod.urdf"
    assert main(["new", "stewart", "--out", str(path)]) == 0
    capsys.readouterr()
    code, facts = checked(path, capsys, "--actuated", *(f"leg{k}" for k in range(1, 6)))
    assert code == 3
    moves = "the motors drive 5 of 6 freedoms: what nothing drives moves leg6"
    assert sentences(facts, "doubtful") == [moves, "no efforts of the motors hold it still"]


def test_what_a_motor_drives_is_its_row_of_differences(capsys):
    """A motor on a dependent joint moves with every coordinate that σ's differences say it depends on."""
    facts = checked("rpdr", capsys, "--actuated", "joint3", "joint4")[1]
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    here = model.mechanism.q_reference
    q, step = model.alpha(here), 1e-5
    for motor in facts["motors"]:
        place = model.mechanism.tree.joint(motor["joint"]).q
        moved = [model.sigma(q + step * e, near=here)[place] - here[place] for e in np.eye(2)]
        assert set(motor["coordinates"]) == {f"joint{k + 1}" for k in range(2) if abs(moved[k]) > 1e-8}


@pytest.mark.parametrize(("name", "told"), [("bennett", "3 of 5"), ("sarrus", "1 of 5"), ("rpdr", None)])
def test_redundant_rows_are_told(name, told, capsys):
    """By Kutzbach's count 4 − 6 = −2 and 6 − 6 = 0 for loops that move in one way: 3 and 1 too many."""
    said = [x for x in sentences(checked(name, capsys)[1], "note") if "redundant rows" in x]
    assert said == ([] if told is None else [f"redundant rows: {told}, so that it moves for exact lengths only"])


def test_it_is_told_in_words_and_drawn(tmp_path, capsys):
    """A picture of the closed and of the stated pose, or a page."""
    for out in ("a.png", "a.html"):
        assert main(["check", "four_bar", "--reference", "crank=0.9", "--out", str(tmp_path / out)]) == 3
        assert (tmp_path / out).stat().st_size > 10_000
    said = capsys.readouterr().out
    for words in (
        "closes (1 loop; joints up to 0.12 m apart, 0.18 kg in all, all of it moving)",
        "moves in one way: crank",
        "motors that drive the joint they are on: crank_motor of crank",
        "doubtful: ",
    ):
        assert words in said
    assert main(["check", "four_bar", "--out", str(tmp_path / "a.step")]) == 1
    assert ".png" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("kind", "move", "length", "angle"),
    [
        ("spherical", ((0.3, 0.0, 0.4), (0.0, 0.0, 0.2)), 0.5, 0.0),
        ("revolute", ((0.3, 0.0, 0.4), (0.2, 0.0, 0.0)), 0.5, 0.2),
        ("fixed", ((0.3, 0.0, 0.4), (0.0, 0.0, 3.0)), 0.5, 3.0),
        ("prismatic", ((0.3, 0.4, 0.7), (0.0, 0.2, 0.0)), 0.5, 0.2),
        ("cylindrical", ((0.3, 0.4, 0.7), (3.0, 0.0, 0.0)), 0.5, 3.0),
        ("universal", ((0.3, 0.0, 0.4), (0.0, 0.0, 0.2)), 0.5, 0.2),
        ("planar", ((0.3, 0.4, 0.7), (0.2, 0.0, 0.0)), 0.7, 0.2),
        ("perpendicular", ((0.3, 0.4, 0.7), (0.0, 0.0, 0.2)), 0.0, 0.2),
        ("in_plane", ((0.3, 0.4, 0.7), (0.1, 0.0, 0.2)), 0.3, 0.0),
        ("distance", ((0.3, 0.0, 0.4), (0.1, 0.0, 0.2)), 0.3, 0.0),
    ],
)
def test_the_gap_of_a_kind_is_what_its_words_say(kind, move, length, angle):
    """End B moved by d and turned from where the ends coincide (a rod is 0.2 m long): worked out by hand."""
    links = tuple(Link(name) for name in ("a", "b"))
    joints = (Joint("j", "revolute", "a", "b"),)
    tree = build_tree(MechanismDescription("two", "a", links, joints), False)
    xyz, rpy = move
    closure = LoopClosure("c", kind, "a", "b", placement_b=(xyz, rpy), length=0.2 if kind == "distance" else None)
    (gap,) = gaps(tree, [closure], np.zeros(1))
    assert gap.length == pytest.approx(length, abs=1e-12)
    assert gap.angle == pytest.approx(angle, abs=1e-12)


needs_others = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no {SHARED}: these files belong to others")


@needs_others
@pytest.mark.parametrize("name", ["5bar_linkage_iso3d", "cassie_like", "digit_like"])
def test_gaps_of_files_by_others(name, capsys):
    """Both frames of each loop by Pinocchio's own parser and kinematics at zero: distance, and angle of welds."""
    facts = checked(SHARED / name, capsys)[1]
    model = pin.buildModelFromUrdf(str(SHARED / name / "robot.urdf"))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    closures = {closure.name: closure for closure in read_description(SHARED / name).closures}
    assert closures
    for gap in facts["stated"]:
        closure = closures[gap["name"]]
        a, b = (data.oMf[model.getFrameId(link, pin.BODY)] for link in (closure.link_a, closure.link_b))
        assert gap["length"] == pytest.approx(np.linalg.norm(b.translation - a.translation), abs=1e-9)
        turn = np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)) if closure.kind == "fixed" else 0.0
        assert gap["angle"] == pytest.approx(turn, abs=1e-6)
    assert facts["closes"]


@needs_others
def test_inertias_of_a_file_by_others(capsys):
    """Of the mini cheetah's leg: refuted for exactly those links whose moments violate the triangle inequality."""
    path = SHARED / "mini_cheetah_leg.urdf"
    impossible = set()
    for link in ElementTree.parse(path).getroot().iter("link"):
        stated = link.find("inertial/inertia")
        if stated is None:
            continue
        xx, xy, xz, yy, yz, zz = (float(stated.get(f"i{word}")) for word in ("xx", "xy", "xz", "yy", "yz", "zz"))
        small, middle, large = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if small + middle < large * (1 - 1e-6):
            impossible.add(link.get("name"))
    code, facts = checked(path, capsys)
    assert code == 4
    assert {re.match(r"link '(.*?)'", sentence)[1] for sentence in sentences(facts, "wrong")} == impossible != set()


_LENGTH = re.compile(r'((?:origin|predecessor|successor)[^>]*?xyz=")([^"]*)"')


def in_millimetres(text):
    """All lengths of its frames a thousandfold."""
    thousandfold = lambda found: f'{found[1]}{" ".join(str(1e3 * float(x)) for x in found[2].split())}"'  # noqa: E731
    return _LENGTH.sub(thousandfold, text)


INERTIA = 'ixx="6e-07" ixy="0" ixz="0" iyy="9.49333e-06" iyz="0" izz="9.13333e-06"'
OF_CRANK = r'lower="-12.566370614359172" upper="12.566370614359172"'
BROKEN = {
    "mass 0 beside an inertia": (
        [('<mass value="0.04"/>', '<mass value="0"/>')],
        4,
        "wrong",
        "'crank': no body without",
    ),
    "negative mass": ([('<mass value="0.04"/>', '<mass value="-0.04"/>')], 1, "error", "mass -0.04 kg is negative"),
    "inertia in kg mm²": (
        [(INERTIA, 'ixx="0.6" ixy="0" ixz="0" iyy="9.5" iyz="0" izz="9.1"')],
        3,
        "doubtful",
        "15.4 m",
    ),
    "centre of mass in mm": ([('<origin xyz="0.02 0 0"/>', '<origin xyz="20 0 0"/>')], 3, "doubtful", "20 m"),
    "one hinge askew": (
        [(r'(<origin xyz="0.04 0 0"/>\s*<axis xyz=")0 -1 0', r"\g<1>0 0 1")],
        *(
            4,
            "doubtful",
            "joint 'coupler' cannot turn: the other 3 axes of loop 'pin' are parallel, its own is not, by 90°",
        ),
    ),
    "the pin askew": (
        [(r'(</successor>|<successor[^\n]*\n)(\s*<axis xyz=")0 -1 0', r"\g<1>\g<2>1 0 0")],
        *(3, "doubtful", "the loop's own joint cannot turn: the other 3 axes of loop 'pin' are parallel"),
    ),
    "a hinge the other way round": (
        [(r'(<origin xyz="0.1 0 0"/>\s*<axis xyz=")0 -1 0', r"\g<1>0 1 0")],
        *(3, "doubtful", "loop 'pin' is open by 134.7 mm"),  # 2 · 80 mm · sin 57.327°: the rocker mirrored
    ),
    "no axis": ([('<axis xyz="0 -1 0"', '<axis xyz="0 0 0"')], 1, "error", "'crank': the axis is the zero vector"),
    "a mesh that is not there": (
        [('<box size="0.16 0.012 0.022"/>', '<mesh filename="base.stl"/>')],
        *(0, "note", "mesh 'base.stl' is not there"),
    ),
    "two links of one name": ([('<link name="rocker">', '<link name="crank">')], 1, "error", "used 2 times"),
    "limits reversed": ([(OF_CRANK, 'lower="1" upper="-1"')], 1, "error", "lower limit 1 exceeds upper limit -1"),
    "limits in degrees": ([(OF_CRANK, 'lower="-180" upper="180"')], 0, "note", "180 rad, which is 29 turns"),
    "the pose in degrees": (
        [("0.6981317007977318", "40"), ("-0.3438668149598163", "-19.7022"), ("1.0005079005386754", "57.3249")],
        *(3, "doubtful", "the stated pose is in degrees: read so"),
    ),
    "no motor": ([(r"(?s)<transmission.*</transmission>", "")], 0, "note", "no motor is stated"),
    "a misspelt element": (
        [('<loop name="pin" type="revolute">', '<lop name="pin" type="revolute">'), ("</loop>", "</lop>")],
        *(1, "error", "did you mean 'loop'?"),
    ),
    "a misspelt attribute": ([('velocity="60"', 'velocty="60"')], 1, "error", "did you mean 'velocity'?"),
    "a misspelt link": ([('<successor link="rocker">', '<successor link="roker">')], 1, "error", "mean 'rocker'?"),
    "a misspelt joint": ([('<joint name="rocker" value', '<joint name="roker" value')], 1, "error", "mean 'rocker'?"),
    "a weld in place of a pin": ([("(<loop[^>]*)revolute", r"\1fixed")], 3, "doubtful", "open by 0 mm 37.03°"),
    "no loop": ([("(?s)<loop.*</loop>", "")], 1, "error", "no <loop> or <coupling> says what they depend on"),
    "a comma for a point": ([('<mass value="0.04"', '<mass value="0,04"')], 1, "error", "'0,04' is not numeric"),
}


LONG = ("the pin askew", "a weld in place of a pin")  # where loops may close is looked for everywhere


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in BROKEN])
def test_what_is_broken_is_told(name, tmp_path, capsys):
    """What a person does to a file that was sound: the exit code, and the sentence that says what it was."""
    changes, code, weight, words = BROKEN[name]
    ended, facts = checked(written(tmp_path, *changes), capsys)
    assert ended == code
    said = [facts.get("message", "")] if weight == "error" else sentences(facts, weight)
    assert any(words in sentence for sentence in said), facts


@pytest.mark.parametrize("name", later("slider_crank", *sorted({*installed_models()} - {"slider_crank"})))
def test_lengths_in_millimetres_are_told(name, tmp_path, capsys):
    """Beside inertias in kg m²: whether the loops still close or not, the units are doubted."""
    text = in_millimetres((MODELS / f"{name}.urdf").read_text(encoding="utf-8"))
    path = tmp_path / "millimetres.urdf"
    path.write_text(text, encoding="utf-8")
    code, facts = checked(path, capsys)
    assert code == 3
    assert any("in other units than m, kg, kg m²?" in sentence for sentence in sentences(facts, "doubtful"))


def test_a_structure_is_no_mechanism(tmp_path, capsys):
    """A four-bar with one hinge askew has 3 freedoms of joints and rows of rank 3: 3 − 3 = 0."""
    bare = re.sub(r' independent="\w+"|(?s:<transmission.*</transmission>)', "", FOUR_BAR)
    path = written(tmp_path, (r'(<origin xyz="0.04 0 0"/>\s*<axis xyz=")0 -1 0', r"\g<1>0 0 1"), text=bare)
    code, facts = checked(path, capsys)
    assert (code, facts["mobility"]) == (4, 0)
    assert "nothing moves: the loops take all 3 freedoms of its joints, so it is a structure" in sentences(
        facts, "wrong"
    )
    assert main(["check", str(path)]) == 4
    assert "nothing moves\n" in capsys.readouterr().out


def test_a_motor_on_what_cannot_turn_moves_nothing(tmp_path, capsys):
    """A pendulum beside the structure moves; the askew hinge's motor does not move it."""
    beside = '<link name="bob"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    beside += (
        '</inertial></link><joint name="swing" type="continuous"><parent link="crank"/><child link="bob"/></joint>'
    )
    askew = (r'(<origin xyz="0.04 0 0"/>\s*<axis xyz=")0 -1 0', r"\g<1>0 0 1")
    bare = re.sub(r' independent="\w+"', "", FOUR_BAR)
    path = written(tmp_path, askew, ("</robot>", f"{beside}</robot>"), text=bare)
    facts = checked(path, capsys, "--actuated", "crank", "swing")[1]
    assert facts["independent"] == ["swing"]
    assert facts["moving_mass"] == pytest.approx(1.0)  # the bob's
    assert "motor 'crank_motor' moves nothing" in sentences(facts, "doubtful")


def test_alike_loops_and_motors_share_a_line(tmp_path, capsys):
    """Forty that say the same say it once."""
    assert main(["check", "delta"]) == 0
    said = capsys.readouterr().out
    assert "loops ball1a, ball1b, ball2a and 3 more: 0 mm 0° as stated, 0 mm 0° assembled" in said
    assert len(re.findall("drives? ", said)) == 2


@needs_others
@pytest.mark.parametrize(
    ("name", "code", "mobility"),
    [
        ("four_bar.urdf", 0, 3 - 2),
        ("mini_cheetah_leg.urdf", 4, 6 - 3),
        ("5bar_linkage_iso3d", 3, 5 - 3),  # its motors, and those of the next two, cannot carry their weight
        ("cassie_like", 3, 19 - 12 - 2),
        ("digit_like", 3, 27 - 18 - 3),
        ("cassie_closed_chain.xml", 3, 32 - 10 - 2),
        pytest.param("neck.xml", 0, 1, marks=pytest.mark.slow),  # whose lengths are repaired
        ("two_rod_ankle/ankle.xml", 0, 2),
    ],
)
def test_files_by_others_are_judged(name, code, mobility, capsys):
    """The mobility is nv less rank and idle spins as counted apart from ccpin; the mass is the sum of the file's."""
    ended, facts = checked(SHARED / name, capsys)
    assert (ended, facts["mobility"]) == (code, mobility)
    path = SHARED / name / "robot.urdf" if (SHARED / name).is_dir() else SHARED / name
    root = ElementTree.parse(path).getroot()
    if root.tag == "robot":
        assert facts["mass"] == pytest.approx(sum(float(mass.get("value")) for mass in root.iter("mass")))


def test_a_tree_whose_loops_are_in_the_file_beside_it(tmp_path, capsys):
    """It is named, whatever it is called; a YAML that declares none, or is about another URDF, is not."""
    beside, tree = tmp_path / "loops.yaml", tmp_path / "robot.urdf"
    shutil.copy(ROOT / "docs/elements/toolbox/robot.urdf", tree)
    assert main(["check", str(tree)]) == 1
    assert "declares its loops" not in capsys.readouterr().err
    beside.write_text("joints: [closed_loop]\n", encoding="utf-8")
    assert main(["check", str(tree)]) == 1
    assert "declares its loops" not in capsys.readouterr().err
    shutil.copy(ROOT / "docs/elements/toolbox/robot.yaml", beside)
    assert main(["check", str(tree)]) == 1
    assert f"'{beside}' declares its loops" in capsys.readouterr().err
    assert main(["check", str(beside)]) == 0
    other = shutil.copy(tree, tmp_path / "other.urdf")
    assert main(["check", str(other)]) == 1
    assert "declares its loops" not in capsys.readouterr().err
