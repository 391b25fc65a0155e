"""A new file format is a reader, a writer and one entry of a table, as docs/contributing.md has it."""

import re
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin.description import FORMATS
from ccpin.errors import AmbiguousFormatError, InvalidInputError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def ring(monkeypatch):
    """The page's own code, run; the table is as it was afterwards."""
    page = (ROOT / "docs/contributing.md").read_text(encoding="utf-8")
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "FORMATS[" in block)
    monkeypatch.setattr("ccpin.description.formats.FORMATS", table := dict(FORMATS))
    monkeypatch.setattr("ccpin.description.FORMATS", table)
    exec(block, {})
    return table["ring"]


def test_a_new_format_is_read_and_written(ring, tmp_path):
    """A file of it is recognised by its content, moves as the four-bar it is, and is written again by its suffix."""
    (tmp_path / "file").write_text('{"corners": [[0.0, 0.0], [0.0, 1.0], [2.0, 2.0], [2.0, 0.0]]}')
    mechanism = ccpin.load(tmp_path / "file")
    assert mechanism.n == 1
    assert mechanism.save(tmp_path / "out.ring") == ("a ring has no place for anything but its corners",)
    again = ccpin.load(tmp_path / "out.ring", format="ring")
    for one, other in zip(mechanism.description.joints, again.description.joints, strict=True):
        np.testing.assert_array_equal(one.placement, other.placement)


def test_messages_list_a_new_format(ring, tmp_path):
    """What is not recognised, or has no suffix of a format, is told of all that there are."""
    (tmp_path / "file").write_text("{}")
    with pytest.raises(AmbiguousFormatError, match="'closed_loop' or 'corners' key"):
        ccpin.load(tmp_path / "file")
    with pytest.raises(InvalidInputError, match="urdf, sdf, mjcf, toolbox, drake, isaac, ring"):
        ccpin.load("four_bar").save(tmp_path / "out.txt")
