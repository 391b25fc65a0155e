"""σ in real time: one warm start a sample, a hard cap on Newton steps, and what to do when that is not enough.

The state a controller carries from sample to sample (its last valid σ) is an object of its own, `OnlineSigma`, and
`OnlineLaw` is a tracking law that uses it. Both belong in a sampled loop, where samples come once each and in
order; in a continuous simulation use the tracking law itself, which finds σ from where the integrator is and
remembers nothing.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, positive, whole
from ccpin.control.control_law import ControlLaw, Measurement, q_of
from ccpin.control.tracking import TrackingLaw
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import checked_configuration, checked_q
from ccpin.kinematics.parametrization import ClosedPoint, NewtonRules, NewtonSolve, Parametrization
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.digests import require_same

Outcome = Literal["solved", "held", "lost"]


def capped_sigma(
    parametrization: Parametrization, q: Array, near: Array | ClosedPoint, max_newton_steps: int, tolerance: float
) -> NewtonSolve:
    """Solve ψ̄(q′, q) = 0 (11) from `near` with at most `max_newton_steps` linear solves.

    An iteration is trusted only if each correction is at most an eighth of the one before, det ψ_q′ keeps its sign and
    ψ_q′⁻¹ changes by half at most; there is no walk when it is not, and no proof as in `Parametrization.sigma`.

    Args:
        parametrization: ψ.
        q: Independent coordinates, of shape (model.nq,).
        near: q′ to start from, of shape (nq,), or a closed point, which spares the first evaluation.
        max_newton_steps: The cap.
        tolerance: Largest |ψ̄| accepted, metres and radians.
    """
    instance(parametrization, "parametrization", Parametrization)
    q, steps = checked_q(parametrization.coordinates, q), whole(max_newton_steps, "max_newton_steps")
    if not isinstance(near, ClosedPoint):
        near = checked_configuration(parametrization.model, near, "near")
    tolerance = positive(tolerance, "tolerance")
    return parametrization.newton(near, q, NewtonRules(tolerance, steps, noise=tolerance))


class OnlineSample(NamedTuple):
    """What the controller has at one sample.

    Attributes:
        state: The State at this sample's q where solved, else that of the last solved sample.
        outcome: solved; held (the last valid σ stands in); lost (held for longer than the patience).
        steps: Newton steps taken.
    """

    state: State
    outcome: Outcome
    steps: int


class OnlineReport(NamedTuple):
    """How σ went in real time.

    Attributes:
        samples: Number of samples.
        held: Samples at which the last valid σ stood in (lost ones included).
        longest_hold: The most in a row.
        first_held: Time of the first, s, or ``None``.
        lost: Whether the patience ran out at any sample.
        most_steps: Most Newton steps at one sample.
        mean_steps: Mean of Newton steps a sample.
        largest_residual: Largest |ψ̄| of a solved sample, metres and radians.
    """

    samples: int
    held: int
    longest_hold: int
    first_held: float | None
    lost: bool
    most_steps: int
    mean_steps: float
    largest_residual: float

    @property
    def message(self) -> str:
        """The report in a sentence."""
        if self.first_held is None:
            return f"σ was found at each of {self.samples} samples in at most {self.most_steps} Newton steps"
        end = "; the patience ran out and the law braked" if self.lost else ""
        return (
            f"σ was not found at {self.held} of {self.samples} samples (first at t = {self.first_held:.6g} s, at most "
            f"{self.longest_hold} in a row); the last valid one was held{end}"
        )


class OnlineSigma:
    """σ sample by sample, warm-started from the last valid one; the only state an on-line law has.

    Args:
        model: The reduced model, or a mechanism.
        q_free: Where the robot is at the first sample: closed, or nearly so; its branch is kept. Of shape (nq,).
        max_newton_steps: Hard cap on Newton steps a sample.
        tolerance: Largest |ψ̄| accepted, metres and radians.
        patience: Samples in a row for which the last valid σ may be held before it counts as lost.

    Raises:
        InvalidInputError: A cap below one, a tolerance that is not positive, a negative patience, or a start that
            cannot be closed.
        SingularConfigurationError: The start is singular.
    """

    def __init__(
        self,
        model: ReducedModel | Mechanism,
        q_free: ArrayLike,
        *,
        max_newton_steps: int = 4,
        tolerance: float = 1e-9,
        patience: int = 20,
    ) -> None:
        self.tolerance = positive(tolerance, "tolerance", "a positive number (metres and radians)")
        self.max_newton_steps = whole(max_newton_steps, "max_newton_steps")
        self.patience = whole(patience, "patience", 0)
        self.model = model_of(model)
        self._valid = self.model.at(self.model.alpha(q_free), q_free)
        self._last: tuple[float, Array, OnlineSample] | None = None
        self._in_a_row = 0
        self._report = OnlineReport(0, 0, 0, None, False, 0, 0.0, 0.0)

    def update(self, t: float, q: Array) -> OnlineSample:
        """Take one sample: at most `max_newton_steps` Newton steps from the last valid σ.

        Asking again for the sample just taken gives the same answer and takes no step.

        Raises:
            InvalidInputError: Time goes back, or stands still while q changes.
        """
        if self._last is not None and t <= self._last[0]:
            if t == self._last[0] and np.array_equal(q, self._last[1]):
                return self._last[2]
            raise InvalidInputError(
                f"an on-line σ takes samples in order of time: one at t = {t:.9g} s followed one at "
                f"t = {self._last[0]:.9g} s; in a continuous simulation use the tracking law itself"
            )
        solve = capped_sigma(self.model.parametrization, q, self._valid.q_free, self.max_newton_steps, self.tolerance)
        if solve.point is not None:
            self._valid, self._in_a_row = State.of(self.model, np.array(q), solve.point), 0
        else:
            self._in_a_row += 1
        outcome: Outcome = "solved" if not self._in_a_row else "held" if self._in_a_row <= self.patience else "lost"
        sample = OnlineSample(self._valid, outcome, solve.steps)
        self._last = (float(t), np.array(q), sample)
        self._report = self._counted(float(t), solve, outcome)
        return sample

    def report(self) -> OnlineReport:
        """How it went so far."""
        return self._report

    def _counted(self, t: float, solve: NewtonSolve, outcome: Outcome) -> OnlineReport:
        before, missed = self._report, outcome != "solved"
        return OnlineReport(
            samples=before.samples + 1,
            held=before.held + missed,
            longest_hold=max(before.longest_hold, self._in_a_row),
            first_held=t if missed and before.first_held is None else before.first_held,
            lost=before.lost or outcome == "lost",
            most_steps=max(before.most_steps, solve.steps),
            mean_steps=before.mean_steps + (solve.steps - before.mean_steps) / (before.samples + 1),
            largest_residual=before.largest_residual if missed else max(before.largest_residual, solve.residual),
        )


class OnlineLaw(ControlLaw):
    """A tracking law as a controller computes it: σ from an `OnlineSigma`, braking once that is lost.

    While σ is held the law works with the model at the last valid configuration (its feedback is still that of the
    measured q and q̇); once lost it stops the robot by `TrackingLaw.brake`, until σ is found again. For sampled loops.

    Args:
        law: The tracking law.
        online: The controller's σ: of the law's own model, as the law reads its model there.

    Raises:
        DifferentSubjectsError: It is of other closures or dynamics.
    """

    def __init__(self, law: TrackingLaw, online: OnlineSigma) -> None:
        instance(law, "law", TrackingLaw)
        instance(online, "online", OnlineSigma)
        require_same("a law with σ on line", law.digests, online.model.digests, "closures", "dynamics")
        self.law = law
        self.online = online

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """The motors' efforts of the sample at time t, of shape (motors,); of where it is given it reads q alone.

        Raises:
            InvalidInputError: Samples out of order.
        """
        q = q_of(state)
        sample = self.online.update(t, q)
        if sample.outcome == "lost":
            return self.law.brake(v, sample.state)
        return self.law.torque_with(t, q, v, sample.state)

    def next_switch(self, t: float) -> float | None:
        """The tracking law's."""
        return self.law.next_switch(t)
