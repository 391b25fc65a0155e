"""Laws and integrators as the compiled core takes them: in plain numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DOP853, RK45

from ccpin.arrays import Array
from ccpin.control.statements import Statement
from ccpin.dynamics.reduced_model import ReducedModel

_KINDS = ("constant", "pd", "pd_gravity", "computed_torque", "pd_plus", "adaptive")  # the core knows these


def law_numbers(model: ReducedModel, law: Statement | None) -> dict[str, Any] | None:
    """A law of a plant in plain numbers; ``None`` where the core has none for it."""
    if law is None or law.kind not in _KINDS:
        return None
    if law.idle:
        return constant_law(np.zeros(model.n_actuated))
    own, path = law.model, law.reference
    if own is None or path is None or own.coordinates.nq != model.nq or own.actuation is not None:
        return None
    return {
        "kind": law.kind,
        "start": path.start.tolist(),
        "breaks": path.breaks.tolist(),
        "degree": path.coefficients.shape[1] - 1,
        "coefficients": path.coefficients.ravel().tolist(),
        "K_p": law.K_p.ravel().tolist(),
        "K_v": law.K_v.ravel().tolist(),
        "constant": law.constant.tolist(),
        "learning": law.learning and {name: each.ravel().tolist() for name, each in law.learning._asdict().items()},
    }


def nominal_model(model: ReducedModel, law: Statement) -> ReducedModel | None:
    """The law's own model, where that is another than the plant's."""
    own = law.model
    if own is None or own is model:
        return None
    same = own.mechanism is model.mechanism and np.array_equal(own.gravity_vector, model.gravity_vector)
    return None if same else own


def constant_law(u: Array) -> dict[str, Any]:
    """A constant u in plain numbers, which is a law whatever the motors."""
    return {"kind": "constant", "constant": u.tolist()}


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
