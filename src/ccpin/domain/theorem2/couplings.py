"""Couplings (gears, belts, mimic joints) as equations of degree at most two.

A coupling Σ rₖ (θₖ − refₖ) + … = 0 between angles with rational rₖ = mₖ / D, the mₖ whole and coprime, becomes
Im Π (uₖ + i sₖ)^mₖ · exp(i D φ⁰) = sin(D φ) = 0, (uₖ, sₖ) the cosine and sine of the angle's change from the centre
and φ⁰ the coupling's value there; negative powers are conjugates, products are named as they arise. Between
displacements a coupling is linear already.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

from ccpin.arrays import Array
from ccpin.description.model import Coupling
from ccpin.domain.theorem2.polynomials import Polynomial, combine
from ccpin.domain.theorem2.trees import Kinematics
from ccpin.domain.theorem2.unknowns import Unknowns
from ccpin.errors import UnsupportedMechanismError

Complex = tuple[Polynomial, Polynomial]
LARGEST_RATIO = 16  # four squarings of (cos, sin), whose products become unknowns


def coupling_row(kinematics: Kinematics, coupling: Coupling, numbers: dict[str, int], q_free: Array) -> Polynomial:
    """A coupling's equation: linear between displacements, sin(D φ) between angles.

    Raises:
        UnsupportedMechanismError: It is neither.
    """
    terms = [term for term in coupling.terms if any(term.coefficients[1:])]
    joints = [numbers[term.joint] for term in terms]
    sliding = {kinematics.joints[j].kind.sliding for j in joints}
    if any(any(term.coefficients[2:]) for term in terms):
        raise UnsupportedMechanismError(_not_algebraic(coupling, "it is not linear"))
    ratios = [term.coefficients[1] for term in terms]
    constant = sum(c * (-term.reference) ** k for term in coupling.terms for k, c in enumerate(term.coefficients[:2]))
    if sliding <= {True}:
        return _displacement_row(kinematics, joints, ratios, constant, q_free)
    if True in sliding:
        raise UnsupportedMechanismError(_not_algebraic(coupling, "it joins angles with displacements"))
    powers, scale = _whole_ratios(coupling, ratios)
    return _angle_row(kinematics, joints, powers, scale * constant, q_free)


def _displacement_row(
    kinematics: Kinematics, joints: Sequence[int], ratios: Sequence[float], constant: float, q_free: Array
) -> Polynomial:
    """Σ rₖ dₖ + constant, the displacements counted from the centre's."""
    parts = []
    for j, ratio in zip(joints, ratios, strict=True):
        parts.append((ratio, kinematics.variables[j][0]))
        constant += ratio * float(q_free[kinematics.joints[j].q.start])
    return combine([(constant, Polynomial.constant(1.0)), *parts])


def _angle_row(
    kinematics: Kinematics, joints: Sequence[int], powers: Sequence[int], constant: float, q_free: Array
) -> Polynomial:
    """The sine of Σ mₖ θₖ + constant, as the imaginary part of a quotient of products of unit complex numbers."""
    unknowns, phase = kinematics.unknowns, constant
    one = (Polynomial.constant(1.0), Polynomial.constant(0.0))
    sides: dict[bool, Complex] = {True: one, False: one}
    for j, m in zip(joints, powers, strict=True):
        phase += m * kinematics.angle_term(j).at(q_free)
        sides[m > 0] = _times(unknowns, sides[m > 0], _power(unknowns, kinematics.turn(j), abs(m)))
    phase = math.remainder(phase, 2 * math.pi)
    (c, s), (c_below, s_below) = sides[True], sides[False]
    c, s = _times(unknowns, (c, s), (c_below, s_below.scaled(-1.0)))  # a / b is a conj(b) as |b| = 1
    return combine([(math.cos(phase), s), (math.sin(phase), c)])


def _not_algebraic(coupling: Coupling, reason: str) -> str:
    return f"coupling '{coupling.name}' has no quadratic form: {reason}"


def _whole_ratios(coupling: Coupling, ratios: Sequence[float]) -> tuple[list[int], float]:
    """Whole mₖ without a common divisor and D > 0 with ratios = mₖ / D."""
    fractions = [Fraction(r).limit_denominator(1000) for r in ratios]
    denominator = math.lcm(*(f.denominator for f in fractions))
    powers = [int(f * denominator) for f in fractions]
    common = math.gcd(*powers)
    exact = all(abs(float(f) - r) <= 1e-12 * abs(r) for f, r in zip(fractions, ratios, strict=True))
    if not exact or max(map(abs, powers)) // common > LARGEST_RATIO:
        shown = ", ".join(f"{r:.12g}" for r in ratios)
        reason = f"its ratios {shown} are not those of whole numbers up to {LARGEST_RATIO}"
        raise UnsupportedMechanismError(_not_algebraic(coupling, reason))
    return [m // common for m in powers], denominator / common


def _times(unknowns: Unknowns, a: Complex, b: Complex) -> Complex:
    product = unknowns.product
    return product(a[0], b[0]) - product(a[1], b[1]), product(a[0], b[1]) + product(a[1], b[0])


def _power(unknowns: Unknowns, base: Complex, exponent: int) -> Complex:
    """The base to a whole power ≥ 1, by squaring."""
    result: Complex | None = None
    while exponent:
        if exponent % 2:
            result = base if result is None else _times(unknowns, result, base)
        exponent //= 2
        if exponent:
            base = _times(unknowns, base, base)
    assert result is not None
    return result
