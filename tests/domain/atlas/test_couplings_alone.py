"""Certificates of mechanisms that couplings alone tie together: φ is linear, so one box holds whatever its size."""

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.domain.atlas.square import newton_steps
from ccpin.errors import UnsupportedMechanismError
from tests.support.walkthrough import file

RATIOS = {"drive": 1.0, "pad_left_joint": -1.0, "follow": -1.0, "pad_right_joint": 1.0, "thumb": 0.5}
OFFSETS = {"follow": 0.05}


@pytest.fixture(params=["native", "numpy"])
def gripper(request, monkeypatch):
    monkeypatch.setenv("CCPIN_BACKEND", request.param)
    return ccpin.load(file("gripper"))


def closed_form(mechanism, drive):
    return np.array([RATIOS[name] * drive + OFFSETS.get(name, 0.0) for name in mechanism.tree.names])


@pytest.mark.parametrize("bounds", ["auto", "reach"])
def test_one_box_holds_everything(gripper, bounds):
    """The largest square tried is proved, and Newton needs one step at most."""
    assert domain.kantorovich_radius(gripper, gripper.q_reference, bounds) == 10.0
    assert newton_steps(gripper, gripper.q_reference, 0.5, bounds=bounds) == 1


def test_atlas_and_path_are_the_closed_form(gripper):
    """σ on the atlas and along a path is what the ratios and offsets say."""
    atlas = domain.certify(gripper, [0.0], ([-0.6], [0.6]))
    assert (atlas.certified_fraction, atlas.single_valued, len(atlas.lower)) == (1.0, True, 1)
    path = domain.certify_path(gripper, [[-0.5], [0.6]])
    assert path.verdict == "proven"
    for drive in (-0.5, 0.05, 0.6):
        expected = closed_form(gripper, drive)
        np.testing.assert_allclose(atlas.sigma([drive]), expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(path.sigma((drive + 0.5) / 1.1), expected, rtol=0, atol=1e-12)


def test_the_planar_form_is_refused(gripper):
    """There is no plane to speak of, and the message says what to ask for."""
    with pytest.raises(UnsupportedMechanismError, match="reach"):
        domain.kantorovich_radius(gripper, gripper.q_reference, "planar")


def _pair(kind, coefficients):
    body, z = Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.1 * np.eye(3)), np.array([0.0, 0.0, 1.0])
    links = (Link("base"), Link("a", body), Link("b", body))
    joints = (Joint("first", kind, "base", "a", axis=z), Joint("second", kind, "base", "b", axis=z))
    gear = Coupling("gear", (CouplingTerm("first", coefficients), CouplingTerm("second", (0.0, -1.0))))
    return ccpin.MechanismDescription("pair", "base", links, joints, couplings=(gear,))


@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_wheels_that_turn_for_ever(backend, monkeypatch):
    """Continuous joints geared 1 : 3 are certified round and round, their relation holding modulo 2π."""
    monkeypatch.setenv("CCPIN_BACKEND", backend)
    mechanism = ccpin.load(_pair("continuous", (0.0, 3.0)), independent=["first"])
    path = domain.certify_path(mechanism, [[0.0], [2.0], [4.0], [6.5]])
    assert path.verdict == "proven"
    wheel = mechanism.tree.joint("second").q
    np.testing.assert_allclose(path.sigma(3.0)[wheel], [np.cos(19.5), np.sin(19.5)], rtol=0, atol=1e-12)


def test_a_cam_is_refused_by_name():
    """Polynomials of degree two are beyond these bounds."""
    mechanism = ccpin.load(_pair("revolute", (0.0, 1.0, 0.5)), independent=["first"])
    with pytest.raises(UnsupportedMechanismError, match="coupling 'gear' is a polynomial of degree 2"):
        domain.kantorovich_radius(mechanism, mechanism.q_reference)
