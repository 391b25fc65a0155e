"""Simulated motions and how they change: beside exact derivatives, SciPy's integrator, and runs of changed robots."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.errors import InvalidInputError
from ccpin.identification import identify, with_constants
from ccpin.identification.calibration.geometry_numbers import changed_mechanism
from ccpin.identification.estimates.shooting import MotionShot, VariedPlant, accelerations, followed

LENGTH = ("origin", "joint3/x")
STEP = 1e-6


def longer(model, by):
    """Another length between two hinges."""
    own = float(model.mechanism.tree.joint("joint3").stated.placement[0, 3])
    return ccpin.ReducedModel(changed_mechanism(model.mechanism, {LENGTH: own + by}), model.gravity_vector)


@pytest.fixture(scope="module")
def plant(bench):
    """The RPDR; what may change are three constants and a length."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint4": {"damping": 0.01}}))
    tangent = np.zeros((len(model.parameters), 3))
    tangent[[model.parameters.names.index(name) for name in ("mx:link3", "Iyy:link2", "damping:joint4")], range(3)] = 1
    return VariedPlant(model, model.parameters.values, tangent, ((longer(model, STEP), longer(model, -STEP)),), (STEP,))


@pytest.fixture(scope="module")
def shots(plant):
    """Two motions of different length under efforts that change."""
    t = np.arange(0.0, 0.0101, 2e-3)

    def efforts(t):
        return 0.2 * np.column_stack([np.sin(20.0 * t), np.cos(15.0 * t)])

    nothing = np.full((len(t), plant.model.n), np.nan)
    whole = MotionShot(t, nothing, efforts(t), efforts((t[1:] + t[:-1]) / 2.0))
    return efforts, [whole, MotionShot(t[:3], nothing[:3], whole.u[:3], whole.between[:2])]


@pytest.fixture(scope="module")
def starts(plant):
    q = plant.model.alpha(plant.model.mechanism.q_reference)
    return np.array([[*q, 0.5, -0.8], [*(q + 0.05), -0.4, 0.9]])


def test_accelerations_and_their_derivatives_are_the_models_own(plant, starts):
    model, draw = plant.model, np.random.default_rng(0)
    Q, V, U = starts[:, :2], starts[:, 2:], draw.normal(size=(2, 2))
    a, by_state, by_numbers = accelerations(plant, Q, V, U)
    assert np.allclose(a, model.forward_dynamics_many(Q, V, U), rtol=1e-10)
    exact = model.forward_dynamics_derivatives_many(Q, V, U)
    assert np.allclose(by_state, np.concatenate([exact.da_dq, exact.da_dv], axis=2), rtol=1e-7, atol=1e-6)
    for k in range(3):  # robots whose files state other constants
        changed = []
        for sign in (1.0, -1.0):
            values = model.parameters.values + sign * 1e-6 * plant.tangent[:, k]
            parameters = type(model.parameters)(
                *(getattr(model.parameters, f) for f in ("names", "kinds", "units")), values
            )
            other = ccpin.ReducedModel(ccpin.load(with_constants(model, parameters)))
            changed.append(other.forward_dynamics_many(Q, V, U))
        slope = (changed[0] - changed[1]) / 2e-6
        assert np.allclose(by_numbers[:, :, k], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())
    more, less = (longer(model, by).forward_dynamics_many(Q, V, U) for by in (1e-5, -1e-5))
    assert np.allclose(by_numbers[:, :, 3], (more - less) / 2e-5, rtol=1e-5, atol=1e-4)


def test_motions_are_those_of_another_integrator(plant, shots, starts):
    efforts, asked = shots
    told = followed(plant, asked, starts)
    for shot, start, q in zip(asked, starts, told.q, strict=True):

        def rate(t, x):
            return np.r_[x[2:], plant.model.forward_dynamics(x[:2], x[2:], efforts(np.array([t]))[0])]

        exact = solve_ivp(rate, (0.0, shot.t[-1]), start, method="DOP853", t_eval=shot.t, rtol=1e-9, atol=1e-11)
        assert np.abs(q - exact.y[:2].T).max() < 2e-8


def test_slopes_are_those_of_changed_runs(plant, shots, starts):
    """Derivatives of the steps taken: by differences of whole runs with other starts, constants and lengths."""
    _, asked = shots
    told, h = followed(plant, asked, starts), 1e-5

    def runs(other, moved):
        return followed(other, asked, starts + moved).q

    def compare(found, more, less):
        for slope, a, b in zip(found, more, less, strict=True):
            assert np.allclose(slope, (a - b) / (2.0 * h), rtol=1e-5, atol=1e-6 * max(np.abs(slope).max(), 1e-3))

    for k in range(4):
        step = h * np.eye(4)[k]
        compare([each[..., k] for each in told.by_start], runs(plant, step), runs(plant, -step))
    for k in range(3):
        ends = [plant._replace(constants=plant.constants + s * plant.tangent[:, k]) for s in (h, -h)]
        compare([each[..., k] for each in told.by_numbers], *(runs(end, 0.0) for end in ends))
    compare(
        [each[..., 3] for each in told.by_numbers],
        *(runs(plant._replace(model=longer(plant.model, s)), 0.0) for s in (h, -h)),
    )


@pytest.mark.slow
def test_lengths_are_found_with_the_constants(bench):
    """A file with two lengths off by millimetres: the true ones explain encoders to their noise, within intervals."""
    wrong = {("origin", "joint3/x"): 0.2814, ("origin", "joint4/x"): 0.2784}
    model = ccpin.ReducedModel(changed_mechanism(bench.model.mechanism, wrong))
    log = bench.log(1, effort=0.0)
    estimate = identify(model, log)
    found = estimate.refined(model, log, geometry=[":".join(each) for each in wrong])
    assert found.names[-2:] == ("origin:joint3/x", "origin:joint4/x")
    assert np.abs(found.values[-2:] - 0.2794).max() < 3.5 * found.deviations[-2:].min()
    truth = np.r_[estimate.multiples @ bench.model.parameters.values, 0.2794, 0.2794]
    assert np.abs((found.values - truth) / found.deviations).max() < 4.5
    assert (found.missed[1] < 1.1 * 2.0 * np.pi / 2**19).all()
    assert (found.missed[0] > 1.5 * found.missed[1]).all()
    assert found.model.mechanism.tree.joint("joint3").stated.placement[0, 3] == found.values[-2]


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_intervals_hold_with_noise_in_encoders_and_in_efforts(bench, noise):
    within = []
    for seed in range(8):
        estimate = identify(bench.model, bench.log(seed, effort=noise))
        found = estimate.refined(bench.model, bench.log(seed, effort=noise))
        within.append(np.abs(found.values - estimate.stated) < 1.96 * found.deviations)
    assert 0.88 < np.mean(within) < 0.99


def test_what_cannot_be_refined_is_told(bench):
    log = bench.log(0).between(0.0, 0.6)
    estimate = identify(bench.model, log, kinds=("friction",))
    with pytest.raises(InvalidInputError, match="these are not the logs"):
        estimate.refined(bench.model, [log, log])
    with pytest.raises(InvalidInputError, match="not one of the logs"):
        estimate.refined(bench.model, bench.log(0).between(0.0, 0.8))
    with pytest.raises(InvalidInputError, match="nowhere 12 samples"):
        estimate.refined(bench.model, log, horizon=0.01)
    with pytest.raises(InvalidInputError, match="there is no 'arm'"):
        estimate.refined(bench.model, log, geometry=("arm",))
    with pytest.raises(InvalidInputError, match="horizon"):
        estimate.refined(bench.model, log, horizon=0.0)
    with pytest.raises(InvalidInputError, match="do not tell"):  # along a hinge's axis
        estimate.refined(bench.model, log, geometry=("origin:joint3/y",))
