"""Closures to certify: models of the catalogue, and two arms joined by a closure of every kind."""

from dataclasses import replace

import numpy as np
from scipy.linalg import qr

import ccpin
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.domain.closures.system import reading_of
from ccpin.proof.equations import closure_values, problem_of

PLANAR = ("rpdr", "four_bar", "slider_crank", "planar_3rrr")
SPATIAL = ("delta", "stewart", "hexa")
KINDS = ("spherical", "revolute", "fixed", "prismatic", "cylindrical", "universal", "planar")
ARMS = {
    "spherical": (("revolute", "continuous", "prismatic", "planar"), ("spherical", "revolute", "prismatic")),
    "floating": (("revolute", "continuous", "prismatic", "planar"), ("prismatic", "floating")),
}


def random_frame(rng):
    frame = np.eye(4)
    frame[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    frame[:3, 0] *= np.sign(np.linalg.det(frame[:3, :3]))
    frame[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    return frame


def two_arms(arms, kind):
    """Two arms of many joint kinds on a common carrier, joined by a closure of one kind, with scalar coordinates."""
    rng = np.random.default_rng(3)
    body = Inertia(1.0, np.zeros(3), np.eye(3))
    links, joints = [Link("base", body), Link("carrier", body)], []

    def add(name, joint_kind, parent, child):
        axis = rng.standard_normal(3)
        joints.append(Joint(name, joint_kind, parent, child, random_frame(rng), axis / np.linalg.norm(axis)))

    add("stem", "revolute", "base", "carrier")
    tips = []
    for arm, kinds in zip("ab", arms, strict=True):
        parent = "carrier"
        for k, joint_kind in enumerate(kinds):
            links.append(Link(f"{arm}{k}", body))
            add(f"{arm}{k}_joint", joint_kind, parent, f"{arm}{k}")
            parent = f"{arm}{k}"
        tips.append(parent)
    loop = ccpin.LoopClosure("loop", kind, *tips, random_frame(rng), random_frame(rng))
    gear = Coupling("gear", (CouplingTerm("stem", (0.1, 2.0)), CouplingTerm("a0_joint", (0.0, 1.0))))
    description = ccpin.MechanismDescription(
        "arms", "base", tuple(links), tuple(joints), closures=(loop,), couplings=(gear,)
    )
    mechanism = ccpin.load(description)
    scalar = [j.name for j in joints if j.kind in ("revolute", "continuous", "prismatic")]
    for joint in joints:
        scalar += {"planar": [f"{joint.name}:{c}" for c in ("tx", "ty", "rz")]}.get(joint.kind, [])
        scalar += {"floating": [f"{joint.name}:{c}" for c in ("tx", "ty", "tz")]}.get(joint.kind, [])
    return replace(mechanism, independent=tuple(scalar[: mechanism.n]))


def closed_problem(name, bounds):
    mechanism = ccpin.load(name)
    reading = reading_of(mechanism, mechanism.q_reference)
    return reading.bounded(bounds).problem, reading.theta(mechanism.q_reference)


def open_problem(arms, kind):
    """The closures of two arms and open θ (n′,), with the best conditioned choice of dependent coordinates there."""
    mechanism = two_arms(arms, kind)
    system = reading_of(mechanism, mechanism.q_reference).system
    theta = np.random.default_rng(8).uniform(-0.8, 0.8, mechanism.n_free)
    jacobian = closure_values(problem_of(system, "reach"), theta[None])[1][0]
    order = qr(jacobian, pivoting=True)[2]  # that choice comes first
    system = replace(system, dependent=np.sort(order[: system.m]), independent=np.sort(order[system.m :]))
    return problem_of(system, "reach"), theta
