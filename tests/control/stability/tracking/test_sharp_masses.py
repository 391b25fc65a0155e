"""Bodies as tips: which of them there are, and what their weights may be off by."""

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.tracking.masses import masses_of
from ccpin.domain.closures.system import reading_of


def masses(name, **options):
    model = ccpin.ReducedModel(ccpin.load(name, **options))
    reading = reading_of(model.mechanism, model.mechanism.q_reference)
    return masses_of(model.mechanism, reading, model.gravity_vector), model


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
