"""The closed loop as an explicit analytic differential equation (x, q̇)′ = f(x, q̇), on a tape.

    ẋ = Γ(x) ρ(x) q̇ (13),    d/dt q̇ = D⁻¹(τ − ρᵀ(D′b + C′q̇′ + B′q̇′ + g′)) (22),
    b = ρ̇q̇ = −ψ_q′⁻¹[φ̇_q′ q̇′; α̇_q′ q̇′] (35),

with x the numbers that hold q′ (`recorded_coordinates`; ẋ = Γ q̇′), τ the law's generalized force,
B′ the joints' dampers, springs in g′ and no dry friction. What is invariant along it, and what becomes of redundant
rows of φ, is in `ccpin/proof/theorems/enclosure.md`: where φ has more rows than its rank m, ψ_q′ is of m rows that are
independent at the start, and `Enclosure.left_open` bounds the others along the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.control_law import ControlLaw, idle, stated
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.programs.recording.ball_joints import BallTurn
from ccpin.programs.recording.recorded_laws import efforts, law_terms, require_sampled, transmission
from ccpin.programs.recording.recorded_mechanism import Numbering, numbering, recorded_model
from ccpin.programs.tape import Tape
from ccpin.proof.digests import Part, digest, require_same
from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.arithmetic.programs import constant, in_balls
from ccpin.validated.loop_equations import ClosedLoopEquations, Upright, Wrapped


class ClosedLoop(NamedTuple):
    """A mechanism under a law, recorded.

    Attributes:
        equations: The programs over (x, q̇).
        own: The numbers x of the mechanism.
    """

    equations: ClosedLoopEquations
    own: Numbering


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
    mechanism = model.mechanism
    near = mechanism.q_reference if near is None else near
    own = numbering(model, near)
    n_x, n = len(own.near), model.n
    if held:
        require_sampled(law)
    tape = Tape(n_x + n + (model.n_actuated if held else 0))
    x, v, u = np.split(np.array(tape.inputs, dtype=object), [n_x, n_x + n])
    recorded = recorded_model(tape, model, own, (x, v), near)
    motion, terms = recorded.motion, recorded.terms
    does = law_terms(tape, law, own.q, (x, v), terms, own.near)
    across = transmission(model, motion.rho)
    wanted = efforts(tape, across, does.force) if told is not None and not told.idle else []
    force = does.force if not held else u if across is None else across @ u
    acceleration = tape.solve(terms.mass, (force - terms.bias)[:, None])[:, 0]
    still = [0] * len(u)
    equations = ClosedLoopEquations(
        n_x,
        n,
        own.q.places,
        field=in_balls(tape, [*motion.x_rate, *acceleration, *still], () if held else wanted),
        closure=in_balls(tape, recorded.closure),
        jacobian=in_balls(tape, motion.jacobian.ravel()),
        drift=in_balls(tape, [*motion.x_rate, *[0] * n, *still]),
        energies=in_balls(tape, [terms.kinetic, terms.potential]),
        left_out=in_balls(tape, [recorded.rows[k] for k in recorded.others]) if recorded.others else None,
        lyapunov=None if does.lyapunov is None else in_balls(tape, [does.lyapunov]),
        efforts=in_balls(tape, list(wanted)) if held else None,
        wrapped=tuple(Wrapped(place, constant(tape, target)) for place, target in does.wrapped.items()),
        upright=tuple(map(_upright, recorded.balls)),
        free=_freely_moved(model) if idle(law) and not own.turns and not recorded.others else "",
    )
    return ClosedLoop(equations, own)


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
