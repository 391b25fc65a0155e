"""The notebooks: made of the pages that show them, run by Jupyter's own machinery, with the pictures that are shown."""

import json

import pytest

from tests.support.documents import blocks
from tests.support.places import ROOT

pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
notebooks = pytest.importorskip("tests.support.notebooks")
PAGES = notebooks.PAGES


def test_there_is_one_of_each_page():
    """And no other."""
    assert {path.stem for path in notebooks.FOLDER.glob("*.ipynb")} == set(PAGES)
    shown = {path for page in PAGES.values() for path in notebooks.shown(page)}
    assert shown >= set(notebooks.FOLDER.glob("*.png"))
    site = (ROOT / "zensical.toml").read_text(encoding="utf-8")
    assert all(page.relative_to(ROOT / "docs").as_posix() in site for page in PAGES.values())


@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_is_its_page(name):
    """Cell for cell; `python -m tests.support.notebooks` writes what a changed page has become."""
    written = json.loads((notebooks.FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    made = notebooks.notebook(PAGES[name])
    assert [cell["source"] for cell in written["cells"]] == [cell.source.splitlines(True) for cell in made.cells]
    code = "\n".join(cell.source for cell in made.cells if cell.cell_type == "code")
    assert all(block.text.strip() in code for block in blocks(PAGES[name]) if block.language == "python")


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_runs_and_shows_its_pages_pictures(name, tmp_path):
    """Without an error, and with as many pictures as the page shows, of the same sizes but for what a label takes."""
    pictures = notebooks.drawn(notebooks.executed(notebooks.notebook(PAGES[name]), tmp_path))
    kept = [path.read_bytes() for path in notebooks.shown(PAGES[name])]
    assert len(pictures) == len(kept) > 0
    for mine, theirs in zip(pictures, kept, strict=True):
        assert all(abs(a - b) <= 30 for a, b in zip(notebooks.size(mine), notebooks.size(theirs), strict=True))
