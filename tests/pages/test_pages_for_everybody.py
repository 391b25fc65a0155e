"""What ccpin writes is for everybody: on a phone, in the dark, by keys alone, read aloud, with nothing that moves."""

from __future__ import annotations

import re
import time
from contextlib import ExitStack

import pytest

import ccpin
from ccpin import report, visualization
from ccpin.paper import reproduction
from ccpin.paper.reproduction_page import page as paper_page
from ccpin.studio import studio
from tests.support.browser import FAINT, click, opened, press, settle
from tests.support.long_cases import later
from tests.support.pages import five_bar, five_bar_swing

ONE = later("the studio", "a motion", "a report", "the paper")
SMALLEST = 24  # pixels across a control, WCAG 2.2, 2.5.8
CONTRAST = 4.5  # of text on what is behind it, WCAG 2.2, 1.4.3


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """The address of a page of a kind, each written or served once."""
    folder, known = tmp_path_factory.mktemp("pages"), {}
    with ExitStack() as stack:

        def of(kind):
            if kind not in known:
                path = folder / f"{kind.replace(' ', '_')}.html"
                known[kind] = path.as_uri()
                if kind == "a motion":
                    t, poses = five_bar_swing()
                    visualization.animate(five_bar(), t, poses, path)
                elif kind == "a report":
                    report.write(ccpin.load("slider_crank"), path, report.ReportSettings(depth=3, duration=0.3))
                elif kind == "the paper":
                    with pytest.MonkeyPatch.context() as patch:
                        patch.setattr(reproduction, "CHAPTERS", reproduction.CHAPTERS[:2])
                        path.write_text(paper_page(reproduction.reproduce()), encoding="utf-8")
                else:
                    served = studio(ccpin.load("four_bar"), open_browser=False, cache=folder)
                    known[kind] = stack.enter_context(served).url
            return known[kind]

        yield of


def ready(page, kind):
    """Wait until the studio's numbers are there."""
    deadline = time.monotonic() + 60
    while kind == "the studio" and page.evaluate("document.querySelectorAll('#facts td').length < 4"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    settle(page, 300)


def emulated(page, name, value):
    """Media features as the user's system would have them."""
    page.command("Emulation.setEmulatedMedia", {"features": [{"name": name, "value": value}]})
    settle(page, 100)


def again(page, url):
    """Another page, or the same anew, in the same window."""
    page.command("Page.navigate", {"url": url})
    time.sleep(1.0)
    while page.evaluate("document.readyState") != "complete":
        time.sleep(0.1)


SEEN = """(all => [...document.querySelectorAll(all)].filter(e => !e.disabled && e.checkVisibility() &&
  e.getBoundingClientRect().width > 0))('button, input, select, summary, a[href], [tabindex]')"""
PART = "(e => `${e.tagName} ${e.id || e.className || e.textContent}`.trim())"
ALOUD = {"button", "link", "slider", "textbox", "combobox", "radio", "checkbox", "DisclosureTriangle", "application"}


@pytest.mark.parametrize("kind", ONE)
def test_a_phone_shows_all_of_it(address, kind):
    """At 360 pixels the page does not scroll sideways, nothing is beyond its edge, and a finger hits every control."""
    with opened(address(kind), 360, 740) as page:
        ready(page, kind)
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        out = f"{SEEN}.filter(e => !e.closest('.wide, pre') && (e.getBoundingClientRect().right > 361 || " + (
            f"e.getBoundingClientRect().left < -1)).map({PART})"
        )
        assert page.evaluate(out) == []
        whole = "[...document.querySelectorAll('canvas, figure, iframe')].map(e => e.getBoundingClientRect().width)"
        assert all(width == 0 or 200 < width <= 360 for width in page.evaluate(whole))
        touched = "(e => (e.type === 'radio' ? e.nextElementSibling : e).getBoundingClientRect())"
        small = f"""{SEEN}.filter(e => e.tabIndex >= 0 && (e.tagName !== 'A' || e.closest('nav')))
          .filter(e => Math.min({touched}(e).width, {touched}(e).height) < {SMALLEST}).map({PART})"""
        assert page.evaluate(small) == []


@pytest.mark.parametrize("kind", ONE)
def test_every_control_has_a_name_and_shows_its_focus(address, kind):
    """What a screen reader says of each is not empty; Tab reaches it, and it is outlined then."""
    with opened(address(kind), 1280, 800) as page:
        ready(page, kind)
        page.command("Accessibility.enable")
        nodes = [one for one in page.command("Accessibility.getFullAXTree")["nodes"] if not one["ignored"]]
        controls = [one for one in nodes if one["role"]["value"] in ALOUD]
        assert len(controls) > 5
        assert [one["role"]["value"] for one in controls if not one.get("name", {}).get("value", "").strip()] == []
        key = {"key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
        for event in ("keyDown", "keyUp"):
            page.command("Input.dispatchKeyEvent", {"type": event, **key})
        dull = f"""{SEEN}.filter(e => {{ if (e.tabIndex < 0) return true; e.focus();
          const shown = e.type === 'radio' ? e.nextElementSibling : e;
          return document.activeElement !== e || getComputedStyle(shown).outlineStyle === 'none'; }}).map({PART})"""
        assert page.evaluate(dull) == []


@pytest.mark.parametrize("dress", later("dark", "light"))
@pytest.mark.parametrize("kind", ONE)
def test_words_stand_out(address, kind, dress):
    """Text is 4.5 times as light, or dark, as what it stands on; all pages are dark where the system is."""
    with opened(address(kind), 1280, 800) as page:
        emulated(page, "prefers-color-scheme", dress)
        ready(page, kind)
        if kind == "a motion":
            press(page, "l")
            press(page, "?")
            settle(page, 200)
        assert page.evaluate(f"{FAINT}({CONTRAST})") == []
        assert page.evaluate(f"{FAINT}(22).length") > 3  # that it looks at words
        panel = {"the studio": "'#drive'", "a motion": "'#bar'"}.get(kind, "'body'")
        behind = page.evaluate(f"getComputedStyle(document.querySelector({panel})).backgroundColor")
        assert (max(map(float, re.findall(r"[\d.]+", behind)[:3])) < 60) == (dress == "dark"), behind


@pytest.mark.slow
def test_who_wants_stillness_has_it(address):
    """Where the system asks for less motion nothing plays or flies by itself; the play button still plays."""
    with opened(address("a motion"), 900, 600) as page:
        emulated(page, "prefers-reduced-motion", "reduce")
        again(page, address("a motion"))
        assert page.evaluate("[player.duration > 0, player.playing, player.time]") == [True, False, 0]
        page.evaluate("look('top')")
        assert page.evaluate("view.flight") is None
        click(page, "#play")
        settle(page, 300)
        assert page.evaluate("player.time") > 0
        again(page, address("a report"))
        assert page.evaluate("getComputedStyle(document.documentElement).scrollBehavior") == "auto"


def test_keys_press_what_has_the_focus(address):
    """Escape closes the list of keys; space presses a button that Tab has led to, and plays where a click has been."""
    with opened(address("a motion"), 900, 600) as page:
        settle(page, 200)
        press(page, "?")
        assert page.evaluate("document.querySelector('[role=dialog]').checkVisibility()")
        press(page, "Escape")
        assert not page.evaluate("document.querySelector('[role=dialog]').checkVisibility()")
        click(page, "[data-view=front]")
        playing = page.evaluate("player.playing")
        press(page, " ")
        assert page.evaluate("player.playing") != playing
        page.evaluate("document.activeElement.blur()")
        space = {"key": " ", "code": "Space", "windowsVirtualKeyCode": 32, "text": " "}
        tab = {"key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9}
        page.evaluate("document.querySelector('[data-view=side]').focus()")
        for key in (tab, space):
            for event in ("keyDown", "keyUp"):
                page.command("Input.dispatchKeyEvent", {"type": event, **key})
        settle(page, 100)
        assert page.evaluate("[document.activeElement.dataset.view, view.name]") == ["top", "top"]
        assert page.evaluate("player.playing") != playing


@pytest.mark.slow
def test_arrow_keys_drive_the_map(address):
    """With the map in focus a press moves its coordinate by a hundredth of what the map shows."""
    with opened(address("the studio"), 1280, 800) as page:
        ready(page, "the studio")
        deadline = time.monotonic() + 60
        while page.evaluate("studio.chart.cells === null"):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        page.evaluate("document.getElementById('omega').focus()")
        before = page.evaluate("studio.here.q[0]")
        press(page, "ArrowRight")
        while (after := page.evaluate("studio.here.q[0]")) == before:
            assert time.monotonic() < deadline
        width = page.evaluate("(({ region: [low, high] }) => high[0] - low[0])(studio.chart.cells)")
        assert after - before == pytest.approx(width / 100, rel=1e-6)
