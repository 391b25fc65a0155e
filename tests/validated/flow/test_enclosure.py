"""Enclosures of single motions hold what integrators compute, and say where they end."""

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import ccpin
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError
from tests.oracles import rpdr as oracle
from tests.support.limp import Limp
from tests.support.singular import least_singular_value

flint = pytest.importorskip("flint")

from ccpin.validated import enclose  # noqa: E402
from ccpin.validated.arithmetic.series import values  # noqa: E402
from ccpin.validated.flow.step import start_box  # noqa: E402
from tests.support.enclosures import FREE, accurately, paper_law  # noqa: E402
from tests.support.long_cases import later  # noqa: E402
from tests.support.paper import GOAL, K_V, START  # noqa: E402

pytestmark = pytest.mark.usefixtures("precise")


@pytest.fixture(scope="module", params=later(0.05, 0.1))
def duration(request):
    """How much of the paper's move is looked at [s]."""
    return request.param


@pytest.fixture(scope="module")
def motion(rpdr_model, law, duration):
    """It by an ordinary integrator."""
    return accurately(rpdr_model, law, START, None, duration)


@pytest.fixture(scope="module")
def enclosure(rpdr_model, law, duration):
    return enclose(rpdr_model, law, START, None, duration)


def test_encloses_what_an_integrator_computes(enclosure, motion, duration):
    """Every sample of the move lies in the sharp box at its time (to the integrator's accuracy) and in the step's."""
    assert enclosure.verdict == "proven"
    assert enclosure.times[-1] >= duration
    for t, q_free, v in zip(motion.t, motion.q_free, motion.v, strict=True):
        assert enclosure.contains(t, q_free, v, tolerance=1e-9)
        k = min(np.searchsorted(enclosure.times, t, side="right") - 1, len(enclosure.steps) - 1)
        assert np.all((enclosure.q_free_lower[k] - 1e-9 <= q_free) & (q_free <= enclosure.q_free_upper[k] + 1e-9))
        assert np.all((enclosure.v_lower[k] - 1e-9 <= v) & (v <= enclosure.v_upper[k] + 1e-9))
    assert max(float(x.rad()) for x in enclosure.box(float(enclosure.times[-1]))) < 1e-13
    assert not enclosure.contains(duration, motion.q_free[-1] + 1e-8, motion.v[-1], tolerance=1e-9)


@pytest.mark.slow
def test_enclosures_of_other_orders_and_precisions_overlap(rpdr_model, law, enclosure):
    """Both hold the one exact trajectory, so their boxes meet at every time."""
    other = enclose(rpdr_model, law, START, None, 0.05, precision=192, order=22, tolerance=1e-22, pieces=5)
    for t in np.linspace(0.0, 0.05, 21):
        assert all(a.overlaps(b) for a, b in zip(enclosure.box(t), other.box(t), strict=True))


def test_determinant_bound(enclosure, motion):
    """The bound on |det ψ_q′| lies below a₃a₄|sin(q1 + q3 − q2 − q4)| at every sample, and within 30 % of it."""
    for k, (begin, end) in enumerate(zip(enclosure.times[:-1], enclosure.times[1:], strict=True)):
        inside = (begin <= motion.t) & (motion.t <= end)
        exact = np.array([abs(np.sin(oracle.fold(q[FREE]))) * oracle.A3 * oracle.A4 for q in motion.q_free[inside]])
        assert np.all(0.7 * exact < enclosure.determinant[k])
        assert np.all(enclosure.determinant[k] <= exact)
    assert enclosure.smallest_determinant == enclosure.determinant.min()


@pytest.mark.parametrize("wrong", later("mass", "gain", "branch"))
def test_a_wrong_model_does_not_contain_the_motion(rpdr, rpdr_model, law, motion, wrong):
    """A gain, a mass wrong by one part in a million, or the other assembly mode: the motion is not enclosed."""
    model, controller, near = rpdr_model, law, None
    if wrong == "gain":
        controller = paper_law(model, [11.0 * (1 + 1e-6), 11.0])
    elif wrong == "mass":
        links = tuple(
            replace(link, inertia=replace(link.inertia, mass=link.inertia.mass * (1 + 1e-6)))
            if link.name == "link3"
            else link
            for link in rpdr.description.links
        )
        model = ccpin.ReducedModel(ccpin.load(replace(rpdr.description, links=links)))
    else:
        near = oracle.sigma(START, -1.0)[FREE]
    other = enclose(model, controller, START, None, 0.05, near=near)
    k = 50
    assert motion.t[k] == pytest.approx(0.05)
    assert not other.contains(min(motion.t[k], other.times[-1]), motion.q_free[k], motion.v[k], tolerance=1e-8)


def test_a_motion_into_a_singularity_is_followed_almost_there(rpdr_model):
    """Flung towards stretched links the enclosure stops shortly before the singularity, with a reason."""
    q0, v0 = np.radians([-108.0, -72.0]), [-8.0, 8.0]
    stopped = enclose(rpdr_model, None, q0, v0, 0.5, order=20, tolerance=1e-14, shortest_step=2.0**-11)
    singular = ccpin.simulate(rpdr_model, Limp(2), q0, v0, duration=0.5, singular_rcond=3e-3)
    assert singular.status == "singular"
    assert stopped.verdict == "refuted"
    assert 0.8 * singular.t[-1] < stopped.times[-1] < singular.t[-1] + 2e-3
    assert stopped.witness.kind == "singular"
    assert np.abs(rpdr_model.mechanism.constraints().residual(stopped.witness.q_free)).max() < 1e-9
    assert least_singular_value(rpdr_model.mechanism, stopped.witness.q_free) < 10 * stopped.witness.error + 1e-9
    assert oracle.elongation(stopped.witness.q) == pytest.approx(1.0, abs=1e-8)
    assert stopped.determinant[-1] < 0.3 * stopped.determinant[0]
    assert np.all(stopped.determinant > 0)


@pytest.mark.slow
def test_energy_is_constant_along_undamped_swinging(rpdr_model):
    """Without torque the energy's ball holds the energy of the start at all times."""
    swing = enclose(rpdr_model, None, np.radians([-108.0, -120.0]), [1.0, -1.0], 0.2)
    start = swing.energy(0.0)
    assert swing.verdict == "proven"
    for t in np.linspace(0.0, 0.2, 21):
        assert swing.energy(t).contains(start.mid())
        assert swing.energy(t).rad() < 1e-14


def test_closed_loop_dissipates(enclosure, motion, law):
    """𝒱 + V(q_d) in balls decreases from step to step, by ∫q̇ᵀK_v q̇, and agrees with the law's own 𝒱."""
    steps = [values(enclosure.loop.equations.lyapunov, start_box(step.end))[0] for step in enclosure.steps]
    assert all(later < earlier for earlier, later in pairwise(steps))
    samples = [values(enclosure.loop.equations.lyapunov, enclosure.box(t))[0] for t in motion.t]
    drop = float((samples[0] - samples[-1]).mid())
    power = np.einsum("ti,i,ti->t", motion.v, K_V, motion.v)
    simpson = np.sum((power[:-2:2] + 4 * power[1:-1:2] + power[2::2]) / 3e3)
    assert drop == pytest.approx(simpson, rel=1e-6)
    own = law.lyapunov(motion.q[0], motion.v[0]) - law.lyapunov(motion.q[-1], motion.v[-1])
    assert drop == pytest.approx(own, abs=1e-9)


@pytest.mark.parametrize("name", ["slider_crank", "planar_3rrr"])
def test_other_mechanisms(name):
    """Enclosures hold the motion of mechanisms with sliding joints and with a ternary platform."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q = model.alpha(model.mechanism.q_reference)
    controller = ccpin.control.PDSimpleGravity(model, q + 0.05, np.full(model.n, 5.0), np.full(model.n, 0.5))
    found = enclose(model, controller, q, None, 0.01, order=16, tolerance=1e-14, pieces=4)
    sample = accurately(model, controller, q, None, 0.01)
    assert found.verdict == "proven"
    assert all(found.contains(*state, tolerance=1e-9) for state in zip(sample.t, sample.q_free, sample.v, strict=True))


@pytest.mark.slow
def test_the_whole_move_is_enclosed(rpdr_model, law):
    """0.6 s of the paper's move, to rest within 1e-2 rad of the goal, agrees with the integrator throughout."""
    whole = enclose(rpdr_model, law, START, None, 0.6, pieces=32)
    sample = accurately(rpdr_model, law, START, None, 0.6)
    assert whole.verdict == "proven"
    assert all(whole.contains(*state, tolerance=1e-9) for state in zip(sample.t, sample.q_free, sample.v, strict=True))
    np.testing.assert_allclose(whole.at(0.6).q_free[[0, 2]], GOAL, rtol=0, atol=1e-2)


@pytest.mark.slow
def test_a_spatial_mechanism_is_enclosed():
    """The delta robot under PD."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    q = model.alpha(model.mechanism.q_reference)
    controller = ccpin.control.PDSimpleGravity(model, q + 0.1, np.full(3, 5.0), np.full(3, 0.5))
    found = enclose(model, controller, q, None, 0.02, order=20, tolerance=1e-14, pieces=4)
    sample = accurately(model, controller, q, None, 0.02)
    assert found.verdict == "proven"
    assert all(found.contains(*state, tolerance=1e-9) for state in zip(sample.t, sample.q_free, sample.v, strict=True))


def test_scope(rpdr_model):
    """Other laws, and starts of another shape, are refused with the reason."""
    with pytest.raises(UnsupportedMechanismError, match="TorqueFunction"):
        enclose(rpdr_model, ccpin.control.TorqueFunction(lambda t, q, v: q), START, None, 0.01)
    with pytest.raises(InvalidInputError, match="shape"):
        enclose(rpdr_model, None, [0.0], None, 0.01)


@pytest.mark.parametrize(
    "bad",
    [
        {"duration": -1.0},
        {"precision": 10},
        {"order": 1},
        {"tolerance": 1e-99},
        {"pieces": 0},
        {"shortest_step": 1.0, "longest_step": 0.1},
    ],
)
def test_bad_arguments(rpdr_model, bad):
    """Arguments out of range are named."""
    arguments = {"q0": START, "v0": None, "duration": 0.01, **bad}
    with pytest.raises(InvalidInputError, match=next(iter(bad)).partition("_")[0]):
        enclose(rpdr_model, None, **arguments)


def test_python_flint_is_optional(rpdr_model, monkeypatch):
    """Without python-flint the error names the extra to install."""
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(CcpinError, match=r"ccpin\[validated\]"):
        enclose(rpdr_model, None, START, None, 0.01)
