"""φ, φ_q′ and φ̇_q′ of every closure kind and coupling, on closed configurations and off them."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description import CLOSURE_KINDS, Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.loading.reference_search import stated_pose
from tests.oracles.finite_differences import along, assert_close, jacobian
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.strategies import PLANAR_JOINTS, ROWS, Growth

SPATIAL_JOINTS = ("revolute", "spherical", "prismatic", "continuous", "planar", "floating", "revolute")
every_kind = pytest.mark.parametrize("kind", CLOSURE_KINDS)


def grown(kind, planar, seed):
    """A trunk with two branches closed on one another, so that the loop's common ancestor moves."""
    growth = Growth(np.random.default_rng(seed), planar)
    trunk = growth.grow("base", ["revolute", "prismatic"])
    chain = PLANAR_JOINTS if planar else SPATIAL_JOINTS
    growth.close(kind, growth.grow(trunk, chain[:3]), growth.grow(trunk, chain[3:]))
    return growth.drawn().description


ARM = 0.1  # m a radian (or rad/s): rows that planarity or a coupling keeps constant have no size of their own


def assert_derivatives(constraints, q_free, v_free):
    model = constraints.model
    value = constraints.value(q_free)
    rate = constraints.rate(value, v_free)
    assert_close(value.jacobian, jacobian(model, q_free, constraints.residual), 1e-9, scale=ARM)
    assert_close(rate, along(model, q_free, v_free, lambda q: constraints.value(q).jacobian), 1e-9, scale=ARM)
    np.testing.assert_array_equal(value.phi, constraints.residual(q_free))
    assert_close(constraints.bias(value, v_free), rate @ v_free, 1e-12, scale=ARM)


@same_on_both
@pytest.mark.parametrize("floating_base", later(True, False))
@pytest.mark.parametrize("planar", [False, True])
@every_kind
@pytest.mark.parametrize("seed", later(0, 1))
def test_derivatives(seed, kind, planar, floating_base):
    """φ_q′ and φ̇_q′ are φ's derivatives on the manifold and off it, with every planar reduction and without."""
    description = grown(kind, planar, 100 * seed + planar)
    tree = build_tree(description, floating_base)
    reference = stated_pose(tree, description)
    rng = np.random.default_rng(seed)
    for reduce_planar in (True, False):
        constraints = Constraints(tree, description.closures, (), reduce_planar=reduce_planar)
        np.testing.assert_allclose(constraints.residual(reference), 0.0, rtol=0, atol=1e-12)
        away = pin.integrate(tree.model, reference, rng.normal(size=tree.model.nv))
        for q_free in (reference, away):
            assert_derivatives(constraints, q_free, rng.normal(size=tree.model.nv))


@every_kind
def test_loops_do_not_feel_what_carries_them(kind):
    """The columns of joints above the common ancestor are zero, and φ does not change when they move."""
    description = grown(kind, False, 7)
    tree = build_tree(description, True)
    constraints = Constraints(tree, description.closures, ())
    q_free = pin.randomConfiguration(tree.model, -np.ones(tree.model.nq), np.ones(tree.model.nq))
    carried = np.zeros(tree.model.nv)
    carried[:8] = np.random.default_rng(1).normal(size=8)
    moved = pin.integrate(tree.model, q_free, carried)
    assert_close(constraints.residual(moved), constraints.residual(q_free), 1e-13)
    assert not constraints.value(q_free).jacobian[:, :8].any()


@same_on_both
@pytest.mark.parametrize("planar", [False, True])
@every_kind
def test_planar_reduction_drops_only_constant_rows(kind, planar):
    """The reduced rows have the rank of the complete ones wherever one looks, closed or not."""
    for seed in range(3):
        description = grown(kind, planar, 10 + seed)
        tree = build_tree(description)
        complete = Constraints(tree, description.closures, (), reduce_planar=False)
        reduced = Constraints(tree, description.closures, ())
        rng = np.random.default_rng(seed)
        reference = stated_pose(tree, description)
        for spread in (0.0, 0.3, 1.0):
            q_free = pin.integrate(tree.model, reference, spread * rng.normal(size=tree.model.nv))
            ranks = [
                np.linalg.matrix_rank(c.value(q_free).jacobian, tol=1e-9) if c.size else 0 for c in (complete, reduced)
            ]
            assert ranks[0] == ranks[1]
        assert complete.size == ROWS[kind]
        assert reduced.size <= complete.size if planar else reduced.size == complete.size


def test_the_five_bar_keeps_two_rows(rpdr):
    """Of the five rows of a revolute closure in a planar loop, the two of (31) remain."""
    assert rpdr.constraints().size == 2
    assert rpdr.constraints().row_slices() == {"end_effector": slice(0, 2)}


def chain(*kinds):
    """A serial chain of joints of the given kinds, about or along z."""
    z, body = np.array([0.0, 0.0, 1.0]), Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.1 * np.eye(3))
    joints = tuple(Joint(f"j{k}", kind, f"l{k}", f"l{k + 1}", axis=z) for k, kind in enumerate(kinds))
    links = tuple(Link(f"l{k}", body) for k in range(len(kinds) + 1))
    return ccpin.MechanismDescription("gears", "l0", links, joints)


def circle(*angles):
    return np.array([f(angle) for angle in angles for f in (np.cos, np.sin)])


def test_polynomial_coupling():
    """Σ of polynomials about their references, with exact derivatives."""
    terms = (
        CouplingTerm("j0", (0.3, -1.0, 0.5, 0.2), 0.1),
        CouplingTerm("j1", (0.0, 2.0, 0.0, -0.4), -0.2),
    )
    constraints = Constraints(build_tree(chain("revolute", "prismatic")), (), (Coupling("cam", terms),))
    rng = np.random.default_rng(3)
    for q in rng.normal(size=(20, 2)):
        x, y = q[0] - 0.1, q[1] + 0.2
        expected = 0.3 - x + 0.5 * x**2 + 0.2 * x**3 + 2.0 * y - 0.4 * y**3
        assert constraints.residual(q)[0] == pytest.approx(expected, rel=1e-13, abs=1e-13)
        assert_derivatives(constraints, q, rng.normal(size=2))


@same_on_both
@pytest.mark.parametrize(
    ("ratio", "teeth"),
    [(-2.0, 1), (1.0 / 3.0, 3), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((1.0, 1), (1.5, 2)))],
)
def test_coupling_of_continuous_joints_counts_no_turns(ratio, teeth):
    """With θ1 = ratio θ0 the row vanishes however often either has turned, smoothly through ±π."""
    terms = (CouplingTerm("j0", (0.0, ratio)), CouplingTerm("j1", (0.0, -1.0)))
    constraints = Constraints(build_tree(chain("continuous", "continuous")), (), (Coupling("gear", terms),))
    for angle in np.linspace(-20.0, 20.0, 97):
        q_free = circle(angle, ratio * angle)
        assert constraints.residual(q_free)[0] == pytest.approx(0.0, abs=1e-13)
        assert_derivatives(constraints, q_free, np.array([0.7, -0.3]))
        open_by = constraints.residual(circle(angle, ratio * angle - 0.2))[0]
        assert open_by == pytest.approx(0.2, abs=1e-12)
    half_tooth = constraints.residual(circle(0.0, np.pi / teeth))[0]
    assert abs(half_tooth) == pytest.approx(np.pi / teeth, abs=1e-12)


def test_gear_train_turns_without_end():
    """σ follows a gear of continuous joints over many turns of the wheel."""
    terms = (CouplingTerm("j0", (0.0, -2.0)), CouplingTerm("j1", (0.0, 1.0)))
    description = replace(chain("continuous", "continuous"), couplings=(Coupling("gear", terms),))
    model = ccpin.ReducedModel(ccpin.load(description, independent=["j0"]))
    here = model.mechanism.q_reference
    for angle in np.arange(0.0, 15.0, 0.4):
        here = model.sigma(circle(angle), here)
        np.testing.assert_allclose(here, circle(angle, 2.0 * angle), rtol=0, atol=1e-11)
    np.testing.assert_allclose(model.rho(here), [[1.0], [2.0]], rtol=0, atol=1e-13)


@pytest.mark.parametrize("coefficients", [(0.0, np.pi), (0.0, 1.0, 0.5)])
def test_couplings_that_would_count_turns_are_refused(coefficients):
    """An irrational ratio or a power of a continuous joint's angle raises, naming coupling and joint."""
    terms = (CouplingTerm("j0", coefficients), CouplingTerm("j1", (0.0, -1.0)))
    with pytest.raises(UnsupportedMechanismError, match=r"'gear'.*'j0' is continuous"):
        Constraints(build_tree(chain("continuous", "revolute")), (), (Coupling("gear", terms),))


def test_constant_term_of_a_continuous_joint():
    """A term that holds only a constant shifts the row, also where its joint is continuous."""
    terms = (CouplingTerm("j0", (0.25,)), CouplingTerm("j1", (0.0, 1.0)))
    constraints = Constraints(build_tree(chain("continuous", "revolute")), (), (Coupling("stop", terms),))
    assert constraints.residual(np.array([1.0, 0.0, 0.5]))[0] == pytest.approx(0.75)


def test_mimic_joint(tmp_path):
    """A URDF mimic joint follows θ = multiplier·θ_master + offset, and a mimic of a mimic follows both."""
    link = (
        '<link name="{0}"><inertial><mass value="1"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/>{3}</joint>'
    )
    body = "".join(link.format(name) for name in "abcd") + joint.format("one", "a", "b", "")
    body += joint.format("two", "b", "c", '<mimic joint="one" multiplier="-2" offset="0.25"/>')
    body += joint.format("three", "c", "d", '<mimic joint="two"/>')
    path = tmp_path / "finger.urdf"
    path.write_text(f'<robot name="finger">{body}</robot>')
    mechanism = ccpin.load(path)
    assert mechanism.independent == ("one",)
    model = ccpin.ReducedModel(mechanism)
    np.testing.assert_allclose(model.sigma([0.4]), [0.4, -0.55, -0.55], rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.rho(model.sigma([0.4])), [[1.0], [-2.0], [-2.0]], rtol=0, atol=1e-13)
