"""What Theorem 3's claims are about: closures, the bodies and springs that make V′, and a law's numbers.

V′ of bodies is a row of what closures are made of, Σ_b B_b c_b(θ), with B_b = −m_b γᵀ and c_b their centres of mass. So
its numbers are checked as those of closures are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, least_eigenvalue
from ccpin.control.stability.set_point.potential import (
    BodiesAndSprings,
    Potential,
    potential_of,
    potential_values,
)
from ccpin.control.stability.set_point.well import SetPoint
from ccpin.proof.chains import Chain
from ccpin.proof.digests import digest
from ccpin.proof.equations import Closures, closure_values, row_of
from ccpin.proof.facts import known, require, sealed
from ccpin.proof.rounding import SLACK

_OWN = 1e-8  # of the terms' sizes: what g(q_d) and V(q_d) of the law may be off from V′'s


@known
@dataclass(frozen=True, eq=False)
class SetPointEquations:
    """Closures, V′ and the law, in copies that cannot be written to.

    Attributes:
        closures: φ, whose facts may be premises.
        masses: V′ in the same θ, and what robots of a set may have besides.
        theta: θ of the law's configuration at q_d, of shape (n′,).
        law: Its numbers.
    """

    closures: Closures
    masses: BodiesAndSprings
    theta: Array
    law: SetPoint

    def __post_init__(self) -> None:
        require(type(self.closures) is Closures, "closures that the kernel does not know")
        bodies, *spread = (_bodies(self.closures, chains) for chains in (self.masses.chains, *self.masses.spread))
        stiffness, rest = (sealed(np.array(values, dtype=np.float64)) for values in self.masses[1:3])
        own = BodiesAndSprings(bodies, stiffness, rest, tuple(spread))
        object.__setattr__(self, "masses", own)
        object.__setattr__(self, "theta", sealed(np.array(self.theta, dtype=np.float64)))
        object.__setattr__(self, "law", SetPoint(*(sealed(value) for value in self.law)))
        _require_springs(self)
        _require_law(self)

    def __reduce__(self) -> tuple[type[SetPointEquations], tuple[Any, ...]]:
        return SetPointEquations, (self.closures, self.masses, self.theta, self.law)

    @property
    def sizes(self) -> Mapping[str, int]:
        """Those of the closures."""
        return self.closures.sizes

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it."""
        return digest((self.closures.digest, self.masses, self.theta, self.law))

    @cached_property
    def potential(self) -> Potential:
        """V′, and its spread from θ on."""
        return potential_of(self.masses, self.theta)

    @property
    def gain(self) -> float:
        """k."""
        return least_eigenvalue(self.law.K_p)

    @property
    def misjudged(self) -> float:
        """How far g(q_d) of a robot of the set may be from the law's, ‖·‖₂; 0 where nothing is spread."""
        pulls = (_gravity(self, part) for part in self.potential.spread)
        return float(sum(np.linalg.norm(np.abs(pull.force) + pull.margin) for pull in pulls)) * SLACK


def _bodies(closures: Closures, chains: tuple[Chain, ...]) -> tuple[Chain, ...]:
    """Chains of points with weights, in copies.

    Raises:
        NotProvedError: They are none.
    """
    require([not chain.direction for chain in chains], "bodies that are no points")
    require([np.isfinite(chain.weights).all() for chain in chains], "weights that are none")
    return row_of(closures, chains).system.chains


def _require_springs(own: SetPointEquations) -> None:
    """That V′ is a function where boxes are glued: modulo turns of what no spring acts on (hypothesis 3).

    Raises:
        NotProvedError: It is not.
    """
    system, (_, stiffness, rest, _) = own.closures.system, own.masses
    shapes = {stiffness.shape, rest.shape, own.theta.shape}
    require(shapes == {(system.n_free,)} and np.isfinite([stiffness, rest, own.theta]), "springs that are none")
    require(stiffness >= 0.0, "a spring that pushes")
    turning = system.periodic[system.dependent]
    require(~turning | (stiffness[system.dependent] == 0.0), "a spring on a circle")


def _require_law(own: SetPointEquations) -> None:
    """Gains (hypothesis 1), and that g(q_d) and V(q_d) are those of V′ at θ_d, up to roundings.

    Raises:
        NotProvedError: They are not.
    """
    (q_d, K_p, K_v, gravity_d, potential_d, motors), system = own.law, own.closures.system
    n, numbers = system.n, [np.ravel(x) for x in own.law if x is not None]
    require((q_d.shape, gravity_d.shape, K_p.shape, K_v.shape) == ((n,), (n,), (n, n), (n, n)), "a law of another size")
    require(motors is None or (motors.ndim == 2 and n <= motors.shape[0]), "motors that are none")
    require(np.isfinite(np.concatenate(numbers)), "a law with what is no number")
    for gains in (K_p, K_v):
        require(np.array_equal(gains, gains.T) and least_eigenvalue(gains) > 0.0, "gains that are not positive")
    theta = own.theta[None]
    require(own.theta[system.independent] == q_d, "a configuration at another q")
    at, pull = potential_values(own.potential, theta), _gravity(own, own.potential)
    require(np.abs(pull.force - gravity_d) <= pull.margin, "g(q_d) of another mechanism")
    require(abs(at.value[0] - potential_d) <= _OWN * own.potential.magnitude(theta)[0], "V(q_d) of another mechanism")


class _Pull(NamedTuple):
    """g at θ and what it may be off, of shape (n,)."""

    force: Array
    margin: Array


def _gravity(own: SetPointEquations, potential: Potential) -> _Pull:
    """ρᵀV_θ of a potential at θ."""
    system, theta = own.closures.system, own.theta[None]
    jacobian, slope = closure_values(own.closures.problem, theta)[1][0], potential_values(potential, theta).gradient[0]
    rho = -np.linalg.solve(jacobian[:, system.dependent], jacobian[:, system.independent])
    pull, direct = slope[system.dependent], slope[system.independent]
    size = np.abs(direct) + np.abs(pull) @ np.abs(rho) + potential.magnitude(theta)[0]
    return _Pull(direct + pull @ rho, _OWN * size)
