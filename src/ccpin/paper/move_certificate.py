"""What Theorem 3 says of the paper's own move, and what closes the gap to its start."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point.sampled_region import sample_region
from ccpin.control.stability.set_point.set_point_certificate import SetPointCertificate
from ccpin.control.stability.set_point.theorem3 import certify_law

if TYPE_CHECKING:
    from ccpin.validated.sets.proved_move import MoveCertificate

_PRECISION = 128  # bits in which the move is enclosed
_RAY = 1e-3  # of a ray: how near its last point in B₂ is found


class Theorem3Facts(NamedTuple):
    """What Theorem 3 says of the paper's move.

    Attributes:
        certificate: About the goal.
        start: 𝒱 at the paper's start, joules.
        slope: sup ‖∂g/∂q‖ over 𝒟, sampled, N m/rad.
        near: The furthest start towards the paper's that B₂ holds.
        move: The proof that the paper's start ends in B₂ nevertheless; ``None`` without python-flint.
    """

    certificate: SetPointCertificate
    start: float
    slope: float
    near: Array
    move: MoveCertificate | None


def theorem3_facts(law: PDSimpleGravity, start: Array) -> Theorem3Facts:
    """Certify the law's goal, look where a start at rest lies, and prove what becomes of it.

    Args:
        law: (28) to the goal; its g is sampled over the box between start and goal, which is 𝒟.
        start: Of shape (2,), the lower corner of that box.
    """
    certificate = certify_law(law)
    value = law.lyapunov(start, np.zeros(2))
    slope = float(sample_region(law.model, start, law.q_d, law.q_free_d).norm.max())
    move = None
    if find_spec("flint") is not None:
        from ccpin.validated import certify_move

        move = certify_move(law.model, law, start, arrival=certificate, precision=_PRECISION)
    return Theorem3Facts(certificate, value, slope, _furthest(certificate, start - law.q_d), move)


def _furthest(certificate: SetPointCertificate, direction: Array) -> Array:
    """The last position at rest in B₂ along a ray from the set point, to 0.1 %."""
    inside, outside = 0.0, 1.0
    while outside - inside > _RAY:
        middle = 0.5 * (inside + outside)
        covered = certificate.contains(certificate.law.q_d + middle * direction)
        inside, outside = (middle, outside) if covered else (inside, middle)
    return np.asarray(certificate.law.q_d + inside * direction)
