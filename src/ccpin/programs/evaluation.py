"""What instructions compute, in any module that has NumPy's functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ccpin.programs.instructions import Code, Instruction, Kind

_TERMS = 40  # of g's series about 1, where (1 − w)/2 ≤ 1/4: what is left out is below 1e-24
_SERIES = 0.5  # from this w on g is its series: the closed forms of its derivatives cancel near 1


def values_of(code: Code, inputs: Sequence[Any], xp: Any) -> list[Any]:
    """All values at inputs that are arrays of one shape (or numbers)."""
    values: list[Any] = [None] * code.size
    values[: code.inputs] = inputs
    for item in code.instructions:
        values[item.target] = value_of(item, values, xp)
    return values


def value_of(item: Instruction, values: Sequence[Any], xp: Any) -> Any:
    """The value of one instruction that is no linear solve."""
    kind, a, b = item.kind, item.a, item.b
    if kind == Kind.MULTIPLY:
        return values[a] * values[b]
    if kind == Kind.ADD:
        return values[a] + values[b]
    if kind == Kind.SUBTRACT:
        return values[a] - values[b]
    if kind == Kind.SCALE:
        return float(item.constant) * values[a]
    if kind == Kind.CONSTANT:
        return float(item.constant)
    if kind == Kind.SINE:
        return xp.sin(values[a])
    if kind == Kind.COSINE:
        return xp.cos(values[a])
    if kind == Kind.RECIPROCAL:
        return 1.0 / values[a]
    if kind == Kind.ROOT:
        return xp.sqrt(values[a])
    if kind == Kind.ANGLE:
        return xp.arctan2(values[a], values[b])
    if kind == Kind.GAIN:
        return gain(values[a], b, xp)
    raise ValueError(f"no instruction {kind} outside linear solves")


def gain(w: Any, order: int, xp: Any) -> Any:
    """A derivative of g(w) = 2 arccos(w)/√(1 − w²) = 2 ₂F₁(1, 1; 3/2; (1 − w)/2), for −1 < w.

    g′ = (w g − 2)/(1 − w²), and (1 − w²) g⁽ᵏ⁺¹⁾ = (2k + 1) w g⁽ᵏ⁾ + k² g⁽ᵏ⁻¹⁾ for k ≥ 1.
    """
    away = xp.minimum(w, _SERIES)
    rest = 1.0 - away * away
    closed = [2.0 * xp.arccos(away) / xp.sqrt(rest)]
    closed.append((away * closed[0] - 2.0) / rest)
    for k in range(1, order):
        closed.append(((2 * k + 1) * away * closed[k] + k * k * closed[k - 1]) / rest)
    z, total = 0.5 * (1.0 - xp.maximum(w, _SERIES)), 0.0
    for coefficient in gain_series(order)[::-1]:
        total = total * z + coefficient
    return xp.where(w < _SERIES, closed[order], total)


def gain_series(order: int) -> list[float]:
    """Coefficients of g⁽ᵏ⁾ as a power series of z = (1 − w)/2, lowest first."""
    terms = [2.0]
    for j in range(_TERMS + order):
        terms.append(terms[-1] * (j + 1) / (j + 1.5))
    for _ in range(order):
        terms = [-0.5 * j * term for j, term in enumerate(terms)][1:]
    return terms
