"""`calibrate`: a mechanism's geometry from its motors' angles and what is measured beside them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, positive
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.identification.calibration.geometry_fit import GeometryFit, identified, settled
from ccpin.identification.calibration.geometry_numbers import numbers_that_count, unknown_numbers
from ccpin.identification.calibration.identified_geometry import IdentifiedGeometry
from ccpin.identification.calibration.sensor_kinds import Encoders, SensorKind
from ccpin.identification.calibration.sensors import Sensor
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.other_coordinates.independent_sets import with_independent
from ccpin.programs.recording.constants import Parameter


def calibrate(
    model: ReducedModel | Mechanism,
    measurements: Iterable[tuple[Sensor, ArrayLike]],
    *,
    parameters: Sequence[str] | None = None,
    known: Sequence[str] = (),
    priors: Mapping[str, float] | None = None,
    coarsest: float = 5e-3,
) -> IdentifiedGeometry:
    """The geometry that N poses speak for: of encoders, and a tracker, points touched or closures alone.

    Each pose is measured by encoders of the independent joints (or of the motors), and by any of: a tracker or camera
    from an unknown place, known points or planes touched, a ball-bar, encoders of passive joints. All have errors, the
    encoders too; the method is in `ccpin.identification.calibration.geometry_fit`.

    Numbers of the geometry are called `"origin:JOINT/x"` (y, z; of its frame on the parent link, m), `"turn:JOINT/x"`
    (a turn of that frame about the link's axes, rad, x first, then y and z; 0 is what the file states),
    `"origin:CLOSURE/A/x"` and `"turn:CLOSURE/A/x"` (B likewise), `"distance:CLOSURE"` and `"ratio:COUPLING/JOINT"`.
    `"JOINT"`, `"CLOSURE/A"`, `"CLOSURE"` and `"COUPLING"` stand for all their own but turns, `"turn:JOINT"` for those,
    and `"origin"`, `"turn"`, `"distance"`, `"ratio"` for all of a kind. In loops that stay in a plane what would open
    them is left out. Sensors bring numbers of their own: offsets of encoders, where a tracker stands.

    Args:
        model: The mechanism as its file states it, near which the true one is.
        measurements: Sensors, each with what it said at the same N poses, NaN in all of a row where it said nothing.
        parameters: What is unknown of the geometry; default all but turns.
        known: What of these is right in the file.
        priors: Standard deviations of what the file states, by names of numbers, in their units.
        coarsest: A direction of numbers that is known no better than this (of the mechanism's extent, or rad) counts
            as not observable and stays as the file has it: about what files are off.

    Returns:
        Numbers, their covariance and intervals, what is not observable, and the mechanism's description with them.

    Raises:
        InvalidInputError: A wrong shape or name; no encoders of the motors; no more equations than numbers that they
            determine; or nothing of these is observable.
        ConvergenceError: The iteration does not settle, or settles far from the file or with residuals far beyond the
            noise; or the mechanism cannot be closed at a pose.
        UnsupportedMechanismError: Rows of φ that are redundant: other geometry would not close.
    """
    model = model_of(model)
    pairs = [_measured(each, place) for place, each in enumerate(instance(measurements, "measurements", Iterable))]
    sensors = [each for each, _ in pairs]
    values = [values for _, values in pairs]
    model = measured_model(model, sensors)
    if len({len(each) for each in values}) > 1 or not len(values[0]):
        counts = ", ".join(f"{len(said)} of {each.name}" for each, said in zip(sensors, values, strict=True))
        raise InvalidInputError(f"measurements must be of the same poses: there are {counts}")
    told = instance({} if priors is None else priors, "priors", Mapping, "a mapping of names to standard deviations")
    limit = positive(coarsest, "coarsest")
    sensors = sensors_at(model, sensors)
    numbers = unknown_geometry(model, sensors, parameters, known)
    fit = GeometryFit(model, numbers, sensors, encoded(model, sensors, values), values, told, limit)
    found = settled(fit)
    residuals = np.where(fit.said, found.estimate.left * fit.noise, np.nan)
    return identified(fit, found, residuals)


def unknown_geometry(
    model: ReducedModel, sensors: Sequence[SensorKind], parameters: Sequence[str] | None, known: Sequence[str]
) -> tuple[Parameter, ...]:
    """The numbers of the geometry that are asked for; errors as of `calibrate`."""
    links = [link for each in sensors for link in each.links]
    return unknown_numbers(numbers_that_count(model, links), parameters, known)


def sensors_at(model: ReducedModel, sensors: Sequence[SensorKind]) -> list[SensorKind]:
    """The sensors at a mechanism.

    Raises:
        InvalidInputError: It has not what they see, or two have a name.
    """
    names = [each.name for each in sensors if not isinstance(each, Encoders)]
    if len(set(names)) != len(names):
        raise InvalidInputError(f"two sensors have one name: {', '.join(names)}; give each a `name`")
    return [each.bound(model) for each in sensors]


def measured_model(model: ReducedModel, sensors: Sequence[SensorKind]) -> ReducedModel:
    """The model in coordinates that encoders measure: its own, or its motors.

    Raises:
        InvalidInputError: Encoders measure neither.
    """
    mechanism = model.mechanism
    read = [name for each in sensors if isinstance(each, Encoders) for name in each.joints]
    if len(set(read)) != len(read):
        raise InvalidInputError(f"encoders read a joint twice: {', '.join(read)}")
    if not set(mechanism.independent) <= set(read):
        if len(mechanism.actuated) != model.n or not set(mechanism.actuated) <= set(read):
            wanted = " or ".join(dict.fromkeys([", ".join(mechanism.independent), ", ".join(mechanism.actuated)]))
            raise InvalidInputError(f"measurements: encoders must measure {wanted}, not {', '.join(read) or 'nothing'}")
        driven = with_independent(mechanism, mechanism.actuated, mechanism.q_reference)
        model = ReducedModel(driven, model.gravity_vector)
    return model


def encoded(model: ReducedModel, sensors: Sequence[SensorKind], measured: Sequence[Array]) -> Array:
    """The independent joints' displacements that encoders said, of shape (N, n).

    Raises:
        InvalidInputError: One of them was not measured at a pose.
    """
    said = {
        name: values[:, k]
        for each, values in zip(sensors, measured, strict=True)
        if isinstance(each, Encoders)
        for k, name in enumerate(each.joints)
    }
    q = np.stack([said[name] for name in model.mechanism.independent], axis=1)
    if np.isnan(q).any():
        raise InvalidInputError(f"measurements: {', '.join(model.mechanism.independent)} must be measured throughout")
    return q


def _measured(pair: Any, place: int) -> tuple[SensorKind, Array]:
    if not isinstance(pair, tuple | list) or len(pair) != 2 or not isinstance(pair[0], Sensor):
        raise InvalidInputError(f"measurements[{place}] must be a Sensor and what it said, not {pair!r:.80}")
    kind = pair[0].kind
    return kind, kind.values(pair[1])
