"""What lies in an audited box's tube, at its ends, and turns away from it."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.auditing.gluing import in_tube

TURN = 2 * np.pi


def told(q=0.5, y=0.0, radius=0.0, turn=0.0, periodic=True, tube=0.25):
    """in_tube for the box |q − ½| ≤ ¼ with y = 1 + ½ (q − ½) + ζ, |ζ| ≤ tube; `y` is told from there."""
    document = SimpleNamespace(
        centre=np.array([[0.5, 1.0]]),
        directions=np.array([[[1.0], [0.5]]]),
        modes=np.ones((1, 1, 1)),
        radius=np.array([[tube]]),
        half=np.array([[0.25]]),
        independent=np.array([0]),
        dependent=np.array([1]),
        periodic=np.array([False, periodic]),
    )
    theta = np.array([q + turn, 1.0 + 0.5 * (q - 0.5) + y])
    return in_tube(document, 0, theta, radius, np.array([turn]))


@pytest.mark.parametrize("side", [-1, 1])
def test_a_ball_is_in_a_tube_up_to_its_end(side):
    for q in (0.26, 0.5, 0.74):
        assert told(q, side * 0.2, 0.0499) is True
        assert told(q, side * 0.2, 0.0501) is None
        assert told(q, side * 0.3, 0.0499) is False
    assert told(0.5 + side * 0.251) is None


def test_angles_are_taken_by_their_nearest_turn():
    for turns in (-10, 10):
        assert told(y=turns * TURN, turn=turns * TURN, radius=1e-6) is True
        assert told(y=turns * TURN, radius=1e-6, periodic=False) is False
