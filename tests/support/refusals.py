"""What the kernel refuses."""

import pytest

from ccpin.proof.facts import NotProvedError, prove


def refused(make, *premises):
    """That no fact comes of a claim, or of what should have been one."""
    with pytest.raises(NotProvedError):
        prove(make(), *premises)
