"""Motions in contact against closed forms and the descriptor form; errors vanish with the integrator's tolerance."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad

import ccpin
from ccpin.simulation import Contact
from tests.oracles import descriptor
from tests.support.backends import same_on_both
from tests.support.carriage import carriage

G = 9.81


def assert_vanishing(errors, bound):
    """Each error is a tenth of the one at the looser tolerance before at most, and the last is below a bound."""
    assert all(later < 0.1 * former or later < bound for former, later in pairwise(errors))
    assert errors[-1] < bound


@same_on_both
def test_a_ball_bounces_for_ever():
    """A mass on a lossless floor: it meets it every 2v/g + (π + 2 atan(g/(vω)))/ω, ω² = k/m, and rises as high."""
    height, k = 0.2, 1e4
    speed, omega = np.sqrt(2 * G * height), np.sqrt(k)
    touching = (np.pi + 2 * np.arctan(G / (speed * omega))) / omega
    model, floor = carriage("z", (0.0, 0.0, -G)), Contact("carriage", stiffness=k, dissipation=0.0)
    errors = []
    for rtol in (1e-6, 1e-8, 1e-10):
        options = {"method": "DOP853", "rtol": rtol, "atol": rtol * 1e-2, "sample_period": 0.5}
        motion = ccpin.simulate(model, None, [height], duration=1.2, contacts=[floor], **options)
        met, left = ([event.t for event in motion.events if event.name.endswith(end)] for end in ("met", "left"))
        expected = speed / G + np.arange(len(met)) * (2 * speed / G + touching)
        assert len(met) == 3
        errors.append(max(np.abs(met - expected).max(), np.abs(left - expected[: len(left)] - touching).max()))
    assert_vanishing(errors, 1e-9)


@pytest.mark.parametrize(
    ("friction", "start"),
    [(0.5, 0.3), pytest.param(0.5, -0.4, marks=pytest.mark.slow), (0.2, -0.4)],
    ids=["sticks", "up", "slips"],
)
def test_a_block_on_a_slope(friction, start):
    """v̇ = g (sin θ − μ cos θ v/√(v² + v_s²)), by quadrature; where μ > tan θ it ends creeping at a part of v_s."""
    slope, slip, k = np.arctan(0.3), 1e-2, 1e5
    along, across = G * np.sin(slope), G * np.cos(slope)
    model = carriage("xz", (along, 0.0, -across))
    floor = Contact("carriage", stiffness=k, dissipation=0.0, friction=friction, slip=slip)

    def slowness(v):
        return 1.0 / (along - friction * across * v / np.hypot(v, slip))

    errors = []
    for rtol in (1e-5, 1e-7, 1e-9):
        motion = ccpin.simulate(
            model,
            None,
            [0.0, -across / k],
            [start, 0.0],
            duration=0.3,
            contacts=[floor],
            rtol=rtol,
            atol=rtol * 1e-2,
            sample_period=0.025,
        )
        speeds = motion.v[:, 0]
        creep = slip * 0.3 / np.sqrt(max(friction**2 - 0.09, 1e-9))
        moving = np.flatnonzero(np.abs(speeds - creep) > 1e-3) if friction > 0.3 else np.arange(len(speeds))
        times = [quad(slowness, start, speeds[i], points=[0.0], epsabs=1e-13, limit=500)[0] for i in moving]
        errors.append(float(np.abs(motion.t[moving] - times).max()))
    assert_vanishing(errors, 1e-7)
    np.testing.assert_allclose(motion.q[:, 1], -across / k, rtol=0, atol=1e-9)
    if friction > 0.3:
        assert speeds[-1] == pytest.approx(creep, rel=1e-6)


def test_a_closed_chain_in_contact_is_the_descriptor_forms():
    """A four-bar drops its coupler's tip on a rough floor: (19) with the force written anew over Pinocchio's frames."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    mechanism, free = model.mechanism, model.mechanism.pin_model
    tip, k, c, friction, slip = np.array([0.1, 0.0, 0.02]), 3e3, 0.4, 0.6, 0.05
    frame, world = free.getFrameId("coupler"), pin.LOCAL_WORLD_ALIGNED

    def moving(q_free, v_free):
        data = free.createData()
        pin.computeJointJacobians(free, data, q_free)
        pin.updateFramePlacements(free, data)
        arm = data.oMf[frame].rotation @ tip
        spatial = pin.getFrameJacobian(free, data, frame, world)
        jacobian = spatial[:3] - pin.skew(arm) @ spatial[3:]
        return (data.oMf[frame].translation + arm)[2], jacobian, jacobian @ v_free

    start = mechanism.q_reference
    height = moving(start, np.zeros(free.nv))[0] - 0.002

    def load(q_free, v_free):
        z, jacobian, velocity = moving(q_free, v_free)
        if z >= height:
            return np.zeros(free.nv)
        normal = k * (height - z) * max(0.0, 1 - c * velocity[2])
        sliding = np.array([velocity[0], velocity[1], 0.0])
        drag = friction * normal / np.sqrt(sliding @ sliding + slip**2)
        return jacobian.T @ (np.array([0.0, 0.0, normal]) - drag * sliding)

    expected = descriptor.integrate(
        mechanism.description, free, start, np.zeros(free.nv), 0.2, leg=0.01, rtol=1e-10, load=load
    )
    floor = Contact("coupler", tuple(tip), k, c, friction, slip, height=height)
    motion = ccpin.simulate(
        model, None, model.alpha(start), duration=0.2, contacts=[floor], friction={}, method="DOP853", rtol=1e-11
    )
    assert next(event.name for event in motion.events) == "'coupler' on the plane: met"
    np.testing.assert_allclose(motion.q_free[-1], expected.q_free, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        model.at(motion.q[-1], motion.q_free[-1]).v_free(motion.v[-1]), expected.v_free, rtol=0, atol=1e-6
    )
