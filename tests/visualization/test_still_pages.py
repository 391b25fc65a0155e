"""Pages that are left alone: where nothing moves, none asks for another frame, and none costs anybody anything."""

from __future__ import annotations

import os
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

import ccpin
from ccpin import report, visualization
from ccpin.studio import studio
from tests.support.browser import opened, press, settle
from tests.support.long_cases import later
from tests.support.pages import five_bar, five_bar_swing

SECONDS = float(os.environ.get("CCPIN_STILL", "0.8"))
KINDS = ("a pose", "a motion paused", "a report", "a live viewer", "the studio")
ASKED = """(inner => { inner.asked = 0; const real = inner.requestAnimationFrame.bind(inner);
  inner.requestAnimationFrame = work => { inner.asked += 1; return real(work); }; })"""


FRAME = "document.querySelector('iframe')"
INNER = FRAME + ".contentWindow"


def until(page, expression):
    """Wait for it."""
    deadline = time.monotonic() + 60
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, expression
        time.sleep(0.05)


def busy():
    """CPU seconds of this process and of all that it has begun."""
    ticks = 0
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(folder.name)] = int(fields[1]), int(fields[11]) + int(fields[12])
    wanted = {os.getpid()}
    while more := {pid for pid, (parent, _) in parents.items() if parent in wanted} - wanted:
        wanted |= more
    ticks = sum(parents[pid][1] for pid in wanted)
    return ticks / os.sysconf("SC_CLK_TCK")


@pytest.fixture
def left_alone(tmp_path):
    """Opens a page of a kind; what plays is paused."""
    with ExitStack() as stack:

        def at(kind):
            rpdr, (t, poses) = five_bar(), five_bar_swing()
            path = tmp_path / "page.html"
            if kind == "a pose":
                path.write_text(visualization.embed(rpdr).page, encoding="utf-8")
            elif kind == "a motion paused":
                visualization.animate(rpdr, t, poses, path)
            elif kind == "a report":
                report.write(ccpin.load("slider_crank"), path, report.ReportSettings(depth=3, duration=0.3))
            elif kind == "a live viewer":
                url = stack.enter_context(visualization.view(rpdr, open_browser=False)).url
            else:
                one = stack.enter_context(studio(ccpin.load("four_bar"), open_browser=False, cache=tmp_path))
                url = one.url
            page = stack.enter_context(opened(url if kind in ("a live viewer", "the studio") else path.as_uri()))
            if kind == "a report":
                page.evaluate(f"{FRAME}.scrollIntoView()")
                until(page, f"{INNER}.document.querySelector('#play')?.textContent")
            return page

        yield at


@pytest.mark.parametrize("kind", later(*KINDS))
def test_nothing_moves_and_nothing_is_drawn(left_alone, kind):
    """It was 0.93 CPU seconds a second: every frame was drawn anew. `CCPIN_STILL` is how long it is looked at."""
    page = left_alone(kind)
    inner = INNER if kind == "a report" else "window"
    if page.evaluate(f"{inner}.document.querySelector('#play').textContent === '\u275a\u275a'"):
        page.evaluate(f"{inner}.document.querySelector('#play').click()")
    page.evaluate(f"{ASKED}({inner})")
    looks = 0  # at which nobody had asked for a frame: what a studio computes first may take a while
    while looks < 3:
        time.sleep(0.4)
        looks = 0 if page.evaluate(f"({inner}.last = {inner}.asked, {inner}.asked = 0, {inner}.last)") else looks + 1
    before = busy()
    time.sleep(SECONDS)
    sys.stdout.write(f"{kind}: {(busy() - before) / SECONDS:.4f} CPU seconds a second\n")
    assert page.evaluate(f"{inner}.asked") == 0
    press(page, "2")
    settle(page, 500)
    if inner == "window":
        assert page.evaluate("window.asked") > 3
