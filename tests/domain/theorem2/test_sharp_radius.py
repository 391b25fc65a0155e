"""Theorem 2's bounds, number by number: against fractions, where they end, and what is told of them."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import sympy

from ccpin.domain.theorem2 import radius as module
from ccpin.domain.theorem2.polynomials import Polynomial, QuadraticSystem, combine
from ccpin.domain.theorem2.radius import CentreBounds, bounds_at, theorem2
from ccpin.errors import InvalidInputError, SingularConfigurationError

INFLATED = 1 + sympy.Rational(1, 10**9)
EPS = sympy.Rational(2) ** -52


def system_of(rows, free=1, right_side=None):
    """A system of rows {monomial: coefficient}."""
    names = [f"z{k}" for k in range(len(rows))]
    return QuadraticSystem.from_polynomials(names, [Polynomial(row) for row in rows], free=free, right_side=right_side)


def by_hand(rows, z, weights, relative, free, right_side):
    """ω, γ and the residual's bound as the theorem's text has them, in fractions."""
    size = len(rows)
    z, w = [sympy.Rational(x) for x in z], [sympy.Rational(x) for x in weights]
    sums = [sum(abs(sympy.Rational(c)) for c in row.values()) for row in rows]
    total = [one + abs(sympy.Rational(b)) for one, b in zip(sums, right_side, strict=True)]
    error, reach, span = sympy.Rational(relative) * max(total), max(1, *map(abs, z)), max(w)
    J, v, P = sympy.zeros(size), [0] * size, []
    for i, (row, b) in enumerate(zip(rows, right_side, strict=True)):
        P.append(sum(c * sympy.prod([z[k] for k in m]) for m, c in row.items()) - sympy.Rational(b))
        for m, c in row.items():
            for k in range(len(m)):
                J[i, m[k]] += c * sympy.prod([z[j] for j in (*m[:k], *m[k + 1 :])]) * w[m[k]]
            if len(m) == 2:
                v[i] += 2 * abs(c) * w[m[0]] * w[m[1]]
    inverse = J.inv()
    M, step = inverse.applyfunc(abs), inverse * sympy.Matrix(P)
    sums = [sum(M.row(i)) for i in range(size)]
    lost = [4 * size * EPS * sum((M * J.applyfunc(abs)).row(i)) for i in range(size)]
    kappa = max(lost[i] + 2 * error * reach * span * sums[i] for i in range(size))
    factor = INFLATED / (1 - kappa)
    bend = max(sum(M[i, k] * (v[k] + 2 * error * span**2) for k in range(size)) for i in range(size))
    gain = max(sum(M[i, k] for k in range(size - free, size)) for i in range(size))
    residual = max(abs(step[i]) + error * reach**2 * sums[i] for i in range(size))
    return float(kappa), [float(factor * x) for x in (bend, gain, residual)]


TWO = [{(0, 0): 1.0, (1,): 2.0, (): -1.0}, {(0, 1): -3.0, (0,): 1.0, (1,): 1.0}]
THREE = [{(0, 0): 2.0, (1,): 1.0}, {(1, 1): 1.0, (0, 2): -1.0, (): 0.5}, {(2,): 4.0, (0,): 1.0, (0, 1): 1.0}]


@pytest.mark.parametrize(
    ("rows", "z", "weights", "relative", "free", "right_side"),
    [
        (TWO, (0.5, 0.25), (1.0, 1.0), 0.0, 1, (0.0, 0.0)),
        (TWO, (0.5, 0.25), (1.0, 0.25), 2.0**-10, 1, (0.0, 0.5)),
        (TWO, (2.5, 0.25), (1.0, 0.5), 2.0**-12, 2, (0.25, 0.5)),
        (THREE, (0.5, -4.0, 0.75), (0.5, 1.0, 0.125), 2.0**-14, 2, (0.0, 1.0, -8.0)),
        (THREE, (0.5, 0.5, -0.75), (4.0, 2.0, 1.0), 2.0**-14, 1, (0.0, 0.0, 0.0)),
        ([{(0,): 1.0, (1,): 2.0**40}, {(1,): 1.0, (0, 0): 1.0}], (0.0, 1.0), (1.0, 1.0), 0.0, 1, (0.0, 0.0)),
        ([{(0,): 8.0, (0, 0): 1.0}], (0.0,), (1.0,), 2.0**-8, 1, (1.0,)),
    ],
)
def test_bounds_are_those_of_the_text(rows, z, weights, relative, free, right_side):
    """ω = ‖J⁻¹diag(v)‖, γ and the first step's length, with what coefficients, and rounding, may be off by."""
    system = system_of(rows, free, right_side)
    kappa, expected = by_hand(rows, z, weights, relative, free, right_side)
    found = bounds_at(system, np.array(z), np.array(weights), relative)
    assert kappa < 0.4
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-300)


def test_an_inverse_counts_by_what_it_is_off_by(monkeypatch):
    """A = (1 + 1/16) J⁻¹ in one row: everything grows by 1/(1 − 1/16), and A is what bounds are made of."""
    system, inverse = system_of([{(0,): 1.0, (0, 0): 1.0}, {(1,): 1.0}]), np.linalg.inv
    monkeypatch.setattr(module.np.linalg, "inv", lambda J: np.diag([17 / 16, 1.0]) @ inverse(J))
    found = bounds_at(system, np.zeros(2), np.ones(2), 0.0)
    np.testing.assert_allclose(found, [(1 + 1e-9) * 16 / 15 * x for x in (2 * 17 / 16, 1.0, 0.0)], rtol=1e-12)


def test_bounds_end_where_the_inverse_is_off_by_half():
    """κ = 2ε/|J| with ε of the coefficients; and where there is none."""
    for relative, known in ((0.245, True), (0.255, False)):
        assert (bounds_at(system_of([{(0,): 1.0}]), np.zeros(1), np.ones(1), relative) is not None) == known
    assert bounds_at(system_of([{(0,): 1.0}, {(0,): 1.0}]), np.zeros(2), np.ones(2), 0.0) is None


@pytest.mark.parametrize(
    ("bend", "gain", "residual", "radius"),
    [
        (2.0, 4.0, 0.0, 0.0625), (2.0, 4.0, 0.125, 0.03125), (2.0, 4.0, 0.5, -0.0625), (2.0, 0.0, 9.0, np.inf),
        (0.0, 4.0, 9.0, np.inf),
    ],
)  # fmt: skip
def test_the_first_step_may_take_half(bend, gain, residual, radius):
    """ω(γr + residual) = ½ at r, less a billionth."""
    found = CentreBounds(bend, gain, residual).radius
    np.testing.assert_allclose(found, radius / (1 + 1e-9), rtol=1e-14)


# What is told


def applied(monkeypatch, bounds, coordinates=("angle",), scaling="unit"):
    """What is told of bounds."""
    system = system_of([{(0,): 1.0, (0, 0): 3.0}])
    monkeypatch.setattr(module, "bounds_at", lambda system, centre, weights, error: bounds)
    monkeypatch.setattr(module, "best_weights", lambda system, centre: np.full(1, 0.5))
    monkeypatch.setattr(module, "_reason", lambda *_: "")
    form = SimpleNamespace(system=system, centre=np.zeros(1), error=0.0, coordinates=coordinates, form="angles")
    return module._apply(form, scaling)


@pytest.mark.parametrize(
    ("r", "angle", "displacement", "rotation"),
    [(0.5, np.pi / 6, 0.5, 0.5), (1.7, np.pi / 2, 1.7, 1.7), (1.9, np.pi / 2, 1.9, np.pi / 3**0.5)],
)
def test_radii_of_coordinates(monkeypatch, r, angle, displacement, rotation):
    """Translated coordinate by coordinate, the least of those that occur."""
    bounds, some = CentreBounds(2.0, 0.25 / r / (1 + 1e-9), 0.0), {"angle": angle, "displacement": displacement}
    some["rotation"] = rotation
    for kinds in (["angle"], ["displacement"], ["rotation"], ["displacement", "angle"], ["rotation", "displacement"]):
        found = applied(monkeypatch, bounds, tuple(kinds))
        least = min(some[kind] for kind in kinds)
        np.testing.assert_allclose(found.radius, least / (1 + 1e-9), rtol=1e-14)
        assert found.verdict == "proven"
        np.testing.assert_allclose([found.radius_quadratic, found.uniqueness], [r, 0.5 / (1 + 1e-9)], rtol=1e-14)


def test_what_is_told_of_no_radius(monkeypatch):
    for bounds in (None, CentreBounds(2.0, 4.0, 0.25), CentreBounds(2.0, 4.0, 0.5)):
        for coordinates in ((), ("angle",)):
            found = applied(monkeypatch, bounds, coordinates)
            assert (found.verdict, found.radius, found.radius_quadratic) == ("undecided", 0.0, 0.0)
            assert found.uniqueness == 0.0
    free = applied(monkeypatch, CentreBounds(0.0, 4.0, 0.0), ())
    assert (free.verdict, free.radius, free.uniqueness) == ("proven", np.inf, np.inf)


def test_unknowns_are_scaled_where_that_is_asked_for(monkeypatch):
    bounds = CentreBounds(2.0, 4.0, 0.0)
    assert applied(monkeypatch, bounds).weights.tolist() == [1.0]
    scaled = applied(monkeypatch, bounds, scaling="weighted")
    assert (scaled.weights.tolist(), scaled.c, scaled.v.tolist()) == ([0.5], 1.5, [1.5])
    assert applied(monkeypatch, None, scaling="weighted").weights.tolist() == [1.0]


@dataclass(frozen=True)
class Found:
    radius: float
    verdict: str = ""
    reason: str = ""
    witness: object = None


@pytest.mark.parametrize(
    ("radii", "singular", "radius", "verdict"),
    [
        ((1.0, 2.0), True, 2.0, ""), ((2.0, 1.0), True, 2.0, ""), ((0.0, 0.0), True, 0.0, "refuted"),
        ((0.0, 0.0), False, 0.0, ""),
    ],
)  # fmt: skip
def test_the_larger_radius_is_told_and_no_radius_refuted(monkeypatch, radii, singular, radius, verdict):
    witness = SimpleNamespace(error=1e-9) if singular else None
    forms = dict(zip(module.FORMS, radii, strict=True))
    monkeypatch.setattr(module, "mechanism_of", lambda mechanism: mechanism)
    monkeypatch.setattr(module, "_checked", lambda mechanism, q_free: q_free)
    monkeypatch.setattr(module, "quadratic_form", lambda mechanism, q_free, form: form)
    monkeypatch.setattr(module, "_apply", lambda form, scaling: Found(forms[form]))
    monkeypatch.setattr(module, "_singular_at", lambda mechanism, q_free: witness)
    found = theorem2(None, np.zeros(1))
    assert (found.radius, found.verdict) == (radius, verdict)
    assert found.witness is (witness if verdict else None)


@pytest.mark.parametrize(
    ("theta", "proved", "found"),
    [
        ([[3.0, 3 + 0.5e-6], [3.0 - 0.75e-6, 3.0]], (True, True), 0),
        ([[3.0, 3 + 0.8e-6], [3.0, 3.0]], (True, True), 1),
        ([[3.0, 3 + 0.7e-6], [3.0, 3 - 0.45e-6]], (True, False), 0),
        ([[3.0, 3 + 0.8e-6], [3.0, 3.0]], (True, False), None),
        ([[3.0, 4.0], [4.0, 3.0]], (True, True), None),
    ],
)  # fmt: skip
def test_a_singular_configuration_is_near_with_all_its_error(monkeypatch, theta, proved, found):
    """Known to 0.25e-6 and 0.5e-6; to a millionth in every coordinate; the one that is known best."""
    reading = SimpleNamespace(
        problem=None, theta=lambda q_free: np.full(2, 3.0), configuration=lambda theta: theta,
        system=SimpleNamespace(independent=np.array([0])),
    )  # fmt: skip
    points = SimpleNamespace(theta=np.array(theta), proved=np.array(proved), error=np.array([0.25e-6, 0.5e-6]))
    monkeypatch.setattr(module, "reading_of", lambda *_: SimpleNamespace(bounded=lambda name: reading))
    monkeypatch.setattr(module.Folds, "near", lambda *_: SimpleNamespace(directions=lambda: np.zeros((2, 1, 1))))
    monkeypatch.setattr(module, "singular_points", lambda *_: points)
    witness = module._singular_at(None, None)
    assert (None if witness is None else witness.q_free.tolist()) == (None if found is None else theta[found])


def test_open_configurations_are_refused(monkeypatch):
    """From 1e-8 in any row of φ on."""
    monkeypatch.setattr(module, "checked_configuration", lambda mechanism, q_free: q_free)
    constraints = SimpleNamespace(residual=lambda q_free: q_free, misfit=lambda phi: "much")
    mechanism = SimpleNamespace(constraints=lambda: constraints)
    for size, closed in ((1e-8 * (1 - 1e-3), True), (1e-8 * (1 + 1e-3), False)):
        for row in np.eye(2) * size:
            if closed:
                assert module._checked(mechanism, -row) is not None
            else:
                with pytest.raises(InvalidInputError, match="open by much"):
                    module._checked(mechanism, -row)


# Polynomials


def test_sums_and_products():
    """Coefficient by coefficient."""
    x, y, one = Polynomial.unknown(0), Polynomial.unknown(1), Polynomial.constant(1.0)
    assert (x + y + one + x).terms == {(0,): 2.0, (1,): 1.0, (): 1.0}
    assert (x - y - one - one).terms == {(0,): 1.0, (1,): -1.0, (): -2.0}
    assert ((y + x) * (x + y)).terms == {(0, 0): 1.0, (0, 1): 2.0, (1, 1): 1.0}
    assert ((x + one) * (x - one)).terms == {(0, 0): 1.0, (): -1.0}
    assert combine([(2.0, x), (3.0, x + y)]).terms == {(0,): 5.0, (1,): 3.0}
    assert [p.degree for p in (one, x, x * y, one - one, x * y + one)] == [0, 1, 2, 0, 2]
    small = Polynomial({(): 8.0, (0,): 1.0, (1,): -1.001, (0, 1): 0.5})
    assert small.cleaned(0.125).terms == {(): 8.0, (1,): -1.001}


@pytest.mark.parametrize(
    ("names", "count", "right", "free"),
    [(["a", "a"], 2, None, 1), (["a", "b"], 1, None, 1), (["a", "b"], 3, None, 1), (["a", "b"], 2, [0.0], 1),
     (["a", "b"], 2, None, 3), (["a", "b"], 2, None, -1)],
)  # fmt: skip
def test_systems_that_are_not_square_are_refused(names, count, right, free):
    with pytest.raises(InvalidInputError, match="square system"):
        QuadraticSystem.from_polynomials(names, [Polynomial.unknown(0)] * count, free=free, right_side=right)


def test_sizes_of_rows():
    """Every |coefficient| times its monomial, the right side with them."""
    rows = [{(): -1.0, (0,): 2.0, (0, 1): -3.0}, {(1, 1): 4.0, (1,): -5.0}]
    system = system_of(rows, right_side=[-0.5, 0.25])
    assert system.magnitude(np.array([-2.0, 3.0])).tolist() == [1 + 0.5 + 4 + 18, 0.25 + 36 + 15]
    assert system.value(np.array([-2.0, 3.0])).tolist() == [-1 + 0.5 - 4 + 18, -0.25 + 36 - 15]
    assert (system.v.tolist(), system.c) == ([6.0, 8.0], 8.0)


def test_the_formula():
    """½/(ωγ) in a system whose rows differ, and none of one without bends; a singular one is refused."""
    system = system_of([{(0,): 2.0, (0, 1): 1.0}, {(1,): 4.0, (0,): 0.0, (1, 1): 1.0}, {(2,): 0.5, (0,): 1.0}], free=2)
    omega, gamma = max(2 / 2, 2 / 4, 2 * (2 / 2)), max(1 / 4, 2.0)
    np.testing.assert_allclose(system.radius(np.zeros(3)), 0.5 / (omega * gamma), rtol=1e-14)
    assert system_of([{(0,): 2.0}]).radius(np.zeros(1)) == np.inf
    for tiny, singular in ((2.0**-50, False), (2.0**-53, True)):
        almost = system_of([{(0,): 1.0, (0, 0): 1.0}, {(1,): tiny}])
        if singular:
            with pytest.raises(SingularConfigurationError):
                almost.radius(np.zeros(2))
        else:
            assert almost.radius(np.zeros(2)) == 0.25 * tiny
