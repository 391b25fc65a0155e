"""The continuation theorem: its bounds against differences of ψ, its verdicts and strict σ against closed forms."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccpin
from ccpin import MechanismDescription
from ccpin.description import Coupling, CouplingTerm
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates, component_names
from ccpin.kinematics.parametrization import Parametrization
from tests.oracles import delta, rpdr
from tests.oracles.geometry import wrap
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.paper import MODES, to_free, to_paper
from tests.support.strategies import mechanisms

MODELS = ["rpdr", "delta", "stewart", "hexa", "planar_3rrr", "four_bar", "slider_crank", "bennett", "sarrus"]


def chart(parametrization, q_free):
    """v ↦ ψ(b ⊕ v), coordinates as steps from those of b."""
    coordinates = parametrization.coordinates
    q = coordinates.alpha(q_free)

    def psi(v):
        moved = pin.integrate(parametrization.model, q_free, v)
        return np.concatenate(
            [parametrization.constraints.residual(moved), coordinates.difference(q, coordinates.alpha(moved))]
        )

    return psi


def assert_bounded(parametrization, q_free, rng, largest=0.3):
    """`bend` is D²Ψ(0), and no second or third derivative found by differences in the box is above its bound."""
    theory, point = parametrization.continuation, parametrization.constraints.value(q_free)
    psi, size, h = chart(parametrization, q_free), parametrization.model.nv, 1e-3
    p, w = rng.normal(size=(2, size)) / np.sqrt(size)
    mixed = (psi(h * (p + w)) - psi(h * (p - w)) - psi(h * (w - p)) + psi(-h * (p + w))) / (4 * h * h)
    np.testing.assert_allclose(theory.bend(point, p) @ w, mixed, rtol=0.0, atol=1e-4)
    box, lengths, h = np.abs(rng.normal(size=size)) * largest / np.sqrt(size), theory.reaches.lengths(point), 0.02
    second, third = (bound[0] for bound in theory.reaches.bounds(lengths, box[None]))
    for _ in range(5):
        step = np.sign(rng.normal(size=size)) * box
        base = rng.uniform(-0.95, 0.95, size) * box
        here = (psi(h * step) - 2.0 * psi(0.0 * step) + psi(-h * step)) / h**2
        there = (psi(base + 2 * h * step) - 2.0 * psi(base + h * step)) / (2 * h**3)
        there += (2.0 * psi(base - h * step) - psi(base - 2 * h * step)) / (2 * h**3)
        assert np.all(np.abs(here) <= 1.001 * second + 1e-8)
        assert np.all(np.abs(there) <= 1.01 * third + 1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_bounds_of_the_models(name):
    """At configurations that need not be closed."""
    mechanism, rng = ccpin.load(name), np.random.default_rng(5)
    parametrization = mechanism.parametrization()
    for _ in range(3):
        step = 0.3 * rng.normal(size=mechanism.n_free)
        assert_bounded(parametrization, pin.integrate(mechanism.pin_model, mechanism.q_reference, step), rng)


def geared(description: MechanismDescription, rng) -> MechanismDescription:
    """With a coupling of degree four between two of its joints that hold one plain number."""
    plain = [joint.name for joint in description.joints if joint.kind in ("revolute", "prismatic")]
    terms = tuple(CouplingTerm(name, tuple(rng.normal(size=5))) for name in plain[:2])
    return replace(description, couplings=(Coupling("gear", terms),)) if len(terms) == 2 else description


@same_on_both
@settings(max_examples=20)
@given(mechanisms(), st.integers(0, 1000))
def test_bounds_of_random_mechanisms(drawn, seed):
    """Joints and closures of every kind, couplings, and single components of joints as coordinates."""
    rng = np.random.default_rng(seed)
    mechanism = ccpin.load(drawn.description)
    tree, constraints = mechanism.tree, mechanism.constraints()
    names = tuple(str(name) for name in rng.permutation(component_names(tree))[:3])
    coordinates = IndependentCoordinates(tree, names, mechanism.q_reference)
    coupled = type(constraints)(
        tree, mechanism.description.closures, geared(drawn.description, rng).couplings, reduce_planar=False
    )
    parametrization = Parametrization(coupled, coordinates, mechanism.q_reference)
    step = rng.normal(size=mechanism.n_free) * 0.3
    assert_bounded(parametrization, pin.integrate(mechanism.pin_model, mechanism.q_reference, step), rng)


def closed(mechanism, q_paper):
    """The closed point next to an oracle's configuration."""
    parametrization = mechanism.parametrization()
    return parametrization.at(to_free(mechanism, q_paper))


@pytest.mark.parametrize("mode", MODES)
def test_no_pair_of_modes_is_joined(rpdr_model, mode):
    """Two configurations of the five-bar are proved to be joined only in one mode and along a line in the domain."""
    mechanism = rpdr_model.mechanism
    continuation, rng, proved = rpdr_model.parametrization.continuation, np.random.default_rng(6), 0
    for k in range(300):
        near = rpdr.coincident_elbows() + rng.normal(size=2) * 10.0 ** rng.uniform(-5.0, 0.0)
        step = rng.normal(size=2) * 10.0 ** rng.uniform(-6.0, -0.5)
        line = near + np.linspace(0.0, 1.0, 200)[:, None] * step
        if max(rpdr.elongation(line[0]), rpdr.elongation(line[-1])) >= 1.0 - 1e-12:
            continue
        other = mode if k % 3 else -mode
        a, b = closed(mechanism, rpdr.sigma(line[0], other)), closed(mechanism, rpdr.sigma(line[-1], mode))
        if continuation.proved(a.constraints, b.constraints, b.factor, 1e-14):
            assert other == mode
            assert rpdr.elongation(line.T).max() < 1.0
            proved += 1
    assert proved > 50


@pytest.mark.parametrize("mode", later(*MODES))
def test_proved_sigma_is_the_closed_form(rpdr_model, mode):
    """Where every step is proved the five-bar's σ is (39)–(40) in the mode of `near`, or refused."""
    mechanism, rng, seen = rpdr_model.mechanism, np.random.default_rng(7), 0
    for k, start in enumerate(rpdr.random_configurations(rng, 24, mode)):
        q = rng.uniform(-np.pi, np.pi, 2) if k % 2 else start[:2] + 0.3 * rng.normal(size=2)
        blocked = rpdr.elongation(np.linspace(start[:2], q, 400).T).max()
        near = to_free(mechanism, start)
        if blocked >= 1.0:
            with pytest.raises(CcpinError):
                rpdr_model.sigma(q, near, proved=True)
        elif blocked < 0.999:
            found = to_paper(mechanism, rpdr_model.sigma(q, near, proved=True))
            np.testing.assert_allclose(wrap(found - rpdr.sigma(q, mode)), 0.0, atol=1e-9)
            seen += 1
    assert seen > 6


def test_proved_sigma_of_a_delta():
    """The platform's position is the closed form's, below and level."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    tree, rng = model.mechanism.tree, np.random.default_rng(8)
    for q in rng.uniform(-0.4, 0.7, (5, 3)):
        q_free = model.sigma(q, proved=True)
        position = [float(q_free[tree.joint(f"platform_{axis}").q][0]) for axis in "xyz"]
        np.testing.assert_allclose(position, delta.forward(q), atol=1e-9)


def test_an_open_configuration_is_closed_by_proof(rpdr_model):
    """An open configuration is joined to its closed point along a straight line of ψ, or refused."""
    mechanism, rng, seen = rpdr_model.mechanism, np.random.default_rng(9), 0
    for _ in range(30):
        q = rpdr.coincident_elbows() + rng.normal(size=2) * 0.3
        if rpdr.elongation(q) >= 0.99:
            continue
        mode = rng.choice(MODES)
        near = rpdr.sigma(q, mode) + np.append([0.0, 0.0], rng.normal(size=2) * 0.02)
        try:
            found = rpdr_model.sigma(q, to_free(mechanism, near), proved=True)
        except InvalidInputError:
            continue
        assert np.sin(rpdr.fold(to_paper(mechanism, found))) * np.sin(rpdr.fold(near)) > 0
        seen += 1
    assert seen > 6
