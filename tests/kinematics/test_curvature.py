"""Bounds of ψ″ and ψ‴ hold anywhere in their balls."""

import numpy as np
import pytest

import ccpin
from ccpin.kinematics.curvature import Curvature, unit_of

MODELS = ["rpdr", "delta", "stewart", "planar_3rrr", "hexa", "four_bar", "slider_crank", "bennett", "sarrus"]


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_stay_below_their_bounds(name):
    """|ψ″[a, b]| and |ψ‴[a, a, b]| of each loop's rows along random unit vectors, in displaced configurations."""
    mechanism = ccpin.load(name)
    constraints, tree = mechanism.parametrization().constraints, mechanism.tree
    unit = unit_of(tree, constraints.loops)
    curvature = Curvature(tree, constraints.loops, np.full(len(constraints.loops), unit))
    slides = np.array([slide for joint in tree.joints for slide in joint.kind.slides])
    columns = np.where(slides, unit, 1.0)
    weights = [1.0 if turns else unit for loop in constraints.loops for turns in loop.rows.direction_rows]
    rng, radius, step = np.random.default_rng(81), 0.2, 1e-4
    at = constraints.value(mechanism.q_reference)
    own, shared = curvature.bounds(at, np.full(len(constraints.loops), radius)).transpose(1, 0, 2) ** 2
    second, third = np.sqrt(own + shared)
    stops = np.cumsum([loop.size for loop in constraints.loops])[:-1]

    def rate(q_free, along):
        return constraints.rate(constraints.value(q_free), along) * columns / np.array(weights)[:, None]

    closest = 0.0
    for _ in range(60):
        e, a, b = rng.normal(size=(3, mechanism.n_free))
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        q_free = mechanism.q_reference + columns * e * radius * rng.uniform() / np.linalg.norm(e)
        bent = rate(q_free, columns * a) @ b
        change = rate(q_free + step * columns * a, columns * a) - rate(q_free - step * columns * a, columns * a)
        bent_more = change @ b / (2 * step)
        sizes = [[np.linalg.norm(part) for part in np.split(each, stops)] for each in (bent, bent_more)]
        assert np.all(sizes[0] <= second)
        assert np.all(sizes[1] <= third * (1 + 1e-6) + 1e-6)
        closest = max(closest, (np.array(sizes[0]) / second).max())
    assert closest > 0.02
