"""What the closures make of q̇, and the forces of inertia, gravity, springs and dampers, on a tape.

Inertial forces are projected body by body (Kane's form): with c the centre of mass, J_c and J_ω the partial
velocities along the columns of ρ, D = Σ m J_cᵀJ_c + J_ωᵀ I J_ω + ρᵀ diag(rotor inertias) ρ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import cross
from ccpin.programs.recording.ball_joints import BallTurn
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_coordinates import StateLayout
from ccpin.programs.recording.recorded_tree import ExactJoint, Table, rational, unit_axes
from ccpin.programs.tape import Expression, Tape, is_zero


class ClosureTerms(NamedTuple):
    """ψ_q′ without its rows of single entries, ρ, q̇′, b and ẋ."""

    jacobian: Table
    rho: Table
    v_free: Table
    bias: Table
    x_rate: Table


class DynamicTerms(NamedTuple):
    """D, ρᵀ(D′b + C′q̇′ + B′q̇′ + g′), g, and the energies."""

    mass: Table
    bias: Table
    gravity: Table
    kinetic: Expression
    potential: Expression


def closure_terms(
    tape: Tape, phi: Sequence[Expression], state: tuple[Table, Table], table: Table, q: StateLayout
) -> ClosureTerms:
    """ρ, q̇′ and b (35) from ψ_q′ = [φ_q′; α_q′] and Γ: rows of α_q′ that are single entries are solved beforehand."""
    v = state[1]
    (size, n_free), n = table.shape, len(v)
    slopes = np.array([tape.derivative(phi, {k: 1}) for k in range(size)], dtype=object).reshape(size, len(phi)).T
    known = [k for k in q.velocities if k >= 0]
    entries = [i for i, k in enumerate(q.velocities) if k >= 0]
    others = [(i, -1 - k) for i, k in enumerate(q.velocities) if k < 0]
    psi = np.vstack([slopes @ table, *(table[[place]] for _, place in others)])
    rest = [k for k in range(n_free) if k not in known]
    right = np.zeros((len(psi), n), dtype=object)
    right[: len(phi), entries] = -psi[: len(phi), known]
    for row, (i, _) in enumerate(others, start=len(phi)):
        right[row, entries] = -psi[row, known]
        right[row, i] = 1
    jacobian = psi[:, rest]
    rho, bias = np.zeros((n_free, n), dtype=object), np.zeros(n_free, dtype=object)
    rho[known, entries] = 1
    rho[rest] = tape.solve(jacobian, right)
    v_free = rho @ v
    x_rate = table @ v_free
    along = dict(enumerate(x_rate.tolist()))  # q̇′ is held below, and not what Γ makes of it
    if q.scalar:
        x_rate[list(q.places)] = v
    moving = [*tape.derivative(phi, along), *(along[place] for _, place in others)]
    turned = np.array(tape.derivative(moving, along), dtype=object)
    bias[rest] = tape.solve(jacobian, -turned[:, None])[:, 0]
    return ClosureTerms(jacobian, rho, v_free, bias, x_rate)


def dynamic_terms(
    tape: Tape,
    constants: Constants,
    joints: Sequence[ExactJoint],
    frames: dict[int, Table],
    motion: ClosureTerms,
    state: tuple[Table, Table],
) -> DynamicTerms:
    """D, bias force, gravity's force and energies, body by body and joint by joint, without springs."""
    v, gravity = state[1], constants.gravity()
    n = len(v)
    mass, bias, weight = (np.zeros(shape, dtype=object) for shape in ((n, n), n, n))
    potential: Expression = 0
    for joint, body in zip(joints, _body_rates(tape, joints, frames, motion), strict=True):
        rotation, position = frames[joint.number][:3, :3], frames[joint.number][:3, 3]
        m, local, tensor = constants.body(tape, joint)
        lever = rotation @ local
        partial = body.velocity[:n] + cross(body.omega[:n], lever)
        turns = body.omega @ rotation
        turning, omega, alpha = turns[:n], turns[n], body.alpha @ rotation
        whirl = cross(body.omega[n], cross(body.omega[n], lever))
        acceleration = body.acceleration + cross(body.alpha, lever) + whirl
        moment = tensor @ alpha + cross(omega, tensor @ omega)
        potential = potential - m * (gravity @ (position + lever))
        weight = weight - (partial @ gravity) * m
        bias = bias + (partial @ acceleration) * m + turning @ moment
        mass = mass + (partial @ partial.T) * m + turning @ tensor @ turning.T
        damping = constants.damping(joint)
        for place in range(joint.v.start, joint.v.stop):
            row, rotor = motion.rho[place], constants.armature(joint, place)
            mass = mass + np.outer(row, row) * rotor
            bias = bias + row * rotor * motion.bias[place]
            if not is_zero(damping):
                bias = bias + row * (motion.v_free[place] * damping)
    mass = np.tril(mass) + np.tril(mass, -1).T  # equal expressions: recorded once
    return DynamicTerms(mass, bias + weight, weight, rational(0.5) * (v @ (mass @ v)), potential)


def with_springs(
    tape: Tape,
    terms: DynamicTerms,
    constants: Constants,
    sprung: Sequence[tuple[ExactJoint | BallTurn, float]],
    x: Table,
    rho: Table,
) -> DynamicTerms:
    """The terms with the joints' springs: ½ k (θ − θ₀)², and ½ k |r|² of balls, whose moment is k r."""
    potential, weight, half = terms.potential, np.zeros(rho.shape[1], dtype=object), rational(0.5)
    for each, reference in sprung:
        joint = each.joint if isinstance(each, BallTurn) else each
        if isinstance(each, BallTurn):
            vector, cosine = each.relative(tape, x)
            stretch = vector * tape.gain(tape.node(cosine))
        else:
            stretch = np.array([x[joint.x.start] - rational(reference)], dtype=object)
        pull = stretch * constants.stiffness(joint)
        potential = potential + half * (pull @ stretch)
        weight = weight + pull @ rho[joint.v]
    return terms._replace(potential=potential, gravity=terms.gravity + weight, bias=terms.bias + weight)


class _BodyRates(NamedTuple):
    """How a body moves, in world axes; with n columns of ρ, a row each, and q̇′ below them.

    Attributes:
        omega: Angular velocities, of shape (n + 1, 3).
        velocity: The origin's velocities, alike.
        alpha: ω̇ for q̇′ and q̈′ = b, of shape (3,).
        acceleration: The origin's acceleration, alike.
    """

    omega: Table
    velocity: Table
    alpha: Table
    acceleration: Table


def _body_rates(
    tape: Tape, joints: Sequence[ExactJoint], frames: dict[int, Table], motion: ClosureTerms
) -> list[_BodyRates]:
    """Every body's motion, by joint.

    With l and w a joint's own linear and angular velocity, P the parent and F the body,
    α_F = α_P + ω_P × w + ẇ and a_F = a_P + α_P × r + ω_P × (ω_P × r) + (ω_P + ω_F) × l + l̇.
    """
    columns = np.column_stack([motion.rho, motion.v_free])
    still = np.zeros((columns.shape[1], 3), dtype=object)
    found = {0: _BodyRates(still, still, still[0], still[0])}
    for joint in joints:
        omega, velocity, alpha, acceleration = found[joint.parent]
        arm = frames[joint.number][:3, 3] - frames[joint.parent][:3, 3]
        axes = _axes(tape, joint, frames)
        turns = np.array(joint.kind.slides) == np.False_
        own, change = columns[joint.v], motion.bias[joint.v]
        slid, turned = (own[which].T @ axes[which] for which in (~turns, turns))
        speeding, spinning = (change[which] @ axes[which] for which in (~turns, turns))
        later = omega + turned
        found[joint.number] = _BodyRates(
            later,
            velocity + cross(omega, arm) + slid,
            alpha + cross(omega[-1], turned[-1]) + spinning,
            acceleration
            + cross(alpha, arm)
            + cross(omega[-1], cross(omega[-1], arm))
            + cross(omega[-1] + later[-1], slid[-1])
            + speeding,
        )
    return [found[joint.number] for joint in joints]


def _axes(tape: Tape, joint: ExactJoint, frames: dict[int, Table]) -> Table:
    """A joint's axes in the world, of shape (nv, 3); those of plain steps are the same before and after they move."""
    if joint.turning_axes:
        return unit_axes(tape, joint) @ frames[joint.number][:3, :3].T
    return unit_axes(tape, joint) @ (frames[joint.parent][:3, :3] @ joint.placement[:3, :3]).T
