"""`ccpin examples`: what it lists is there and runs; every script and how-to page of the checkout is in it."""

import argparse
import json

from ccpin.cli import _parser, main
from ccpin.cli.examples import pages, scripts
from tests.support.places import ROOT, SCRIPTS


def test_every_command_script_and_page_is_listed(capsys):
    """Commands by an example that `test_help.py` runs; scripts that are programs; pages by their titles."""
    assert main(["examples", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    commands = next(a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction)).choices
    assert [one["run"].split()[1] for one in found["commands"]] == list(commands)
    programs = {path.name for path in SCRIPTS.glob("*.py") if "def main(" in path.read_text(encoding="utf-8")}
    assert {one["run"].rpartition("/")[2] for one in found["scripts"]} == programs
    assert all((ROOT / one["run"]).is_file() for one in found["pages"])
    assert len(found["pages"]) == len(list((ROOT / "docs/howto").glob("*.md")))
    assert all(one["what"] and "\n" not in one["what"] for listed in found.values() for one in listed)


def test_a_line_each(capsys):
    """In words: the same, a line each."""
    assert main(["examples"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert main(["examples", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(lines) == sum(1 + len(listed) for listed in found.values())
    for one in (one for listed in found.values() for one in listed):
        assert sum(one["run"] in line and line.endswith(one["what"]) for line in lines) == 1


def test_without_a_checkout_commands_are_left(tmp_path, capsys, monkeypatch):
    """An installed package has neither scripts nor pages, and says where they are."""
    assert scripts(tmp_path) == pages(tmp_path) == []
    monkeypatch.setattr("ccpin.cli.examples._SOURCES", tmp_path)
    assert main(["examples"]) == 0
    said = capsys.readouterr().out
    assert "ccpin info rpdr" in said
    assert "scripts:" not in said
    assert "sources" in said
