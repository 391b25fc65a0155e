"""Runs that live in the compiled core: its laws, under SciPy's RK45 and DOP853 with SciPy's own coefficients."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.integrate import DOP853, RK45

from ccpin.arrays import Array
from ccpin.control.laws import ControlLaw, ModelLaw, NoTorque, PDFullGravity, PDSimpleGravity
from ccpin.control.references import Hold, PiecewisePolynomial, PointToPoint, Waypoints
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus, TrackingLaw
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.mechanism.siblings import Measure
from ccpin.native import Declining
from ccpin.simulation.following import Following
from ccpin.simulation.trajectory import Status, Trajectory

_TRACKING: dict[type[ControlLaw], str] = {
    ComputedTorque: "computed_torque",
    PDPlus: "pd_plus",
    PDOnlineGravity: "pd_gravity",
}

_REFERENCES = (Hold, PointToPoint, Waypoints)  # themselves: a subclass may have another `at`


class _Piece(NamedTuple):
    """What the core answers: samples in the coordinates of one model (the first `done` rows), and how it ended.

    `end` holds the time it had come to, the step it would have taken next, (q, q̇) and q′ there.
    """

    done: int
    q: Array
    v: Array
    u: Array
    q_free: Array
    v_free: Array
    closure: Array
    status: Status | Literal["left"]
    settled_since: float
    evaluations: int
    end: tuple[float, float, Array, Array]


def simulate_in_core(
    model: ReducedModel,
    law: ControlLaw,
    method: str,
    guess: Array | None,
    run: dict[str, Any],
) -> Trajectory | None:
    """The trajectory, or ``None`` where the law, the method or the motion is not one the core can answer for.

    Args:
        model: The reduced model.
        law: The law.
        method: The integrator.
        guess: As for `simulate`.
        run: times (N,), start (q, q̇), rtol, atol, max_step, singular_rcond, a `Settling`'s fields (an empty goal: run
            to the end), wrenches (`wrench_rows`) and sampling (`SampledCommands.numbers`).
    """
    tableau, numbers = TABLEAUX.get(method), law_numbers(model, law)
    if tableau is None or numbers is None or isinstance(model.core, Declining):
        return None
    if type(law) is NoTorque and not len(run["goal"]) and run["sampling"] is None:
        return _passive(model, law, guess, run, tableau)
    run = run | _part(0.0, 0.0, np.inf, Measure(model.mechanism))
    answer = model.core.simulate(guess, numbers, run, tableau)
    return None if answer is None else _joined(model, run["times"], [_Piece(*answer)], 0, None)


def _passive(
    model: ReducedModel, law: NoTorque, guess: Array | None, run: dict[str, Any], tableau: dict[str, Any]
) -> Trajectory | None:
    """A motion without torques, piece by piece in the coordinates that follow it."""
    following, times = Following(model, law), run["times"]
    state, v = model.at(run["start"][: model.nq], guess), run["start"][model.nq :]
    following.begin(state)
    pieces: list[_Piece] = []
    t, step, done, stop = 0.0, 0.0, 0, None
    while stop is None:
        run = run | _part(t, step, following.most, following.measure)
        run |= {"times": times[done:], "start": np.concatenate([state.q, v])}
        answer = following.model.core.simulate(state.q_free, {"kind": "none"}, run, tableau)
        if answer is None:
            return None
        pieces.append(_Piece(*answer))
        done += pieces[-1].done
        if pieces[-1].status != "left":
            break
        t, step, end, q_free = pieces[-1].end
        state, v = following.model.at(end[: following.model.nq], q_free), end[following.model.nq :]
        changed = following.change(state, v)
        if changed is None:
            stop = following.why(t, state, "the motion cannot go on in any independent coordinates")
        else:
            state, v = changed
    return _joined(model, times, pieces, following.changes, stop)


def _part(t: float, step: float, most: float, measure: Measure) -> dict[str, Any]:
    """Where a run begins, its first step (0: chosen), and when its coordinates are left."""
    return {
        "begin": t,
        "first_step": step,
        "most_leverage": most,
        "row_weights": measure.rows.tolist(),
        "column_weights": measure.columns.tolist(),
    }


def _joined(model: ReducedModel, times: Array, pieces: list[_Piece], changes: int, stop: str | None) -> Trajectory:
    """The pieces one after the other, in the coordinates of the model."""
    columns = {
        name: np.concatenate([getattr(piece, name)[: piece.done] for piece in pieces])
        for name in ("q_free", "v_free", "closure")
    }
    first, alpha, slope = pieces[0], model.coordinates.alpha, model.coordinates.jacobian
    later = slice(first.done, None)
    q = [alpha(x) for x in columns["q_free"][later]]
    v = [slope(x) @ w for x, w in zip(columns["q_free"][later], columns["v_free"][later], strict=True)]
    t, last = np.array(times[: len(columns["q_free"])]), pieces[-1]
    message = (
        stop
        or {
            "finished": f"simulated {t[-1]:.6g} s",
            "settled": f"settled since t = {last.settled_since:.6g} s",
            "interrupted": f"interrupted at t = {t[-1]:.6g} s",
        }[last.status]
    )
    return Trajectory(
        t,
        np.vstack([first.q[: first.done], *q]),
        np.vstack([first.v[: first.done], *v]),
        np.vstack([first.u[: first.done], *np.zeros((len(q), model.n_actuated))]),
        columns["q_free"],
        columns["closure"],
        "singular" if last.status == "left" else last.status,
        message,
        sum(piece.evaluations for piece in pieces),
        columns["v_free"],
        changes,
    )


def law_numbers(model: ReducedModel, law: ControlLaw) -> dict[str, Any] | None:
    """A law in plain numbers: its kind, gains, constant part and reference; ``None`` where the core has none."""
    n, kind = model.n, type(law)
    if kind is NoTorque:
        return {"kind": "none"}
    if not isinstance(law, ModelLaw) or law.model.mechanism is not model.mechanism:
        return None
    if not np.array_equal(law.model.gravity_vector, model.gravity_vector):
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
