"""What `ccpin check` says standing still takes: a parallelogram's by hand, others' by Pinocchio's potential energy.

The parallelogram's bars stand at θ to the horizontal and its coupler only slides, so that V = g sin θ (½ L Σ m + L M).
"""

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.cli import main
from ccpin.description import read_description
from ccpin.description.finding import installed_models
from ccpin.description.model import Motor
from ccpin.dynamics.soundness import examine
from tests.support.places import MODELS, SHARED

LENGTH, ANGLE, APART = 0.3, 1.0, 0.4
MASSES = {"base": 5.0, "crank": 0.5, "rocker": 0.7, "coupler": 2.0}
TAKES = 9.81 * np.cos(ANGLE) * LENGTH * ((MASSES["crank"] + MASSES["rocker"]) / 2 + MASSES["coupler"])  # N m


def parallelogram(tmp_path, **efforts):
    """A file of it, with a motor of that limit of effort (0: none stated) on each joint that is named."""
    middles = {"base": 0.0, "crank": LENGTH / 2, "rocker": LENGTH / 2, "coupler": APART / 2}
    on = {"crank": ("base", 0.0), "rocker": ("base", APART), "coupler": ("crank", LENGTH)}
    stands = {"crank": ANGLE, "rocker": ANGLE, "coupler": -ANGLE}
    moments = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
    text = "".join(
        f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>{moments}</inertial></link>'
        for (name, x), mass in zip(middles.items(), MASSES.values(), strict=True)
    )
    for name, (parent, x) in on.items():
        text += f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
        text += f'<origin xyz="{x} 0 0"/><axis xyz="0 -1 0"/>'
        text += f'<limit lower="-3" upper="3" effort="{efforts.get(name, 0)}" velocity="9"/></joint>'
    for name in efforts:
        text += f'<transmission name="{name}"><type>transmission_interface/SimpleTransmission</type>'
        text += f'<joint name="{name}"/><actuator name="{name}_motor"/></transmission>'
    text += f'<loop name="pin" type="revolute"><predecessor link="coupler"><origin xyz="{APART} 0 0"/></predecessor>'
    text += f'<successor link="rocker"><origin xyz="{LENGTH} 0 0"/></successor><axis xyz="0 -1 0"/></loop>'
    text += '<group_state name="reference" group="all">'
    text += "".join(f'<joint name="{name}" value="{angle}"/>' for name, angle in stands.items()) + "</group_state>"
    path = tmp_path / "parallelogram.urdf"
    path.write_text(f'<robot name="parallelogram">{text}</robot>', encoding="utf-8")
    return path


def checked(path, capsys, *more):
    """The exit code, the facts, and the words."""
    code = main(["check", str(path), "--json", *more])
    facts = json.loads(capsys.readouterr().out)
    assert main(["check", str(path), *more]) == code
    return code, facts, capsys.readouterr().out


def sentences(facts, weight):
    return [finding["sentence"] for finding in facts["findings"] if finding["weight"] == weight]


@pytest.mark.parametrize(("of_need", "code"), [(1.001, 0), (0.999, 3)])
def test_a_limit_suffices_or_is_doubted(of_need, code, tmp_path, capsys):
    """A thousandth more than the weight's moment about the crank is enough; a thousandth less is not."""
    ended, facts, said = checked(parallelogram(tmp_path, crank=of_need * TAKES), capsys)
    assert ended == code
    (motor,) = facts["motors"]
    assert motor["standing"] == pytest.approx(TAKES, rel=1e-9)
    assert (motor["unit"], motor["limits"]) == ("N m", pytest.approx([-of_need * TAKES, of_need * TAKES]))
    told = f"{TAKES:.3g} N m of crank_motor (limit {of_need * TAKES:.4g} N m)\n"
    assert f"\nmotors drive 1 of 1\nstanding still as assembled takes {told}" in said
    weak = f"motor 'crank_motor' cannot hold it still: that takes {TAKES:.3g} N m (limit {of_need * TAKES:.4g} N m)"
    assert sentences(facts, "doubtful") == ([weak] if code else [])


def test_nothing_is_said_without_a_limit_or_a_load(tmp_path, capsys):
    """No limit stated, or gravity along the hinges: no word, whatever the limit, and no doubt."""
    code, facts, said = checked(parallelogram(tmp_path, crank=0), capsys)
    assert (code, facts["motors"][0]["limits"]) == (0, [None, None])
    assert facts["motors"][0]["standing"] == pytest.approx(TAKES)
    assert "standing still" not in said
    flat = replace(read_description(parallelogram(tmp_path, crank=1e-6)), gravity=(0.0, -9.81, 0.0))
    found = examine(flat)
    assert (found.verdict, found.drives.each[0].standing) == ("proven", None)


@pytest.mark.parametrize(("crank", "rocker", "code"), [(0.3, 0.701, 0), (0.3, 0.699, 3), (0.6, 0.6, 0)])
def test_motors_share_a_load(crank, rocker, code, tmp_path, capsys):
    """Both bars turn alike, so any two moments with that sum will do: limits suffice where their sum does."""
    path = parallelogram(tmp_path, crank=crank * TAKES, rocker=rocker * TAKES)
    ended, facts, said = checked(path, capsys)
    assert ended == code
    assert sum(motor["standing"] for motor in facts["motors"]) == pytest.approx(TAKES, rel=1e-6)
    if code:
        assert sentences(facts, "doubtful") == ["however 2 motors share it, their limits do not hold it still"]
    else:
        assert all(abs(motor["standing"]) <= motor["limits"][1] * (1 + 1e-6) for motor in facts["motors"])
    assert "standing still as assembled takes, in one of many ways, " in said


@pytest.mark.parametrize(("lower", "upper", "code"), [(-1.001, 0.1, 0), (-0.999, 9.0, 3)])
def test_gears_and_limits_of_one_side(lower, upper, code, tmp_path):
    """Behind a gear of −10 the motor's lower bound, tenfold, is what lifts."""
    motor = Motor("drive", "crank", gear=-10.0, lower=lower * TAKES / 10, upper=upper * TAKES / 10)
    found = examine(replace(read_description(parallelogram(tmp_path, crank=0)), motors=(motor,)))
    (drive,) = found.drives.each
    assert drive.limits == pytest.approx((-upper * TAKES, -lower * TAKES))
    assert drive.standing == pytest.approx(TAKES)
    assert drive.share == pytest.approx(-1 / lower)
    assert (found.verdict == "undecided") == (code == 3)
    assert drive.told()[1] == f"limits {-upper * TAKES:.4g} … {-lower * TAKES:.4g} N m"


@pytest.mark.parametrize(
    ("effort", "limits", "share"),
    [
        *((2.0, (1.0, 3.0), 1.0), (0.0, (1.0, 3.0), np.inf), (-1.0, (0.0, 3.0), np.inf), (0.0, (0.0, 3.0), 0.0)),
        *((-2.0, (-np.inf, 1.0), 0.0), (-2.0, (-4.0, 1.0), 0.5), (None, (-1.0, 1.0), 0.0)),
    ],
)
def test_the_share_of_a_limit(effort, limits, share, tmp_path):
    """By hand: of the limit on the effort's side; limits that leave out 0 are kept to or not."""
    drive = examine(read_description(parallelogram(tmp_path, crank=1))).drives.each[0]
    assert drive._replace(limits=limits, standing=effort).share == share


def test_what_no_motor_drives_is_not_held(capsys):
    """Without a motor on joint 2 its arm falls; with a base that floats it is open what carries that."""
    code, facts, said = checked("rpdr", capsys, "--actuated", "joint1")
    assert (code, facts["motors"][0]["standing"]) == (3, None)
    assert "no efforts of the motors hold it still" in sentences(facts, "doubtful")
    assert "standing still" not in said
    code, facts, said = checked("rpdr", capsys, "--floating-base")
    assert (code, [motor["standing"] for motor in facts["motors"]]) == (0, [None, None])
    assert "what standing still takes is not told: it depends on what carries the base" in sentences(facts, "note")


MODELS_AND_MOTORS = [
    *((name, ()) for name in sorted(installed_models())),
    *(("rpdr", ("joint3", "joint4")), ("rpdr", ("joint1", "joint2", "joint3"))),
]


@pytest.mark.parametrize(("name", "actuated"), MODELS_AND_MOTORS)
def test_virtual_work(name, actuated, capsys):
    """Σ uₖ δθₖ = δV along every small closed motion: V is Pinocchio's, δ central differences; motors anywhere."""
    more = ["--actuated", *actuated] if actuated else []
    motors = checked(name, capsys, *more)[1]["motors"]
    mechanism = ccpin.load(name, actuated=actuated or None)
    model, here, step = ccpin.ReducedModel(mechanism), mechanism.q_reference, 1e-5
    free, q = mechanism.pin_model, model.alpha(mechanism.q_reference)
    places = [mechanism.tree.joint(motor["joint"]).q for motor in motors]
    assert {motor["unit"] for motor in motors} == {"N" if name == "stewart" else "N m"}
    for along in np.eye(len(q)):
        ends = [model.sigma(q + sign * step * along, near=here) for sign in (1, -1)]
        rise = np.subtract(*(pin.computePotentialEnergy(free, free.createData(), end) for end in ends))
        work = sum(motor["standing"] * (ends[0] - ends[1])[at][0] for motor, at in zip(motors, places, strict=True))
        assert work == pytest.approx(rise, rel=1e-6, abs=1e-9 * step)


def test_alike_motors_share_a_line(capsys):
    """Three arms of a Delta that stands level, in the file's order; six legs are four names at the most."""
    said = checked("delta", capsys)[2]
    alike = r"standing still as assembled takes \S+ N m of arm1_motor, arm2_motor, arm3_motor \(limit \S+ N m\)\n"
    assert len(re.findall(alike, said)) == 1
    said = checked("stewart", capsys)[2]
    some = r"\S+ N of leg1_extension_motor, leg2_extension_motor, leg3_extension_motor and 3 more \(limit 2000 N\)\n"
    assert len(re.findall(rf"standing still as assembled takes {some}", said)) == 1


def test_many_motors_unlike_are_told_from_the_nearest_to_its_limit(capsys):
    """A hexapod that leans: the larger efforts first, as all limits are alike, and how many more there are."""
    _, facts, said = checked("stewart", capsys, "--reference", "leg1_extension=0.1", "leg2_extension=0.02")
    (line,) = (line for line in said.splitlines() if line.startswith("standing still"))
    *told, rest = line.removeprefix("standing still as assembled takes ").split("; ")
    sizes = [float(words.split()[0]) for words in told]
    assert len(told) == 4
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == pytest.approx(max(abs(motor["standing"]) for motor in facts["motors"]), rel=5e-3)
    named = sum(words.count("_motor") for words in told)
    assert rest == f"of {6 - named} more a smaller share of the limit"


def test_the_mass_that_moves(tmp_path, capsys):
    """A base's does not; nor does that of an arm whose joint is locked."""
    _, facts, said = checked(parallelogram(tmp_path, crank=0), capsys)
    moving = sum(MASSES.values()) - MASSES["base"]
    assert facts["moving_mass"] == pytest.approx(moving)
    assert f"{sum(MASSES.values()):.4g} kg in all, {moving:.4g} kg of it moving)" in said
    root = ElementTree.parse(MODELS / "rpdr.urdf").getroot()
    masses = {
        link.get("name"): float(link.find("inertial/mass").get("value")) for link in root.iterfind("link[inertial]")
    }
    (arm,) = (joint.find("child").get("link") for joint in root.iterfind("joint") if joint.get("name") == "joint1")
    facts = checked("rpdr", capsys, "--locked", "joint1")[1]
    assert facts["moving_mass"] == pytest.approx(sum(masses.values()) - masses[arm])
    assert "0.18 kg in all, all of it moving)" in checked("four_bar", capsys)[2]


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"no {SHARED}: these files belong to others")
def test_a_file_by_others_that_cannot_carry_its_weight(capsys):
    """Its limits of 1 N m are far below what Pinocchio's own reading of it needs; only six bars of it move."""
    path = SHARED / "5bar_linkage_iso3d"
    code, facts, said = checked(path, capsys)
    assert code == 3
    mechanism = ccpin.load(path)
    model, read = ccpin.ReducedModel(mechanism), pin.buildModelFromUrdf(str(path / "robot.urdf"))
    q, here, step = model.alpha(mechanism.q_reference), mechanism.q_reference, 1e-5

    def energy(wanted):
        closed, own = model.sigma(wanted, near=here), pin.neutral(read)
        for joint in mechanism.tree.joints:
            own[read.joints[read.getJointId(joint.name)].idx_q] = closed[joint.q][0]
        return pin.computePotentialEnergy(read, read.createData(), own)

    for motor, along in zip(facts["motors"], np.eye(2), strict=True):
        slope = (energy(q + step * along) - energy(q - step * along)) / (2 * step)
        assert motor["standing"] == pytest.approx(slope, rel=1e-6)
        assert abs(slope) > motor["limits"][1] == 1.0
    assert facts["moving_mass"] == pytest.approx(sum(x.mass for x in list(read.inertias)[1:]))
    assert facts["moving_mass"] < 0.6 * facts["mass"]
    assert "motor 'mot2' cannot hold it still" in said
    assert "hold the joint" not in said
