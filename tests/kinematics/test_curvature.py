"""Bounds of ψ″ and ψ‴ over boxes against differences of ψ itself, and the proofs that rest on them."""

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.kinematics.branches import Branches
from ccpin.kinematics.curvature import Curvature
from ccpin.kinematics.linear import factorize
from tests.support.ball_joint import ball_joint

NAMES = ("rpdr", "slider_crank", "delta", "stewart", "hexa", "sarrus")


def parametrizations():
    yield from ((name, ccpin.load(name).parametrization()) for name in NAMES)
    whole = ball_joint()
    yield "ball", whole.parametrization
    description = whole.mechanism.description
    components = [f"shoulder:r{axis}" for axis in "xyz"]
    yield "ball components", ccpin.load(description, independent=components).parametrization()


CASES = list(parametrizations())


@pytest.mark.parametrize(("name", "parametrization"), CASES)
def test_bounds_hold(name, parametrization):
    """Second and third differences along random displacements, anywhere in the box, stay below the bounds."""
    rng, step = np.random.default_rng(3), 1e-3
    constraints, coordinates, model = parametrization.constraints, parametrization.coordinates, parametrization.model
    curvature, nv = Curvature(constraints, coordinates), model.nv

    def psi(q_free, e):
        moved = pin.integrate(model, q_free, e)
        return np.concatenate([constraints.residual(moved), coordinates.difference(start, coordinates.alpha(moved))])

    for _ in range(20):
        q_free = pin.integrate(model, parametrization.q_reference, rng.uniform(-0.5, 0.5, nv))
        start = coordinates.alpha(q_free)
        at = constraints.value(q_free)
        box, r, w = rng.uniform(0.01, 0.2, (3, nv))
        second, third = curvature.bounds(at, curvature.levers(at), box + 2 * step * (r + w), r[None], w[None])
        e, a, b = (rng.uniform(-1.0, 1.0, nv) * width for width in (box, r, w))
        value = {(i, j): psi(q_free, e + step * (i * a + j * b)) for i in (-2, -1, 0, 1, 2) for j in (-1, 1)}
        mixed = (value[1, 1] - value[1, -1] - value[-1, 1] + value[-1, -1]) / (4 * step**2)
        along = [value[1, j] - 2 * value[0, j] + value[-1, j] for j in (1, -1)]
        assert np.all(np.abs(mixed) <= second[0] * (1 + 1e-6) + 1e-8)
        assert np.all(np.abs(along[0] - along[1]) / (2 * step**3) <= third[0] * (1 + 1e-6) + 1e-5)


@pytest.mark.parametrize(("name", "parametrization"), CASES)
def test_a_proven_tube_is_regular_and_holds_the_solution(name, parametrization):
    """Over a proven step det ψ_q′ keeps its sign anywhere in the tube, and Newton's method ends in the box."""
    rng, proven = np.random.default_rng(4), 0
    constraints, coordinates, model = parametrization.constraints, parametrization.coordinates, parametrization.model
    branches, start = Branches(constraints, coordinates, 1e-14), parametrization.at(parametrization.q_reference)
    for _ in range(12):
        v = rng.normal(size=coordinates.n)
        step = start.rho @ (v / np.linalg.norm(v) * 10.0 ** rng.uniform(-3.0, 0.0))
        proof = branches.prove(start.constraints, start.factor, step)
        assert 0.0 < proof.part <= 1.0
        proven += proof.part == 1.0
        for s in rng.uniform(0.0, 1.0, 5):
            e = s * proof.centre + rng.uniform(-1.0, 1.0, model.nv) * proof.radius
            inside = factorize(parametrization.psi_jacobian(pin.integrate(model, start.q_free, e)))
            assert inside.rcond > 0.0
            assert inside.sign == start.factor.sign
    assert proven > 0
