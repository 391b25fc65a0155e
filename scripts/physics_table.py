"""What each reader does with each piece of physics: writes the table of docs/physics.md.

Every cell is found out by reading two files that differ in the one thing: the description changes (read), only its
notes do (noted), or the file is refused. A cell in which nothing changes would be physics lost without a word.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ccpin import MechanismDescription
from ccpin.description import read_description
from ccpin.errors import DescriptionError

PAGE = Path(__file__).resolve().parents[1] / "docs" / "physics.md"
BEGIN, END = "<!-- table: scripts/physics_table.py -->\n", "<!-- end of table -->\n"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
YAML = "closed_loop: [[a, b]]\ntype: [3d]\nname_mot: [j]\n"

URDF = """<robot name="r" xmlns:drake="d"><link name="base"/>
<link name="a">{link}</link><link name="b">{inertial}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><limit {limit}/>{joint}</joint>
<joint name="k" type="revolute"><parent link="base"/><child link="b"/>
<limit effort="9" velocity="9" lower="-2" upper="2"/></joint>{root}</robot>"""
MJCF = """<mujoco>{head}<worldbody>
<body name="a" {body}><joint name="j" {joint}/><geom size="0.1" pos="0 0 1" {geom}/></body>
<body name="b"><joint name="k"/><geom size="0.1" pos="0 0 1"/>
<body name="c"><joint name="ball" type="ball" {ball}/><geom size="0.1" pos="0 0 1"/></body></body>
<body name="f"><joint name="free" type="free" {free}/><geom size="0.1"/></body>
</worldbody><equality><joint joint1="j" joint2="k" {equality}/></equality>
<actuator><motor name="m" joint="k" {motor}/>{actuator}</actuator>{tail}</mujoco>"""
SDF = """<sdf version="1.9"><world name="w">{world}<model name="m">
<link name="a">{link}{inside}</link><link name="b">{inertial}</link>
<joint name="j" type="revolute"><parent>world</parent><child>a</child>
<axis><xyz>0 0 1</xyz><limit>{limit}</limit>{joint}</axis>{beside}</joint>
<joint name="k" type="revolute"><parent>world</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint>{root}
</model></world></sdf>"""
HEAVY = "<inertial><mass>1</mass></inertial>"
SLOTS = {
    "SDF": {"link": HEAVY, "inertial": HEAVY}
    | dict.fromkeys(["world", "inside", "limit", "joint", "beside", "root"], ""),
    "URDF": {"link": INERTIAL, "inertial": INERTIAL, "limit": "", "joint": "", "root": ""},
    "MJCF": dict.fromkeys(
        ["head", "body", "joint", "geom", "ball", "free", "equality", "motor", "actuator", "tail"], ""
    ),
}


def transmission(inside: str, kind: str = "SimpleTransmission") -> str:
    """A URDF's transmission that drives joint j."""
    driven = f'<joint name="j"/><actuator name="m">{inside}</actuator>'
    return f'<transmission name="t"><type>{kind}</type>{driven}</transmission>'


def bounds(**changed: str) -> str:
    """A URDF's limits with some changed."""
    return " ".join(f'{key}="{value}"' for key, value in {"effort": 9, "velocity": 9, **changed}.items())


class Element(NamedTuple):
    """A piece of physics: what it is, and (slot, text) that states it in a URDF, an MJCF and an SDFormat file."""

    name: str
    urdf: tuple[str, str] | None
    mjcf: tuple[str, str] | None
    sdf: tuple[str, str] | None = None


def dynamics(word: str) -> tuple[str, str]:
    """SDFormat's <dynamics> with one thing in it."""
    return "joint", f"<dynamics><{word}>1</{word}></dynamics>"


ELEMENTS = (
    Element(
        "mass, centre, inertia",
        ("link", INERTIAL.replace('value="1"', 'value="2"')),
        ("geom", 'mass="3"'),
        ("link", "<inertial><mass>2</mass></inertial>"),
    ),
    Element("gravity", None, ("head", '<option gravity="1 2 3"/>'), ("world", "<gravity>1 2 3</gravity>")),
    Element("gravity compensation of a body", None, ("body", 'gravcomp="1"')),
    Element(
        "position limits",
        ("limit", bounds(lower="-1", upper="1")),
        ("joint", 'range="-1 1"'),
        ("limit", "<lower>-1</lower><upper>1</upper>"),
    ),
    Element("cone of a ball joint", None, ("ball", 'range="0 1"')),
    Element("limit of velocity", ("limit", bounds(velocity="3")), None, ("limit", "<velocity>3</velocity>")),
    Element(
        "limit of effort",
        ("limit", bounds(effort="3")),
        ("joint", 'actuatorfrcrange="-1 1"'),
        ("limit", "<effort>3</effort>"),
    ),
    Element("soft limits", ("joint", '<safety_controller k_velocity="1" soft_upper_limit="1"/>'), None),
    Element("damping", ("joint", '<dynamics damping="1"/>'), ("joint", 'damping="1"'), dynamics("damping")),
    Element("gravity of one link switched off", None, None, ("inside", "<gravity>0</gravity>")),
    Element(
        "decay of a link's velocity", None, None, ("inside", "<velocity_decay><linear>1</linear></velocity_decay>")
    ),
    Element("damping of a ball joint", None, ("ball", 'damping="1"')),
    Element("nonlinear damping", None, ("joint", 'damping="0 1"')),
    Element("dry friction", ("joint", '<dynamics friction="1"/>'), ("joint", 'frictionloss="1"'), dynamics("friction")),
    Element(
        "Stribeck's friction", ("joint", '<dynamics friction="1" breakaway="2" stribeck_speed="0.1"/>'), None, None
    ),
    Element(
        "spring",
        ("root", '<gazebo reference="j"><springStiffness>1</springStiffness></gazebo>'),
        ("joint", 'stiffness="1" springref="20"'),
        dynamics("spring_stiffness"),
    ),
    Element("spring of a ball joint", None, ("ball", 'stiffness="1"')),
    Element("damping of a free joint", None, ("free", 'damping="1"')),
    Element("rotor inertia of a free joint", None, ("free", 'armature="1"')),
    Element("spring of a free joint", None, ("free", 'stiffness="1"')),
    Element("nonlinear spring", None, ("joint", 'stiffness="0 1"')),
    Element("spring and damper by their period", None, ("joint", 'springdamper="1 1"')),
    Element("forces switched off by a flag", None, ("head", '<option><flag actuation="disable"/></option>')),
    Element("bushing", ("root", '<drake:linear_bushing_rpy name="x"/>'), None, ("root", "<drake:linear_bushing_rpy/>")),
    Element(
        "rotor inertia",
        ("root", transmission('<drake:rotor_inertia value="1"/>')),
        ("joint", 'armature="1"'),
        ("beside", '<drake:rotor_inertia xmlns:drake="drake.mit.edu">1</drake:rotor_inertia>'),
    ),
    Element("rotor inertia and damping of an actuator", None, ("motor", 'armature="1" damping="2"')),
    Element(
        "motor",
        ("root", transmission("")),
        ("actuator", '<motor joint="j"/>'),
        ("root", '<plugin name="p" filename="f"><joint_name>j</joint_name></plugin>'),
    ),
    Element("gear", ("root", transmission("<mechanicalReduction>5</mechanicalReduction>")), ("motor", 'gear="5"')),
    Element("gear of a ball joint's motor", None, ("actuator", '<motor joint="ball" gear="0 1 0"/>')),
    Element("bounds of a motor", None, ("motor", 'ctrlrange="-1 1" forcerange="-2 2"')),
    Element("differential transmission", ("root", transmission("", "DifferentialTransmission")), None),
    Element("second motor of a joint", ("root", transmission("") * 2), ("actuator", '<velocity joint="k"/>')),
    Element("servo: position", None, ("actuator", '<position joint="j" kp="5" kv="1"/>')),
    Element("servo: velocity", None, ("actuator", '<velocity joint="j" kv="5"/>')),
    Element("actuator: general", None, ("actuator", '<general joint="j" gainprm="5" biastype="affine" biasprm="1"/>')),
    Element("actuator with a state", None, ("actuator", '<intvelocity joint="j" kp="5" actrange="-1 1"/>')),
    Element("actuator of a body or a site", None, ("actuator", '<adhesion body="a" ctrlrange="0 1"/>')),
    Element(
        "tendons",
        None,
        ("tail", '<tendon><fixed stiffness="1"><joint joint="j" coef="1"/></fixed></tendon>'),
    ),
    Element(
        "softness of constraints",
        None,
        ("equality", 'solref="0.1 1"'),
        ("beside", "<physics><ode><cfm>0.1</cfm></ode></physics>"),
    ),
    Element("contacts, as a section", None, ("tail", '<contact><exclude body1="a" body2="b"/></contact>')),
    Element("fluid", None, ("head", '<option density="1.2" viscosity="2"/>')),
    Element(
        "unknown attribute of an element",
        ("joint", '<dynamics dampin="1"/>'),
        ("joint", 'dampin="1"'),
        dynamics("dampin"),
    ),
)


def urdf(text: str, folder: Path) -> MechanismDescription:
    """Read a URDF."""
    (folder / "one.urdf").write_text(text)
    return read_description(folder / "one.urdf")


def toolbox(text: str, folder: Path) -> MechanismDescription:
    """Read the URDF through a robot.yaml beside it."""
    (folder / "one.urdf").write_text(text)
    (folder / "robot.yaml").write_text(YAML)
    return read_description(folder / "robot.yaml")


def mjcf(text: str, folder: Path) -> MechanismDescription:
    """Read an MJCF file."""
    (folder / "one.xml").write_text(text)
    return read_description(folder / "one.xml")


def sdf(text: str, folder: Path) -> MechanismDescription:
    """Read an SDFormat file."""
    (folder / "one.sdf").write_text(text)
    return read_description(folder / "one.sdf")


FORMATS: dict[str, tuple[str, Callable[[str, Path], MechanismDescription]]] = {
    "URDF": ("URDF", urdf),
    "URDF with robot.yaml": ("URDF", toolbox),
    "MJCF": ("MJCF", mjcf),
    "SDFormat": ("SDF", sdf),
}


def verdict(element: Element, name: str, folder: Path) -> str:
    """What a reader does with an element: read, read and noted, noted, refused; – where the format cannot state it."""
    language, read = FORMATS[name]
    stated = {"URDF": element.urdf, "MJCF": element.mjcf, "SDF": element.sdf}[language]
    if stated is None:
        return "–"
    slot, text = stated
    template, slots = {"URDF": URDF, "MJCF": MJCF, "SDF": SDF}[language], SLOTS[language]
    before = read(template.format(**slots), folder)
    try:
        after = read(template.format(**slots | {slot: text}), folder)
    except DescriptionError:
        return "refused"
    told = "noted" if set(after.notes) - set(before.notes) else ""
    fields = set(before.__dataclass_fields__) - {"notes", "source"}
    changed = any(repr(vars_of(getattr(after, f))) != repr(vars_of(getattr(before, f))) for f in fields)
    return ", ".join(word for word in ("read" if changed else "", told) if word) or "LOST"


def vars_of(value: object) -> object:
    """A record's numbers, however deep, for comparing."""
    if isinstance(value, tuple):
        return [vars_of(item) for item in value]
    return {key: vars_of(item) for key, item in vars(value).items()} if hasattr(value, "__dict__") else value


def table() -> str:
    """The table in Markdown."""
    lines = [f"| | {' | '.join(FORMATS)} |", "|---|" + "---|" * len(FORMATS)]
    with TemporaryDirectory() as folder:
        for element in ELEMENTS:
            cells = [verdict(element, name, Path(folder)) for name in FORMATS]
            lines.append(f"| {element.name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(page: Path = PAGE) -> None:
    """Write the table between its marks."""
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    page.write_text(before + BEGIN + table() + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
