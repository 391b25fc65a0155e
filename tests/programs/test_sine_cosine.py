"""The error of our sine and cosine: the theorem's hypotheses and sums from the constants, and an attack on it."""

import ctypes
import math
import shutil
import subprocess
from fractions import Fraction

import numpy as np
import pytest

from ccpin.programs.c_code import _trigonometry, scalar_macros
from ccpin.programs.sine_cosine import DOUBLE, FLOAT, sine_and_cosine

flint = pytest.importorskip("flint", reason="the error is proved in ball arithmetic (python-flint)")
from flint import arb, arb_poly, ctx  # noqa: E402  # after the test that it is there

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-fast-math")
BITS = {"double": 53, "float": 24}
TYPES = {"double": np.float64, "float": np.float32}
PIECES = 512
FORMATS = pytest.mark.parametrize("precision", [DOUBLE, FLOAT], ids=["double", "float"])


@pytest.fixture(autouse=True)
def _bits():
    before, ctx.prec = ctx.prec, 200
    yield
    ctx.prec = before


def ball(value):
    """A rational or a number, exactly or to 200 bits."""
    exact = Fraction(value)
    return arb(exact.numerator) / arb(exact.denominator)


def bits(value):
    """How many bits there are between the first and the last 1."""
    numerator = abs(Fraction(value)).numerator
    return (numerator >> ((numerator & -numerator).bit_length() - 1)).bit_length()


def horner(coefficients, z):
    found = ball(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        found = ball(coefficient) + z * found
    return found


def added(coefficients, z, first):
    """What Horner's rule adds to a coefficient."""
    return z * horner(coefficients[first + 1 :], z)


def upper(value):
    return float(abs(value).upper()) * (1 + 1e-12)


def polynomials_error(precision, rho):
    """ε_s and ε_c: Taylor's polynomial below r²⁴ less ours by the mean value over pieces; the series' rest."""
    found = []
    for own, lowest in ((precision.sine, 3), (precision.cosine, 4)):
        terms = [arb(0)] * 24
        for degree in range(lowest, 24, 2):
            terms[degree] = arb((-1) ** (degree // 2)) / math.factorial(degree)
        for k, coefficient in enumerate(own):
            terms[lowest + 2 * k] -= ball(coefficient)
        off, worst = arb_poly(terms), 0.0
        slope = off.derivative()
        for k in range(PIECES):
            middle, half = ball(rho) * (2 * k + 1) / (2 * PIECES), ball(rho) / (2 * PIECES)
            piece = (middle - half).union(middle + half)
            worst = max(worst, upper(off(middle) + slope(piece) * (piece - middle)))
        found.append(worst + rho**24 / math.factorial(24))
    return found


def proved(precision):
    """The theorem's bound from the constants; its hypotheses hold or this fails."""
    p = BITS[precision.name]
    u, X = Fraction(1, 2**p), Fraction(precision.reach)
    c = Fraction(float(TYPES[precision.name](2.0 / math.pi)))
    K = math.floor(X * c * (1 + u) + Fraction(1, 2))
    first, second, third = map(Fraction, precision.parts)
    omega = upper(arb.pi() / 2 - ball(first) - ball(second) - ball(third))
    assert Fraction(precision.rounder) == 3 * Fraction(2) ** (p - 2)
    assert all(float(TYPES[precision.name](v)) == v for v in (*precision.parts, *precision.sine, *precision.cosine))
    assert upper(ball(c) - 2 / arb.pi()) <= u / 2
    assert 2 ** (p - 3) > K
    assert max(bits(first), bits(second)) + K.bit_length() <= p
    assert 1.5 <= first < 1.58
    assert (first / (2 * u)).denominator == 1
    assert K * (abs(second) + abs(third) + omega) < 1
    rho = float(arb.pi().upper()) / 4 + float(Fraction("1.9") * u * X + 3 * u)
    delta = float(u + u * K * abs(third)) + K * omega
    assert rho < 0.786
    assert delta <= 2 * u
    assert rho + K * (abs(float(third)) + omega) < 1
    z = arb(0).union(ball(rho) ** 2)
    for coefficients, size, more in ((precision.sine, 0.1667, 0.0052), (precision.cosine, 0.0417, 0.0009)):
        assert all(
            upper(horner(coefficients, (part := ball(rho) ** 2 / 64) * k + part * arb(0).union(1))) <= size
            for k in range(64)
        )
        assert upper(added(coefficients, z, 0)) <= more
        for k in range(1, len(coefficients) - 1):
            assert upper(added(coefficients, z, k)) <= abs(coefficients[k]) / 20
    sine, cosine = polynomials_error(precision, rho)
    return max(delta + 0.82 * float(u) + sine, 0.7076 * delta + 1.32 * float(u) + cosine)


def test_what_the_theorem_adds_up():
    """Its two lines of roundings, from the sizes that its hypotheses state."""
    r, S, C = 0.786, 0.1667, 0.0417
    sine = 3 * r**3 * S + r**3 * (1 / 8 + 4 * 0.0052) + 1 / 2
    z = r * r
    cosine = 1 / 4 + 1 / 2 + C * (2 * z / 2 + 1 / 4) + z * z * (1 / 32 + 4 * 0.0009) + 1 / 64 + 1 / 2
    assert sine < 0.82
    assert cosine < 1.32
    assert 4 >= 3 + 4 / 20 + 4 / 20**2 * 2  # of what is added: z, the product, the sum, and a twentieth of the same
    assert z * z * C < 2**-5
    assert math.sin(0.786) < 0.7076


@FORMATS
def test_the_error_is_what_is_proved(precision):
    """And not ten per cent more."""
    found = proved(precision)
    assert found <= precision.error < 1.1 * found


def changed(precision):
    """Every constant a little off, one at a time."""
    for field, little in (("parts", 2.0**-4), ("sine", 2.0**-8), ("cosine", 2.0**-8)):
        values = getattr(precision, field)
        for k, value in enumerate(values):
            for factor in (1 + little, 1 - little):
                other = float(TYPES[precision.name](value * factor))
                yield f"{field} {k} × {factor}", precision._replace(**{field: (*values[:k], other, *values[k + 1 :])})
            yield f"−{field} {k}", precision._replace(**{field: (*values[:k], -value, *values[k + 1 :])})
    yield "rounder", precision._replace(rounder=precision.rounder * 2)
    yield "reach", precision._replace(reach=precision.reach * 100)
    yield "error", precision._replace(error=precision.error * 0.95)


@FORMATS
def test_a_constant_that_is_changed_is_noticed(precision, monkeypatch):
    """Each, by the hypotheses or by the sum."""
    monkeypatch.setitem(globals(), "PIECES", 256)
    assert proved(precision) <= precision.error
    unnoticed = []
    for what, mutant in changed(precision):
        try:
            if proved(mutant) <= mutant.error:
                unnoticed.append(what)
        except AssertionError:
            continue
    assert unnoticed == []


def attack(precision, count, seed):
    """Random numbers up to the reach, numbers next to multiples of π/4 and to its ends, tiny ones."""
    rng, kind = np.random.default_rng(seed), TYPES[precision.name]
    reach = precision.reach
    spread = (
        rng.uniform(-reach, reach, count // 4),
        rng.uniform(-1.0, 1.0, count // 4) * reach ** rng.uniform(-1.0, 1.0, count // 4),
    )
    multiples = (np.pi / 4) * rng.integers(-int(reach / 0.79), int(reach / 0.79), count // 4)
    near = multiples.astype(kind)
    for _ in range(3):
        near = np.where(rng.random(len(near)) < 0.5, np.nextafter(near, kind(np.inf)), near)
        near = np.where(rng.random(len(near)) < 0.5, np.nextafter(near, kind(-np.inf)), near)
    quarter = (np.pi / 4 * rng.choice([-3, -1, 1, 3], count // 4)).astype(kind) * (
        1 + 1e-3 * rng.normal(size=count // 4)
    )
    ends = np.array([0.0, -0.0, reach, -reach, 5e-324, 1e-300, 1e-40, 1e-9, -1e-9])
    x = np.concatenate([*spread, near, quarter, ends]).astype(kind)
    return x[np.abs(x.astype(np.float64)) <= reach]


def largest_error(precision, x, sine, cosine):
    """Against ball arithmetic at 100 bits."""
    worst = 0.0
    before, ctx.prec = ctx.prec, 100
    try:
        for value, a, b in zip(x.tolist(), sine.tolist(), cosine.tolist(), strict=True):
            s, c = arb(value).sin_cos()
            worst = max(worst, float(abs(s - a).upper()), float(abs(c - b).upper()))
    finally:
        ctx.prec = before
    return worst


@FORMATS
@pytest.mark.parametrize("count", [20_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_no_number_is_off_by_more_than_is_proved(precision, count):
    """And some are off by almost half of it, so that the bound is not for show."""
    x = attack(precision, count, 0)
    found = largest_error(precision, x, *sine_and_cosine(x, precision))
    assert 0.4 * precision.error < found <= precision.error


@pytest.fixture(scope="module", params=[DOUBLE, FLOAT], ids=["double", "float"])
def compiled(request, tmp_path_factory):
    """The C of a format as a function of arrays."""
    gcc = shutil.which("gcc") or shutil.which("cc")
    if gcc is None:
        pytest.skip("there is no C compiler")
    folder, precision = tmp_path_factory.mktemp("c"), request.param
    text = [
        "#include <math.h>",
        scalar_macros(precision),
        _trigonometry("own", precision),
        "void many(long n, const S *x, S *s, S *c);",
        "void many(long n, const S *x, S *s, S *c) { for (long k = 0; k < n; k++) own_sincos(x[k], s + k, c + k); }",
    ]
    (folder / "own.c").write_text("\n".join(text) + "\n")
    subprocess.run([gcc, *FLAGS, "-shared", "-fPIC", "-o", str(folder / "own.so"), str(folder / "own.c")], check=True)
    many = ctypes.CDLL(str(folder / "own.so")).many

    def run(x):
        s, c = np.empty_like(x), np.empty_like(x)
        many(ctypes.c_long(len(x)), *(ctypes.c_void_p(a.ctypes.data) for a in (x, s, c)))
        return s, c

    return precision, run


def test_the_compiled_ones_have_the_same_bits(compiled):
    """As NumPy, operation by operation."""
    precision, run = compiled
    x = attack(precision, 1_000_000, 1)
    for own, other in zip(run(x), sine_and_cosine(x, precision), strict=True):
        assert own.tobytes() == other.tobytes()
