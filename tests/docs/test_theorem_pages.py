"""The theorems on the site are the ones that certificates carry: each page is its file's text, and nothing else."""

import re

from ccpin.proof.theorems import theorem
from tests.support.documents import SNIPPET
from tests.support.places import ROOT

PAGES = ROOT / "docs" / "theorems"
SOURCES = ROOT / "src" / "ccpin" / "proof" / "theorems"


def test_every_theorem_has_its_page():
    assert {page.name for page in PAGES.iterdir()} == {source.name for source in SOURCES.glob("*.md")}
    for page in PAGES.iterdir():
        text = page.read_text(encoding="utf-8")
        assert SNIPPET.fullmatch(text.rstrip())[1] == (SOURCES / page.name).relative_to(ROOT).as_posix()


def test_the_index_leads_to_each():
    linked = re.findall(r"^\| \[(\w+)\]\((\w+)\.md\) \|", theorem("index"), re.M)
    assert all(shown == file for shown, file in linked)
    assert sorted(file for _, file in linked) == sorted(page.stem for page in PAGES.iterdir() if page.stem != "index")
