"""Bodies as tips: which of them there are, and what their weights may be off by."""

from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.tracking.mass_reading import bodies_on_joints_of
from ccpin.control.stability.tracking.masses import masses_of
from ccpin.control.stability.tracking.motion_bounds import placed
from ccpin.domain.closures.system import reading_of
from ccpin.proof.balls import Affine
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF
from tests.support.flat_cells import heavy_based
from tests.support.open_configurations import assert_bounds_are_the_model
from tests.support.strategies import Growth


def masses(name, **options):
    model = ccpin.ReducedModel(ccpin.load(name, **options))
    reading = reading_of(model.mechanism, model.mechanism.q_reference)
    return masses_of(reading.system, bodies_on_joints_of(model.mechanism, reading, model.gravity_vector)), model


def test_second_moments_are_off_by_a_little_of_the_largest():
    """1e-14 of a body's largest; a centre of mass is where it is."""
    found, model = masses("rpdr")
    weights = np.concatenate([bodies.weights.mid for bodies in found.bodies])
    doubts = np.concatenate([bodies.weights.rad for bodies in found.bodies])
    fall = np.concatenate([bodies.fall for bodies in found.bodies])
    falling = np.any(fall != 0.0, axis=1)
    assert not doubts[falling].any()
    expected = []
    for inertia in list(model.mechanism.tree.model.inertias)[1:]:
        about = np.asarray(inertia.inertia)
        if about.any():
            moments = np.linalg.eigvalsh(0.5 * np.trace(about) * np.eye(3) - about)
            expected += [(m, 1e-14 * np.abs(moments).max()) for m in moments]
    told = sorted(zip(weights[~falling], doubts[~falling], strict=True))
    np.testing.assert_allclose(told, sorted(expected), rtol=1e-9)
    assert sorted(weights[falling]) == pytest.approx(
        sorted(i.mass for i in list(model.mechanism.tree.model.inertias)[1:] if i.mass)
    )


def test_what_only_slides_has_no_moments():
    """And what turns has three."""
    found, model = masses("slider_crank")
    tree = model.mechanism.tree.model
    turned = [bool(np.any(tree.inertias[k].inertia)) for k in (1, 2)]
    told = sum(len(bodies.weights.mid) for bodies in found.bodies)
    assert np.any(tree.inertias[3].inertia)
    assert told == sum(bool(i.mass) for i in list(tree.inertias)[1:]) + 3 * sum(turned)


def test_the_base_has_no_tips():
    """Nor gravity of its own: the free system is the same."""
    found = []
    for mechanism in (ccpin.load("rpdr"), heavy_based()):
        reading = reading_of(mechanism, mechanism.q_reference)
        found.append(
            [
                b.weights.mid.tolist()
                for b in masses_of(
                    reading.system, bodies_on_joints_of(mechanism, reading, np.array([0.0, 0.0, -9.8]))
                ).bodies
            ]
        )
    assert found[0] == found[1]


def test_slides_on_bodies_that_turn():
    """D, C and ∂τ/∂y where slides are carried round: of State, at one configuration."""
    growth = Growth(np.random.default_rng(7), True)
    growth.close("revolute", growth.grow("base", ["revolute", "prismatic"]), growth.grow("base", ["revolute"]))
    model = ccpin.ReducedModel(ccpin.load(growth.drawn().description))
    assert_bounds_are_the_model(model)


@pytest.mark.parametrize("rank", [1, 2])
def test_sums_over_chains_in_their_places(rank):
    """What chains share adds up, radii too, and 4u(C + 1) of all that is added."""
    rng = np.random.default_rng(2)
    joints = np.array([[0, 2], [2, 3], [1, 2]])  # of three coordinates; 3 is padded
    stack = SimpleNamespace(joints=joints, placement=np.zeros((6, 3)))
    shape = (2, 3, *[2] * rank)
    local = Affine(rng.normal(size=shape), rng.normal(size=(2, *shape)), rng.uniform(0, 1e-15, shape), 1)
    found = placed(stack, local, rank)
    mid, rad, size = (np.zeros((2, *[4] * rank)) for _ in range(3))
    lin = np.zeros((2, *mid.shape))
    for c in range(3):
        for at in np.ndindex(*[2] * rank):
            place, here = (..., *joints[c][list(at)]), (slice(None), c, *at)
            mid[place] += local.mid[here]
            lin[place] += local.lin[(slice(None), *here)]
            rad[place] += local.rad[here]
            size[place] += np.abs(local.mid[here]) + np.abs(local.lin[(slice(None), *here)]).sum(axis=0)
    inner = (..., *[slice(3)] * rank)
    np.testing.assert_allclose(found.mid, mid[inner], rtol=1e-14)
    np.testing.assert_allclose(found.lin, lin[inner], rtol=1e-14)
    exact = rad + 16 * UNIT_ROUNDOFF * size
    np.testing.assert_allclose(found.rad, exact[inner] * SLACK, rtol=1e-12, atol=0)
