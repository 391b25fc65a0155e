"""The table of what readers do with physics is current, and nothing in it is lost without a word."""

import mujoco
import pytest

from tests.support.loading import script

physics_table = script("physics_table")


def test_the_page_is_current():
    """`python scripts/physics_table.py` would write what stands in docs/physics.md."""
    page = physics_table.PAGE.read_text(encoding="utf-8")
    assert physics_table.BEGIN + physics_table.table() + physics_table.END in page


def test_nothing_is_lost():
    """Whatever a format can state is read, noted or refused."""
    assert "LOST" not in physics_table.table()


@pytest.mark.parametrize("element", [e for e in physics_table.ELEMENTS if e.mjcf], ids=lambda e: e.name)
def test_the_samples_are_mujocos(element):
    """MuJoCo compiles every sample, but for the one that both refuse."""
    text = physics_table.MJCF.format(**physics_table.SLOTS["MJCF"] | dict([element.mjcf]))
    if element.name.startswith("unknown"):
        with pytest.raises(ValueError, match="dampin"):
            mujoco.MjModel.from_xml_string(text)
    else:
        mujoco.MjModel.from_xml_string(text)
