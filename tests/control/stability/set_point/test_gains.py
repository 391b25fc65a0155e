"""Gains for a set point alone: the linearised loop's poles, on a mechanism with a locked spin and one of couplings."""

import numpy as np
import pytest

import ccpin
from ccpin.control import local_gains
from ccpin.errors import InvalidInputError
from tests.support.walkthrough import NAMES, file


@pytest.mark.parametrize("name", NAMES)
def test_every_mode_has_the_damping_and_at_least_the_frequency(name):
    """Poles of D ẍ + K_v ẋ + (K_p + ∂g/∂q) x = 0: −Re λ / |λ| = ζ and |λ| ≥ ω, and K_p is above ∂g/∂q."""
    model = ccpin.ReducedModel(ccpin.load(file(name)))
    q_d = model.alpha(model.mechanism.q_reference) + 0.1
    stiff, damper = local_gains(model, q_d, frequency=12.0, damping=0.6)
    mass, slope, n = model.at(q_d).D, model.gravity_derivative(q_d), model.n
    fall = -np.linalg.solve(mass, np.hstack([stiff + slope, damper]))
    poles = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), fall]))
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.6, rtol=0, atol=1e-9)
    assert np.abs(poles).min() >= 12.0 * (1.0 - 1e-9)
    assert np.linalg.eigvalsh(stiff)[0] > np.linalg.norm(slope, 2)


@pytest.mark.parametrize("wrong", [{"frequency": 0.0}, {"damping": -1.0}])
def test_bad_wishes(rpdr_model, wrong):
    """Frequency and damping are positive."""
    with pytest.raises(InvalidInputError, match="positive"):
        local_gains(rpdr_model, [-1.7, -1.4], **wrong)
