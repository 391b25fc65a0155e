"""Theorems are files that documents carry, however Python was started."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import ccpin
from ccpin import auditing
from ccpin.domain.documents.kinds import ATLAS, CURVES, SHEETS
from ccpin.proof.theorems import theorem, theorems

FOLDER = Path(ccpin.__file__).parent / "proof" / "theorems"
WRITE = """
import sys, ccpin
atlas = ccpin.domain.certify(ccpin.load("four_bar"), [1.5], ([1.4], [1.6]), max_depth=0)
atlas.save(sys.argv[1])
"""


def test_documents_written_without_docstrings_have_their_theorem(tmp_path):
    """`python -OO` drops docstrings; the theorems of a document are files."""
    path = tmp_path / "atlas.npz"
    subprocess.run([sys.executable, "-OO", "-c", WRITE, str(path)], check=True)
    told = auditing.verify(path).theorem
    assert told == theorems(*ATLAS.theorems)
    assert "**Theorem N.**" in told
    assert "**Theorem S.**" in told


@pytest.mark.parametrize("kind", [ATLAS, SHEETS, CURVES], ids=lambda kind: kind.schema.format)
def test_theorems_of_a_document_exist(kind):
    """Every kind of document names files that are there, each with a statement."""
    for name in kind.theorems:
        assert theorem(name).startswith("# ")
    assert "∎" in theorems(*kind.theorems)


def test_the_index_lists_every_theorem():
    """The index has each file once."""
    listed = re.findall(r"\]\((\w+)\.md\)", theorem("index"))
    assert sorted(listed) == sorted(path.stem for path in FOLDER.glob("*.md") if path.stem != "index")


def test_code_cites_theorems_that_exist():
    """Every file of theorems that a module names is there."""
    cited = {
        name
        for path in FOLDER.parents[1].rglob("*.py")
        for name in re.findall(r"proof/theorems/(\w+)\.md", path.read_text(encoding="utf-8"))
    }
    assert cited >= {"theorem_n", "folds", "tubes", "ranges"}
    assert [name for name in cited if not (FOLDER / f"{name}.md").is_file()] == []
