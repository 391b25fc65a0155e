"""Witnesses against σ: only singular configurations of which the kernel makes facts, on the branch that was walked."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from ccpin.domain.paths import refutation as module
from ccpin.domain.paths.walker import Walker
from ccpin.proof.equations import problem_of
from ccpin.proof.facts import NotProvedError, prove
from tests.support.unfolded import CIRCLE

PROBLEM = problem_of(CIRCLE.system, "reach")
READING = SimpleNamespace(configuration=lambda theta: theta + 10.0)


def walked(end=0.6, side=1.0):
    """φ = cos y − q followed from q = ½ to an end on the upper branch, or the lower one."""
    pieces = PPoly(np.array([[[end - 0.5]], [[0.5]]]), np.array([0.0, 1.0]))
    walker = Walker(PROBLEM, pieces, np.zeros(1), np.array([0.5, side * np.pi / 3]))
    assert walker.walk() is None
    return walker


def targets(*q):
    return [np.array([x]) for x in q]


@pytest.mark.parametrize("steps", [0, 1, 99])
def test_a_fold_ahead_of_the_walker_is_a_witness(steps):
    """With q, the configuration and how near it is, from the walk's end or before; the fold is at q = 1, y = 0."""
    walker = walked()
    before = walker.back(min(steps, len(walker.times) - 1))
    witness = module.singular_witness(before, READING, targets(0.6, 0.5, 0.9, 1.5))
    assert witness.kind == "singular"
    np.testing.assert_allclose(witness.q, [1.0], atol=witness.error)
    np.testing.assert_allclose(witness.q_free, [11.0, 10.0], atol=witness.error)
    assert witness.error < 1e-9
    assert module.singular_witness(before, READING, targets(0.9, 0.99, 0.2)) is None
    assert module.singular_witness(before, READING, [before.theta[:1]]) is None


def test_errors_are_those_of_the_fact(monkeypatch):
    """As it has them, and where."""
    walker = walked()
    told = SimpleNamespace(found={"theta": np.array([[3.0, 4.0]]), "error": np.array([0.25])})
    monkeypatch.setattr(module, "_on_branch", lambda *_: told)
    witness = module.singular_witness(walker, READING, targets(1.5))
    assert (witness.q.tolist(), witness.q_free.tolist(), witness.error) == ([3.0], [13.0, 14.0], 0.25)


def test_nothing_is_told_without_facts(monkeypatch):
    """Nor of a point that the walk is not proved to lead to."""
    walker = walked()
    for name, nothing in (("_on_branch", None), ("_join", None)):
        with monkeypatch.context() as patched:
            patched.setattr(module, name, lambda *_, nothing=nothing: nothing)
            assert module.singular_witness(walker, READING, targets(1.5)) is None
    monkeypatch.setattr(Walker, "leads_to", lambda self, point: False)
    assert module.singular_witness(walker, READING, targets(1.5)) is None


def test_a_search_that_goes_wrong(monkeypatch):
    """Boxes of q-space that are not proved, curves on other lines and that end before the fold."""
    honest, walker = module.certify_boxes, walked()
    with monkeypatch.context() as patched:
        patched.setattr(
            module,
            "certify_boxes",
            lambda *given: SimpleNamespace(boxes=(found := honest(*given).boxes)._replace(radius=1e-3 * found.radius)),
        )
        assert module._join(walker) is None
    with monkeypatch.context() as patched:
        line = module.line_problem
        patched.setattr(module, "line_problem", lambda problem, theta, d, j: line(problem, theta, d, 0))
        assert module.singular_witness(walker, READING, targets(1.5)) is None
    with monkeypatch.context() as patched:
        patched.setattr(module, "_BEYOND", -0.5)
        assert module.singular_witness(walker, READING, targets(1.5)) is None
    with monkeypatch.context() as patched:
        patched.setattr(module, "prove", lambda claim, *premises: refuse())
        assert module.singular_witness(walker, READING, targets(1.5)) is None
    other, there = walked(side=-1.0), walker.theta
    walker.theta = other.theta
    assert module.singular_witness(walker, READING, targets(1.5)) is None
    walker.theta = there
    assert module.singular_witness(walker, READING, targets(1.5)) is not None


def refuse():
    raise NotProvedError("")


def test_where_a_walk_leads_is_a_fact(monkeypatch):
    """Its end's point, or the start's where it has not gone; not another branch's, nor another place."""
    walker, other = walked(), walked(side=-1.0)
    still = walker.back(len(walker.times) - 1)
    assert still.point_here() is walker.start
    assert still.leads_to(walker.start)
    assert not still.leads_to(other.start)
    assert walker.leads_to(walker.point_here())
    for point in (walker.start, other.point_here(), walker.back(1).point_here()):
        assert not walker.leads_to(point)
    assert prove(walker.proved().claim, *walker.proved().premises)
    monkeypatch.setattr(Walker, "proved", lambda self: None)
    assert not walker.leads_to(walker.point_here())
