"""Pages of the documentation as notebooks: the page is the source, its notebook and its pictures are made from it.

``python -m tests.support.notebooks [NAME …]`` writes docs/notebooks/NAME.ipynb, runs it, and keeps its pictures beside
the page, in the order in which the page shows them.
"""

import base64
import os
import re
import struct
import sys
import sysconfig
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

from tests.support.documents import FENCE, files
from tests.support.places import ROOT

FOLDER = ROOT / "docs" / "notebooks"
PAGES = {page.stem: page for page in [*sorted(FOLDER.glob("*.md")), ROOT / "docs" / "howto" / "ankle.md"]}
PICTURE = re.compile(r"^!\[[^]]*\]\(([\w.]+\.png)\)\n", re.M)
_HIDDEN = re.compile(r"^<!-- .* -->\n| ?\(\[As a notebook\]\([\w./]+\)[^)]*\)", re.M)
_LINK = re.compile(r"\]\((?!\w+://)([\w./#-]+)\)|\[(`[^`]+`)\]\[[\w.]+\]")


def notebook(page):
    """A page as a notebook without outputs: what the page shows of them is left out, files are written by a cell."""
    text, cells, end = page.read_text(encoding="utf-8"), [], 0
    cells += [_code(f"%%writefile {file.name}\n{file.read_text(encoding='utf-8')}") for file in files(page)]
    for found in FENCE.finditer(text):
        cells += _prose(text[end : found.start()])
        end, body = found.end(), found["text"]
        if found["title"]:
            cells.append(_code(f"%%writefile {found['title']}\n{body}"))
        elif found["language"] == "python":
            cells.append(_code(body))
        elif found["language"] == "console":
            cells.append(_code("\n".join(f"!{line[2:]}" for line in body.splitlines() if line.startswith("$ "))))
    cells += _prose(text[end:])
    cells = sorted(cells, key=lambda cell: not cell.source.startswith("# ")) if files(page) else cells
    for number, cell in enumerate(cells):
        cell.id = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})


def executed(book, folder):
    """The notebook with its outputs, run in a folder."""
    path = os.environ["PATH"]
    os.environ["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), path])
    try:
        return NotebookClient(book, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    finally:
        os.environ["PATH"] = path


def drawn(book):
    """The pictures among a notebook's outputs, as PNG files' bytes, in order."""
    outputs = [out for cell in book.cells for out in cell.get("outputs", ())]
    return [base64.b64decode(out["data"]["image/png"]) for out in outputs if "image/png" in out.get("data", {})]


def shown(page):
    """The pictures that a page shows, in order."""
    return [page.parent / name for name in PICTURE.findall(page.read_text(encoding="utf-8"))]


def size(png):
    """The width and height of a PNG file, pixels."""
    return struct.unpack(">II", png[16:24])


def _code(source):
    return nbformat.v4.new_code_cell(source.strip())


def _prose(text):
    text = _LINK.sub(lambda link: link[2] or "]", _HIDDEN.sub("", PICTURE.sub("", text))).strip()
    return [nbformat.v4.new_markdown_cell(text)] if text else []


def main(names):
    """Write the notebooks and their pictures."""
    for name in names or PAGES:
        page = PAGES[name]
        book = notebook(page)
        nbformat.write(book, FOLDER / f"{name}.ipynb")
        with TemporaryDirectory() as folder:
            pictures = drawn(executed(book, folder))
        for path, picture in zip(shown(page), pictures, strict=True):
            path.write_bytes(picture)


if __name__ == "__main__":
    main(sys.argv[1:])
