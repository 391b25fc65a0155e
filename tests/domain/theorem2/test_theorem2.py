"""Theorem 2's radii: against the RPDR's exact domain, and by trying σ all over the certified cube."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Joint, Link
from ccpin.domain import theorem2
from ccpin.domain.theorem2.form import FORMS, quadratic_form
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from tests.oracles import rpdr as closed_form
from tests.support.long_cases import later
from tests.support.places import SHARED
from tests.support.singular import least_singular_value
from tests.support.strategies import Growth, mechanisms

SQUARE = ("rpdr", "four_bar", "slider_crank", "planar_3rrr", "delta", "stewart", "hexa")
# Table I, degrees: centre, the paper's radius, the exact one (all in the downward mode).
TABLE_I = (
    ((-108.0, -72.0), 3.5, 15.056),
    ((-108.0, -48.0), 0.13, 3.467),
    ((-108.0, -120.0), 1.7, 40.737),
    ((-70.0, -110.0), 0.31, 13.056),
)
every_mechanism = pytest.mark.parametrize("name", SQUARE)
some_mechanisms = pytest.mark.parametrize("name", ["rpdr", *later("delta", *SQUARE[1:4], *SQUARE[5:])])
every_centre = pytest.mark.parametrize(("centre", "paper", "exact"), TABLE_I)


@cache
def load(name):
    return ccpin.load(name)


def configuration(rpdr, paper_order):
    """A configuration in the paper's order (q1, q2, q3, q4) as a configuration of the free system."""
    q_free = np.empty(4)
    for name, value in zip(closed_form.FREE, paper_order, strict=True):
        q_free[rpdr.pin_model.idx_qs[rpdr.pin_model.getJointId(name)]] = value
    return q_free


def square(centre, half, points):
    """A grid over the closed square about a centre, boundary included, of shape (2, points, points)."""
    side = np.linspace(-half, half, points)
    return np.array(np.meshgrid(centre[0] + side, centre[1] + side))


def exact_radius(centre):
    """Half the side of the largest square about a centre with 0 < √(λ²+μ²) < a₃ + a₄ inside, in radians.

    The elbows coincide at two isolated points (modulo turns) only; elongation is judged on a fine grid.
    """
    elbows = closed_form.coincident_elbows()
    apart = [np.abs(np.remainder(centre - s * elbows + np.pi, 2 * np.pi) - np.pi).max() for s in (1.0, -1.0)]
    low, high = 0.0, min(apart)
    reach = closed_form.A3 + closed_form.A4
    for _ in range(30):
        half = 0.5 * (low + high)
        inside = np.hypot(*closed_form.elbow_offset(square(centre, half, 241))).max() < reach
        low, high = (half, high) if inside else (low, half)
    return low


def cube_points(q0, radius, rng, count):
    """Random points of the open cube about q0, among them some of its corners and faces."""
    inside = rng.uniform(-1.0, 1.0, (count, len(q0)))
    corners = rng.choice([-1.0, 1.0], (count, len(q0)))
    return q0 + 0.999999 * radius * np.vstack([inside, corners])


def right_side(quadratic, q0, q):
    """What the last n equations are to equal at q."""
    angles = np.array([kind == "angle" for kind in quadratic.coordinates])
    return np.where(angles, np.sin(q - q0), q - q0)


@every_centre
def test_table_1(rpdr, centre, paper, exact):
    """At the paper's four centres the radius is positive, never above the exact one, and not below the paper's."""
    q0 = np.deg2rad(centre)
    largest = exact_radius(q0)
    assert np.rad2deg(largest) == pytest.approx(exact, abs=1e-2)
    radius = theorem2(rpdr, configuration(rpdr, closed_form.sigma(q0, 1.0))).radius
    assert np.deg2rad(paper) <= radius <= largest


@pytest.mark.parametrize("count", later(2, 4))
def test_never_above_the_exact_radius(rpdr, count):
    """At random closed configurations of both modes, some of them near singularities, the radius stays below."""
    rng = np.random.default_rng(11)
    for mode in (1.0, -1.0):
        for paper_order in closed_form.random_configurations(rng, count, mode, away=1e-3):
            radius = theorem2(rpdr, configuration(rpdr, paper_order)).radius
            assert 0.0 < radius <= exact_radius(paper_order[:2])


@pytest.mark.parametrize("sides", later(4, 7))
def test_beside_the_coinciding_elbows(rpdr, sides):
    """The square never reaches the isolated singular point, from any side and however near the centre."""
    for distance in (0.5, 0.1, 1e-3):
        for angle in np.linspace(0.0, 2.0 * np.pi, sides):
            q0 = closed_form.coincident_elbows() + distance * np.array([np.cos(angle), np.sin(angle)])
            radius = theorem2(rpdr, configuration(rpdr, closed_form.sigma(q0, 1.0))).radius
            assert 0.0 < radius < np.abs(q0 - closed_form.coincident_elbows()).max()


@pytest.mark.parametrize("points", later(50, 150))
@every_centre
def test_sigma_all_over_the_square(rpdr, centre, paper, exact, points):
    """Everywhere in the certified square σ exists and is the closed form's value in the centre's mode."""
    parametrization = rpdr.parametrization()
    q0 = np.deg2rad(centre)
    start = configuration(rpdr, closed_form.sigma(q0, 1.0))
    rng = np.random.default_rng(12)
    for q in cube_points(q0, theorem2(rpdr, start).radius, rng, points):
        found = parametrization.sigma(q, start).q_free
        expected = configuration(rpdr, closed_form.sigma(q, 1.0))
        np.testing.assert_allclose(np.remainder(found - expected + np.pi, 2 * np.pi), np.pi, rtol=0, atol=1e-9)


@some_mechanisms
@pytest.mark.parametrize("form", FORMS)
def test_the_theorem_holds_all_over_the_cube(name, form):
    """In the cube σ's lift lies in the uniqueness ball, ψ_q′ keeps its sign, and Newton's method from z₀ finds it."""
    mechanism = load(name)
    result = theorem2(mechanism, mechanism.q_reference, form=form)
    quadratic = quadratic_form(mechanism, mechanism.q_reference, form)
    parametrization = mechanism.parametrization()
    q0 = parametrization.coordinates.alpha(mechanism.q_reference)
    sign = parametrization.at(mechanism.q_reference).factor.sign
    n = result.system.free
    for q in cube_points(q0, result.radius, np.random.default_rng(13), 10):
        point = parametrization.sigma(q)
        lift = quadratic.lift(point.q_free) / result.weights
        assert np.abs(lift - result.centre).max() < result.uniqueness
        assert point.factor.sign == sign
        right = np.zeros(result.system.size)
        right[-n:] = right_side(quadratic, q0, q)
        assert np.abs(right).max() < result.radius_quadratic
        z = result.centre
        for _ in range(40):
            z = z - np.linalg.solve(result.system.jacobian(z), result.system.value(z) - right)
        np.testing.assert_allclose(z, lift, rtol=0, atol=1e-9)


@settings(max_examples=5)
@given(drawn=mechanisms(), seed=st.integers(0, 99))
def test_the_theorem_holds_for_random_mechanisms(drawn, seed):
    """Wherever a radius is certified for a random tree with loops, σ exists in the cube, its lift inside the ball."""
    try:
        mechanism = ccpin.load(drawn.description)
        result = theorem2(mechanism, mechanism.q_reference)
    except ccpin.CcpinError:
        assume(False)
    quadratic = quadratic_form(mechanism, mechanism.q_reference, result.form)
    parametrization = mechanism.parametrization()
    coordinates = parametrization.coordinates
    q0 = coordinates.alpha(mechanism.q_reference)
    step = min(result.radius, 1.0) * np.random.default_rng(seed).uniform(-1.0, 1.0, (3, coordinates.n))
    for one in step:
        q_free = parametrization.sigma(coordinates.integrate(q0, one)).q_free
        lift = quadratic.lift(q_free) / result.weights
        assert np.abs(lift - result.centre).max() < result.uniqueness


@every_mechanism
def test_radius_is_the_formula_with_small_margins(name):
    """The certified r is below the formula's, by less than a millionth; v and c are those of the system used."""
    mechanism = load(name)
    for form in FORMS:
        kinds = quadratic_form(mechanism, mechanism.q_reference, form).coordinates
        for scaling in ("unit", "weighted"):
            result = theorem2(mechanism, mechanism.q_reference, form=form, scaling=scaling)
            formula = result.system.radius(result.centre)
            assert (1 - 1e-4) * formula < result.radius_quadratic < formula
            assert result.c == result.v.max()
            if set(kinds) == {"angle"}:
                assert np.sin(result.radius) == pytest.approx(result.radius_quadratic, rel=1e-8)
            np.testing.assert_array_equal(result.v, result.system.v)


@some_mechanisms
def test_best_form_and_scaling(name):
    """The default is the better form, and scaling the unknowns never makes the radius smaller."""
    mechanism = load(name)
    best = theorem2(mechanism, mechanism.q_reference)
    assert best.radius == theorem2(mechanism, mechanism.q_reference).radius > 0.0
    radii = []
    for form in FORMS:
        weighted, unit = (
            theorem2(mechanism, mechanism.q_reference, form=form, scaling=s) for s in ("weighted", "unit")
        )
        assert weighted.radius >= unit.radius * (1 - 1e-6)
        assert weighted.form == form
        assert form in weighted.description
        radii.append(weighted.radius)
    assert best.radius == max(radii)


def enlarged(description, factor):
    """The same mechanism, every length multiplied by a factor."""
    size = np.ones((4, 4))
    size[:3, 3] = factor
    joints = tuple(replace(joint, placement=joint.placement * size) for joint in description.joints)
    closures = tuple(
        replace(closure, placement_a=closure.placement_a * size, placement_b=closure.placement_b * size)
        for closure in description.closures
    )
    return replace(description, joints=joints, closures=closures)


@pytest.mark.parametrize("name", ["four_bar", "rpdr"])
def test_radius_of_angles_does_not_depend_on_the_unit_of_length(name):
    """A linkage a thousand times as large has the same radius about the same pose."""
    mechanism = load(name)
    large = ccpin.load(enlarged(mechanism.description, 1000.0))
    point = large.parametrization().sigma(
        mechanism.parametrization().coordinates.alpha(mechanism.q_reference), mechanism.q_reference
    )
    radius = theorem2(mechanism, mechanism.q_reference).radius
    assert theorem2(large, point.q_free).radius == pytest.approx(radius, rel=1e-5)


def built(joints, closures, independent, reference, couplings=()):
    """A mechanism of light bodies, each joint with its own body, from (name, kind, parent, axis)."""
    names = ["base", *(f"{joint[0]}_body" for joint in joints)]
    links = tuple(Link(name, Growth(np.random.default_rng(k)).inertia()) for k, name in enumerate(names))
    tree = tuple(
        Joint(name, kind, parent, f"{name}_body", axis=np.asarray(axis, dtype=float))
        for name, kind, parent, axis in joints
    )
    description = MechanismDescription("built", "base", links, tree, closures, couplings, reference=reference)
    return ccpin.load(description, independent=independent)


def ladder(x, length=1.0):
    """Two slides at right angles whose bodies stay a length apart: x² + y² = length²."""
    closure = LoopClosure("rod", "distance", "x_body", "y_body", length=length)
    joints = [("x", "prismatic", "base", (1, 0, 0)), ("y", "prismatic", "base", (0, 1, 0))]
    return built(joints, (closure,), ["x"], {"x": (x,), "y": (np.sqrt(length**2 - x**2),)})


@pytest.mark.parametrize("x", [0.0, 0.3, 0.6, -0.7, 0.8, 0.95, 0.99])
@pytest.mark.parametrize("length", later(50.0, 1.0, 0.1))
def test_ladder_in_closed_form(x, length):
    """Against the ladder's radii worked out by hand.

    ω = 2/y and γ = max(1, |x|/y), so r = y / (4 max(1, |x|/y)). With weights (1, b), ω = (1 + b²)/(b y) and
    γ = max(1, |x|/(y b)): the best are b = 1 where |x| ≤ y, so r = y/4, else b = |x|/y, so r = |x| y²/(2 length²).
    The exact domain is |x + dx| < length.
    """
    x *= length
    y = np.sqrt(length**2 - x**2)
    mechanism = ladder(x, length)
    unit, weighted = (theorem2(mechanism, mechanism.q_reference, scaling=s) for s in ("unit", "weighted"))
    assert unit.radius == pytest.approx(y / (4.0 * max(1.0, abs(x) / y)), rel=1e-6)
    best = y / 4.0 if abs(x) <= y else abs(x) * y**2 / (2.0 * length**2)
    assert weighted.radius == pytest.approx(best, rel=1e-4)
    assert weighted.radius < length - abs(x)


def test_linear_closures_have_no_limit():
    """Two slides geared to one another are linear: v = 0, the formula's radius infinite; margins leave a huge one."""
    joints = [("x", "prismatic", "base", (1, 0, 0)), ("y", "prismatic", "base", (1, 0, 0))]
    coupling = Coupling("rack", (CouplingTerm("x", (0.0, 1.0)), CouplingTerm("y", (0.0, -3.0))))
    mechanism = built(joints, (), ["x"], {}, (coupling,))
    result = theorem2(mechanism, mechanism.q_reference)
    assert result.c == 0.0
    assert result.system.radius(result.centre) == np.inf
    assert result.radius > 1e9


def test_spherical_joint_as_coordinate():
    """A ball-jointed body carried round by three slides: σ is global, and the last rows are 2 sin(|ξ|/2) ξ/|ξ|."""
    pin_point = np.eye(4)
    pin_point[:3, 3] = 0.3, -0.2, 0.4
    joints = [
        ("ball", "spherical", "base", (0, 0, 1)),
        ("x", "prismatic", "base", (1, 0, 0)),
        ("y", "prismatic", "x_body", (0, 1, 0)),
        ("z", "prismatic", "y_body", (0, 0, 1)),
    ]
    closure = LoopClosure("pin", "spherical", "ball_body", "z_body", placement_a=pin_point)
    quaternion = np.array([0.1, -0.5, 0.3, 0.8]) / np.linalg.norm([0.1, -0.5, 0.3, 0.8])
    mechanism = built(joints, (closure,), ["ball"], {"ball": tuple(quaternion)})
    result = theorem2(mechanism, mechanism.q_reference)
    assert 0.1 < result.radius <= result.radius_quadratic
    quadratic = quadratic_form(mechanism, mechanism.q_reference, result.form)
    parametrization = mechanism.parametrization()
    for xi in cube_points(np.zeros(3), result.radius, np.random.default_rng(14), 20):
        q_free = parametrization.sigma(parametrization.coordinates.integrate(quaternion, xi)).q_free
        lift = quadratic.lift(q_free)
        right = 2.0 * np.sin(0.5 * np.linalg.norm(xi)) * xi / np.linalg.norm(xi)
        np.testing.assert_allclose(quadratic.system.value(lift)[-3:], right, rtol=0, atol=1e-12)
        assert np.abs(right).max() < result.radius_quadratic
        assert np.abs(lift / result.weights - result.centre).max() < result.uniqueness


def test_joints_off_the_loops_do_not_matter(rpdr):
    """A turntable under the whole mechanism, and an arm on its tip, leave the radius as it is."""
    description = rpdr.description
    body = Growth(np.random.default_rng(0)).inertia()
    joints = (
        Joint("table", "continuous", "ground", description.root),
        *description.joints,
        Joint("wrist", "spherical", "link3", "hand"),
    )
    links = (Link("ground"), *(replace(link, inertia=link.inertia or body) for link in description.links))
    whole = replace(
        description, root="ground", links=(*links, Link("hand", body)), joints=joints, independent=None, actuated=None
    )
    mechanism = ccpin.load(whole, independent=["wrist", "joint1", "table", "joint2"])
    radius = theorem2(rpdr, rpdr.q_reference).radius
    assert theorem2(mechanism, mechanism.q_reference).radius == pytest.approx(radius, rel=1e-6)


def test_geared_leg():
    """The shared folder's geared leg: three mimic couplings among continuous joints, with a positive radius."""
    path = SHARED / "mini_cheetah_leg.urdf"
    if not path.exists():
        pytest.skip("the folder ../shared/models is absent")
    mechanism = ccpin.load(path)
    assert theorem2(mechanism, mechanism.q_reference).radius > 0.0


@pytest.mark.parametrize("name", ["bennett", "sarrus"])
def test_redundant_rows_are_refused(name):
    """A certificate of some of the rows is not one of all of them."""
    with pytest.raises(UnsupportedMechanismError, match="not be one of all"):
        theorem2(load(name), load(name).q_reference)


def test_singular_configuration(rpdr):
    """With links 3 and 4 stretched there is no radius."""
    half = closed_form.A3 + closed_form.A4
    q1 = np.arccos((closed_form.C - half) / (2.0 * closed_form.A1))  # symmetric, elbows 2 a₃ apart
    paper = np.array([q1, np.pi - q1, -q1, q1])
    found = theorem2(rpdr, configuration(rpdr, paper))
    assert (found.verdict, found.radius) == ("refuted", 0.0)
    assert np.abs(rpdr.constraints().residual(found.witness.q_free)).max() < 1e-9
    assert least_singular_value(rpdr, found.witness.q_free) < 1e-9 + 10 * found.witness.error
    assert np.abs(found.witness.q_free - configuration(rpdr, paper)).max() < 1e-6


def test_undecided_at_a_cusp(rpdr):
    """Where the elbows coincide the links turn freely: no fold is to be proved, and none is claimed."""
    q1, q2 = -closed_form.coincident_elbows()
    found = theorem2(rpdr, configuration(rpdr, closed_form.sigma((q1 + 1e-10, q2 - 1e-10), 1.0)))
    assert (found.verdict, found.radius, found.witness) == ("undecided", 0.0, None)
    assert "kantorovich_radius" in found.reason


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ([0.1, 0.0, 0.0, 0.0], {}, "open by"),
        ([np.nan, 0.0, 0.0, 0.0], {}, "finite"),
        ([0.0, 0.0, 0.0, 0.0], {"form": "relative"}, "angles, absolute"),
        ([0.0, 0.0, 0.0, 0.0], {"scaling": "none"}, "unit, weighted"),
    ],
)
def test_bad_arguments(rpdr, change, options, message):
    """Open or non-finite configurations and unknown options are refused with what would be right."""
    with pytest.raises(InvalidInputError, match=message):
        theorem2(rpdr, rpdr.q_reference + np.array(change), **options)


def test_wrong_size(rpdr):
    """A configuration of another mechanism is refused with the size wanted."""
    with pytest.raises(InvalidInputError, match="4 finite numbers"):
        theorem2(rpdr, np.zeros(3))
