"""`identify_geometry`: lengths and anchor points of a linkage from measured pairs of motor and joint angles.

Pairs are measured with errors on both sides, and encoders may be mounted off by o,

    q̂_m = σ_m(q_j; p) + o_m + ε_m,        q̂_j = q_j + o_j + ε_j:

a calibration by encoders of motors and joints (`geometry_fit`), in the joints' coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import instance, matrix_rows, one_each, records
from ccpin.errors import InvalidInputError
from ccpin.identification.calibration.calibrating import sensors_at
from ccpin.identification.calibration.geometry_fit import GeometryFit, identified, settled
from ccpin.identification.calibration.geometry_numbers import numbers_on_loops, unknown_numbers
from ccpin.identification.calibration.identified_geometry import IdentifiedGeometry
from ccpin.identification.calibration.sensor_kinds import Encoders
from ccpin.transmission.transmission import Transmission

_DEFAULT_NOISE = np.radians(0.02)
_COARSEST = 0.05  # of the extent, or rad: a standard deviation above says nothing that the file does not


def identify_geometry(
    transmission: Transmission,
    motor_positions: ArrayLike,
    joint_positions: ArrayLike,
    *,
    motor_noise: ArrayLike = _DEFAULT_NOISE,
    joint_noise: ArrayLike = _DEFAULT_NOISE,
    parameters: Sequence[str] | None = None,
    known: Sequence[str] = (),
    offsets: Sequence[str] = (),
    priors: Mapping[str, float] | None = None,
) -> IdentifiedGeometry:
    """Lengths and anchor points of a linkage, of pairs q_m, q_j measured with errors on both sides.

    Numbers of the geometry are called as parameters of programs are: `"origin:JOINT/x"` (y, z; on the parent link, m)
    of joints on loops, `"origin:CLOSURE/A/x"` and `"origin:CLOSURE/B/x"`, a rod's `"distance:CLOSURE"`, and
    `"ratio:COUPLING/JOINT"` for all terms but the first. `"JOINT"`, `"CLOSURE/A"`, `"CLOSURE"` and `"COUPLING"` stand
    for all that are its own.

    Args:
        transmission: With the geometry that the file states, near which the true one is.
        motor_positions: q̂_m of the motors' joints, in the order of `transmission.motors`, rad or m, of shape (N, n).
        joint_positions: q̂_j likewise.
        motor_noise: Standard deviations s_m, one for all or of shape (n,); default 0.02°.
        joint_noise: s_j likewise.
        parameters: What is identified; default all.
        known: What of these is right in the file. Angles alone do not tell a linkage's size, so name a length.
        offsets: Joints and motors' joints whose encoders have an unknown offset.
        priors: Standard deviations of what the file states, by names of numbers, in their units.

    Raises:
        InvalidInputError: A wrong shape or name, a number that is not finite; no more equations than numbers that they
            determine; or pairs by which no number of these is determined.
        ConvergenceError: The iteration does not settle, or settles far from the file or with residuals far beyond the
            noise; or the linkage cannot be closed at a pair. So it is with pairs of another branch or mechanism.
        UnsupportedMechanismError: Rows of φ that are redundant: other geometry would not close.
    """
    transmission = instance(transmission, "transmission", Transmission)
    n, model = transmission.n, transmission.joint_model
    motors = matrix_rows(motor_positions, "motor_positions", n)
    joints = matrix_rows(joint_positions, "joint_positions", n)
    if len(motors) != len(joints) or not len(motors):
        raise InvalidInputError(f"{len(motors)} motor_positions and {len(joints)} joint_positions make no pairs")
    off = records(offsets, "offsets", str)
    there = dict.fromkeys((*transmission.joints, *transmission.motors))
    if wrong := [name for name in off if name not in there]:
        raise InvalidInputError(f"offsets: '{wrong[0]}' is none of {', '.join(there)}")
    told = instance({} if priors is None else priors, "priors", Mapping, "a mapping of names to standard deviations")
    spreads = (
        one_each(motor_noise, "motor_noise", n, positive=True),
        one_each(joint_noise, "joint_noise", n, positive=True),
    )
    driven = tuple(name for name in off if name in transmission.motors)
    both = driven, tuple(name for name in off if name not in driven)
    sides = zip(spreads, (transmission.motors, transmission.joints), both, strict=True)
    encoders = sensors_at(model, [Encoders("encoders", *side) for side in sides])
    numbers = unknown_numbers(numbers_on_loops(model), parameters, known)
    fit = GeometryFit(model, numbers, encoders, joints, (motors, joints), told, _COARSEST)
    found = settled(fit)
    here = found.estimate
    left = here.left * fit.noise
    J = here.poses.by_q[:, :n]
    return identified(fit, found, left[:, :n] - np.einsum("Nij,Nj->Ni", J, left[:, n:]))
