"""A mechanism written in a format and read again: equal, or refused and why.

Equal means that D, C and g of the reduced model are the same to `EQUAL`, at the reference and at states around it, and
that what joints, motors and poses state besides came back, or the writer said that it would not.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ccpin
from ccpin.description import FORMATS
from ccpin.description.changes.overrides import JOINT_FIELDS
from ccpin.errors import CcpinError

EQUAL = 1e-12  # of D, C and g, relative to the largest entry
PINOCCHIO = "pinocchio"  # a model and its constraint models, which are no file
WRITTEN = (*FORMATS, PINOCCHIO)
STATES = 3  # around the reference
STEP, SPEED = 0.02, 0.7  # rad or m, and per second


class Trip(NamedTuple):
    """One mechanism through one format.

    Attributes:
        subject, format: Which.
        error: The largest relative difference of D, C and g; ``None`` where the format refused.
        said: The refusal, or what the writer said it has no place for.
        silent: What joints and motors state and came back otherwise, without a word.
    """

    subject: str
    format: str
    error: float | None
    said: str = ""
    silent: tuple[str, ...] = ()

    @property
    def equal(self) -> bool:
        """Whether it came back as it was, but for what was said."""
        return self.error is not None and self.error <= EQUAL and not self.silent


def trip(subject: str, before: ccpin.Mechanism, name: str, folder: Path) -> Trip:
    """Write, read and compare."""
    if name == PINOCCHIO and before.locked:  # its tree has whole joints locked, with all of their bodies' inertia
        before = ccpin.load(before.description, free=["all"], actuated=before.actuated)
    try:
        after, said = _through_pinocchio(before) if name == PINOCCHIO else _through_a_file(before, name, folder)
    except CcpinError as error:
        return Trip(subject, name, None, str(error))
    told = "; ".join(said)
    return Trip(subject, name, difference(before, after), told, () if name == PINOCCHIO else lost(before, after, told))


def _through_a_file(before: ccpin.Mechanism, name: str, folder: Path) -> tuple[ccpin.Mechanism, Iterable[str]]:
    """What the format has no place for, of which joints are independent and driven and the pose, is stated again."""
    file = folder / f"robot{FORMATS[name].suffixes[0]}"
    notes = before.save(file, name)
    again = {"independent": before.independent, "actuated": before.actuated}
    if any("reference pose" in note for note in notes):
        again["reference"] = before.settled().reference
    return ccpin.load(file, **again, format=name), notes


def _through_pinocchio(before: ccpin.Mechanism) -> tuple[ccpin.Mechanism, Iterable[str]]:
    constraints = before.pinocchio_constraints()
    free = before.pin_model
    poses, stated = before.settled().reference, {joint.name: joint for joint in before.description.joints}
    springs = {
        name: {"stiffness": joint.stiffness, "spring_reference": joint.spring_reference}
        for name, joint in stated.items()
        if joint.stiffness
    }
    after = ccpin.load(
        free,
        constraints=constraints,
        independent=before.independent,
        actuated=before.actuated,
        reference={name: pose for name, pose in poses.items() if free.existJointName(name)},
        joints=springs,
        motors={motor.joint: {"gear": motor.gear} for motor in before.description.motors},
        free=() if before.locked else ["all"],
    )
    return after, [f"springs are stated again: {', '.join(springs)}"] if springs else []


def difference(before: ccpin.Mechanism, after: ccpin.Mechanism) -> float:
    """The largest difference of D, C and g at the reference and around it, relative to D's and to their own size."""
    if before.n != after.n:
        return np.inf
    one, other = (ccpin.ReducedModel(mechanism) for mechanism in (before, after))
    rng, worst = np.random.default_rng(1), 0.0
    for step in (np.zeros(before.n), *STEP * rng.uniform(-1.0, 1.0, (STATES, before.n))):
        v = SPEED * rng.uniform(-1.0, 1.0, before.n)
        state = one.at(one.coordinates.integrate(one.alpha(before.q_reference), step))
        near = _same(before, after, state.q_free)
        q = other.coordinates.integrate(other.alpha(after.q_reference), step) if near is None else other.alpha(near)
        mine, theirs = (
            (terms.D, terms.C, terms.g) for terms in (one.terms(state.q, v, state.q_free), other.terms(q, v, near))
        )
        size = np.abs(mine[0]).max()
        for a, b in zip(mine, theirs, strict=True):
            worst = max(worst, float(np.abs(b - a).max() / max(size, np.abs(a).max())))
    return worst


TOLD = {
    "velocity": "limits of velocity",
    "effort": "limits of effort",
    "lower": "limits of position",
    "upper": "limits of position",
    "gear": "motors (load",
    "bounds": "bounds of motors",
    "kind": "the loops closed around motors",
    "poses": "further poses",
}
"""What may be lost if the writer says so, and its words."""
DIGITS = 1e-9  # relative: of what is no part of D, C and g


def lost(before: ccpin.Mechanism, after: ccpin.Mechanism, told: str) -> tuple[str, ...]:
    """What of joints, motors and poses is other than it was, though the writer said nothing of it."""
    found = []
    back = {joint.name: joint for joint in after.description.joints}
    for joint in before.description.joints:
        for field in JOINT_FIELDS if joint.kind != "fixed" else ():
            if not np.isclose(getattr(joint, field), getattr(back[joint.name], field), rtol=DIGITS, atol=DIGITS):
                found.append((field, f"{field} of {joint.name}"))
    motors = {motor.joint: motor for motor in after.motors.each}
    for motor in before.motors.each if "motors (load" not in told else ():
        other = motors[motor.joint]
        found += [("gear", f"gear of {motor.name}")] * (not np.isclose(motor.gear, other.gear, rtol=DIGITS))
        bounds = [np.isclose(*pair, rtol=DIGITS) for pair in ((motor.lower, other.lower), (motor.upper, other.upper))]
        found += [("bounds", f"bounds of {motor.name}")] * (not all(bounds))
        found += [("kind", f"loop of {motor.name}")] * (motor.kind != other.kind)
        found += [("name", f"name of {motor.name}")] * (motor.name != other.name)
    found += [("poses", "poses")] * (before.description.poses.keys() != after.description.poses.keys())
    found += [("gravity", "gravity")] * (before.description.gravity != after.description.gravity)
    return tuple(what for field, what in found if field not in TOLD or TOLD[field] not in told)


def _same(before: ccpin.Mechanism, after: ccpin.Mechanism, q_free: np.ndarray) -> np.ndarray | None:
    """A configuration of the one as one of the other, joint by joint; ``None`` where free bodies are told otherwise.

    From here σ has nothing left to solve: what is compared are the two mechanisms, not where Newton's steps ended.
    """
    known = {joint.name: joint for joint in before.tree.joints}
    found = np.array(after.q_reference)
    for joint in after.tree.joints:
        if joint.name not in known or joint.stated.kind == "floating":
            return None
        found[joint.q] = joint.kind.stated(np.array(known[joint.name].kind.told(q_free[known[joint.name].q])))
    return found
