"""Base parameters: how many combinations of a mechanism's constants its motion shows, which, and what is proved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import qr

from ccpin.arrays import FrozenMapping, Indices, choice, instance, number, records, whole
from ccpin.dynamics.changed_constants import with_stribeck_speeds
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import CcpinError, UnsupportedMechanismError
from ccpin.identification.combinations.base_combinations import BaseParameters
from ccpin.identification.combinations.dependent_search import combinations_of, depend
from ccpin.identification.combinations.exact_spaces import doubles
from ccpin.identification.combinations.identification_equations import IdentificationEquations
from ccpin.identification.combinations.rank_claims import IndependentColumns, VanishingCombinations, stacked_forms
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.facts import Fact, prove
from ccpin.validated.arithmetic.balls import Ball, ball, flint
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.flow.start_search import proved_start

_SPREAD = 0.3  # rad or m about the reference, of states that are tried; halved until they can be closed
_SEED = 20011
_MOST_STATES = 64  # that are tried by default
_ROUNDED = 1e-9  # of a combination of length 1: nearer to others, and it is they that numbers' rounding keeps apart
_TINY = 1e-13  # of a pivot: what is smaller may be there by rounding of a file's numbers alone, and is not counted


def base_parameters(
    mechanism: Mechanism | ReducedModel,
    *,
    forces: Sequence[str] = (),
    base: bool = False,
    states: int | None = None,
    precision: int = 500,
    box: float | None = 0.05,
) -> BaseParameters:
    """How many combinations of a mechanism's constants its equations of motion show, proved as far as can be.

    What encoders of passive joints tell is q′, which closures make known anyway: they add no combination. Stribeck's
    friction, where a joint states it, is left out: what is counted are the combinations of all other constants.

    Args:
        mechanism: A mechanism, or a model with its gravity.
        forces: Closures and couplings whose constraint forces (all their λ) are measured besides the motors' efforts:
            a rod's axial force, what a ball joint carries.
        base: Whether the wrench between the ground and all that stands on it is measured, as a force plate does.
        states: How many closed states are tried; default half as many again as have to suffice where all of a state's
            forms differ, and twice as many as long as the last one still shows something new, up to 64.
        precision: In bits, of the arithmetic.
        box: Half-width (rad, m) of a box about the reference over which what structure does not show is to be proved
            to 1e-12, of three degrees of freedom at most; it is halved until it can be. ``None``: not asked.

    Raises:
        InvalidInputError: No mechanism is given, numbers that are none, or a closure that is none.
        UnsupportedMechanismError: λ is asked for where closures repeat one another: motion does not decide it.
        ConvergenceError: No closed state near the reference is proved.
        NotProvedError: The precision does not suffice for a state's rates.
        CcpinError: python-flint is not installed.
    """
    model, bits = model_of(mechanism), whole(precision, "precision", 53)
    model = with_stribeck_speeds(model, {j.name: 0.0 for j in model.mechanism.tree.joints if j.stated.stribeck_speed})
    wide = None if box is None else number(box, "box", "a positive number, or None", above=0.0)
    wanted, plate = None if states is None else whole(states, "states"), instance(base, "base", bool)
    names, fewer = _sensors(model, forces), dict[str, BaseParameters]()
    found = _bounds(model, (), False, wanted, bits, wide)
    steps = [(name, names[: k + 1], False) for k, name in enumerate(names)]
    for sensor, closures, held in [*steps, *[("base", names, True)] * plate]:
        fewer[sensor], found = found, _bounds(model, closures, held, wanted, bits, wide)
    return replace(found, fewer=FrozenMapping(fewer))


def _sensors(model: ReducedModel, forces: Sequence[str]) -> tuple[str, ...]:
    """Closures and couplings whose forces are measured, checked."""
    constraints = model.parametrization.constraints
    names = records(forces, "forces", str)
    for name in names:
        choice(name, "forces", tuple(constraints.row_slices()))
    if names and constraints.size > model.mechanism.n_free - model.n:
        raise UnsupportedMechanismError(
            f"{model.mechanism.name}: closures repeat one another, so that the motion does not decide their forces"
        )
    return tuple(dict.fromkeys(names))


def _bounds(
    model: ReducedModel, forces: tuple[str, ...], base: bool, states: int | None, bits: int, box: float | None
) -> BaseParameters:
    """What is proved with some sensors."""
    with flint().ctx.workprec(bits):
        equations, own = recorded_motions(model, forces, base)
        shown = prove(VanishingCombinations(equations, _apart(equations)))
        columns = BaseParameters(model.parameters, (shown,), FrozenMapping()).base
        count = states or _enough(len(columns), equations)
        while True:
            closed = _closed_states(model, equations, own, count, bits)
            forms = stacked_forms(equations, closed)
            rows, free = _independent(forms, columns.tolist(), bits)
            last = len(forms) - len(forms) // len(closed)
            if states is not None or count >= _MOST_STATES or max(rows, default=0) < last:
                break
            count = min(2 * count, _MOST_STATES)
        apart, others = np.sort(np.array(free, dtype=np.int64)), np.setdiff1d(columns, free)
        regrouped = combinations_of(forms, apart, others) if box is not None and len(others) else None
    independent = prove(
        IndependentColumns(equations, np.array(rows, dtype=np.int64), np.array(free, dtype=np.int64), np.array([bits])),
        *closed,
    )
    facts: tuple[Fact, ...] = (independent, shown)
    if regrouped is not None and box is not None:
        z = np.zeros((len(others), equations.sizes["P"]))
        z[np.arange(len(others)), others], z[:, apart] = 1.0, -regrouped.T
        fact = depend(equations, own.numbers(model.mechanism.q_reference), box, others, z)
        facts = facts if fact is None else (*facts, fact)
    return BaseParameters(model.parameters, facts, FrozenMapping())


def _apart(equations: IdentificationEquations) -> Indices:
    """Which combinations to choose: as many as are independent, and not by their numbers' rounding."""
    rows = doubles(equations.identities)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    triangle, order = qr(rows.T, mode="r", pivoting=True)
    return np.sort(order[: np.sum(np.abs(np.diagonal(triangle)) > _ROUNDED)]).astype(np.int64)


def _enough(columns: int, equations: IdentificationEquations) -> int:
    """States that may suffice: each has n(n + 1)/2 + n forms of masses and weights, n + 1 for each virtual motion."""
    n = equations.loop.n
    return 4 + (3 * columns) // (n * (n + 3) + 2 * equations.virtual * (n + 1))


def _closed_states(
    model: ReducedModel, equations: IdentificationEquations, own: Any, count: int, bits: int
) -> tuple[Fact, ...]:
    """Closed states about the reference, as facts: as many as there are of so many tried."""
    rng, found = np.random.default_rng(_SEED), list[Fact]()
    start, failed = model.alpha(model.mechanism.q_reference), None
    for _ in range(count):
        step, v = _SPREAD * rng.uniform(-1.0, 1.0, model.n), rng.uniform(-1.0, 1.0, model.n)
        for _ in range(6):
            try:
                x = own.numbers(model.at(model.coordinates.integrate(start, step)).q_free)
                q = boxed([ball(value) for value in x[list(equations.loop.independent)].tolist()], bits)
                found.append(proved_start(equations.loop, q, x, v, bits))
                break
            except CcpinError as error:
                step, failed = 0.5 * step, error
    if not found and failed is not None:
        raise failed
    return tuple(found)


def _independent(forms: Sequence[Sequence[Ball]], base: Sequence[int], bits: int) -> tuple[list[int], list[int]]:
    """Rows and columns of a minor that is not zero, by elimination row by row: a proposal."""
    left, pivots, rows, columns = list(base), list[tuple[int, list[Ball]]](), list[int](), list[int]()
    with flint().ctx.workprec(bits):
        for number, form in enumerate(forms):
            if not left:
                break
            row = dict(zip(base, (form[k] for k in base), strict=True))
            for column, pivot in pivots:
                factor = row.pop(column)
                if factor == 0:
                    continue
                for k, entry in pivot:
                    row[k] = row[k] - factor * entry
            sizes = [float(abs(row[k]).abs_lower()) for k in left]
            best = int(np.argmax(sizes))
            if sizes[best] > _TINY:
                column = left.pop(best)
                scale = 1 / row.pop(column)
                pivots.append((column, [(k, row[k] * scale) for k in left]))
                rows.append(number)
                columns.append(column)
    return rows, columns
