"""The reference pages hold every public name, once, and what public functions return."""

import importlib
import re
import sys
import types

import pytest

import ccpin
from tests.support.places import ROOT

PAGES = ROOT / "docs" / "api"
TEXTS = {page.stem: page.read_text(encoding="utf-8") for page in sorted(PAGES.glob("*.md"))}
ROOMS = [room for room in TEXTS if room not in ("ccpin", "gym", "native")]
INNER = {"PiecewisePolynomial", "Problem", "Sample"}  # what rooms hand to each other
ENTRIES = [entry for text in TEXTS.values() for entry in re.findall(r"^::: ([\w.]+)$", text, re.M)]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_documented_whole(room):
    """One entry for each name of its face."""
    entries = re.findall(rf"^::: ccpin\.{room}\.(\w+)$", TEXTS[room], re.M)
    assert sorted(entries) == sorted(importlib.import_module(f"ccpin.{room}").__all__)


def test_the_package_is_documented_whole():
    """Every public name of ccpin itself has its entry, every room its row and its page."""
    rooms = {name for name in ccpin.__all__ if hasattr(getattr(ccpin, name), "__file__")}
    assert sorted(re.findall(r"^::: ccpin\.(\w+)$", TEXTS["ccpin"], re.M)) == sorted({*ccpin.__all__} - rooms)
    assert re.findall(r"^\| \[`ccpin\.(\w+)`\]", TEXTS["ccpin"], re.M) == sorted(rooms)
    assert rooms <= set(ROOMS)


def test_entries_are_of_what_is():
    """Each name is documented once, and is where its entry says."""
    assert len(ENTRIES) == len(set(ENTRIES))
    for entry in ENTRIES:
        module, _, name = entry.rpartition(".")
        assert entry == "ccpin.gym" or hasattr(importlib.import_module(module), name), entry


def test_what_is_returned_is_documented():
    """A class of ccpin's that a public function, or a method of a public class, returns has its entry."""
    documented = {entry.rpartition(".")[2] for entry in ENTRIES}
    faces = [ccpin, *(importlib.import_module(f"ccpin.{room}") for room in ROOMS)]
    public = [getattr(face, name) for face in faces for name in face.__all__]
    methods = [m for c in public if isinstance(c, type) for name, m in vars(c).items() if not name.startswith("_")]
    found = {name for thing in (*public, *methods) for name in _returned(thing)}
    assert len(found) > 60
    assert found - documented == INNER


def _returned(thing):
    """Names of ccpin's classes in what a function says it returns."""
    function = getattr(thing, "fget", None) or getattr(thing, "func", None) or getattr(thing, "__func__", thing)
    if not isinstance(function, types.FunctionType):
        return
    names = vars(sys.modules[function.__module__])
    for name in re.findall(r"\w+", str(function.__annotations__.get("return", ""))):
        found = names.get(name)
        if isinstance(found, type) and found.__module__.startswith("ccpin."):
            yield name
