"""Lengths and anchors from measured angles: Freudenstein's equation, least squares of closed forms, true numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import ccpin
from ccpin.errors import ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.transmission import Transmission, identify_geometry
from tests.oracles.linkages import Knee
from tests.support.linkage_models import loaded, transmission_of
from tests.support.measured_pairs import INSIDE, LINKAGES, NOISE, knee, simulated
from tests.support.rods import FOUR_BAR, rocker_angle, rod_four_bar


def identified(linkage, pairs, **options):
    """Of the linkage's own numbers."""
    return identify_geometry(linkage.transmission, *pairs, **({"parameters": linkage.numbers} | options))


def test_freudensteins_equation():
    """The knee from angles alone: cos(m − j) = k₁ + k₂ sin m − k₃ sin j, linear in g/c, g/a and the rod's square."""
    truth = np.array([-0.063, 0.348, -0.048])
    motors, joints = knee().measured(truth, 30, np.random.default_rng(3), noise=0.0)
    m, j = motors[:, 0], joints[:, 0]
    rows = np.stack([np.ones_like(m), np.sin(m), -np.sin(j)], axis=1)
    k = np.linalg.lstsq(rows, np.cos(m - j), rcond=None)[0]
    a, c, g = Knee.THIGH / k[2], Knee.THIGH / k[1], Knee.THIGH
    rod = np.sqrt(a * a + c * c + g * g - 2.0 * a * c * k[0])
    found = identified(knee(), (motors, joints))
    np.testing.assert_allclose(found.values, [-a, rod, -c], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.values, truth, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", LINKAGES)
def test_it_is_the_most_likely_geometry(name):
    """SciPy's least squares over the numbers and every true joint angle, of the closed form; its covariance."""
    linkage, rng = LINKAGES[name](), np.random.default_rng(8)
    truth = linkage.stated + linkage.error * rng.normal(size=len(linkage.numbers))
    motors, joints = linkage.measured(truth, 12, rng)
    noise = 1.5 * NOISE, 0.7 * NOISE

    def left(z):
        p, q = z[: len(truth)], z[len(truth) :].reshape(joints.shape)
        return np.concatenate([(motors - linkage.motors(p, q)) / noise[0], (joints - q) / noise[1]]).ravel()

    start = np.concatenate([truth, joints.ravel()])
    best = least_squares(left, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    found = identified(linkage, (motors, joints), motor_noise=noise[0], joint_noise=noise[1])
    spread = np.linalg.inv(best.jac.T @ best.jac)[: len(truth), : len(truth)]
    deviations = np.sqrt(np.diag(spread))
    np.testing.assert_allclose((found.values - best.x[: len(truth)]) / deviations, 0.0, atol=1e-2)
    scaled = np.outer(deviations, deviations)
    np.testing.assert_allclose(found.covariance / scaled, spread / scaled, rtol=0, atol=2e-2)
    np.testing.assert_allclose(found.misfit**2 * (joints.size - len(truth)), 2.0 * best.cost, rtol=1e-4)
    assert found.rank == len(truth)
    assert found.unobservable == ()
    low, high = found.intervals(0.95)
    np.testing.assert_allclose((high - low) / (2.0 * found.standard_deviations), INSIDE, rtol=1e-6)


@pytest.mark.parametrize("name", ["ankle", "knee"])
def test_files_that_are_far_off(name, tmp_path):
    """5 mm in every number, of cranks of 50: found from angles without errors, and the files written say so."""
    linkage, rng = LINKAGES[name](), np.random.default_rng(2)
    truth = linkage.stated + 5e-3 * rng.choice([-1.0, 1.0], len(linkage.numbers))
    found = identified(linkage, linkage.measured(truth, 30, rng, noise=0.0))
    np.testing.assert_allclose(found.values, truth, rtol=0, atol=1e-8)
    sides = linkage.transmission
    written = ccpin.load(found.description)
    written.save(tmp_path / "found.urdf")
    for mechanism in (written, ccpin.load(tmp_path / "found.urdf")):
        whole, q = Transmission(mechanism, sides.joints, sides.motors), 0.3 * np.array(linkage.span)
        np.testing.assert_allclose(whole.motor_from_joint(q), linkage.motors(truth, q[None])[0], rtol=0, atol=1e-8)


def test_what_angles_do_not_tell():
    """All of the knee: its size, hinges along their axes; geometries along such directions have the same angles."""
    linkage = knee()
    motors, joints = linkage.measured(linkage.stated, 40, np.random.default_rng(1), noise=0.0)
    found = identify_geometry(linkage.transmission, motors, joints)
    assert found.unobservable[0].startswith("the size of the whole")
    assert "origin:rod_swing/y alone (nothing measured changes)" in found.unobservable
    assert any("lever/B/z" in each and "hardly" in each for each in found.unobservable)
    assert not found.determined.all()
    assert np.isinf(found.standard_deviations[~found.determined]).all()
    np.testing.assert_allclose(found.values, found.stated, rtol=0, atol=1e-9)
    in_plane = [not name.endswith("y") for name in found.parameters]  # across it the loop would be open
    free = found.directions[found.singular_values[found.rank :] <= 1e-10 * found.singular_values[0]] * in_plane
    ways = free[np.abs(free).max(axis=1) > 1e-3 * np.abs(free).max()]
    assert len(ways) > 3
    for way in 1e-3 * ways / np.abs(ways).max(axis=1, keepdims=True):
        moved = _moved(loaded("knee").description, dict(zip(found.parameters, way, strict=True)))
        other = Transmission(ccpin.load(moved), linkage.transmission.joints)
        changes = [other.motor_from_joint(q) - m for q, m in zip(joints[:3], motors[:3], strict=True)]
        np.testing.assert_allclose(changes, 0.0, atol=(1e-3 / Knee.LEVER) ** 2)  # of first order: 1e-3/lever


def _moved(description, way):
    """The description with origins moved, by hand."""

    def at(frame, name):
        frame = np.array(frame)
        frame[:3, 3] += [way.get(f"origin:{name}/{axis}", 0.0) for axis in "xyz"]
        return frame

    joints = tuple(replace(each, placement=at(each.placement, each.name)) for each in description.joints)
    (pin,) = description.closures
    pin = replace(pin, placement_a=at(pin.placement_a, "lever/A"), placement_b=at(pin.placement_b, "lever/B"))
    return replace(description, joints=joints, closures=(pin,))


def test_encoders_mounted_off():
    """Offsets of both sides beside the neck's ratios: what a line through pairs has as its value at 0."""
    linkage = LINKAGES["neck"]()
    motors, joints = linkage.measured(linkage.stated, 30, np.random.default_rng(5), noise=0.0)
    found = identified(linkage, (motors + [0.02, -0.01], joints), offsets=("left_motor", "right_motor"))
    np.testing.assert_allclose(found.values, [*linkage.stated, 0.02, -0.01], rtol=0, atol=1e-9)
    both = identified(linkage, (motors, joints + [0.03, 0.0]), parameters=["tendon_1/roll"], offsets=["pitch"])
    np.testing.assert_allclose(both.values, [linkage.stated[1], 0.03], rtol=0, atol=1e-9)


def test_what_the_drawing_says_beside():
    """Priors add their weight; with them all is determined, and what no pair shows stays as stated."""
    linkage, spread, rng = LINKAGES["neck"](), 1e-3, np.random.default_rng(6)
    pairs = linkage.measured(linkage.stated, 40, rng)
    alone, held = identified(linkage, pairs), identified(linkage, pairs, priors=dict.fromkeys(linkage.numbers, spread))
    wanted = np.linalg.inv(np.linalg.inv(alone.covariance) + np.eye(4) / spread**2)
    np.testing.assert_allclose(held.covariance / wanted[0, 0], wanted / wanted[0, 0], rtol=0, atol=1e-3)
    linkage = knee()
    pairs = linkage.measured(linkage.stated, 40, rng)
    every = {"knee": spread, "motor": spread, "rod_swing": spread, "lever": spread}
    whole = identified(linkage, pairs, parameters=None, priors=every)
    assert whole.determined.all()
    across = whole.parameters.index("origin:rod_swing/y")
    np.testing.assert_allclose([whole.values[across], whole.standard_deviations[across]], [0.0, spread], atol=1e-12)


def test_a_rod_of_stated_length():
    """A distance closure: rod, rocker and offset of the crank's encoder, of pairs where circles meet."""
    other = Transmission(ccpin.load(rod_four_bar()), ["rocker"], ["crank"])
    cranks = -1.0 + np.linspace(-0.5, 0.0, 25)[:, None]
    rockers = np.array([[rocker_angle(crank)] for crank in cranks[:, 0]])
    description = other.joint_model.mechanism.description
    (rod,) = description.closures
    end = np.array(rod.placement_b)
    end[0, 3] += 0.004
    off = replace(description, closures=(replace(rod, length=rod.length - 0.003, placement_b=end),))
    numbers = ["distance:rod", "origin:rod/B/x"]
    found = identify_geometry(
        Transmission(ccpin.load(off), ["rocker"], ["crank"]),
        cranks + 0.01,
        rockers,
        parameters=numbers,
        offsets=["crank"],
    )
    np.testing.assert_allclose(found.values, [FOUR_BAR[3], FOUR_BAR[2], 0.01], rtol=0, atol=1e-9)
    assert found.units == ("m", "m", "rad")
    again = Transmission(ccpin.load(found.description), ["rocker"], ["crank"])
    np.testing.assert_allclose(again.motor_from_joint(rockers[3]), cranks[3], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"motors": np.zeros((5, 2))}, "motor_positions"),
        ({"joints": np.full((20, 1), np.nan)}, "joint_positions"),
        ({"count": 3}, "measure more poses"),
        ({"motors": np.zeros((0, 1)), "joints": np.zeros((0, 1))}, "no pairs"),
        ({"motors": np.zeros((19, 1))}, "no pairs"),
        ({"motor_noise": 0.0}, "motor_noise"),
        ({"joint_noise": [1.0, 1.0]}, "joint_noise"),
        ({"parameters": ["rods"]}, "no 'rods'"),
        ({"known": ["lever/C"]}, "no 'lever/C'"),
        ({"offsets": ["lever"]}, "none of knee, motor"),
        ({"priors": {"lever": -1.0}}, "priors"),
        ({"known": ["rod_swing", "lever"]}, "nothing is unknown"),
        ({"parameters": ["origin:rod_swing/y"]}, "observable"),
    ],
)
def test_what_is_refused(change, word):
    linkage = knee()
    motors, joints = linkage.measured(linkage.stated, change.pop("count", 20), np.random.default_rng(0))
    pairs = change.pop("motors", motors), change.pop("joints", joints)
    with pytest.raises(InvalidInputError, match=word):
        identified(linkage, pairs, **change)


def test_pairs_of_something_else():
    """The other branch (the crank on the far side), another mechanism's pairs, and degrees; rows that are redundant."""
    linkage, rng = knee(), np.random.default_rng(0)
    motors, joints = linkage.measured(linkage.stated, 25, rng)
    d = np.stack([Knee.LEVER * -np.cos(joints[:, 0]), Knee.LEVER * np.sin(joints[:, 0]) - Knee.THIGH])
    mirrored = 2.0 * np.arctan2(d[1], -d[0])[:, None] - motors
    other = LINKAGES["ankle"]()
    left, feet = other.measured(other.stated, 25, rng)
    for pairs in ((mirrored, joints), (left[:, :1], feet[:, :1]), (np.degrees(motors), np.degrees(joints))):
        with pytest.raises(ConvergenceError, match=r"same order, units and signs|cannot be moved"):
            identified(linkage, pairs)
    with pytest.raises(UnsupportedMechanismError, match="redundant"):
        identify_geometry(_redundant(), np.zeros((9, 1)), np.zeros((9, 1)))


def _redundant():
    """The knee with its pin closed twice."""
    description = loaded("knee").description
    (pin,) = description.closures
    again = replace(pin, name="again")
    return Transmission(ccpin.load(replace(description, closures=(pin, again))), ["knee"], ["motor"])


@pytest.mark.slow
@pytest.mark.parametrize("name", LINKAGES)
def test_intervals_hold_what_they_say(name):
    """95 % of 95 % intervals, pooled over 200 runs, within three deviations were a run's numbers all one."""
    runs = list(simulated(LINKAGES[name](), 200))
    held = np.abs([run.errors for run in runs]) < INSIDE
    assert abs(held.mean() - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / len(runs))
    assert abs(np.mean([run.misfit for run in runs]) - 1.0) < 0.03


def test_it_says_what_it_found():
    """A line a number, what is not observable, and what is left."""
    linkage = knee()
    found = identified(linkage, linkage.measured(linkage.stated, 20, np.random.default_rng(0)), known=["lever/B"])
    said = str(found).splitlines()
    assert said[0].startswith("origin:rod_swing/x")
    assert "± 0." in said[0]
    assert said[-1].startswith("residuals")
    assert transmission_of("knee").joint_model.mechanism.description is not found.description
