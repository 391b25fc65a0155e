"""Every kind of MJCF's actuators in the words of <general>, as MuJoCo's compiler reads them.

All kinds share one set of defaults, so that the k_p of a <position> in a default class is the gain of a <general>.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

_NAMES = "adhesion cylinder damper dcmotor general intvelocity motor muscle orientation pid plugin position velocity"
ACTUATORS = frozenset(_NAMES.split())
_FIRST_ORDER = {"cylinder": "filter", "intvelocity": "integrator"}


def as_general(tag: str, own: Mapping[str, str], inherited: Mapping[str, str]) -> dict[str, str]:
    """The attributes that an actuator or a default of that tag ends with, those it inherits being <general>'s."""
    values = {**inherited, **own}
    if tag == "general":
        return values
    gain = (values.get("gainprm") or "1").split()[0]
    _, _, rate = (*(values.get("biasprm") or "").split(), "0", "0", "0")[:3]
    kp, kv = own.get("kp") or gain, own.get("kv") or _negative(rate)
    dynamics, gains, gained, biased, bias = _FIRST_ORDER.get(tag, "none"), "fixed", "1", "none", "0 0 0"
    if tag in ("position", "intvelocity"):
        gained, biased, bias = kp, "affine", f"0 {_negative(kp)} {_negative(kv)}"
        dynamics = "filterexact" if tag == "position" and own.get("timeconst") else dynamics
    elif tag == "velocity":
        kv = own.get("kv") or gain
        gained, biased, bias = kv, "affine", f"0 0 {_negative(kv)}"
    elif tag == "damper":
        gains, gained = "affine", f"0 0 {_negative(own.get('kv') or '0')}"
    elif tag == "cylinder":
        gained = own.get("area") or gain
        if own.get("diameter"):
            gained = repr(0.25 * pi * float(own["diameter"].split()[0]) ** 2)
        biased, bias = "affine", own.get("bias") or "0 0 0"
    elif tag != "motor":
        dynamics, gains, biased = tag, tag, tag
        return values | {"dyntype": dynamics, "gaintype": gains, "biastype": biased}
    for key in ("kp", "kv"):
        values.pop(key, None)
    return values | {"dyntype": dynamics, "gaintype": gains, "gainprm": gained, "biastype": biased, "biasprm": bias}


def _negative(number: str) -> str:
    return number[1:] if number.startswith("-") else f"-{number.removeprefix('+')}"
