"""Dexterity over a box where more coordinates are independent than depend, against the closed form at random points."""

from __future__ import annotations

import numpy as np
import pytest

from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.domain.closures.seeds import seed_at_configuration
from ccpin.proof.equations import Requirements, closure_values
from ccpin.proof.newton import predict
from ccpin.proof.requirements import _first, conditioning
from tests.support.carriages import joint, linkage, pin

A, B, C, D, E, BASE = 0.5, 0.4, 0.02, 0.45, 0.45, 0.3
UNITS = np.array([1.0, 1.0, 0.05])  # the third coordinate moves the tip little


@pytest.fixture(scope="module")
def arms():
    """An arm of three links and one of two that meet in a pin: n = 3, m = 2."""
    joints = (
        joint("revolute", "a", "base"),
        joint("revolute", "b", "a_body", A),
        joint("revolute", "c", "b_body", B),
        joint("revolute", "d", "base", BASE),
        joint("revolute", "e", "d_body", D),
    )
    return linkage("two arms", joints, (pin("c", "e", C, end=E),), (), ["a", "b", "c"])


def steps(angles, lengths):
    """∂tip/∂(joint angles) of an arm of links, (2, links)."""
    directions = np.cumsum(angles)
    parts = np.array(lengths) * np.array([-np.sin(directions), np.cos(directions)])
    return np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]


def driven_rates(theta):
    """∂(c, d, e)/∂(a, b, c) by the two arms' Jacobians, at closed angles (5,)."""
    three, two = steps(theta[:3], (A, B, C)), steps(theta[3:], (D, E))
    return np.vstack([[0.0, 0.0, 1.0], np.linalg.solve(two, three)])


def closed(q, near):
    """The angles (5,) at q whose elbow is bent as `near`'s."""
    turned = np.cumsum(q)
    gap = np.array([A, B, C]) @ np.column_stack([np.cos(turned), np.sin(turned)]) - [BASE, 0.0]
    bend = np.sign(np.sin(near[4])) * np.arccos((gap @ gap - D**2 - E**2) / (2 * D * E))
    first = np.arctan2(gap[1], gap[0]) - np.arctan2(E * np.sin(bend), D + E * np.cos(bend))
    return np.array([*q, first, bend])


@pytest.fixture(scope="module")
def start(arms):
    """(θ's order of a … e, the problem, closed angles there, the seed's θ)."""
    order = [joint.q.start for name in "abcde" for joint in arms.tree.joints if joint.name == name]
    near = closed(np.array([1.9, -1.2, 0.3]), np.array([0.0, 0.0, 0.0, 0.0, 1.0]))
    configuration = np.empty(5)
    configuration[order] = near
    seed = seed_at_configuration(arms, configuration)
    return order, seed.reading.bounded("reach").problem, near, seed.theta


@pytest.mark.parametrize("half", [0.002, 0.02, 0.04])
def test_every_column_of_f_is_bounded(start, half):
    """Of three columns in two places only the last two were: the first was given the third's bound."""
    _, problem, _, theta = start
    boxes = certify_boxes(problem, theta[None], np.full((1, 3), half), np.eye(3)).boxes
    bound, rng = _first(problem, boxes)[0], np.random.default_rng(5)
    most = np.zeros_like(bound)
    for _ in range(300):
        delta = half * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], size=3)
        zeta = boxes.radius[0] * rng.uniform(-1.0, 1.0, 2)
        at = predict(problem, boxes, delta[None], zeta[None])
        slope = boxes.preconditioner[0] @ closure_values(problem, at)[1][0] @ boxes.directions[0]
        most = np.maximum(most, np.abs(slope))
    assert np.all(most <= bound)
    assert np.all(bound[:, 0] < 6.0 * most[:, 0].max() + 1e-9)


@pytest.mark.parametrize("half", [0.002, 0.02, 0.04])
@pytest.mark.parametrize("driven", [(2, 3, 4), (0, 3, 4)])
def test_dexterity_with_more_independent_than_dependent_coordinates(start, half, driven):
    """0.0787 was claimed where 0.0663 is true."""
    order, problem, near, theta = start
    unlimited = np.full(5, np.inf)
    demands = Requirements(-unlimited, unlimited, np.array([order[k] for k in driven]), UNITS, 0.0)
    tried = certify_boxes(problem, theta[None], np.full((1, 3), half), np.eye(3))
    assert tried.proved.all()
    low, high = conditioning(problem, demands, tried.boxes)
    truth, rng = [], np.random.default_rng(3)
    for _ in range(400):
        offset = half * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], size=3)
        rates = np.vstack([np.eye(3), driven_rates(closed(near[:3] + offset, near))[1:]])[list(driven)] / UNITS
        sizes = np.linalg.svd(rates, compute_uv=False)
        truth.append(sizes[-1] / sizes[0])
    assert low[0] <= min(truth)
    assert max(truth) <= high[0]
    assert half > 0.002 or low[0] > 0.85 * min(truth)
