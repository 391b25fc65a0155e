"""What a serial robot is, in lines: what was left out and added, its limits, and by how much it is amiss."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ccpin.arrays import Array
from ccpin.transmission.linkage import stated_of
from ccpin.transmission.motor_limits import LimitsCertificate
from ccpin.validated.programs.program_certificate import ProgramCertificate

if TYPE_CHECKING:
    from ccpin.transmission.serial_robots import SerialRobot

_POOR = 0.5  # of D: with more amiss the range is too wide, or these are not the robot's joints
_ADVICE = ": constant numbers do not say this linkage: narrow the range, or name other joints"


def in_words(robot: SerialRobot) -> Iterator[str]:
    """The lines."""
    transmission, errors = robot.transmission, robot.errors
    joints, slide, mechanism = transmission.joints, transmission.joint_side.slides, transmission.joint_model.mechanism

    def row(values: Array, unit: str = "", sliding: str = "", sign: str = "±") -> str:
        units = [sliding if slides else unit for slides in slide]
        told = zip(joints, values.tolist(), units, strict=True)
        return ", ".join(f"{joint} {sign}{value:.4g} {unit}".rstrip() for joint, value, unit in told)

    yield f"{mechanism.name} as a serial robot of {', '.join(joints)}; driven through {', '.join(transmission.motors)}"
    kept = {link.name for link in robot.description.links}
    left = [link.name for link in stated_of(mechanism).links if link.name not in kept]
    yield f"left out: {', '.join(left) or 'nothing'}"
    met = "fitted over the range" if robot.at is None else f"D is the mechanism's at {_row(robot.at.q_joint)}"
    yield f"range {_row(robot.lower)} … {_row(robot.upper)}; {met}"
    yield f"largest differences over the range ({_how(robot.compared)}):"
    yield f"  D by {100 * errors.share:.3g} %{_ADVICE if errors.share > _POOR else ''}"
    for what, each in (("g", errors.gravity), ("C q̇, per |q̇|²,", errors.velocity)):
        if each.any():
            yield f"  {what} by {row(each, 'N m', 'N')}"
    if errors.damping.any():
        yield f"  damping by {row(errors.damping.max(axis=1), 'N m s/rad', 'N s/m')}"
    for what, limits, units, certificate in (
        ("efforts", robot.effort, ("N m", "N"), robot.held),
        ("speeds", robot.speed, ("rad/s", "m/s"), robot.compared),
    ):
        if np.isfinite(limits).all():
            yield f"{what} {row(limits, *units)} ({_how(certificate)})"
        else:
            yield f"{what}: no limits are stated of the motors"
    yield f"armatures added: {row(robot.added.armatures, 'kg m²', 'kg', sign='')}"
    for link in dict.fromkeys(point.link for point in robot.added.masses):
        points = [point for point in robot.added.masses if point.link == link]
        yield f"mass added to {link}: {sum(point.mass for point in points):.4g} kg at {len(points)} points"


def is_proved(certificate: LimitsCertificate | ProgramCertificate | None) -> bool:
    """Whether there is a certificate, and it is proven."""
    return certificate is not None and certificate.verdict == "proven"


def _how(certificate: LimitsCertificate | ProgramCertificate | None) -> str:
    return "proved" if is_proved(certificate) else "sampled with a margin, not proved"


def _row(values: Array) -> str:
    return " ".join(f"{value:.4g}" for value in values.tolist())
