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
from ccpin.control.control_law import kind_of
from ccpin.control.stability.tracking.motion_bounds import Motion
from ccpin.control.stability.tracking.reference_tube import CellForms
from ccpin.control.stability.tracking.storage import StorageChoice, gain, storage_of, widths
from ccpin.control.statements import LawKind
from ccpin.control.tracking import TrackingLaw
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.balls import affine, product

_DECAYS = np.geomspace(0.02, 0.98, 40)  # of the largest α there can be: those tried
_CROSS = np.geomspace(0.01, 0.9, 24)  # of λ_min(K_v)/λ_max(D): the cross terms c tried
_KEPT = 0.98  # of the α a P was made for: leaves W − αP definite with room


class ErrorEquation(NamedTuple):
    """The error's equation under a kind of law.

    Attributes:
        motion: The motion (q̇, q̇_r, q̈_r) whose force τ = D q̈_r + C q̇_r + damping q̇_r + g the law asks of the model.
        by_mass: Whether the feedback is in τ, multiplied by D: what drives the error is then D⁻¹(Gδ + f), else Gδ + f.
        choices: Storage functions to try, for deviations of a scale (n,) and D (K, n, n) at K places.
    """

    motion: Callable[[TrackingLaw, CellForms], Motion]
    by_mass: bool
    choices: Callable[[TrackingLaw, Array, Array], list[StorageChoice]]


def equation_of(law: TrackingLaw) -> ErrorEquation:
    """The equation of a law's error.

    Raises:
        UnsupportedMechanismError: The theorem is not about laws of its kind.
    """
    kind = kind_of(law)
    equation = None if kind is None else ERROR_EQUATIONS.get(kind)
    if equation is None:
        raise UnsupportedMechanismError(
            f"a {type(law).__name__} does not cancel what it tracks against, so its error is no matter of σ alone: "
            "certify a ComputedTorque or PDPlus law"
        )
    return equation


def choice_for(law: TrackingLaw, scale: Array, D: Array, C: Array, damping: Array) -> StorageChoice | None:
    """The storage function whose bound of e is about the least, for deviations of a scale and terms at K places."""
    best, least, n, terms = None, np.inf, len(scale), [affine(term) for term in (D, C, damping)]
    for choice in equation_of(law).choices(law, scale, D):
        storage = storage_of(law, choice, *terms)
        with np.errstate(all="ignore"):
            reach = gain(storage, choice)[:, None] * widths(storage)[:, :n] / scale
        worst = float(reach.sum(axis=1).max())
        if worst < least:
            best, least = choice, worst
    return best


def _with_feedback(law: TrackingLaw, states: CellForms) -> Motion:
    """Computed torque's: q̈_r = q̈_d + K_v ė + K_p e."""
    feedback = product("ij,kj->ki", law.K_p, states.e) + product("ij,kj->ki", law.K_v, states.e_dot)
    return Motion(states.v, states.v, states.a_d + feedback)


def _of_reference(law: TrackingLaw, states: CellForms) -> Motion:
    """PD+'s: the reference's own."""
    return Motion(states.v, states.v_d, states.a_d)


def _ellipsoids(law: TrackingLaw, scale: Array, D: Array) -> list[StorageChoice]:
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


def _crossed(law: TrackingLaw, scale: Array, D: Array) -> list[StorageChoice]:
    """Cross terms c and decays α from a grid."""
    largest = float(np.linalg.eigvalsh(law.K_v)[0] / np.linalg.eigvalsh(D)[:, -1].max())
    return [StorageChoice(2.0 * c * share, c, scale, None) for c in largest * _CROSS for share in _DECAYS[::2]]


ERROR_EQUATIONS: Mapping[LawKind, ErrorEquation] = MappingProxyType(
    {
        "computed_torque": ErrorEquation(_with_feedback, True, _ellipsoids),
        "pd_plus": ErrorEquation(_of_reference, False, _crossed),
    }
)
