"""Small MJCF files, each about one way of stating a mechanism, and what to read them with."""

from __future__ import annotations

import pytest

from ccpin import MechanismDescription
from tests.support.places import SHARED
from tests.support.reading import read_mjcf

CASSIE = SHARED / "cassie_closed_chain.xml"
BALL = '<geom size="0.1"/>'


def model(bodies: str, *, equality: str = "", head: str = "", tail: str = "") -> str:
    """Return an MJCF file around some bodies and constraints."""
    return f'<mujoco model="sample">{head}<worldbody>{bodies}</worldbody><equality>{equality}</equality>{tail}</mujoco>'


PAIR = (
    f'<body name="a" pos="0.1 0.2 0.3" euler="10 20 30"><joint name="ja" axis="1 2 3"/>{BALL}</body>'
    f'<body name="b" pos="1 0 0" quat="1 2 -1 0.5"><joint name="jb" axis="0 1 0"/>{BALL}</body>'
)
JOINTLESS = (
    f'<body name="base" pos="0.4 -0.1 0.2" euler="0 30 0">{BALL}<body name="arm" pos="0 0 1">'
    f'<joint name="j" axis="0 1 0"/>{BALL}<body name="tip" pos="0.3 0 0.1" euler="5 6 7">{BALL}</body></body></body>'
)
SAMPLES = {
    "connect with joint pos": model(
        f'<body name="a" pos="0 0 1"><joint name="j" pos="0.2 -0.1 0.3" axis="1 1 0"/>{BALL}'
        f'<body name="b" pos="0.5 0 0"><joint name="k" pos="0 0.4 0" axis="0 0 1" ref="25"/>{BALL}</body></body>',
        equality='<connect name="c" body1="b" anchor="0.3 0.1 -0.2"/>',
    ),
    "several top-level bodies": model(
        PAIR, equality='<connect body1="a" body2="b" anchor="0.5 0.1 0"/><connect body1="b" anchor="1 0 0"/>'
    ),
    "jointless first body": model(JOINTLESS, equality='<connect body1="arm" body2="base" anchor="0 0 0.5"/>'),
    "weld to a jointless body": model(
        JOINTLESS + f'<body name="c"><freejoint name="f"/>{BALL}</body>',
        equality='<weld body1="c" body2="tip" anchor="0.1 0.2 0.3"/><weld body1="tip"/>',
    ),
    "weld with relpose": model(
        PAIR,
        equality='<weld body1="a" body2="b" relpose="0.1 0.2 0.3 1 2 3 4" anchor="0.5 0.6 0.7" torquescale="2"/>'
        '<weld body1="b" body2="a" relpose="9 9 9 0 0 0 0" anchor="0.1 0 0"/>',
    ),
    "weld that leaves turning free": model(
        PAIR, equality='<weld body1="a" body2="b" anchor="0.5 0.6 0.7" torquescale="0"/>'
    ),
    "sites": model(
        f'<body name="a"><joint name="j"/>{BALL}<site name="s" pos="0.1 0.2 0.3" xyaxes="1 1 0 0 1 1"/>'
        f'<site name="line" fromto="0 0 0 0.1 0.5 -0.2" type="capsule" size="0.01"/></body>'
        f'<body name="b" pos="1 0 0"><joint name="k" axis="1 0 0"/>{BALL}'
        f'<frame pos="0 0 1" euler="0 90 0"><site name="t" pos="0.4 0 0" zaxis="1 2 3"/></frame></body>',
        equality='<connect site1="s" site2="t"/><weld site1="t" site2="line"/>',
    ),
    "defaults tree": model(
        f'<body name="a" childclass="slider"><joint name="j"/>{BALL}<body name="b" pos="0 0 1">'
        f'<joint name="k" class="tilted"/>{BALL}<body name="c" childclass="tilted" pos="0 1 0">'
        f'<joint name="l" ref="0"/>{BALL}<site name="s" quat="1 1 0 0"/></body></body></body>',
        equality='<connect name="on" body1="c" anchor="0 0 1" active="true"/>'
        '<connect name="off" body1="b" anchor="0 0 1"/><weld name="s" site1="s" site2="w" class="slider"/>',
        head='<compiler angle="radian" eulerseq="zYx"/><default><equality active="false"/>'
        '<site euler="1 0.5 0.2"/><default class="slider"><joint type="slide" axis="0 1 1" ref="0.3"/>'
        '<equality active="true"/><default class="tilted"><joint type="hinge" range="-1 2"/></default>'
        "</default></default>",
    ).replace("</worldbody>", '<site name="w" pos="1 2 3"/></worldbody>'),
    "several joints in a body": model(
        f'<body name="a" pos="1 2 3" axisangle="1 1 0 40"><joint name="x" type="slide" axis="1 0 0" ref="0.4"/>'
        f'<joint name="h" axis="0 1 1" pos="0.1 0.2 0.3" ref="30"/><joint name="y" type="slide" axis="0 1 2"/>'
        f'<joint name="s" type="ball" pos="0 0.5 0"/>{BALL}</body>'
        f'<body name="b"><joint name="p" type="ball" pos="0.3 0 0"/>{BALL}</body>',
        equality='<weld body1="a" body2="b"/><connect body1="a" body2="b" anchor="0 1 0"/>',
    ),
    "frames": model(
        f'<frame pos="1 0 0" euler="0 0 90"><frame zaxis="0 1 1"><body name="a" pos="0 1 0"><freejoint name="f"/>'
        f'{BALL}<frame pos="0 0 2"><body name="b" euler="1 2 3"><joint name="j"/>{BALL}</body></frame></body>'
        f"</frame></frame>",
        head='<compiler eulerseq="XzY"/>',
        equality='<connect body1="a" body2="b" anchor="0 0 0"/>',
    ),
    "joints and inertias in frames": model(
        f'<frame pos="0 1 0" euler="90 0 0"><body name="a" pos="1 0 0"><frame pos="0.1 0.2 0" euler="0 0 40">'
        f'<joint name="j" pos="0.3 0 0" axis="1 2 3"/><frame euler="0 50 0"><joint name="k" type="slide" axis="0 1 0"/>'
        f'<inertial pos="0.1 0 0.4" mass="2" diaginertia="0.1 0.2 0.25" euler="10 20 30"/></frame></frame>{BALL}</body>'
        f"</frame>"
        f'<body name="f"><frame pos="1 2 3" euler="0 0 30"><freejoint name="free"/></frame>{BALL}</body>',
        equality='<connect body1="a" body2="f" anchor="0.1 0 0"/>',
    ),
    "copies in copies": model(
        f'<replicate count="3" offset="1 0.1 0" euler="0 10 20" sep="-"><body name="a"><joint name="j" axis="0 1 0"/>'
        f'{BALL}<replicate count="2" offset="0 0 0.5" childclass="c"><body name="b" pos="0.2 0 0"><joint name="k"/>'
        f'{BALL}<site name="s"/></body></replicate></body></replicate>',
        head='<default><default class="c"><joint axis="1 0 0" damping="0.5"/></default></default>',
        equality='<connect body1="a-0" body2="b0-1" anchor="0.1 0 0"/><weld site1="s1-2" site2="s0-0"/>',
    ),
    "more than ten copies": model(
        f'<body name="r"><joint name="h"/>{BALL}<replicate count="11" offset="0 0.1 0"><body name="a">'
        f'<joint name="j" axis="0 1 0"/>{BALL}</body></replicate></body>',
        equality='<connect body1="a00" body2="a10" anchor="0 0 0"/>',
    ),
}
SAMPLES["cassie"] = CASSIE.read_text() if CASSIE.is_file() else ""
HAS_CASSIE = pytest.mark.skipif(not CASSIE.is_file(), reason="the sample of Cassie is not here")
ALL = [pytest.param(name, marks=HAS_CASSIE) if name == "cassie" else name for name in SAMPLES]


def read(text: str) -> MechanismDescription:
    """Read a file given as text."""
    return read_mjcf(text.encode(), None)
