"""XML parsed safely, attributes read with errors that name the element, and documents written."""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from lxml import etree

from ccpin.arrays import Array
from ccpin.description.model import IDENTITY, MechanismDescription, frame_from_rpy
from ccpin.description.names import meant
from ccpin.errors import DescriptionError, InvalidXmlError
from ccpin.files import write_atomically

XmlElement: TypeAlias = Any  # lxml's etree._Element, which has no type stubs
Colour: TypeAlias = tuple[float, float, float, float]
ZERO = (0.0, 0.0, 0.0)  # xyz and rpy where an element states none
MAX_BYTES = 32 * 1024 * 1024  # 32 MiB: bounds what a file makes the parser hold
TRUTH = {"true": True, "1": True, "false": False, "0": False}


def parse_xml(text: bytes, source: str | None) -> XmlElement:
    """Parse bytes into an element tree without expanding entities, reading files or using the network.

    Prefixes that the root does not declare (often ``drake:``) are declared on the fly. The tree remembers its
    source, which `fail` puts into messages.

    Raises:
        InvalidXmlError: Not well-formed, a document type declaration (entities), or larger than 32 MiB.
    """
    if len(text) > MAX_BYTES:
        raise InvalidXmlError(f"the file is larger than {MAX_BYTES} bytes", source=source)
    try:
        return _parse(text, source)
    except etree.XMLSyntaxError as error:
        with contextlib.suppress(etree.XMLSyntaxError):
            return _parse(_declare_prefixes(text), source)
        raise InvalidXmlError(f"not well-formed XML: {error.msg}", source=source) from None


def _parse(text: bytes, source: str | None) -> XmlElement:
    safe = {"resolve_entities": False, "no_network": True, "load_dtd": False, "huge_tree": False}
    parser = etree.XMLParser(**safe, remove_comments=True, remove_pis=True)
    root = etree.fromstring(text, parser, base_url=source)
    if root is None:
        raise InvalidXmlError("the file is empty", source=source)
    document = root.getroottree().docinfo
    if document.internalDTD is not None or document.doctype:
        message = "a document type declaration (<!DOCTYPE …>) is refused: entities are never expanded"
        raise InvalidXmlError(message, source=source)
    for element in root.iter("{*}*"):  # a default namespace says nothing: drop it
        if element.prefix is None and element.tag.startswith("{"):
            element.tag = tag(element)
    return root


def _declare_prefixes(text: bytes) -> bytes:
    used = set(re.findall(rb"</?\s*([A-Za-z_][\w.-]*):[A-Za-z_]", text)) | set(
        re.findall(rb"\s([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*\s*=", text)
    )
    missing = {p for p in used if p not in (b"xml", b"xmlns") and b"xmlns:" + p not in text}
    declarations = b"".join(b' xmlns:%s="urn:%s"' % (p, p) for p in sorted(missing))
    return re.sub(rb"<([A-Za-z_][\w.-]*)", lambda m: m.group(0) + declarations, text, count=1)


def source_of(element: XmlElement) -> str | None:
    """The file an element was read from, as given to `parse_xml`."""
    source: str | None = element.getroottree().docinfo.URL
    return source


def fail(element: XmlElement, message: str) -> DescriptionError:
    """The error that blames an element of a file."""
    return DescriptionError(message, source=source_of(element), element=label(element))


def label(element: XmlElement) -> str:
    """Name an element as a reader would look for it: ``mass of link 'arm'``, with its line if it has twins."""
    own = tag(element)
    name = element.get("name")
    if name is not None:
        return f"{own} {name!r}"
    line = f" (line {element.sourceline})" if element.sourceline else ""
    for ancestor in element.iterancestors():
        if ancestor.get("name") is not None and ancestor.getparent() is not None:
            twins = element.getparent().findall(element.tag)
            return f"{own} of {tag(ancestor)} {ancestor.get('name')!r}{line if len(twins) > 1 else ''}"
    return own + line


def tag(element: XmlElement) -> str:
    """The element's tag without its namespace."""
    return str(etree.QName(element).localname)


def children(element: XmlElement, *names: str) -> Iterator[XmlElement]:
    """Child elements with one of those local names, whatever their namespace."""
    found: Iterator[XmlElement] = element.iterchildren(*map("{{*}}{}".format, names))
    return found


def child(element: XmlElement, name: str) -> XmlElement:
    """The first child of that local name.

    Raises:
        DescriptionError: It is absent.
    """
    found = next(element.iterchildren("{*}" + name), None)
    if found is None:
        raise fail(element, f"<{name}> is missing")
    return found


def spelt(element: XmlElement, word: str, known: Iterable[str]) -> bool:
    """Whether a tag or an attribute of an element is a known one.

    Raises:
        DescriptionError: It is not, but is so like one that it must be a misspelling.
    """
    expected = tuple(known)
    if word in expected:
        return True
    near = meant(word, expected)
    if near:
        raise fail(element, f"'{word}' does not exist here; did you mean '{near}'?")
    return False


def strange_attributes(element: XmlElement, known: Collection[str]) -> list[str]:
    """The attributes of an element that are not known, those with a prefix apart: they are others'.

    Raises:
        DescriptionError: One is a misspelling of a known one that the element lacks.
    """
    absent = [name for name in known if name not in element.attrib]
    strange = [name for name in element.attrib if name not in known]
    for name in strange:
        spelt(element, name, absent)
    return [name for name in strange if not name.startswith("{")]


def doubled(root: XmlElement, repeated: Collection[str], others: Collection[str]) -> list[str]:
    """Sentences on elements that stand more than once where one of them is read.

    Args:
        root: Looked through with all in it.
        repeated: Elements that may stand as often as they like, ``parent/child`` where they do in one parent only.
        others: Elements that are not looked into.
    """
    notes, waiting = list[str](), [root]
    while waiting:
        element = waiting.pop()
        inner = [child for child in element.iterchildren("*") if tag(child) not in others]
        for name, count in Counter(map(tag, inner)).items():
            if count > 1 and not {name, f"{tag(element)}/{name}"} & {*repeated}:
                notes.append(f"<{name}> stands {count} times in {label(element)}: one of them is read")
        waiting.extend(reversed(inner))
    return notes


def unread(element: XmlElement, known: Iterable[str]) -> list[str]:
    """The names of child elements that are not among those known.

    Raises:
        DescriptionError: A name is so like a known one that it must be a misspelling.
    """
    expected, strangers = tuple(known), dict[str, None]()
    for other in element.iterchildren("*"):
        if not spelt(other, tag(other), expected):
            strangers[tag(other)] = None
    return list(strangers)


def text_attribute(element: XmlElement, attribute: str) -> str:
    """A required, non-empty text attribute."""
    value = element.get(attribute)
    if value is None or not value.strip():
        raise fail(element, f"attribute '{attribute}' is missing")
    return str(value)


def truth(element: XmlElement, attribute: str) -> bool:
    """A required attribute that is true or false (or 1 or 0), in any letter case."""
    value = text_attribute(element, attribute).strip().lower()
    if value not in TRUTH:
        raise fail(element, f"{attribute}='{element.get(attribute)[:80]}' is neither true nor false")
    return TRUTH[value]


def numeric_attributes(element: XmlElement, counts: Mapping[str, int | None]) -> dict[str, tuple[float, ...]]:
    """Those of the attributes in `counts` that the element has, each of so many finite numbers (``None``: of any).

    Raises:
        DescriptionError: Not numeric, not finite, or of the wrong length.
    """
    found = {}
    for attribute, count in counts.items():
        text = element.get(attribute, "")
        if text.strip():
            found[attribute] = numbers_in(text, count, element, f"{attribute}=")
    return found


def numbers_in(text: str, count: int | None, element: XmlElement, said: str = "") -> tuple[float, ...]:
    """The finite numbers that a text of an element holds, `count` of them (``None``: any number of them).

    Raises:
        DescriptionError: It holds something else; `said` stands before the text.
    """
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        raise fail(element, f"{said}{text[:80]!r} is not numeric") from None
    if count is not None and len(values) != count:
        raise fail(element, f"{said}{text[:80]!r} has {len(values)} numbers where {count} are needed")
    if not all(map(math.isfinite, values)):
        raise fail(element, f"{said}{text[:80]!r} is not finite")
    return values


def numbers(element: XmlElement, attribute: str, count: int | None) -> tuple[float, ...]:
    """A required attribute of `count` finite numbers (``None``: of any number of them).

    Raises:
        DescriptionError: It is absent, not numeric, not finite, or of the wrong length.
    """
    found = numeric_attributes(element, {attribute: count})
    if attribute not in found:
        raise fail(element, f"attribute '{attribute}' is missing")
    return found[attribute]


def number(element: XmlElement, attribute: str) -> float:
    """A required finite number."""
    return numbers(element, attribute, 1)[0]


def origin(element: XmlElement | None) -> Array:
    """The 4×4 transform of an element's ``xyz`` and ``rpy`` attributes; the identity where there is none."""
    if element is None:
        return IDENTITY
    values = numeric_attributes(element, {"xyz": 3, "rpy": 3})
    return frame_from_rpy(values.get("xyz", ZERO), values.get("rpy", ZERO))


def unit_vector(element: XmlElement, attribute: str) -> Array:
    """A non-zero 3-vector attribute, normalised."""
    vector = np.array(numbers(element, attribute, 3))
    length = math.hypot(*vector)
    if not 1e-9 < length < 1e150:
        raise fail(element, f"{attribute} is the zero vector")
    return vector / length


def written(values: object) -> str:
    """A number or numbers with all their digits."""
    return " ".join(map(str, np.atleast_1d(np.asarray(values, dtype=np.float64)).ravel().tolist()))


def saved(root: XmlElement, path: str | Path) -> None:
    """Write a document, indented, whole or not at all.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    etree.indent(root)
    text = etree.tostring(root, xml_declaration=True, encoding="utf-8")
    write_atomically(path, "wb", lambda file: file.write(text))


def cannot(description: MechanismDescription, element: str, message: str) -> DescriptionError:
    """The error of a format that has no words for something."""
    return DescriptionError(message, source=description.source, element=element)
