"""Models loaded once a file."""

import pytest

import ccpin


@pytest.fixture(scope="module")
def loaded():
    kept = {}

    def model(name):
        if name not in kept:
            kept[name] = ccpin.ReducedModel(ccpin.load(name))
        return kept[name]

    return model
