"""Assembly modes: the configurations q′ that share one q, one for each branch of σ."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, listener, positive, whole
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import CcpinError
from ccpin.kinematics.coordinates import checked_q
from ccpin.kinematics.linear import Factor, factorize
from ccpin.kinematics.parametrization import SINGULAR_RCOND
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.poses.loop_closing import solve
from ccpin.mechanism.poses.pose_search import within_limits
from ccpin.mechanism.poses.same_pose import Likeness

INTERRUPTED = "interrupted"
_NONE_CLOSES = 5  # times the patience: starts after which a q over which none has closed is given up


class AssemblyMode(NamedTuple):
    """One branch of σ over a given q.

    Attributes:
        q_free: The configuration, of shape (nq,): the first found of those that are alike.
        sign: Sign of det ψ_q′ (0 where redundant rows make ψ_q′ tall); constant along a branch.
        rcond: Reciprocal condition number of ψ_q′: 0 at a singular configuration.
        is_reference: Whether σ(q) from the mechanism's reference gives this one.
        hits: From how many starts it was found.
        within_limits: Whether it respects the joints' limits.
    """

    q_free: Array
    sign: int
    rcond: float
    is_reference: bool
    hits: int
    within_limits: bool


class AssemblyModes(NamedTuple):
    """The modes found, the reference's first, then the best conditioned.

    They are sampled: nothing proves that there are no more.

    Attributes:
        modes: The poses over q. Configurations that differ only by a universal joint's flip, or by a spin that moves
            nothing else, are one (`ccpin.mechanism.poses.same_pose`).
        starts: The number of starts they were found from.
        singular: How many starts ended at singular configurations, which belong to no branch.
        complete: Whether the search ended by itself, the last starts having found nothing new.
        reason: Why it ended, and what it is evidence of, in words.
    """

    modes: tuple[AssemblyMode, ...]
    starts: int
    singular: int
    complete: bool
    reason: str


class ModeSearch(NamedTuple):
    """A search under way.

    Attributes:
        starts: Starts so far.
        modes: Modes found.
        quiet: How many starts that closed have found nothing new, in a row; the search ends at `patience`.
        patience: See `assembly_modes`.
    """

    starts: int
    modes: int
    quiet: int
    patience: int


def assembly_modes(
    model: ReducedModel | Mechanism,
    q: ArrayLike,
    *,
    patience: int = 60,
    limit: int = 2000,
    budget: float | None = None,
    progress: Callable[[ModeSearch], None] | None = None,
) -> AssemblyModes:
    """Search the σ branches over q from deterministic starts spread over the free system's configurations.

    Args:
        model: The reduced model, or a mechanism.
        q: Independent coordinates, of shape (model.nq,).
        patience: End after this many starts that close in a row and find nothing new, or five times as many of which
            none closes.
        limit: Largest number of starts.
        budget: Seconds after which no start is made any more; default no limit.
        progress: Called after every start.

    Returns:
        What was found, also when the search was stopped by a limit or by the user (Ctrl-C).

    Raises:
        InvalidInputError: q has the wrong shape or is not finite, or a limit is not positive.
    """
    model, patience, limit = model_of(model), whole(patience, "patience"), whole(limit, "limit")
    if budget is not None:
        budget = positive(budget, "budget")
    told = listener(progress)
    search = _ModeFinder(model, checked_q(model.coordinates, q))
    end = math.inf if budget is None else time.monotonic() + budget
    stopped = ""
    try:
        while not search.over(patience) and not stopped:
            search.step()
            told(ModeSearch(search.starts, len(search.found), search.quiet, patience))
            if search.starts >= limit:
                stopped = f"stopped at the limit of {limit} starts"
            elif time.monotonic() >= end:
                stopped = f"stopped after the budget of {budget:g} s"
    except KeyboardInterrupt:
        stopped = INTERRUPTED
    return search.result(patience, "" if search.over(patience) else stopped)


class _FoundMode:
    """A mode, its bodies' poses, and how often it was found."""

    def __init__(self, q_free: Array, poses: Array, factor: Factor, is_reference: bool) -> None:
        self.q_free, self.poses, self.is_reference = q_free, poses, is_reference
        self.sign, self.rcond, self.hits = factor.sign, factor.rcond, 0


class _ModeFinder:
    def __init__(self, model: ReducedModel, q: Array) -> None:
        self.model, self.q = model, q
        self.likeness = Likeness(model.mechanism.tree, model.parametrization.constraints)
        self.generator = np.random.default_rng(20003)
        self.equations = model.parametrization.equations(q)
        self.found: list[_FoundMode] = []
        self.starts = self.quiet = self.singular = self.closed = 0
        with suppress(CcpinError):
            self.add(model.sigma(q), is_reference=True)

    def step(self) -> None:
        """One more start."""
        model = self.model
        start = _start(model, self.q, self.starts, self.generator)
        attempt = solve(model.mechanism.tree.model, self.equations, start)
        self.starts += 1
        if attempt.closed and model.parametrization.constraints.aligned(attempt.q_free):
            self.closed, self.quiet = self.closed + 1, self.quiet + 1
            self.add(attempt.q_free).hits += 1

    def over(self, patience: int) -> bool:
        """Whether it has ended by itself."""
        return self.quiet >= patience or (not self.closed and self.starts >= _NONE_CLOSES * patience)

    def add(self, q_free: Array, is_reference: bool = False) -> _FoundMode:
        """The mode that a closed configuration belongs to, a new one perhaps."""
        poses = self.likeness.poses(q_free)
        for known in self.found:
            if self.likeness.alike(known.poses, poses):
                return known
        factor = factorize(self.model.parametrization.psi_jacobian(q_free))
        new = _FoundMode(q_free if is_reference else _unwound(self.model, q_free), poses, factor, is_reference)
        if factor.rcond < SINGULAR_RCOND**0.5:
            self.singular += 1
        else:
            self.found.append(new)
            self.quiet = 0
        return new

    def result(self, patience: int, stopped: str) -> AssemblyModes:
        """What was found; `stopped` says what cut the search short."""
        ordered = sorted(self.found, key=lambda mode: (not mode.is_reference, -mode.rcond))
        tree = self.model.mechanism.tree.model
        modes = tuple(
            AssemblyMode(m.q_free, m.sign, m.rcond, m.is_reference, m.hits, within_limits(tree, m.q_free))
            for m in ordered
        )
        rarest = min((mode.hits for mode in modes), default=0)
        seen = f"{self.closed} of {self.starts} starts closed"
        seen += f", and each mode was found from {rarest} of them at least" if modes else ""
        if stopped:
            told = f"{stopped}, so modes may be missing"
        elif self.closed:
            quiet = f"the last {self.quiet} starts that closed led to nothing new"
            told = f"{quiet}: evidence that there are no more, no proof"
        else:
            told = "evidence that q is out of reach, no proof"
        return AssemblyModes(modes, self.starts, self.singular, not stopped, f"{told}; {seen}")


def _start(model: ReducedModel, q: Array, number: int, generator: np.random.Generator) -> Array:
    """The reference first, then configurations spread over circles, spheres and ranges, with q put in."""
    pin_model, reference = model.mechanism.tree.model, model.mechanism.q_reference
    start = reference
    if number > 0:
        spread = np.full(pin_model.nv, np.pi)
        for joint in model.mechanism.tree.joints:
            if joint.kind.sliding and joint.kind.nq == 1:
                i = joint.q.start
                low, high = pin_model.lowerPositionLimit[i], pin_model.upperPositionLimit[i]
                bounded = np.isfinite(low) and np.isfinite(high) and high > low
                spread[joint.v] = 0.5 * (high - low) if bounded else 1.0
        start = pin.integrate(pin_model, reference, spread * generator.uniform(-1.0, 1.0, pin_model.nv))
    return model.coordinates.embed(q, start)


def _unwound(model: ReducedModel, q_free: Array) -> Array:
    """Turn dependent revolute joints by whole turns to lie nearest the reference."""
    mechanism, unwound = model.mechanism, q_free.copy()
    for joint in mechanism.tree.joints:
        if joint.kind.angle and joint.name not in mechanism.independent and not mechanism.couplings:
            i = joint.q.start
            unwound[i] -= 2 * np.pi * np.round((q_free[i] - mechanism.q_reference[i]) / (2 * np.pi))
    return unwound
