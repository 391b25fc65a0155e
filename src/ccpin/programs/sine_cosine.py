"""Sine and cosine by additions and multiplications alone: the same bits wherever these are IEEE's.

With k the integer nearest to 2x/π and r = x − kπ/2, taken off in three parts of π/2 of which the first two times k are
exact, sin x = A s(r) + B c(r) and cos x = A c(r) − B s(r), where A = cos(kπ/2) and B = sin(kπ/2) are −1, 0 or 1 and
come of k by rounding k/2 and k/4 to integers, ties to even. The error is bounded in
`ccpin/proof/theorems/sine_cosine.md`.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Format = Literal["double", "float"]


class Precision(NamedTuple):
    """The constants for one floating-point format.

    Attributes:
        name: The type in C.
        suffix: Of its constants in C.
        rounder: 1.5 · 2^p, which added and subtracted leaves the nearest integer.
        parts: π/2 in three parts.
        sine: Coefficients of r³, r⁵, ….
        cosine: Coefficients of r⁴, r⁶, … after 1 − r²/2.
        reach: |x| up to which the bound holds.
        error: The bound of the absolute error.
        settled: A correction δ of σ whose δ^{3/2}, which it leaves, is rounding.
    """

    name: str
    suffix: str
    rounder: float
    parts: tuple[float, ...]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]
    reach: float
    error: float
    settled: float

    def converged(self, tolerance: float) -> float:
        """Up to which length of its last correction σ counts as found: below rounding there is nothing to ask for."""
        return max(tolerance, self.settled)

    @property
    def type(self) -> type[np.floating[Any]]:
        """NumPy's numbers of the format."""
        return np.float64 if self.name == "double" else np.float32


def _numbers(text: str) -> tuple[float, ...]:
    """Those that `float.hex` wrote."""
    return tuple(map(float.fromhex, text.split()))


DOUBLE = Precision(
    "double",
    "",
    6755399441055744.0,
    _numbers("0x1.921fb544p+0 0x1.0b4611a6p-34 0x1.3198a2e037073p-69"),
    _numbers(
        "-0x1.5555555555549p-3 0x1.111111110f8a6p-7 -0x1.a01a019c161d5p-13 "
        "0x1.71de357b1fe7dp-19 -0x1.ae5e68a2b9cebp-26 0x1.5d93a5acfd57cp-33"
    ),
    _numbers(
        "0x1.555555555554cp-5 -0x1.6c16c16c15177p-10 0x1.a01a019cb1590p-16 "
        "-0x1.27e4f809c52adp-22 0x1.1ee9ebdb4b1c4p-29 -0x1.8fae9be8838d4p-37"
    ),
    1e5,
    2.3e-16,
    2.0**-35,
)
FLOAT = Precision(
    "float",
    "f",
    12582912.0,
    _numbers("0x1.92p+0 0x1.fb4p-12 0x1.4442d2p-24"),
    _numbers("-0x1.555540p-3 0x1.1105bcp-7 -0x1.98dc20p-13"),
    _numbers("0x1.55554ap-5 -0x1.6c0c1ap-10 0x1.99e0ecp-16"),
    1e3,
    1.23e-7,
    2.0**-16,
)
PRECISIONS: dict[str, Precision] = {"double": DOUBLE, "float": FLOAT}


def sine_and_cosine(x: NDArray[Any], precision: Precision = DOUBLE) -> tuple[NDArray[Any], NDArray[Any]]:
    """Both of x, operation by operation as compiled programs have them.

    x is of the format's type (np.float64 or np.float32); what is beyond `reach` is wrong.
    """
    big, (first, second, third) = precision.rounder, precision.parts
    k = (x * (2.0 / math.pi) + big) - big
    r = ((x - k * first) - k * second) - k * third
    z = r * r
    s = r + (r * z) * _horner(precision.sine, z)
    c = (1.0 - 0.5 * z) + (z * z) * _horner(precision.cosine, z)
    h, w = k * 0.5, k * 0.25
    e, f = h - ((h + big) - big), w - ((w + big) - big)
    b = e + e
    a = (1.0 - b * b) * (1.0 - 8.0 * (f * f))
    return s * a + c * b, c * a - s * b


def _horner(coefficients: tuple[float, ...], z: NDArray[Any]) -> NDArray[Any]:
    found = np.full_like(z, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        found = coefficient + z * found
    return found
