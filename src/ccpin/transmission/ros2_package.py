"""`export_ros2`: a transmission as a package of ROS 2: a plugin of ros2_control made of exported C, and its test."""

from __future__ import annotations

import re
from email.utils import parseaddr
from importlib.resources import files
from itertools import product
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, corners, instance, whole
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.files import writable_folder, write_text
from ccpin.programs.c_code import identifier
from ccpin.programs.c_export import header
from ccpin.programs.program import Program
from ccpin.programs.sine_cosine import DOUBLE
from ccpin.transmission.posture import Posture
from ccpin.transmission.transmission import Given, Transmission

_TESTED, _STEP = 24, 0.05  # postures of the package's test, and how far apart they are at most, rad or m
_GRID, _WIDER = 9, 0.02  # postures along each axis of a region, and by how much motors' box is wider than their image
_SIDES: tuple[Given, ...] = ("joints", "motors")
_LONGEST = 32  # letters of a name
_PLACES = {
    "CMakeLists.txt": "CMakeLists.txt",
    "package.xml": "package.xml",
    "plugin.xml": "@NAME@.xml",
    "robot.xml": "robot.xml",
    "linkage_transmission.hpp": "include/@NAME@/linkage_transmission.hpp",
    "linkage_transmission.cpp": "src/linkage_transmission.cpp",
    "loader.cpp": "src/loader.cpp",
    "test_transmission.cpp": "test/test_transmission.cpp",
}  # of the texts beside this module


def export_ros2(
    transmission: Transmission,
    folder: str | Path,
    *,
    maintainer: str,
    license: str = "Proprietary",
    name: str | None = None,
    region: tuple[ArrayLike, ArrayLike] | None = None,
    max_cells: int = 4096,
) -> tuple[Path, ...]:
    """Write a transmission as a package of ROS 2 (Jazzy): `transmission_interface::Transmission`, its loader, a test.

    The plugin follows σ from the last state both ways. What it cannot compute it refuses: handles keep their last
    values, and the status goes to a joint handle `status`. Where ROS 2 is missing the package builds against
    declarations of its own, so that it can be tested, not loaded.

    Args:
        transmission: The transmission.
        folder: The package's folder, which is made where it is absent.
        maintainer: Of the package, as package.xml has to have one: ``"Ada Lovelace <ada@lab.org>"``.
        license: Of the package, as SPDX names it; default all rights reserved.
        name: Of package, library and namespace: small letters, digits and single _; default of the mechanism's.
        region: Lower and upper q_j, of shape (n,) each, outside of which it refuses; what it does inside is proved (the
            extra `validated`), of the motors over the box around the region's image. Default: nothing is proved.
        max_cells: Into how many cells each side's box is cut at most.

    Returns:
        The files.

    Raises:
        InvalidInputError: A maintainer, name or region that is none, motors that are the joints.
        CcpinError: What was to be proved of the region could not be, or it does not hold the reference.
    """
    instance(transmission, "transmission", Transmission)
    whole(max_cells, "max_cells")
    title = transmission.joint_model.mechanism.name
    called = _package_name(re.sub("_+", "_", identifier(title).lower())[:_LONGEST] if name is None else name)
    words = {"NAME": called, "TITLE": _one_line(title), "TITLE_XML": escape(_one_line(title))}
    words |= _people(maintainer, license)
    box = None if region is None else corners(region, "region", transmission.n)
    programs: dict[Given, Program] = {given: transmission.program(given, steps=3) for given in _SIDES}
    if box is not None:
        programs = _proved(transmission, programs, *box, max_cells)
    words |= _sides(transmission) | _starts(programs) | _tested(transmission, programs["joints"])
    texts = {file: _filled(_texts() / text, words) for text, file in _PLACES.items()}
    declared = _texts() / "declared"
    texts |= {f"declared/{room.name}/{file.name}": file.read_text(encoding="utf-8")
              for room in declared.iterdir() for file in room.iterdir() if file.name.endswith(".hpp")}  # fmt: skip
    for given, program in programs.items():
        texts[f"include/@NAME@/@NAME@_{given}.h"] = header(program, f"{called}_{given}", DOUBLE)
    into, paths = writable_folder(folder, "folder"), list[Path]()
    for file, text in texts.items():
        path = into / file.replace("@NAME@", called)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
        paths.append(path)
    return tuple(paths)


def _texts() -> Path:
    return Path(str(files("ccpin.transmission"))) / "ros2"


def _filled(text: Path, words: dict[str, str]) -> str:
    return re.sub(r"@([A-Z_]+)@", lambda found: words[found[1]], text.read_text(encoding="utf-8"))


def _package_name(name: str) -> str:
    """A name that ROS 2 takes for a package, and C++ for a namespace.

    Raises:
        InvalidInputError: It is none.
    """
    if not isinstance(name, str) or not re.fullmatch(rf"[a-z](_?[a-z0-9]){{1,{_LONGEST - 1}}}", name):
        raise InvalidInputError(f"name must be a package's: small letters, digits and single _; it is {name!r}")
    return name


def _people(maintainer: str, license: str) -> dict[str, str]:
    """Who maintains a package, and on what terms.

    Raises:
        InvalidInputError: No name with an address, or no licence.
    """
    name, address = map(_one_line, parseaddr(instance(maintainer, "maintainer", str)))
    if not name or not re.fullmatch(r"[^@\s]+@[^@\s]+", address):
        wanted = "a name and an address, as 'Ada Lovelace <ada@lab.org>'"
        raise InvalidInputError(f"maintainer must be {wanted}; it is {maintainer!r}")
    terms = _one_line(instance(license, "license", str)).strip()
    if not terms:
        raise InvalidInputError("license must be the name of one")
    return {"MAINTAINER_XML": escape(name), "EMAIL_XML": quoteattr(address), "LICENSE_XML": escape(terms)}


def _one_line(text: str) -> str:
    return "".join(letter if letter.isprintable() and letter != "\\" else "?" for letter in text)


def _sides(transmission: Transmission) -> dict[str, str]:
    """Names of both sides, and the elements of a robot description."""
    found, elements = dict[str, str](), list[str]()
    for side, names in (("JOINTS", transmission.joints), ("MOTORS", transmission.motors)):
        plain = [_one_line(name).replace('"', "?") for name in names]
        found |= {side: ", ".join(f'"{name}"' for name in plain), f"{side}_XML": escape(", ".join(plain))}
        kind, inner = "joint" if side == "JOINTS" else "actuator", "<mechanical_reduction>1</mechanical_reduction>"
        elements += [f"  <{kind} name={quoteattr(one)} role={quoteattr(one)}>{inner}</{kind}>" for one in plain]
    return found | {"N": str(transmission.n), "ELEMENTS": "\n".join(elements)}


def _starts(programs: dict[Given, Program]) -> dict[str, str]:
    """Where each map begins."""
    found = dict[str, str]()
    for given, program in programs.items():
        n, side = program.inputs[0].size, given.upper()
        found |= {f"Q_{side}": _row(program.example[:n]), f"Y_{side}": _row(program.example[n:])}
        found[f"N_Y_{side}"] = str(program.inputs[1].size)
    return found


def _tested(transmission: Transmission, by_joints: Program) -> dict[str, str]:
    """Postures along a way from the reference, by the package, not by the programs."""
    n, rng, rows = transmission.n, np.random.default_rng(0), list[str]()
    posture = transmission.reference
    for _ in range(100 * _TESTED):
        q = posture.q_joint + _STEP * rng.uniform(-1.0, 1.0, n)
        if by_joints.region is not None:
            q = np.clip(q, by_joints.region.lower[:n], by_joints.region.upper[:n])
        try:
            posture = transmission.at(q, posture)
            v, effort = rng.uniform(-1.0, 1.0, (2, n))
            sides = posture.q_motor, v, effort, posture.q_joint, posture.joint_velocity(v), posture.joint_effort(effort)
        except CcpinError:
            continue
        rows.append(f"  {{{_row(np.concatenate(sides))}}}")
        if len(rows) == _TESTED:
            break
    return {"STATES": str(len(rows)), "TABLE": ",\n".join(rows)}


def _row(numbers: ArrayLike) -> str:
    return ", ".join(map(repr, np.asarray(numbers, dtype=np.float64).tolist()))


def _proved(
    transmission: Transmission, programs: dict[Given, Program], lower: Array, upper: Array, max_cells: int
) -> dict[Given, Program]:
    """The programs, which refuse all outside of the region.

    Raises:
        CcpinError: That could not be proved.
    """
    from ccpin.validated.programs.certifying import certify_program  # with python-flint

    n, boxes = transmission.n, dict[Given, tuple[Array, Array]]({"joints": (lower, upper)})
    image = np.array([posture.q_motor for posture in _grid(transmission, lower, upper)])
    least, most = image.min(axis=0), image.max(axis=0)
    boxes["motors"] = least - _WIDER * (most - least), most + _WIDER * (most - least)
    found = dict[Given, Program]()
    for given, program in programs.items():
        begin = np.array(program.example[:n])
        if not ((boxes[given][0] <= begin) & (begin <= boxes[given][1])).all():
            raise InvalidInputError(
                f"region must hold the reference, where the plugin begins: {transmission.reference!r}"
            )
        made = certify_program(program, boxes[given], bounds={}, formats=("double",), max_cells=max_cells)
        if made.verdict != "proven":
            raise CcpinError(f"from the {given}, over {boxes[given][0]} … {boxes[given][1]}: {made.reason}")
        found[given] = made.guarded()
    return found


def _grid(transmission: Transmission, lower: Array, upper: Array) -> list[Posture]:
    return [transmission.at(q) for q in product(*np.linspace(lower, upper, _GRID).T.tolist())]
