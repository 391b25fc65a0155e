"""The equations that certificates are about, against φ of the model itself, also at configurations that are open."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ccpin
from ccpin.description import CLOSURE_KINDS, Coupling, CouplingTerm, Joint
from ccpin.description.closure_kinds import Fixed, Gap
from ccpin.domain.closures import scalar_coordinates
from ccpin.domain.closures import system as module
from ccpin.domain.closures.packing import pack_reading, same_reading, unpack_reading
from ccpin.domain.closures.rods import rod_length
from ccpin.domain.closures.scalar_coordinates import chart_at, independent_indices
from ccpin.domain.closures.system import reading_of
from ccpin.domain.closures.task_coordinates import task_space
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.equations import closures_of
from tests.oracles.geometry import rot_x, rot_y, rot_z
from tests.support.closed_chains import spatial_chain
from tests.support.geared import geared
from tests.support.rods import rod_ankle, rod_four_bar, rod_stewart
from tests.support.strategies import ROWS, Growth
from tests.support.walkthrough import file


def values(reading, theta):
    """φ of the kernel at θ (n′,)."""
    return closures_of(reading.bounded("reach").problem).values(theta[None])[0]


def opened(reading, centre, rng, size=0.4):
    """θ near a configuration's, in general open, and the configuration."""
    chart = reading.chart.theta(centre)
    chart += rng.uniform(-size, size, len(chart))
    q_free = reading.configuration(chart)
    return reading.theta(q_free), q_free


def assert_is_phi(mechanism, centre, seeds=range(3)):
    """Row by row; a distance's row by the length of its rod's."""
    reading, constraints = reading_of(mechanism, centre), mechanism.constraints()
    theta = reading.theta(centre)
    assert np.abs(values(reading, theta)).max() < 1e-8
    for seed in seeds:
        theta, q_free = opened(reading, centre, np.random.default_rng(seed))
        found, phi, rods, row = values(reading, theta), constraints.residual(q_free), list(reading.rods), 0
        for k, loop in enumerate(constraints.loops):
            if (length := rod_length(loop)) is None:
                np.testing.assert_allclose(found[row : row + loop.size], phi[: loop.size], rtol=0, atol=1e-12)
                row, phi = row + loop.size, phi[loop.size :]
                continue
            rod = rods.pop(0)
            count = 2 if rod.planar else 3
            gap = np.sqrt(length**2 + 2.0 * length * phi[0])
            assert np.linalg.norm(found[row : row + count]) == pytest.approx(abs(gap - length), abs=1e-12), k
            row, phi = row + count, phi[1:]
        np.testing.assert_allclose(found[row:], phi, rtol=0, atol=1e-12)
        assert len(found) == reading.system.m or mechanism.n_free - mechanism.n != constraints.size
    return reading


@pytest.mark.parametrize("kind", [kind for kind in CLOSURE_KINDS if kind != "perpendicular"])
def test_rows_of_every_closure_kind(monkeypatch, kind):
    """Between chains with balls, circles and slides, on a moving ancestor, whichever coordinates are independent."""
    for seed in (1, 2):
        mechanism = spatial_chain(kind, seed)
        monkeypatch.setattr(module, "independent_indices", lambda mechanism, chart: np.arange(mechanism.n))
        assert_is_phi(mechanism, mechanism.q_reference)


@pytest.mark.parametrize("kind", [kind for kind in CLOSURE_KINDS if kind not in ("perpendicular", "distance")])
@pytest.mark.parametrize("first", [True, False])
def test_rows_of_closures_on_the_base(monkeypatch, kind, first):
    """Whichever of the two ends is on it."""
    growth = Growth(np.random.default_rng(3))
    tip = growth.grow("base", ("revolute", "spherical", "prismatic", "revolute", "revolute"))
    growth.close(kind, *((tip, "base") if first else ("base", tip)))
    monkeypatch.setattr(module, "independent_indices", lambda mechanism, chart: np.arange(mechanism.n))
    single = [joint.name for joint in growth.drawn().description.joints if joint.kind != "spherical"]
    whole = [joint.name for joint in growth.drawn().description.joints if joint.kind == "spherical"]
    n = 7 - ROWS[kind]
    mechanism = ccpin.load(
        growth.drawn().description, independent=[*single[:n]] if n < 4 else [*whole, *single[: n - 3]]
    )
    assert_is_phi(mechanism, mechanism.q_reference)


@pytest.mark.parametrize("name", ["four_bar", "planar_3rrr", "delta", "stewart"])
def test_rows_of_models(name):
    mechanism = ccpin.load(name)
    assert_is_phi(mechanism, mechanism.q_reference)


def test_rows_that_lock_a_spin():
    mechanism = ccpin.load(file("rssr"))
    assert_is_phi(mechanism, mechanism.q_reference)


@pytest.mark.parametrize(
    "make", [rod_four_bar, lambda: rod_four_bar(0.15), rod_stewart, lambda: rod_stewart("cranks"), rod_ankle],
    ids=["plane", "skew", "stewart", "cranks", "ankle"],
)  # fmt: skip
def test_rods_keep_distances(make):
    """Their own angles are measured from where they are at the chart's centre, and are the last in θ."""
    mechanism = ccpin.load(make())
    reading = assert_is_phi(mechanism, mechanism.q_reference)
    angles = reading.theta(mechanism.q_reference)[mechanism.n_free :]
    np.testing.assert_allclose(angles, 0.0, rtol=0, atol=1e-12)
    stops = [(rod.place.start, rod.place.stop) for rod in reading.rods]
    count = 1 if make is rod_four_bar else 2
    assert stops == [(mechanism.n_free + count * k, mechanism.n_free + count * (k + 1)) for k in range(len(stops))]
    for rod in reading.rods:
        np.testing.assert_allclose(rod.reference.T @ rod.reference, np.eye(3), rtol=0, atol=1e-15)
        assert np.linalg.det(rod.reference) == pytest.approx(1.0)
        ends = [np.linalg.norm(rod.tip), np.linalg.norm(rod.reference @ rod.tip)]
        np.testing.assert_allclose(ends, rod.length, rtol=1e-14)


def test_a_chart_is_centred_where_a_floating_body_is_turned():
    """Its slides are the world's, its turns from there."""
    mechanism = ccpin.load(rod_stewart())
    centre = mechanism.q_reference.copy()
    platform = next(joint for joint in mechanism.tree.joints if joint.kind.name == "floating")
    centre[platform.q] = 0.01, -0.02, 0.03, *Rotation.from_euler("XYZ", [0.3, -0.5, 0.8]).as_quat()
    reading, constraints = reading_of(mechanism, centre), mechanism.constraints()
    np.testing.assert_allclose(reading.chart.theta(centre)[platform.v], [0.01, -0.02, 0.03, 0, 0, 0], atol=1e-15)
    for seed in range(3):
        theta, q_free = opened(reading, centre, np.random.default_rng(seed))
        rows, phi = values(reading, theta).reshape(6, 3), constraints.residual(q_free)
        lengths = np.array([rod.length for rod in reading.rods])
        gaps = np.sqrt(lengths**2 + 2.0 * lengths * phi)
        np.testing.assert_allclose(np.linalg.norm(rows, axis=1), np.abs(gaps - lengths), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("share", "planar"), [(0.95, True), (1.05, False), (1.9, False)])
def test_a_rod_is_in_the_plane_to_1e_12_of_its_length(share, planar):
    described = rod_four_bar(0.6 * share * 1e-12)
    (rod,) = reading_of(ccpin.load(described), ccpin.load(described).q_reference).rods
    assert rod.planar == planar
    np.testing.assert_allclose(rod.reference.T @ rod.reference, np.eye(3), rtol=0, atol=1e-15)


def test_which_closures_are_distances():
    """One row of two products: of the gap with itself, and of one vector with itself."""
    rod, other, gap = Fixed("C", np.array([3.0, 4.0, 0.0])), Fixed("C", np.array([3.0, 4.0, 0.0])), Gap()

    def length(row, size=1):
        return rod_length(SimpleNamespace(size=size, rows=SimpleNamespace(rows=(row,) * size)))

    assert length([(0.1, gap, gap), (-0.1, rod, rod)]) == 5.0
    for row in (
        [(0.1, gap, gap)], [(0.1, gap, gap), (-0.1, rod, other)], [(0.1, rod, gap), (-0.1, rod, rod)],
        [(0.1, gap, rod), (-0.1, rod, rod)], [(0.1, gap, gap), (-0.1, gap, gap)],
    ):  # fmt: skip
        assert length(row) is None
    assert length([(0.1, gap, gap), (-0.1, rod, rod)], size=2) is None


# Couplings


def gears():
    """Two circles geared exactly but for turns, of which one is named in two terms."""
    return geared([((0.25, 2.0), 0.3), ((0.5, -1.5, 0.0), 0.1)], ("continuous", "revolute"), (0.3, 0.0))


def test_rows_of_couplings():
    """Σ (c + r(θ − reference)), modulo what continuous joints leave open."""
    mechanism = gears()
    reading = reading_of(mechanism, mechanism.q_reference)
    (coupling,) = mechanism.constraints().couplings
    assert reading.system.moduli.tolist() == [coupling.modulus]
    assert coupling.modulus > 0.0
    for seed in range(5):
        theta, q_free = opened(reading, mechanism.q_reference, np.random.default_rng(seed), 3.0)
        np.testing.assert_allclose(values(reading, theta), mechanism.constraints().residual(q_free), rtol=0, atol=1e-12)
    assert reading.system.periodic.tolist() == [False, False]


@pytest.mark.parametrize("more", [(0.5,), (0.5, 0.0), (0.0, 0.5)])
def test_couplings_that_are_not_linear_are_refused(more):
    mechanism = geared([((0.0, 1.0),), ((0.0, -1.0, *more),)], ("revolute", "revolute"), (0.0, 0.0))
    with pytest.raises(UnsupportedMechanismError, match=f"degree {1 + len(more)}"):
        reading_of(mechanism, mechanism.q_reference)


def test_what_is_a_circle():
    """A turn that enters no coupling; slides are none, and geared turns are known by more than their angle."""
    mechanism = ccpin.load("slider_crank")
    reading = reading_of(mechanism, mechanism.q_reference)
    assert reading.system.periodic.tolist() == [True, True, False]
    joints = (*mechanism.description.joints, Joint("rotor", "revolute", mechanism.description.root, "wheel"))
    wheel = replace(mechanism.description.links[1], name="wheel")
    gear = Coupling("gear", (CouplingTerm("crank", (0.0, 2.0)), CouplingTerm("rotor", (0.0, -1.0))))
    described = replace(
        mechanism.description, links=(*mechanism.description.links, wheel), joints=joints, couplings=(gear,),
        actuated=None, independent=("crank",),
    )  # fmt: skip
    wheeled = ccpin.load(described)
    names = [joint.name for joint in wheeled.tree.joints]
    found = assert_is_phi(wheeled, wheeled.q_reference).system
    assert {name for name, circle in zip(names, found.periodic, strict=True) if circle} == {names[1]} - {"rotor"}
    assert [names[k] for k in found.independent] == ["crank"]
    assert sorted([*found.independent, *found.dependent]) == list(range(len(names)))


# Which coordinates are independent


@pytest.mark.parametrize(
    ("independent", "wanted"),
    [
        (("platform:tz", "platform:tx", "drive0", "drive1", "drive2", "drive3"), ["platform:tz", "platform:tx"]),
        (("drive5", "drive0", "drive1", "drive2", "drive3", "platform:ty"), ["drive5"]),
    ],
)
def test_independent_coordinates_are_found_in_theta(independent, wanted):
    described = replace(rod_stewart(), independent=independent)
    mechanism = ccpin.load(described)
    found = independent_indices(mechanism, chart_at(mechanism, mechanism.q_reference))
    places = {}
    for joint in mechanism.tree.joints:
        parts = [f"{joint.name}:{c}" for c in joint.kind.components] or [joint.name]
        places |= {name: joint.v.start + k for k, name in enumerate(parts)}
    assert found.tolist() == [places[name] for name in independent]
    assert wanted[0] in independent


def test_turns_about_several_axes_are_no_coordinates(monkeypatch):
    """All of a ball, or one turn of it; those of joints with one turn are."""
    names = ["a", "b:tx", "b:ty", "b:rz", "c:rx", "c:ry", "c:rz"]
    tree = SimpleNamespace(split=lambda name: (name.split(":")[0], ":" in name))
    joints = tuple(
        SimpleNamespace(name=name, v=slice(*v), kind=SimpleNamespace(unit=unit))
        for name, v, unit in (("a", (0, 1), 0), ("b", (1, 4), 2), ("c", (4, 7), 4))
    )

    monkeypatch.setattr(scalar_coordinates, "component_names", lambda tree: names)

    def found(*independent):
        mechanism = SimpleNamespace(tree=tree, independent=independent)
        return independent_indices(mechanism, SimpleNamespace(joints=joints)).tolist()

    assert found("b", "a") == [1, 2, 3, 0]
    assert found("b:rz", "b:tx") == [3, 1]
    for refused in ("c", "c:rx", "c:rz"):
        with pytest.raises(UnsupportedMechanismError, match=f"'{refused}' is independent"):
            found(refused)
    floating = SimpleNamespace(name="f", v=slice(1, 7), kind=SimpleNamespace(unit=4))
    names[1:4] = ["f:tx", "f:ty", "f:tz"]
    names[4:] = ["f:rx", "f:ry", "f:rz"]
    joints = (joints[0], floating)
    assert found("f:tz", "f:tx") == [3, 1]
    with pytest.raises(UnsupportedMechanismError):
        found("f")


# Task spaces


@cache
def effector(name, link, point=(0.0, 0.0, 0.0)):
    return ccpin.EndEffector(ccpin.load(name), link, point)


@pytest.mark.parametrize(
    ("name", "link", "point", "names"),
    [
        ("stewart", "platform", (0.1, -0.05, 0.02), ("x", "y", "z", "rx", "ry", "rz")),
        ("delta", "platform", (0.02, 0.01, -0.05), ("x", "y", "z")),
    ],
)
def test_an_end_effector_is_held_to_its_carriage(name, link, point, names):
    """Behind φ's own rows the gap's: 0 where the carriage is at the end effector's pose, as long as it is else."""
    end_effector = effector(name, link, point)
    mechanism = end_effector.model.mechanism
    _, centre = opened(reading_of(mechanism, mechanism.q_reference), mechanism.q_reference, np.random.default_rng(1))
    task = task_space(end_effector, centre)
    assert task.names == names
    assert task.slides == tuple(not name.startswith("r") for name in names)
    reading = reading_of(mechanism, centre, task)
    pose, n, n_free = end_effector.point.pose(centre), len(names), mechanism.n_free
    np.testing.assert_allclose(task.x, [*pose[:3, 3], *np.zeros(n - 3)], rtol=0, atol=1e-15)
    system, rows = reading.system, mechanism.constraints().size
    assert system.independent.tolist() == list(range(n_free, n_free + n))
    assert system.dependent.tolist() == list(range(n_free))
    assert system.periodic[n_free:].tolist() == [not slides for slides in task.slides]
    rng = np.random.default_rng(0)
    for _ in range(4):
        q_free = reading.configuration(reading.chart.theta(centre) + rng.uniform(-0.3, 0.3, n_free))
        theta, at = reading.chart.theta(q_free), end_effector.point.pose(q_free)
        turns = Rotation.from_matrix(pose[:3, :3].T @ at[:3, :3]).as_euler("XYZ")[: n - 3]
        x = np.array([*at[:3, 3], *turns])
        assert n == 3 or np.allclose(pose[:3, :3] @ rot_x(x[3]) @ rot_y(x[4]) @ rot_z(x[5]), at[:3, :3])
        held = values(reading, np.concatenate([theta, x]))
        np.testing.assert_allclose(held[:rows], mechanism.constraints().residual(q_free), rtol=0, atol=1e-12)
        np.testing.assert_allclose(held[rows:], 0.0, rtol=0, atol=1e-12)
        for k in range(n):
            moved = values(reading, np.concatenate([theta, x + 0.125 * np.eye(n)[k]]))
            np.testing.assert_allclose(moved[:rows], held[:rows], rtol=0, atol=1e-12)
            away = np.linalg.norm(moved[rows:])
            assert away == pytest.approx(0.125, abs=1e-12) if k < 3 else 0.05 < away < 0.3


@pytest.mark.parametrize(("name", "link"), [("rpdr", "link3"), ("planar_3rrr", "platform")])
def test_a_carriage_in_a_plane(name, link):
    """Two slides in it, and a turn about its normal; what is across the plane is kept."""
    mechanism = ccpin.load(name)
    end_effector = ccpin.EndEffector(mechanism, link, (0.1, 0.05, 0.02))
    _, centre = opened(reading_of(mechanism, mechanism.q_reference), mechanism.q_reference, np.random.default_rng(1))
    task = task_space(end_effector, centre)
    assert task.names == ("x", "z", "ry")[: mechanism.n]
    reading, rows = reading_of(mechanism, centre, task), mechanism.constraints().size
    pose, rng, n_free = end_effector.point.pose(centre), np.random.default_rng(0), mechanism.n_free
    for _ in range(4):
        q_free = reading.configuration(reading.chart.theta(centre) + rng.uniform(-0.3, 0.3, n_free))
        at = end_effector.point.pose(q_free)
        turn = Rotation.from_matrix(pose[:3, :3].T @ at[:3, :3]).as_rotvec() @ (pose[:3, :3].T @ task.loop.normal)
        x = np.array([*at[[0, 2], 3], turn])[: mechanism.n]
        theta = np.concatenate([reading.chart.theta(q_free), x])
        np.testing.assert_allclose(values(reading, theta)[rows:], 0.0, rtol=0, atol=1e-12)
        for k in range(2):
            theta[n_free + k] += 0.125
            assert np.linalg.norm(values(reading, theta)[rows:]) == pytest.approx(0.125, abs=1e-12)
            theta[n_free + k] -= 0.125


# Packed and compared


@pytest.mark.parametrize("make", [rod_ankle, rod_stewart])
def test_a_reading_is_packed_whole(make):
    """What is unpacked is the same, and gives the same θ and φ."""
    mechanism = ccpin.load(make())
    reading = reading_of(mechanism, mechanism.q_reference)
    again = unpack_reading(*pack_reading(reading))
    assert same_reading(again, reading)
    theta, q_free = opened(reading, mechanism.q_reference, np.random.default_rng(0))
    np.testing.assert_array_equal(again.theta(q_free), theta)
    np.testing.assert_array_equal(values(again, theta), values(reading, theta))
    assert [joint.reference.tolist() for joint in again.chart.joints] == [
        joint.reference.tolist() for joint in reading.chart.joints
    ]


def test_readings_that_differ_in_one_number_are_not_the_same():
    """Or in a header's, or in which arrays there are."""
    mechanism = ccpin.load(rod_four_bar(0.15))
    reading = reading_of(mechanism, mechanism.q_reference)
    system, (rod,) = reading.system, reading.rods
    longer = rod._replace(length=rod.length + 1e-12)
    offset = system.offset.copy()
    offset[-1] += 1e-15
    moved = reading.problem._replace(system=replace(system, offset=offset))
    assert same_reading(reading, reading)
    for other in (
        reading._replace(rods=(longer,)), reading._replace(rods=()), reading._replace(problem=moved),
        reading._replace(chart=replace(reading.chart, nq=9)),
    ):  # fmt: skip
        assert not same_reading(reading, other)
        assert not same_reading(other, reading)
    asked = SimpleNamespace(_asdict=lambda: {"lower": np.zeros(2)})
    assert not same_reading(reading, reading._replace(problem=reading.problem._replace(requirements=asked)))
