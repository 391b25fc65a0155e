"""A motor whose limit is too small to hold start or goal is told of by all that runs into it, with what to do.

What holding takes is dV/dq by central differences of Pinocchio's potential energy along closed configurations.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.cli import main
from ccpin.control import ComputedTorque, PDSimpleGravity, PointToPoint, certify_set_point
from ccpin.description.model import Motor
from ccpin.dynamics.drives import too_weak
from ccpin.dynamics.soundness import examine
from ccpin.report import ReportSettings, set_point_move
from ccpin.simulation import Limits, demands
from ccpin.simulation.results.metrics import band_in_words

LIMIT = 0.01  # N m, of a crank that takes more than twice of it
GOAL = np.array([0.4])
GAINS = 2.0, 0.2
DURATION = 0.05
WEAK = re.compile(r"motor 'crank_motor' cannot hold it still (at [\w ]+): that takes (\S+) N m \(limit 0\.01 N m\)")
REMEDIES = 'joints={"crank": {"effort": …}}', "--effort-limits ignore", 'limits=Limits(effort="ignore")'


@pytest.fixture(scope="module")
def model():
    return ccpin.ReducedModel(ccpin.load("four_bar", joints={"crank": {"effort": LIMIT}}))


@pytest.fixture(scope="module")
def law(model):
    return PDSimpleGravity(model, GOAL, *GAINS)


@pytest.fixture(scope="module")
def motion(model, law):
    return ccpin.simulate(model, law, model.alpha(model.mechanism.q_reference), duration=DURATION)


def takes(model, q, step=1e-6):
    """dV/dq."""
    free, data = model.mechanism.pin_model, model.mechanism.pin_model.createData()
    ends = [model.sigma(np.asarray(q) + sign * step) for sign in (1.0, -1.0)]
    return np.subtract(*(pin.computePotentialEnergy(free, data, end) for end in ends)) / (2.0 * step)


def told(text, where, effort):
    """Whether a text tells of it, and of what to do."""
    found = WEAK.search(text)
    return found is not None and found[1] == where and float(found[2]) == pytest.approx(abs(effort), rel=6e-3)


def test_a_motion_says_what_holding_takes_and_what_to_do(model, motion):
    """In its notes, its repr and its demands; of start and goal the one that takes more."""
    ends = {"at the start": takes(model, motion.q[0]), "at the goal": takes(model, GOAL)}
    where = max(ends, key=lambda name: abs(ends[name]))
    assert motion.status == "finished"
    sizing = demands(model, motion, bearings=False)
    assert sizing.peak_effort == pytest.approx([LIMIT])
    for text in (repr(motion), " ".join(motion.notes), sizing.notes[1]):
        assert told(text, where, ends[where])
        assert all(remedy in text for remedy in REMEDIES)
    share = np.mean(np.abs(motion.u) == LIMIT)
    assert sizing.notes[0].startswith(f"peak_effort is what the motors gave, at their limits: crank for {share:.0%} of")


def test_the_remedies_are_remedies(model, law, motion):
    """Both leave nothing of it to tell, and both ways the motors give what is asked."""
    stated = ccpin.ReducedModel(ccpin.load("four_bar", joints={"crank": {"effort": 500.0}}))
    ways = [
        (stated, ccpin.simulate(stated, PDSimpleGravity(stated, GOAL, *GAINS), motion.q[0], duration=DURATION)),
        (model, ccpin.simulate(model, law, motion.q[0], duration=DURATION, limits=Limits(effort="ignore"))),
    ]
    for own, free in ways:
        sizing = demands(own, free, bearings=False)
        assert sizing.notes == ()
        assert not any("hold it still" in note for note in free.notes)
        assert sizing.peak_effort == pytest.approx(np.abs(ways[0][1].u).max(axis=0))
        assert sizing.peak_effort[0] > 2.0 * LIMIT


def test_the_goal_of_a_tracking_law_is_its_references_end(model, motion):
    """Held level at the end, upright or hanging at the start: it is the end that is told of."""
    end = next(q for q in np.arange(0.3, 3.0, 0.3) if abs(takes(model, [q])) > 1.05 * abs(takes(model, motion.q[0])))
    law = ComputedTorque(model, PointToPoint(model, motion.q[0], [end], 0.4), 100.0, 20.0)
    moved = ccpin.simulate(model, law, motion.q[0], duration=DURATION)
    assert told(repr(moved), "at the goal", takes(model, [end]))


def test_motors_at_their_limits_that_hold_it_are_named(motion):
    """A limit beyond what standing still takes, at which the law's first push ends all the same."""
    strong = ccpin.ReducedModel(ccpin.load("four_bar", joints={"crank": {"effort": 0.1}}))
    cut = ccpin.simulate(strong, PDSimpleGravity(strong, GOAL, 20.0, 0.2), motion.q[0], duration=DURATION)
    assert "efforts at their limits: crank" in cut.notes
    assert repr(cut).endswith("efforts at their limits: crank)")


def test_gravity_is_the_models(motion):
    """Without any nothing is to be held."""
    level = ccpin.ReducedModel(ccpin.load("four_bar", joints={"crank": {"effort": LIMIT}}), gravity=(0.0, 0.0, 0.0))
    floating = ccpin.simulate(level, PDSimpleGravity(level, GOAL, *GAINS), motion.q[0], duration=DURATION)
    assert "efforts at their limits: crank" in floating.notes


def test_a_certificate_says_that_it_knows_no_limits(model):
    """In its reason, where holding q_d takes more than there is; not where limits suffice."""
    proof = certify_set_point(model, GOAL, *GAINS, budget=20)
    assert "; efforts are taken as unlimited, and " in proof.reason
    assert told(proof.reason, "at q_d", takes(model, GOAL))
    strong = ccpin.ReducedModel(ccpin.load("four_bar"))
    assert "unlimited" not in certify_set_point(strong, GOAL, *GAINS, budget=20).reason


def test_the_command_says_so_before_it_says_finished(tmp_path, capsys):
    """`simulate` begins with it, and with a goal beyond a joint's limits; `--effort-limits ignore` is a way out."""
    robot = tmp_path / "robot.urdf"
    ccpin.load("four_bar", joints={"crank": {"effort": LIMIT, "upper": 0.6}}).save(robot)
    words = [
        "simulate",
        str(robot),
        "--start",
        "0.5",
        "--goal",
        "0.8",
        "--kp",
        "20",
        "--kv",
        "0.1",
        "--duration",
        "0.3",
    ]
    assert main(words) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert "cannot hold it still" in first
    assert all(remedy in first for remedy in REMEDIES)
    assert main([*words, "--effort-limits", "ignore"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert not any("hold it still" in line for line in lines)
    (beyond,) = (k for k, line in enumerate(lines) if line.startswith("position of crank beyond 0.6"))
    assert beyond < next(k for k, line in enumerate(lines) if "finished" in line)
    assert main([*words, "--json"]) == 0
    assert any("cannot hold it still" in note for note in json.loads(capsys.readouterr().out)["notes"])


@pytest.mark.slow
def test_a_report_says_so(model, motion):
    """The experiment's section, before how it ran; its band is of angles, as all coordinates are."""
    page = set_point_move.experiment(model, set_point_move.run(model, ReportSettings(goal=GOAL, duration=DURATION)))
    assert page.index("cannot hold it still") < page.index("ran to its end")
    assert "mm" not in page[: page.index("<figure")]
    assert "±2°" in page


def test_bands_are_of_what_coordinates_do():
    """Degrees of what turns, millimetres of what slides."""
    assert band_in_words(ccpin.load("four_bar"), np.radians(2.0)) == "2°"
    assert band_in_words(ccpin.load("stewart"), 0.035) == "35 mm"


def test_what_a_check_says_to_do():
    """The same words as a note, of the joint's limit or of the motor's own, whichever binds."""
    description = ccpin.load("four_bar", joints={"crank": {"effort": LIMIT}}).description
    notes = [found.sentence for found in examine(description).findings if found.weight == "note"]
    assert any(REMEDIES[0] in note for note in notes)
    motor = Motor("m", "crank", lower=-LIMIT, upper=LIMIT)
    own = ccpin.load(replace(description, motors=(motor,)), joints={"crank": {"effort": np.inf}})
    assert 'motors={"crank": {"lower": …, "upper": …}}' in too_weak(own, {"here": own.q_reference})


def test_other_motors_are_named():
    """The one that lacks most with its numbers, the others by name."""
    delta = ccpin.load("delta", joints={f"arm{k}": {"effort": 0.1} for k in (1, 2, 3)})
    assert "(nor can arm" in too_weak(delta, {"here": delta.q_reference})
