"""Assembly modes against the RPDR's closed form, which has exactly two."""

import numpy as np
import pytest

import ccpin
from ccpin.dynamics import assembly_modes
from tests.oracles import rpdr


@pytest.fixture(scope="module")
def model() -> ccpin.ReducedModel:
    return ccpin.ReducedModel(ccpin.load("rpdr"))


def _by_number(model, q_free):
    pin_model = model.mechanism.pin_model
    return np.array([q_free[pin_model.idx_qs[pin_model.getJointId(f"joint{i}")]] for i in (1, 2, 3, 4)])


def test_the_rpdr_has_two_modes(model):
    """Away from singularities exactly the two closed-form configurations are found, one of them the reference's."""
    for q in np.radians([[-100.0, -80.0], [-150.0, -160.0], [-70.0, -110.0], [10.0, 40.0]]):
        found = assembly_modes(model, q)
        assert len(found.modes) == 2
        assert sum(mode.is_reference for mode in found.modes) <= 1
        assert {mode.sign for mode in found.modes} == {-1, 1}
        for mode in found.modes:
            q1, q2, q3, q4 = _by_number(model, mode.q_free)
            assert (q1, q2) == pytest.approx(q)
            assert np.abs(rpdr.phi((q1, q2, q3, q4))).max() < 1e-10
        shapes = [np.sin(np.dot(_by_number(model, mode.q_free), [1, -1, 1, -1])) for mode in found.modes]
        assert min(shapes) < 0 < max(shapes)


def test_no_mode_beyond_the_workspace(model):
    """Where the elbows are too far apart nothing is found."""
    assert assembly_modes(model, np.radians([180.0, 0.0])).modes == ()


def test_modes_are_deterministic(model):
    """Two searches give the same configurations, bit for bit."""
    first, second = (assembly_modes(model, [-1.7, -1.4]) for _ in range(2))
    assert all(np.array_equal(a.q_free, b.q_free) for a, b in zip(first.modes, second.modes, strict=True))
