"""The compiled core's bounds against NumPy's, on random boxes about open points of every kind of closure.

No mutants are made of compiled code: its bounds are compared instead. The whole campaign is
``pytest -m slow tests/native/test_bounds_agree.py`` with CCPIN_BOXES (default 100,000) boxes.
"""

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import qr

from ccpin import backend
from ccpin.domain.closures.system import reading_of
from ccpin.native.certifier import certifier
from ccpin.proof.equations import problem_of
from ccpin.proof.newton import Boxes, bounds_of
from tests.support.closures import ARMS, KINDS, PLANAR, SPATIAL, closed_problem, two_arms

if backend().name != "native":
    pytest.skip(backend().reason, allow_module_level=True)

CAMPAIGN = int(os.environ.get("CCPIN_BOXES", "100000"))
CHUNK = 500


def random_boxes(system, rng, count):
    """Boxes of sizes from 1e-6 to 3 whose D, V, Ã, R and w are any numbers."""
    n, m, size = system.n, system.m, system.n_free
    width = 10.0 ** rng.uniform(-6, 0.5, (count, 1))
    directions = rng.normal(size=(count, size, n))
    directions[:, system.independent] = np.eye(n)
    return Boxes(
        rng.uniform(-3, 3, (count, size)),
        width * rng.uniform(0.1, 1, (count, n)),
        directions,
        rng.normal(size=(count, m, m)),
        rng.normal(size=(count, m, m)),
        width * rng.uniform(0.1, 1, (count, m)),
        rng.uniform(0.1, 1, (count, m)),
        np.full(count, 0.5),
    )


def farthest(problem, rng, count):
    """The largest relative difference of Y, Z̄R and Zw over so many boxes."""
    core, worst = certifier(problem.system, problem.phasors), 0.0
    for begin in range(0, count, CHUNK):
        boxes = random_boxes(problem.system, rng, min(CHUNK, count - begin))
        bounds = bounds_of(problem, boxes)
        image = bounds.mean(boxes.radius).of(boxes.radius)
        shrunk = bounds.contraction(boxes.radius).of(boxes.weight)
        for found, expected in zip(core.bounds(tuple(boxes)), (bounds.y, image, shrunk), strict=True):
            worst = max(worst, float((np.abs(found - expected) / np.abs(expected)).max()))
    return worst


def problems():
    """Closures of every kind between two arms of every kind, and files' in both forms."""
    rng = np.random.default_rng(8)
    for name in PLANAR:
        yield from (closed_problem(name, bounds)[0] for bounds in ("planar", "reach"))
    for name in SPATIAL:
        yield closed_problem(name, "reach")[0]
    for arms in ARMS.values():
        for kind in KINDS:
            mechanism = two_arms(arms, kind)
            system = reading_of(mechanism, mechanism.q_reference).system
            theta = rng.uniform(-0.8, 0.8, (1, mechanism.n_free))
            order = qr(certifier(system, None).values(theta)[1][0], pivoting=True)[2]
            dependent, independent = np.sort(order[: system.m]), np.sort(order[system.m :])
            yield problem_of(replace(system, dependent=dependent, independent=independent), "reach")


def assert_all_agree(total):
    """Within 5e-11: half of what the inequalities leave to rounding, and far above what another order loses."""
    rng, every = np.random.default_rng(5), list(problems())
    apart = [farthest(problem, rng, -(-total // len(every))) for problem in every]
    assert max(apart) < 5e-11, apart


def test_bounds_agree_on_a_few_boxes_of_every_kind():
    assert_all_agree(500)


@pytest.mark.slow
def test_bounds_agree_on_100_000_boxes():
    assert_all_agree(CAMPAIGN)
