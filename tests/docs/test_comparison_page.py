"""The page that compares: each cell has a source that is there, and what was measured is measured again."""

import re

import numpy as np
import pytest

from benchmarks import comparison
from benchmarks.peers import NotForThisError, drake
from tests.support.places import ROOT

PAGE = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
NOTES = dict(re.findall(r"^\[\^([\w-]+)\]: (.+)$", PAGE, re.M))
TABLES = [
    [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
    for block in re.findall(r"(?:^\|.*\|\n)+", PAGE, re.M)
]


def test_every_cell_has_a_source():
    """A footnote each, each footnote used, and each is a URL, a file of ours, or a page of ours."""
    head, _, *rows = TABLES[0]
    for row in rows:
        assert len(row) == len(head)
        for peer, cell in zip(head[1:], row[1:], strict=True):
            assert re.search(r"\[\^[\w-]+\]$", cell), f"{row[0]}, {peer}: {cell}"
    used = set(re.findall(r"\[\^([\w-]+)\](?!:)", PAGE))
    assert used == set(NOTES)


@pytest.mark.parametrize("name", NOTES)
def test_a_source_is_there(name):
    """Files of ours exist; what is of others has an address."""
    note = NOTES[name]
    files = re.findall(r"`((?:benchmarks|scripts|tests)/[\w/]+\.py)`", note)
    pages = re.findall(r"\]\(([\w/.]+\.md)(?:#[\w-]+)?\)", note)
    assert files or pages or "https://" in note
    assert all((ROOT / file).is_file() for file in files)
    assert all((ROOT / "docs" / page).is_file() for page in pages)


def test_the_readme_says_the_same():
    """Every figure of the README's short table is in the long one."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    short = re.search(r"^\| \| ccpin \| MuJoCo.*?\n\n", readme, re.M | re.S)[0]
    long = " ".join(cell for row in TABLES[0] for cell in row)
    figures = re.findall(r"\d+e-\d+|\d+ µs", short)
    assert len(figures) >= 8
    assert [figure for figure in figures if figure not in long] == []


@pytest.mark.slow
def test_the_swings_are_as_printed():
    """Whoever is installed does what the page says, within a factor of three."""
    shown = {row[0]: [float(cell.split()[0]) for cell in row[1:]] for row in TABLES[1][2:]}
    assert list(shown) == list(comparison.ENGINES)
    found, absent = comparison.swings()
    assert {swing.who for swing in found} | set(absent) == set(shown)
    for swing in found:
        for measured, printed in zip(swing[1:], shown[swing.who], strict=True):
            assert printed / 3 < measured < 3 * printed, swing
    first = {swing.who: swing.gap for swing in found}
    assert min(first, key=first.__getitem__) == "ccpin"


@pytest.mark.parametrize(
    ("column", "make"),
    [pytest.param(1, comparison.forearms_in_line, marks=pytest.mark.slow), (2, comparison.bars_in_line)],
)
def test_the_answers_are_as_printed(column, make):
    """What everybody says of a singular configuration begins as the page has it."""
    shown = {row[0]: row[column] for row in TABLES[2][2:]}
    for answer in comparison.asked(*make()):
        said = str(answer)
        if "skipped" in said:
            continue
        if said.startswith("error"):
            assert shown[answer.who] == "error: singular configuration"
            assert "is a singular configuration" in said
        else:
            assert said == shown[answer.who]


@pytest.mark.slow
def test_a_configuration_that_is_singular():
    """The independent oracle of what is asked: forearms in line, and bars in line, by plain trigonometry."""
    mechanism, q_free = comparison.forearms_in_line()
    angle = {joint.name: float(q_free[joint.q][0]) for joint in mechanism.tree.joints}
    forearms = angle["joint1"] + angle["joint3"] - angle["joint2"] - angle["joint4"]
    assert abs(np.sin(forearms)) < 1e-9
    _, flat = comparison.bars_in_line()
    assert not flat.any()


def test_who_is_absent_is_skipped_with_a_word(monkeypatch):
    """Without Drake there are figures of all others, and a word."""
    monkeypatch.setattr(drake, "drake_plant", None)
    found, absent = comparison.swings(0.01)
    assert absent == {"Drake, SAP": drake.ABSENT}
    assert len(found) == len(comparison.ENGINES) - 1
    with pytest.raises(NotForThisError, match="pip install drake"):
        comparison.ENGINES["Drake, SAP"](comparison.bars_in_line()[0])
