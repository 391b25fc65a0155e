"""What tests of enclosures share: precision, and the paper's law."""

import pytest

from tests.support.enclosures import paper_law


@pytest.fixture
def precise():
    """The precision, in bits, that enclosures are computed with."""
    flint = pytest.importorskip("flint")
    with flint.ctx.workprec(128):
        yield


@pytest.fixture(scope="module")
def law(rpdr_model):
    """The law of the paper's move."""
    return paper_law(rpdr_model)
