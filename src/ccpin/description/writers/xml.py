"""What the writers of XML share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lxml import etree

from ccpin.description.model import MechanismDescription
from ccpin.description.xml import XmlElement
from ccpin.errors import DescriptionError
from ccpin.files import write_atomically


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
