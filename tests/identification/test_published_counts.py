"""How many base parameters others have published: as many, or fewer where a loop hands over what a tree does not.

Counts and combinations are those of SchapplM's robsynth-serhybroblib, -parroblib and -serroblib on GitHub
(`*_convert_par2_MPV_fixb.m`, `*_minimal_parameter_para.m`), of bodies alone and gravity of any direction.
"""

import re
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ccpin

pytest.importorskip("flint")
from ccpin.description import Part, combine, read_description
from ccpin.dynamics.parameters import INERTIAL
from ccpin.identification import base_parameters
from tests.oracles.tree_regressor import motions, rank
from tests.support import published

TILTED = (1.3, -0.7, -9.4)  # m/s²
ROBOTS = list(Path(sys.prefix).glob("lib/python*/site-packages/cmeel.prefix/share/example-robot-data/robots"))


def base_of(description, gravity=TILTED, **given):
    return base_parameters(ccpin.ReducedModel(ccpin.load(description), gravity=gravity), **given)


def of_bodies(told, *more):
    """Base combinations of bodies' constants alone, the columns' names with them: its rank is how many there are."""
    columns = told.parameters.of("inertia", *more)
    return told.grouping[:, columns], [told.parameters.names[k] for k in columns]


BARS, PARALLELOGRAM = published.BARS, published.PARALLELOGRAM
LOOPS = {
    "fourbar2": published.four_bar(PARALLELOGRAM),
    "fourbar1": published.four_bar(BARS),
    "fourbarpris": published.swinging_cylinder(),
    "fourbar1turn": published.four_bar(BARS, turntable=True),
}


@cache
def loop(name):
    """What is told of one of these."""
    return base_of(LOOPS[name])


@pytest.mark.parametrize(
    ("name", "count", "theirs"),
    [
        ("fourbar2", 3, published.parallelogram_combinations(PARALLELOGRAM)),
        ("fourbar1", 8, published.four_bar_combinations(BARS)),
        pytest.param("fourbarpris", 8, None, marks=pytest.mark.slow),
        ("fourbar1turn", 21, None),
    ],
)
def test_loops_of_bars(name, count, theirs):
    """3 as published; 8 where 9 are, of which they are combinations, 8 of 9, 21 of 25: singular values say the same."""
    told, description = loop(name), LOOPS[name]
    assert told.proved
    ours, names = of_bodies(told)
    assert np.linalg.matrix_rank(ours) == count
    rows, columns = motions(description, description.actuated, TILTED, 60, np.random.default_rng(1), 0.1)
    assert rank(rows) == count
    for line in (ours, rows[:, [columns.index(name) for name in names]]):
        if theirs is not None:
            known = np.linalg.qr(published.combinations(names, theirs).T)[0]
            np.testing.assert_allclose(line @ known @ known.T, line, rtol=0, atol=1e-11 * np.abs(line).max())


def test_what_a_pin_hands_over():
    """A mass on the pin of coupler and rocker is either's, which makes 8 of 9; on a turntable a closed loop hides more.

    Products of inertia Iyz that are as the rods' lengths have Σ l sin θ, a constant of the loop, for their momentum
    about the turntable: no mass that could sit on the pin, so that structure does not show it.
    """
    _, l2, l3, l4 = BARS
    handed = {
        "mass:coupler": 1.0, "mx:coupler": l3, "Izz:coupler": l3**2,
        "mass:rocker": -1.0, "mx:rocker": -l4, "Izz:rocker": -(l4**2),
    }  # fmt: skip
    closed = {"Iyz:crank": l2, "Iyz:coupler": l3, "Iyz:rocker": -l4}
    for name, combo, more in (("fourbar1", handed, 0), ("fourbar1turn", closed, 1)):
        ours, names = of_bodies(loop(name))
        (z,) = published.combinations(names, [combo])
        assert np.abs(ours @ z).max() < 1e-12
        assert loop(name).upper - loop(name).within == more
    _, names = of_bodies(loop("fourbar1"))
    (z,) = published.combinations(names, [handed])
    assert np.abs(published.combinations(names, published.four_bar_combinations(BARS)) @ z).max() > 0.1


@pytest.mark.parametrize(
    ("description", "count", "theirs"),
    [
        (published.palletizer(), 21, published.palletizer_combinations()),
        pytest.param(published.level_palletizer(), 22, None, marks=pytest.mark.slow),
    ],
    ids=["palh2m1", "palh2m2"],
)
def test_palletizers(description, count, theirs):
    """21 and 22 as published: so many are proved, and motions show nothing but the combinations published."""
    told = base_of(description, box=None)
    independent = told.facts[0].claim.columns
    assert len(np.intersect1d(independent, told.parameters.of("inertia"))) == count
    rows, names = motions(description, description.actuated, TILTED, 60, np.random.default_rng(2), 1.5)
    assert rank(rows) == count
    if theirs is not None:
        known = np.linalg.qr(published.combinations(names, theirs).T)[0]
        assert known.shape[1] == count
        np.testing.assert_allclose(rows @ known @ known.T, rows, rtol=0, atol=1e-12 * np.abs(rows).max())


@pytest.mark.parametrize(
    ("name", "bodies", "count"),
    [
        ("planar_3rrr", ("proximal", "distal", "platform"), 9),
        pytest.param("stewart", ("leg_cross", "cylinder", "piston", "platform"), 23, marks=pytest.mark.slow),
    ],
)
def test_legs_that_are_alike(name, bodies, count):
    """10 of P3RRR1 and 24 of P6RRPRRR14V3 are published, of equal legs: both are one fewer, a mass on legs' tips."""
    told = base_parameters(ccpin.load(name), box=None)
    assert told.proved
    kinds = [(kind, re.sub(r"\d+", "", body)) for kind, body in (each.split(":") for each in told.parameters.names)]
    shared = [(kind, body) for body in bodies for kind in INERTIAL]
    alike = np.array([[float(each == one) for one in shared] for each in kinds])
    assert np.linalg.matrix_rank(told.grouping @ alike) == count
    description, names = ccpin.load(name).description, told.parameters.names
    rows, columns = motions(description, description.independent, (0.0, 0.0, -9.81), 60, np.random.default_rng(3), 0.05)
    assert rank(rows @ alike[[names.index(each) for each in columns]]) == count


def beside_a_loop(description):
    """With a four-bar of its own beside it, as a loop is asked for."""
    return combine("beside", {"arm_": Part(description), "bar_": Part(read_description("four_bar"))})


def of_arm(told, *more):
    """How many there are of its bodies, and other constants of these kinds: proved from both sides."""
    assert told.proved
    rows, names = of_bodies(told, *more)
    return np.linalg.matrix_rank(rows[:, [":arm_" in name for name in names]])


@pytest.mark.slow
def test_an_arm():
    """S6RRRRRR10's 38, for gravity of any direction."""
    assert of_arm(base_of(beside_a_loop(published.arm()), box=None)) == 38


@pytest.mark.slow
def test_an_arm_that_stands_upright():
    """36 where gravity is along the first axis, 40 with rotors: the first two joints' turn as their bodies do."""
    told = base_of(beside_a_loop(published.arm()), (0.0, 0.0, -9.81), box=None)
    assert (of_arm(told), of_arm(told, "armature")) == (36, 40)


@pytest.mark.slow
@pytest.mark.skipif(not ROBOTS, reason="example-robot-data is not installed")
@pytest.mark.parametrize(
    ("path", "count"),
    [
        ("ur_description/urdf/ur5_robot.urdf", 36),
        ("ur_description/urdf/ur10_robot.urdf", 36),
        ("panda_description/urdf/panda.urdf", 43),
    ],
)
def test_arms_of_files(path, count):
    """A UR has 36 of 60, a Panda 43 of 70 (its fingers held)."""
    described = beside_a_loop(read_description(ROBOTS[0] / path))
    fingers = [joint.name for joint in described.joints if "finger_joint" in joint.name]
    assert of_arm(base_parameters(ccpin.load(described, locked=fingers), box=None)) == count
