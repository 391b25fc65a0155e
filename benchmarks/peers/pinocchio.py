"""Pinocchio's constrained dynamics, `lcaba` and derivatives, with the fastest proximal settings that are accurate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

import ccpin
from benchmarks.peers import NotForThisError
from benchmarks.subjects import Place, difference
from benchmarks.timing import in_turn

# (accuracy, μ, iterations): rows that are redundant need μ > 0, and one iteration is enough where μ is tiny.
SETTINGS = ((1e-12, 0.0, 1), (1e-12, 1e-12, 1), (1e-12, 1e-12, 3), (1e-12, 1e-10, 5), (1e-12, 1e-8, 10))
LCABA_SETTINGS = ((1e-12, 1e-6, 1), (1e-12, 1e-6, 3), (1e-12, 1e-8, 3), (1e-12, 1e-4, 10))  # alike
ACCURATE, LCABA_ACCURATE = 1e-9, 1e-6  # of q̈: the fastest settings that reach it are timed

Solve = Callable[[pin.ProximalSettings], np.ndarray]


class Pinocchio:
    """The loops of a mechanism as Pinocchio's contacts: 6 rows for a fixed closure, else the 3 of a common point.

    Attributes:
        note, lcaba_note: The settings chosen.

    Raises:
        NotForThisError: A coupling, or a closure that is neither fixed, a common point nor in a plane.
    """

    def __init__(self, mechanism: ccpin.Mechanism, at: Place) -> None:
        self.model, self.at = mechanism.pin_model, at
        self.contacts = contacts(mechanism)
        self.memory, self.lcaba_memory = memory(self.contacts), memory(self.contacts)  # each leaves its own in it
        self.data, self.lcaba_data = self.model.createData(), self.model.createData()
        pin.initConstraintDynamics(self.model, self.data, self.contacts, self.memory)
        self.settings, self.note = self._fastest(SETTINGS, self._solve, ACCURATE)
        self.lcaba_settings, self.lcaba_note = None, ""

    def prepare_lcaba(self) -> None:
        """What `lcaba` needs once: an order of elimination, and settings."""
        pin.computeJointMinimalOrdering(self.model, self.lcaba_data, self.contacts)
        self.lcaba_settings, self.lcaba_note = self._fastest(LCABA_SETTINGS, self._lcaba, LCABA_ACCURATE)

    def acceleration(self) -> np.ndarray:
        """q̈′ at the place."""
        return self._solve(self.settings)

    def lcaba(self) -> np.ndarray:
        """q̈′ by the loop-constrained articulated-body algorithm."""
        return self._lcaba(self.lcaba_settings)

    def derivatives(self) -> tuple[np.ndarray, ...]:
        """q̈′ and the contact forces by q′, q̇′ and τ′, at an acceleration just computed."""
        self._solve(self.settings)
        return pin.computeConstraintDynamicsDerivatives(self.model, self.data, self.contacts, self.memory)

    def loop(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> None:
        """A Python loop over the rows of q′, q̇′ and τ′."""
        model, data, contacts, memory, settings = self.model, self.data, self.contacts, self.memory, self.settings
        for row in zip(q, v, tau, strict=True):
            pin.constraintDynamics(model, data, *row, contacts, memory, settings)

    def _solve(self, settings: pin.ProximalSettings) -> np.ndarray:
        at = self.at
        arguments = (at.q_free, at.v_free, at.tau, self.contacts, self.memory, settings)
        return pin.constraintDynamics(self.model, self.data, *arguments)

    def _lcaba(self, settings: pin.ProximalSettings) -> np.ndarray:
        at = self.at
        arguments = (at.q_free, at.v_free, at.tau, self.contacts, self.lcaba_memory, settings)
        return pin.lcaba(self.model, self.lcaba_data, *arguments)

    def _fastest(
        self, candidates: tuple[tuple[float, float, int], ...], solve: Solve, accurate: float
    ) -> tuple[pin.ProximalSettings, str]:
        """The fastest settings whose q̈′ is accurate; the most accurate where none is."""
        settings = {each: pin.ProximalSettings(*each) for each in candidates}
        wrong = {each: _or_infinite(difference(solve(settings[each]), self.at.a_free)) for each in candidates}
        able = [each for each in candidates if wrong[each] <= accurate] or [min(candidates, key=wrong.__getitem__)]
        times = in_turn({each: lambda s=settings[each]: solve(s) for each in able}, 5, 1e-3)
        best = min(able, key=lambda each: times[each].seconds)
        return settings[best], f"μ = {best[1]:g}, at most {best[2]} iterations"


def contacts(mechanism: ccpin.Mechanism) -> pin.StdVec_RigidConstraintModel:
    """The mechanism's loops as contacts of Pinocchio.

    Raises:
        NotForThisError: As for `Pinocchio`.
    """
    if mechanism.couplings:
        raise NotForThisError("Pinocchio's constraintDynamics has no couplings")
    made = pin.StdVec_RigidConstraintModel()
    for loop in mechanism.constraints().loops:
        kind = loop.closure.kind
        if kind not in ("fixed", "spherical") and loop.normal is None:
            raise NotForThisError(f"Pinocchio's constraintDynamics has no {kind} closure")
        rows = pin.ContactType.CONTACT_6D if kind == "fixed" else pin.ContactType.CONTACT_3D
        ends = (loop.joint_a, pin.SE3(loop.frame_a), loop.joint_b, pin.SE3(loop.frame_b))
        made.append(pin.RigidConstraintModel(rows, mechanism.pin_model, *ends, pin.ReferenceFrame.LOCAL))
    return made


def memory(made: pin.StdVec_RigidConstraintModel) -> pin.StdVec_RigidConstraintData:
    """Scratch memory for contacts."""
    scratch = pin.StdVec_RigidConstraintData()
    for contact in made:
        scratch.append(contact.createData())
    return scratch


def _or_infinite(error: float) -> float:
    return error if np.isfinite(error) else np.inf
