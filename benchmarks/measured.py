"""What every part of the benchmarks is given, and what it gives back."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

NATIVE, NUMPY = "native", "numpy"
PINOCCHIO, LCABA, LOOP = "constraintDynamics", "lcaba", "loop over constraintDynamics"
MUJOCO, DRAKE = "MuJoCo", "Drake"


class Measured(NamedTuple):
    """One figure.

    Attributes:
        part: Which part of the benchmarks it is of.
        subject: What was measured: a mechanism, or a family of them.
        quantity: What of it.
        who: Who computed it.
        value: The figure; ``None`` where there is none, and `note` says why.
        unit: ``"s"``, ``"MB"``, ``"rad"`` …; ``""`` for a pure number.
        ratio: To the peer's time, the median over rounds of both taken in turn; ``None`` where nothing is compared.
        note: Settings, or why there is no figure.
    """

    part: str
    subject: str
    quantity: str
    who: str
    value: float | None
    unit: str = "s"
    ratio: float | None = None
    note: str = ""


class Options(NamedTuple):
    """How much to measure.

    Attributes:
        models: Installed models' names, or files; those that do not exist are skipped with a word.
        sizes: Numbers of four-bars in the families.
        peer_joints: The largest family member, in joints, that peers are asked for (Pinocchio's Data grows as n′³).
        numpy_joints: The largest one that the NumPy reference is asked for.
        rows: Of a batch.
        rounds: How often everything is timed in turn.
        slice_seconds: How long one timing takes at least; calls are repeated until then.
        deep: Also what takes minutes (whole maps; loads of every size).
    """

    models: tuple[str, ...] = ("rpdr", "delta", "stewart")
    sizes: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64, 133)
    peer_joints: int = 100
    numpy_joints: int = 100
    rows: int = 100_000
    rounds: int = 15
    slice_seconds: float = 0.01
    deep: bool = True

    @classmethod
    def smallest(cls) -> Options:
        """Enough to see that every part works."""
        return cls(("rpdr",), (1, 2), rows=20, rounds=1, slice_seconds=0.0, deep=False)


def short_name(model: str) -> str:
    """A model's name in the table: a file's without its folder and ending."""
    return Path(model).stem
