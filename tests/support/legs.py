"""The 3-RPR of the how-to on assembly modes, its first leg held still."""

import numpy as np

import ccpin
from tests.support.places import ROOT

LEG1 = 0.1498  # m: the slice that the how-to shows
WHOLE = np.array([[0.03, 0.03], [0.4, 0.4]])  # leg2 and leg3, m


def load_slice(leg1=LEG1, independent=None):
    """The mechanism with n = 2."""
    pose = {"leg1": leg1, "leg2": 0.15, "leg3": 0.17}
    return ccpin.load(ROOT / "docs/howto/planar_3rpr.urdf", locked=["leg1"], independent=independent, reference=pose)


def with_first_leg(q):
    """Leg lengths (K, 3) of points of the slice at 14.98 cm."""
    return np.column_stack([np.full(len(q), LEG1), q])
