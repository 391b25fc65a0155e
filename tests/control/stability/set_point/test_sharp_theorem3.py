"""What a certificate of a set point says, just where it does and does not; what is asked of a flood, and of whom."""

import copy
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point import set_point_certificate as words
from ccpin.control.stability.set_point import theorem3 as module
from ccpin.control.stability.set_point.flood import FloodLimits, Sublevel
from ccpin.control.stability.set_point.set_point_certificate import MemberCells, SampledRegion, SetPointCertificate
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError
from ccpin.proof.facts import NotProvedError
from tests.support.flat_cells import boxes_about
from tests.support.paper import GOAL, K_P, K_V


def certificate(law=None, region=None, **more):
    known = {
        "law": law, "level": 2.0, "level_domain": 3.0, "beta": 1.0, "slope": 1.0, "gain": 4.0, "stiffness": 2.0,
        "rigorous": True, "method": "", "limit": "domain", "touch": np.zeros(2), "proved": 3,
        "_region": region,
    }  # fmt: skip
    return SetPointCertificate(**known | more)


@pytest.fixture(scope="module")
def laws():
    """Two laws that differ in K_v alone."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    return [PDSimpleGravity(model, GOAL, K_P, gain) for gain in (K_V, 2.0 * K_V)]


@pytest.fixture(scope="module")
def known(laws):
    """What a few cells prove of the first."""
    found = replace(certify_law(laws[0], max_depth=4, budget=12), gain=4.0, slope=1.0, stiffness=2.0)
    assert found.verdict == "proven"
    return found


@pytest.mark.parametrize(
    ("given", "verdict"),
    [
        ({}, "proven"), ({"rigorous": False}, "undecided"),
        ({"level": 0.0}, "undecided"), ({"level": 1e-300}, "undecided"), ({"beta": 0.0}, "undecided"),
        ({"_region": None}, "undecided"),
        ({"stiffness": -0.95e-9 * 4.0}, "proven"), ({"stiffness": -1.05e-9 * 4.0}, "refuted"),
        ({"stiffness": -3.0}, "refuted"), ({"slope": (1 + 0.95e-9) * 4.0}, "proven"),
        ({"slope": (1 + 1.05e-9) * 4.0}, "refuted"), ({"slope": 2.1}, "proven"), ({"slope": 3.9}, "proven"),
        ({"slope": 4.3}, "refuted"), ({"slope": 9.0, "_region": None}, "refuted"),
    ],
)  # fmt: skip
def test_verdicts_on_set_points(known, given, verdict):
    """Proven where a fact says so; refuted where at q_d K_p + ∂g/∂q is not positive definite or ‖∂g/∂q‖ not below k."""
    assert replace(known, **given).verdict == verdict


def test_facts_of_other_things(known, laws):
    """A fact about another law, a premise, what a file has, and a claim are no facts about this one."""
    other, region = certify_law(laws[1], max_depth=4, budget=12), known._region
    assert other.level == known.level
    assert replace(known, law=laws[1]).verdict == "undecided"
    told = pickle.loads(pickle.dumps(known.sublevel))
    for fact, verdict in (
        (other.sublevel, "undecided"), (known.sublevel.premises[0], "undecided"), (told, "undecided"),
        (told.claim, "undecided"), (None, "undecided"), (known.sublevel.replay(), "proven"), (told.replay(), "proven"),
    ):  # fmt: skip
        assert replace(known, _region=replace(region, sublevel=fact)).verdict == verdict


def test_certificates_that_were_sent(known):
    """Undecided until they are replayed, whatever was asked of them before; copied they are what they were."""
    assert known.verdict == "proven"
    sent = pickle.loads(pickle.dumps(known))
    assert sent.verdict == "undecided"
    again = sent.replay()
    assert (again.verdict, str(again)) == ("proven", str(known))
    assert copy.deepcopy(known).verdict == "proven"
    sampled = replace(known, _region=None)
    assert sampled.replay() is sampled


def test_what_is_assumed_of_a_mechanism(monkeypatch):
    monkeypatch.setattr(words, "limits_left_out", lambda mechanism: ("limits",))
    monkeypatch.setattr(words, "mass_assumed", lambda mechanism: ("mass",))
    law = SimpleNamespace(model=SimpleNamespace(mechanism=None))
    assert certificate(law).assumes == ("limits", "mass")


def test_states_from_which_motions_converge(monkeypatch):
    """Where a configuration of the branch is known and 𝒱 is below the level."""
    monkeypatch.setattr(words, "checked_q", lambda _, q: np.asarray(q, float))
    law = SimpleNamespace(
        model=SimpleNamespace(coordinates=None, n=2), lyapunov=lambda q, v, near: float(q[0] + v[1] + near[0])
    )
    region = SimpleNamespace(near=lambda q: None if q[1] > 0.0 else np.array([1.0]))
    one = certificate(law, region)
    for q, v, held in (
        ([0.5, 0.0], None, True), ([0.99, 0.0], None, True), ([1.0, 0.0], None, False), ([1.5, 0.0], None, False),
        ([0.5, 1.0], None, False), ([0.5, 0.0], [0.0, 0.4], True), ([0.5, 0.0], [0.0, 0.6], False),
    ):  # fmt: skip
        assert one.contains(q, v) is held
    assert certificate(law, None).contains([0.0, 0.0]) is False


def test_configurations_of_the_cell_that_holds_a_point(monkeypatch):
    """From its own centre, of cells in which {U < c} is 𝒬; none where no such cell holds it."""
    monkeypatch.setattr(words, "predict", lambda problem, box, delta: np.hstack([box.centre[:, :2] + delta, delta]))
    reading = SimpleNamespace(
        problem=None,
        system=SimpleNamespace(independent=np.array([0, 1])),
        configuration=lambda theta: theta,
    )
    boxes = boxes_about([(4.0, 0.5), (0.5, 0.5), (2.0, 0.5)], [[1.0, 1.0]] * 3)
    claim = SimpleNamespace(
        lower=np.array([[3.0, 0.0], [0.0, 0.0], [1.0, 0.0]]), upper=np.array([[5.0, 1.0], [1.0, 1.0], [3.0, 1.0]])
    )
    solutions = SimpleNamespace(claim=SimpleNamespace(boxes=boxes))
    found = {"within": np.array([False, True, True])}
    members = MemberCells(reading, SimpleNamespace(found=found, claim=claim, premises=(solutions,)))
    np.testing.assert_array_equal(members.lower, [[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_array_equal(members.upper, [[1.0, 1.0], [3.0, 1.0]])
    np.testing.assert_allclose(members.near(np.array([2.5, 0.25])), [2.5, 0.25, 0.5, -0.25])
    np.testing.assert_allclose(members.near(np.array([0.25, 1.0])), [0.25, 1.0, -0.25, 0.5])
    for outside in ([2.0, 1.5], [4.0, 0.5]):
        assert members.near(np.array(outside)) is None


def test_configurations_in_a_sampled_region():
    """From q_d, where q is inside and σ is found."""

    def sigma(q, near):
        if q[0] == 1.5:
            raise CcpinError
        return near + q

    law = SimpleNamespace(q_free_d=np.array([10.0, 20.0]), model=SimpleNamespace(sigma=sigma))
    region = SampledRegion(law, np.array([1.0, -1.0]), np.array([2.0, 3.0]))
    np.testing.assert_array_equal(region.near(np.array([1.0, 3.0])), [11.0, 23.0])
    for q in ([1.5, 0.0], [0.9, 0.0], [2.1, 0.0], [1.2, -1.1], [1.2, 3.1], [0.0, 9.0], [3.0, 4.0]):
        assert region.near(np.array(q)) is None


# What is asked of a flood.

GRAVITY = np.array([[-1.0, 0.5], [0.5, 2.0]])
GAINS = np.diag([4.0, 6.0])


@pytest.fixture
def asked(monkeypatch):
    """`certify_law` with floods that tell what is given."""
    told = SimpleNamespace(found=[], floods=[], proved=7, asked=[], fact=lambda: fact(1.25, 3.0))

    class Told:
        def __init__(self, store, good, budget, go_on):
            told.floods.append((good, budget))
            assert go_on(SimpleNamespace())

        def run(self, q_d):
            return told.found[len(told.floods) - 1]

    class Atlas(SimpleNamespace):
        pass

    store = SimpleNamespace(proved=told.proved, reading="reading")
    monkeypatch.setattr(module, "Flood", Told)
    monkeypatch.setattr(module, "Atlas", Atlas)
    monkeypatch.setattr(module, "require_certifiable", lambda law: None)
    monkeypatch.setattr(module, "require_about", lambda *_: None)
    monkeypatch.setattr(module, "cells_around", lambda *_: store)
    monkeypatch.setattr(module, "cells_of_atlas", lambda *_: store)
    monkeypatch.setattr(module, "equations_of", lambda law, reading, _: (law, reading))
    monkeypatch.setattr(module, "proved_of_cells", lambda kind, *given: told.asked.append(given) or told.fact())
    monkeypatch.setattr(module, "_sampled", lambda *_: "sampled")
    monkeypatch.setattr(words, "too_weak", lambda mechanism, poses, free: f"{mechanism} {free}")
    told.atlas = Atlas(boxes=SimpleNamespace(kappa=np.zeros(5)))
    told.law = SimpleNamespace(
        model=SimpleNamespace(gravity_derivative=lambda *_: GRAVITY, n=2, mechanism="motors", free_system="give way"),
        q_d=np.zeros(2), q_free_d=None, K_p=GAINS,
    )  # fmt: skip
    return told


def sublevel(level, limit):
    return Sublevel(level, (1, 2) if level else (), limit, np.array([1.0, 2.0]))


def fact(level, beta):
    return SimpleNamespace(found={"level": np.array([level]), "beta": np.array([beta])})


def well(beta, effort):
    return SimpleNamespace(beta=beta, effort=effort)


def test_certificates_of_levels(asked):
    """The level and β that were proved of the members; k, and at q_d what K_p + ∂g/∂q and ‖∂g/∂q‖₂ are."""
    asked.found = [sublevel(1.5, "domain")]
    made = certify_law(asked.law)
    assert (made.level, made.level_domain, made.beta, made.limit, made.rigorous) == (1.25, 1.5, 3.0, "domain", True)
    (((law, reading), store, members),) = asked.asked
    assert (law, reading, store.proved, members) == (asked.law, "reading", 7, (1, 2))
    assert (made._region.reading, made.sublevel.found["level"][0]) == ("reading", 1.25)
    assert made.gain == 4.0
    assert made.stiffness == pytest.approx(np.linalg.eigvalsh(GAINS + GRAVITY)[0], rel=1e-12)
    assert made.slope == pytest.approx(np.linalg.norm(GRAVITY, 2), rel=1e-12)
    assert made.proved == 7
    assert len(asked.floods) == 1


def test_levels_that_are_not_found_or_not_proved(asked):
    """Nothing is known of them but what is so at q_d; that one was refused is said."""
    asked.found = [sublevel(0.0, "domain")]
    made = certify_law(asked.law)
    assert (made.level, made.limit, made.sublevel, made._region, asked.asked) == (0.0, "domain", None, None, [])
    assert made.beta == pytest.approx(np.linalg.norm(GRAVITY, 2), rel=1e-12)
    asked.floods.clear()
    asked.found = [sublevel(1.5, "domain")]

    def refuse():
        raise NotProvedError

    asked.fact = refuse
    made = certify_law(asked.law)
    assert (made.level, made.level_domain, made.limit, made.sublevel, made._region) == (0.0, 1.5, "refused", None, None)
    assert made.beta == pytest.approx(np.linalg.norm(GRAVITY, 2), rel=1e-12)
    assert "did not hold" in made.reason
    assert made.reason.endswith("; efforts are taken as unlimited, and motors give way")


def test_members_are_good_where_the_gain_condition_holds_and_motors_have_a_grip(asked):
    asked.found = [sublevel(1.5, "domain")]
    certify_law(asked.law)
    good = asked.floods[0][0]
    assert good(well(3.99, 1.0))
    assert good(well(3.99, 1e-300))
    for wrong in (well(4.0, 1.0), well(6.0, 1.0), well(3.0, 0.0), well(3.0, -1.0), well(9.0, -1.0)):
        assert not good(wrong)


@pytest.mark.parametrize("limit", ["gain", "depth"])
def test_levels_whatever_the_gains(asked, limit):
    """A second flood, of cells where motors have a grip, with as many cells more; at least the first level."""
    for second, expected in ((2.5, 2.5), (1.0, 1.5)):
        asked.floods.clear()
        asked.found = [sublevel(1.5, limit), sublevel(second, "domain")]
        made = certify_law(asked.law, max_depth=3, budget=11)
        assert (made.level, made.level_domain) == (1.25, expected)
        (_, first), (good, more) = asked.floods
        assert (first, more) == (FloodLimits(3, 11), FloodLimits(3, 11 + 7))
        assert good(well(99.0, 1e-300))
        assert not good(well(1.0, 0.0))
        assert not good(well(1.0, -1.0))


def test_budgets_of_floods(asked):
    """By the number of coordinates, and as many more as an atlas brings; a region is sampled."""
    asked.found = [sublevel(1.5, "domain")] * 2
    certify_law(asked.law)
    made = certify_law(asked.law, asked.atlas)
    assert [budget for _, budget in asked.floods] == [FloodLimits(14, 2000), FloodLimits(14, 2005)]
    assert "5 boxes" in made.method
    assert certify_law(asked.law, (np.zeros(2), np.ones(2))) == "sampled"


def law(kind="pd", plural=False, elsewhere=False, scalar=True, constant=True):
    joint = SimpleNamespace(kind=SimpleNamespace(nv=3 if plural else 1))
    tree = SimpleNamespace(joint=lambda name: joint, split=lambda name: (name, None))
    mechanism = SimpleNamespace(
        name="m", actuated=("c", "b") if elsewhere else ("a", "b"), independent=("a", "b"), tree=tree
    )
    coordinates = SimpleNamespace(scalar=scalar, constant=constant)
    return SimpleNamespace(kind=kind, model=SimpleNamespace(mechanism=mechanism, coordinates=coordinates))


def test_what_the_theorem_is_about(monkeypatch):
    """PD with constant gravity, plain coordinates; motors of one freedom, where they are elsewhere."""
    monkeypatch.setattr(module, "kind_of", lambda one: one.kind)
    for fine in (law(), law(plural=True), law(elsewhere=True)):
        module.require_certifiable(fine)
    with pytest.raises(InvalidInputError):
        module.require_certifiable(law("pd_gravity"))
    for wrong in (law(plural=True, elsewhere=True), law(scalar=False), law(constant=False)):
        with pytest.raises(UnsupportedMechanismError):
            module.require_certifiable(wrong)
