"""Searches for arrivals that go wrong: what they propose is refused, and costs a verdict, never makes a false one."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint")

from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.errors import DifferentSubjectsError
from ccpin.mechanism.assumptions import limits_left_out
from ccpin.proof.facts import NotProvedError, prove
from ccpin.validated import certify_move
from ccpin.validated.arithmetic.balls import ball
from ccpin.validated.sets import arrival, move
from ccpin.validated.sets.arrival_claim import Arrived
from tests.oracles import rpdr as oracle
from tests.support.enclosures import FREE, accurately, paper_law
from tests.support.long_cases import later
from tests.support.paper import GOAL, K_P, K_V

QUICK = {"order": 12, "tolerance": 1e-12, "pieces": 4, "precision": 64, "cells": 1, "parts": 1}
START = GOAL + [0.05, -0.05]  # where 𝒱 is 0.03 J and the level 0.05 J
FAR = GOAL + [0.15, -0.15]
SPREAD = (1e-4, 0.0)
OTHER = oracle.sigma(GOAL, -1.0)[FREE]


@pytest.fixture(scope="module")
def certificate(rpdr_model):
    """Theorem 3's, of the law with other velocity gains."""
    found = certify_law(PDSimpleGravity(rpdr_model, GOAL, K_P, 2.0 * np.array(K_V)), max_depth=4, budget=12)
    assert found.verdict == "proven"
    assert 0.04 < found.level < 0.06
    return found


@pytest.fixture(scope="module")
def certified(rpdr_model, law, certificate):
    """`certify_move` of the paper's law."""

    def told(start=START, **more):
        return certify_move(rpdr_model, law, start, **{"arrival": certificate} | QUICK | more)

    return told


@pytest.fixture(scope="module")
def honest(certified):
    found = certified()
    assert (found.verdict, found.rigorous) == ("proven", True)
    return found


@pytest.fixture(scope="module")
def honest_set(certified):
    found = certified(spread=SPREAD)
    assert (found.verdict, found.rigorous, len(found.tubes)) == ("proven", True, 1)
    return found


def test_what_is_told_of_an_arrival(rpdr_model, law, certificate, honest, honest_set):
    """The level's own; 𝒱 and T as an integrator has them; of a set what holds in its middle, and more."""
    for found in (honest, honest_set):
        assert found.level == certificate.level == found.proved.claim.level[0]
        assert found.lyapunov_start == pytest.approx(law.lyapunov(START, np.zeros(2)), abs=1e-12)
        assert found.lyapunov_start < law.lyapunov(START, np.zeros(2)) + 1e-12
        assert f"{found.time:.6g} s" in found.reason
        assert f"{found.lyapunov:.6g} J" in found.reason
        assert "caller" not in found.reason
        assert found.witness is None
        assert found.assumes == limits_left_out(rpdr_model.mechanism)
    motion = accurately(rpdr_model, law, START, None, honest.time)
    value = law.lyapunov(motion.q[-1], motion.v[-1], motion.q_free[-1])
    assert honest.lyapunov == pytest.approx(value, abs=1e-8)
    assert honest.lyapunov < honest.level
    assert honest.time == honest.enclosure.times[-1]
    assert honest_set.time == honest_set.tubes[0].duration
    assert value < honest_set.lyapunov < honest_set.level
    assert "1 tubes" in honest_set.reason


# Searches.


def connected(monkeypatch, change):
    """`connection` whose answer is changed."""
    honest_one = arrival.connection

    def told(goal, end):
        found = honest_one(goal, end)
        return found if isinstance(found, str) else change(found)

    for module in (arrival, move):
        monkeypatch.setattr(module, "connection", told)


LIES = {
    "a line that ends early": lambda found: found._replace(line=found.line[:-1]),
    "no line": lambda found: found._replace(line=()),
    "a line that begins late": lambda found: found._replace(line=found.line[1:]),
    "a line in another order": lambda found: found._replace(line=found.line[::-1]),
    "claims of a line": lambda found: found._replace(line=tuple(step.claim for step in found.line)),
    "a step for a box": lambda found: found._replace(around=found.line[0]),
    "a box that is claimed": lambda found: found._replace(around=found.around.claim),
}


@pytest.mark.parametrize("name", later(*LIES))
def test_lines_that_do_not_lead_to_the_set_point(monkeypatch, certified, name):
    monkeypatch.setattr(arrival, "_SHORTEST", 2.0**-20)
    short = arrival.march

    def march(field, here, duration, options):
        return short(field, here, duration, options._replace(longest=0.25))

    monkeypatch.setattr(arrival, "march", march)
    assert certified().verdict == "proven"
    connected(monkeypatch, LIES[name])
    found = certified()
    assert (found.verdict, found.proved, found.rigorous) == ("undecided", None, False)
    assert found.enclosure.verdict == "proven"


def test_boxes_about_the_set_point_of_another_branch(monkeypatch, certified, honest):
    """Or one so small that the line does not end in it."""
    loop, q_d = honest.equations.loop, honest.equations.q_d
    still, bits = np.zeros(2), 64
    for x in (OTHER, honest.equations.x_d):
        around = arrival.proved_start(loop, q_d, x, still, bits)
        with monkeypatch.context() as context:
            connected(context, lambda found, own=around: found._replace(around=own))
            assert certified().verdict == "undecided"


def test_values_that_are_told_too_low(monkeypatch, rpdr_model, law, certificate, certified):
    """Of 𝒱 where it is above the level; of U on the line."""
    assert law.lyapunov(FAR, np.zeros(2)) > 3.0 * certificate.level
    with monkeypatch.context() as context:
        context.setattr(arrival.Goal, "highest", lambda *_: 0.0)
        found = certified(FAR)
    assert (found.verdict, found.proved) == ("undecided", None)
    assert "not below the level" in found.reason
    with monkeypatch.context() as context:
        context.setattr(arrival.Goal, "highest", lambda *_: -1.0)
        found = certified(FAR)
    assert found.verdict == "undecided"
    assert "not below 0" in found.reason
    with monkeypatch.context() as context:
        context.setattr(arrival.LyapunovAt, "on_section", lambda *_: ball(0))
        context.setattr(arrival.Goal, "highest", lambda *_: 0.0)
        found = certified(FAR, spread=SPREAD)
    assert found.verdict == "undecided"


def test_levels_that_are_told_too_high(monkeypatch, certified, certificate):
    """Than the fact's; than the number that was given."""
    made = move.goal_of
    monkeypatch.setattr(move, "goal_of", lambda own, level, *rest: made(own, 10.0 * level, *rest))
    for more in ({}, {"arrival": 0.05}):
        found = certified(FAR, **more)
        assert (found.verdict, found.level) == ("undecided", more.get("arrival", certificate.level))
    monkeypatch.setattr(move, "goal_of", lambda own, level, sublevel, *rest: made(own, level, None, *rest))
    assert certified().verdict == "undecided"


def test_set_points_of_another_branch(monkeypatch, certified):
    """The law's configuration is named by the equations, whatever was searched from."""
    found = arrival.proved_start
    monkeypatch.setattr(arrival, "proved_start", lambda loop, q, x, *rest: found(loop, q, OTHER, *rest))
    with pytest.raises(NotProvedError, match="branch"):
        certified()


def test_motions_on_another_branch(certified):
    """However large the level."""
    assert certified(GOAL, arrival=1e3, near=OTHER, duration=0.002).verdict == "undecided"


def test_motions_that_were_not_followed(monkeypatch, certified):
    """With a step left out; that were followed to another end."""
    told = move.proved_motion
    for change in (lambda steps: steps[1:], lambda steps: steps[:-1]):
        with monkeypatch.context() as context:
            context.setattr(
                move, "proved_motion", lambda loop, start, steps, *rest, c=change: told(loop, start, c(steps), *rest)
            )
            found = certified(FAR, arrival=0.2, duration=0.5)
        assert (found.verdict, found.proved) == ("undecided", None)


@pytest.mark.slow
def test_arrivals_of_tubes_that_are_no_arrivals(monkeypatch, certified):
    """Told too early; with a line from elsewhere."""
    connected(monkeypatch, lambda found: found._replace(line=found.line[1:]))
    found = certified(spread=SPREAD)
    assert (found.verdict, found.proved) == ("undecided", None)
    assert found.lyapunov == np.inf
    assert found.tubes[0].verdict == "proven"
    assert found.time == found.tubes[0].duration > 0.0


# What is told.


def test_moves_are_about_what_was_asked(rpdr_model, certified, honest):
    """Other motions, levels, loops and facts: none is proven; what was pickled is once it is replayed."""
    other = certify_move(rpdr_model, paper_law(rpdr_model, [11.5, 11.0]), START, arrival=0.05, **QUICK)
    assert other.verdict == "proven"
    given, asked = certified(arrival=honest.level), honest.enclosure.asked
    assert (given.verdict, given.rigorous) == ("proven", False)
    assert replace(honest).verdict == "proven"
    for change in (
        {"proved": None},
        {"proved": honest.enclosure.motion},
        {"proved": honest.proved.claim},
        {"proved": honest.proved.replay()},
        {"proved": other.proved},
        {"proved": given.proved},
        {"enclosure": honest.enclosure.replay()},
        {"enclosure": replace(honest.enclosure, motion=None)},
        {"enclosure": replace(honest.enclosure, asked=asked._replace(v=asked.v + 1e-12))},
        {"enclosure": replace(honest.enclosure, times=1.5 * honest.enclosure.times)},
        {"enclosure": other.enclosure},
        {"equations": other.equations},
        {"equations": given.equations},
        {"level": np.nextafter(honest.level, 1.0)},
        {"equations": other.equations, "proved": other.proved},
        {"starts": arrival.TOO_EARLY},
    ):
        found = replace(honest, **change)
        assert (found.verdict, found.rigorous) == ("undecided", False)
        assert "not replayed" in found.reason
    assert replace(honest, without=", but").reason == honest.reason + ", but"
    assert "why" in replace(honest, proved=None, stopped="why").reason
    sent = pickle.loads(pickle.dumps(honest))
    assert (sent.verdict, sent.rigorous, sent.lyapunov, sent.lyapunov_start) == ("undecided", False, np.inf, -np.inf)
    again = sent.replay()
    assert str(again) == str(honest)
    assert (again.rigorous, again.lyapunov_start) == (True, honest.lyapunov_start)
    forged = sent.proved._replace(claim=replace(sent.proved.claim, level=10.0 * sent.proved.claim.level))
    with pytest.raises(NotProvedError, match="above the one"):
        replace(sent, proved=forged).replay()


@pytest.mark.slow
def test_sets_of_moves_are_about_what_was_asked(honest, honest_set):
    starts, tube = honest_set.starts, honest_set.tubes[0]
    for change in (
        {"proved": None},
        {"proved": honest.proved},
        {"proved": honest_set.proved.premises[1]},
        {"proved": honest_set.proved.replay()},
        {"starts": starts._replace(spread=2.0 * starts.spread)},
        {"starts": None},
        {"tubes": ()},
        {"tubes": (tube.replay(),)},
        {"equations": replace(honest_set.equations, single=False)},
        {"level": 0.5 * honest_set.level},
        {"enclosure": replace(tube.enclosure)},
        {"tubes": honest_set.tubes * 2},
    ):
        assert replace(honest_set, **change).verdict == "undecided"
    assert replace(honest, tubes=honest_set.tubes).verdict == "undecided"
    sent = pickle.loads(pickle.dumps(honest_set))
    assert (sent.verdict, sent.time, sent.lyapunov) == ("undecided", 0.0, np.inf)
    again = sent.replay()
    assert str(again) == str(honest_set)
    assert again.enclosure is again.tubes[0].enclosure
    alone = replace(sent, proved=None).replay()
    assert (alone.verdict, alone.tubes[0].verdict, alone.enclosure.verdict) == ("undecided", "proven", "proven")


# Levels.


def test_levels_are_facts_or_the_caller_s(rpdr_model, law, certificate, certified, honest):
    """What was sampled, or sent and not replayed, makes no arrival; another law's is refused."""
    sampled = certify_law(law, (GOAL - 0.1, GOAL + 0.1))
    assert sampled.level > 0.0
    for given in (sampled, pickle.loads(pickle.dumps(certificate)), replace(certificate, beta=0.0)):
        found = certified(arrival=given)
        assert (found.verdict, found.rigorous, found.level) == ("undecided", False, given.level)
        assert "not proved: certify it" in found.reason
        assert found.enclosure.verdict == "proven"
    for other in (
        PDSimpleGravity(rpdr_model, GOAL, 2.0 * K_P, K_V),
        PDSimpleGravity(rpdr_model, GOAL + 1e-9, K_P, K_V),
    ):
        with pytest.raises(DifferentSubjectsError):
            certified(arrival=certify_law(other, max_depth=2, budget=4))
    assert honest.equations.set_point.digest == certificate.sublevel.digest


def test_levels_of_other_set_points(rpdr_model, law, certificate, honest):
    """The kernel asks: of other gains, another place, or above the one that is proved; K_v is no part of it."""
    claim, (moved, goal, around, level, *line) = honest.proved.claim, honest.proved.premises
    prove(claim, moved, goal, around, level, *line)

    def refused(*premises, match=None, **change):
        with pytest.raises(NotProvedError, match=match):
            prove(replace(claim, **change), *premises)

    refused(moved, goal, around, level, *line, level=np.nextafter(claim.level, 1.0), match="above the one")
    prove(replace(claim, level=0.999 * claim.level), moved, goal, around, level, *line)
    refused(moved, goal, around, *line, match="no level")
    refused(moved, goal, around, match="no level")
    refused(moved, goal, around, level, level, *line, match="no steps")
    refused(moved, goal, level, around, *line)
    for gains, velocity, holds in ((K_P, K_V, True), (1.0001 * np.array(K_P), K_V, False)):
        other = certify_law(PDSimpleGravity(rpdr_model, GOAL, gains, velocity), max_depth=4, budget=12).sublevel
        if holds:
            assert other.digest != level.digest
            prove(replace(claim, level=0.9 * claim.level), moved, goal, around, other, *line)
        else:
            refused(moved, goal, around, other, *line, level=0.9 * claim.level, match="other equations")
    free = replace(claim.equations, set_point=None)
    refused(moved, goal, around, level, *line, equations=free, match="other equations")
    prove(Arrived(free, claim.level, claim.precision), moved, goal, around, *line)
    for change in (
        {"potential_d": claim.equations.potential_d + 1e-9},
        {"q_d": claim.equations.q_d._replace(parts=claim.equations.q_d.parts + [1e-12, 0.0])},
        {"q_d": claim.equations.q_d._replace(parts=claim.equations.q_d.parts + [[0.0, 0.0], [0.0, 1e-20]])},
        {"q_d": claim.equations.q_d._replace(radius=claim.equations.q_d.radius + [0.0, 1e-20])},
    ):
        with pytest.raises(NotProvedError, match="another set point"):
            replace(claim.equations, **change)
