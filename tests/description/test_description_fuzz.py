"""Two thousand damaged descriptions: each loads or is refused with its file and the element at fault, in good time."""

import random

import pytest

import ccpin
from tests.support.damage import VALUES, XML_DAMAGE, complaint, damage_bytes
from tests.support.described import MJCF, TOOLBOX_URDF, TOOLBOX_YAML
from tests.support.places import MODELS

CASES = 400
CHUNKS = 16


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


@pytest.mark.parametrize("chunk", [pytest.param(k, marks=[pytest.mark.slow] * (k > 0)) for k in range(CHUNKS)])
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
