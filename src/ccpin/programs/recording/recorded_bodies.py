"""Inertia and force of a tree of bodies on a tape, each in its own body's axes, where masses and levers are constants.

With r the arm from the parent's origin and R the turn, in the parent's axes; l, w a joint's own linear and angular
velocity in the body's; carried ω = Rᵀω_P:

    ω = Rᵀω_P + w,    α = Rᵀα_P + (Rᵀω_P) × w + ẇ,    a = Rᵀ(a_P + W_P r) + (Rᵀω_P + ω) × l + l̇,

where W = [α]× + ωωᵀ − |ω|² I takes a point of the body to its acceleration beside the origin's. A body of mass m, first
moment h = ∫ρ dm and E = ∫ρρᵀ dm about its origin asks for

    f = m a + W h,    n = h × a + ∫ρ × Wρ dm,    (∫ρ × Wρ dm)_i = (W E)_kj − (W E)_jk, i, j, k in turn.

D′ is that of composite bodies: of all that a joint carries, h and E in its own axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import cross
from ccpin.programs.recording.recorded_tree import ExactJoint, Table
from ccpin.programs.tape import Expression


class CarriedBody(NamedTuple):
    """A body and the joint that carries it.

    Attributes:
        joint: The joint.
        rotation: R, its axes in its parent's.
        arm: r, its origin in its parent's axes.
        axes: Of the joint, in its own axes, of shape (nv, 3).
        mass: m.
        moment: h, of shape (3,).
        spread: E, of shape (3, 3).
        trace: Of E.
    """

    joint: ExactJoint
    rotation: Table
    arm: Table
    axes: Table
    mass: Expression
    moment: Table
    spread: Table
    trace: Expression


def joint_forces(bodies: Sequence[CarriedBody], v_free: Table, a_free: Table, base: Table) -> Table:
    """D′q̈′ + C′q̇′ where the base accelerates, of shape (n′,): minus gravity makes it + g′."""
    nothing = np.zeros(3, dtype=object)
    omega, alpha, speed = {0: nothing}, {0: nothing}, {0: base}
    turning = {0: _turning(nothing, nothing)}
    for body in bodies:
        j, p, R = body.joint.number, body.joint.parent, body.rotation
        slides = np.array(body.joint.kind.slides)
        rates, changes, axes = v_free[body.joint.v], a_free[body.joint.v], body.axes
        slid, turned = rates[slides] @ axes[slides], rates[~slides] @ axes[~slides]
        carried = omega[p] @ R
        omega[j] = carried + turned
        alpha[j] = alpha[p] @ R + cross(carried, turned) + changes[~slides] @ axes[~slides]
        drawn = (speed[p] + turning[p] @ body.arm) @ R
        speed[j] = drawn + cross(carried + omega[j], slid) + changes[slides] @ axes[slides]
        turning[j] = _turning(omega[j], alpha[j])
    force, moment = ({body.joint.number: nothing for body in bodies} | {0: nothing} for _ in range(2))
    found = np.zeros(len(v_free), dtype=object)
    for body in reversed(bodies):
        j, p = body.joint.number, body.joint.parent
        W, a = turning[j], speed[j]
        spun = W @ body.spread
        whirl = np.array([spun[2, 1] - spun[1, 2], spun[0, 2] - spun[2, 0], spun[1, 0] - spun[0, 1]], dtype=object)
        f = force[j] + a * body.mass + W @ body.moment
        n = moment[j] + cross(body.moment, a) + whirl
        found[body.joint.v] = _along(body, f, n)
        f = body.rotation @ f
        force[p], moment[p] = force[p] + f, moment[p] + body.rotation @ n + cross(body.arm, f)
    return found


def joint_weights(bodies: Sequence[CarriedBody], gravity: Table, n_free: int) -> Table:
    """g′, of shape (n′,): what a joint carries beyond its body hangs, in the body's axes, at that joint's arm."""
    found, nothing = np.zeros(n_free, dtype=object), np.zeros(3, dtype=object)
    up = {0: -gravity}
    for body in bodies:
        up[body.joint.number] = up[body.joint.parent] @ body.rotation
    masses = {body.joint.number: body.mass for body in bodies} | {0: 0}
    levers = {body.joint.number: body.moment for body in bodies} | {0: nothing}
    moments = dict.fromkeys(up, nothing)
    for body in reversed(bodies):
        j, p = body.joint.number, body.joint.parent
        moment = moments[j] + cross(levers[j], up[j])
        found[body.joint.v] = _along(body, up[j] * masses[j], moment)
        masses[p] = masses[p] + masses[j]
        levers[p] = levers[p] + body.arm * masses[j]
        moments[p] = moments[p] + body.rotation @ moment
    return found


def joint_masses(bodies: Sequence[CarriedBody], n_free: int) -> Table:
    """D′ without rotors, of shape (n′, n′)."""
    by_number = {body.joint.number: body for body in bodies}
    whole = dict(by_number)
    for body in reversed(bodies):
        own, parent = whole[body.joint.number], whole.get(body.joint.parent)
        if parent is not None:
            R, r, m = own.rotation, own.arm, own.mass
            h = R @ own.moment
            across = np.outer(h, r)
            whole[body.joint.parent] = parent._replace(
                mass=parent.mass + m,
                moment=parent.moment + h + r * m,
                spread=parent.spread + R @ own.spread @ R.T + across + across.T + np.outer(r, r) * m,
                trace=parent.trace + own.trace + (h @ r) * 2 + (r @ r) * m,
            )
    found = np.zeros((n_free, n_free), dtype=object)
    for body in bodies:
        own = whole[body.joint.number]
        for k, (axis, slides) in enumerate(zip(own.axes, own.joint.kind.slides, strict=True)):
            place = own.joint.v.start + k
            f, n = (
                (axis * own.mass, cross(own.moment, axis))
                if slides
                else (cross(axis, own.moment), axis * own.trace - own.spread @ axis)
            )
            at: CarriedBody | None = own
            while at is not None:
                found[at.joint.v, place] = found[place, at.joint.v] = _along(at, f, n)
                f = at.rotation @ f
                n = at.rotation @ n + cross(at.arm, f)
                at = by_number.get(at.joint.parent)
    return found


def _along(body: CarriedBody, force: Table, moment: Table) -> Table:
    """A force and a moment at a body's origin as a joint's own, of shape (nv,)."""
    slides = body.joint.kind.slides
    return np.array([axis @ (force if s else moment) for axis, s in zip(body.axes, slides, strict=True)], dtype=object)


def _turning(omega: Table, alpha: Table) -> Table:
    """W = [α]× + ωωᵀ − |ω|² I."""
    x, y, z = omega
    a, b, c = alpha
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return np.array(
        [[-(yy + zz), xy - c, xz + b], [xy + c, -(xx + zz), yz - a], [xz - b, yz + a, -(xx + yy)]], dtype=object
    )
