"""The closed loop as an explicit analytic differential equation (x, q̇)′ = f(x, q̇), on a tape.

    ẋ = Γ(x) ρ(x) q̇ (13),    d/dt q̇ = D⁻¹(τ − ρᵀ(D′b + C′q̇′ + B′q̇′ + g′)) (22),
    b = ρ̇q̇ = −ψ_q′⁻¹[φ̇_q′ q̇′; α̇_q′ q̇′] (35),

with x the numbers that hold q′ (`recorded_coordinates`; ẋ = Γ q̇′), τ the law's generalized force,
B′ the joints' dampers, springs in g′ and no dry friction. What is invariant along it, and what becomes of redundant
rows of φ, is in `ccpin/proof/theorems/enclosure.md`: where φ has more rows than its rank m, ψ_q′ is of m rows that are
independent at the start, and `Enclosure.left_open` bounds the others along the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from ccpin.arrays import Array
from ccpin.control.control_law import ControlLaw, idle, stated
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.kinematics.tree import Tree
from ccpin.programs.recording.ball_joints import BallAngle, BallTurn, ball_at, turn_rates, turn_rows, turns_of
from ccpin.programs.recording.recorded_coordinates import layout_of, numbers_of
from ccpin.programs.recording.recorded_forces import closure_terms, dynamic_terms, with_springs
from ccpin.programs.recording.recorded_laws import (
    efforts,
    law_terms,
    require_sampled,
    transmission,
)
from ccpin.programs.recording.recorded_tree import (
    ExactJoint,
    Table,
    closure_rows,
    exact,
    exact_joints,
    poses,
    rates,
    rational,
)
from ccpin.programs.tape import Expression, Tape
from ccpin.proof.digests import Part, digest, require_same
from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.arithmetic.programs import constant, in_balls
from ccpin.validated.loop_equations import ClosedLoopEquations, Upright, Wrapped


class ClosedLoop(NamedTuple):
    """A mechanism under a law, recorded.

    Attributes:
        equations: The programs over (x, q̇).
        joints: The joints, with their places in x.
        near: The numbers that angles on circles are counted from, of shape (n_x,).
        scalar: Whether q̇ is the rate of the numbers at `equations.independent`, one each.
        turns: Single turns of balls among q; their numbers come after the joints'.
    """

    equations: ClosedLoopEquations
    joints: tuple[ExactJoint, ...]
    near: Array
    scalar: bool
    turns: tuple[BallAngle, ...]

    def numbers(self, q_free: Array) -> Array:
        """The numbers x of a configuration of shape (nq,), rounded; angles within half a turn of those `near`."""
        return numbers_of(self.joints, q_free, self.near, self.turns)


def recorded_loop(
    model: ReducedModel, law: ControlLaw | None, near: Array | None = None, *, held: bool = False
) -> ClosedLoop:
    """Record a mechanism and its law at the current precision.

    Args:
        model: The reduced model.
        law: The law.
        near: A configuration of shape (nq,) about which the motion is, default the reference: where the rows of φ are
            chosen, and what angles on circles are counted from.
        held: With efforts held from sample to sample.

    Raises:
        UnsupportedMechanismError: The law is another than none and the two PD laws.
        DifferentSubjectsError: The law is of other closures than the model; one that computes g(q) itself, of other
            masses, springs or gravity. The constants of law (28) may be a nominal model's: it is then that law that is
            enclosed, on this plant.
    """
    told = stated(law)
    if told is not None and told.model is not None:
        parts: tuple[Part, ...] = ("closures",) if told.kind == "pd" else ("closures", "dynamics")
        require_same("an enclosure", told.model.digests, model.digests, *parts)
    mechanism, constraints = model.mechanism, model.parametrization.constraints
    near = mechanism.q_reference if near is None else near
    joints = exact_joints(mechanism.tree)
    q = layout_of(model.coordinates, joints)
    turns = turns_of(model.coordinates, joints, numbers_of(joints, near))
    about = numbers_of(joints, near, None, turns)
    n_x, n = len(about), model.n
    if held:
        require_sampled(law)
    tape = Tape(n_x + n + (model.n_actuated if held else 0))
    x, v, u = np.split(np.array(tape.inputs, dtype=object), [n_x, n_x + n])
    rows = closure_rows(tape, constraints, joints, x, about)
    kept, others = _independent_rows(model, near)
    phi = [rows[k] for k in kept]
    table = np.vstack([rates(tape, joints, x), turn_rates(tape, turns, x, mechanism.n_free)])
    motion = closure_terms(tape, phi, (x, v), table, q)
    frames = poses(tape, joints, x)
    terms = dynamic_terms(tape, mechanism.tree, joints, frames, motion, (x, v), exact(model.gravity_vector))
    sprung = _sprung(joints, mechanism.tree, about)
    terms = with_springs(tape, terms, mechanism.tree, sprung, x, motion.rho)
    does = law_terms(tape, law, q, (x, v), terms, about)
    across = transmission(model, motion.rho)
    wanted = efforts(tape, across, does.force) if told is not None and not told.idle else []
    force = does.force if not held else u if across is None else across @ u
    acceleration = tape.solve(terms.mass, (force - terms.bias)[:, None])[:, 0]
    still = [0] * len(u)
    dependent = tuple(k for k in range(n_x) if k not in q.places)
    balls = (*(turn.ball for turn in turns), *(each for each in sprung if isinstance(each, BallTurn)))
    equations = ClosedLoopEquations(
        n_x,
        n,
        q.places,
        field=in_balls(tape, [*motion.x_rate, *acceleration, *still], () if held else wanted),
        closure=in_balls(tape, [*phi, *_unit_lengths(joints, x, dependent), *turn_rows(tape, turns, x)]),
        jacobian=in_balls(tape, motion.jacobian.ravel()),
        drift=in_balls(tape, [*motion.x_rate, *[0] * n, *still]),
        energies=in_balls(tape, [terms.kinetic, terms.potential]),
        left_out=in_balls(tape, [rows[k] for k in others]) if others else None,
        lyapunov=None if does.lyapunov is None else in_balls(tape, [does.lyapunov]),
        efforts=in_balls(tape, list(wanted)) if held else None,
        wrapped=tuple(Wrapped(place, constant(tape, target)) for place, target in does.wrapped.items()),
        upright=tuple(map(_upright, balls)),
        free=_freely_moved(model) if idle(law) and not turns and not others else "",
    )
    return ClosedLoop(equations, joints, about, q.scalar, turns)


def _upright(turn: BallTurn) -> Upright:
    """That a ball is turned by less than half a turn, which the programs rest on."""
    entries = [ball(float(entry)) for entry in turn.reference]
    length = sum((entry * entry for entry in entries), ball(0)).sqrt()
    return Upright(turn.joint.x.stop - 4, tuple(entry / length for entry in entries))


def _freely_moved(model: ReducedModel) -> str:
    """Of which mechanism a motion without torque is: a digest of all but its coordinates and motors."""
    mechanism = model.mechanism
    masses = [(body.mass, body.lever, body.inertia) for body in mechanism.tree.model.inertias]
    moved = {name: getattr(mechanism.joints, name) for name in ("damping", "stiffness", "spring_reference", "armature")}
    closures = (*mechanism.closures, *mechanism.locks), mechanism.couplings
    return digest((mechanism.tree, closures, masses, moved, model.gravity_vector))


def _independent_rows(model: ReducedModel, near: Array) -> tuple[list[int], list[int]]:
    """Rows of φ that are independent at a configuration, as many as its rank, and the others; all where none is."""
    constraints, rank = model.parametrization.constraints, model.mechanism.n_free - model.n
    if constraints.size == rank:
        return list(range(rank)), []
    order = qr(constraints.value(near).jacobian.T, mode="r", pivoting=True)[1].tolist()
    return sorted(order[:rank]), sorted(order[rank:])


def _sprung(joints: Sequence[ExactJoint], tree: Tree, near: Array) -> list[ExactJoint | BallTurn]:
    """The joints with springs; of balls their turn from no rotation."""
    stiff = (joint for joint in joints if tree.joints[joint.number - 1].stated.stiffness)
    return [ball_at(joint, np.array([0.0, 0.0, 0.0, 1.0]), near) if joint.kind.unit else joint for joint in stiff]


def _unit_lengths(joints: tuple[ExactJoint, ...], x: Table, dependent: tuple[int, ...]) -> list[Expression]:
    """½(|p|² − 1) of the quaternions p among the dependent numbers."""
    found, half = list[Expression](), rational(0.5)
    for joint in joints:
        if joint.kind.unit == 4 and joint.x.stop - 1 in dependent:
            p = x[joint.x][-4:]
            found.append((p @ p) * half - half)
    return found
