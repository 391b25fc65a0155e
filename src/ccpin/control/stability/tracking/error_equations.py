"""How the tracking error moves under each kind of law: all that a certificate asks of a law's kind, an entry each.

`ccpin/proof/theorems/tracking.md` has the error's equations, `storage.md` their storage functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import CellForms
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.proof.balls import product
from ccpin.proof.facts import require

_DECAYS = np.geomspace(0.02, 0.98, 40)  # of the largest α there can be: those tried
_CROSS = np.geomspace(0.01, 0.9, 24)  # of λ_min(K_v)/λ_max(D): the cross terms c tried
_KEPT = 0.98  # of the α a P was made for: leaves W − αP definite with room


class Feedback(NamedTuple):
    """What the theorem takes of a law: its kind, and its gains K_p and K_v, of shape (n, n)."""

    kind: str
    K_p: Array
    K_v: Array


class StorageChoice(NamedTuple):
    """Which storage function.

    Attributes:
        decay: α, 1/s.
        cross: c, 1/s; 0 for computed torque.
        scale: L's diagonal, of shape (n,).
        P: Computed torque's P, of shape (2n, 2n).
    """

    decay: float
    cross: float
    scale: Array
    P: Array | None


class ErrorEquation(NamedTuple):
    """The error's equation under a kind of law.

    Attributes:
        motion: The motion (q̇, q̇_r, q̈_r) whose force τ = D q̈_r + C q̇_r + damping q̇_r + g the law asks of the model.
        by_mass: Whether the feedback is in τ, multiplied by D: what drives the error is then D⁻¹(Gδ + f), else Gδ + f.
        choices: Storage functions to try, for deviations of a scale (n,) and D (K, n, n) at K places.
    """

    motion: Callable[[Feedback, CellForms], Motion]
    by_mass: bool
    choices: Callable[[Feedback, Array, Array], list[StorageChoice]]


def equation_of(kind: str) -> ErrorEquation:
    """The equation of the error under laws of a kind.

    Raises:
        NotProvedError: The theorem is not about such laws.
    """
    require(kind in ERROR_EQUATIONS, "a law that does not cancel what it tracks against")
    return ERROR_EQUATIONS[kind]


def _with_feedback(law: Feedback, states: CellForms) -> Motion:
    """Computed torque's: q̈_r = q̈_d + K_v ė + K_p e."""
    feedback = product("ij,kj->ki", law.K_p, states.e) + product("ij,kj->ki", law.K_v, states.e_dot)
    return Motion(states.v, states.v, states.a_d + feedback)


def _of_reference(law: Feedback, states: CellForms) -> Motion:
    """PD+'s: the reference's own."""
    return Motion(states.v, states.v_d, states.a_d)


def _ellipsoids(law: Feedback, scale: Array, D: Array) -> list[StorageChoice]:
    """Of the smallest ellipsoids that |L⁻¹Δ| ≤ 1 cannot leave, A Y + Y Aᵀ + αY + BL²Bᵀ/α = 0, P = Y⁻¹: one an α."""
    n = len(scale)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-law.K_p, -law.K_v]])
    slowest = -2.0 * float(np.linalg.eigvals(A).real.max())
    drive = np.zeros((2 * n, 2 * n))
    drive[n:, n:] = np.diag(scale**2)
    choices = []
    for decay in slowest * _DECAYS:
        Y = solve_continuous_lyapunov(A + 0.5 * decay * np.eye(2 * n), -drive / decay)
        P = np.linalg.inv(0.5 * (Y + Y.T))
        choices.append(StorageChoice(_KEPT * decay, 0.0, scale, 0.5 * (P + P.T)))
    return choices


def _crossed(law: Feedback, scale: Array, D: Array) -> list[StorageChoice]:
    """Cross terms c and decays α from a grid."""
    largest = float(np.linalg.eigvalsh(law.K_v)[0] / np.linalg.eigvalsh(D)[:, -1].max())
    return [StorageChoice(2.0 * c * share, c, scale, None) for c in largest * _CROSS for share in _DECAYS[::2]]


ERROR_EQUATIONS: Mapping[str, ErrorEquation] = MappingProxyType(
    {
        "computed_torque": ErrorEquation(_with_feedback, True, _ellipsoids),
        "pd_plus": ErrorEquation(_of_reference, False, _crossed),
    }
)
