"""Four small mechanisms as people write them: rods between balls, a gripper of mimic joints, a gas spring."""

from pathlib import Path

from tests.support.places import ROOT

FILES = Path(__file__).parent / "files"
SHOWN = {"ankle": ROOT / "docs" / "howto"}
"""Those that a page of the documentation shows."""
NAMES = ("rssr", "ankle", "gripper", "gas_spring_leg")


def file(name):
    """The URDF of a name."""
    return SHOWN.get(name, FILES) / f"{name}.urdf"
