"""Forms of joints and couplings, number by number, also about configurations that are not closed."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ccpin
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.domain.theorem2 import form as module
from ccpin.domain.theorem2.form import quadratic_form
from ccpin.domain.theorem2.polynomials import Polynomial
from ccpin.domain.theorem2.trees import Kinematics, _parts, find_runs, simple_tree
from ccpin.domain.theorem2.unknowns import Ball, Unknowns, without_noise
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.tree import TreeJoint
from tests.support.geared import geared

X, Y, Z = np.eye(3)


def joint(number, kind, axis=Z, parent=None, at=0, placement=None):
    """A joint of a tree, on the one before it."""
    start = number if at == 0 else at
    kind, parent = JOINT_KINDS[kind], number - 1 if parent is None else parent
    placement = np.eye(4) if placement is None else placement
    window = slice(start, start + kind.nq)
    return TreeJoint(number, f"j{number}", kind, parent, window, window, placement, np.array(axis), None)


def placed(angle, axis=X, shift=(0.0, 0.0, 0.0)):
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = Rotation.from_rotvec(angle * axis).as_matrix(), shift
    return placement


# Couplings


@pytest.mark.parametrize(
    ("ratios", "kinds", "scale"),
    [((-2.0, 3.0), ("revolute", "continuous"), 1), ((0.5, -0.75), ("continuous", "revolute"), 4)],
)
def test_gears_about_configurations_that_are_open(ratios, kinds, scale):
    """sin(D φ) in whichever turn the coupling is; also with a constant term, and higher ones that are 0."""
    terms = [((0.1, ratio, 0.0), 0.3 * k) for k, ratio in enumerate(ratios)]
    mechanism = geared(terms, kinds, (0.0, 0.0))
    for open_by in (0.4, 2.0, 3.5, -5.0):
        centre = _opened(mechanism, open_by)
        form, residual = quadratic_form(mechanism, centre, "angles"), mechanism.constraints().residual
        for at in (centre, _opened(mechanism, open_by + 0.5)):
            value = form.system.value(form.lift(at))[form.closures]
            np.testing.assert_allclose(value, np.sin(scale * residual(at)), rtol=0, atol=1e-12)


def _opened(mechanism, angle):
    """The reference with the first joint turned."""
    q_free, first = mechanism.q_reference.copy(), mechanism.tree.joints[0]
    q_free[first.q] = (np.cos(angle), np.sin(angle)) if first.kind.unit else angle
    return q_free


def test_racks_about_configurations_that_are_open():
    mechanism = geared([((0.1, 2.0), 0.1), ((0.0, -0.7), 0.0)], ("prismatic", "prismatic"), (0.2, 0.1))
    centre = mechanism.q_reference + [0.5, 0.0]
    form = quadratic_form(mechanism, centre, "angles")
    for at in (centre, centre + [0.25, -0.5]):
        value = form.system.value(form.lift(at))[form.closures]
        np.testing.assert_allclose(value, mechanism.constraints().residual(at), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("ratios", "whole"),
    [
        ((1.0, 9.0), True), ((1.0, -16.0), True), ((1.0, 17.0), False), ((0.5, 8.0), True), ((0.5, 9.0), False),
        ((1.0, 0.5 * (1 + 0.97e-12)), True), ((1.0, 0.5 * (1 + 1.05e-12)), False), ((0.5 + 1e-9, 1.0), False),
        ((1.0, -0.5 * (1 - 1.05e-12)), False),
    ],
)  # fmt: skip
def test_ratios_are_whole_up_to_sixteen(ratios, whole):
    """As told: within 1e-12 of itself each."""
    mechanism = geared([((0.0, ratio),) for ratio in ratios], ("revolute", "revolute"), (0.0, 0.0))
    if whole:
        assert quadratic_form(mechanism, mechanism.q_reference, "angles").system.free == 1
    else:
        with pytest.raises(UnsupportedMechanismError, match="whole numbers"):
            quadratic_form(mechanism, mechanism.q_reference, "angles")


# Coefficients


def test_what_coefficients_may_be_off_by(monkeypatch):
    """1e-12, and sixteen times what placements are no rotations by."""
    mechanism = ccpin.load("slider_crank")
    for defect in (0.0, 2.0**-10):
        monkeypatch.setattr(module, "_rigidity_defect", lambda joints, loops, defect=defect: defect)
        error = quadratic_form(mechanism, mechanism.q_reference, "angles").error
        np.testing.assert_allclose(error, 1e-12 + 16 * defect, rtol=1e-3)


@pytest.mark.parametrize("where", ["placement", "axis", "frame_a", "frame_b"])
def test_what_placements_are_no_rotations_by(where):
    """The largest entry of RᵀR − I, and of 1 − |axis|, wherever it is."""
    off, flat = np.eye(4), np.eye(4)
    off[1, 1], off[0, 0] = 1.5, 1.25
    exact = joint(1, "revolute")
    one = SimpleNamespace(placement=off if where == "placement" else flat, axis=(0.75 if where == "axis" else 1.0) * Z)
    loop = SimpleNamespace(frame_a=flat, frame_b=flat, **{})
    if where.startswith("frame"):
        setattr(loop, where, off)
    found = module._rigidity_defect({1: exact, 2: one, 3: exact}, [loop])
    assert found == (0.25 if where == "axis" else 1.25)
    assert module._rigidity_defect({1: exact}, []) == 0.0


def test_coefficients_that_are_noise():
    """Below 1e-14 of the largest in what is named, and below 1e-15 of the largest, or of one, in placements."""
    unknowns = Unknowns()
    for share, kept in ((0.97, False), (1.03, True)):
        named = unknowns.affine(Polynomial({(0,): -4.0, (): 4e-14 * share}))
        assert (() in named.terms) == kept
        for size in (1.0, 0.25, 4.0):
            entry = 1e-15 * share * max(size, 1.0)
            found = without_noise(np.array([size, -entry, entry]))
            assert found.tolist() == [size, -entry * kept, entry * kept]


def test_quaternions_have_their_last_number_above_zero():
    """The rotation from the centre to a configuration, whichever of the two quaternions states it."""
    rng = np.random.default_rng(0)
    for a, b in rng.normal(size=(20, 2, 4)):
        a /= np.linalg.norm(a)
        found = np.array(Ball(1, tuple(a), "ball").values(np.array([9.0, *b])))
        expected = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).as_quat(canonical=True)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


# Joints


def test_joints_of_several_steps_in_parts():
    """Each with its numbers in q′, its kind and its axis; a joint of one step, and a ball, are their own."""
    flat = [("prismatic", slice(5, 6), X), ("prismatic", slice(6, 7), Y)]
    expected = {
        "planar": [*flat, ("continuous", slice(7, 9), Z)],
        "floating": [*flat, ("prismatic", slice(7, 8), Z), ("spherical", slice(8, 12), Z)],
        "spherical": [("spherical", slice(5, 9), Z)],
        "revolute": [("revolute", slice(5, 6), Z)],
        "continuous": [("continuous", slice(5, 7), Z)],
    }
    for kind, parts in expected.items():
        found = [(part.kind.name, part.q, part.axis.tolist()) for part in _parts(joint(1, kind, at=5))]
        assert found == [(name, window, axis.tolist()) for name, window, axis in parts]


def test_parts_stand_one_behind_the_other():
    """The first where the joint is, the others in it; the next joint on the last."""
    first = joint(1, "planar", placement=placed(0.5, shift=(1.0, 2.0, 3.0)))
    tree = SimpleNamespace(joints=(first, joint(2, "revolute"), joint(3, "spherical", parent=1)))
    simple = simple_tree(tree)
    assert simple.parts == {0: (0,), 1: (1, 2, 3), 2: (4,), 3: (5,)}
    assert {number: (one.number, one.parent) for number, one in simple.joints.items()} == {
        1: (1, 0), 2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3)
    }  # fmt: skip
    np.testing.assert_array_equal(simple.joints[1].placement, first.placement)
    for number in (2, 3):
        np.testing.assert_array_equal(simple.joints[number].placement, np.eye(4))
    assert simple.path([1, 3]) == [1, 2, 3, 5]


def parents(joints, on_loops=(1, 2, 3), ancestors=(0,), merge=True):
    """What each joint's angle is summed onto, and with which sign."""
    runs = find_runs({one.number: one for one in joints}, set(on_loops), set(ancestors), merge)
    return {number: (run.parent, run.sign) for number, run in runs.items()}


def test_angles_are_summed_along_parallel_axes():
    """Through slides, whatever the sign; not past another axis, a ball, or where a loop begins, nor off the loops."""
    one, two, three = joint(1, "revolute"), joint(2, "revolute", -Z), joint(3, "continuous")
    assert parents([one, two, three]) == {1: (None, 1.0), 2: (1, -1.0), 3: (2, 1.0)}
    assert parents([one, two, three], merge=False) == {1: (None, 1.0), 2: (None, 1.0), 3: (None, 1.0)}
    assert parents([one, two, three], ancestors=(0, 2)) == {1: (None, 1.0), 2: (1, -1.0), 3: (None, 1.0)}
    assert parents([one, two, three], on_loops=(1, 2)) == {1: (None, 1.0), 2: (1, -1.0), 3: (None, 1.0)}
    slide = joint(2, "prismatic", Z, placement=placed(0.5))
    turned = joint(3, "revolute", Rotation.from_rotvec(-0.5 * X).apply(Z))
    assert parents([one, slide, turned]) == {1: (None, 1.0), 3: (1, 1.0)}
    assert parents([one, joint(2, "spherical"), three]) == {1: (None, 1.0), 3: (None, 1.0)}
    assert parents([joint(1, "spherical"), two]) == {2: (None, 1.0)}


@pytest.mark.parametrize(
    ("angle", "parallel"), [(0.95e-13, True), (1.05e-13, False), (-1.05e-13, False), (1.9e-13, False)]
)
def test_axes_are_parallel_to_1e_13(angle, parallel):
    tilted = joint(2, "revolute", [0.0, angle, 1.0])
    assert parents([joint(1, "revolute"), tilted])[2][0] == (1 if parallel else None)


@pytest.mark.parametrize("merge", [True, False])
def test_a_joints_own_turn(merge):
    """Cosine and sine of its angle from the centre, also where angles are summed."""
    rng = np.random.default_rng(1)
    joints = {1: joint(1, "revolute"), 2: joint(2, "revolute", -Z), 3: joint(3, "revolute")}
    runs = find_runs(joints, {1, 2, 3}, {0}, merge)
    centre, q_free = rng.normal(size=(2, 4))
    kinematics = Kinematics(joints, runs, [1, 2, 3], centre)
    z = kinematics.unknowns.lift(q_free)
    for number in joints:
        cosine, sine = (p.at(z) for p in kinematics.turn(number))
        change = q_free[number] - centre[number]
        np.testing.assert_allclose([cosine, sine], [np.cos(change), np.sin(change)], rtol=0, atol=1e-14)


def last_rows(independent):
    """The last equations of a slide, a joint of two slides and a turn, a ball and a turn off the loops."""
    kinds = ["prismatic", "prismatic", "prismatic", "continuous", "spherical", "revolute"]
    joints = {number: joint(number, kind) for number, kind in enumerate(kinds, start=1)}
    variables = {number: tuple(Polynomial.unknown(10 * number + k) for k in range(4)) for number in range(1, 6)}
    kinematics = SimpleNamespace(
        joints=joints, variables=variables, turn=lambda j: (None, Polynomial.unknown(10 * j + 1))
    )
    numbers = {"s": 1, "p:tx": 2, "p:ty": 3, "p:rz": 4, "b": 5, "r": 6}
    parts = {"s": (1,), "p": (2, 3, 4), "b": (5,), "r": (6,)}
    rows, told = module._last_rows(kinematics, independent, parts, numbers)
    return [dict(row.terms) for row in rows], told


def test_the_last_equations():
    """A function of each independent coordinate: slides as they are, sines, and twice the quaternion's vector."""
    rows, kinds = last_rows(("s", "b", "p:ty", "p:rz", "r"))
    assert rows == [{(10,): 1.0}, *({(50 + k,): 2.0} for k in range(3)), {(30,): 1.0}, {(41,): 1.0}]
    assert kinds == ("displacement", "rotation", "rotation", "rotation", "displacement", "angle")
    rows, kinds = last_rows(("p",))
    assert rows == [{(20,): 1.0}, {(30,): 1.0}, {(41,): 1.0}]
    assert kinds == ("displacement", "displacement", "angle")
    with pytest.raises(UnsupportedMechanismError, match="'b:rx' is one component"):
        last_rows(("b:rx",))
