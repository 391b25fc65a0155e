"""What every test file shares: the case study loaded once, reproducible Hypothesis runs, and Ctrl-C that is heard."""

import gc
import os
import signal

import pytest
from hypothesis import HealthCheck, settings

import ccpin
from tests.support.paper import CURVED

_SLOW_DRAWS = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
settings.register_profile("reproducible", deadline=None, derandomize=True, suppress_health_check=_SLOW_DRAWS)
settings.register_profile("explore", deadline=None, max_examples=2000, suppress_health_check=_SLOW_DRAWS)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as shells start what they put in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # until all tests are collected, which make no garbage


def pytest_collection_finish():
    """Tests and modules stay to the end: the collector does not look through them every time, which takes long."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def rpdr():
    """The Rice Planar Delta Robot."""
    return ccpin.load("rpdr")


@pytest.fixture(scope="session")
def rpdr_model(rpdr):
    """Its reduced model."""
    return ccpin.ReducedModel(rpdr)


@pytest.fixture(scope="session")
def model(rpdr_model):
    """The model of files that make none of their own."""
    return rpdr_model


@pytest.fixture(scope="session")
def rpdr_curves(rpdr):
    """All its singular curves over a region that holds one of each kind."""
    return ccpin.domain.certify_singularities(rpdr, CURVED)
