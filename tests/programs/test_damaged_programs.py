"""Files that say they are programs: what is damaged or forged is refused by name, at once and in little memory."""

import json
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

import ccpin
from ccpin import programs
from ccpin.programs.written_numbers import rational_of

Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    return dict(json.loads(programs.record(model, "forward_dynamics", given="near").text))


def _first(document: dict[str, Any], word: str) -> list[Any]:
    return next(entry for entry in document["instructions"] if entry[0] == word)


CHANGES: dict[str, Change] = {
    "is no whole number": lambda d: d.update(size=10**12),
    "'1e99999999' is no constant": lambda d: _first(d, "constant").__setitem__(-1, "1e99999999"),
    "'nan' is no constant": lambda d: _first(d, "constant").__setitem__(-1, "nan"),
    "no double is near": lambda d: _first(d, "constant").__setitem__(-1, f"{10**399}/1"),
    "322 letters that no double": lambda d: _first(d, "scale").__setitem__(-1, f"{10**319}/3"),
    "'add' of 3 operands": lambda d: _first(d, "add").append(0),
    "'multiply' of 1 operands": lambda d: _first(d, "multiply").pop(),
    "3.5 is no whole number": lambda d: d["results"].__setitem__(0, 3.5),
    "-1 is no whole number": lambda d: d["instructions"][0].__setitem__(1, -1),
    "'inf' is no finite number": lambda d: d.update(tolerance="inf"),
    "'nan' is no finite number above 0": lambda d: d["pivots"][0].__setitem__(1, "nan"),
    "two of one name": lambda d: d["inputs"][0].update(name=d["inputs"][1]["name"]),
    "examples of other inputs": lambda d: d.update(example=[]),
    "version True": lambda d: d.update(version=True),
    "operands that are not there": lambda d: d["instructions"].reverse(),
    "its outputs are not there": lambda d: d["results"].append(0),
}


@pytest.mark.parametrize("told", CHANGES)
def test_what_is_no_program_is_refused(told: str, document: dict[str, Any], tmp_path: Path) -> None:
    forged = json.loads(json.dumps(document))
    del forged["digest"]
    CHANGES[told](forged)
    forged["digest"] = sha256(json.dumps(forged, sort_keys=True).encode()).hexdigest()
    path = tmp_path / "forged.json"
    path.write_text(json.dumps(forged))
    with pytest.raises(ccpin.CcpinError, match=f"is no program of ccpin's: .*({told})"):
        programs.Program.load(path)


@pytest.mark.parametrize("text", ["[" * 100_000, "{}", "[]", "null", "\x00", ""])
def test_what_is_no_document_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "none.json"
    path.write_text(text)
    with pytest.raises(ccpin.CcpinError, match="is no program of ccpin's"):
        programs.Program.load(path)


def test_what_was_written_is_read(document: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "as_it_was.json"
    path.write_text(json.dumps(document))
    assert programs.Program.load(path).digest == document["digest"]


def test_digits_of_constants_are_bounded_above_and_below() -> None:
    ones = "1" * 400
    assert rational_of(f"-{ones}/{ones}", 400) == -1
    for text in (f"{ones}1/1", f"1/{ones}1"):
        with pytest.raises(ValueError, match="is no constant"):
            rational_of(text, 400)
