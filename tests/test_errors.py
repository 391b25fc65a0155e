"""Each mistake has its own error class and a sentence that names the culprit."""

import inspect
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin import errors
from ccpin.errors import (
    AmbiguousFormatError,
    DescriptionError,
    DescriptionNotFoundError,
    IndependentSetError,
    InvalidInputError,
    InvalidXmlError,
    LoopNotClosedError,
    NoLoopError,
    SingularConfigurationError,
    UnreachableError,
)
from tests.oracles import rpdr as oracle

CLOSED = [-np.pi / 2, -np.pi / 2]


def test_one_root():
    """Every error of the package descends from CcpinError, warnings do not; all are named in ``__all__``."""
    classes = [c for _, c in inspect.getmembers(errors, inspect.isclass) if c.__module__ == "ccpin.errors"]
    assert all(issubclass(c, ccpin.CcpinError) != issubclass(c, Warning) for c in classes)
    assert {c.__name__ for c in classes} == set(errors.__all__)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("<robot name='x'><link", InvalidXmlError, "not well-formed"),
        ("<?xml version='1.0'?>", InvalidXmlError, "XML|empty"),
        ("once upon a time", AmbiguousFormatError, "neither XML"),
        ("", AmbiguousFormatError, "neither XML"),
        ("<sdf version='1.7'/>", DescriptionError, "not exactly one model"),
        ("<robot name='x'/>", DescriptionError, "no link"),
        ("<robot name='x'><link name='a'/></robot>", NoLoopError, "no loop closure and no coupling"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><robot name='x'>&b;</robot>", InvalidXmlError, "DOCTYPE"),
    ],
)
def test_files(tmp_path, text, error, message):
    """What is not a usable mechanism file raises, naming the file."""
    path = tmp_path / "wrong.urdf"
    path.write_text(text)
    with pytest.raises(error, match=message) as caught:
        ccpin.load(path)
    assert caught.type is error
    assert "wrong.urdf" in str(caught.value)


@pytest.mark.parametrize("path", ["nowhere.urdf", "", "a\0b", "x" * 5000])
def test_missing_file(path):
    """A path to nothing raises, and says what models there are."""
    with pytest.raises(DescriptionNotFoundError):
        ccpin.load(path)


def test_missing_file_lists_the_models():
    """The message lists the installed models."""
    with pytest.raises(DescriptionNotFoundError, match=r"rpbr.*no installed model.*rpdr"):
        ccpin.load("rpbr")


def test_unknown_link_in_a_loop(rpdr, tmp_path):
    """In a file and in Python, the loop and the link are named."""
    text = Path(rpdr.description.source).read_text(encoding="utf-8")
    path = tmp_path / "typo.urdf"
    path.write_text(text.replace('<successor link="link4">', '<successor link="link5">'))
    with pytest.raises(DescriptionError, match=r"typo.urdf: loop 'end_effector': link 'link5' does not exist"):
        ccpin.load(path)
    extra = ccpin.LoopClosure("weld", "fixed", "link3", "hand")
    with pytest.raises(DescriptionError, match="loop 'weld': link 'hand' does not exist"):
        ccpin.load("rpdr", closures=[extra])


def test_no_loop(rpdr):
    """A tree is refused; one whose joints are marked dependent is told that loops are missing."""
    tree = replace(rpdr.description, closures=())
    with pytest.raises(NoLoopError, match="marked dependent"):
        ccpin.load(tree)
    with pytest.raises(NoLoopError, match="nothing to reduce"):
        ccpin.load(replace(tree, independent=None))


@pytest.mark.parametrize(
    ("independent", "message"),
    [
        (["joint1"], r"1 independent velocities are named \(joint1\) but the mobility is 2: add joint"),
        ([], r"0 independent velocities are named \(none\) but the mobility is 2"),
        (["joint1", "joint2", "joint3"], r"3 independent .* but the mobility is 2: joint\d, joint\d would do"),
        (["joint1", "elbow"], "'elbow' is not a movable joint"),
        (["joint1", "joint1"], "'joint1' is named twice"),
    ],
)
def test_independent_set(independent, message):
    """A set of the wrong size or with unknown names says what would do."""
    with pytest.raises(IndependentSetError, match=message):
        ccpin.load("rpdr", independent=independent)


def test_actuated_set():
    """Unknown actuated joints are named."""
    with pytest.raises(IndependentSetError, match="'motor9'"):
        ccpin.load("rpdr", actuated=["motor9"])


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([1.0], r"q has shape \(1,\); it must be \(2,\)"),
        ([[1.0, 2.0]], r"q has shape \(1, 2\)"),
        (1.0, r"q has shape \(\)"),
        ([np.nan, 0.0], "q has entries that are not finite"),
        ([np.inf, 0.0], "q has entries that are not finite"),
        (["a", "b"], "q is not an array of numbers"),
        ([[1.0], [1.0, 2.0]], "q is not an array of numbers"),
        (None, "q "),
    ],
)
def test_wrong_q(rpdr_model, q, message):
    """Wrong shapes and entries of q raise InvalidInputError in every method that takes one."""
    zero = [0.0, 0.0]
    for call in (
        lambda: rpdr_model.sigma(q),
        lambda: rpdr_model.terms(q, zero),
        lambda: rpdr_model.terms(q, zero, rpdr_model.mechanism.q_reference),
        lambda: rpdr_model.forward_dynamics(q, zero, zero),
        lambda: rpdr_model.inverse_dynamics(q, zero, zero),
        lambda: rpdr_model.constraint_forces(q, zero, zero),
        lambda: rpdr_model.energy(q, zero),
    ):
        with pytest.raises(InvalidInputError, match=message):
            call()


@pytest.mark.parametrize("wrong", [[1.0], [np.nan, 0.0], [1.0, 2.0, 3.0], "speed"])
def test_other_arguments(rpdr_model, wrong):
    """v, u, a, `near`, q′, q̇′ and batches are checked too, by name."""
    zero = [0.0, 0.0]
    for name, call in (
        ("v", lambda: rpdr_model.terms(CLOSED, wrong)),
        ("v", lambda: rpdr_model.forward_dynamics(CLOSED, wrong, zero)),
        ("u", lambda: rpdr_model.forward_dynamics(CLOSED, zero, wrong)),
        ("a", lambda: rpdr_model.inverse_dynamics(CLOSED, zero, wrong)),
        ("near", lambda: rpdr_model.sigma(CLOSED, wrong)),
        ("q_free", lambda: rpdr_model.rho(wrong)),
        ("v_free", lambda: rpdr_model.rho_dot(rpdr_model.sigma(CLOSED), wrong)),
        ("Q", lambda: rpdr_model.sigma_many(wrong)),
        ("Q", lambda: rpdr_model.sigma_many([[0.0], [0.0, 1.0]])),
    ):
        with pytest.raises(InvalidInputError, match=rf"^{name} "):
            call()
    with pytest.raises(InvalidInputError, match="lengths"):
        rpdr_model.terms_many([CLOSED, CLOSED], [zero])


def test_nothing_where_numbers_belong(rpdr_model):
    """None for v, u or a is refused by name, not taken for zero."""
    zero, state = [0.0, 0.0], rpdr_model.at(CLOSED)
    for name, call in (
        ("v", lambda: state.terms(None)),
        ("u", lambda: state.forward_dynamics(zero, None)),
        ("u", lambda: rpdr_model.forward_dynamics(CLOSED, zero, None)),
        ("a", lambda: rpdr_model.generalized_force_derivatives(CLOSED, zero, None)),
    ):
        with pytest.raises(InvalidInputError, match=rf"^{name} "):
            call()


def test_unreachable_and_singular(rpdr_model):
    """Both show q; neither is a kind of the other."""
    with pytest.raises(UnreachableError, match=r"q = \[-3.141593,\s+0."):
        rpdr_model.sigma([-np.pi, 0.0])
    names = list(rpdr_model.mechanism.pin_model.names)[1:]
    q = oracle.coincident_elbows()
    near = np.empty(4)
    near[[names.index(name) for name in oracle.FREE]] = oracle.sigma(q + [0.02, 0.01], 1)
    with pytest.raises(SingularConfigurationError, match=r"q = \[0.9938\d+, 2.1477\d+\]"):
        rpdr_model.sigma(q, near)


def test_loop_that_cannot_close(rpdr):
    """Arms too far apart: the loop is named, with by how much it stays open."""
    joints = [replace(j, placement=_shifted(3.0)) if j.name == "joint2" else j for j in rpdr.description.joints]
    with pytest.raises(LoopNotClosedError, match="'end_effector'") as caught:
        ccpin.load(replace(rpdr.description, joints=tuple(joints)))
    gap = 3.0 - 2.0 * (oracle.A1 + oracle.A3)
    assert caught.value.errors["end_effector"] == pytest.approx(gap, rel=1e-3)


def test_an_open_loop_says_what_is_open(rpdr):
    """Metres where points are apart, radians where axes are askew."""
    joints = [replace(j, placement=_shifted(3.0)) if j.name == "joint2" else j for j in rpdr.description.joints]
    with pytest.raises(LoopNotClosedError, match=r"'end_effector' open by \d\.\d+ m\. State"):
        ccpin.load(replace(rpdr.description, joints=tuple(joints)))
    constraints = ccpin.load("bennett").constraints()
    assert constraints.misfit(np.array([0.1, -0.3, 0.2, 0.0, 0.04])) == "0.3 m and 0.04 rad"
    assert constraints.misfit(np.array([0.0, 0.0, 0.0, -0.25, 0.04])) == "0.25 rad"


def test_a_library_that_does_not_load_is_named(rpdr, monkeypatch, tmp_path):
    """And is not taken for a fault of the file."""
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    monkeypatch.delitem(sys.modules, "ccpin.description.urdf.writer", raising=False)
    with pytest.raises(ccpin.CcpinError, match=r"what writes urdf files does not load \(.*yourdfpy"):
        rpdr.save(tmp_path / "out.urdf")
    rpdr.save(tmp_path / "out.sdf")  # which needs it not


def test_loop_that_cannot_close_across_its_plane(rpdr):
    """Arms in parallel planes: said as such, with the distance."""
    placement = _shifted(oracle.C).copy()
    placement[1, 3] = 0.01
    joints = [replace(j, placement=placement) if j.name == "joint2" else j for j in rpdr.description.joints]
    with pytest.raises(LoopNotClosedError, match=r"'end_effector' can never close.*0.01 m apart across it"):
        ccpin.load(replace(rpdr.description, joints=tuple(joints)))


def test_loop_that_closes_only_turned_end_for_end(rpdr):
    """A hinge whose two axes point opposite ways along a planar loop's normal: said as such, not as open by 0."""
    closure = rpdr.closures[0]
    turned = closure.placement_b @ np.diag([1.0, -1.0, -1.0, 1.0])
    with pytest.raises(LoopNotClosedError, match="turned end for end"):
        ccpin.load(replace(rpdr.description, closures=(replace(closure, placement_b=turned),)))


def _shifted(x):
    placement = np.eye(4)
    placement[0, 3] = x
    return placement
