"""The compiled core beside the NumPy reference at one state: every number both give, and how far they may differ."""

from typing import NamedTuple

import numpy as np
import pytest

from ccpin import ReducedModel, State, native
from ccpin.dynamics import Wrench
from ccpin.dynamics.derivatives import ForwardDynamicsDerivatives, GeneralizedForceDerivatives
from ccpin.dynamics.wrenches import wrench_rows
from ccpin.errors import CcpinError

# How often each quantity divides by ψ_q′ on the way from q′, and whether it divides by D.
POWER = {
    "sigma": (1, False),
    "phi": (0, False),
    "jacobian": (0, False),
    "jacobian_rate": (1, False),
    "v_free": (1, False),
    "rho": (1, False),
    "rho_dot": (2, False),
    "D": (1, False),
    "C": (2, False),
    "g": (1, False),
    "tau": (2, False),
    "regressor": (2, False),
    "gravity": (1, False),
    "energy": (1, False),
    "acceleration": (2, True),
    "constraint_forces": (2, True),
    "dtau_dq": (3, False),
    "dtau_dv": (2, False),
    "dtau_da": (1, False),
    "da_dq": (3, True),
    "da_dv": (2, True),
    "da_du": (1, True),
}
_TIMES, _NEAR = 32, 1e-13  # times that a state is moved by a share of itself: what a rounding does to an answer


def reference_model(mechanism, gravity=None):
    """The reduced model that computes with NumPy alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(native.VARIABLE, "numpy")
        return ReducedModel(mechanism, gravity)


class Difference(NamedTuple):
    """One quantity of both cores: how far apart relative to its size (at least 1), and how far it may be."""

    name: str
    relative: float
    allowed: float


def relative(native, reference):
    """The largest difference over the larger of 1 and the reference's largest entry; infinite where it declined."""
    if native is None:
        return np.inf
    native, reference = np.asarray(native), np.asarray(reference)
    assert native.shape == reference.shape
    return float(np.abs(native - reference).max(initial=0.0)) / max(1.0, float(np.abs(reference).max(initial=0.0)))


def allowed(name, kappa, kappa_mass, tolerance):
    """1e-12, and more where rounding alone makes more of it: (κ/100)ᵖ, and the conditioning of D over 1000.

    σ: both stop at the same tolerance on ψ̄, κ times which is how far apart they may stop.
    """
    power, divides = POWER[name.removeprefix("pushed ")]
    if name == "sigma":
        return 1e-12 + 2.0 * kappa * tolerance
    growth = max(1.0, kappa / 1e2) ** power
    return 1e-12 * growth * (max(1.0, kappa_mass / 1e3) if divides else 1.0)


def differences(model, kernel, q, rng, near=None):
    """Every quantity at σ(q) and random q̇, q̈, u and wrenches on links.

    Where one is beyond what κ allows, both are asked at dozens of q′ beside the state's, hundreds of roundings off:
    rounding errors go both ways and leave the mean of what is between them, other errors stay.

    Raises:
        CcpinError: The reference refuses the state.
    """
    state = model.at(q, near)
    v, a, u = rng.normal(size=model.n), rng.normal(size=model.n), rng.normal(size=model.n_actuated)
    pushed = random_wrenches(model, rng)
    reference = dict(_reference(model, state, v, a, u, pushed))
    native = dict(_native(kernel, state, q, near, v, a, u, wrench_rows(model.mechanism.tree, pushed)))
    kappa, kappa_mass = 1.0 / state.rcond, float(np.linalg.cond(reference["D"])) if model.n else 1.0
    limits = kappa, kappa_mass, model.parametrization.rules.tolerance
    found = [
        Difference(name, relative(native.get(name), value), allowed(name, *limits)) for name, value in reference.items()
    ]
    if all(one.relative <= one.allowed for one in found):
        return found
    mean = _mean_difference(model, kernel, state, v, a, u, pushed)
    return [one._replace(relative=min(one.relative, mean.get(one.name, np.inf))) for one in found]


def random_wrenches(model, rng):
    """A force and a moment on two links, one of them at a point of it."""
    links = rng.permutation(sorted(model.mechanism.tree.attachments))[:2].tolist()
    return {links[0]: Wrench(*rng.normal(size=(3, 3))), links[-1]: rng.normal(size=6)}


def _mean_difference(model, kernel, state, v, a, u, pushed):
    """The mean of what is between both near q′, relative to the quantity's size: by name; not of σ."""
    rng, total = np.random.default_rng(0), {}
    for _ in range(_TIMES):
        q_free = state.q_free * (1.0 + _NEAR * rng.uniform(-1.0, 1.0, len(state.q_free)))
        moved = State.of(model, state.q, model.parametrization.at(q_free))
        native = dict(_native(kernel, moved, state.q, None, v, a, u, wrench_rows(model.mechanism.tree, pushed)))
        for name, value in _reference(model, moved, v, a, u, pushed):
            if name != "sigma":
                size = max(1.0, float(np.abs(value).max(initial=0.0)))
                total[name] = total.get(name, 0.0) + (np.asarray(native[name]) - value) / size
    return {name: float(np.abs(sums).max(initial=0.0)) / _TIMES for name, sums in total.items()}


def _reference(model, state, v, a, u, pushed):
    q_free, constraints = state.q_free, model.parametrization.constraints
    value = constraints.value(q_free)
    yield from {"sigma": q_free, "phi": value.phi, "jacobian": value.jacobian}.items()
    yield "jacobian_rate", constraints.rate(value, state.v_free(v))
    terms = state.terms(v)
    yield from ((name, getattr(terms, name)) for name in ("v_free", "rho", "rho_dot", "D", "C", "g"))
    yield "regressor", _smooth(model, state.regressor(v, a, a[::-1]))
    yield "gravity", state.g
    yield "energy", np.array(state.energy(v))
    for name, wrenches in (("", None), ("pushed ", pushed)):
        yield f"{name}tau", state.tau(v, a, wrenches)
        yield f"{name}acceleration", state.forward_dynamics(v, u, wrenches)
        yield f"{name}constraint_forces", state.constraint_forces(v, u, wrenches)
        slopes = state.generalized_force_derivatives(v, a, wrenches)._asdict()
        slopes |= state.forward_dynamics_derivatives(v, u, wrenches)._asdict()
        yield from ((name + field, value) for field, value in slopes.items())


def _native(kernel, state, q, near, v, a, u, pushed):
    q_free, names = state.q_free, ("q_free", "v_free", "rho", "rho_dot", "D", "C", "g")
    yield "sigma", kernel.sigma(q, near)
    yield from zip(("phi", "jacobian"), kernel.constraints(q_free), strict=True)
    yield "jacobian_rate", kernel.constraint_rate(q_free, state.v_free(v))
    yield from zip(names[1:], kernel.terms(q_free, v)[1:], strict=True)
    yield "regressor", _smooth(state.model, kernel.regressor(q_free, v, a, a[::-1]))
    yield "gravity", kernel.gravity(q_free)
    yield "energy", kernel.energy(q_free, v)
    for name, rows in (("", None), ("pushed ", pushed)):
        yield f"{name}tau", kernel.generalized_force(q_free, v, a, None, rows)
        yield f"{name}acceleration", kernel.forward_dynamics(q_free, v, u, None, rows)
        yield f"{name}constraint_forces", kernel.constraint_forces(q_free, v, u, None, rows)
        of_force = kernel.generalized_force_derivatives(q_free, v, a, None, rows)
        yield from zip([name + field for field in GeneralizedForceDerivatives._fields], of_force, strict=True)
        of_motion = kernel.forward_dynamics_derivatives(q_free, v, u, None, rows)
        yield from zip([name + field for field in ForwardDynamicsDerivatives._fields], of_motion, strict=True)


def _smooth(model, Y):
    """Its columns but those of dry friction, whose sign(q̇′) rounding decides where a joint does not turn."""
    return Y[:, np.array(model.parameters.kinds) != "friction"]


def random_states(model, rng, count, size=0.3):
    """Yield q near the reference's, of growing distance up to `size` times a normal step."""
    start = model.alpha(model.mechanism.q_reference)
    for k in range(count):
        yield model.coordinates.integrate(start, size * (k + 1) / count * rng.normal(size=model.n))


def refused(model, q, near=None):
    """Whether the reference refuses σ(q)."""
    try:
        model.sigma(q, near)
    except CcpinError:
        return True
    return False
