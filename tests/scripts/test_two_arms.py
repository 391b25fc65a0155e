"""Combining descriptions, and two arms of example-robot-data holding one bar."""

import sys
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin.description import Link, Part, combine, read_description
from ccpin.errors import DescriptionError
from tests.oracles import descriptor
from tests.support.loading import script

ROBOTS = list(Path(sys.prefix).glob("lib/python*/site-packages/cmeel.prefix/share/example-robot-data/robots"))


def test_two_mechanisms_side_by_side():
    """Two copies under one root keep their own motions: D is block diagonal with each one's D."""
    part = read_description("rpdr")
    beside = np.eye(4)
    beside[:3, 3] = [2.0, 0.3, 0.0]
    pair = ccpin.load(
        combine("pair", {"a_": Part(part), "b_": Part(part, beside)}),
        independent=["a_joint1", "a_joint2", "b_joint1", "b_joint2"],
    )
    single, model = ccpin.ReducedModel(ccpin.load("rpdr")), ccpin.ReducedModel(pair)
    q, v = np.array([-1.7, -1.4, -1.9, -1.3]), np.array([0.3, -0.2, 0.5, 0.1])
    both, first, second = model.terms(q, v), single.terms(q[:2], v[:2]), single.terms(q[2:], v[2:])
    zero = np.zeros((2, 2))
    assert np.allclose(both.D, np.block([[first.D, zero], [zero, second.D]]), atol=1e-13)
    assert np.allclose(both.C, np.block([[first.C, zero], [zero, second.C]]), atol=1e-12)
    assert np.allclose(both.g, np.concatenate([first.g, second.g]), atol=1e-12)


def test_clashing_names_are_refused():
    """An added link that has a part's name is an error that names it."""
    with pytest.raises(DescriptionError, match="a_link1"):
        combine("pair", {"a_": Part(read_description("rpdr"))}, links=[Link("a_link1")])


@pytest.mark.skipif(not ROBOTS, reason="example-robot-data (the extra [robots]) is not installed")
def test_two_arms_and_a_bar():
    """Twelve joints, one fixed closure of rank 6: six motions, and the dynamics of the descriptor form (19)."""
    two_arms = script("two_arms")
    mechanism = ccpin.load(two_arms.two_arms(), independent=[f"left_{name}" for name in two_arms.ELBOW_UP])
    assert (mechanism.n_free, mechanism.mobility.rank, mechanism.n) == (12, 6, 6)
    assert len(mechanism.actuated) == 12
    model = ccpin.ReducedModel(mechanism)
    generator = np.random.default_rng(5)
    centre = model.alpha(mechanism.q_reference)
    for _ in range(20):
        q, v = centre + 0.1 * generator.uniform(-1, 1, 6), generator.standard_normal(6)
        u = generator.standard_normal(12)
        point = model.at(q)
        tau = mechanism.actuation.T @ u
        expected = descriptor.direct(mechanism.description, mechanism.pin_model, point.q_free, point.rho @ v, tau)[0]
        a = model.forward_dynamics(q, v, u)
        assert np.allclose(a, model.coordinates.jacobian(point.q_free) @ expected, rtol=1e-8, atol=1e-8)
        force = point.generalized_force(model.inverse_dynamics(q, v, a))
        assert np.allclose(force, point.generalized_force(u), rtol=1e-9, atol=1e-9)


@pytest.mark.skipif(not ROBOTS, reason="example-robot-data (the extra [robots]) is not installed")
def test_the_script_runs(tmp_path, capsys):
    """The example moves the bar and writes its animation."""
    script("two_arms").main(tmp_path)
    assert "simulated 1 s" in capsys.readouterr().out
    assert (tmp_path / "animation.html").stat().st_size > 100_000
