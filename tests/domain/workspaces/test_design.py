"""Designs: what is certified of the best proposal holds in closed forms with the dimensions found."""

import signal

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.description import read_description
from ccpin.errors import InvalidInputError
from tests.oracles.geometry import rot_x, rot_y
from tests.support.loading import script
from tests.support.places import ROOT

ANKLE = ROOT / "docs" / "howto" / "ankle.urdf"
ARM, FOREARM, BASE = 0.2794, 0.3048, 0.3048
CRANK, ROD = 0.05, 0.26
POINTS = 2000


def elbow_distance(q, arms):
    """How far apart the RPDR's elbows are: singular at 0 and at two forearms."""
    first = arms * ARM * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])])
    second = arms * ARM * np.stack([np.cos(q[:, 1]), np.sin(q[:, 1])])
    second[0] += BASE
    return np.linalg.norm(first - second, axis=0)


def cranks_of(pitch, roll, crank=1.0, foot=1.0):
    """The two crank angles at which the rods fit, and the slopes (2, 2) by pitch and roll; NaN where none does.

    |heel − base − R_y(θ)(−c, 0, 0)| = rod, with (x, y, z) = heel − base, is
    x cos θ − z sin θ = (rod² − c² − x² − y² − z²)/2c; of its two solutions the one with
    the crank level when the foot is.
    """
    angles, slopes = np.empty(2), np.empty((2, 2))
    c, turn = CRANK * crank, rot_y(pitch) @ rot_x(roll)
    for k, side in enumerate((1.0, -1.0)):
        arm = foot * np.array([-0.05, 0.04 * side, -0.01])
        x, y, z = turn @ arm - np.array([0.0, 0.04 * side, 0.25])
        wanted = (ROD**2 - c**2 - x * x - y * y - z * z) / (2.0 * c)
        size, phase = np.hypot(x, z), np.arctan2(z, x)
        angles[k] = -np.arccos(wanted / size) - phase
        angles[k] = (angles[k] + np.pi) % (2.0 * np.pi) - np.pi
        tip = c * np.array([-np.cos(angles[k]), 0.0, np.sin(angles[k])])
        rod = np.array([x, y, z]) - tip
        heel = [np.cross([0.0, 1.0, 0.0], turn @ arm), turn @ np.cross([1.0, 0.0, 0.0], arm)]
        slopes[k] = [rod @ moved for moved in heel] / (
            rod @ np.array([c * np.sin(angles[k]), 0.0, c * np.cos(angles[k])])
        )
    return angles, slopes


def motors_at(space_atlas, mechanism, points):
    q_free = np.atleast_2d(space_atlas.sigma(points))
    return np.column_stack([q_free[:, mechanism.tree.joint(n).q.start] for n in ("left_motor", "right_motor")])


@pytest.fixture(scope="module")
def ankle():
    return ccpin.load(ANKLE)


@pytest.mark.slow
def test_ankle_range_holds_in_closed_form(ankle):
    """Motors within limits and the same as the closed form's, det ∂motors/∂(pitch, roll) of one sign."""
    found = domain.largest_cube(domain.JointSpace(ankle, ("pitch", "roll")), (0.0, 0.0), proportions=(0.6, 0.45))
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.0, 1.0, (POINTS, 2)) * np.array([0.6, 0.45]) * found.half * (1 - 1e-12)
    assert found.contains(points).all()
    assert found.atlas.names == ("pitch", "roll")
    motors, dets = motors_at(found.atlas, ankle, points), []
    for (pitch, roll), angles in zip(points, motors, strict=True):
        exact, slopes = cranks_of(pitch, roll)
        np.testing.assert_allclose(angles, exact, atol=1e-9)
        assert np.all(np.abs(exact) <= 1.2)
        assert abs(roll) <= 0.5
        assert abs(pitch) <= 0.9
        dets.append(np.linalg.det(slopes))
    assert np.ptp(np.sign(dets)) == 0.0
    assert found.obstacle is not None
    assert found.upper < 1.1 * found.half


@pytest.mark.slow
def test_a_limit_in_the_way_is_the_obstacle(ankle):
    """A motor kept within ±0.5 rad stops the range; the closed form has it there at the obstacle."""
    space = domain.JointSpace(ankle, ("pitch", "roll"))
    found = domain.largest_cube(space, (0.0, 0.0), limits={"left_motor": (-0.5, 0.5)})
    pitch, roll = found.obstacle.q
    assert found.obstacle.kind == "limit"
    assert abs(abs(cranks_of(pitch, roll)[0][0]) - 0.5) < 1e-2


@pytest.mark.slow
def test_rpdr_design_is_certified_in_closed_form():
    """More than thrice the square of the robot as built; elbows apart and within reach at every point of it."""
    design = script("design_rpdr")
    found = domain.design(
        domain.scaled_links("rpdr", design.LINKS),
        design.RANGES,
        design.square,
        start={"arms": 1.0, "forearms": 1.0},
        evaluations=12,
    )
    assert found.complete
    assert len(found.trials) <= 12
    assert found.figure > 1.5 * found.trials[0].figure
    assert found.certificate.verify().all()
    q = design.CENTRE + np.random.default_rng(1).uniform(-found.figure, found.figure, (POINTS, 2))
    distance = elbow_distance(q, found.dimensions["arms"])
    assert distance.min() > 0.0
    assert distance.max() < 2.0 * found.dimensions["forearms"] * FOREARM


@pytest.mark.slow
def test_scripts(tmp_path, capsys):
    found = script("design_rpdr").main(evaluations=4, out=tmp_path)
    assert (tmp_path / "design_rpdr.csv").read_text().count("\n") == len(found.trials) + 1
    better = script("design_ankle").main(evaluations=4, model=ANKLE)
    assert better.figure >= better.trials[0].figure > 0.9
    assert "best" in capsys.readouterr().out


def test_proposals_that_fail_are_told(ankle):
    """A proposal that cannot be closed counts as nothing and does not end the search."""
    build = domain.scaled_links(read_description("rpdr"), {"arms": ("link1", "link2")})

    def figure(mechanism):
        return domain.certify(mechanism, np.radians([60.0, 115.0]), max_depth=0, resolution=0.1)

    found = domain.design(build, {"arms": (0.5, 40.0)}, figure, start={"arms": 1.0}, evaluations=4)
    assert found.trials[1].figure == 0.0
    assert "UnreachableError" in found.trials[1].reason
    assert found.figure >= found.trials[0].figure > 0.0
    with pytest.raises(InvalidInputError, match="none of"):
        domain.design(build, {"arms": (6.0, 8.0)}, figure, evaluations=3)
    with pytest.raises(InvalidInputError, match="start"):
        domain.design(build, {"arms": (0.5, 1.0)}, figure, start={"leg": 1.0})
    with pytest.raises(InvalidInputError, match="'arms'"):
        domain.design(build, {"arms": (1.0, 0.5)}, figure)


def test_interrupted_search_keeps_the_best():
    calls = []

    def figure(value):
        calls.append(value)
        if len(calls) == 4:
            signal.raise_signal(signal.SIGINT)
        return value

    found = domain.design(lambda dimensions: dimensions["a"], {"a": (0.0, 1.0)}, figure)
    assert not found.complete
    assert found.figure == max(calls[:3])
