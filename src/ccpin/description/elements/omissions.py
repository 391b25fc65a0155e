"""What a description states and a format has no place for, in sentences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ccpin.description.joint_kinds import FIXED, JOINT_KINDS
from ccpin.description.model import MechanismDescription, Motor

_MANY = tuple(name for name, kind in JOINT_KINDS.items() if kind.nv > 1)
_MOST = 5  # names in one sentence


def _driven(description: MechanismDescription) -> list[Motor]:
    driven = description.actuated or ()
    return [motor for motor in description.motors if motor.joint in driven]


def _limited(field: str) -> Callable[[MechanismDescription], list[str]]:
    return lambda d: [j.name for j in d.joints if j.kind != FIXED and np.isfinite(getattr(j, field))]


def _independent(description: MechanismDescription) -> list[str]:
    """Those a reader would not find: where the motors are independent, in their order, it does."""
    marked = description.independent or ()
    return [] if marked == description.actuated else list(marked)


_STATED: dict[str, Callable[[MechanismDescription], list[str]]] = {
    "gravity": lambda d: [] if d.gravity == (0.0, 0.0, -9.81) else [" ".join(f"{g:g}" for g in d.gravity)],
    "the reference pose (load(reference=…) states it again)": lambda d: list(d.reference),
    "further poses": lambda d: list(d.poses),
    "which joints are independent (load(independent=…) states them again)": _independent,
    "motors (load(actuated=…, motors=…) states them again)": lambda d: list(d.actuated or ()),
    "bounds of motors": lambda d: [m.joint for m in _driven(d) if np.isfinite([m.lower, m.upper]).any()],
    "bounds of motors on one side": lambda d: [
        m.joint for m in _driven(d) if np.isfinite(m.lower) != np.isfinite(m.upper)
    ],
    "the loops closed around motors": lambda d: [f"{m.joint} ({m.kind})" for m in _driven(d) if m.kind != "motor"],
    "what the file tells MuJoCo's solver": lambda d: [
        *d.solver.options,
        *d.solver.flags,
        *(f"softness of {name}" for name in (*d.solver.equalities, *d.solver.joints)),
    ],
    "limits of effort of 0, and of joints of several velocities": lambda d: [
        j.name for j in d.joints if j.effort == 0.0 or (np.isfinite(j.effort) and j.kind in _MANY)
    ],
    "limits of velocity": _limited("velocity"),
    "breakaway levels and Stribeck speeds": lambda d: [j.name for j in d.joints if j.breakaway_level > j.friction],
    "limits of position on one side": lambda d: [
        j.name for j in d.joints if np.isfinite(j.lower) != np.isfinite(j.upper)
    ],
}
STATED = tuple(_STATED)


def left_out(description: MechanismDescription, format: str, *words: str) -> tuple[str, ...]:
    """A sentence for each of these things that the description states, naming the joints (or whatever) concerned.

    Args:
        description: What is written.
        format: The format's name.
        words: What it has no place for, each the start of an entry of `STATED`.
    """
    told = []
    for word in words:
        entry = next(entry for entry in _STATED if entry == word or entry.startswith(f"{word} ("))
        told += not_written(format, entry, _STATED[entry](description))
    return tuple(told)


def not_written(format: str, what: str, names: list[str]) -> list[str]:
    """One such sentence, or none where it concerns nobody."""
    if not names:
        return []
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return [f"{format} has no place for {what}: {', '.join(names[:_MOST])}{more}"]
