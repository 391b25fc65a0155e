"""Every example on the formats page loads, and all are the same four-bar."""

import re

import numpy as np
import pytest

import ccpin
from tests.support.places import ROOT

PAGE = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
OPEN, *OTHERS = re.findall(r"```xml\n(.*?)```", PAGE, re.DOTALL)
WHOLE = [
    text if text.startswith(("<sdf", "<mujoco")) else OPEN.replace("</robot>", f"{text}</robot>") for text in OTHERS
]


@pytest.mark.parametrize("text", WHOLE, ids=[re.sub(r"\W+", " ", block[:30]).strip() for block in OTHERS])
def test_an_example_loads_as_the_four_bar(text, tmp_path):
    """One freedom, and in the parallelogram crank and rocker turn alike."""
    file = tmp_path / "example.txt"
    file.write_text(text, encoding="utf-8")
    mechanism = ccpin.load(file, independent=["A"])
    circle = mechanism.tree.joint("A").kind.nq == 2
    state = ccpin.ReducedModel(mechanism).at([np.cos(0.3), np.sin(0.3)] if circle else [0.3])
    rates = {joint.name: state.rho[joint.v.start, 0] for joint in mechanism.tree.joints}
    assert mechanism.n == 1
    assert np.isclose(rates["A"], rates["D"])
    assert np.isclose(rates["B"], -rates["A"])


def test_the_page_names_every_format():
    """A format without a section is not documented."""
    for heading in ("## URDF", "## SDFormat", "## MJCF", "## toolbox-parallel-robots", "## Pinocchio"):
        assert heading in PAGE
