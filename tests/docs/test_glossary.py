"""The glossary: every symbol of the public docstrings is in it, and every name it gives is there."""

import importlib
import inspect
import re
import unicodedata

import pytest

import ccpin
from tests.support.places import ROOT

PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
MARKS, *_ = PAGE.partition("## The mechanism")
CELLS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.splitlines() if line.startswith("| ")]
ROWS = [cells for cells in CELLS if len(cells) == 4 and cells[0] != "symbol"]  # symbol, word, unit, name in code
SYMBOLS = "".join(row[0] for row in ROWS)
LINKED = re.findall(r"\]\[([\w.]+)\]", PAGE)
API = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs" / "api").glob("*.md")))
ENTRIES = [entry for entry in re.findall(r"^::: ([\w.]+)$", API, re.M) if not entry.startswith("ccpin.native")]
SUMS = "Σ"  # stands for a sum, too


def thing(path):
    """What a dotted path names: a module, or what is in one."""
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError:
        above, _, name = path.rpartition(".")
        return getattr(thing(above), name)


def texts(entry):
    """The docstrings of a public name, and of a class's public methods."""
    found = thing(entry)
    members = [m for name, m in vars(found).items() if name[0] != "_"] if inspect.isclass(found) else []
    return [inspect.getdoc(one) or "" for one in (found, *members)]


def letters(text):
    """Greek and script letters of a text, without what is above them."""
    plain = unicodedata.normalize("NFD", text)
    return {c for c in plain if re.match("GREEK|MATHEMATICAL SCRIPT|MATHEMATICAL BOLD SCRIPT", unicodedata.name(c, ""))}


def marks(text):
    """Dots, tildes, hats and bars over letters, primes, circled operators."""
    combined = {c for c in unicodedata.normalize("NFD", text.replace("≠", "")) if unicodedata.combining(c)}
    return combined | {c for c in text if c in "′⊕⊖ᵀ"}


def test_every_name_is_there():
    """Linked ones (the strict build checks their pages), and plain ones of a class."""
    assert len(LINKED) > 40
    for path in LINKED:
        assert thing(path) is not None, path
    for owner, name in re.findall(r"\| `([A-Z]\w+)\.(\w+)` \|", PAGE):
        cls = getattr(ccpin, owner, None) or getattr(ccpin.domain, owner)
        assert hasattr(cls, name) or name in inspect.get_annotations(cls), f"{owner}.{name}"


def test_every_symbol_of_a_docstring_is_explained():
    """Its Greek and script letters have rows, and what is set above and beside letters is among the marks."""
    assert len(ENTRIES) > 200
    known, explained = letters(SYMBOLS) | {*SUMS}, marks(MARKS)
    for entry, text in ((name, text) for name in ENTRIES for text in texts(name)):
        assert letters(text) <= known, f"{entry}: {letters(text) - known}"
        assert marks(text) <= explained, f"{entry}: {[unicodedata.name(c) for c in marks(text) - explained]}"


def test_a_symbol_has_one_row():
    """Each has words; what has no symbol is a word itself, with its name in code."""
    symbols = [symbol for symbol, *_ in ROWS if symbol]
    assert len(symbols) == len({*symbols}) > 30
    assert all(word and (symbol or where) for symbol, word, _, where in ROWS)


def test_a_symbol_without_a_row_would_be_seen():
    assert letters("q̇ = ϑ̇") - letters(SYMBOLS) == {"ϑ"}
    assert marks("q̌") - marks(MARKS)
    with pytest.raises(AttributeError):
        thing("ccpin.domain.nothing_of_that_name")
