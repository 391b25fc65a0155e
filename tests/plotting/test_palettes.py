"""Colours that stand for different things are told apart by eyes without red or green cones, too."""

import itertools
import re

import numpy as np
import pytest

from ccpin.plotting import COLOURS
from ccpin.plotting.atlases import _STATUS_COLOURS
from ccpin.plotting.sheets import _COUNTS, _OPEN
from tests.support.places import ROOT

# Machado, Oliveira and Fernandes, A Physiologically-based Model for Simulation of Color Vision Deficiency, IEEE
# Transactions on Visualization and Computer Graphics 15 (2009), severity 1, on linear RGB.
EYES = {
    "all cones": np.eye(3),
    "without red": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "without green": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
APART = 15.0  # CIE 1976 colour difference; one is just seen, side by side
STUDIO = (ROOT / "src" / "ccpin" / "studio" / "assets" / "plots.js").read_text(encoding="utf-8")
LINES = tuple(re.findall(r'"(#[0-9a-f]{6})"', re.search(r"^const LINES = (.*)$", STUDIO, re.M)[1]))
PALETTES = {
    "lines": COLOURS,
    "cells": tuple(colour for _, _, colour in _STATUS_COLOURS),
    "counts": (_OPEN, *_COUNTS),
}


def lab(colour, eyes):
    """CIE L*a*b* of a hexadecimal colour as eyes see it."""
    coded = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    x, y, z = XYZ @ np.clip(eyes @ linear, 0, 1) / [0.95047, 1.0, 1.08883]
    x, y, z = (np.cbrt(v) if v > 216 / 24389 else (24389 / 27 * v + 16) / 116 for v in (x, y, z))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def nearest(palette, eyes):
    """The least difference of any two."""
    seen = [lab(colour, eyes) for colour in palette]
    return min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2))


def test_the_measure():
    """White is L* = 100, grey has no hue to anybody; the red and green of traffic lights are near to many eyes."""
    assert lab("#ffffff", EYES["all cones"]) == pytest.approx([100, 0, 0], abs=0.02)
    for eyes in EYES.values():
        assert eyes.sum(axis=1) == pytest.approx(1.0, abs=2e-6)
    confused = ("#d1541f", "#b58900")
    assert nearest(confused, EYES["all cones"]) > 2 * APART > 2 * nearest(confused, EYES["without green"])


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("name", PALETTES)
def test_colours_are_told_apart(name, eyes):
    assert nearest(PALETTES[name], EYES[eyes]) > APART


def test_the_studio_draws_lines_in_the_same_colours():
    assert LINES == COLOURS
