"""Claims about levels that are forged: misshapen, altered, with borrowed premises, about other laws and mechanisms."""

import pickle
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.control.stability.set_point.potential import potential_values
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.proof.equations import Closures, closure_values
from ccpin.proof.facts import Fact, NotProvedError, prove, prove_some
from tests.support.paper import GOAL, K_P, K_V
from tests.support.refusals import refused

SPRINGS = {"joint3": {"stiffness": 2.0, "spring_reference": 0.4}}


def certified(name="rpdr", gain=K_P, **more):
    model = ccpin.ReducedModel(ccpin.load(name, **more))
    found = certify_law(PDSimpleGravity(model, GOAL, gain, K_V), max_depth=4, budget=12)
    assert found.verdict == "proven"
    return found


@pytest.fixture(scope="module")
def known():
    """The fact about a few cells."""
    return certified().sublevel


@pytest.fixture(scope="module")
def sprung():
    """The same with a spring on an elbow."""
    return certified(joints=SPRINGS, gain=3.0 * K_P).sublevel


MISSHAPEN = {
    "a cell too few": {"lower": lambda x: x[1:], "upper": lambda x: x[1:]},
    "a corner too few": {"upper": lambda x: x[:-1]},
    "a coordinate too few": {"lower": lambda x: x[:, :1], "upper": lambda x: x[:, :1]},
    "single precision": {"lower": lambda x: x.astype(np.float32)},
    "words": {"upper": lambda x: x.astype(str)},
    "no number": {"lower": lambda x: x * np.nan},
    "without end": {"upper": lambda x: x + np.inf},
    "no cells": {"lower": lambda x: x[:0], "upper": lambda x: x[:0]},
    "corners exchanged": {"lower": lambda x: x + 1.0, "upper": lambda x: x - 1.0},
    "cells in another order": {"lower": lambda x: x[::-1], "upper": lambda x: x[::-1]},
    "wider cells": {"upper": lambda x: x + 1e-9},
    "all of it moved": {"lower": lambda x: x + 0.3, "upper": lambda x: x + 0.3},
}


@pytest.mark.parametrize("name", MISSHAPEN)
def test_no_fact_comes_of_other_cells(known, name):
    change = {side: alter(getattr(known.claim, side).copy()) for side, alter in MISSHAPEN[name].items()}
    refused(lambda: replace(known.claim, **change), *known.premises)


def test_smaller_cells_prove_less(known):
    """A cell cut at one end leaves a gap: the level is lower, or none."""
    for k in range(len(known.claim.lower)):
        upper = known.claim.upper.copy()
        upper[k] -= 0.1 * (known.claim.upper[k] - known.claim.lower[k])
        try:
            level = prove(replace(known.claim, upper=upper), *known.premises).found["level"][0]
        except NotProvedError:
            level = 0.0
        assert level <= known.found["level"][0]


def test_premises_are_about_these_boxes_and_closures(known, sprung):
    """Not another mechanism's, nor the same ones proved again, without those that were glued."""
    solutions, *glue = known.premises
    again = solutions.replay()
    for premises in ((), glue, (again, *glue), sprung.premises, (known,), (solutions, known), (solutions.claim, *glue)):
        refused(lambda: known.claim, *premises)
    with suppress(NotProvedError):
        assert prove(known.claim, again).found["level"][0] < known.found["level"][0]
    refused(lambda: replace(known.claim, equations=sprung.claim.equations), *known.premises)
    for claim, premises in (
        (replace(known.claim, equations=known.claim.equations.closures), known.premises),
        (replace(solutions.claim, equations=known.claim.equations), ()),
    ):
        with pytest.raises((NotProvedError, AttributeError)):
            prove(claim, *premises)


def test_kinds_that_the_kernel_does_not_know(known):
    class Generous(SublevelProved):
        def examined(self, *premises):
            return super().examined(*premises)

    class Easy(SetPointEquations):
        gain = 1e9

    class Wide(Closures):
        pass

    equations = known.claim.equations
    refused(lambda: Generous(equations, known.claim.lower, known.claim.upper), *known.premises)
    easy = Easy(equations.closures, equations.masses, equations.theta, equations.law)
    refused(lambda: replace(known.claim, equations=easy), *known.premises)
    with pytest.raises(NotProvedError):
        replace(equations, closures=Wide(equations.closures.system))


def test_it_is_one_claim_and_comes_back_from_a_file(known):
    fact, rows = prove_some(known.claim, *known.premises)
    assert (type(fact), rows.tolist()) == (Fact, [True])
    told = pickle.loads(pickle.dumps(known))
    assert type(told) is not Fact
    again = told.replay()
    assert again.digest == known.digest
    assert all(np.array_equal(again.found[name], known.found[name]) for name in known.found)
    with pytest.raises(NotProvedError):
        told._replace(claim=replace(told.claim, upper=told.claim.upper + 1e-9)).replay()


def test_digests_tell_laws_and_mechanisms_apart(known, sprung):
    """Every number counts."""
    own = known.claim.equations
    assert own.sizes == own.closures.sizes
    heavier = own.masses.chains[0]._replace(weights=own.masses.chains[0].weights * (1.0 + 1e-13))
    others = [
        replace(own, law=own.law._replace(K_v=2.0 * own.law.K_v)),
        replace(own, law=own.law._replace(K_p=2.0 * own.law.K_p)),
        replace(own, law=own.law._replace(gravity_d=own.law.gravity_d * (1.0 + 1e-12))),
        replace(own, law=own.law._replace(motors=np.eye(4)[:2])),
        replace(own, masses=own.masses._replace(chains=(heavier, *own.masses.chains[1:]))),
        replace(own, masses=own.masses._replace(rest=own.masses.rest + 1.0)),
        sprung.claim.equations,
    ]
    digests = {one.digest for one in (own, *others)}
    assert len(digests) == 1 + len(others)
    assert replace(own).digest == own.digest


def test_what_they_hold_is_sealed(known):
    own = known.claim.equations
    arrays = (own.theta, own.law.K_p, own.law.gravity_d, own.masses.stiffness, own.masses.rest)
    for array in (*arrays, own.masses.chains[0].weights, own.masses.chains[0].tip):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


# What equations may be: each hypothesis that they answer for, just kept and just not.


def with_law(own, **changes):
    return replace(own, law=own.law._replace(**changes))


def with_masses(own, **changes):
    return replace(own, masses=own.masses._replace(**changes))


def with_chain(own, **changes):
    return with_masses(own, chains=(own.masses.chains[0]._replace(**changes), *own.masses.chains[1:]))


def out_of(values, k, value):
    changed = np.array(values, dtype=float)
    changed[k] = value
    return changed


K = np.array([[4.0, 1.0], [1.0, 4.0]])
NONE = {
    "gains that are not symmetric": lambda own: with_law(own, K_p=K + [[0.0, 1e-15], [0.0, 0.0]]),
    "dampers that are not symmetric": lambda own: with_law(own, K_v=K + [[0.0, 1e-15], [0.0, 0.0]]),
    "gains that are not positive": lambda own: with_law(own, K_p=np.diag([1.0, 0.0])),
    "dampers that are not positive": lambda own: with_law(own, K_v=np.diag([-1.0, 1.0])),
    "gains of another size": lambda own: with_law(own, K_p=np.eye(3)),
    "dampers of another size": lambda own: with_law(own, K_v=np.eye(1)),
    "gains in a row": lambda own: with_law(own, K_p=np.ones(2)),
    "a set point of another size": lambda own: with_law(own, q_d=np.zeros(3)),
    "gravity of another size": lambda own: with_law(own, gravity_d=np.zeros(1)),
    "gravity that is no number": lambda own: with_law(own, gravity_d=np.full(2, np.nan)),
    "gains without end": lambda own: with_law(own, K_p=np.diag([np.inf, 1.0])),
    "motors in a row": lambda own: with_law(own, motors=np.ones(4)),
    "too few motors": lambda own: with_law(own, motors=np.ones((1, 4))),
    "another set point": lambda own: with_law(own, q_d=own.law.q_d + 1e-15),
    "a configuration elsewhere": lambda own: replace(own, theta=out_of(own.theta, 1, own.theta[1] + 0.1)),
    "a configuration of another size": lambda own: replace(own, theta=own.theta[:-1]),
    "a configuration that is no number": lambda own: replace(own, theta=out_of(own.theta, 1, np.nan)),
    "springs of another size": lambda own: with_masses(own, stiffness=np.zeros(3)),
    "rests of another size": lambda own: with_masses(own, rest=np.zeros(5)),
    "springs that are no numbers": lambda own: with_masses(own, stiffness=np.full(4, np.nan)),
    "rests that are no numbers": lambda own: with_masses(own, rest=np.full(4, np.inf)),
    "a spring on a circle": lambda own: with_masses(own, stiffness=out_of(np.zeros(4), 1, 1e-300)),
    "no bodies": lambda own: with_masses(own, chains=()),
    "a body that is a direction": lambda own: with_chain(own, direction=True),
    "a body of two rows": lambda own: with_chain(own, weights=np.ones((2, 3))),
    "an axis that is not of unit length": lambda own: with_chain(own, axes=1.1 * own.masses.chains[0].axes),
    "a heavier body": lambda own: with_chain(own, weights=1.01 * own.masses.chains[0].weights),
    "a circle that slides": lambda own: with_masses(
        own, chains=tuple(c._replace(prismatic=np.ones_like(c.prismatic)) for c in own.masses.chains)
    ),
}


@pytest.mark.parametrize("name", NONE)
def test_equations_that_are_none(known, name):
    with pytest.raises(NotProvedError):
        NONE[name](known.claim.equations)


def test_equations_that_are_some(known, sprung):
    """A spring on what is no circle to the closures, on q, or elsewhere if no turn is taken out there."""
    own = known.claim.equations
    for fine in (
        with_law(own, K_p=K), with_law(own, K_v=K), with_law(own, motors=np.ones((2, 4))),
        with_law(own, motors=np.ones((3, 4))), with_law(own, K_v=np.diag([1e-300, 1.0])),
    ):  # fmt: skip
        assert fine.gain == pytest.approx(3.0 if fine.law.K_p[0, 1] else 11.0)
    with pytest.raises(NotProvedError, match="a spring that pushes"):
        with_masses(sprung.claim.equations, stiffness=out_of(sprung.claim.equations.masses.stiffness, 1, -1e-300))
    assert with_masses(own, stiffness=np.zeros(4), rest=np.ones(4)).law is not None


@pytest.mark.parametrize("name", ["gravity_d", "potential_d"])
def test_what_the_law_has_of_gravity_is_its_mechanisms(known, name):
    """To 1e-8 of the sizes that it is added from, no more."""
    own = known.claim.equations
    size = own.potential.magnitude(own.theta[None])[0]
    if name == "gravity_d":
        system, at = own.closures.system, own.theta
        slope = potential_values(own.potential, at[None]).gradient[0]
        phi = closure_values(own.closures.problem, at[None])[1][0]
        rho = np.abs(np.linalg.inv(phi[:, system.dependent]) @ phi[:, system.independent])
        size = size + np.abs(slope[system.independent]) + np.abs(slope[system.dependent]) @ rho
    else:
        size = np.array([size])
    for k, sign in ((k, sign) for k in range(len(size)) for sign in (-1.0, 1.0)):
        for share, held in ((0.95e-8, True), (1.05e-8, False)):
            value = np.atleast_1d(np.array(getattr(own.law, name), dtype=float))
            value[k] += sign * share * size[k]
            told = {name: value if name == "gravity_d" else float(value[0])}
            if held:
                with_law(own, **told)
                continue
            with pytest.raises(NotProvedError):
                with_law(own, **told)
