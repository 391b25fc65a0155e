"""Headless Chromium for the tests that look at pixels: found, installed where that is possible, or skipped."""

from __future__ import annotations

import functools
import io
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib.image
import numpy as np
import pytest
from numpy.typing import NDArray

from ccpin.visualization.browser import BrowserPage

FAINT = """(least => {
  const parse = text => { const n = text.match(/[\\d.]+/g).map(Number);
    return [...n.slice(0, 3), n[3] ?? 1]; };
  const over = ([r, g, b, a], [x, y, z]) => [r * a + x * (1 - a), g * a + y * (1 - a), b * a + z * (1 - a), 1];
  const linear = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const light = rgb => rgb.slice(0, 3).map(v => linear(v / 255))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = e => { const layers = [];
    for (let at = e; at; at = at.parentElement) {
      if (at.id === 'stage') {                                                      // the darkest of its gradient
        const sky = getComputedStyle(document.getElementById('pane')).backgroundImage;
        layers.push(parse(sky.match(/rgb[^)]*\\)/g).at(-1))); break; }
      layers.push(parse(getComputedStyle(at).backgroundColor)); }
    return layers.reverse().reduce((under, layer) => over(layer, under), parse('rgb(255, 255, 255)')); };
  const faint = [];
  for (const e of document.querySelectorAll('body *')) {
    const words = [...e.childNodes].some(node => node.nodeType === 3 && node.textContent.trim());
    if (!words || !e.checkVisibility() || e.closest('script, style, :disabled, option, .dg')) continue;
    const back = behind(e), [a, b] = [light(back), light(over(parse(getComputedStyle(e).color), back))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < least) faint.push([e.tagName + ' ' + e.id + e.className, e.textContent.slice(0, 30), ratio]);
  }
  return faint;
})"""
"""Of a contrast: [element, its words, contrast] of all words that stand out less from what is behind them."""
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@functools.cache
def chromium() -> str:
    """The path of a Chromium, installed from Debian's archive if this machine lets us; else the test is skipped."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found:
        return found
    if os.name != "posix" or os.geteuid() != 0 or not shutil.which("apt-get"):
        pytest.skip("no Chromium is installed, and only root with apt-get can install one")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for command in (["apt-get", "update", "-qq"], ["apt-get", "install", "-y", "-qq", "chromium"]):
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
        if done.returncode:
            pytest.skip(f"Chromium could not be installed: {' '.join(command)}: {done.stderr.strip()[-300:]}")
    return shutil.which("chromium") or pytest.skip("apt-get installed no chromium")


@contextmanager
def opened(url: str, width: int = 900, height: int = 600) -> Iterator[BrowserPage]:
    """The page in a browser, shown once; afterwards its console must be clean."""
    pytest.importorskip("choreographer")
    chromium()
    with BrowserPage(url, width, height) as page:
        settle(page)
        yield page
        assert not page.problems, page.problems[:5]


def settle(page: BrowserPage, milliseconds: int = 0) -> None:
    """Wait until what the page draws next is on the screen."""
    frames = "requestAnimationFrame(() => requestAnimationFrame(() => done(true)))"
    page.evaluate(f"new Promise(done => setTimeout(() => {frames}, {milliseconds}))")


def pixels(page: BrowserPage) -> NDArray[np.float64]:
    """What the page shows, of shape (height, width, 3), values in [0, 1]."""
    return np.asarray(matplotlib.image.imread(io.BytesIO(page.picture())), dtype=np.float64)[..., :3]


def press(page: BrowserPage, key: str) -> None:
    """A key, as from the keyboard."""
    text = {"text": key} if len(key) == 1 else {}
    for kind in ("keyDown", "keyUp"):
        page.command("Input.dispatchKeyEvent", {"type": kind, "key": key, **(text if kind == "keyDown" else {})})


def click(page: BrowserPage, selector: str) -> None:
    """The left mouse button on the middle of an element."""
    box = f"document.querySelector({selector!r}).getBoundingClientRect()"
    x, y = page.evaluate(f"(box => [box.left + box.width / 2, box.top + box.height / 2])({box})")
    for kind in ("mousePressed", "mouseReleased"):
        page.command("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1})
