"""Sine and cosine by additions and multiplications alone: the same bits wherever these are IEEE's.

With k the integer nearest to 2x/π and r = x − kπ/2, taken off in three parts of π/2 of which the first two times k are
exact, sin x = A s(r) + B c(r) and cos x = A c(r) − B s(r), where A = cos(kπ/2) and B = sin(kπ/2) are −1, 0 or 1 and
come of k by rounding k/2 and k/4 to integers, ties to even. The error is bounded in
`ccpin/proof/theorems/sine_cosine.md`.
"""

from __future__ import annotations

from typing import NamedTuple


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
    """

    name: str
    suffix: str
    rounder: float
    parts: tuple[float, float, float]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]
    reach: float
    error: float


DOUBLE = Precision(
    "double",
    "",
    6755399441055744.0,
    (
        float.fromhex("0x1.921fb544p+0"),
        float.fromhex("0x1.0b4611a6p-34"),
        float.fromhex("0x1.3198a2e037073p-69"),
    ),
    (
        float.fromhex("-0x1.5555555555549p-3"),
        float.fromhex("0x1.111111110f8a6p-7"),
        float.fromhex("-0x1.a01a019c161d5p-13"),
        float.fromhex("0x1.71de357b1fe7dp-19"),
        float.fromhex("-0x1.ae5e68a2b9cebp-26"),
        float.fromhex("0x1.5d93a5acfd57cp-33"),
    ),
    (
        float.fromhex("0x1.555555555554cp-5"),
        float.fromhex("-0x1.6c16c16c15177p-10"),
        float.fromhex("0x1.a01a019cb1590p-16"),
        float.fromhex("-0x1.27e4f809c52adp-22"),
        float.fromhex("0x1.1ee9ebdb4b1c4p-29"),
        float.fromhex("-0x1.8fae9be8838d4p-37"),
    ),
    1e5,
    3e-16,
)
FLOAT = Precision(
    "float",
    "f",
    12582912.0,
    (1.5703125, 0.000483751296997070312, 7.549790126404332e-08),
    (-0.16666654611, 8.3321608736e-3, -1.9515295891e-4),
    (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
    1e3,
    2e-7,
)
