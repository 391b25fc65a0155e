"""Every block of code in README and documentation runs as it is printed, page after page."""

import pytest

from ccpin.description import CLOSURE_KINDS, FORMATS
from ccpin.studio.server import Studio
from ccpin.visualization.live import Viewer
from tests.support.browser import chromium
from tests.support.documents import PAGES, alike, blocks, needs, run
from tests.support.exported import compiler

KNOWN = {"python", "console", "sh", "text", "xml", "yaml", "toml", "cpp"}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    """An empty folder, servers that are not waited for, and tables that a page may add to."""
    tables = [(table, dict(table)) for table in (CLOSURE_KINDS, FORMATS)]
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda url: True)
    monkeypatch.setenv("CCPIN_CACHE", str(tmp_path / "cache"))
    for served in (Viewer, Studio):
        monkeypatch.setattr(served, "wait", lambda opened: None)
    yield
    for table, entries in tables:
        table.clear()
        table.update(entries)


LONG = (
    {"README.md"}
    | {
        f"docs/{name}.md"
        for name in ("cli", "faq", "gallery", "identification", "pictures", "programs", "transmission", "tutorial")
    }
    | {f"docs/notebooks/{name}.md" for name in ("delta", "paper", "tuning")}
    | {
        f"docs/howto/{name}.md"
        for name in (
            "adaptive",
            "assembly_modes",
            "cad_to_policy",
            "calibration",
            "cluster",
            "firmware",
            "gains",
            "impedance",
            "knee_and_neck",
            "mpc",
            "optimise",
            "realtime",
            "rl",
            "ros2_control",
            "robot_log",
            "serial_limits",
            "torques",
            "tracking",
            "two_arms",
            "workspace",
        )
    }
)


@pytest.mark.parametrize(
    "page", [pytest.param(page, id=name, marks=[pytest.mark.slow] * (name in LONG)) for name, page in PAGES.items()]
)
def test_a_page_runs(page):
    """Files, programs, commands and what they print, in the page's order."""
    for package in needs(page):
        if package == "chromium":
            chromium()
        elif package == "gcc":
            compiler()
        else:
            pytest.importorskip(package, reason=f"the page's code needs {package}")
    run(page)


def test_every_block_says_what_it_is():
    """A block in a language nobody runs or compares would go untested."""
    for page in PAGES.values():
        for block in blocks(page):
            assert block.language in KNOWN or block.title, f"{page}:{block.line}: {block.language}"


def test_dots_stand_for_lines_left_out():
    """Numbers are shown as they are printed: within a line nothing is left out."""
    assert alike("n = 2\nin 0.31 s\n", "n = 2\n…")
    assert alike("n = 2\nin 0.31 s\n", "n = 2\n…\nin 0.31 s\n")
    assert alike("n = 2\n1\n2\nin 0.31 s\n", "n = 2\n…\nin 0.31 s\n")
    assert not alike("n = 2\nin 0.31 s\n", "n = 2\nin … s")
    assert not alike("n = 3\nin 0.31 s\n", "n = 2\n…")
    assert not alike("n = 2\nin 0.31 s\n", "…\nn = 3\n…")


def test_the_readme_begins_in_plain_words():
    """What a stranger reads first has none of the theory's words."""
    first = PAGES["README.md"].read_text(encoding="utf-8").partition("## The files it reads")[0]
    assert "## When not to use it" in first
    assert [word for word in ("σ", "Ω", "ρ", "φ", "ψ", "cut-open", "Theorem") if word in first] == []
