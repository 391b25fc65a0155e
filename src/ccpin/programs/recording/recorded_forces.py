"""What the closures make of q̇, and the forces of inertia, gravity, springs and dampers, on a tape.

D = ρᵀD′ρ and ρᵀ(D′b + C′q̇′ + B′q̇′ + g′) are projected from the free system's (`recorded_bodies`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.programs.recording.ball_joints import BallTurn
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_bodies import CarriedBody, joint_forces, joint_masses, joint_weights
from ccpin.programs.recording.recorded_closures import ClosureRows
from ccpin.programs.recording.recorded_coordinates import StateLayout
from ccpin.programs.recording.recorded_tree import ExactJoint, Table, rational, relative_motion, unit_axes
from ccpin.programs.tape import Expression, Tape


class ClosureTerms(NamedTuple):
    """ψ_q′ without its rows of single entries, ρ, q̇′, b and ẋ."""

    jacobian: Table
    rho: Table
    v_free: Table
    bias: Table
    x_rate: Table


class DynamicTerms(NamedTuple):
    """D, ρᵀ(D′b + C′q̇′ + B′q̇′ + g′), the same without g′, g, and the energies."""

    mass: Table
    bias: Table
    velocity: Table
    gravity: Table
    kinetic: Expression
    potential: Expression


def closure_terms(
    tape: Tape, rows: ClosureRows, state: tuple[Table, Table], table: Table, q: StateLayout
) -> ClosureTerms:
    """ρ, q̇′ and b (35) from ψ_q′ = [φ_q′; α_q′] and Γ: rows of α_q′ that are single entries are solved beforehand."""
    v = state[1]
    n_free, n = table.shape[1], len(v)
    known = [k for k in q.velocities if k >= 0]
    entries = [i for i, k in enumerate(q.velocities) if k >= 0]
    others = [(i, -1 - k) for i, k in enumerate(q.velocities) if k < 0]
    slopes = rows.slopes()
    psi = np.vstack([slopes, *(table[[place]] for _, place in others)])
    rest = [k for k in range(n_free) if k not in known]
    right = np.zeros((len(psi), n), dtype=object)
    right[: len(slopes), entries] = -psi[: len(slopes), known]
    for row, (i, _) in enumerate(others, start=len(slopes)):
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
    turned = [*rows.changes(v_free, along), *tape.derivative([along[place] for _, place in others], along)]
    bias[rest] = tape.solve(jacobian, -np.array(turned, dtype=object)[:, None])[:, 0]
    return ClosureTerms(jacobian, rho, v_free, bias, x_rate)


def dynamic_terms(
    tape: Tape,
    constants: Constants,
    joints: Sequence[ExactJoint],
    frames: dict[int, Table],
    motion: ClosureTerms,
    state: tuple[Table, Table],
) -> DynamicTerms:
    """D, bias force, gravity's force and energies, joint by joint and projected by ρ, without springs."""
    (x, v), gravity = state, constants.gravity()
    bodies, n_free = _bodies(tape, constants, joints, x), len(motion.rho)
    whole = joint_masses(bodies, n_free)
    rotors, losses = np.zeros(n_free, dtype=object), np.zeros(n_free, dtype=object)
    for joint in joints:
        for place in range(joint.v.start, joint.v.stop):
            rotors[place] = constants.armature(joint, place)
            whole[place, place] = whole[place, place] + rotors[place]
            losses[place] = constants.damping(joint)
    other = rotors * motion.bias + losses * motion.v_free
    moved = joint_forces(bodies, motion.v_free, motion.bias, np.zeros(3, dtype=object)) + other
    fallen = joint_forces(bodies, motion.v_free, motion.bias, -gravity) + other
    weight = joint_weights(bodies, gravity, n_free)
    mass = motion.rho.T @ (whole @ motion.rho)
    mass = np.tril(mass) + np.tril(mass, -1).T  # equal expressions: recorded once
    potential: Expression = 0
    for body in bodies:
        rotation, position = frames[body.joint.number][:3, :3], frames[body.joint.number][:3, 3]
        potential = potential - gravity @ (position * body.mass + rotation @ body.moment)
    kinetic = rational(0.5) * (v @ (mass @ v))
    return DynamicTerms(mass, motion.rho.T @ fallen, motion.rho.T @ moved, motion.rho.T @ weight, kinetic, potential)


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


def _bodies(tape: Tape, constants: Constants, joints: Sequence[ExactJoint], x: Table) -> list[CarriedBody]:
    """The bodies, parents first."""
    found = list[CarriedBody]()
    for joint in joints:
        moved, (m, lever, tensor) = relative_motion(tape, joint, x[joint.x]), constants.body(tape, joint)
        placed, moment = joint.placement[:3, :3], lever * m
        spread = np.eye(3, dtype=object) * (np.trace(tensor) * rational(0.5)) - tensor + np.outer(moment, lever)
        found.append(
            CarriedBody(
                joint, placed @ moved[:3, :3], joint.placement[:3, 3] + placed @ moved[:3, 3], unit_axes(tape, joint),
                m, moment, spread, spread[0, 0] + spread[1, 1] + spread[2, 2],
            )
        )  # fmt: skip
    return found
