"""What a mechanism states and the smooth equations of motion (22) leave out, in words for the claims made of them.

Springs, dampers, rotors and gears are in the equations. Dry friction is not, nor is any limit: of a motor's effort, of
a joint's position (an end stop) or speed. A claim about motions that is proved from the equations is true of the
mechanism as stated only where none of these acts, so every such claim names them.
"""

from __future__ import annotations

import numpy as np

from ccpin.mechanism.mechanism import Mechanism


def rubbing(mechanism: Mechanism) -> tuple[str, ...]:
    """The joints that state dry friction."""
    return tuple(joint.name for joint in mechanism.tree.joints if joint.stated.friction)


def without_dry_friction(mechanism: Mechanism) -> str:
    """What is to be added to a sentence about smooth motions; empty where no joint states dry friction."""
    names = rubbing(mechanism)
    return f"; this is of the smooth equations, without the dry friction of {', '.join(names)}" if names else ""


def limits_left_out(mechanism: Mechanism) -> tuple[str, ...]:
    """The limits that are taken not to be met, a phrase for each kind; empty where the mechanism states none."""
    joints, (lower, upper) = mechanism.tree.joints, mechanism.position_limits
    stopped, quick = np.isfinite(lower) | np.isfinite(upper), np.isfinite(mechanism.joints.velocity)
    limited = np.isfinite(mechanism.motors.limits).any(axis=1)
    kinds = {
        "efforts of the motors on": [name for name, is_so in zip(mechanism.actuated, limited, strict=True) if is_so],
        "positions of": [joint.name for joint in joints if not joint.kind.unit and stopped[joint.q].any()],
        "speeds of": [joint.name for joint in joints if quick[joint.v].any()],
    }
    return tuple(f"the limits of the {kind} {', '.join(names)}" for kind, names in kinds.items() if names)
