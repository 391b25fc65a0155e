"""The half width or radius proved to be too large holds wherever the obstacle is within its error."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.domain.atlas.cover import SquareNorm
from ccpin.domain.workspaces.largest import LargestWorkspace
from ccpin.proof.verdict import Witness

ERROR = 1e-3


@pytest.mark.parametrize("round", [False, True])
@pytest.mark.parametrize("weights", [[1.0, 1.0, 1.0], [1.0, 2.0, 0.5], [1.0, 1.0, 0.0]])
def test_the_upper_bound_is_attained_and_holds(round, weights):
    """An obstacle off by its error in every coordinate, away from the centre: of a ball that is √n times as far."""
    shape = SquareNorm(np.array(weights), round)
    found = LargestWorkspace(np.zeros(3), 0.1, round, np.zeros(0), SimpleNamespace(), shape)
    direction = np.ones(3)
    found.__dict__["obstacle"] = Witness("singular", 0.3 * direction * (shape.weights > 0), None, ERROR)
    if round:  # along the weights, where the two lengths add up
        found.__dict__["obstacle"] = Witness("singular", 0.3 * direction, None, ERROR)
    worst = float(shape.of(np.abs(found.obstacle.q + ERROR)[None])[0])
    assert worst <= found.upper <= worst * (1.0 + 1e-9)
