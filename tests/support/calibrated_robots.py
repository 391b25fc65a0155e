"""Robots whose geometry is other than their files state, and what encoders and a tracker say of them.

A robot as built is its description with frames moved and turned here, loaded anew: nothing of it is recorded.
"""

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import ccpin
from ccpin.identification import Sensor, calibrate, calibration_poses
from ccpin.identification.calibration.geometry_numbers import numbers_that_count
from ccpin.kinematics.points import LinkPoint

INSIDE = 1.959964  # standard deviations: 95 % of normal errors are within
ENCODER, TRACKER = 1e-5, 5e-5  # rad or m, m
ORIGIN, TURN = 1e-3, np.radians(0.1)  # how far files are off
COARSEST = 1e-3
TOOLS = {"rpdr": ("link3", (0.3048, 0.0, 0.0)), "delta": ("platform", (0.02, 0.01, -0.05))}
TOOLS |= {"stewart": ("platform", (0.0, 0.0, 0.1))}
SPANS = {"rpdr": np.radians(25.0), "delta": 0.3, "stewart": 0.05}


def moved(description, told):
    """The description with origins and turns of joints and closures as told by names of numbers."""

    def frame(placement, of):
        placement = np.array(placement)
        for k, axis in enumerate("xyz"):
            placement[k, 3] = told.get(f"origin:{of}/{axis}", placement[k, 3])
        angles = [told.get(f"turn:{of}/{axis}", 0.0) for axis in "xyz"]
        placement[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix() @ placement[:3, :3]
        return placement

    return replace(
        description,
        joints=tuple(replace(each, placement=frame(each.placement, each.name)) for each in description.joints),
        closures=tuple(
            replace(
                each,
                placement_a=frame(each.placement_a, f"{each.name}/A"),
                placement_b=frame(each.placement_b, f"{each.name}/B"),
            )
            for each in description.closures
        ),
    )


class Built(NamedTuple):
    """A robot as it was built, and what it is off."""

    truth: dict
    model: ccpin.ReducedModel
    base: np.ndarray
    offsets: np.ndarray


class Robot:
    """A robot of an installed model, whose tool a tracker sees."""

    def __init__(self, name):
        self.name, self.stated = name, ccpin.ReducedModel(ccpin.load(name))
        self.link, self.point = TOOLS[name]
        self.joints = self.stated.mechanism.independent
        self.middle = self.stated.alpha(self.stated.mechanism.q_reference)
        self.box = self.middle - SPANS[name], self.middle + SPANS[name]
        self.known = [each.name for each in self.stated.mechanism.tree.joints if each.name.startswith("platform_")]
        self.sensors = Sensor.encoders(self.joints, ENCODER), Sensor.tracker(self.link, TRACKER, point=self.point)

    @cached_property
    def poses(self):
        """40 poses for its tracker."""
        return calibration_poses(
            self.stated, 40, measure=self.sensors, within=self.box, parameters=["origin", "turn"],
            known=self.known, coarsest=COARSEST,
        )  # fmt: skip

    @property
    def everything(self):
        """All origins and turns that count."""
        every = numbers_that_count(self.stated, [self.link])
        return [each.name for each in every if each.of.split("/")[0] not in self.known]

    def built(self, rng, numbers=None):
        """One whose numbers (default those that the poses determine) are off, as are its encoders."""
        description, numbers = self.stated.mechanism.description, self.poses.base if numbers is None else numbers
        frames = {each.name: each.placement for each in description.joints}
        for each in description.closures:
            frames |= {f"{each.name}/A": each.placement_a, f"{each.name}/B": each.placement_b}
        truth = {}
        for name in numbers:
            kind, _, of = name.partition(":")
            owner, _, axis = of.rpartition("/")
            value = frames[owner]["xyz".index(axis), 3] if kind == "origin" else 0.0
            truth[name] = value + (ORIGIN if kind == "origin" else TURN) * rng.normal()
        model = ccpin.ReducedModel(ccpin.load(moved(description, truth)))
        slides = [joint.kind.slides[0] for joint in model.mechanism.tree.joints if joint.name in self.joints]
        offsets = np.where(slides, ORIGIN, TURN) * rng.normal(size=len(self.joints))
        base = np.eye(4)
        base[:3, :3], base[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
        truth |= {f"offset:{name}": value for name, value in zip(self.joints, offsets, strict=True)}
        return Built(truth, model, base, offsets)

    def seen(self, built, q):
        """Where the tool is in the tracker's axes, of shape (N, 3)."""
        return tool(built.model, self.link, self.point, q) @ built.base[:3, :3].T + built.base[:3, 3]

    def measured(self, built, q, rng, noise=1.0):
        """What encoders and tracker say at q, with errors."""
        said = q + built.offsets + noise * ENCODER * rng.normal(size=q.shape)
        return (self.sensors[0], said), (
            self.sensors[1],
            self.seen(built, q) + noise * TRACKER * rng.normal(size=(len(q), 3)),
        )

    def calibrated(self, built, q, rng, noise=1.0, **options):
        """The geometry found of it."""
        if "parameters" not in options:
            options["parameters"] = self.poses.base
        return calibrate(self.stated, self.measured(built, q, rng, noise), **({"coarsest": COARSEST} | options))


def tool(model, link, point, q):
    """Where a link's point is, of shape (N, 3), by Pinocchio's kinematics."""
    at = LinkPoint(model.mechanism.tree, link, point)
    return np.array([at.pose(q_free)[:3, 3] for q_free in model.sigma_many(q)])


def deviations(found, truth):
    """Errors of the numbers that are known and determined, in predicted standard deviations."""
    pairs = zip(found.parameters, found.values, found.standard_deviations, strict=True)
    return np.array([(value - truth[name]) / s for name, value, s in pairs if name in truth and np.isfinite(s)])


def tool_errors(robot, built, found, q):
    """Distances of the tool from where the file, in the frame that fits best, and the calibration have it at q, m."""
    true, offsets = robot.seen(built, q), dict(zip(found.parameters, found.values, strict=True))
    said = q + built.offsets
    before = tool(robot.stated, robot.link, robot.point, said)
    turn, _ = Rotation.align_vectors(true - true.mean(axis=0), before - before.mean(axis=0))
    before = turn.apply(before - before.mean(axis=0)) + true.mean(axis=0)
    model, base = ccpin.ReducedModel(ccpin.load(found.description)), found.frames["tracker"]
    joints = said - [offsets.get(f"offset:{name}", 0.0) for name in robot.joints]
    after = tool(model, robot.link, robot.point, joints) @ base[:3, :3].T + base[:3, 3]
    return np.linalg.norm(true - before, axis=1), np.linalg.norm(true - after, axis=1)
