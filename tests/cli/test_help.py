"""What the command line says of itself: examples that run, exit codes, completion, errors that name the option."""

import argparse
import contextlib
import json
import re
import shlex
import shutil
import subprocess
import sys
import threading
import time

import pytest

from ccpin.cli import _parser, main
from ccpin.cli.progress import busy
from ccpin.description.finding import installed_models

COMMANDS = next(a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction)).choices
VERDICTS = (0, 3, 4)
JUDGES = (" domain ", " check ")


def examples(name):
    """The commands a command's help shows."""
    return re.findall(r"(?:example:)? *(ccpin .+)", COMMANDS[name].epilog or "")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_fits_eighty_columns(name, monkeypatch):
    """All but the examples, which are to be pasted whole."""
    monkeypatch.setenv("COLUMNS", "80")
    assert [line for line in COMMANDS[name].format_help().splitlines() if len(line) > 80 and "ccpin " not in line] == []


@pytest.mark.parametrize(
    "name",
    [
        *("new", "info", "check", "modes", "convert", "export", "doctor", "examples"),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("simulate", "domain", "merge", "verify", "view")),
        pytest.param("transmission", marks=pytest.mark.slow),
    ],
)
def test_a_command_shows_examples_that_run(name, tmp_path, monkeypatch, capsys):
    """As printed, one after another, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    shown = examples(name)
    assert any(line.startswith(f"ccpin {name} ") for line in shown)
    for line in shown:
        assert main(shlex.split(line)[1:]) in (VERDICTS if any(name in line for name in JUDGES) else (0,)), line
    capsys.readouterr()
    with pytest.raises(SystemExit, match="0"):
        main([name, "--help"])
    said = capsys.readouterr().out
    assert all(line in said for line in shown)
    assert " ".join(COMMANDS[name].description.split()) in " ".join(said.split())


def test_every_command_has_an_example_and_json():
    """Those of today and those to come."""
    for name, parser in COMMANDS.items():
        assert examples(name), name
        assert "--json" in parser._option_string_actions, name


def test_help_states_the_exit_codes(capsys):
    """0, 1, 2, 3, 4 and 130, and how to switch completion on."""
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    said = capsys.readouterr().out
    assert all(
        words in said
        for words in ("0 done", "1 it cannot be done", "2 wrong usage", "3 undecided", "4 refuted", "130 interrupted")
    )
    assert "--print-completion bash" in said


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_is_a_script(shell, capsys, tmp_path):
    """It names every command and model, and the shell itself finds no error in it."""
    with pytest.raises(SystemExit, match="0"):
        main(["--print-completion", shell])
    script = capsys.readouterr().out
    wanted = [*COMMANDS, *(installed_models() if shell != "tcsh" else ())]
    assert all(word in script for word in wanted)
    if shutil.which(shell) and shell != "tcsh":
        subprocess.run([shell, "-n"], input=script, text=True, check=True, capture_output=True)


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("typed", "found"),
    [("ccpin do", {"doctor", "domain"}), ("ccpin info rpd", {"rpdr"}), ("ccpin info --js", {"--json"})],
)
def test_bash_completes(typed, found, capsys, tmp_path):
    """Commands, models and options after TAB."""
    with pytest.raises(SystemExit):
        main(["--print-completion", "bash"])
    words = typed.split()
    script = f"""{capsys.readouterr().out}
COMP_WORDS=({" ".join(map(shlex.quote, words))}); COMP_CWORD={len(words) - 1}; COMP_TYPE=9
COMP_LINE={shlex.quote(typed)}; COMP_POINT={len(typed)}; compopt() {{ :; }}
$(complete -p ccpin | sed 's/.*-F \\([^ ]*\\).*/\\1/') ccpin {shlex.quote(words[-1])} {shlex.quote(words[-2])}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert set(done.stdout.split()) == found, done.stderr


def test_friction_is_of_independent_joints(capsys):
    """Which joints its numbers are of is in the help."""
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "--friction-coulomb F [F ...] level, N m or N: one for each independent joint, or one for all of them" in said
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "rpdr", "--duration", "-1"], "argument --duration: must be a number above 0, not -1"),
        (["simulate", "rpdr", "--cycles", "0"], "argument --cycles: must be a whole number, 1 or more"),
        (["simulate", "rpdr", "--friction-coulomb", "-1"], "argument --friction-coulomb: must be a number, 0 or more"),
        (["simulate", "rpdr", "--sample-rate", "0"], "argument --sample-rate: must be a number above 0"),
        (["modes", "rpdr", "--budget", "soon"], "argument --budget: must be a number above 0, not soon"),
        (["domain", "rpdr", "--depth", "1.5"], "argument --depth: must be a whole number, 0 or more"),
    ],
)
def test_a_wrong_value_names_its_option(arguments, words, capsys):
    """Wrong usage, exit code 2."""
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["modes", "rpdr", "--q", "1"], "--q takes 2 numbers, of joint1, joint2, not 1"),
        (["simulate", "rpdr", "--start-deg", "1", "2", "3"], "--start-deg takes 2 numbers, of joint1, joint2, not 3"),
        (["simulate", "rpdr", "--kp", "1", "2", "3", "--kv", "1"], "--kp takes one number or 2, not 3"),
        (["domain", "rpdr", "--lower", "-1", "-1"], "--upper"),
    ],
)
def test_what_does_not_fit_the_mechanism_names_its_option(arguments, words, capsys):
    """It cannot be done, exit code 1, in words and as JSON."""
    assert main(arguments) == 1
    assert words in capsys.readouterr().err
    assert main([*arguments, "--json"]) == 1
    assert words in json.loads(capsys.readouterr().out)["message"]


def test_a_second_and_more_is_told_on_a_terminal_alone(capsys, monkeypatch):
    """Nothing is written where the output is piped, with --json, or for what is quick."""
    monkeypatch.setattr("ccpin.cli.progress._PATIENCE", 0.05)
    for quiet, terminal, told in ((False, True, True), (True, True, False), (False, False, False)):
        monkeypatch.setattr("sys.stderr.isatty", lambda terminal=terminal: terminal, raising=False)
        with busy(quiet, "thinking"):
            time.sleep(0.3)
        shown = capsys.readouterr()
        assert (("thinking" in shown.err), shown.out) == (told, "")
    with busy(False, "thinking"):
        pass
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "more", [["--duration", "0.2", "--friction-coulomb", "0.1"], ["--cycles", "1", "--wait", "0.1"]]
)
def test_simulate_tells_its_share(more, monkeypatch):
    """A motion by its time, cycles by their moves: 0 where it begins, and at its end at least half, at most all."""
    shares = []

    @contextlib.contextmanager
    def asked(quiet, what, share=None):
        shares.append(share and share())
        yield
        shares.append(share and share())

    monkeypatch.setattr("ccpin.cli.simulate.busy", asked)
    assert main(["simulate", "rpdr", "--start-deg", "-150", "-160", "--goal-deg", "-90", "-100", *more]) == 0
    assert shares[0] <= 0.0
    assert 0.5 <= shares[1] <= 1.0


def test_a_share_is_looked_up_while_it_grows(capsys, monkeypatch):
    """By another thread, again and again, and shown between none and all."""
    monkeypatch.setattr("ccpin.cli.progress._PATIENCE", 0.0)
    monkeypatch.setattr("ccpin.cli.progress._LOOK", 0.005)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    left, seen = [-0.5, 0.1, 0.5, 0.9, 1.5], threading.Event()

    def share():
        if len(left) == 1:
            seen.set()
        return left.pop(0) if len(left) > 1 else left[0]

    with busy(False, "simulating", share):
        assert seen.wait(60.0)
    shares = [int(share) for share in re.findall(r"simulating +(\d+) %", capsys.readouterr().err)]
    assert shares == sorted(shares)
    assert {0, 10, 50, 90} <= set(shares) <= {0, 10, 50, 90, 100}


def test_a_piped_command_writes_its_result_alone():
    """stdout is JSON, stderr is empty."""
    command = [sys.executable, "-m", "ccpin", "modes", "rpdr", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert json.loads(done.stdout)["modes"]


@pytest.mark.parametrize("typed", [["--help"], ["--version"], ["infoo"]])
def test_help_waits_for_nothing(typed):
    """What needs no computation loads nothing that computes; a misspelt command little more than that."""
    code = f"""
import sys
from ccpin.cli import main
try:
    main({typed!r})
except SystemExit:
    pass
print(sorted({{"pinocchio", "scipy", "numpy", "matplotlib"}} & set(sys.modules)), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stderr.splitlines()[-1]
    assert loaded == "[]" or (typed == ["infoo"] and "pinocchio" not in loaded)


def test_a_command_alone_knows_what_all_of_them_know():
    """Called by name, a command has the parser that it has among all, and the list of commands is the same."""
    for name in COMMANDS:
        parser = _parser([name])
        chosen = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        assert chosen.choices[name].format_help() == COMMANDS[name].format_help()
        assert parser.format_help() == _parser().format_help()
