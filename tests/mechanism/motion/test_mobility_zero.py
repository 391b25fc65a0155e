"""A mechanism that cannot move: all that can be said of it is, and what cannot is told."""

import numpy as np
import pytest

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.control import Measurement, PDFullGravity
from ccpin.description import Inertia, Joint, Link
from ccpin.description.model import frame
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.simulation.results.forces import closure_forces_at
from tests.oracles import descriptor

Y = (0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def triangle():
    """Two bars, 0.6 and 0.8 m, pinned 1 m apart and to each other: a right-angled triangle."""
    bars = (Link(name, Inertia(1.0, [0.1, 0, 0], 0.01 * np.eye(3))) for name in "ab")
    joints = (
        Joint("j1", "revolute", "world", "a", axis=Y),
        Joint("j2", "revolute", "world", "b", placement=frame([1.0, 0, 0]), axis=Y),
    )
    pin = LoopClosure("pin", "spherical", "a", "b", frame([0.6, 0, 0]), frame([-0.8, 0, 0]))
    return ccpin.ReducedModel(
        ccpin.load(MechanismDescription("triangle", "world", (Link("world"), *bars), joints, (pin,)))
    )


def test_statics_of_a_frame(triangle):
    """q is empty, and λ carries the weight as the descriptor form (19) says."""
    state, none = triangle.at([]), np.zeros(0)
    assert state.D.shape == state.damping.shape == state.C(none).shape == (0, 0)
    assert state.forward_dynamics(none, none).shape == (0,)
    description, model = triangle.mechanism.description, triangle.mechanism.pin_model
    expected = descriptor.direct(description, model, state.q_free, np.zeros(2), np.zeros(2))
    force = triangle.mechanism.constraints().value(state.q_free).jacobian.T @ state.constraint_forces(none, none)
    np.testing.assert_allclose(force, expected.force, rtol=1e-10)
    assert closure_forces_at(triangle, [], none, none)[0].force.shape == (1, 3)
    assert PDFullGravity(triangle, [], [], []).torque(0.0, Measurement(none), none).shape == (0,)


def test_what_needs_motion_is_refused(triangle):
    """There is nothing to simulate and nothing to certify."""
    with pytest.raises(UnsupportedMechanismError, match="mobility 0"):
        ccpin.simulate(triangle, None, [], duration=0.1)
    with pytest.raises(UnsupportedMechanismError, match="mobility 0"):
        ccpin.domain.certify(triangle, [])


@pytest.mark.parametrize("call", [ccpin.ReducedModel, lambda name: ccpin.simulate(name, None, [0, 0], duration=1.0)])
def test_a_name_is_no_mechanism(call):
    """A model's name is to be loaded first, and the error says so."""
    with pytest.raises(InvalidInputError, match=r"ccpin.load.*not str"):
        call("rpdr")
