"""One alteration of a file at a time, and what the reader makes of it: raw errors, waiting, and silence."""

from __future__ import annotations

import pickle
import random
import re
import time
from dataclasses import replace
from typing import NamedTuple

from lxml import etree

import ccpin
from ccpin.description import read_description
from ccpin.errors import CcpinError
from tests.support.damage import TooSlow, time_limit

NUMBERS = ("1e300", "-1e300", "1e-300", "nan", "inf", "", "7.3", "-7.3", "0")
WORDS = ("", "nan", "qqq", "1e300")
HANG = 2.0
"""Seconds of the processor."""


class Altered(NamedTuple):
    """A file with one alteration: its text, what was done, to which word of which element, and what it is within."""

    text: bytes
    what: str
    tag: str
    attribute: str
    before: str
    within: tuple[str, ...]


def altered(text: bytes, rng: random.Random) -> Altered:
    """An element or an attribute (or an element's text) renamed, removed, doubled, or with another value."""
    root = etree.fromstring(text)
    element = rng.choice([e for e in root.iter() if isinstance(e.tag, str) and e is not root])
    tag, parent = etree.QName(element).localname, element.getparent()
    space = str(element.tag).removesuffix(tag)
    within = tuple(etree.QName(each).localname for each in element.iterancestors())
    said = (element.text or "").strip() if not len(element) else ""
    actions = ["rename", "remove", "double"]
    actions += ["attribute renamed", "attribute removed", "value", "value"] * bool(element.attrib)
    actions += ["text", "text"] * bool(said)
    what = rng.choice(actions)
    attribute = rng.choice(sorted(element.attrib)) if element.attrib and what.startswith(("attr", "value")) else ""
    before = element.get(attribute, "") if attribute else said or " ".join(element.attrib.values())
    if what == "rename":
        element.tag = space + _misspelt(tag, rng)
    elif what == "remove":
        parent.remove(element)
    elif what == "double":
        parent.insert(parent.index(element) + 1, etree.fromstring(etree.tostring(element)))
    elif what == "attribute renamed":
        del element.attrib[attribute]
        element.set(_misspelt(attribute, rng), before)
    elif what == "attribute removed":
        del element.attrib[attribute]
    elif what == "value":
        element.set(attribute, _other(before, rng))
    else:
        element.text = _other(said, rng)
    return Altered(etree.tostring(root), what, tag, attribute, before, within)


def _misspelt(word: str, rng: random.Random) -> str:
    """Another word: a letter lost or doubled, the end turned round, or a stranger."""
    at = rng.randrange(len(word))
    found = rng.choice((word[:at] + word[at + 1 :], word[: at + 1] + word[at:], word[:at] + word[at:][::-1], "unheard"))
    return found if re.match(r"[A-Za-z_]", found) and found != word else "unheard"


def _other(value: str, rng: random.Random) -> str:
    """Another value of the same kind, or none; of several numbers one changes."""
    parts = value.split()
    if not (re.fullmatch(r"[-+.\deE\s]+", value) and parts):
        return rng.choice(WORDS)
    at = rng.randrange(len(parts))
    parts[at] = rng.choice([each for each in NUMBERS if not each or abs(float(each) - float(parts[at])) >= 1e-200])
    return " ".join(parts)


class Taken(NamedTuple):
    """How a file was taken: what was raised that is not ours or that it hung; the description as bytes; its notes."""

    fault: str
    content: bytes
    notes: tuple[str, ...]
    refused: bool


def taken(file, loaded: bool = True) -> Taken:
    """Read a file, and load what it says."""
    begin = time.process_time()
    content, notes, refused, fault = b"", (), False, ""
    try:
        with time_limit():
            description = read_description(file)
            content, notes = pickle.dumps(replace(description, notes=(), source=None)), description.notes
            if loaded:
                ccpin.load(file)
    except CcpinError:
        refused = True
    except TooSlow:
        fault = "does not end"
    except Exception as error:
        fault = f"{type(error).__name__}: {error}"[:200]
    spent = time.process_time() - begin
    if spent > HANG and not fault:
        fault = f"takes {spent:.1f} s"
    return Taken(fault, content, notes, refused)
