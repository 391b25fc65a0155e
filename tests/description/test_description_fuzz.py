"""Two thousand damaged descriptions: each loads or is refused with its file and the element at fault, in good time."""

import random
import re
import signal
from contextlib import contextmanager

import pytest
from lxml import etree

import ccpin
from ccpin.errors import (
    AmbiguousFormatError,
    CcpinError,
    DescriptionError,
    DescriptionNotFoundError,
    InvalidXmlError,
    NoLoopError,
)
from tests.support.places import MODELS

CASES = 2000
CHUNKS = 20
SECONDS_A_CASE = 5.0

TOOLBOX_URDF = """<robot name="bar">
<link name="base"/>
<link name="crank"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0.2 0 0" rpy="0 0.1 0"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rocker"><inertial><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="end_A"/><link name="end_B"/>
<joint name="motor" type="revolute"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/><dynamics damping="0.1" friction="0.2"/></joint>
<joint name="ball" type="revolute"><origin xyz="0.2 0 0"/><parent link="crank"/><child link="rod"/><axis xyz="0 0 1"/>
  <limit effort="1" velocity="1"/></joint>
<joint name="pivot" type="continuous"><origin xyz="0.4 0 0"/><parent link="base"/><child link="rocker"/>
  <axis xyz="0 0 1"/></joint>
<joint name="end_A_frame" type="fixed"><origin xyz="0.4 0 0"/><parent link="rod"/><child link="end_A"/></joint>
<joint name="end_B_frame" type="fixed"><origin xyz="0.3 0 0.05" rpy="0 0 1"/><parent link="rocker"/>
  <child link="end_B"/></joint>
<transmission name="drive"><type>transmission_interface/SimpleTransmission</type><joint name="motor"/>
  <actuator name="m"><mechanicalReduction>20</mechanicalReduction><rotor_inertia value="1e-5"/></actuator>
</transmission>
<gazebo reference="motor"><springStiffness>2</springStiffness><springReference>0.1</springReference></gazebo>
</robot>"""
TOOLBOX_YAML = """closed_loop: [['end_A', 'end_B']]
type: ['3d']
name_mot: ['motor']
joint_name: ['ball']
joint_type: ['UJOINT_YZ']
"""
MJCF = """<mujoco model="bars">
  <compiler angle="radian" autolimits="true"/>
  <default><default class="bar"><geom type="capsule" size="0.02" density="800"/></default></default>
  <worldbody>
    <body name="crank" pos="0 0 1"><joint name="motor" type="hinge" axis="0 1 0" range="-3 3" armature="0.01"
        damping="0.1" stiffness="2" springref="0.3" frictionloss="0.2"/>
      <geom class="bar" fromto="0 0 0 0.2 0 0"/>
      <body name="rod" pos="0.2 0 0"><joint name="elbow" type="ball"/>
        <geom class="bar" fromto="0 0 0 0.3 0.1 0"/></body>
    </body>
    <body name="rocker" pos="0.5 0.1 1"><joint name="pivot" axis="0 1 0"/>
      <inertial pos="0 0 0.1" mass="0.4" diaginertia="0.01 0.01 0.002"/>
      <geom class="bar" fromto="0 0 0 0 0 0.3"/></body>
    <body name="wheel" pos="0 1 0"><joint name="gear" axis="0 1 0"/><geom type="cylinder" size="0.1 0.02"/></body>
  </worldbody>
  <equality>
    <connect name="tip" body1="rod" body2="rocker" anchor="0.3 0.1 0"/>
    <joint name="mesh" joint1="gear" joint2="motor" polycoef="0 2 0 0 0"/>
  </equality>
  <actuator><motor joint="motor" gear="20" ctrlrange="-2 2" forcerange="-3 3"/>
    <position name="servo" joint="pivot" kp="20" kv="1"/><general joint="gear" gainprm="3" biastype="affine"/>
  </actuator>
</mujoco>"""

VALUES = (
    *("", " ", "0", "-1", "nan", "inf", "-inf", "1e308", "1e400", "-1e-320", "0 0 0", "1 2", "1 2 3 4", "abc"),
    *(
        "true",
        "false",
        "0x10",
        "1,2,3",
        "base",
        "world",
        "universe",
        "root_joint",
        "link1",
        "joint1",
        "../../etc/passwd",
    ),
    *("package://", "file:///dev/zero", "/dev/zero", "é\u202e名", "a" * 5000, "1e9 1e9 1e9", "' or 1", "{}", "%s%n"),
    *("revolute", "floating", "planar", "spherical", "prismatic", "fixed", "free", "slide", "ball", "continuous"),
)
TAGS = (
    *("link", "joint", "robot", "inertial", "mass", "inertia", "origin", "axis", "limit", "loop", "coupling", "mimic"),
    *("parent", "child", "visual", "geometry", "mesh", "ratio", "transmission", "group_state", "loop_joint"),
    *("body", "geom", "connect", "weld", "freejoint", "include", "default", "worldbody", "equality", "mujoco"),
    *(
        "dynamics",
        "gazebo",
        "springStiffness",
        "mechanicalReduction",
        "actuator",
        "motor",
        "position",
        "general",
        "flag",
    ),
)
LAUGHS = (
    '<!DOCTYPE lolz [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY {n} "{10 * f"&{p};"}">' for p, n in zip("abcdefgh", "bcdefghi", strict=True))
    + "]>"
)
EXTERNAL = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'


class TooSlow(BaseException):
    """Raised in the middle of a case that takes too long."""


@contextmanager
def time_limit():
    """Interrupt the block after so many seconds of the processor (of the clock, tenfold), whatever it is doing."""

    def stop(signum, frame):
        raise TooSlow

    timers = (
        (signal.SIGVTALRM, signal.ITIMER_VIRTUAL, SECONDS_A_CASE),
        (signal.SIGALRM, signal.ITIMER_REAL, 10 * SECONDS_A_CASE),
    )
    previous = [signal.signal(number, stop) for number, _, _ in timers]
    for _, timer, seconds in timers:
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(timers, previous, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


def damage_bytes(text, rng):
    """Damage that knows nothing of the format."""
    at = rng.randrange(len(text))
    span = rng.randrange(1, 200)
    junk = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 12)))
    return rng.choice(
        (
            lambda: text[:at],
            lambda: text[at:],
            lambda: text[:at] + junk + text[at:],
            lambda: text[:at] + junk + text[at + len(junk) :],
            lambda: text[:at] + text[at + span :],
            lambda: text[:at] + text[at : at + span] * 3 + text[at + span :],
            lambda: text[:at] + b"\0" + text[at:],
            lambda: text + text,
            lambda: text.decode().encode("utf-16"),
            lambda: b"\xef\xbb\xbf" + text,
            lambda: junk * 50,
            lambda: b"",
        )
    )()


def damage_digits(text, rng):
    """Another number in place of one of the numbers."""
    places = [i for i, c in enumerate(text) if chr(c).isdigit()]
    at = rng.choice(places)
    return text[:at] + rng.choice((b"9", b"0", b"-", b"e9", b".", b"99999999999", b"nan")) + text[at + 1 :]


def with_entities(text, rng):
    """Entities that grow without bound, or read files, in a document type declaration."""
    declaration, entity = rng.choice(((LAUGHS, "&i;"), (EXTERNAL, "&a;")))
    body = text.decode().partition("?>")[2] if text.startswith(b"<?xml") else text.decode()
    used = body.replace(">", f">{entity}", 3) if rng.random() < 0.5 else body.replace('="', f'="{entity}', 3)
    return (declaration + used).encode()


def nested(text, rng):
    """An element inside itself a few hundred or a hundred thousand times."""
    tag, depth = rng.choice(TAGS), rng.choice((200, 300, 5000, 100_000))
    at = text.rfind(b"</")
    return text[:at] + f'<{tag} name="n">'.encode() * depth + f"</{tag}>".encode() * depth + text[at:]


def damage_xml(text, rng):
    """Damage to one or two elements: deleted, doubled, renamed, moved, emptied, or with hostile values."""
    root = etree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2))):
        element = rng.choice([e for e in root.iter() if isinstance(e.tag, str)])
        _damage_element(root, element, rng)
    return etree.tostring(root)


def _damage_element(root, element, rng):
    parent = element.getparent()
    action = rng.choice(
        ("value", "value", "value", "delete", "double", "tag", "move", "drop", "attribute", "swap", "clear")
    )
    keys = [key for key in element.attrib if not key.startswith("{")]
    if action == "value" and keys:
        element.set(rng.choice(keys), rng.choice(VALUES))
    elif action == "drop" and keys:
        del element.attrib[rng.choice(keys)]
    elif action == "attribute":
        element.set(
            rng.choice(("name", "type", "link", "value", "xyz", "rpy", "independent", "pos")), rng.choice(VALUES)
        )
    elif action == "tag":
        element.tag = rng.choice(TAGS)
    elif action == "clear":
        element.clear()
    elif parent is None:
        return
    elif action == "delete":
        parent.remove(element)
    elif action == "double":
        parent.insert(0, etree.fromstring(etree.tostring(element)))
    elif action == "move":
        rng.choice([e for e in root.iter() if e is not element and element not in e.iterancestors()]).append(element)
    elif action == "swap":
        names = [e for e in root.iter() if isinstance(e.tag, str) and e.get("name") is not None]
        a, b = rng.choice(names), rng.choice(names)
        a_name, b_name = a.get("name"), b.get("name")
        a.set("name", b_name)
        b.set("name", a_name)


def damage_yaml(text, rng):
    """Another word, list or construct in place of one of the YAML's."""
    words = ("end_A", "end_B", "3d", "motor", "ball", "UJOINT_YZ", "closed_loop", "type", "name_mot", "joint_name")
    new = rng.choice(
        (
            *VALUES[:40],
            "[]",
            "[[",
            "{a: b}",
            "&x [*x]",
            "*x",
            "!!python/object:os.system",
            "~",
            "2001-99-99",
            "[" * 5000,
        )
    )
    return text.replace(rng.choice(words).encode(), new.encode(), 1)


XML_DAMAGE = (damage_xml,) * 8 + (damage_digits, damage_bytes, damage_bytes, with_entities, nested)
YAML_DAMAGE = (damage_yaml, damage_yaml, damage_bytes)
SOURCES = (
    "rpdr",
    "four_bar",
    "toolbox",
    "mjcf",
    "slider_crank",
    "toolbox_urdf",
    "mjcf",
    "bennett",
    "planar_3rrr",
    "rpdr",
)


def write_case(number, folder):
    """Write the damaged description of that number; returns the file to load."""
    rng = random.Random(number)
    name = SOURCES[number % len(SOURCES)]
    if name.startswith("toolbox"):
        yaml, urdf = TOOLBOX_YAML.encode(), TOOLBOX_URDF.encode()
        if name == "toolbox":
            yaml = rng.choice(YAML_DAMAGE)(yaml, rng)
        else:
            urdf = rng.choice(XML_DAMAGE)(urdf, rng)
        (folder / "robot.urdf").write_bytes(urdf)
        file = folder / "robot.yaml"
        file.write_bytes(yaml)
        return file
    text = MJCF.encode() if name == "mjcf" else (MODELS / f"{name}.urdf").read_bytes()
    file = folder / f"{name}.xml"
    file.write_bytes(rng.choice(XML_DAMAGE)(text, rng))
    return file


def names_in(file):
    """Every name the file states, and those of the URDF beside a YAML."""
    text = "".join(each.read_text(errors="replace") for each in file.parent.iterdir())
    return {name for name in re.findall(r"""name=["']([^"']+)["']""", text) if name.strip()}


def unnamed(error, file):
    """What the message of a refusal leaves out, or ``None``: it names the file and the place, or a name in it."""
    message = str(error)
    if isinstance(error, DescriptionError) and str(file.parent) not in message:
        return "its file"
    if isinstance(error, (InvalidXmlError, AmbiguousFormatError, NoLoopError, DescriptionNotFoundError)):
        return None if len(message) > len(str(file)) + 10 else "the reason"
    if isinstance(error, DescriptionError):
        return None if error.element or "no link" in message or "no body" in message else "the element"
    return None if any(name in message for name in names_in(file)) else "any joint or loop"


def complaint(file):
    """What is wrong with how ccpin takes the file, or ``None``."""
    try:
        with time_limit():
            ccpin.load(file)
    except CcpinError as error:
        lacking = unnamed(error, file)
        return None if lacking is None else f"{type(error).__name__} without {lacking}: {error}"
    except TooSlow:
        return f"took more than {SECONDS_A_CASE} s of the processor"
    except Exception as error:
        return f"leaked {type(error).__name__}: {error}"
    return None


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_a_damaged_description_loads_or_is_refused_by_name(chunk, tmp_path, capfd):
    """No case crashes, hangs, leaks a foreign exception, or prints; a refusal names the file and more."""
    failures = []
    for number in range(chunk, CASES, CHUNKS):
        folder = tmp_path / str(number)
        folder.mkdir()
        found = complaint(write_case(number, folder))
        if found is not None:
            failures.append(f"case {number} ({SOURCES[number % len(SOURCES)]}): {found[:300]}")
    printed = capfd.readouterr()
    assert not failures, "\n".join(failures)
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.parametrize("name", sorted(set(SOURCES)))
def test_the_undamaged_originals_load(name, tmp_path):
    """The damage is what is refused: every original loads."""
    (tmp_path / "robot.urdf").write_text(TOOLBOX_URDF)
    (tmp_path / "robot.yaml").write_text(TOOLBOX_YAML)
    (tmp_path / "mjcf.xml").write_text(MJCF)
    file = {"mjcf": tmp_path / "mjcf.xml"}.get(
        name, tmp_path if name.startswith("toolbox") else MODELS / f"{name}.urdf"
    )
    assert ccpin.load(file).n >= 1
