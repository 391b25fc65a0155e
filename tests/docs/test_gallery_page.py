"""The gallery's pictures are those that its code saves, and small; the page itself runs with all others."""

import re
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image, ImageSequence

from tests.support.loading import script
from tests.support.places import ROOT

PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
FOLDER = ROOT / "docs" / "gallery"
SHOWN = re.findall(r"^!\[[^\]]+\]\(gallery/(\w+)\.webp\)$", PAGE, re.M)


def test_each_picture_is_made_by_the_code_above_it():
    """The last block before a picture saves it, and nothing lies in the folder that the page does not show."""
    assert len(SHOWN) >= 10
    for name in SHOWN:
        before = PAGE.partition(f"(gallery/{name}.webp)")[0]
        assert f'"{name}.png"' in re.findall(r"```python\n(.*?)```", before, re.S)[-1]
    assert sorted(path.stem for path in FOLDER.iterdir()) == sorted(SHOWN)


def test_the_script_runs_that_code_and_no_other():
    """One source: what the script runs is what the page shows."""
    assert script("gallery").blocks(PAGE) == re.findall(r"```python\n(.*?)```", PAGE, re.S)


def test_pictures_are_small():
    """Two megabytes in all, three for the moving one."""
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 2e6
    assert (ROOT / "docs" / "hero.webp").stat().st_size < 3e6


def test_a_picture_becomes_smaller(tmp_path):
    """A PNG larger than a page shows comes out as WebP of the largest size and the same shape."""
    Image.new("RGB", (1800, 900), "white").save(tmp_path / "wide.png")
    path = script("gallery").smaller(tmp_path / "wide.png", tmp_path)
    assert Image.open(path).size == (900, 450)


def test_the_moving_picture_moves_and_comes_back():
    """The step from its last frame to its first is no longer than the longest from one frame to the next."""
    frames = [
        np.asarray(frame.convert("L"), dtype=float)
        for frame in ImageSequence.Iterator(Image.open(ROOT / "docs" / "hero.webp"))
    ]
    hero = script("hero")
    assert len(frames) == round(hero.CYCLE / hero.SLOWER * hero.FPS)
    steps = [np.abs(after - before).mean() for before, after in pairwise(frames)]
    assert min(steps) > 0
    assert np.abs(frames[0] - frames[-1]).mean() <= max(steps)


@pytest.mark.parametrize(("belt", "slot", "next_slot"), [("in", 2, 1), ("in", 3, 2), ("out", 1, 2)])
def test_a_cycle_ends_as_it_began(belt, slot, next_slot):
    """After a cycle a box of a belt stands where the next one stood; the carried one has become the first put down."""
    hero = script("hero")
    end = np.nextafter(hero.CYCLE, 0.0)
    np.testing.assert_allclose(
        hero.box_at(belt, slot, end, hero.PICK), hero.box_at(belt, next_slot, 0.0, hero.PICK), atol=1e-12
    )
    np.testing.assert_allclose(hero.box_at("in", 0, end, hero.PICK), hero.box_at("out", 1, 0.0, hero.PICK), atol=1e-12)
    np.testing.assert_allclose(hero.box_at("in", 1, end, hero.PICK), hero.box_at("in", 0, 0.0, hero.PICK), atol=1e-12)
