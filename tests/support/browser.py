"""Headless Chromium for the tests that look at pixels: found, installed where that is possible, or skipped."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from numpy.typing import NDArray

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
)


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


def screenshot(url: str, width: int = 900, height: int = 600, wait_ms: int = 3000) -> NDArray[np.float64]:
    """The page as a picture of shape (height, width, 3), values in [0, 1], after `wait_ms` of virtual time."""
    program = chromium()
    with tempfile.TemporaryDirectory(prefix="ccpin-chromium-") as folder:
        picture = Path(folder, "page.png")
        command = [
            program,
            *FLAGS,
            f"--virtual-time-budget={wait_ms}",
            f"--window-size={width},{height}",
            f"--user-data-dir={folder}/profile",
            f"--screenshot={picture}",
            url,
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert picture.is_file(), f"Chromium wrote no picture of {url}: {done.stderr[-500:]}"
        return np.asarray(matplotlib.image.imread(picture), dtype=np.float64)[..., :3]
