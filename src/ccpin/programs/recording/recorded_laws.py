"""Laws on a tape: set points as constants, which validated integration knows, and references that move as inputs."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.control_law import ControlLaw, stated
from ccpin.control.references import ReferenceState
from ccpin.control.statements import Statement
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.programs.recording.recorded_coordinates import StateLayout
from ccpin.programs.recording.recorded_forces import DynamicTerms
from ccpin.programs.recording.recorded_tree import Table, exact, rational
from ccpin.programs.tape import Expression, Tape
from ccpin.proof.digests import Part, require_same

CoriolisAlong = Callable[[Table], Table]


class LawTerms(NamedTuple):
    """What a law does.

    Attributes:
        force: The generalized force ρᵀSᵀu, of shape (n,).
        lyapunov: 𝒱 + V(q_d) with the law's own g(q_d), or ``None``.
        wrapped: Of angles that it reads on circles, by their place in x: q_d's, less than half a turn away.
    """

    force: Table
    lyapunov: Expression | None
    wrapped: dict[int, Expression]


def law_terms(
    tape: Tape, law: ControlLaw | None, q: StateLayout, state: tuple[Table, Table], terms: DynamicTerms, near: Array
) -> LawTerms:
    """A law's force; angles on circles are counted from the numbers `near`.

    Where motors do not sit on the independent joints, the laws' u has ρᵀSᵀu = this force wherever ρᵀSᵀ has full rank.

    Raises:
        UnsupportedMechanismError: Another law.
    """
    told, (x, v) = stated(law), state
    if told is not None and told.idle:
        return LawTerms(np.zeros(len(v), dtype=object), None, {})
    if told is None or not told.holds or told.kind not in ("pd", "pd_gravity"):
        raise UnsupportedMechanismError(
            f"enclosures know PDSimpleGravity, PDFullGravity and no torque, not {type(law).__name__}"
        )
    goal, wrapped = _goal(tape, told, q, near)
    still, told = np.zeros(len(v), dtype=object), told._replace(constant=exact(told.constant))
    force = reference_force(told, ReferenceState(goal, still, still), (x[list(q.places)], v), terms)
    if told.kind == "pd_gravity":
        return LawTerms(force, None, wrapped)
    error, half = goal - x[list(q.places)], rational(0.5)
    stored = error @ told.constant + half * (error @ (exact(told.K_p) @ error))
    return LawTerms(force, terms.kinetic + terms.potential + stored, wrapped)


def recorded_law(law: ControlLaw | None, model: ReducedModel) -> Statement:
    """What a law of which a program is recorded states.

    Raises:
        InvalidInputError: No law, or no torque.
        UnsupportedMechanismError: One that does not state itself.
        DifferentSubjectsError: It is of other closures than the model; one that computes with D, C or g itself, of
            other masses, springs or gravity.
    """
    if law is None:
        raise InvalidInputError("'torque' and 'lyapunov' are a law's: give law=")
    told = stated(law)
    if told is None or told.kind == "adaptive" or (told.kind == "constant" and not told.idle):
        raise UnsupportedMechanismError(
            "programs know PDSimpleGravity, PDFullGravity, PDOnlineGravity, PDPlus and ComputedTorque, not "
            f"{type(law).__name__}"
        )
    if told.model is None:
        raise InvalidInputError("the law is no torque at all: there is nothing to record")
    parts: tuple[Part, ...] = ("closures",) if told.kind == "pd" else ("closures", "dynamics")
    require_same("a program of a law", told.model.digests, model.digests, *parts)
    return told


def reference_force(
    told: Statement,
    wanted: ReferenceState,
    state: tuple[Table, Table],
    terms: DynamicTerms,
    along: CoriolisAlong | None = None,
) -> Table:
    """The generalized force of a law (`Statement`) with q_d, q̇_d and q̈_d as expressions, of shape (n,).

    Args:
        told: The law; its constant is of expressions.
        wanted: The reference, q_d in the numbers of q, circles in q's turn.
        state: The numbers of q, and q̇.
        terms: D, the bias force and g.
        along: (C + damping) times a velocity, which PD+ asks for.
    """
    q, v = state
    error, rate = wanted.q - q, wanted.v - v
    if told.kind == "computed_torque":
        return terms.mass @ (wanted.a + exact(told.K_v) @ rate + exact(told.K_p) @ error) + terms.bias
    feedback = exact(told.K_p) @ error + exact(told.K_v) @ rate
    if told.kind == "pd":
        return feedback + told.constant
    if told.kind == "pd_gravity":
        return feedback + terms.gravity
    assert along is not None
    return feedback + terms.mass @ wanted.a + along(wanted.v) + terms.gravity


def goal_of(tape: Tape, law: Statement, q: StateLayout, near: Array) -> Table:
    """A constant q_d in the numbers of q, exact."""
    return _goal(tape, law, q, near)[0]


def _goal(tape: Tape, law: Statement, q: StateLayout, near: Array) -> tuple[Table, dict[int, Expression]]:
    """q_d in the numbers of q, exact."""
    assert law.model is not None  # a set-point law has both
    assert law.reference is not None
    goal, wrapped = list[Any](), dict[int, Expression]()
    for part in law.model.coordinates.parts:
        values = exact(law.reference.start[part.q]).tolist()
        if len(goal) in q.circles:
            place = q.places[len(goal)]
            wrapped[place] = _angle(tape, values, float(near[place]))
            values = [wrapped[place]]
        goal += values
    return np.array(goal, dtype=object), wrapped


def _angle(tape: Tape, values: list[Fraction], near: float) -> Expression:
    """An angle, or that of a point (cosine, sine), less the whole turns that bring it within half a turn of another."""
    angle, about = (values[0], float(values[0])) if len(values) == 1 else (tape.angle(*values[::-1]), _turned(*values))
    turns = round((near - about) / math.tau)
    return angle + tape.angle(0, -1) * (2 * turns) if turns else angle


def _turned(cosine: Fraction, sine: Fraction) -> float:
    return math.atan2(float(sine), float(cosine))


def transmission(model: ReducedModel, rho: Table) -> Table | None:
    """ρᵀSᵀ, of shape (n, motors); ``None`` where u acts on q itself."""
    return None if model.actuation is None else rho.T @ exact(model.actuation).T


def efforts(tape: Tape, across: Table | None, force: Table) -> Table:
    """The u of least norm with ρᵀSᵀu = a force; it exists only where ρᵀSᵀ has full rank."""
    if across is None:
        return force
    if across.shape[0] == across.shape[1]:
        return tape.solve(across, force[:, None])[:, 0]
    return across.T @ tape.solve(across @ across.T, force[:, None])[:, 0]


def require_sampled(law: ControlLaw | None) -> Statement:
    """A law that can be sampled and held.

    Raises:
        UnsupportedMechanismError: Another law than (28).
    """
    told = stated(law)
    if told is None or told.kind != "pd":
        raise UnsupportedMechanismError(
            f"a sampled loop is enclosed under PDSimpleGravity only, not under {type(law).__name__}"
        )
    return told
