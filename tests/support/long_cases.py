"""Cases that say on another mechanism, seed or setting what a quicker one says: `pytest -m slow` runs them."""

import pytest


def later(*values):
    """The first value as it is, the rest as cases for long runs."""
    first, *rest = values
    return [first, *(pytest.param(value, marks=pytest.mark.slow) for value in rest)]
