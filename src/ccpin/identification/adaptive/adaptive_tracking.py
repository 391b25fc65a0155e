"""Slotine and Li's adaptive tracking, on the reduced model: masses that are not known need not be.

(J.-J. Slotine and W. Li, On the adaptive control of robot manipulators, International Journal of Robotics Research 6,
1987.) The law has a memory, the estimate π̂, and is therefore a sampled one: `AdaptiveTracking` itself remembers nothing
and may be shared by any number of runs; each run asks what `begin` makes for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, instance, numbers, positive, vector
from ccpin.control.control_law import ControlLaw, Measurement, stated
from ccpin.control.laws import ModelLaw
from ccpin.control.references import Reference, require_commuting
from ccpin.control.sampling import Sampling
from ccpin.control.statements import Learning, Statement, polynomial_of
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.errors import InvalidInputError
from ccpin.identification.adaptive.adaptive_step_program import adaptive_program
from ccpin.identification.adaptive.estimate_history import EstimateHistory, asked_again
from ccpin.identification.adaptive.physical_bounds import constant_box
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.program import Program
from ccpin.programs.recordings import Given
from ccpin.simulation.results.trajectory import Trajectory


class AdaptiveStep(NamedTuple):
    """What the law does at one sample.

    Attributes:
        effort: u, of shape (motors,).
        estimate: π̂ from the next sample on, of shape (k,).
    """

    effort: Array
    estimate: Array


class AdaptiveTracking(ModelLaw):
    """Tracking with constants that are learnt on the way, sampled with a period T.

    With e = q − q_d, q̇_r = q̇_d − Λe, q̈_r = q̈_d − Λė and s = q̇ − q̇_r = ė + Λe

        ρᵀSᵀu_k = Y_r(q, q̇, q̇_r, q̈_r) π̂_k − K s,   π̂_{k+1} = Proj(π̂_k − T Γ Y_rᵀ s),

    Y_r of `State.regressor` (C(q̇) and the dampers multiply q̇_r), Proj onto a box of the adapted constants; all others
    are what the model states, and dry friction is neither known nor learnt. In the limit T → 0, with the true π in the
    box and π̃ = π̂ − π, V = ½ sᵀD s + ½ π̃ᵀΓ⁻¹π̃ has V̇ ≤ −sᵀK s, since Ḋ − 2C is skew symmetric (Lemma III.1).

    Args:
        model: The reduced model, or a mechanism.
        reference: q_d(t).
        slope: Λ, 1/s: (n,) for a diagonal matrix, symmetric positive definite (n, n), or one number.
        K: Gains on s, N m s/rad (N s/m), as for `PDPlus`.
        gain: The diagonal of Γ, of shape (k,), in squared units of each constant per joule; or one number γ, 1/J, for
            γ (upper − lower)², with which ½ π̃ᵀΓ⁻¹π̃ ≤ k/2γ in the box.
        period: T, s: a simulation samples the law so.
        adapted: Names of constants of `model.parameters`, of kinds of them (``inertia``: the ten of each body), or
            ``body:LINK`` (``body``: of all), the factor of all ten that are stated: its mass, in kg over kg.
        bounds: Of these, a pair (lower, upper) of shape (k,) each, factors of bodies first, then in the order of
            `model.parameters`; or a share of what is stated: then constants stated as 0 are left out.
        initial: π̂ at the start of a run, of shape (k,); default what is stated, or the nearest in the box.
        near: Chooses the assembly mode of σ(q_d(0)).

    Attributes:
        model, reference, slope (n, n), K (n, n), period: As given.
        adapted: Names of the adapted constants. units: of each.
        lower, upper: Their bounds, of shape (k,). gain: the diagonal of Γ, alike. initial: as given.
        basis, known: Which constants of the model are meant, π = known + B π̂, of shapes (p, k) and (p,).

    Raises:
        InvalidInputError: Gains, bounds or constants that are none, or a box with a corner that no body can have: its
            pseudo-inertia is not positive definite. A planar motion does not feel Ixx and Iyy, but the check does.
        UnsupportedMechanismError, UnreachableError, SingularConfigurationError: As for `PDPlus`.
    """

    slope: Array
    K: Array
    period: float

    def __init__(
        self,
        model: ReducedModel | Mechanism,
        reference: Reference,
        slope: ArrayLike,
        K: ArrayLike,
        *,
        gain: ArrayLike,
        period: float,
        adapted: Sequence[str],
        bounds: float | tuple[ArrayLike, ArrayLike] = 0.2,
        initial: ArrayLike | None = None,
        near: Near = None,
    ) -> None:
        model, reference = model_of(model), instance(reference, "reference", Reference)
        require_commuting(model.coordinates, "a tracking law")
        rates = numbers(slope, "slope")
        rates = rates if rates.ndim else np.full(model.n, rates)  # 1/s, whatever the coordinates
        super().__init__(model, reference.at(0.0).q, near, slope=rates, K=K)
        self.reference, self.period = reference, positive(period, "period")
        box = constant_box(model.parameters, adapted, bounds)
        self.adapted, self.units, self.basis, stated, self.lower, self.upper, self.known = box
        count = len(box.names)
        gains = numbers(gain, "gain")
        self.gain = frozen(vector(gains if gains.ndim else gains * (box.upper - box.lower) ** 2, "gain", count))
        if not (self.gain > 0.0).all():
            raise InvalidInputError("gain must be positive: the diagonal of Γ, or one number for all")
        start = np.clip(stated, box.lower, box.upper) if initial is None else initial
        self.initial = frozen(self.within(start, "initial"))

    def error(self, t: float, q: Array) -> Array:
        """e = q − q_d(t), of shape (n,)."""
        return self.model.coordinates.difference(self.reference.at(t).q, q)

    def sliding(self, t: float, q: Array, v: Array) -> Array:
        """s = ė + Λ e, of shape (n,)."""
        return np.asarray(v - self.reference.at(t).v + self.slope @ self.error(t, q))

    def step(self, t: float, state: State | Measurement, v: Array, estimate: ArrayLike) -> AdaptiveStep:
        """One sample: u of an estimate π̂, of shape (k,), and the next estimate."""
        own, wanted, v = self.own(state), self.reference.at(t), vector(v, "v", self.model.n)
        e, s = self.error(t, own.q), self.sliding(t, own.q, v)
        Y = own.regressor(v, wanted.a - self.slope @ (v - wanted.v), wanted.v - self.slope @ e)
        current, learnt = vector(estimate, "estimate", len(self.adapted)), Y @ self.basis
        force = Y @ self.known + learnt @ current - self.K @ s
        following = np.clip(current - self.period * self.gain * (learnt.T @ s), self.lower, self.upper)
        return AdaptiveStep(own.efforts(force), following)

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """u with the first estimate: what a run's first sample gets. What learns is a run (`begin`)."""
        return self.step(t, state, v, self.initial).effort

    def next_switch(self, t: float) -> float | None:
        """Where the reference passes from one piece to the next."""
        return self.reference.next_switch(t)

    def begin(self) -> Adapting:
        """The law at the start of a run, with the first estimate."""
        return Adapting(self)

    def statement(self) -> Statement:
        """The law with its first estimate: K_p is Λ, K_v is K."""
        rates = self.period * self.gain
        learning = Learning(self.known, self.basis, rates, self.lower, self.upper, self.initial)
        path = polynomial_of(self.reference)
        return Statement("adaptive", self.model, self.near, path, self.slope, self.K, learning=learning)

    def constants(self, estimate: ArrayLike) -> DynamicParameters:
        """All constants of the mechanism with those of an estimate, of shape (k,): `with_constants` takes them.

        Raises:
            InvalidInputError: It is not in the box.
        """
        stated = self.model.parameters
        rubbing = np.isin(np.arange(len(stated)), stated.of("friction", "stribeck"))
        found = self.known + self.basis @ self.within(estimate, "estimate")
        return replace(stated, values=np.where(rubbing, stated.values, found))

    def lyapunov(
        self, t: float, q: Array | State, v: Array, estimate: ArrayLike, true: ArrayLike, near: Near = None
    ) -> float:
        """V = ½ sᵀD s + ½ π̃ᵀΓ⁻¹π̃, in joules, π̃ = π̂ − π and D of π.

        Args:
            t: The time, s.
            q: Where, of shape (model.nq,), or a State.
            v: q̇, of shape (n,).
            estimate: π̂, of shape (k,).
            true: π, alike.
            near: Chooses the assembly mode of σ(q).
        """
        pi, own = self.within(true, "true"), self.model.at(q, self.near if near is None else near)
        s, rest = self.sliding(t, own.q, v), np.zeros(self.model.n)
        kinetic = 0.5 * s @ (own.regressor(rest, s) - own.regressor(rest, rest)) @ (self.known + self.basis @ pi)
        off = vector(estimate, "estimate", len(self.adapted)) - pi
        return float(kinetic + 0.5 * off @ (off / self.gain))

    def estimates(
        self, motion: Trajectory, *, sampling: Sampling | None = None, true: ArrayLike | None = None
    ) -> EstimateHistory:
        """What was learnt along a motion that `ccpin.simulate` gave: the law is asked again at each of its samples.

        Args:
            motion: From the start of a run, with a sample at each of the law's (`sample_period` T, or T over a number).
            sampling: As the run had it, default T alone.
            true: π, of shape (k,), for V.

        Raises:
            InvalidInputError: Samples are missing, or the efforts that come out are not the motion's.
            DifferentSubjectsError: The motion is of another mechanism.
        """
        return asked_again(self, motion, sampling, true)

    def program(self, *, given: Given = "closed", steps: int = 2, near: State | None = None) -> Program:
        """One sample as a program (`ccpin.programs`): q, y, v, q_d, v_d, a_d and p = π̂_k to `torque` and `estimate`.

        The estimate is π̂_{k+1}, which is in the box but for rounding.

        Args:
            given: As for `ccpin.programs.record`.
            steps: Alike.
            near: The State that it is recorded about, default where the law begins.

        Raises:
            InvalidInputError: A bad argument.
        """
        about = self.model.at(self.near if near is None else near)
        return adaptive_program(self, about, given, steps)

    def within(self, values: ArrayLike, name: str) -> Array:
        """Values of the adapted constants that are in the box, of shape (k,).

        Raises:
            InvalidInputError: They are not.
        """
        found = vector(values, name, len(self.adapted))
        for known, x, low, high in zip(self.adapted, found, self.lower, self.upper, strict=True):
            if not low <= x <= high:
                raise InvalidInputError(f"{name} = {x:g} of {known} is outside its bounds, {low:g} to {high:g}")
        return found


class Adapting(ControlLaw):
    """One run of an adaptive law: its estimate, from sample to sample.

    Args:
        law: The law.

    Attributes:
        law, period: As given, and the law's.
        estimate: π̂ as it will be used at the next sample, of shape (k,).
    """

    def __init__(self, law: AdaptiveTracking) -> None:
        self.law, self.period, self.estimate = law, law.period, law.initial
        self._last: tuple[float, Array] | None = None

    def statement(self) -> Statement | None:
        """The law's, with the estimate as it is."""
        told = stated(self.law)
        if told is None or told.learning is None:
            return None
        return told._replace(learning=told.learning._replace(estimate=self.estimate))

    def adopt(self, t: float, u: Array, learnt: Array) -> None:
        """Go on with the estimate that the compiled core has come to by the sample at t."""
        self._last, self.estimate = (t, u), frozen(learnt)

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """u of the sample at time t; asked again for it the law answers the same and learns nothing.

        Raises:
            InvalidInputError: Time goes back.
        """
        if self._last is not None and t <= self._last[0]:
            if t == self._last[0]:
                return self._last[1]
            raise InvalidInputError(f"a sample at t = {t:.9g} s followed one at t = {self._last[0]:.9g} s")
        step = self.law.step(t, state, v, self.estimate)
        effort = frozen(step.effort)
        self.estimate, self._last = frozen(step.estimate), (t, effort)
        return effort

    def begin(self) -> Adapting:
        """Another run, with the law's first estimate."""
        return self.law.begin()

    def next_switch(self, t: float) -> float | None:
        """The law's."""
        return self.law.next_switch(t)
