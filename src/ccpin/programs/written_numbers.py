"""Numbers as documents of programs have them: counts that fill no memory, rationals that take no time."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Any

LARGEST = 10**7  # values of a program, and numbers of them: more are no program, but a means to fill a memory
_RATIONAL = re.compile(r"-?\d+/\d+")  # no exponents, of which a few letters are a number without end


def count_of(value: Any) -> int:
    """A whole number from 0 to `LARGEST`.

    Raises:
        ValueError: It is none.
    """
    if type(value) is not int or not 0 <= value <= LARGEST:
        raise ValueError(f"{value!r:.40} is no whole number from 0 to {LARGEST}")
    return value


def rational_text(value: Fraction) -> str:
    """A rational as text."""
    return f"{value.numerator}/{value.denominator}"


def rational_of(text: Any, digits: int) -> Fraction:
    """The rational of a text, of so many digits at most above and below.

    Raises:
        ValueError, TypeError, ZeroDivisionError: It is none.
    """
    if not _RATIONAL.fullmatch(text) or max(map(len, text.lstrip("-").split("/"))) > digits:
        raise ValueError(f"{text[:40]!r} is no constant")
    return Fraction(text)
