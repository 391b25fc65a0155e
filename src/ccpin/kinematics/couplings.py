"""Couplings placed in the tree: sums of polynomials in joint displacements, modulo whole turns on circles."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import Coupling
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.tree import Tree


class ResolvedTerm(NamedTuple):
    """One joint's part of a coupling.

    Attributes:
        idx_q, idx_v: Where the joint sits in q′ and q̇′.
        wrapped: Whether it is an angle on the circle.
        coefficients: Of the polynomial in the displacement from the reference, lowest power first.
        reference: Where displacements are counted from.
    """

    idx_q: int
    idx_v: int
    wrapped: bool
    coefficients: Array
    reference: float

    def angle(self, q_free: Array) -> float:
        """The joint's displacement from the term's reference; on the circle in (−π, π] before the reference."""
        i = self.idx_q
        return float((math.atan2(q_free[i + 1], q_free[i]) if self.wrapped else q_free[i]) - self.reference)

    def slope(self, order: int, q_free: Array) -> float:
        """The polynomial's derivative of an order there."""
        if len(self.coefficients) <= order:
            return 0.0
        return float(np.polynomial.polynomial.polyval(self.angle(q_free), self._derivative(order)))

    def _derivative(self, order: int) -> Array:
        return np.asarray(np.polynomial.polynomial.polyder(self.coefficients, order))


class ResolvedCoupling(NamedTuple):
    """A coupling placed in the tree; its row of φ holds modulo `modulus` (0: exactly)."""

    coupling: Coupling
    terms: tuple[ResolvedTerm, ...]
    modulus: float

    def value(self, q_free: Array) -> float:
        """The row of φ."""
        total = sum(term.slope(0, q_free) for term in self.terms)
        return math.remainder(total, self.modulus) if self.modulus else total


def resolve_coupling(tree: Tree, coupling: Coupling) -> ResolvedCoupling:
    """Place a coupling; where a continuous joint takes part the row is read modulo what whole turns add to it.

    Raises:
        UnsupportedMechanismError: A continuous joint enters with a power above one or an irrational ratio: the
            relation then depends on the number of turns, which a configuration on the circle does not hold.
    """
    terms, ratios = [], []
    for term in coupling.terms:
        joint = tree.joint(term.joint)
        wrapped = joint.kind.unit == 2
        if wrapped:
            slope = term.coefficients[1] if len(term.coefficients) > 1 else 0.0
            ratio = Fraction(slope).limit_denominator(1000)
            if any(term.coefficients[2:]) or abs(float(ratio) - slope) > 1e-12:
                raise UnsupportedMechanismError(
                    f"coupling '{coupling.name}': joint '{term.joint}' is continuous, so its ratio must be a "
                    "fraction of whole numbers up to 1000; make the joint revolute for any other relation"
                )
            ratios.append(ratio)
        coefficients = np.array(term.coefficients, dtype=np.float64)
        terms.append(ResolvedTerm(joint.q.start, joint.v.start, wrapped, coefficients, term.reference))
    return ResolvedCoupling(coupling, tuple(terms), 2 * math.pi * _common_divisor(ratios))


def _common_divisor(ratios: list[Fraction]) -> float:
    """The largest number of which every ratio is a whole multiple (0 without ratios)."""
    denominator = math.lcm(*(r.denominator for r in ratios))
    return math.gcd(*(int(r * denominator) for r in ratios)) / denominator
