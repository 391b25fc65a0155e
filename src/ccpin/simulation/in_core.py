"""Runs that live in the compiled core: its laws, under SciPy's RK45 and DOP853 with SciPy's own coefficients."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853, RK45

from ccpin.arrays import Array
from ccpin.control.laws import ControlLaw, Delayed, ModelLaw, NoTorque, PDFullGravity, PDSimpleGravity, of_own
from ccpin.control.references import Hold, PiecewisePolynomial, PointToPoint, Waypoints
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus, TrackingLaw
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.native import Declining
from ccpin.simulation.budget import Budget
from ccpin.simulation.happenings import Moment
from ccpin.simulation.samples import Stop
from ccpin.simulation.settling import Settling

PLAIN = Settling(np.empty(0))._asdict() | {"origin": 0.0, "first_step": 0.0, "sampling": None, "leaving": None}
"""What a run is told that neither settles nor is sampled nor leaves its coordinates."""
_TRACKING: dict[type[ControlLaw], str] = {
    ComputedTorque: "computed_torque",
    PDPlus: "pd_plus",
    PDOnlineGravity: "pd_gravity",
}

_REFERENCES = (Hold, PointToPoint, Waypoints)  # themselves: a subclass may have another `at`


class Answer(NamedTuple):
    """What the compiled core answers: its first `done` rows hold samples.

    Attributes:
        done: How many samples there are. t, q, v, a, u, q_free, v_free, closure_error: the columns of
            these. a_free: the column of q̈′, of runs that may leave their coordinates alone.
        ended: How it ended: ``finished``, ``settled``, ``evaluations`` or ``seconds`` spent, ``interrupted``, or
            ``left``: where coordinates are to be left, or where only the reference can tell.
        since: Since when it is settled. evaluations: of the equations of motion.
        raised: What a signal's handler raised. memory: what a sampled loop remembers.
        time, state, place, first_step: Where it has come to: t, (q, q̇), q′, and the step it would take next (0: to be
            chosen). creeping: how many steps in a row were next to nothing.
    """

    done: int
    t: Array
    q: Array
    v: Array
    a: Array
    u: Array
    q_free: Array
    v_free: Array
    closure_error: Array
    a_free: Array
    ended: str
    since: float
    evaluations: int
    raised: BaseException | None
    memory: Any
    time: float
    state: Array
    place: Array
    first_step: float
    creeping: int


class CoreRun(NamedTuple):
    """A stretch of a motion that the core has integrated.

    Attributes:
        columns: The samples, by the fields of `StateSample` but friction and limits.
        stop: Why it ended before its time, or ``None``.
        evaluations: Of the equations of motion.
        memory: What a sampled loop remembers, for `SampledCommands.adopt`.
    """

    columns: dict[str, Any]
    stop: Stop | None
    evaluations: int
    memory: Any


def run_in_core(
    model: ReducedModel,
    law: ControlLaw,
    method: str,
    start: Moment,
    numbers: dict[str, Any],
    settling: Settling | None = None,
    budget: Budget | None = None,
) -> CoreRun | None:
    """A run from a start, or ``None`` where the law, the method or the motion is not one the core can answer for.

    Args:
        model: The reduced model.
        law: The law.
        method: The integrator.
        start: Where and when it begins.
        numbers: times (N,) of the samples, beginning at the start's, rtol, atol, max_step, singular_rcond, lower and
            upper bounds of u (a run that would go beyond is not the core's), wrenches (`wrench_rows`) and sampling
            (`SampledCommands.numbers`).
        settling: End once settled.
        budget: End once it is spent.
    """
    origin, law = (law.start, law.law) if isinstance(law, Delayed) else (0.0, law)
    tableau, told, nominal = TABLEAUX.get(method), law_numbers(model, law), _nominal(model, law)
    direct = model.actuation is None or (told == _no_torque(model) and numbers["sampling"] is None)
    if (
        tableau is None
        or told is None
        or not direct
        or (nominal is not None and isinstance(nominal.model.core, Declining))
    ):
        return None
    most = budget or Budget()
    times = numbers["times"]
    run = PLAIN | numbers | {"begin": times[0], "until": times[-1], "origin": origin}
    run |= {"start": np.concatenate([start.state.q, start.v])} | ({} if settling is None else settling._asdict())
    run |= {name: np.inf if value is None else value for name, value in most._asdict().items()}
    own = () if nominal is None else (nominal.model.core, of_own(nominal.model, start.state, nominal.near).q_free)
    answer = model.core.simulate(start.state.q_free, told, run, tableau, *own)
    if answer is None:
        return None
    found = Answer(*answer)
    names = ("t", "q", "v", "a", "u", "q_free", "v_free", "closure_error")
    columns = {name: getattr(found, name)[: found.done] for name in names}
    stop = _stop(found.ended, float(columns["t"][-1]), found.since, found.raised)
    return CoreRun(columns, stop, found.evaluations, found.memory)


def _stop(ended: str, t: float, since: float, raised: BaseException | None) -> Stop | None:
    """How the core's run ended, in the reference's words."""
    if ended == "finished":
        return None
    if ended == "settled":
        return Stop.settled(since)
    return Stop.exhausted(t, ended) if raised is None else Stop.broken_off(t, raised)


def law_numbers(model: ReducedModel, law: ControlLaw) -> dict[str, Any] | None:
    """A law in plain numbers: its kind, gains, constant part and reference; ``None`` where the core has none."""
    n, kind = model.n, type(law)
    if kind is NoTorque:
        return _no_torque(model)
    if not isinstance(law, ModelLaw) or "torque" in vars(law) or law.model.coordinates.nq != model.nq:
        return None
    if law.model.actuation is not None:
        return None
    if isinstance(law, PDSimpleGravity | PDFullGravity) and kind in (PDSimpleGravity, PDFullGravity):
        simple = isinstance(law, PDSimpleGravity)
        path = Hold(model, law.q_d).as_polynomial()
        constant = law.gravity_d if simple else np.zeros(n)
        return _numbers("pd" if simple else "pd_gravity", path, law.K_p, law.K_v, constant)
    if not isinstance(law, TrackingLaw) or kind not in _TRACKING or type(law.reference) not in _REFERENCES:
        return None
    found = law.reference.as_polynomial()
    return None if found is None else _numbers(_TRACKING[kind], found, law.K_p, law.K_v, np.zeros(n))


def _nominal(model: ReducedModel, law: ControlLaw) -> ModelLaw | None:
    """The law, where its model is another than the plant's."""
    if not isinstance(law, ModelLaw) or law.model is model:
        return None
    same = law.model.mechanism is model.mechanism and np.array_equal(law.model.gravity_vector, model.gravity_vector)
    return None if same else law


def _no_torque(model: ReducedModel) -> dict[str, Any]:
    """u = 0 in plain numbers; a constant law is one whatever the motors."""
    return {"kind": "constant", "constant": [0.0] * model.n_actuated}


def _numbers(kind: str, path: PiecewisePolynomial, K_p: Array, K_v: Array, constant: Array) -> dict[str, Any]:
    return {
        "kind": kind,
        "start": path.start.tolist(),
        "breaks": path.breaks.tolist(),
        "degree": path.coefficients.shape[1] - 1,
        "coefficients": path.coefficients.ravel().tolist(),
        "K_p": K_p.ravel().tolist(),
        "K_v": K_v.ravel().tolist(),
        "constant": constant.tolist(),
    }


def _rk45() -> dict[str, Any]:
    A = np.vstack([np.pad(RK45.A, ((0, 0), (0, 6 - RK45.A.shape[1]))), np.zeros((1, 6))])
    return _tableau(RK45, A, RK45.C, RK45.E, np.empty(0), RK45.P, extra=0)


def _dop853() -> dict[str, Any]:
    count = DOP853.A_EXTRA.shape[1]
    A = np.vstack([np.pad(DOP853.A, ((0, 0), (0, count - DOP853.A.shape[1]))), np.zeros((1, count)), DOP853.A_EXTRA])
    C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
    return _tableau(DOP853, A, C, DOP853.E5, DOP853.E3, DOP853.D, extra=len(DOP853.A_EXTRA))


def _tableau(method: Any, A: Array, C: Array, E: Array, E_low: Array, P: Array, extra: int) -> dict[str, Any]:
    return {
        "A": A.ravel().tolist(),
        "columns": A.shape[1],
        "B": method.B.tolist(),
        "C": C.tolist(),
        "E": E.tolist(),
        "E_low": E_low.tolist(),
        "P": P.ravel().tolist(),
        "extra": extra,
        "error_order": method.error_estimator_order,
    }


TABLEAUX = {"RK45": _rk45(), "DOP853": _dop853()}
