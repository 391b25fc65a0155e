"""Every mechanism through every format and back: D, C and g to 1e-12, or a refusal that names what cannot be said."""

import math
import re

import numpy as np
import pytest

import ccpin
from benchmarks import round_trips
from ccpin.description.elements.xml import numbers_in
from ccpin.description.formats import write_description
from ccpin.description.model import LoopClosure, frame, frame_from_rpy
from ccpin.description.urdf.writer import _origin
from ccpin.errors import DescriptionError
from tests.support.grown import grown
from tests.support.long_cases import later
from tests.support.places import MODELS, SHARED
from tests.support.trips import EQUAL, PINOCCHIO, WRITTEN, difference, lost, trip

REFUSALS = (
    r"^joint '\w+': (SDFormat|MJCF) has no planar joint$",
    r"^joint '\w+': (SDFormat|MJCF) frees bodies from the world only$",
    r"^joint '\w+': SDFormat gives a (spherical|floating) joint no limits, spring or friction$",
    r"^closure '\w+': the loop is open at zero displacement, and SDFormat has no (prismatic|universal) closure",
    r"^closure '\w+': (SDFormat|MJCF|a robot\.yaml|Drake's URDFs|Isaac Sim's loops) (has|have) no \w+ closure",
    r"^Pinocchio has no constraint model of a \w+ closure \('\w+'\)$",
)
"""All that random mechanisms may be refused for."""


OURS = ("rpdr", "delta", *sorted({path.stem for path in MODELS.glob("*.urdf")} - {"rpdr", "delta"}))


@pytest.mark.parametrize("name", ["rpdr", *later(*OURS[1:])])
@pytest.mark.parametrize("format", WRITTEN)
def test_every_installed_model_comes_back(name, format, tmp_path):
    """Nothing is refused, and nothing lost without a word."""
    found = trip(name, ccpin.load(name), format, tmp_path)
    assert found.error is not None, found.said
    assert found.error <= EQUAL
    assert not found.silent


OTHERS_REFUSED = {
    ("mini_cheetah_leg.urdf", "mjcf"): r"link 'abduct': no body has such moments of inertia",
    ("mini_cheetah_leg.urdf", PINOCCHIO): r"no constraint model of a coupling",
    ("cassie_like", "drake"): r"Drake's URDFs have no fixed closure",
    ("digit_like", "drake"): r"Drake's URDFs have no fixed closure",
    ("neck.xml", "drake"): r"closure 'weld_1': Drake's URDFs have no fixed closure",
    ("cassie_closed_chain.xml", "sdf"): r"'left-achilles-rod': SDFormat gives a spherical joint no limits",
}


REPAIRED = "neck.xml"


@pytest.mark.parametrize(
    "name",
    [*(name for name in round_trips.OTHERS if name != REPAIRED), pytest.param(REPAIRED, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("format", later(*WRITTEN))
def test_every_model_of_others_comes_back(name, format, tmp_path):
    """Or is refused for the reason that is listed."""
    if not (SHARED / name).exists():
        pytest.skip(f"no {SHARED / name}: these files belong to others")
    found = trip(name, ccpin.load(SHARED / name), format, tmp_path)
    if (name, format) in OTHERS_REFUSED:
        assert found.error is None
        assert re.search(OTHERS_REFUSED[name, format], found.said)
    else:
        assert found.equal, found


def of_random_ones(count):
    """The trips of so many random mechanisms."""
    found = list(round_trips.measured(round_trips.random_mechanisms(count)))
    assert len(found) == count * len(WRITTEN)
    return found


def equal_or_refused(trips):
    """Which came back; the others were refused for what is listed."""
    for each in trips:
        if each.error is None:
            assert any(re.search(reason, each.said) for reason in REFUSALS), each
        else:
            assert each.equal, each
    return [each for each in trips if each.equal]


def test_some_random_mechanisms_come_back():
    """URDF has words for all of them."""
    back = equal_or_refused(of_random_ones(4))
    assert sum(each.format == "urdf" for each in back) == 4


@pytest.mark.slow
def test_thirty_random_mechanisms_come_back():
    """Likewise; of each format many come back."""
    back = equal_or_refused(of_random_ones(30))
    counts = {name: sum(each.format == name for each in back) for name in WRITTEN}
    assert counts["urdf"] == 30
    assert min(counts.values()) >= 10


@pytest.mark.parametrize("field", ["damping", "friction", "armature", "stiffness"])
def test_a_loss_does_not_go_unseen(field, tmp_path):
    """A number that is changed in the file is told by `lost`, and by D or g where it bears on them."""
    before = ccpin.load("four_bar", joints={"rocker": {field: 0.4}})
    other = ccpin.load("four_bar", joints={"rocker": {field: 0.4000001}})
    assert lost(before, before, "") == ()
    assert lost(before, other, "") == (f"{field} of rocker",)
    assert difference(before, before) == 0.0
    assert (difference(before, other) > EQUAL) == (field in ("armature", "stiffness"))


def test_the_table_tells_of_every_trip():
    """Equal, refused with its reason, and off by how much."""
    found = list(round_trips.measured([("pair", ccpin.load(grown(4)))], ["urdf", "toolbox"]))
    text = round_trips.table([*found, found[0]._replace(format="sdf", error=3e-5)])
    assert "| pair | equal | refused | OFF by 3.0e-05 |" in text
    assert "- pair, toolbox: closure 'loop0': a robot.yaml has no universal closure" in text


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2, math.pi / 2 - 1e-9, 1.2])
def test_angles_keep_the_digits_of_a_rotation(pitch):
    """Also where pitch is a right angle, and of a matrix with rounding of its own."""
    turn = frame_from_rpy((0.1, 0.2, 0.3), (0.7, pitch, -1.9))
    noise = frame(np.zeros(3), np.eye(3) + 1e-16 * np.arange(9).reshape(3, 3))
    said = _origin(turn @ noise)
    back = frame_from_rpy(*(numbers_in(said[word], 3, None) for word in ("xyz", "rpy")))
    np.testing.assert_allclose(back, turn @ noise, rtol=0, atol=5e-15)


@pytest.mark.parametrize("format", ["urdf", "toolbox", "drake", "isaac"])
def test_gravity_is_kept(format, tmp_path):
    """In a URDF by an element that ccpin alone reads; the Earth's is not written."""
    before = ccpin.load("four_bar").description
    moon = ccpin.MechanismDescription(**{**vars(before), "gravity": (0.1, 0.0, -1.6)})
    suffix = ".yaml" if format == "toolbox" else ".urdf"
    write_description(moon, tmp_path / f"moon{suffix}", format)
    assert ccpin.load(tmp_path / f"moon{suffix}").description.gravity == (0.1, 0.0, -1.6)
    write_description(before, tmp_path / "earth.urdf")
    text = (tmp_path / "earth.urdf").read_text()
    assert "gravity" not in text
    wrong = text.replace("</robot>", '<gravity xyz="0 0"/></robot>')
    (tmp_path / "wrong.urdf").write_text(wrong)
    with pytest.raises(DescriptionError, match="has 2 numbers where 3 are needed"):
        ccpin.load(tmp_path / "wrong.urdf")


@pytest.mark.parametrize(
    ("format", "word", "kind"), [("drake", "ball_constraint", "spherical"), ("isaac", "loop_joint", "fixed")]
)
def test_loops_are_in_the_words_of_the_dialect(format, word, kind, tmp_path):
    """And in no others."""
    before = ccpin.load("four_bar").settled()
    (loop,) = before.closures
    loop = LoopClosure(loop.name, kind, loop.link_a, loop.link_b, loop.placement_a, loop.placement_b)
    description = ccpin.MechanismDescription(**{**vars(before), "closures": (loop,)})
    write_description(description, tmp_path / "robot.urdf", format)
    text = (tmp_path / "robot.urdf").read_text()
    assert f"{word} " in text
    assert "<loop " not in text
    (back,) = ccpin.description.read_description(tmp_path / "robot.urdf").closures
    assert (back.name, back.kind, back.link_a, back.link_b) == (loop.name, kind, loop.link_a, loop.link_b)
    part = np.s_[:, :] if kind == "fixed" else np.s_[:3, 3]
    np.testing.assert_allclose(back.placement_a[part], loop.placement_a[part], atol=1e-15)
    np.testing.assert_allclose(back.placement_b[part], loop.placement_b[part], atol=1e-15)
