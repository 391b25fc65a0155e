"""Four small mechanisms as people write them: rods between balls, a gripper of mimic joints, a gas spring."""

from pathlib import Path

FILES = Path(__file__).parent / "files"
NAMES = ("rssr", "ankle", "gripper", "gas_spring_leg")


def file(name):
    """The URDF of a name."""
    return FILES / f"{name}.urdf"
