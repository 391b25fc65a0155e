"""Mechanisms with every joint kind that enclosures know, at random states, and their numbers as balls."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin import MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link
from tests.support.ball_joint import ball_joint
from tests.support.families import revolute_delta
from tests.support.linkages import rssr, stewart_on_balls
from tests.support.rods import rod_four_bar

flint = pytest.importorskip("flint")

from ccpin.validated.arithmetic.balls import ball  # noqa: E402

X, Y, Z = np.eye(3)


def numbers(box):
    return np.array([float(x.mid()) for x in box])


def balls(*arrays):
    return [ball(float(x)) for x in np.concatenate(arrays)]


def body(mass, *com):
    return Inertia(mass, np.array(com), np.diag([2e-3, 3e-3, 4e-3]) * mass)


def at(*position):
    placement = np.eye(4)
    placement[:3, 3] = position
    return placement


def with_kinds(name, **kinds):
    """A description of `models/` with some joints of another kind (a joint's axis stays)."""
    described = ccpin.load(name).description
    joints = (
        replace(j, kind=kinds[j.name], lower=-np.inf, upper=np.inf) if j.name in kinds else j for j in described.joints
    )
    return replace(described, joints=tuple(joints))


def planar_platform():
    """The 3-RRR whose platform has one planar joint where `models/` has two slides and a turn."""
    described = ccpin.load("planar_3rrr").description
    first, _, last = (j for j in described.joints if j.name.startswith("platform_"))
    joint = Joint("platform", "planar", first.parent, last.child, first.placement, axis=Y)
    others = tuple(j for j in described.joints if not j.name.startswith("platform_"))
    used = {j.child for j in (*others, joint)} | {described.root}
    return replace(
        described,
        joints=(*others, joint),
        links=tuple(link for link in described.links if link.name in used),
        reference={name: pose for name, pose in described.reference.items() if not name.startswith("platform_")},
    )


def geared(curve, kind="revolute", references=(0.0, 0.0), **of_wheel):
    """A crank with a spring, geared by a polynomial to a wheel, references and all; both out of balance."""
    links = Link("base"), Link("crank", body(1.0, 0.1, 0.0, 0.02)), Link("wheel", body(0.5, 0.05, 0.02, 0.0))
    joints = (
        Joint("crank", "revolute", "base", "crank", axis=Y, stiffness=0.4, spring_reference=0.3, damping=0.05),
        Joint("wheel", kind, "base", "wheel", at(0.4, 0.0, 0.0), axis=Y, damping=0.01, **of_wheel),
    )
    pairs = zip(("crank", "wheel"), (curve, (0.0, -1.0)), references, strict=True)
    gears = tuple(CouplingTerm(*pair) for pair in pairs)
    named = {"independent": ("crank",), "actuated": ("crank",)}
    return MechanismDescription("gears", "base", links, joints, couplings=(Coupling("gear", gears),), **named)


def gear_train():
    """Three to one, to a wheel that turns without end."""
    return geared((0.0, 3.0), "continuous")


def ball_and_universal(**stated):
    """The spatial four-bar whose rod is held by a universal joint at its other end: none of its motions is idle."""
    described = rssr()
    joints = tuple(replace(j, **stated) if j.name == "ball" else j for j in described.joints)
    return replace(described, joints=joints, closures=(replace(described.closures[0], kind="universal"),))


def flying_four_bar():
    """A four-bar on a floating base: eight numbers, seven velocities."""
    return ccpin.load("four_bar", floating_base=True)


MECHANISMS = {
    "ball, independent": lambda: ball_joint().mechanism,
    "ball, dependent": lambda: ccpin.load(rssr()),
    "ball and universal": lambda: ccpin.load(ball_and_universal(damping=0.1)),
    "ball with a spring": lambda: ccpin.load(ball_and_universal(stiffness=3.0)),
    "single turn": lambda: ccpin.load(rssr(), free=["all"], independent=["crank", "ball:rx"]),
    "balls of a Stewart platform": lambda: ccpin.load(stewart_on_balls()),
    "continuous": lambda: ccpin.load(with_kinds("rpdr", **{f"joint{k}": "continuous" for k in range(1, 5)})),
    "floating": flying_four_bar,
    "geared": lambda: ccpin.load(gear_train()),
    "rod": lambda: ccpin.load(rod_four_bar()),
    "planar": lambda: ccpin.load(planar_platform()),
    "redundant": lambda: ccpin.load("bennett"),
    "many redundant": lambda: ccpin.load(revolute_delta()),
}


def random_state(model, seed=1, size=0.03):
    rng = np.random.default_rng(seed)
    q = model.coordinates.integrate(model.alpha(model.mechanism.q_reference), size * rng.normal(size=model.n))
    return model.at(q), 0.5 * rng.normal(size=model.n)


def x_rate(loop, state, v):
    """Ẋ from the joints' own rates of q′, and q̇ for single turns."""
    q_free, v_free, rates = state.q_free, state.rho @ v, []
    for joint in loop.own.joints:
        rate = joint.kind.rate(q_free[joint.q], v_free[joint.v])
        rates += [*rate[:-2], v_free[joint.v][-1]] if joint.kind.unit == 2 else [*rate]
    parts = (part for part in state.model.coordinates.parts if part.kind.unit == 4 and part.component is not None)
    return np.array([*rates, *(v[part.v.start] for part in parts if not part.slides[0])])
