"""What `identify` tells: combinations of constants, with their covariance, and what was found beside them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from ccpin.arrays import Array, instance, positive
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.identification.estimates.clock_delays import Delay
from ccpin.identification.estimates.felt_combinations import Effects
from ccpin.identification.estimates.held_out import HeldOut
from ccpin.identification.estimates.motor_constants import MotorConstants
from ccpin.identification.estimates.output_error import Refined, refined
from ccpin.identification.estimates.stribeck_friction import StribeckFriction
from ccpin.identification.logs.log import Log
from ccpin.identification.logs.smoothing import Outlier, Smoothed
from ccpin.mechanism.mechanism import Mechanism


class Estimate(NamedTuple):
    """What logs tell of a mechanism's constants.

    Attributes:
        combinations: What can be told, in words: a parameter, and the multiples of others that it cannot be told from.
        values: Of these, of shape (r,), in the first parameter's unit. stated: what the model says of them, alike.
        covariance: Of the values, of shape (r, r).
        multiples: The values as multiples of all p constants, of shape (r, p).
        parameters: All constants looked at: those nearest the model's (in effect) that agree with the values.
        effort_noise: Standard deviation of the residuals of each row of ρᵀSᵀu, N m or N, of shape (n,).
        autocorrelation: Of each row's residuals, from one sample to the next, of shape (n,). Where it is large noise
            is coloured, which the covariance counts, or the model does not hold; 0 is no proof that it does.
        samples: How many counted, and how many were left out because a joint may have stood.
        outliers: Efforts that were left out, by the motor that explains them best; `off` in deviations of all rows.
        held_out: What constants found without a part of the samples make of it.
        delays: How late each log's efforts are.
        motions: The smoothed logs.
        effects: How combinations follow from constants.
        model: The mechanism that the constants are of: as it was given, with the Stribeck speeds that were found.
        stribeck: What was found of the joints of which Stribeck's friction was asked for.
        motors: What was found of the motors whose constants were asked for.
        added: Of each log by how much constants were larger than these, by name.
    """

    combinations: tuple[str, ...]
    values: Array
    stated: Array
    covariance: Array
    multiples: Array
    parameters: DynamicParameters
    effort_noise: Array
    autocorrelation: Array
    samples: tuple[int, int]
    outliers: tuple[Outlier, ...]
    held_out: tuple[HeldOut, ...]
    delays: tuple[Delay, ...]
    motions: tuple[Smoothed, ...]
    effects: Effects
    model: ReducedModel
    stribeck: tuple[StribeckFriction, ...]
    motors: MotorConstants
    added: tuple[dict[str, float], ...]

    def __repr__(self) -> str:
        used, left = self.samples
        return f"Estimate({len(self.values)} combinations of constants from {used} samples, {left} left out)"

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, of shape (r,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the values."""
        return tuple(self.parameters.units[k] for k in self.effects.columns[self.effects.pivots])

    def box(self, confidence: float = 0.95, about: DynamicParameters | None = None) -> tuple[Array, Array]:
        """Bounds (lower, upper), of shape (p,) each, of constants about the ellipsoid of this confidence.

        Of each combination its first parameter alone varies, so that the combination is its value less to plus √χ²_r
        deviations: that is how far any of (β − β̂)ᵀ C⁻¹ (β − β̂) ≤ χ²_r goes. As Y knows combinations alone (to what
        `effects` calls felt), a robot whose combinations are in the ellipsoid moves as one in the box does.

        Args:
            confidence: Of the ellipsoid, between 0 and 1.
            about: What all other constants are, those of a law's model; default `parameters`.

        Raises:
            InvalidInputError: The confidence is not between 0 and 1, or the constants are another mechanism's.
        """
        about = self.parameters if about is None else instance(about, "about", DynamicParameters)
        if about.names != self.parameters.names:
            raise InvalidInputError("the constants are those of another mechanism")
        level, radii = positive(confidence, "confidence", "a number between 0 and 1"), np.zeros(len(self.parameters))
        if level >= 1.0:
            raise InvalidInputError(f"confidence = {level:g} must be a number between 0 and 1")
        first = self.effects.columns[self.effects.pivots]
        radii[first] = np.sqrt(2.0 * gammaincinv(len(self.values) / 2.0, level)) * self.deviations
        middle = np.array(about.values)
        middle[first] += self.values - self.multiples @ about.values
        return middle - radii, middle + radii

    def refined(
        self,
        model: ReducedModel | Mechanism,
        logs: Log | Iterable[Log],
        *,
        geometry: Sequence[str] = (),
        horizon: float = 0.1,
    ) -> Refined:
        """Constants, and lengths, by which motions simulated from here on come nearest to the measured ones.

        Args:
            model: The mechanism that the estimate is of.
            logs: Those that it is from.
            geometry: Numbers of the geometry to find with the constants: ``"origin:JOINT/x"`` and others, as
                `calibrate` calls them.
            horizon: How long a simulated motion is, s (`ccpin.identification.estimates.output_error`).

        Raises:
            InvalidInputError: Other logs, an unknown name, no stretch that is long enough, numbers that the logs do
                not tell, or an estimate with motors' constants.
            ConvergenceError: No constants were settled on.
        """
        return refined(model, self, logs, geometry, horizon)

    def table(self) -> str:
        """Each combination: value, deviation, what the model states, and unit, a line each; then motors and speeds."""
        rows = zip(self.combinations, self.values, self.deviations, self.stated, self.units, strict=True)
        lines = [
            f"{value:12.5g} ± {off:9.2g}   stated {said:12.5g}   {name}   [{unit}]"
            for name, value, off, said, unit in rows
        ]
        told = zip(self.motors.names, self.motors.values, self.motors.deviations, strict=True)
        lines += [f"{value:12.5g} ± {off:9.2g}   stated {1:12.5g}   motor:{name}" for name, value, off in told]
        for each in self.stribeck:
            found = (
                f"{each.values[2]:12.5g} ± {each.deviations[2]:9.2g}   {each.interval[0]:.4g} … {each.interval[1]:.4g}"
            )
            lines.append(
                f"no Stribeck effect of {each.joint}: {each.reason}" if each.reason else f"{found}   speed:{each.joint}"
            )
        return "\n".join(lines)
