"""What every test file shares: the case study loaded once, and reproducible Hypothesis runs."""

import os

import pytest
from hypothesis import HealthCheck, settings

import ccpin

_SLOW_DRAWS = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
settings.register_profile("reproducible", deadline=None, derandomize=True, suppress_health_check=_SLOW_DRAWS)
settings.register_profile("explore", deadline=None, max_examples=2000, suppress_health_check=_SLOW_DRAWS)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))


@pytest.fixture(scope="session")
def rpdr():
    """The Rice Planar Delta Robot."""
    return ccpin.load("rpdr")


@pytest.fixture(scope="session")
def rpdr_model(rpdr):
    """Its reduced model."""
    return ccpin.ReducedModel(rpdr)
