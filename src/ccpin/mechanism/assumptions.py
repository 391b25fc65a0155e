"""What a mechanism states and the smooth equations of motion (22) leave out, in words for the claims made of them.

Springs, dampers, rotors and gears are in the equations. Dry friction is not, nor is any limit: of a motor's effort, of
a joint's position (an end stop) or speed. A claim about motions that is proved from the equations is true of the
mechanism as stated only where none of these acts, so every such claim names them.

The equations themselves suppose that every motion moves mass, D positive definite. It is so where every movable body
has mass and a rotational inertia that is positive definite: no kinetic energy then means bodies at rest, and q̇′ = 0.
"""

from __future__ import annotations

import numpy as np

from ccpin.mechanism.mechanism import Mechanism

_ROUNDING = 1e-12  # of the largest principal moment: one below is none


def rubbing(mechanism: Mechanism) -> tuple[str, ...]:
    """The joints that state dry friction."""
    return tuple(joint.name for joint in mechanism.tree.joints if joint.stated.breakaway_level)


def without_dry_friction(mechanism: Mechanism) -> str:
    """What is to be added to a sentence about smooth motions; empty where no joint states dry friction."""
    names = rubbing(mechanism)
    return f"; this is of the smooth equations, without the dry friction of {', '.join(names)}" if names else ""


def limits_left_out(mechanism: Mechanism) -> tuple[str, ...]:
    """The limits that are taken not to be met, a phrase for each kind; empty where the mechanism states none."""
    joints, (lower, upper) = mechanism.tree.joints, mechanism.position_limits
    stopped, quick = np.isfinite(lower) | np.isfinite(upper), np.isfinite(mechanism.joints.velocity)
    limited = np.asarray(np.isfinite(mechanism.motors.limits).any(axis=1))
    kinds = {
        "efforts of the motors on": [name for name, is_so in zip(mechanism.actuated, limited, strict=True) if is_so],
        "positions of": [joint.name for joint in joints if not joint.kind.unit and stopped[joint.q].any()],
        "speeds of": [joint.name for joint in joints if quick[joint.v].any()],
    }
    return tuple(f"the limits of the {kind} {', '.join(names)}" for kind, names in kinds.items() if names)


def massless(mechanism: Mechanism) -> tuple[str, ...]:
    """The joints whose bodies have no mass, or a rotational inertia that is not positive definite (to rounding)."""
    model, names = mechanism.tree.model, list[str]()
    for number, inertia in enumerate(model.inertias):
        moments = np.linalg.eigvalsh(inertia.inertia)
        if number and not (inertia.mass > 0.0 and moments[0] > _ROUNDING * moments[-1]):
            names.append(model.names[number])
    return tuple(names)


def mass_assumed(mechanism: Mechanism) -> tuple[str, ...]:
    """That D is positive definite, as a phrase, where `massless` bodies leave it open; else nothing."""
    names = massless(mechanism)
    if not names:
        return ()
    return (f"that every motion moves mass: {len(names)} bodies have no inertia of their own, as that of {names[0]}",)
