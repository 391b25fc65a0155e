"""Folds and cusps of rows that are known in closed form, as searches tell them; cusps found twice are one."""

from types import SimpleNamespace

import numpy as np

from ccpin.covering import claims
from ccpin.covering.proposals import solving
from ccpin.domain.singular import cusp_points
from ccpin.domain.singular.cusp_points import Cusp, proved_cusps
from ccpin.domain.singular.folds import Folds, singular_points
from ccpin.proof.equations import Derivatives, problem_of
from tests.support.unfolded import CIRCLE, SWALLOW


def reading_of(equations):
    problem = problem_of(equations.system, "reach")
    return SimpleNamespace(problem=problem, system=problem.system, configuration=lambda theta: theta + 10.0)


def test_folds_are_told_as_they_are_proved():
    """φ = cos y − q from q = 0.9 along q = 0.9 + 2s: s = 0.05, y = 0, w = ±1; a line that goes nowhere finds none."""
    problem = reading_of(CIRCLE).problem
    found = singular_points(problem, np.array([[0.9, 0.5], [0.9, 0.4]]), np.array([[0.0], [2.0]]))
    assert found.proved.tolist() == [False, True]
    np.testing.assert_allclose(found.theta[1], [1.0, 0.0], atol=found.error[1])
    np.testing.assert_allclose(found.along[1], 0.05, atol=found.error[1])
    np.testing.assert_allclose(np.abs(found.kernel[1]), [1.0], atol=found.error[1])
    assert found.error[1] < 1e-10
    assert np.isnan(found.error[0])
    assert found.fact.claim.x.shape == (1, 3)


def test_folds_are_found_where_they_are_expected():
    """Few steps are enough from where σ and its bending say that the line meets the fold."""
    problem, theta = reading_of(CIRCLE).problem, np.array([[0.98, 0.2]])
    folds, along = Folds.near(problem, theta), np.ones((1, 1))
    found = singular_points(problem, theta, along, folds.along(folds.bending(problem, theta), along))
    assert found.proved[0]
    np.testing.assert_allclose(found.along, 0.02, atol=found.error[0])


def test_cusps_are_told_as_they_are_proved():
    """At zero, v = ±1; from nowhere there are none."""
    reading = reading_of(SWALLOW)
    assert proved_cusps(reading, np.zeros((0, 3))) == []
    (cusp,) = proved_cusps(reading, np.array([[0.02, -0.01, 0.1]]))
    np.testing.assert_allclose(cusp.q, [0.0, 0.0], atol=cusp.error)
    np.testing.assert_allclose(cusp.q_free, [10.0, 10.0, 10.0], atol=1e-14 + cusp.error)
    np.testing.assert_allclose(np.abs(cusp.kernel), [1.0], atol=cusp.error)
    assert cusp.error < 1e-9


def shifted(place):
    """Derivatives of a row that has a fold at a place, over its last but one coordinate."""

    def derive(problem, at):
        gap, size = at - place, len(place)
        slope, bent = np.zeros((len(at), 1, size)), np.zeros((len(at), 1, size, size))
        slope[:, 0, -2], slope[:, 0, -1], bent[:, 0, -1, -1] = -1.0, gap[:, -1], 1.0
        return Derivatives(0.5 * gap[:, -1:] ** 2 - gap[:, -2:-1], slope, bent, np.ones((len(at), 1, 1)))

    return derive


def test_a_search_with_other_derivatives(monkeypatch):
    """Newton's method is told of a fold where there is none: the kernel asks φ itself, and nothing is proved."""
    place = np.array([0.9, 0.4])
    monkeypatch.setattr(solving, "closure_derivatives", shifted(place))
    found = singular_points(reading_of(CIRCLE).problem, place[None] + 0.01, np.ones((1, 1)))
    np.testing.assert_allclose(found.theta[0], place, atol=1e-9)
    assert not found.proved.any()


def test_a_search_that_is_led_elsewhere(monkeypatch):
    """Unknowns altered on their way to the kernel cost a proof."""
    honest, (fold, cusp) = claims.solved, (reading_of(CIRCLE), reading_of(SWALLOW))
    start, near, along = np.array([[0.9, 0.4]]), np.array([[0.02, -0.01, 0.1]]), np.ones((1, 1))
    for k in range(3):
        monkeypatch.setattr(claims, "solved", lambda *given, k=k: honest(*given) + 0.7 * np.eye(3)[k])
        assert not singular_points(fold.problem, start, along).proved.any()
    for k in range(4):
        monkeypatch.setattr(claims, "solved", lambda *given, k=k: honest(*given) + 0.7 * np.eye(5)[k])
        assert proved_cusps(cusp, near) == []
    monkeypatch.setattr(claims, "solved", honest)
    assert singular_points(fold.problem, start, along).proved.all()
    assert len(proved_cusps(cusp, near)) == 1


def test_cusps_are_counted_once():
    """Two within 1e-6 in every coordinate, modulo 2π of angles, are one."""
    reading = SimpleNamespace(theta=lambda q_free: q_free, system=SimpleNamespace(periodic=np.array([True, False])))
    made = [Cusp(np.zeros(2), np.array(at) + [0.5, 0.25], np.zeros(1), 0.0) for at in (
        (0.0, 0.0), (2 * np.pi, 0.99e-6), (0.0, 1.01e-6), (-0.99e-6, 0.0), (0.0, 2 * np.pi), (1.01e-6, 3e-6),
    )]  # fmt: skip
    assert cusp_points.distinct(reading, made) == (made[0], made[2], made[4], made[5])
    assert cusp_points.distinct(reading, []) == ()
    far, near = made[2]._replace(error=0.6e-6), made[2]._replace(error=0.4e-6)
    assert cusp_points.distinct(reading, [made[0]._replace(error=0.5e-6), far]) == (made[0]._replace(error=0.5e-6),)
    assert len(cusp_points.distinct(reading, [made[0]._replace(error=0.5e-6), near])) == 2
