"""Each question of the FAQ names a thread where it was asked, and has an answer that runs."""

import re

import pytest

from tests.support.places import ROOT

PAGE = (ROOT / "docs" / "faq.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S))
THREAD = r"\]\(https://github\.com/[\w.-]+/[\w.-]+/(?:issues|discussions|pull)/\d+\)"


@pytest.mark.parametrize("question", SECTIONS)
def test_a_question_was_asked_and_is_answered(question):
    """A thread in its first paragraph, and code."""
    section = SECTIONS[question]
    assert re.search(THREAD, section.strip().partition("\n\n")[0])
    assert "```python\n" in section
