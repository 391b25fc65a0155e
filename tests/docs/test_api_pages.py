"""The reference pages hold every public name, once, and nothing else."""

import importlib
import re

import pytest

import ccpin
from tests.support.places import ROOT

PAGES = ROOT / "docs" / "api"
ROOMS = [page.stem for page in sorted(PAGES.glob("*.md")) if page.stem not in ("ccpin", "gym")]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_documented_whole(room):
    """One entry for each name of its face."""
    entries = re.findall(rf"^::: ccpin\.{room}\.(\w+)$", (PAGES / f"{room}.md").read_text(encoding="utf-8"), re.M)
    assert sorted(entries) == sorted(importlib.import_module(f"ccpin.{room}").__all__)


def test_the_package_is_documented_whole():
    """Every public name of ccpin itself has its row."""
    rows = re.findall(r"^\| `ccpin\.(\w+)` \|", (PAGES / "ccpin.md").read_text(encoding="utf-8"), re.M)
    assert rows == sorted(ccpin.__all__)


def test_every_room_has_a_page():
    """What is public of ccpin and is a folder or module is a page."""
    rooms = {name for name in ccpin.__all__ if hasattr(getattr(ccpin, name), "__file__")}
    assert rooms <= set(ROOMS)
