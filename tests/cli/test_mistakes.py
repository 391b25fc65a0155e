"""What a person mistypes: one line says what would be right, nothing is asked back, nothing is left behind."""

import json
import re

import pytest

import ccpin
from ccpin.cli import main
from ccpin.cli.notes import gathered
from ccpin.errors import DescriptionError, InvalidInputError
from tests.support.places import MODELS, ROOT


def said(arguments, capsys):
    """The exit code, and the one line on stderr."""
    try:
        code = main(arguments)
    except SystemExit as ended:
        code = ended.code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    return code, shown.err


@pytest.mark.parametrize(
    ("typed", "code", "meant"),
    [
        ("infoo rpdr", 2, "did you mean 'info'?"),
        ("simulat rpdr", 2, "did you mean 'simulate'?"),
        ("--verison", 2, "did you mean '--version'?"),
        ("info rpdr --indpendent joint1 joint2", 2, "did you mean '--independent'?"),
        ("convert rpdr --oout=x.xml", 2, "did you mean '--out'?"),  # though --out is missing too
        ("simulate rpdr --law simpel", 2, "did you mean 'simple'?"),
        ("info rpdr --format urfd", 2, "did you mean 'urdf'?"),
        ("info rpddr", 1, "did you mean 'rpdr'?"),
        ("info Stewrat", 1, "did you mean 'stewart'?"),
        ("info rpdr --independent joint11 joint2", 1, "did you mean 'joint1'?"),
        ("info rpdr --actuated jonit2", 1, "did you mean 'joint2'?"),
        ("info rpdr --locked jiont3", 1, "did you mean 'joint3'?"),
        ("info rpdr --reference jont1=0.5", 1, "did you mean 'joint1'?"),
        ("info rpdr --reference refernce", 1, "did you mean 'reference'?"),
        ("info", 2, "example: ccpin info rpdr"),
        ("info rpdr delta", 2, "there is no place for delta"),
        ("", 2, "ccpin --help"),
    ],
)
def test_a_misspelling_is_told_with_what_was_meant(typed, code, meant, capsys):
    """Commands, options, choices, models, joints, poses; exit code 2 for usage, 1 for what names nothing."""
    ended, line = said(typed.split(), capsys)
    assert ended == code
    assert meant in line


@pytest.mark.parametrize("typed", ["info qqqqqq", "qqqqqq", "info rpdr --qqqqqq"])
def test_what_is_like_nothing_gets_no_guess(typed, capsys):
    """All there are instead."""
    line = said(typed.split(), capsys)[1]
    assert "did you mean" not in line
    assert ("rpdr" if "info qq" in typed else "info" if typed == "qqqqqq" else "--independent") in line


def test_beginnings_of_options_are_still_taken(capsys):
    """As argparse takes them."""
    assert main(["info", "rpdr", "--js"]) == 0
    assert json.loads(capsys.readouterr().out)["mobility"] == 2


def test_a_file_beside_the_one_named_is_meant(tmp_path, capsys):
    """A path that is nearly one there is."""
    (tmp_path / "ankle.urdf").write_bytes((MODELS / "rpdr.urdf").read_bytes())
    code, line = said(["info", str(tmp_path / "ankel.urdf")], capsys)
    assert code == 1
    assert f"did you mean '{tmp_path / 'ankle.urdf'}'?" in line


def test_degrees_given_as_radians_are_told(capsys):
    """Refused where the limits leave no doubt (those of rpdr's motors are ±2π)."""
    code, line = said(["simulate", "rpdr", "--start", "-150", "-160"], capsys)
    assert code == 1
    assert "did you mean degrees, --start-deg -150 -160?" in line


@pytest.mark.parametrize(("q", "noted"), [("7", True), ("6.2", False), ("12", True)])
def test_degrees_that_may_be_turns_are_a_note(q, noted, capsys):
    """A crank that turns twice either way (±4π) may stand at 7 rad: it is done, and told on stderr."""
    assert main(["modes", "four_bar", "--q", q, "--limit", "1"]) == 0
    assert (f"--q-deg {q}?" in capsys.readouterr().err) is noted


def test_lengths_are_no_degrees(capsys):
    """Of a prismatic coordinate nothing of the kind is said."""
    assert main(["modes", "stewart", "--q", *["150"] * 6, "--limit", "1"]) in (0, 1)
    assert "degrees" not in capsys.readouterr().err


def test_an_error_nobody_foresaw_is_one_line_too(capsys, monkeypatch):
    """With how to see where it is from; --debug shows that, for errors of both sorts."""

    def broken(_):
        raise ZeroDivisionError("one\ntwo")

    monkeypatch.setattr("ccpin.cli.info.summary", broken)
    code, line = said(["info", "rpdr"], capsys)
    assert code == 1
    assert "ZeroDivisionError: one two" in line
    assert "--debug" in line
    with pytest.raises(ZeroDivisionError):
        main(["info", "rpdr", "--debug"])
    with pytest.raises(Exception, match="no such file"):
        main(["info", "nosuch", "--debug"])


@pytest.mark.parametrize(
    "typed",
    [
        "info rpdr",
        "modes rpdr --limit 2",
        "simulate rpdr --duration 0.01",
        "domain rpdr --centre-deg -108 -72",
        "doctor",
        "simulate nosuch --out out",
        "info rpdr --independent nosuch",
    ],
)
def test_nothing_is_written_that_was_not_asked_for(typed, tmp_path, monkeypatch, capsys):
    """Nor where a command fails before it has anything to write."""
    monkeypatch.chdir(tmp_path)
    main(typed.split())
    assert list(tmp_path.iterdir()) == []


def test_notes_in_the_same_words_become_one():
    """In the order of their first; those that differ in more than names and numbers stay apart."""
    notes = [f"joint 'j{k}' states no limit" for k in range(40)]
    limits = ["joint 'j1' has a limit of 2", "joint 'j2' has a limit of -1.5e-3"]
    told = gathered([notes[0], "something else", *notes[1:], "something else", "1 row", "2 rows", "3 rows", *limits])
    assert told == [
        "joint 'j0' states no limit (so too of 'j1', 'j2', 'j3' and 36 more)",
        "something else",
        *("1 row", "2 rows", "3 rows"),
        "joint 'j1' has a limit of 2 (so too, with other numbers, of 'j2')",
    ]
    assert gathered(notes[:5]) == ["joint 'j0' states no limit (so too of 'j1', 'j2', 'j3', 'j4')"]
    assert gathered(notes[:2]) == ["joint 'j0' states no limit (so too of 'j1')"]
    assert gathered([]) == []


def test_the_page_tells_mistakes_as_they_are_told(capsys):
    """docs/cli.md's table, row by row."""
    page = (ROOT / "docs/cli.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `ccpin (.+?)` \| `(.+)` \|$", page, re.MULTILINE)
    assert len(rows) == 5
    for typed, told in rows:
        assert told in said(typed.split(), capsys)[1]


def test_fixed_joints_are_not_what_was_meant(tmp_path):
    """An exporter's frames: nothing can be stated of them, and they are not proposed."""
    text = (MODELS / "four_bar.urdf").read_text(encoding="utf-8")
    frame = '<link name="tip"/><joint name="crankx_frame" type="fixed"><parent link="base"/><child link="tip"/></joint>'
    path = tmp_path / "framed.urdf"
    path.write_text(text.replace("</robot>", f"{frame}</robot>"), encoding="utf-8")
    with pytest.raises(InvalidInputError, match="'crankx_frames' is no joint; ") as told:
        ccpin.load(path, joints={"crankx_frames": {"effort": 1.0}})
    assert "crankx_frame'" not in str(told.value).replace("'crankx_frames'", "")
    assert "crankx_frame," not in str(told.value)
    marked = text.replace(
        "</robot>",
        f'{frame}<group_state name="reference" group="all"><joint name="crankx_fram" value="0"/></group_state></robot>',
    )
    path.write_text(marked, encoding="utf-8")
    with pytest.raises(DescriptionError) as said:
        ccpin.load(path)
    assert "did you mean" not in str(said.value)
