"""Quadratic systems, and ψ of a mechanism as one: against sympy, φ itself and det ψ_q′."""

from functools import cache, partial

import numpy as np
import pinocchio as pin
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin.description import CLOSURE_KINDS
from ccpin.domain import theorem2
from ccpin.domain.theorem2.form import FORMS, quadratic_form
from ccpin.domain.theorem2.polynomials import Polynomial, QuadraticSystem
from ccpin.errors import InvalidInputError, SingularConfigurationError, UnsupportedMechanismError
from tests.oracles import rpdr as closed_form
from tests.oracles.finite_differences import assert_close, derivative
from tests.support.closed_chains import spatial_chain
from tests.support.geared import geared
from tests.support.rods import rod_ankle, rod_stewart
from tests.support.strategies import ROWS, mechanisms
from tests.support.walkthrough import file

PAPER_UNKNOWNS = ("x", "y", "u", "v", "w", "s")
PAPER_EQUATIONS = ("x*u - 1", "x*v - 2*y", "u**2 + v**2 - 1", "x**2 - w", "y**2 - s", "s*y - 3*w*y")
SQUARE = ("rpdr", "four_bar", "slider_crank", "planar_3rrr", "delta", "stewart", "hexa")

every_form = pytest.mark.parametrize("form", FORMS)
every_mechanism = pytest.mark.parametrize("name", SQUARE)


@cache
def load(name):
    return ccpin.load(name)


def random_expressions(rng, names):
    """Polynomials of degree two with small whole coefficients, many of them zero, as sympy expressions."""
    symbols = sympy.symbols(names)
    monomials = [1, *symbols, *(a * b for i, a in enumerate(symbols) for b in symbols[i:])]
    return [sum(int(c) * m for c, m in zip(rng.integers(-3, 4, len(monomials)), monomials, strict=True)) for _ in names]


def system_of(names, expressions, free=1, right_side=None):
    """The system of equations written by hand: strings or sympy expressions."""
    symbols = sympy.symbols(names)
    polynomials = []
    for expression in expressions:
        terms = sympy.Poly(sympy.sympify(expression), *symbols).terms()
        monomials = {tuple(i for i, power in enumerate(m) for _ in range(power)): float(c) for m, c in terms}
        polynomials.append(Polynomial({m: c for m, c in monomials.items() if c}))
    return QuadraticSystem.from_polynomials(names, polynomials, free=free, right_side=right_side)


def v_by_the_rule(expressions, names):
    """Theorem 2's v word by word: per entry of the Jacobian drop constants, make signs +, set variables to 1; sum."""
    symbols = sympy.symbols(names)
    rows = []
    for expression in expressions:
        entries = [sympy.Poly(sympy.diff(expression, symbol), *symbols) for symbol in symbols]
        rows.append(sum(abs(c) for entry in entries for m, c in entry.terms() if sum(m) > 0))
    return np.array(rows, dtype=float)


def shifted(mechanism, q_free, size, seed):
    """A configuration nearby, in general open."""
    step = np.random.default_rng(seed).normal(scale=size, size=mechanism.n_free)
    return pin.integrate(mechanism.pin_model, q_free, step)


def test_the_papers_worked_example():
    """The vector is v = (2, 2, 4, 2, 2, 8) and c = 8, the right side (0, 0, 0, 0, 0, r)."""
    system = system_of(PAPER_UNKNOWNS, PAPER_EQUATIONS, right_side=[0, 0, 0, 0, 0, 0.25])
    assert system.v.tolist() == [2.0, 2.0, 4.0, 2.0, 2.0, 8.0]
    assert system.c == 8.0
    z = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 11.0])
    assert system.value(z).tolist() == [2.0, 1.0, 33.0, -6.0, -7.0, 22.0 - 42.0 - 0.25]


@pytest.mark.parametrize("seed", range(8))
def test_system_against_sympy(seed):
    """Value, Jacobian and v of random systems are sympy's."""
    rng, names = np.random.default_rng(seed), ("a", "b", "c", "d")
    expressions, z = random_expressions(rng, names), rng.normal(size=4)
    system = system_of(names, expressions)
    at = dict(zip(sympy.symbols(names), z, strict=True))
    matrix = sympy.Matrix(expressions)
    np.testing.assert_allclose(system.value(z), np.array(matrix.subs(at), dtype=float)[:, 0], rtol=0, atol=1e-12)
    exact = np.array(matrix.jacobian(sympy.symbols(names)).subs(at), dtype=float)
    np.testing.assert_allclose(system.jacobian(z), exact, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(system.v, v_by_the_rule(expressions, names))


@pytest.mark.parametrize("seed", range(8))
def test_v_bounds_the_change_of_the_jacobian(seed):
    """Row sums of |P_z(x) − P_z(y)| are at most v ‖x − y‖∞, also after rescaling the unknowns."""
    rng, names = np.random.default_rng(seed), ("a", "b", "c", "d")
    system = system_of(names, random_expressions(rng, names))
    scaled = system.rescaled(rng.uniform(0.1, 10.0, 4))
    for one in (system, scaled):
        for x, y in rng.normal(size=(50, 2, 4)):
            change = np.abs(one.jacobian(x) - one.jacobian(y)).sum(axis=1)
            assert np.all(change <= one.v * np.abs(x - y).max() * (1 + 1e-12) + 1e-12)


def test_radius_is_sharp_for_a_square_root():
    """x² = 1 + δ about x = 1 has the radius 1, and is singular at δ = −1."""
    system = system_of(["x"], ["x**2 - 1"])
    assert system.radius(np.array([1.0])) == 1.0
    assert system.jacobian(np.array([0.0]))[0, 0] == 0.0


def test_radius_does_not_depend_on_the_equations_scales():
    """Multiplying equations other than the last n by numbers changes v and P_z alike, and not the radius."""
    z = np.array([1.0, 0.5, 1.0, 1.0, 1.0, 0.25])
    factors = (3.0, -0.2, 7.0, 1e3, -5.0, 1.0)
    scaled = [f"{k}*({e})" for k, e in zip(factors, PAPER_EQUATIONS, strict=True)]
    plain, other = (system_of(PAPER_UNKNOWNS, e) for e in (PAPER_EQUATIONS, scaled))
    assert plain.radius(z) == pytest.approx(other.radius(z), rel=1e-12)


def test_singular_centre():
    """There is no radius about a point where P_z is singular."""
    with pytest.raises(SingularConfigurationError):
        system_of(["x"], ["x**2"]).radius(np.array([0.0]))


@pytest.mark.parametrize(
    ("expressions", "message"),
    [
        (["x*y*y", "y"], "above degree two"),
        (["x"], "square system"),
    ],
)
def test_what_is_not_a_quadratic_system(expressions, message):
    """Whatever is not a square polynomial system of degree two is refused with the reason."""
    with pytest.raises(InvalidInputError, match=message):
        system_of(["x", "y"], expressions)


def assert_form_is_psi(mechanism, form, seeds=range(3), size=0.4):
    """Identities hold and closure rows are φ's at closed and open configurations; the centre solves the system.

    φ itself is known to the accuracy with which the model's placements are rigid.
    """
    constraints = mechanism.constraints()
    centre = mechanism.q_reference
    quadratic = quadratic_form(mechanism, centre, form)
    system, window = quadratic.system, quadratic.closures
    np.testing.assert_allclose(quadratic.lift(centre), quadratic.centre, rtol=0, atol=1e-13)
    assert_close(system.value(quadratic.centre), np.zeros(system.size), 1e-11, scale=1.0)
    for seed in seeds:
        q_free = shifted(mechanism, centre, size, seed)
        value = system.value(quadratic.lift(q_free))
        np.testing.assert_allclose(value[: window.start], 0.0, rtol=0, atol=1e-12)
        phi = constraints.residual(q_free)[: sum(loop.size for loop in constraints.loops)]
        assert_close(value[window][: len(phi)], phi, quadratic.error, scale=1.0)  # an error in metres
    return quadratic


@every_form
@every_mechanism
def test_closure_rows_are_phi(name, form):
    """The quadratic form of each mechanism is φ itself in other unknowns, on the manifold and off it."""
    assert_form_is_psi(load(name), form)


@every_form
@every_mechanism
def test_forms_vanish_on_closed_configurations(name, form):
    """Where σ is closed the system is solved, with right side sin(q − q⁰) or q − q⁰."""
    mechanism = load(name)
    quadratic = quadratic_form(mechanism, mechanism.q_reference, form)
    parametrization = mechanism.parametrization()
    alpha = parametrization.coordinates.alpha
    q0 = alpha(mechanism.q_reference)
    rng = np.random.default_rng(3)
    angles = np.array([kind == "angle" for kind in quadratic.coordinates])
    for _ in range(5):
        q = q0 + rng.uniform(-0.03, 0.03, mechanism.n)
        right = np.where(angles, np.sin(q - q0), q - q0)
        value = quadratic.system.value(quadratic.lift(parametrization.sigma(q).q_free))
        np.testing.assert_allclose(value[: quadratic.closures.stop], 0.0, rtol=0, atol=1e-11)
        np.testing.assert_allclose(value[quadratic.closures.stop :], right, rtol=0, atol=1e-12)


@every_form
@every_mechanism
def test_jacobian_is_affine_and_exact(name, form):
    """P_z agrees with finite differences, and P_z((x + y)/2) is the mean of P_z(x) and P_z(y)."""
    system = quadratic_form(load(name), load(name).q_reference, form).system
    rng = np.random.default_rng(4)
    x, y, d = rng.normal(size=(3, system.size))
    assert_close(system.jacobian(x) @ d, derivative(lambda s: system.value(x + s * d)), 1e-9)
    assert_close(system.jacobian((x + y) / 2), (system.jacobian(x) + system.jacobian(y)) / 2, 1e-14)


@every_form
@every_mechanism
def test_determinant_is_that_of_psi(name, form):
    """|det P_z| at the centre is 2^(number of angles) |det ψ_q′|: singular together, and only together."""
    mechanism = load(name)
    parametrization = mechanism.parametrization()
    for seed in range(3):
        q = parametrization.coordinates.alpha(mechanism.q_reference)
        q_free = parametrization.sigma(q + np.random.default_rng(seed).uniform(-0.02, 0.02, mechanism.n)).q_free
        quadratic = quadratic_form(mechanism, q_free, form)
        psi = abs(np.linalg.det(parametrization.psi_jacobian(q_free)))
        factor = 2.0 ** sum(unknown.endswith(".cos") for unknown in quadratic.system.unknowns)
        assert abs(np.linalg.det(quadratic.system.jacobian(quadratic.centre))) == pytest.approx(factor * psi, rel=1e-9)


@every_form
def test_determinant_of_the_rpdr(rpdr, form):
    """|det P_z| = 16 a₃ a₄ |sin(q1 + q3 − q2 − q4)| at random closed configurations of both modes."""
    order = [list(rpdr.pin_model.names).index(name) - 1 for name in closed_form.FREE]
    for mode in (1.0, -1.0):
        for paper in closed_form.random_configurations(np.random.default_rng(5), 20, mode):
            q_free = np.empty(4)
            q_free[order] = paper
            quadratic = quadratic_form(rpdr, q_free, form)
            np.testing.assert_allclose(quadratic.system.value(quadratic.centre), 0.0, rtol=0, atol=1e-13)
            expected = 16.0 * closed_form.A3 * closed_form.A4 * abs(np.sin(closed_form.fold(paper)))
            found = abs(np.linalg.det(quadratic.system.jacobian(quadratic.centre)))
            assert found == pytest.approx(expected, rel=1e-10)


@every_form
@pytest.mark.parametrize("name", ["rssr", "ankle", "gas_spring_leg"])
def test_rows_that_lock_a_spin(name, form):
    """The row w·u of a rod's locked spin is one of the form's, beside the ball's quaternion."""
    mechanism = ccpin.load(file(name))
    assert [lock.kind for lock in mechanism.locks] == ["perpendicular"]
    assert_form_is_psi(mechanism, form)


@every_form
@pytest.mark.parametrize(
    "kind", [kind for kind in CLOSURE_KINDS if kind != "perpendicular"]
)  # no slide enters that one
def test_every_closure_kind(kind, form):
    """Each closure kind between chains with spherical, continuous and prismatic joints, on a moving ancestor."""
    for seed in (1, 2):
        mechanism = spatial_chain(kind, seed)
        quadratic = assert_form_is_psi(mechanism, form)
        balls = sum(unknown.endswith(".qw") for unknown in quadratic.system.unknowns)
        angles = sum(unknown.endswith(".cos") for unknown in quadratic.system.unknowns)
        psi = mechanism.parametrization().psi_jacobian(mechanism.q_reference)
        on_loop = np.flatnonzero(np.abs(psi[: -mechanism.n]).max(axis=0))  # all but the stem
        stem = ROWS[kind] + (3 if mechanism.n > 6 else 0)
        psi = np.delete(psi[:, on_loop], stem, axis=0)
        found = abs(np.linalg.det(quadratic.system.jacobian(quadratic.centre)))
        assert found == pytest.approx(2.0**angles * 16.0**balls * abs(np.linalg.det(psi)), rel=1e-8)


@pytest.mark.slow
@every_form
@settings(max_examples=25)
@given(drawn=mechanisms(), seed=st.integers(0, 99))
def test_random_mechanisms(form, drawn, seed):
    """Random trees with one or two loops, planar or spatial: a form is φ itself, or is refused with the reason."""
    try:
        mechanism = ccpin.load(drawn.description)
    except ccpin.CcpinError:
        assume(False)
    try:
        assert_form_is_psi(mechanism, form, seeds=(seed,))
    except UnsupportedMechanismError as refusal:
        message = str(refusal)
        assume("redundant by numerical rank" not in message)
        assume("lies on a loop" not in message)
        assume("one component of" not in message)
        raise


@every_form
@pytest.mark.parametrize(
    ("ratios", "kinds", "scale"),
    [
        ((1.0, 1.0), ("revolute", "revolute"), 1),
        ((-2.0, 3.0), ("revolute", "continuous"), 1),
        ((1.0, -0.75), ("revolute", "revolute"), 4),
        ((1 / 3, -0.5, 1.0), ("revolute", "revolute", "revolute"), 6),
        ((-2.0, 0.25), ("continuous", "continuous"), 4),
        ((2.0, -4.0), ("continuous", "revolute"), 0.5),
    ],
)
def test_gear_rows_are_sines(ratios, kinds, scale, form):
    """A gear's equation is sin(D φ), D making the ratios whole and coprime, at closed and open configurations."""
    terms = [((0.1, ratio), 0.3 * k) for k, ratio in enumerate(ratios)]
    pose = [0.4 + 0.2 * k for k in range(len(kinds))]
    mechanism = geared(terms, kinds, pose)
    quadratic = quadratic_form(mechanism, mechanism.q_reference, form)
    constraints = mechanism.constraints()
    for seed in range(5):
        q_free = shifted(mechanism, mechanism.q_reference, 0.3, seed)
        value = quadratic.system.value(quadratic.lift(q_free))
        np.testing.assert_allclose(value[: quadratic.closures.start], 0.0, rtol=0, atol=1e-12)
        sine = np.sin(scale * constraints.residual(q_free))
        np.testing.assert_allclose(value[quadratic.closures], sine, rtol=0, atol=1e-12)


def test_racks_are_linear():
    """A coupling between displacements is its own quadratic form."""
    mechanism = geared([((0.1, 2.0), 0.1), ((0.0, -0.7), 0.0)], ("prismatic", "prismatic"), (0.2, 0.1))
    quadratic = quadratic_form(mechanism, mechanism.q_reference, "angles")
    assert quadratic.system.c == 0.0
    q_free = shifted(mechanism, mechanism.q_reference, 0.3, 1)
    value = quadratic.system.value(quadratic.lift(q_free))[quadratic.closures]
    np.testing.assert_allclose(value, mechanism.constraints().residual(q_free), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("terms", "kinds", "reason"),
    [
        ([((0.0, 1.0),), ((0.0, -2.0),)], ("revolute", "prismatic"), "angles with displacements"),
        ([((0.0, 1.0),), ((0.0, -1.0, 0.2),)], ("revolute", "revolute"), "not linear"),
        ([((0.0, 1.0),), ((0.0, -np.sqrt(2.0)),)], ("revolute", "revolute"), "whole numbers"),
        ([((0.0, 1.0),), ((0.0, -37.0),)], ("revolute", "revolute"), "whole numbers"),
    ],
)
def test_couplings_without_a_quadratic_form(terms, kinds, reason):
    """Rack and pinion, cams and irrational or large ratios are refused by name."""
    mechanism = geared(terms, kinds, (0.0, 0.0))
    with pytest.raises(UnsupportedMechanismError, match=f"'gear' has no quadratic form: .*{reason}"):
        quadratic_form(mechanism, mechanism.q_reference, "angles")


@pytest.mark.parametrize("name", ["bennett", "sarrus"])
def test_redundant_rows_are_refused(name):
    """Overconstrained linkages keep rows that only their numerical rank makes superfluous."""
    with pytest.raises(UnsupportedMechanismError, match="redundant by numerical rank"):
        quadratic_form(load(name), load(name).q_reference, "angles")


def test_unknown_form(rpdr):
    """A form that does not exist is refused with those that do."""
    with pytest.raises(InvalidInputError, match="angles, absolute"):
        quadratic_form(rpdr, rpdr.q_reference, "relative")


def test_planar_loops_are_affine_in_absolute_directions(rpdr):
    """With absolute directions the only quadratic monomials of the RPDR are those of the unit circles."""
    system = quadratic_form(rpdr, rpdr.q_reference, "absolute").system
    assert system.v.tolist() == [4.0] * 4 + [0.0] * 4


@pytest.mark.parametrize(
    "make", [rod_stewart, partial(rod_stewart, "cranks"), rod_ankle], ids=["stewart", "cranks", "ankle"]
)
def test_floating_joints_and_distances(make):
    """The closure rows of lifts of open configurations are φ's, and σ's lifts over the certified cube are its roots."""
    mechanism = ccpin.load(make())
    found, rng = theorem2(mechanism, mechanism.q_reference), np.random.default_rng(9)
    form = quadratic_form(mechanism, mechanism.q_reference, found.form)
    for _ in range(20):
        moved = pin.integrate(mechanism.pin_model, mechanism.q_reference, rng.uniform(-0.4, 0.4, mechanism.n_free))
        values = form.system.value(form.lift(moved))
        assert np.abs(values[form.closures] - mechanism.constraints().residual(moved)).max() < 1e-12
        assert np.abs(values[: form.closures.start]).max() < 1e-12
    assert found.verdict == "proven"
    assert found.radius > 1e-3
    parametrization = mechanism.parametrization()
    q0 = parametrization.coordinates.alpha(mechanism.q_reference)
    for _ in range(20):
        q = q0 + found.radius * rng.uniform(-0.999, 0.999, mechanism.n)
        lift = form.lift(parametrization.sigma(q).q_free) / found.weights
        assert np.abs(lift - found.centre).max() < found.uniqueness
