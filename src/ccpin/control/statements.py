"""What a law states of itself in constants: all that the compiled core, enclosures and certificates need to know of it.

Nobody asks a law for its class. A law that states itself runs in the core, is enclosed and certified by its kind; one
that does not is asked for its efforts only. A statement is about what its own class does: where a class further down,
or an object, redefines any of that, nothing is stated.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.control.references import PiecewisePolynomial, Reference
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State

_NOTHING = frozen(np.empty(0))  # a constant that a law does not have

LawKind = Literal["constant", "pd", "pd_gravity", "computed_torque", "pd_plus", "adaptive"]


class Learning(NamedTuple):
    """What an adaptive law learns: θ, k numbers of all constants π = known + B θ, sampled.

    Attributes:
        known: Of shape (p,). basis: B, of shape (p, k).
        rates: T Γ's diagonal: θ̂ becomes θ̂ − T Γ (Y_r B)ᵀ s within its bounds, of shape (k,).
        lower, upper: These bounds, alike.
        estimate: θ̂ as the next sample uses it, alike.
    """

    known: Array
    basis: Array
    rates: Array
    lower: Array
    upper: Array
    estimate: Array


class Statement(NamedTuple):
    """A law in constants: u has ρᵀSᵀu = f, with e = q_d − q, ė = q̇_d − q̇ and D, C, g of the law's own model.

    =================  ====================================================  =============================
    kind               f                                                     with a constant q_d
    =================  ====================================================  =============================
    `constant`         u = constant
    `pd`               K_p e + K_v ė + constant                              (28) if constant = g(q_d)
    `pd_gravity`       K_p e + K_v ė + g(q)                                  (30)
    `computed_torque`  D (q̈_d + K_v ė + K_p e) + C q̇ + damping q̇ + g
    `pd_plus`          D q̈_d + C q̇_d + damping q̇_d + g + K_p e + K_v ė       (30)
    `adaptive`         Y_r(q, q̇, q̇_r, q̈_r) π̂ − K_v (q̇ − q̇_r), sampled,
                       q̇_r = q̇_d + K_p e, q̈_r = q̈_d + K_p ė
    =================  ====================================================  =============================

    Attributes:
        kind: Which of these.
        model: The law's own model.
        near: A State of it, where its σ starts.
        reference: q_d(t), without pieces for a set point; ``None`` where it is no polynomial by its own word.
        K_p, K_v: Gains, symmetric positive definite, (n, n).
        constant: Of shape (n,); a constant u of shape (motors,).
        start: When the law's clock shows zero, s.
        learning: Of an adaptive law.
    """

    kind: LawKind
    model: ReducedModel | None = None
    near: State | None = None
    reference: PiecewisePolynomial | None = None
    K_p: Array = _NOTHING
    K_v: Array = _NOTHING
    constant: Array = _NOTHING
    start: float = 0.0
    learning: Learning | None = None

    @property
    def idle(self) -> bool:
        """Whether u = 0."""
        return self.kind == "constant" and not np.any(self.constant)

    @property
    def holds(self) -> bool:
        """Whether q_d is constant: a set-point law."""
        return self.reference is not None and not self.reference.breaks.size


def polynomial_of(reference: Reference) -> PiecewisePolynomial | None:
    """A reference as a piecewise polynomial, ``None`` where it is none by its own word."""
    return reference.as_polynomial() if speaks_for(reference, "as_polynomial") else None


def speaks_for(thing: object, statement: str) -> bool:
    """Whether what the method `statement` says holds of an object: nothing below its class redefines anything of it."""
    home = _home(type(thing), statement)  # type: ignore[arg-type]  # mypy: a class is not hashable
    return home is not None and not any(callable(getattr(home, name, None)) for name in getattr(thing, "__dict__", ()))


@cache
def _home(kind: type[Any], statement: str) -> type[Any] | None:
    """The class that makes a statement, or ``None`` where a class between it and `kind` redefines what it has."""
    order = kind.__mro__
    first = next((k for k, c in enumerate(order) if statement in vars(c)), None)
    if first is None:
        return None
    home = order[first]
    below = (name for c in order[:first] for name in vars(c))
    redefined = any(hasattr(home, name) for name in below if name not in _NOT_BEHAVIOUR)
    return None if redefined else home


_NOT_BEHAVIOUR = {*vars(type("Empty", (), {})), "__init__", "__annotations__", "_abc_impl"} | {
    "__abstractmethods__",
    "__parameters__",
    "__orig_bases__",
    "__firstlineno__",
    "__static_attributes__",
    "__repr__",
    "__str__",
    "__hash__",
    "__eq__",
}
"""What a class may have of its own without doing anything else than the one above it."""
