"""Safe XML parsing and attribute reading with errors that name the element."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from lxml import etree
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array, frozen
from ccpin.errors import DescriptionError, InvalidXmlError

Element: TypeAlias = Any  # lxml's etree._Element, which has no type stubs
MAX_BYTES = 32 * 1024 * 1024


def parse_xml(text: bytes, source: str | None) -> Element:
    """Parse bytes into an element tree without expanding entities, reading files or using the network.

    Prefixes that the root does not declare (often ``drake:``) are declared on the fly.

    Raises:
        InvalidXmlError: Not well-formed, a document type declaration (entities), or larger than 32 MiB.
    """
    if len(text) > MAX_BYTES:
        raise InvalidXmlError(f"the file is larger than {MAX_BYTES} bytes", source=source)
    try:
        return _parse(text, source)
    except etree.XMLSyntaxError as error:
        repaired = _declare_prefixes(text)
        if repaired is not None:
            try:
                return _parse(repaired, source)
            except etree.XMLSyntaxError:
                pass
        raise InvalidXmlError(f"not well-formed XML: {error.msg}", source=source) from None


def _parse(text: bytes, source: str | None) -> Element:
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    root = etree.fromstring(text, parser)
    if root is None:
        raise InvalidXmlError("the file is empty", source=source)
    document = root.getroottree().docinfo
    if document.internalDTD is not None or document.doctype:
        raise InvalidXmlError(
            "a document type declaration (<!DOCTYPE …>) is refused: entities are never expanded",
            source=source,
        )
    return root


def _declare_prefixes(text: bytes) -> bytes | None:
    used = set(re.findall(rb"</?\s*([A-Za-z_][\w.-]*):[A-Za-z_]", text)) | set(
        re.findall(rb"\s([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*\s*=", text)
    )
    missing = {p for p in used if p not in (b"xml", b"xmlns") and b"xmlns:" + p not in text}
    if not missing:
        return None
    declarations = b"".join(b' xmlns:%s="urn:%s"' % (p, p) for p in sorted(missing))
    return re.sub(rb"<([A-Za-z_][\w.-]*)", lambda m: m.group(0) + declarations, text, count=1)


def label(element: Element) -> str:
    """Name an element as a reader would look for it: ``mass of link 'arm'``."""
    own = tag(element)
    name = element.get("name")
    if name is not None:
        return f"{own} {name!r}"
    for ancestor in element.iterancestors():
        if ancestor.get("name") is not None and ancestor.getparent() is not None:
            return f"{own} of {tag(ancestor)} {ancestor.get('name')!r}"
    return f"{own} (line {element.sourceline})" if element.sourceline else own


def tag(element: Element) -> str:
    """The element's tag without its namespace."""
    return str(etree.QName(element).localname)


def children(element: Element, name: str) -> Iterator[Element]:
    """Child elements with that local name, whatever their namespace."""
    return (child for child in element if isinstance(child.tag, str) and tag(child) == name)


def child(element: Element, name: str, source: str | None) -> Element:
    """The one child of that name.

    Raises:
        DescriptionError: It is absent.
    """
    found = next(children(element, name), None)
    if found is None:
        raise DescriptionError(f"<{name}> is missing", source=source, element=label(element))
    return found


def text_attribute(element: Element, attribute: str, source: str | None) -> str:
    """A required, non-empty text attribute."""
    value = element.get(attribute)
    if value is None or not value.strip():
        raise DescriptionError(f"attribute '{attribute}' is missing", source=source, element=label(element))
    return str(value)


def numbers(
    element: Element, attribute: str, count: int | None, source: str | None, default: str | None = None
) -> Array:
    """A finite numeric attribute of `count` entries (any number of them if ``None``), read-only.

    Raises:
        DescriptionError: Missing without a default, not numeric, not finite, or of the wrong length.
    """
    value = element.get(attribute, default)
    if value is None:
        raise DescriptionError(f"attribute '{attribute}' is missing", source=source, element=label(element))
    try:
        array = frozen([float(word) for word in value.split()])
    except ValueError:
        raise DescriptionError(
            f"{attribute}={value[:80]!r} is not numeric", source=source, element=label(element)
        ) from None
    if count is not None and array.size != count:
        raise DescriptionError(
            f"{attribute}={value[:80]!r} has {array.size} numbers where {count} are needed",
            source=source,
            element=label(element),
        )
    if not np.all(np.isfinite(array)):
        raise DescriptionError(f"{attribute}={value[:80]!r} is not finite", source=source, element=label(element))
    return array


def number(element: Element, attribute: str, source: str | None, default: str | None = None) -> float:
    """A finite scalar attribute."""
    return float(numbers(element, attribute, 1, source, default)[0])


def origin(element: Element | None, source: str | None) -> Array:
    """The 4×4 transform of an element with URDF's ``xyz`` (m) and ``rpy`` (rad, fixed axes) attributes."""
    transform = np.eye(4)
    if element is not None:
        transform[:3, 3] = numbers(element, "xyz", 3, source, default="0 0 0")
        rpy = numbers(element, "rpy", 3, source, default="0 0 0")
        transform[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    return frozen(transform)


def unit_vector(element: Element, attribute: str, source: str | None) -> Array:
    """A non-zero 3-vector attribute, normalised."""
    vector = numbers(element, attribute, 3, source)
    length = float(np.linalg.norm(vector))
    if not 1e-9 < length < 1e150:
        raise DescriptionError(f"{attribute} is the zero vector", source=source, element=label(element))
    return frozen(vector / length)
