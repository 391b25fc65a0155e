"""What claims about arrivals are about: a closed loop's programs, its set point, and what its level is proved of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.proof.digests import digest
from ccpin.proof.facts import Fact, known, require, sealed
from ccpin.validated.arithmetic.exact_numbers import ExactBox
from ccpin.validated.loop_equations import ClosedLoopEquations


@known
@dataclass(frozen=True, eq=False)
class ArrivalEquations:
    """A closed loop and the set point of its law, in copies that cannot be written to.

    Attributes:
        loop: The loop, under PD with simple gravity compensation that acts at every moment.
        q_d: A box around the set point, in the numbers of q.
        x_d: The law's configuration there, computed: of shape (n_x,).
        potential_d: V(q_d) in joules, as the law's level counts 𝒱.
        single: Whether 𝒱 is one continuous function of configuration and velocity.
        set_point: What Theorem 3 proves a level of, the same law on the same mechanism; ``None``: that a level is
            Theorem 3's is a hypothesis.
    """

    loop: ClosedLoopEquations
    q_d: ExactBox
    x_d: Array
    potential_d: float
    single: bool
    set_point: SetPointEquations | None = None

    def __post_init__(self) -> None:
        loop, own = self.loop, self.set_point
        require(type(loop) is ClosedLoopEquations, "a loop that the kernel does not know")
        require(loop.lyapunov is not None, "a law without a Lyapunov function")
        require(loop.efforts is None, "a law that is sampled: its Lyapunov function may rise")
        parts, radius, x_d = (np.array(values, dtype=np.float64) for values in (*self.q_d, self.x_d))
        object.__setattr__(self, "q_d", ExactBox(sealed(parts), sealed(radius)))
        object.__setattr__(self, "x_d", sealed(x_d))
        size = len(loop.independent)
        require(parts.ndim == 2 and len(parts) == size and radius.shape == (size,), "a set point in other numbers")
        require(x_d.shape == (loop.n_x,), "a configuration in other numbers")
        require(type(self.potential_d) is float and type(self.single) is bool, "numbers that are none")
        require(np.isfinite([*parts.ravel(), *radius, *x_d, self.potential_d]), "what is no number")
        require(radius >= 0.0, "a box without room")
        require(own is None or type(own) is SetPointEquations, "a set point that the kernel does not know")
        if own is not None:
            same = np.array_equal(parts[:, 0], own.law.q_d) and not parts[:, 1:].any() and not radius.any()
            require(same and own.law.potential_d == self.potential_d, "a level about another set point")

    def __reduce__(self) -> tuple[type[ArrivalEquations], tuple[Any, ...]]:
        return ArrivalEquations, tuple(getattr(self, each.name) for each in fields(self))

    @property
    def sizes(self) -> Mapping[str, int]:
        """Those of the loop."""
        return self.loop.sizes

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it."""
        level = None if self.set_point is None else self.set_point.digest
        return digest((self.loop.digest, self.q_d, self.x_d, self.potential_d, self.single, level))

    def digest_of_level(self, level: Fact) -> str:
        """What a fact about a level is to be about: this set point; K_v may be another, that is positive definite."""
        if self.set_point is None:
            return ""
        law = self.set_point.law._replace(K_v=level.claim.equations.law.K_v)
        return replace(self.set_point, law=law).digest
