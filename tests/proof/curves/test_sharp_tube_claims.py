"""What is asked of tubes besides Theorem R, at the last bit; which are glued, by their numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof.curves import tube_claims as module
from ccpin.proof.curves.tube_claims import GluedTubes, SingularTubes
from ccpin.proof.curves.tubes import Tubes, stated
from ccpin.proof.facts import NotProvedError
from tests.support.straight_curves import PROBLEM, straighten, tubes


@pytest.fixture(autouse=True)
def _straight(monkeypatch):
    straighten(monkeypatch)


def equations(n=2):
    """Of straight curves."""
    return SimpleNamespace(system=SimpleNamespace(**vars(PROBLEM.system), n=n), problem=PROBLEM)


def claim_of(n=2, **others):
    """Three tubes, some of their arrays altered."""
    given = stated(tubes((0.0, 0.4), (0.25, 0.4), (0.5, 0.4)))
    return SingularTubes(equations(n), *given._replace(**others))


def proved(**others):
    """Which of the three are."""
    return claim_of(**others).examined().proved.tolist()


def test_tubes_are_found_with_what_follows():
    """As `certify_tubes` has it."""
    made, found = tubes((0.0, 0.4), (0.25, 0.4), (0.5, 0.4)), claim_of().examined()
    assert found.proved.all()
    for name in ("gain", "kappa", "hull"):
        np.testing.assert_array_equal(found.found[name], getattr(made, name))


def test_a_tube_runs_along_its_coordinate():
    """|t_j| = 1 and R_j = 0, to the last bit, row by row."""
    tangent, radius = claim_of().tangent.copy(), claim_of().radius.copy()
    tangent[:, 0] = [1.0, -1.0, 1.0 + 2.0**-52]
    assert proved(tangent=tangent) == [True, True, False]
    tangent[:, 0] = [1.0 - 2.0**-53, 1.0, 0.0]
    assert proved(tangent=tangent) == [False, True, False]
    radius[1, 0] = 5e-324
    assert proved(radius=radius) == [True, False, True]
    radius[2, 1] = 1e-12
    off = claim_of().theta + [0.0, 1e-6]
    assert proved(radius=radius, theta=off) == [True, False, False]


def test_tubes_are_in_x_space():
    """n′ + m coordinates, one of which is the parameter; n = 2; without premises."""
    claim = claim_of()
    wider = {name: np.pad(getattr(claim, name), ((0, 0), (0, 1))) for name in ("tangent", "radius")}
    for wrong in (
        {"n": 1}, {"n": 3}, wider, {name: getattr(claim, name)[:, :-1] for name in wider},
        {"along": np.array([0, 3, 0])}, {"along": np.array([0, 0, 4])},
    ):  # fmt: skip
        with pytest.raises(NotProvedError):
            claim_of(**wrong).examined()
    with pytest.raises(NotProvedError):
        claim.examined("a premise")
    last = claim_of(along=np.array([0, 2, 0])).examined()
    assert last.proved.tolist() == [True, False, True]


def test_tubes_are_glued_by_their_numbers(monkeypatch):
    """Each to the next, not back; numbers through all facts; none beyond the last."""
    made = tubes((0.0, 0.4), (0.25, 0.4), (0.5, 0.4), (2.0, 0.4))
    monkeypatch.setattr(module, "tubes_of", lambda equations, facts: made)
    pairs = np.array([(0, 1), (1, 2), (2, 3), (1, 0), (0, 0), (0, 2)])
    assert GluedTubes(equations(), *pairs.T).examined().proved.tolist() == [True, True, False, False, False, False]
    for wrong in ((0, 4), (4, 0)):
        with pytest.raises(NotProvedError):
            GluedTubes(equations(), *np.array([wrong]).T).examined()


def test_tubes_of_facts_are_one_behind_the_other(monkeypatch):
    """With what was found of each; none of none."""
    monkeypatch.setattr(module, "no_tubes", lambda problem: tubes((0.0, 0.4)).take(slice(0)))
    claim, facts = claim_of(), []
    for first in (0, 2):
        part = claim.take(slice(first, first + 2))
        facts.append(SimpleNamespace(claim=part, found=part.examined().found))
    both = module.tubes_of(equations(), facts)
    assert isinstance(both, Tubes)
    np.testing.assert_array_equal(both.theta, claim.theta)
    np.testing.assert_array_equal(both.hull, claim.examined().found["hull"])
    assert len(module.tubes_of(equations(), []).half) == 0
    with pytest.raises(NotProvedError):
        module.tubes_of(
            equations(), [SimpleNamespace(claim=GluedTubes(equations(), *np.zeros((2, 1), dtype=np.int64)))]
        )
