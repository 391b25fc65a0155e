"""`load` and `Mechanism`: what is found out about a file, and what a caller may add."""

import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.errors import DescriptionError, InvalidInputError
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.loading.reference_search import stated_pose
from tests.oracles import rpdr as oracle
from tests.support.strategies import Growth


def test_the_case_study(rpdr):
    """Names, sizes and orders of the five-bar."""
    assert rpdr.name == "rpdr"
    assert rpdr.independent == rpdr.actuated == ("joint1", "joint2")
    assert (rpdr.nq, rpdr.n_free, rpdr.n) == (4, 4, 2)
    assert [closure.name for closure in rpdr.closures] == ["end_effector"]
    assert list(rpdr.pin_model.names)[1:] == ["joint1", "joint3", "joint2", "joint4"]
    assert rpdr.notes == ()
    assert np.abs(rpdr.constraints().residual(rpdr.q_reference)).max() <= 1e-10


def test_immutable():
    """A mechanism's fields cannot be set, and its reference cannot be written into."""
    mechanism = ccpin.load("rpdr")
    with pytest.raises(FrozenInstanceError):
        mechanism.actuated = ()
    with pytest.raises(ValueError, match="read-only"):
        mechanism.q_reference[0] = 1.0


def test_picklable(rpdr):
    """A pickled mechanism gives bit for bit the same model."""
    other = ccpin.ReducedModel(pickle.loads(pickle.dumps(rpdr)))
    for a, b in zip(
        other.terms([-2.0, -2.1], [1.0, 2.0]), ccpin.ReducedModel(rpdr).terms([-2.0, -2.1], [1.0, 2.0]), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_loading_twice_is_the_same(rpdr):
    """Nothing about loading is random."""
    other = ccpin.load("rpdr")
    np.testing.assert_array_equal(other.q_reference, rpdr.q_reference)
    assert other.independent == rpdr.independent


def test_closures_given_in_python(rpdr):
    """The loop may come from the caller instead of the file."""
    cut_open = replace(rpdr.description, closures=())
    other = ccpin.load(cut_open, closures=iter(rpdr.closures))
    np.testing.assert_array_equal(other.q_reference, rpdr.q_reference)


def test_every_kind_of_pin_makes_the_same_five_bar(rpdr, rpdr_model):
    """A spherical or cylindrical pin constrains the planar loop as the revolute one does."""
    q, v, u = [-2.0, -2.1], [0.5, -0.7], [0.3, 0.2]
    for kind in ("spherical", "cylindrical"):
        other = ccpin.load(replace(rpdr.description, closures=(replace(rpdr.closures[0], kind=kind),)))
        assert other.mobility.rank == 2
        found = ccpin.ReducedModel(other).forward_dynamics(q, v, u)
        np.testing.assert_allclose(found, rpdr_model.forward_dynamics(q, v, u), rtol=0, atol=1e-11)


def test_a_closure_stated_twice_changes_nothing(rpdr, rpdr_model):
    """Redundant rows leave mobility and motion as they are."""
    again = ccpin.load("rpdr", closures=[replace(rpdr.closures[0], name="again", kind="spherical")])
    assert (again.n, again.mobility.rank, again.mobility.rows) == (2, 2, 4)
    args = ([-2.0, -2.1], [0.5, -0.7], [0.3, 0.2])
    found = ccpin.ReducedModel(again).forward_dynamics(*args)
    np.testing.assert_allclose(found, rpdr_model.forward_dynamics(*args), rtol=0, atol=1e-11)


def test_a_coupling_takes_one_freedom(rpdr):
    """Gearing the arms together leaves one freedom; σ then follows the gear."""
    terms = (CouplingTerm("joint1", (np.pi, 1.0)), CouplingTerm("joint2", (0.0, 1.0)))
    geared = ccpin.load("rpdr", couplings=[Coupling("gear", terms)], independent=["joint1"])
    assert geared.n == 1
    q_free = ccpin.ReducedModel(geared).sigma([-1.8])
    names = list(geared.pin_model.names)[1:]
    q_paper = q_free[[names.index(name) for name in oracle.FREE]]
    assert q_paper[1] == pytest.approx(1.8 - np.pi, abs=1e-12)
    np.testing.assert_allclose(q_paper, oracle.sigma(q_paper[:2], 1), rtol=0, atol=1e-11)


def test_floating_base(rpdr_model):
    """Freed from the ground the five-bar has eight freedoms, and its arms' closure is as before."""
    floating = ccpin.load("rpdr", floating_base=True)
    assert (floating.n, floating.independent) == (8, ("root_joint", "joint1", "joint2"))
    model = ccpin.ReducedModel(floating)
    base = [0.4, -0.3, 0.2, *np.array([0.1, -0.5, 0.3, 0.8]) / np.sqrt(0.99)]
    q_free = model.sigma([*base, -2.0, -2.1])
    np.testing.assert_allclose(q_free[7:], rpdr_model.sigma([-2.0, -2.1]), rtol=0, atol=1e-12)
    rho = model.rho(q_free)
    np.testing.assert_allclose(rho[6:, 6:], rpdr_model.rho(q_free[7:]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(rho[:6], np.eye(6, 8), rtol=0, atol=1e-13)
    np.testing.assert_allclose(rho[6:, :6], 0.0, rtol=0, atol=1e-13)


def test_a_floating_base_is_no_motor_by_default():
    """A file without motors gets them on its joints; what floats freely is named in the notes instead."""
    description = replace(ccpin.load("rpdr").description, actuated=None, independent=None, motors=())
    floating = ccpin.load(description, floating_base=True)
    assert floating.independent[0] == "root_joint"
    assert set(floating.actuated) == set(floating.independent[1:])
    assert any("floats freely (root_joint)" in note for note in floating.notes)
    chosen = ccpin.load(description, floating_base=True, actuated=floating.independent)
    assert chosen.actuated == floating.independent


def test_what_only_floats_has_no_motor():
    """Two bodies hinged to nothing but each other's closure: no motor at all, and dynamics without u."""
    links = [Link(name, Inertia(1.0, np.zeros(3), np.eye(3) / 50)) for name in ("a", "b")]
    joints = (Joint("to_a", "floating", "base", "a"), Joint("to_b", "floating", "base", "b"))
    weld = LoopClosure("weld", "fixed", "a", "b", np.eye(4), np.eye(4))
    two = MechanismDescription("two", "base", (Link("base"), *links), joints, closures=(weld,))
    mechanism = ccpin.load(two)
    assert (mechanism.n, mechanism.actuated) == (6, ())
    model = ccpin.ReducedModel(mechanism)
    a = model.forward_dynamics(model.alpha(mechanism.q_reference), np.zeros(6), [])
    np.testing.assert_allclose(np.abs(a), [0, 0, 9.81, 0, 0, 0], rtol=0, atol=1e-12)


def test_a_structure_without_freedom():
    """A triangle is rigid: either it loads with n = 0 and no motion, or a ccpin error says so."""
    growth = Growth(np.random.default_rng(40), planar=True)
    growth.close("spherical", growth.grow("base", ["revolute"]), growth.grow("base", ["revolute"]))
    description = growth.drawn().description
    try:
        mechanism = ccpin.load(description)
    except ccpin.CcpinError as error:
        assert "mobility" in str(error) or "freedom" in str(error)  # noqa: PT017
        return
    assert mechanism.n == 0
    model = ccpin.ReducedModel(mechanism)
    np.testing.assert_allclose(model.sigma([]), mechanism.q_reference, rtol=0, atol=1e-12)
    assert model.forward_dynamics([], [], []).shape == (0,)


def test_wrong_reference_values(rpdr):
    """A reference value of the wrong size is refused with the size that would be right."""
    wrong = replace(rpdr.description, reference={"joint1": (0.1, 0.2)})
    with pytest.raises(
        DescriptionError, match=r"joint 'joint1': the reference value has 2 numbers; a revolute joint needs 1"
    ):
        stated_pose(build_tree(wrong), wrong)


@pytest.mark.parametrize(
    "arguments",
    [(None,), (3,), ("rpdr", "joint1"), ("rpdr", [1, 2])],
)
def test_arguments_of_the_wrong_type_are_named(arguments):
    """A path that is none, or names that are no sequence of names, raise ours at once."""
    path, *independent = arguments
    with pytest.raises(InvalidInputError):
        ccpin.load(path, independent=independent[0] if independent else None)
