"""Geometry as exporters write it: turned as a whole, and every number rounded to some decimals."""

import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ccpin.description.model import frame
from ccpin.mechanism.motion.mobility import null_space
from ccpin.mechanism.poses.loop_closing import close


def rounded(description, decimals, seed=3):
    """A description tilted by a random rotation, with positions, angles, axes and lengths rounded as in a URDF."""
    tilt = frame(np.zeros(3), Rotation.random(random_state=seed).as_matrix())

    def placed(placement, link):
        placement = tilt @ placement if link == description.root else placement
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # gimbal lock: any of the angles will do
            angles = Rotation.from_matrix(placement[:3, :3]).as_euler("xyz")
        angles = np.round(angles, decimals)
        return frame(np.round(placement[:3, 3], decimals), Rotation.from_euler("xyz", angles).as_matrix())

    joints = []
    for joint in description.joints:
        axis = np.round(joint.axis, decimals)
        joints.append(replace(joint, placement=placed(joint.placement, joint.parent), axis=axis / np.linalg.norm(axis)))
    closures = tuple(
        replace(
            closure,
            placement_a=placed(closure.placement_a, closure.link_a),
            placement_b=placed(closure.placement_b, closure.link_b),
            length=None if closure.length is None else round(closure.length, decimals),
        )
        for closure in description.closures
    )
    gravity = tuple((tilt[:3, :3] @ description.gravity).tolist())
    return replace(description, joints=tuple(joints), closures=closures, gravity=gravity)


def poses_along(mechanism, count, seed=0):
    """Closed, regular poses along a mechanism's motion: random steps of up to 0.5 rad or m from its reference."""
    constraints, parametrization = mechanism.constraints(), mechanism.parametrization()
    generator, here, found = np.random.default_rng(seed), mechanism.q_reference, []
    for _ in range(20 * count):
        if len(found) == count:
            break
        basis = null_space(constraints, here, mechanism.mobility.rank)
        step = basis @ generator.standard_normal(basis.shape[1])
        step *= generator.uniform(0.1, 0.5) / np.linalg.norm(step)
        attempt = close(constraints, pin.integrate(constraints.model, here, step))
        if attempt.closed and constraints.aligned(attempt.q_free) and parametrization.rcond(attempt.q_free) > 1e-4:
            here = attempt.q_free
            found.append(here)
    return found
