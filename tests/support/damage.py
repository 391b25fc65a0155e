"""Damage to files, and what is wrong with how ccpin takes a damaged one."""

import random
import re
import signal
from contextlib import contextmanager

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

SECONDS_A_CASE = 5.0  # of the processor's time, ten times as long by the clock
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
    *("dynamics", "springStiffness", "mechanicalReduction", "actuator", "motor", "position", "general", "flag"),
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


def damage_xml(text, rng, extra=()):
    """Damage to one or two elements: deleted, doubled, renamed, moved, emptied, or with hostile values.

    `extra` are further actions: "text" puts a hostile value between an element's tags.
    """
    root = etree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2))):
        element = rng.choice([e for e in root.iter() if isinstance(e.tag, str)])
        _damage_element(root, element, rng, extra)
    return etree.tostring(root)


def _damage_element(root, element, rng, extra):
    parent = element.getparent()
    action = rng.choice(
        ("value", "value", "value", "delete", "double", "tag", "move", "drop", "attribute", "swap", "clear", *extra)
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
    elif action == "text":
        element.text = rng.choice(VALUES).replace("\0", "")
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


XML_DAMAGE = (damage_xml,) * 8 + (damage_digits, damage_bytes, damage_bytes, with_entities, nested)


def damage_text_xml(text, rng):
    """As `damage_xml`, for formats whose values stand between tags."""
    return damage_xml(text, rng, ("text",) * 8)


TEXT_XML_DAMAGE = tuple(damage_text_xml if damage is damage_xml else damage for damage in XML_DAMAGE)


def complaints(texts, numbers, folder, damages=XML_DAMAGE, suffix=".xml"):
    """What is wrong with how ccpin takes the damaged files of those numbers, one line each."""
    found = []
    for number in numbers:
        rng = random.Random(number)
        name = sorted(texts)[number % len(texts)]
        place = folder / str(number)
        place.mkdir()
        file = place / f"{name}{suffix}"
        file.write_bytes(rng.choice(damages)(texts[name].encode(), rng))
        complained = complaint(file)
        if complained is not None:
            found.append(f"case {number} ({name}): {complained[:300]}")
    return found
