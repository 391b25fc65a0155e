"""Scaled descriptions: what scaling laws say of D, g and the loops."""

import numpy as np
import pytest

import ccpin
from ccpin.description import scaled
from ccpin.errors import InvalidInputError

V = np.array([0.7, -1.3, 0.4])


@pytest.fixture(scope="module", params=["rpdr", "delta", "slider_crank"])
def mechanism(request):
    return ccpin.load(request.param)


def at_reference(mechanism):
    """The State at the reference, and a velocity."""
    model = ccpin.ReducedModel(mechanism)
    return model.at(model.alpha(mechanism.q_reference)), V[: model.n]


def test_denser_stuff(mechanism):
    """All masses and rotors times f: D and g times f, at the same configurations."""
    one, v = at_reference(mechanism)
    two, _ = at_reference(ccpin.load(scaled(mechanism.settled(), masses=1.7, armature=1.7)))
    np.testing.assert_allclose(two.q_free, one.q_free, rtol=0, atol=1e-12)
    np.testing.assert_allclose(two.D, 1.7 * one.D, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(two.g, 1.7 * one.g, rtol=1e-10, atol=1e-10)
    assert two.energy(v).kinetic == pytest.approx(1.7 * one.energy(v).kinetic, rel=1e-10)


def test_masses_add(mechanism):
    """D is linear in the links' inertias: what each adds when it alone doubles makes up the whole."""
    one, _ = at_reference(mechanism)
    bodies = [link.name for link in mechanism.description.links if link.inertia is not None]
    each = [{"masses": {name: 2.0}} for name in bodies] + [{"armature": 2.0}]
    alone = [at_reference(ccpin.load(scaled(mechanism.settled(), **part)))[0].D - one.D for part in each]
    np.testing.assert_allclose(sum(alone), one.D, rtol=1e-9, atol=1e-12)


def test_larger_by_lengths():
    """All lengths times f: angles stay, D times f² and g times f where all coordinates are angles."""
    mechanism = ccpin.load("rpdr")
    one, _ = at_reference(mechanism)
    two, _ = at_reference(ccpin.load(scaled(mechanism.settled(), lengths=1.3, armature=1.69)))
    np.testing.assert_allclose(two.q_free, one.q_free, rtol=0, atol=1e-9)
    np.testing.assert_allclose(two.D, 1.3**2 * one.D, rtol=1e-8)
    np.testing.assert_allclose(two.g, 1.3 * one.g, rtol=1e-8)


def test_inertia_alone():
    """A link's rotational inertia adds ½(f − 1)ωᵀIω to the kinetic energy; of a crank on the base ω is its own rate."""
    mechanism = ccpin.load("four_bar")
    one, v = at_reference(mechanism)
    two, _ = at_reference(ccpin.load(scaled(mechanism.settled(), inertias={"crank": 3.0})))
    joint = next(joint for joint in mechanism.description.joints if joint.child == "crank")
    inertia = next(link.inertia for link in mechanism.description.links if link.name == "crank")
    gain = joint.axis @ inertia.rotational @ joint.axis * v[0] ** 2
    assert two.energy(v).kinetic - one.energy(v).kinetic == pytest.approx(gain, rel=1e-9)


def test_one_longer_link_closes_anew():
    """The loops close with the new length: the slider-crank's stroke is √((l+r)²−e²) − √((l−r)²−e²)."""
    mechanism = ccpin.load("slider_crank")

    def stroke(factor):
        model = ccpin.ReducedModel(ccpin.load(scaled(mechanism.settled(), lengths={"crank": factor})))
        slide = next(joint.q.start for joint in model.mechanism.tree.joints if joint.kind.name == "prismatic")
        angles, q_free = np.linspace(0.0, 2 * np.pi, 721), model.mechanism.q_reference
        start, slides = model.alpha(q_free), []
        for angle in angles:
            q_free = model.sigma(start + angle, q_free)
            slides.append(q_free[slide])
        return np.ptp(slides)

    for factor in (1.0, 1.1):
        r, rod, offset = 0.04 * factor, 0.12, 0.02
        expected = np.sqrt((rod + r) ** 2 - offset**2) - np.sqrt((rod - r) ** 2 - offset**2)
        assert stroke(factor) == pytest.approx(expected, abs=1e-6)


def test_joints_numbers():
    """Friction, damping and rotor inertia are multiplied by joint."""
    stated = {"joint1": {"friction": 0.2, "damping": 0.1, "armature": 0.01}}
    mechanism = ccpin.load("rpdr", joints=stated)
    factors = {"friction": {"joint1": 1.5}, "damping": 2.0, "armature": {"joint1": 0.0}}
    joints = ccpin.load(scaled(mechanism.settled(), **factors)).joints
    at = joints.names.index("joint1")
    assert (joints.friction[at], joints.damping[at], joints.armature[at]) == pytest.approx((0.3, 0.2, 0.0))


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"masses": {"link_1": 2.0}}, "masses: there is no 'link_1'"),
        ({"friction": {"joint1": -1.0}}, "friction: the factor of 'joint1' = -1.0"),
        ({"lengths": 0.0}, "it must be positive"),
        ({"inertias": "many"}, "'many'"),
    ],
)
def test_bad_factors(factors, words):
    """Unknown names and impossible factors are named."""
    with pytest.raises(InvalidInputError, match=words):
        scaled(ccpin.load("rpdr").description, **factors)
