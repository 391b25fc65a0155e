"""Reading takes work in proportion to the file: calls are counted, not timed."""

from __future__ import annotations

import sys

import pytest

from ccpin.description import read_description
from ccpin.errors import CcpinError

SMALL, TIMES = 40, 4
AXIS = '<axis xyz="0 0 1"/>'
JOINT = f'<joint name="%s{{0}}" type="%s"><parent link="l{{0}}"/><child link="l{{1}}"/>{AXIS}%s</joint>'
TURNS = "<axis><xyz>0 0 1</xyz></axis>"


def each(template, first, last):
    """A template filled with k, k + 1, k + 2 and k − 1 as {0}, {1}, {2} and {before} for each k."""
    return "".join(template.format(k, k + 1, k + 2, before=k - 1) for k in range(first, last))


def chain(n, more="", kind="continuous", following=""):
    """A URDF of n links one above the other, and what comes behind them."""
    links = each("<link name='l{0}'/>", 0, n + 1)
    joints = each(JOINT % ("j", kind, ""), 0, 1) + each(JOINT % ("j", kind, following), 1, n)
    return f'<robot name="r">{links}{joints}{more}</robot>'


def loops(n):
    """Each second link closed onto the next but one."""
    return chain(n, each((JOINT % ("g", "continuous", "")).replace("l{1}", "l{2}"), 0, n - 1))


def notes(n):
    """Elements that nobody knows."""
    return chain(3, each("<gadget{0}/><transmission name='t{0}'><joint name='none{0}'/></transmission>", 0, n))


def mimics(n):
    """Each joint after the one before it."""
    return chain(n, following="<mimic joint='j{before}'/>")


def couplings(n):
    """Joints coupled to their neighbours, each stated by links deep in the tree."""
    coupling = (
        "<coupling name='c{0}'><predecessor link='l{1}'/><successor link='l{before}'/><ratio value='2'/></coupling>"
    )
    return chain(n, each(coupling, 1, n))


def model(*parts):
    """An SDFormat file."""
    return f'<sdf version="1.9"><model name="m">{"".join(parts)}</model></sdf>'


def frames(n):
    """An SDFormat chain whose poses are measured from the link before."""
    links = each("<link name='l{0}'><pose relative_to='l{before}'>0 0 1 0 0 0</pose></link>", 1, n)
    joints = each("<joint name='j{0}' type='fixed'><parent>l{0}</parent><child>l{1}</child></joint>", 0, n - 1)
    return model("<link name='l0'/>", links, joints)


def gears(n, deep=False):
    """Gearboxes between neighbours, side by side or along a chain."""
    links, parent = each("<link name='l{0}'/>", 0, n + 1), "l{0}" if deep else "l0"
    joint = f"<joint name='j{{0}}' type='revolute'><parent>{parent}</parent><child>l{{1}}</child>{TURNS}</joint>"
    ends = ("l{0}", "l{2}", "l{1}") if deep else ("l{1}", "l{2}", "l0")
    gear = (
        f"<joint name='m{{0}}' type='gearbox'><parent>{ends[0]}</parent><child>{ends[1]}</child>{TURNS}"
        f"<gearbox_ratio>2</gearbox_ratio><gearbox_reference_body>{ends[2]}</gearbox_reference_body></joint>"
    )
    return model(links, each(joint, 0, n), each(gear, 0, n - 1))


def bodies(n):
    """An MJCF file of n bodies with motors, couplings of neighbours and a tendon over all of them."""
    parts = {
        "worldbody": each("<body name='b{0}'><joint name='j{0}'/><geom size='1'/></body>", 0, n),
        "actuator": each("<motor joint='j{0}'/>", 0, n),
        "tendon": "<fixed name='t'>" + each("<joint joint='j{0}' coef='1'/>", 0, n) + "</fixed>",
        "equality": each("<joint joint1='j{0}' joint2='j{1}'/>", 0, n - 1),
    }
    return f"<mujoco>{''.join(f'<{part}>{inside}</{part}>' for part, inside in parts.items())}</mujoco>"


SHAPES = {
    "chain": chain,
    "loops": loops,
    "notes": notes,
    "mimics": mimics,
    "couplings": couplings,
    "frames": frames,
    "gears": gears,
    "gears along a chain": lambda n: gears(n, deep=True),
    "bodies": bodies,
}


def calls(text, path):
    """How many functions, of Python and of C, reading a file calls."""
    count = 0

    def counted(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    path.write_text(text)
    sys.setprofile(counted)
    try:
        read_description(path)
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize("shape", SHAPES)
def test_calls_grow_with_the_file(shape, tmp_path):
    """A deep chain took a walk to the root for each of its links, a gearbox a table of all joints."""
    file = tmp_path / "file.xml"
    calls(SHAPES[shape](10), file)  # what is imported late is imported
    few, many = (calls(SHAPES[shape](n), file) for n in (SMALL, TIMES * SMALL))
    assert many < 1.1 * TIMES * few


def test_a_circle_of_joints_with_a_gearbox_is_refused(tmp_path):
    """Its way to the root has no end."""
    gear = (
        "<gazebo><joint name='g' type='gearbox'><parent>l0</parent><child>l1</child><gearbox_ratio>2</gearbox_ratio>"
        "<gearbox_reference_body>l2</gearbox_reference_body><axis><xyz>0 0 1</xyz></axis></joint></gazebo>"
    )
    back = "<joint name='b' type='fixed'><parent link='l2'/><child link='l0'/></joint>"
    path = tmp_path / "circle.urdf"
    path.write_text(chain(2, back + gear, "fixed"))
    with pytest.raises(CcpinError, match=r"circle\.urdf"):
        read_description(path)
