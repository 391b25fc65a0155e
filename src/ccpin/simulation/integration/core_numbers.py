"""Laws and integrators as the compiled core takes them: in plain numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DOP853, RK45

from ccpin.arrays import Array
from ccpin.control.laws import ControlLaw, ModelLaw, NoTorque, PDFullGravity, PDSimpleGravity
from ccpin.control.references import Hold, PiecewisePolynomial, PointToPoint, Waypoints
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity, PDPlus, TrackingLaw
from ccpin.dynamics.reduced_model import ReducedModel

_TRACKING: dict[type[ControlLaw], str] = {
    ComputedTorque: "computed_torque",
    PDPlus: "pd_plus",
    PDOnlineGravity: "pd_gravity",
}

_REFERENCES = (Hold, PointToPoint, Waypoints)  # themselves: a subclass may have another `at`


def law_numbers(model: ReducedModel, law: ControlLaw) -> dict[str, Any] | None:
    """A law in plain numbers: its kind, gains, constant part and reference; ``None`` where the core has none."""
    n, kind = model.n, type(law)
    if kind is NoTorque:
        return constant_law(np.zeros(model.n_actuated))
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


def nominal_law(model: ReducedModel, law: ControlLaw) -> ModelLaw | None:
    """The law, where its model is another than the plant's."""
    if not isinstance(law, ModelLaw) or law.model is model:
        return None
    same = law.model.mechanism is model.mechanism and np.array_equal(law.model.gravity_vector, model.gravity_vector)
    return None if same else law


def constant_law(u: Array) -> dict[str, Any]:
    """A constant u in plain numbers, which is a law whatever the motors."""
    return {"kind": "constant", "constant": u.tolist()}


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
