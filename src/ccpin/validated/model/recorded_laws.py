"""The laws that validated integration knows, on a tape."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.control_law import ControlLaw, stated
from ccpin.control.statements import Statement
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnsupportedMechanismError
from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.arithmetic.tape import Expression, Tape
from ccpin.validated.loop_equations import Wrapped
from ccpin.validated.model.recorded_coordinates import StateLayout, unwound
from ccpin.validated.model.recorded_forces import DynamicTerms
from ccpin.validated.model.recorded_tree import Table, exact


class LawTerms(NamedTuple):
    """What a law does.

    Attributes:
        force: The generalized force ρᵀSᵀu, of shape (n,).
        lyapunov: 𝒱 + V(q_d) with the law's own g(q_d), or ``None``.
        wrapped: The angles it reads on circles.
    """

    force: Table
    lyapunov: Expression | None
    wrapped: tuple[Wrapped, ...]


def law_terms(law: ControlLaw | None, q: StateLayout, x: Table, v: Table, terms: DynamicTerms, near: Array) -> LawTerms:
    """A law's force; angles on circles are counted from the numbers `near`.

    Where motors do not sit on the independent joints, the laws' u has ρᵀSᵀu = this force wherever ρᵀSᵀ has full rank.

    Raises:
        UnsupportedMechanismError: Another law.
    """
    told = stated(law)
    if told is not None and told.idle:
        return LawTerms(np.zeros(len(v), dtype=object), None, ())
    if told is None or not told.holds or told.kind not in ("pd", "pd_gravity"):
        raise UnsupportedMechanismError(
            f"validated integration knows PDSimpleGravity, PDFullGravity and no torque, not {type(law).__name__}"
        )
    goal, wrapped = _goal(told, q, near)
    error = goal - x[list(q.places)]
    spring = exact(told.K_p) @ error
    force = spring - exact(told.K_v) @ v
    if told.kind == "pd_gravity":
        return LawTerms(force + terms.gravity, None, wrapped)
    constant = exact(told.constant)
    half = flint().fmpq(1, 2)
    stored = error @ constant + half * (error @ spring)
    return LawTerms(force + constant, terms.kinetic + terms.potential + stored, wrapped)


def _goal(law: Statement, q: StateLayout, near: Array) -> tuple[Table, tuple[Wrapped, ...]]:
    """q_d in the numbers of q, exact."""
    assert law.model is not None  # a set-point law has both
    assert law.reference is not None
    goal, wrapped = list[Any](), list[Wrapped]()
    for part in law.model.coordinates.parts:
        values = exact(law.reference.start[part.q]).tolist()
        if len(goal) in q.circles:
            place = q.places[len(goal)]
            angle = ball(values[0]) if len(values) == 1 else flint().arb.atan2(ball(values[1]), ball(values[0]))
            values = [unwound(angle, float(near[place]))]
            wrapped.append(Wrapped(place, values[0]))
        goal += values
    return np.array(goal, dtype=object), tuple(wrapped)


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
