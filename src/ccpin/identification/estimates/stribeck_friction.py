"""Stribeck's friction from logs: what it is made of beside Coulomb's, and what is said of each joint's.

Of joint j the column beside s_j − c_j is E_j = exp(−(q̇′_j/v_j)²) ρ_jᵀ sign q̇′_j, linear but for the speed v_j, which
`stribeck_search` finds. ∂(E δ)/∂v_s stands beside W in the fit that counts, so that all covariances have what is not
known of v_s in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, records
from ccpin.description.names import choices
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.identification.estimates.effort_samples import EffortSamples
from ccpin.identification.estimates.felt_combinations import Effects
from ccpin.identification.estimates.robust_fit import EffortRows

_ALONE = 1e-6  # of a constant: as much may be told with others


class StribeckFriction(NamedTuple):
    """What logs tell of one joint's dry friction.

    Attributes:
        joint: Its name.
        values: Coulomb level c, breakaway level s and Stribeck speed v_s, N m or N and rad/s or m/s, of shape (3,); NaN
            where no Stribeck effect is told.
        covariance: Of these, of shape (3, 3).
        interval: 95 % of the profile likelihood of v_s.
        gain: By how much less is left of the efforts with the effect than without, in squares of their deviations.
        due: What two constants have to explain for their place.
        reason: Why no effect is told; empty where one is.
    """

    joint: str
    values: Array
    covariance: Array
    interval: tuple[float, float]
    gain: float
    due: float
    reason: str

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, of shape (3,)."""
        return np.sqrt(np.diag(self.covariance))

    def level(self, speed: Array) -> tuple[Array, Array]:
        """c + (s − c) exp(−(v/v_s)²) at some speeds, and its standard deviation."""
        c, s, v_s = self.values
        fall = np.exp(-((speed / v_s) ** 2))
        slopes = np.stack([1.0 - fall, fall, (s - c) * fall * 2.0 * speed**2 / v_s**3])
        return c + (s - c) * fall, np.sqrt(np.einsum("i...,ij,j...->...", slopes, self.covariance, slopes))


class StribeckColumns(NamedTuple):
    """What Stribeck's friction is made of.

    Attributes:
        names: Of k joints.
        friction: Columns of Y beside their Coulomb levels, ρ_jᵀ sign q̇′_j, of shape (N, n, k).
        rates: q̇′_j, of shape (N, k).
    """

    names: tuple[str, ...]
    friction: Array
    rates: Array

    def of(self, joints: Sequence[int]) -> StribeckColumns:
        """Some of the joints."""
        chosen = list(joints)
        return StribeckColumns(tuple(self.names[k] for k in chosen), self.friction[..., chosen], self.rates[:, chosen])

    def falling(self, speeds: Array) -> Array:
        """E at these speeds, of shape (N, n, k)."""
        return np.asarray(self.friction * np.exp(-((self.rates / speeds) ** 2))[:, None])

    def slopes(self, speeds: Array) -> Array:
        """∂E/∂v_s, alike."""
        return np.asarray(self.falling(speeds) * (2.0 * self.rates**2 / speeds**3)[:, None])


class Verdict(NamedTuple):
    """What is said of a joint's Stribeck effect: `StribeckFriction` tells of each."""

    joint: str
    interval: tuple[float, float]
    gain: float
    due: float
    reason: str


class FoundSpeeds(NamedTuple):
    """What was found of some joints.

    Attributes:
        speeds: v_s by joint of those whose effect is told.
        increments: δ = s − c of these, of shape (k,).
        told: Of every joint that was asked for.
    """

    speeds: dict[str, float]
    increments: Array
    told: tuple[Verdict, ...]

    def slopes(self, columns: StribeckColumns) -> Array:
        """∂(E δ)/∂v_s, of shape (N, n, k)."""
        return columns.slopes(np.array([*self.speeds.values()])) * self.increments


def stribeck_columns(model: ReducedModel, samples: Sequence[EffortSamples], joints: Sequence[str]) -> StribeckColumns:
    """Those of joints in all samples."""
    tree, names = model.mechanism.tree, model.parameters.names
    places = [names.index(f"friction:{joint}") for joint in joints]
    own = [tree.joint(joint).v.start for joint in joints]
    friction = np.concatenate([each.Y[..., places] for each in samples])
    return StribeckColumns(tuple(joints), friction, np.concatenate([each.rates[:, own] for each in samples]))


def asked_joints(model: ReducedModel, asked: bool | Sequence[str]) -> tuple[str, ...]:
    """Joints of one velocity: all, none, or those named.

    Raises:
        InvalidInputError: A name of none.
    """
    able = tuple(joint.name for joint in model.mechanism.tree.joints if joint.kind.nv == 1)
    if isinstance(asked, bool):
        return able if asked else ()
    names = (asked,) if isinstance(asked, str) else records(asked, "stribeck", str)
    for name in names:
        if name not in able:
            raise InvalidInputError(f"stribeck: '{name}' is no joint of one velocity; {choices(str(name), able)}")
    return tuple(name for name in able if name in names)


def with_columns(rows: EffortRows, further: Array) -> EffortRows:
    """Further columns (N, n, k) beside W, of which nothing is known beforehand."""
    return rows._replace(W=np.concatenate([rows.W, further], axis=2), P=np.pad(rows.P, ((0, 0), (0, further.shape[2]))))


def with_effect(before: ReducedModel, after: ReducedModel, samples: EffortSamples, found: FoundSpeeds) -> EffortSamples:
    """Samples of a model whose constants have those of Stribeck's friction besides."""
    old = np.isin(after.parameters.names, before.parameters.names)
    Y = np.empty((*samples.Y.shape[:2], len(old)))
    columns = stribeck_columns(before, [samples], tuple(found.speeds))
    Y[..., old], Y[..., ~old] = samples.Y, columns.falling(np.array([*found.speeds.values()]))
    return samples._replace(Y=Y)


def told_friction(
    found: FoundSpeeds, effects: Effects, parameters: DynamicParameters, together: Array
) -> tuple[StribeckFriction, ...]:
    """Levels and speeds of every joint that was asked for, from the covariance of β̂ and speeds, in this order."""
    told, r = [], effects.basis.shape[1]

    def row(name: str) -> Array:
        """What a constant is of β and speeds; NaN where it is told in combinations only."""
        place = int(np.searchsorted(effects.columns, parameters.names.index(name)))
        own = np.pad(effects.basis[place] / effects.scale[place], (0, len(together) - r))
        return own if np.linalg.norm(effects.basis[place]) > 1.0 - _ALONE else own * np.nan

    for each in found.told:
        values, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
        if each.joint in found.speeds:
            names = f"friction:{each.joint}", f"stribeck:{each.joint}"
            c, more = (float(parameters.values[parameters.names.index(name)]) for name in names)
            coulomb, increment, speed = row(names[0]), row(names[1]), np.zeros(len(together))
            speed[r + list(found.speeds).index(each.joint)] = 1.0
            slopes = np.array([coulomb, coulomb + increment, speed])
            values, covariance = np.array([c, c + more, found.speeds[each.joint]]), slopes @ together @ slopes.T
        told.append(StribeckFriction(each.joint, values, covariance, *each[1:]))
    return tuple(told)
