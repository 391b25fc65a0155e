"""MJCF's <replicate>: its copies are written out before anything else is read, as MuJoCo's compiler does."""

from __future__ import annotations

import copy
from collections.abc import Iterator

import numpy as np
from lxml import etree
from scipy.spatial.transform import Rotation

from ccpin.description.elements.xml import ZERO, XmlElement, fail
from ccpin.description.mjcf.defaults import Compiler
from ccpin.description.mjcf.element import Element

MOST = 10_000
"""Elements that all copies of a file may have."""
_REFERRING = ("joint", "jointinparent", "site", "body", "refsite", "cranksite", "slidersite")

_Renamed = dict[tuple[str, str], list[str]]
"""What became of the elements of a kind and a name."""


def expand_replicates(root: XmlElement, compiler: Compiler) -> None:
    """Replace every <replicate>, inner ones first, by its copies in frames, the k-th turned by k times `euler`.

    Names of copies end in `sep` and their number, with leading zeros. An actuator of what was copied is copied too.

    Raises:
        DescriptionError: A count is no whole number, a joint stands directly inside, or there are more than `MOST`
            elements in copies.
    """
    made, renamed = 0, _Renamed()
    for xml in reversed(list(root.iter("replicate"))):
        said = Element.of(xml)
        count = float(said.vector("count", 1)[0])
        if count < 0.0 or count % 1.0:
            raise said.fail(f"count should be a whole number, not {count:g}")
        for child in xml.iterchildren("joint", "freejoint", "inertial"):
            raise fail(child, f"a <{child.tag}> cannot be repeated; put the body into the <replicate>")
        made += int(count * sum(1 for _ in xml.iterdescendants("*")))
        if made > MOST:
            raise said.fail(f"it is repeated into more than {MOST} elements")
        for frame in _copies(said, int(count), compiler, renamed):
            xml.addprevious(frame)
        parent = xml.getparent()
        if parent is None:
            raise said.fail("it stands in no body")
        parent.remove(xml)
    for section in root.iterchildren("actuator") if renamed else ():
        for xml in list(section.iterchildren("*")):
            _repeat(xml, renamed)


def _copies(said: Element, count: int, compiler: Compiler, renamed: _Renamed) -> Iterator[XmlElement]:
    """The frames that stand for a <replicate>."""
    step, euler = said.vector("offset", 3, ZERO), said.vector("euler", 3, ZERO)
    at, digits = np.zeros(3), len(str(max(count - 1, 0)))
    for k in range(count):
        pose = Element(said.xml, {"euler": _written(k * euler)}).orientation(compiler.angles)
        x, y, z, w = Rotation.from_matrix(pose).as_quat()
        here = {"pos": _written(at), "quat": _written((w, x, y, z))}
        if said.text("childclass"):
            here["childclass"] = said.required("childclass")
        frame = etree.Element("frame", here)
        frame.sourceline = said.xml.sourceline
        frame.extend([copy.deepcopy(child) for child in said.xml])
        for each in frame.iterdescendants("*"):
            if name := each.get("name"):
                each.set("name", f"{name}{said.values.get('sep', '')}{k:0{digits}d}")
                renamed.setdefault((_kind(each), name), []).append(each.get("name"))
        yield frame
        at = at + pose @ step


def _repeat(xml: XmlElement, renamed: _Renamed) -> None:
    """One actuator for each copy of what it acts on."""
    for word in _REFERRING:
        kind, name = _REFERRED.get(word, word), xml.get(word)
        copies = list(_ends(kind, name, renamed)) if (kind, name) in renamed else []
        for name_of_copy, name_of_original in ((each, name) for each in copies):
            one = copy.deepcopy(xml)
            one.set(word, name_of_copy)
            if one.get("name"):
                one.set("name", one.get("name") + name_of_copy[len(name_of_original) :])
            xml.addprevious(one)
        if copies:
            xml.getparent().remove(xml)
            return


_REFERRED = {"jointinparent": "joint", "refsite": "site", "cranksite": "site", "slidersite": "site"}


def _ends(kind: str, name: str, renamed: _Renamed) -> Iterator[str]:
    """The names that copies, and copies of copies, have at last."""
    for each in renamed[kind, name]:
        if (kind, each) in renamed:
            yield from _ends(kind, each, renamed)
        else:
            yield each


def _kind(xml: XmlElement) -> str:
    return str(xml.tag).removeprefix("free")


def _written(numbers: object) -> str:
    return " ".join(repr(float(number)) for number in np.asarray(numbers, dtype=np.float64))
