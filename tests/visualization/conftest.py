"""What tests of pictures share: the five-bar, and its swing."""

import pytest

from tests.support.pages import five_bar, five_bar_swing


@pytest.fixture(scope="module")
def rpdr():
    """The five-bar."""
    return five_bar()


@pytest.fixture(scope="module")
def swing():
    """Times and configurations."""
    return five_bar_swing()
