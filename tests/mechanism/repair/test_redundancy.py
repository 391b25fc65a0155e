"""Geometry as CAD writes it: tilted and rounded mechanisms move as the exact ones, or are refused with the misfit."""

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings

import ccpin
from ccpin.description import read_description
from ccpin.description.urdf.writer import write_urdf
from ccpin.errors import InvalidInputError, LoopNotClosedError
from ccpin.kinematics.clusters import cut
from ccpin.kinematics.points import moved
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.repair import open_poses
from ccpin.mechanism.repair.geometry import NO_RELATIONS, Geometry, shape_of
from ccpin.mechanism.repair.relations import parallel_axes
from tests.support import families
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.places import MODELS, SHARED
from tests.support.rounded import poses_along, rounded
from tests.support.strategies import mechanisms

NECK = SHARED / "neck.xml"
REDUNDANT = ("bennett", "sarrus", "parallel_bars", "welded_four_bar", "spherical_four_bar", "revolute_delta")
PLANAR = ("four_bar", "slider_crank", "rpdr", "planar_3rrr")
FULL = ("delta", "hexa", "stewart")


@cache
def exact(name):
    return ccpin.load(getattr(families, name)() if hasattr(families, name) else name)


def repairs(mechanism):
    return [note for note in mechanism.notes if note.startswith("geometry repaired")]


@pytest.mark.parametrize("decimals", [5, *later(8, 6, 11)])
@pytest.mark.parametrize("name", [*REDUNDANT, *PLANAR, *FULL])
@pytest.mark.parametrize("poses", later(2, 6))
def test_a_rounded_mechanism_moves_as_the_exact_one(name, decimals, poses):
    """The same mobility; at poses all along the motion the same σ, D and q̈ within the rounding, and closed loops."""
    meant = exact(name)
    mechanism = ccpin.load(rounded(meant.description, decimals), independent=meant.independent)
    assert mechanism.n == meant.n
    assert bool(repairs(mechanism)) == (name not in FULL)
    model, other = ccpin.ReducedModel(meant), ccpin.ReducedModel(mechanism)
    generator, v = np.random.default_rng(5), np.ones(meant.n)
    for pose in poses_along(meant, poses):
        here = model.at(model.coordinates.alpha(pose), near=pose)
        there = other.at(here.q, near=pose)
        assert np.abs(mechanism.constraints().residual(there.q_free)).max() <= 1e-12
        # an error of the geometry divided by ψ_q′ moves q′; its derivatives come in by the next power
        allowed = 30.0 * 10.0**-decimals / meant.parametrization().rcond(here.q_free)
        np.testing.assert_allclose(there.q_free, here.q_free, rtol=0, atol=allowed)
        inertia, u = here.terms(v).D, generator.standard_normal(other.n_actuated)
        a = here.forward_dynamics(v, u)
        np.testing.assert_allclose(there.terms(v).D, inertia, rtol=0, atol=10.0 * allowed * np.abs(inertia).max())
        np.testing.assert_allclose(there.forward_dynamics(v, u), a, rtol=0, atol=10 * allowed * (1 + np.abs(a).max()))


@same_on_both
@pytest.mark.parametrize("seed", later(*range(6)))
@pytest.mark.parametrize("name", ["sarrus", "parallel_bars", "revolute_delta"])
def test_whatever_the_tilt(name, seed):
    """Mobility and the order of q do not hang on how the numbers happened to be rounded."""
    mechanism = ccpin.load(rounded(exact(name).description, 5, seed))
    assert (mechanism.n, mechanism.independent) == (exact(name).n, exact(name).independent)


def test_a_file_rounded_as_text(tmp_path):
    """A tilted four-bar written as URDF with six decimals everywhere loads, planar, and σ turns the crank around."""
    path = tmp_path / "four_bar.urdf"
    write_urdf(rounded(families.serial(1), 15), path)
    text = re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda number: f"{float(number[0]):.6f}", path.read_text())
    path.write_text(text)
    mechanism = ccpin.load(path)
    assert (mechanism.n, mechanism.mobility.rows) == (1, 2)
    assert len(repairs(mechanism)) == 1
    model, near = ccpin.ReducedModel(mechanism), mechanism.q_reference
    for crank in np.arange(families.START, families.START + 2 * np.pi, 0.3):
        near = model.at([crank], near=near).q_free
        coupler, rocker = families.four_bar_angles(crank)
        gap = (near - [crank, coupler, rocker] + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(gap).max() < 2e-5


@same_on_both
def test_beyond_the_tolerance_it_is_refused_by_name():
    """Three decimals are too few for a Delta: the loop, its misfit and the change it would take are told; four do."""
    description = rounded(exact("revolute_delta").description, 3)
    with pytest.raises(
        LoopNotClosedError, match=r"loop 'bars\d' stays open by \d.\d*e-05 m.*change of \d.\de-04 m"
    ) as caught:
        ccpin.load(description)
    assert set(caught.value.errors) == {closure.name for closure in description.closures}
    assert ccpin.load(rounded(exact("revolute_delta").description, 4)).n == 3


@pytest.mark.skipif(not NECK.is_file(), reason="the folder of others' models is not here")
def test_parallel_bars_whose_pivots_lie_in_a_line():
    """Two rods beside a third, as a neck has them: what they ask for is of second order, and closes all the same."""
    mechanism = ccpin.load(NECK)
    assert mechanism.n == 1
    (note,) = [note for note in mechanism.notes if "geometry repaired" in note]
    assert "5 of the 12 rows" in note
    model = ccpin.ReducedModel(mechanism)
    for step in (-0.2, 0.1, 0.3):
        closed = model.sigma(model.alpha(mechanism.q_reference) + step)
        assert np.abs(mechanism.constraints().residual(closed)).max() < 1e-12


@pytest.mark.slow
@same_on_both
def test_too_open_to_be_rounded():
    """Bennett's linkage with four decimals stays open by more than the tolerance: told, with the way out."""
    description = rounded(exact("bennett").description, 4)
    with pytest.raises(LoopNotClosedError, match=r"loop 'joint4' open by 4.*e-05.*larger geometry_tolerance"):
        ccpin.load(description)
    assert ccpin.load(description, geometry_tolerance=1e-4).n == 1


def test_an_open_loop_is_not_repaired():
    """A planar loop that misses itself by a millimetre across its plane cannot close."""
    description = families.serial(1)
    (closure,) = description.closures
    shifted = np.array(closure.placement_a)
    shifted[2, 3] += 1e-3
    with pytest.raises(LoopNotClosedError, match=r"'loop0' can never close.*0.001 .*apart across it"):
        ccpin.load(replace(description, closures=(replace(closure, placement_a=shifted),)))


@same_on_both
def test_no_tolerance_takes_numbers_as_exact():
    """With geometry_tolerance=0 nothing is changed: the rounded linkage does not close along its motion."""
    description = rounded(exact("bennett").description, 6)
    with pytest.raises(LoopNotClosedError, match="no closed configuration"):
        ccpin.load(description, geometry_tolerance=0)


@pytest.mark.parametrize("tolerance", [-1e-5, 0.1, float("nan"), "1e-5"])
def test_a_tolerance_is_a_small_number(tolerance):
    """Anything but a number from 0 to 0.01 is refused."""
    with pytest.raises(InvalidInputError, match="geometry_tolerance"):
        ccpin.load("rpdr", geometry_tolerance=tolerance)


@same_on_both
@settings(max_examples=25)
@given(mechanisms())
def test_exact_geometry_is_left_alone(drawn):
    """Mechanisms that close by construction keep every number they state."""
    mechanism = ccpin.load(drawn.description, free=["all"])
    for field in ("joints", "closures"):
        for kept, stated in zip(getattr(mechanism.description, field), getattr(drawn.description, field), strict=True):
            assert kept is stated or repr(kept) == repr(stated)


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.urdf")), ids=lambda path: path.stem)
def test_our_own_models_are_exact(path):
    """No model that comes with ccpin needs a repair."""
    assert repairs(ccpin.load(path)) == []


@same_on_both
@settings(max_examples=30)
@given(mechanisms(kinds=("revolute", "spherical", "distance", "fixed", "universal", "prismatic")))
def test_derivatives_by_the_geometry(drawn):
    """∂φ/∂p is the finite difference of φ over the changed frames."""
    tree, rng = build_tree(drawn.description), np.random.default_rng(0)
    reference = ccpin.load(drawn.description, free=["all"]).q_reference
    for part in cut(tree, drawn.description.closures, ()):
        if not part.closures:
            continue
        shape = shape_of(part)
        geometry = Geometry(shape, shape.constraints.extent, NO_RELATIONS)
        q_free = moved(part.tree.model, reference[part.q], rng.standard_normal(part.tree.model.nv))
        jacobian = geometry.jacobian(shape, shape.constraints.value(q_free))
        direction, h = rng.standard_normal(geometry.count), 1e-6
        ahead, behind = (geometry.shape(step * direction).constraints.residual(q_free) for step in (h, -h))
        np.testing.assert_allclose(jacobian @ direction, (ahead - behind) / (2 * h), rtol=0, atol=2e-7)


def test_parallel_axes_are_made_so_and_no_others():
    """Axes 1e-6 rad apart become parallel by that much; those at a right angle and 1e-3 rad apart stay."""
    crank, coupler, rocker = families.serial(1).joints
    off = np.array([1e-6, 0.0, 1.0])
    description = replace(families.serial(1), joints=(crank, replace(coupler, axis=off / np.linalg.norm(off)), rocker))
    (part,) = cut(build_tree(description), description.closures, ())
    relations = parallel_axes(shape_of(part), 1e-4)
    assert relations.joints == {"crank_joint0", "coupler_joint0", "rocker_joint0"}
    assert relations.ends == {("loop0", 0), ("loop0", 1)}
    turned = relations.change.joints["coupler_joint0"][:3, :3] @ description.joints[1].axis
    np.testing.assert_allclose(turned, [0.0, 0.0, 1.0], rtol=0, atol=1e-15)
    assert relations.change.largest(1.0)[1] == pytest.approx(1e-6, rel=1e-3)
    assert "coupler_joint0" not in parallel_axes(shape_of(part), 1e-7).joints


def test_repaired_geometry_is_what_the_mechanism_says(tmp_path):
    """What is written out again is the repaired geometry: it loads without another repair."""
    mechanism = ccpin.load(rounded(families.welded_four_bar(), 6))
    path = tmp_path / "again.urdf"
    write_urdf(mechanism.description, path)
    assert repairs(ccpin.load(read_description(path))) == []


def test_rows_that_are_no_numbers_are_told(monkeypatch):
    """The decomposition of rows that are infinite ended in NumPy's own error."""

    def failing(*_, **__):
        raise np.linalg.LinAlgError

    poses = open_poses.OpenPoses(ccpin.load("rpdr").constraints(), 1e-5)
    monkeypatch.setattr(open_poses.np.linalg, "svd", failing)
    with pytest.raises(LoopNotClosedError, match="no numbers"):
        poses.near(SimpleNamespace(constraints=ccpin.load("rpdr").constraints()), np.zeros(4))
