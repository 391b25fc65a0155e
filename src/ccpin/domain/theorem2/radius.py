"""Theorem 2: a radius about a closed configuration within which σ exists, is unique nearby and nonsingular.

Let F(z; δ) = 0 be the quadratic form of ψ̄(q′, q) = 0 (`ccpin.domain.theorem2.form`): N equations in N unknowns,
the last n with right side δ, J = F_z affine in z, z₀ the lift of q₀′, δ = 0 there. Write ‖·‖ for the maximum norm
in the unknowns as scaled, and

    ω = ‖J(z₀)⁻¹ diag(v)‖,  γ = ‖J(z₀)⁻¹ diag(0, …, 0, 1, …, 1)‖ (n ones),  r = 1 / (2ωγ).

**Theorem.** For every δ with ‖δ‖ < r, F(z; δ) = 0 has exactly one solution z*(δ) with ‖z − z₀‖ < 1/ω; it is
smooth in δ, and J is nonsingular on that whole ball.

*Proof.* Row i of J(x) − J(y) has absolute sum at most vᵢ‖x − y‖, hence ‖J(z₀)⁻¹(J(x) − J(y))‖ ≤ ω‖x − y‖; on the
ball of radius 1/ω, J(z₀)⁻¹J(z) differs from I by less than 1 and is invertible. The first Newton step has length
‖J(z₀)⁻¹(0, δ)‖ ≤ γ‖δ‖ =: η, and ωη < ½: Kantorovich's theorem gives a solution within (1 − √(1 − 2ωη))/ω < 1/ω,
unique within (1 + √(1 − 2ωη))/ω > 1/ω. Smoothness is the implicit function theorem. ∎

**Corollary (in joint coordinates).** Let ϱ be the radius translated coordinate by coordinate: arcsin(min(r, 1))
if there are angles, r if there are displacements, min(r, π/√3) if there are spherical joints; the least of those
that occur. On the open cube ‖q − q₀‖∞ < ϱ there is exactly one continuous σ with ψ̄(σ(q), q) = 0 and
σ(q₀) = q₀′; it is smooth, ψ_q′ is nonsingular on it, and σ(q) is the only closed configuration over q whose lift
lies within 1/ω of z₀. Hence the cube belongs to Ω.

*Proof.* Take q in the cube and go to it by q(τ), τ ∈ [0, 1], along the straight line (spherical joints: R₀
exp(τξ)). The right sides are δᵢ(τ) = sin τ(qᵢ − qᵢ⁰), |·| < sin ϱ ≤ r; or τ(qᵢ − qᵢ⁰), |·| < r; or
2 sin(τ|ξ|/2) ξᵢ/|ξ|, |·| ≤ |ξᵢ| < r. So z*(δ(τ)) exists and is continuous.
(a) It is a lift: its identities hold exactly, so its circle unknowns are points on circles, its quaternions unit,
its products what they are named; angles follow continuously from their values at z₀. Its closure rows are those
of φ, so it comes from a closed q′(τ). (For a coupling, sin(D φ) = 0 with φ continuous and 0 at the start.)
(b) Its independent coordinates are q(τ): an angle's change Δ from the centre has sin Δ = δᵢ(τ) and is continuous,
with |δᵢ| < 1 the cosine has no zero and stays positive, so Δ = arcsin δᵢ(τ) = τ(qᵢ − qᵢ⁰), as ϱ ≤ π/2. A
quaternion's w² = 1 − sin²(τ|ξ|/2) has no zero as |ξ| ≤ √3 ‖ξ‖∞ < π, so w > 0 and the rotation is R₀ exp(τξ).
(c) ψ_q′ is nonsingular: if ψ_q′ ν = 0, the lift's velocity ż = z_q′ ν satisfies J ż = 0 (identities hold for every
q′, closure rows are φ's, the last rows are functions of q with q̇ = 0), so ż = 0, and z_q′ is injective on the
joints that enter: ν = 0. Joints that do not enter (on no loop, in no coupling) are independent coordinates
themselves, free wherever those are defined.
(d) Two such σ agree at q₀ and locally everywhere ((c)), so they agree on the cube. ∎

**Hypotheses and rounding.** φ square (no redundant rows), joints of slides, turns and balls (a planar joint is two
slides and a turn, a floating one three slides and a ball); checked when the form is generated. With A a computed
inverse of J(z₀) and κ ≥ ‖I − A J(z₀)‖, κ < 1, ‖J(z₀)⁻¹X‖ ≤ ‖A X‖/(1 − κ); the residual at the centre shortens the step
allowed. The coefficients are taken to be within 1e-12 of exact relative to the largest row sum of coefficients (the
chain products leave some 1e-15, and coefficients below 1e-14 are dropped; where placements are rotations to a lesser
accuracy, that is added): a perturbation e with |e(z₀)|, ‖e_z(z₀)‖ and its v bounded accordingly is added to residual,
κ and v. Norms are inflated and the radius deflated by 1e-9.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.domain.closures.seeds import checked_configuration
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular.folds import Folds, singular_points
from ccpin.domain.theorem2.form import FORMS, Form, QuadraticForm, quadratic_form
from ccpin.domain.theorem2.polynomials import QuadraticSystem
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.verdict import Judged, Verdict, Witness

Scaling = Literal["unit", "weighted"]

_CLOSED = 1e-8  # rad, m: what a configuration may be open by
_NEAR = 1e-6  # rad, m: a singular one this near leaves no radius
_INFLATE = 1.0 + 1e-9  # for rounding
_DESCRIPTIONS: dict[str, str] = {
    "angles": "one (cos, sin) for each joint's own angle from the centre",
    "absolute": "one (cos, sin) for the sum of the angles of successive joints about parallel axes, from the centre",
}


@dataclass(frozen=True, eq=False, repr=False)
class Theorem2Result(Judged):
    """What Theorem 2 certifies about a closed configuration.

    Attributes:
        verdict: ``"proven"``: σ is unique and nonsingular on ‖q − q₀‖∞ < ϱ, ϱ > 0. ``"refuted"``: a configuration
            within 1e-6 of this one is proved to be singular (`singular.folds`), so no radius beyond that exists.
            ``"undecided"``: neither.
        reason: The verdict in a sentence.
        witness: The singular configuration, where refuted.
        radius: ϱ in joint coordinates, maximum norm (rad, m); 0 where nothing is proved, infinite where no independent
            coordinate enters a loop.
        radius_quadratic: r, the radius in the last n right sides (sines, metres, doubled quaternion vectors).
        v: Theorem 2's vector of the system used, of shape (N,).
        c: The largest of v.
        form: ``"angles"`` or ``"absolute"``.
        description: The quadratic form used, in words.
        system: The system used, in its scaled unknowns z / weights.
        weights: The unknowns' scales, of shape (N,).
        centre: The scaled unknowns at the configuration, of shape (N,).
        uniqueness: 1/ω: no other solution has its scaled unknowns this near to the centre (maximum norm).
    """

    verdict: Verdict
    reason: str
    witness: Witness | None
    radius: float
    radius_quadratic: float
    v: Array
    c: float
    form: Form
    description: str
    system: QuadraticSystem
    weights: Array
    centre: Array
    uniqueness: float


class CentreBounds(NamedTuple):
    """Upper bounds at a centre, rounding included: ω, γ and the length of A F(z₀)."""

    bend: float
    gain: float
    residual: float

    @property
    def radius(self) -> float:
        """The r up to which ω(γ r + residual) < ½; negative where the residual alone is too large."""
        if self.gain == 0.0:
            return np.inf
        room = 0.5 / self.bend if self.bend else np.inf
        return (room - self.residual) / self.gain / _INFLATE


def theorem2(
    mechanism: Mechanism | HasMechanism,
    q_free: Array,
    *,
    form: Form | Literal["best"] = "best",
    scaling: Scaling = "weighted",
) -> Theorem2Result:
    """Apply Theorem 2 about a closed configuration; the module's text states what is certified.

    Args:
        mechanism: The mechanism, or its model.
        q_free: A closed, nonsingular configuration q₀′, of shape (nq,).
        form: The quadratic form: ``"angles"``, ``"absolute"``, or ``"best"`` for the larger radius.
        scaling: ``"weighted"``: the unknowns scaled so as to make r as large as that can; ``"unit"``: as they are.

    Raises:
        UnsupportedMechanismError: No quadratic form is available (the message says why).
        InvalidInputError: The configuration has the wrong size, is not finite or is open; an unknown option.
    """
    forms = FORMS if form == "best" else (form,)
    if scaling not in get_args(Scaling):
        raise InvalidInputError(f"unknown scaling '{scaling}'; those are {', '.join(get_args(Scaling))}")
    mechanism = mechanism_of(mechanism)
    q_free = _checked(mechanism, q_free)
    results = [_apply(quadratic_form(mechanism, q_free, one), scaling) for one in forms]
    best = max(results, key=lambda result: result.radius)
    witness = None if best.radius > 0.0 else _singular_at(mechanism, q_free)
    if witness is None:
        return best
    reason = (
        f"a configuration within {_NEAR:g} of this one is singular (known to {witness.error:.1e}): there is no radius"
    )
    return replace(best, verdict="refuted", reason=reason, witness=witness)


def _singular_at(mechanism: Mechanism, q_free: Array) -> Witness | None:
    """A configuration proved to be singular within 1e-6 of a closed one in every coordinate of the chart."""
    try:
        reading = reading_of(mechanism, q_free).bounded("reach")
    except UnsupportedMechanismError:
        return None
    problem, theta = reading.problem, reading.theta(q_free)
    directions = Folds.near(problem, theta[None]).directions()[:, 0]
    found = singular_points(problem, np.tile(theta, (len(directions), 1)), directions)
    near = found.proved & (np.abs(found.theta - theta).max(axis=1) + found.error <= _NEAR)
    if not near.any():
        return None
    k = int(np.flatnonzero(near)[np.argmin(found.error[near])])
    singular = found.theta[k]
    q = singular[reading.system.independent].copy()
    return Witness("singular", q, reading.configuration(singular), float(found.error[k]))


def bounds_at(system: QuadraticSystem, centre: Array, weights: Array, relative_error: float) -> CentreBounds | None:
    """ω, γ and residual at a centre with rounding margins, or ``None`` where J is numerically singular.

    Args:
        system: The quadratic system.
        centre: z₀, of shape (N,).
        weights: Scales of the unknowns' norm: ‖z‖ = max |zᵢ| / weightsᵢ.
        relative_error: Of the system's coefficients, relative to their largest row sum.
    """
    scaled = system.rescaled(weights)
    jacobian = scaled.jacobian(centre / weights)
    try:
        inverse = np.linalg.inv(jacobian)
    except np.linalg.LinAlgError:
        return None
    size = np.abs(inverse)
    rows = size.sum(axis=1)
    reach = max(1.0, float(np.abs(centre).max(initial=0.0)))
    error = relative_error * float(system.magnitude(np.ones(system.size)).max(initial=0.0))
    span = float(weights.max(initial=0.0))
    rounding = 4.0 * system.size * np.finfo(np.float64).eps * (size @ np.abs(jacobian)).sum(axis=1)
    defect = np.abs(np.eye(system.size) - inverse @ jacobian).sum(axis=1) + rounding + 2.0 * error * reach * span * rows
    kappa = float(defect.max(initial=0.0))
    if not kappa < 0.5:
        return None
    inflate = _INFLATE / (1.0 - kappa)
    bend = size @ (scaled.v + 2.0 * error * span**2)
    gain = size[:, system.size - system.free :].sum(axis=1)
    residual = np.abs(inverse @ system.value(centre)) + error * reach**2 * rows
    return CentreBounds(*(inflate * float(x.max(initial=0.0)) for x in (bend, gain, residual)))


def _checked(mechanism: Mechanism, q_free: Array) -> Array:
    q_free = checked_configuration(mechanism, q_free)
    constraints = mechanism.constraints()
    phi = constraints.residual(q_free)
    if float(np.abs(phi).max(initial=0.0)) > _CLOSED:
        open_by = constraints.misfit(phi)
        raise InvalidInputError(
            f"the configuration is open by {open_by}; Theorem 2 is about a closed one (take one from σ)"
        )
    return q_free


def _apply(form: QuadraticForm, scaling: Scaling) -> Theorem2Result:
    system, centre = form.system, form.centre
    weights = np.ones(system.size)
    bounds = bounds_at(system, centre, weights, form.error)
    if bounds is not None and scaling == "weighted":
        weights = best_weights(system, centre)
        bounds = bounds_at(system, centre, weights, form.error)
    r = 0.0 if bounds is None else max(bounds.radius, 0.0)
    joint = {"angle": float(np.arcsin(min(r, 1.0))), "displacement": r, "rotation": min(r, np.pi / np.sqrt(3.0))}
    scaled = system.rescaled(weights)
    bend = 0.0 if bounds is None else bounds.bend
    radius = min((joint[kind] for kind in form.coordinates), default=np.inf) / _INFLATE if r > 0.0 else 0.0
    return Theorem2Result(
        verdict="proven" if radius > 0.0 else "undecided",
        reason=_reason(system, centre, radius),
        witness=None,
        radius=radius,
        radius_quadratic=r,
        v=frozen(scaled.v),
        c=scaled.c,
        form=form.form,
        description=f"{form.form}: {_DESCRIPTIONS[form.form]}; {system.size} unknowns, {scaling} scales",
        system=scaled,
        weights=frozen(weights),
        centre=frozen(centre / weights),
        uniqueness=0.0 if not r > 0.0 else 1.0 / (bend * _INFLATE) if bend else np.inf,
    )


def _reason(system: QuadraticSystem, centre: Array, radius: float) -> str:
    if radius > 0.0:
        return f"σ is unique and nonsingular on the open cube of half width {radius:.6g}"
    rcond = 1.0 / float(np.linalg.cond(system.jacobian(centre), 1))
    return (
        f"the quadratic system's Jacobian has a reciprocal condition number of {rcond:.1e}, too little for a radius "
        "beside rounding: kantorovich_radius and certify come nearer to singularities"
    )


# Scales of the unknowns that make Theorem 2's radius largest.


_BISECTIONS = 24  # of weights' radius: to 1e-7 of it
_ITERATIONS = 300  # of weights
_SETTLED = 1e-5  # growth of a weight that ends them
_LEAST = 1e-4  # weight, beside the largest


def best_weights(system: QuadraticSystem, centre: Array) -> Array:
    """Weights w of shape (N,), largest 1, near those that maximise r(w) at a centre with nonsingular Jacobian.

    No weight is below 1e-4, so that rounding margins, which do not know the scales, stay small.
    """
    inverse = np.abs(np.linalg.inv(system.jacobian(centre)))
    least = inverse[:, system.size - system.free :].sum(axis=1)
    top = float(least.max(initial=0.0))
    if top == 0.0 or system.c == 0.0:
        return np.ones(system.size)
    least = np.maximum(least / top, _LEAST)
    best = np.ones(system.size)
    high = float((inverse @ system.rescaled(best).v).max())
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        weights = _least_fixed_point(system, inverse, least, middle)
        if weights is None:
            low = middle
        else:
            best, high = weights, middle
    return np.asarray(best / best.max())


def _least_fixed_point(system: QuadraticSystem, inverse: Array, least: Array, omega: float) -> Array | None:
    """The least w ≥ `least` with B v(w) ≤ ω w, or ``None`` where the iteration does not settle."""
    doubled = 2.0 * np.abs(system.coefficient)
    weights = least
    for _ in range(_ITERATIONS):
        products = doubled * weights[system.first] * weights[system.second]
        bend = np.bincount(system.row, weights=products, minlength=system.size)
        raised = np.maximum(least, inverse @ bend / omega)
        growth = float((raised / weights).max())
        if growth < 1.0 + _SETTLED:
            return np.asarray(raised)
        if raised.max() > 1.0 / _LEAST:
            return None
        weights = raised
    return None
