"""Ctrl-C at random moments of long commands: answered soon, what is kept is whole, nothing runs on, it goes on equal.

``CCPIN_INTERRUPTS=200 pytest -m slow -s tests/test_interrupts.py`` presses it so often, over all commands.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin import domain

JUDGED = (0, 3, 4)  # exit codes of what was done, whatever was found
ANSWERED = 2.5  # s, on a machine that does other things: half a second of ccpin's, the rest Python's own end
TORUS = ("--lower", "-3.14159", "-3.14159", "--upper", "3.14159", "3.14159")
COMMANDS = {
    "atlas": ("domain", "rpdr", "--atlas", "--depth", "10", *TORUS, "--save", "out.npz", "--checkpoint", "kept"),
    "workers": (
        *("domain", "rpdr", "--atlas", "--depth", "10", *TORUS, "--save", "out.npz", "--checkpoint", "kept"),
        *("--workers", "2"),
    ),
    "sheets": ("domain", "rpdr", "--sheets", "--depth", "6", *TORUS, "--save", "out.npz", "--checkpoint", "kept"),
    "curves": ("domain", "rpdr", "--curves", *TORUS, "--save", "out.npz", "--checkpoint", "kept"),
    "report": ("report", "rpdr", "-o", "out.html", "--depth", "7"),
    "simulate": (
        "simulate",
        "rpdr",
        "--cycles",
        "40",
        "--out",
        "out",
        "--duration",
        "20",
        "--friction-coulomb",
        "0.01",
    ),
}


def begun(name, folder):
    """The command, in a group of processes of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "ccpin", *COMMANDS[name]],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


def group_of(process):
    """Processes that are left of its group."""
    left = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == process.pid and fields[0] != "Z":
            left.append(int(folder.name))
    return left


def content(name, folder):
    """What the command has written, so that it can be compared; ``None`` where there is nothing."""
    file = folder / "out.npz"
    if name == "simulate":
        files = sorted((folder / "out").glob("*.npz")) if (folder / "out").is_dir() else []
        return [ccpin.Trajectory.load(each).q.shape for each in files] or None
    if name == "report":
        page = folder / "out.html"
        return (
            page.read_text().endswith("</html>\n") or page.read_text().rstrip().endswith("</html>")
            if page.exists()
            else None
        )
    if not file.exists():
        return None
    if name in ("atlas", "workers"):
        atlas = domain.Atlas.load(file)
        return atlas.certified_fraction, len(atlas.boxes.centre), float(np.sum(atlas.boxes.centre))
    if name == "sheets":
        sheets = domain.SheetAtlas.load(file)
        return sheets.counted_fraction, len(sheets.sheets), sheets.complete
    cover = domain.SingularCover.load(file)
    return [len(curve.tubes.half) for curve in cover.curves], cover.complete


def parts_of_files(folder):
    """Files that a writing has left behind."""
    return [path for path in folder.rglob(".*") if path.is_file()]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_pressed_at_random_moments(name, tmp_path):
    count = max(1, int(os.environ.get("CCPIN_INTERRUPTS", "12")) // len(COMMANDS))
    whole = tmp_path / "whole"
    whole.mkdir()
    start = time.monotonic()
    assert begun(name, whole).wait(300) in JUDGED
    lasts, wanted = time.monotonic() - start, content(name, whole)
    rng, answers, kept = random.Random(name), [], 0
    for k in range(count):
        folder = tmp_path / str(k)
        folder.mkdir()
        process = begun(name, folder)
        time.sleep(rng.uniform(0.02, 1.0) * lasts)
        ended = process.poll() is not None
        process.send_signal(signal.SIGINT)
        pressed = time.monotonic()
        try:
            said = process.communicate(timeout=60)[1]
        finally:
            for left in group_of(process):
                os.kill(left, signal.SIGKILL)
        answers.append(0.0 if ended else time.monotonic() - pressed)
        assert not group_of(process)
        assert not parts_of_files(folder)
        assert "Traceback" not in said or "site" in said, said[-800:]  # before Python has come to ccpin
        found = content(name, folder)
        kept += found is not None
        if name in ("atlas", "workers", "sheets", "curves"):  # go on from what is kept
            assert begun(name, folder).wait(300) in JUDGED
            assert content(name, folder) == wanted
    sys.stdout.write(
        f"\n{name}: {lasts:.1f} s; pressed {count} times, answered within {np.median(answers):.2f} s (median), "
        f"{max(answers):.2f} s (most); {kept} left a whole result\n"
    )
    assert max(answers) < ANSWERED
