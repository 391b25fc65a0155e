"""Joint friction against the paper's closed forms, a time-stepping reference, and what Coulomb's law says."""

import numpy as np
import pytest

import ccpin
from ccpin.control import Sampling
from ccpin.errors import ConvergenceError, InvalidInputError
from ccpin.kinematics.coordinates import component_names
from ccpin.simulation.plant.friction import joint_friction
from ccpin.simulation.plant.stick_slip import friction_force
from tests.oracles import rpdr as oracle
from tests.support.backends import same_on_both
from tests.support.carriage import carriage
from tests.support.held_loads import share_of_levels

POSE = np.radians([-95.0, -105.0])
HANGING = np.radians([-82.180, -97.823])
FREE = oracle.FREE
MOTORS = {"joint1": (0.2, 0.02), "joint2": (0.2, 0.02)}
EVERY = {"joint1": (0.03, 0.002), "joint2": (0.02, 0.001), "joint3": (0.01, 0.003), "joint4": (0.015, 0.0)}
NO_MOTION = np.zeros(2)


def columns(model):
    """Where joint1 … joint4 sit in q′."""
    pin_model = model.mechanism.pin_model
    return [pin_model.idx_qs[pin_model.getJointId(name)] for name in FREE]


def reduced(q_free, v):
    """D, C, g (23)–(25) and ρ from the closed forms."""
    rho, rho_dot = oracle.rho(q_free), oracle.rho_dot(q_free, v)
    mass, coriolis = oracle.mass_matrix(q_free), oracle.coriolis_matrix(q_free, rho @ v)
    return rho.T @ mass @ rho, rho.T @ (coriolis @ rho + mass @ rho_dot), rho.T @ oracle.gravity(q_free), rho, rho_dot


def mechanical_energy(model, motion):
    return np.array([sum(model.energy(*state)) for state in zip(motion.q, motion.v, motion.q_free, strict=True)])


def hold(model, share):
    """The efforts that leave a share of joint 1's breakaway level, and none of joint 2's, to friction."""
    return reduced(oracle.sigma(POSE, 1), NO_MOTION)[2] + [share * MOTORS["joint1"][0], 0.0]


def test_static_friction_holds(rpdr_model):
    """Ten seconds under 99 % of the breakaway level: the position does not move by one bit, let alone 1e-6 rad."""
    u = hold(rpdr_model, 0.99)
    motion = ccpin.simulate(rpdr_model, lambda t, q, v: u, POSE, duration=10.0, friction=MOTORS, sample_period=0.05)
    assert motion.status == "finished"
    assert np.abs(motion.q - POSE).max() == 0.0
    assert np.abs(motion.v).max() == 0.0


@pytest.mark.parametrize("sampling", [None, Sampling(2e-3)])
def test_a_load_that_grows_in_place_lets_go(rpdr_model, sampling):
    """A law that writes into one array is felt as one that makes them anew: what was at rest is looked at again."""
    kept, motions = hold(rpdr_model, 0.9), []
    start = kept.copy()

    def growing(t, q, v):
        kept[:] = start + [0.4 * t, 0.0]
        return kept

    for law in (growing, lambda t, q, v: start + [0.4 * t, 0.0]):
        motions.append(ccpin.simulate(rpdr_model, law, POSE, duration=0.2, friction=MOTORS, sampling=sampling))
    assert np.array_equal(motions[0].q, motions[1].q)
    moved = motions[0].t[np.abs(motions[0].q[:, 0] - POSE[0]) > 0]
    assert moved[0] == pytest.approx(0.1 * 0.2 / 0.4, abs=3.1e-3)  # where it exceeds its level, to a sample


def test_a_held_mechanism_bears_the_load(rpdr_model):
    """At rest the friction equals the load, g(q) − u by the closed forms, joint by joint."""
    u = hold(rpdr_model, 0.7)
    force = friction_force(rpdr_model, MOTORS, POSE, NO_MOTION, u)
    load = reduced(oracle.sigma(POSE, 1), NO_MOTION)[2] - u
    assert force.generalized == pytest.approx(load, abs=1e-12)
    assert force.joint == pytest.approx(load, abs=1e-12)


def test_beyond_its_level_friction_lets_go(rpdr_model):
    """Under 101 % it moves, in the direction of the load and with the acceleration the closed forms give."""
    u = hold(rpdr_model, 1.01)
    motion = ccpin.simulate(rpdr_model, lambda t, q, v: u, POSE, duration=0.02, friction=MOTORS)
    D, *_ = reduced(oracle.sigma(POSE, 1), NO_MOTION)
    # Joint 2 is still held while joint 1 breaks loose, so only D₁₁ is felt.
    assert motion.q[1, 0] - POSE[0] == pytest.approx(0.5 * (0.01 * 0.2 / D[0, 0]) * 1e-6, rel=1e-3)
    assert motion.q[-1, 0] > POSE[0]
    assert motion.q[5, 1] == POSE[1]


@pytest.mark.parametrize("seed", range(40))
def test_holding_is_feasibility(rpdr_model, seed):
    """With all four joints rubbing, a load is held exactly if forces within the levels can balance it (by LP)."""
    rng = np.random.default_rng(seed)
    q = np.radians([rng.uniform(-130, -95), rng.uniform(-140, -105)])
    q_free = oracle.sigma(q, 1)
    _, _, gravity, rho, _ = reduced(q_free, NO_MOTION)
    level = np.array([EVERY[name][0] for name in FREE])
    load = rng.normal(size=2) * 0.06
    share = share_of_levels(rho, level, load)
    motion = ccpin.simulate(rpdr_model, lambda t, q, v: gravity - load, q, duration=2e-3, friction=EVERY)
    assert abs(share - 1) > 1e-6
    assert (np.abs(motion.v[-1]).max() == 0.0) == (share < 1)


@pytest.mark.parametrize("seed", range(40))
def test_coulombs_law_where_joints_start(rpdr_model, seed):
    """From rest and from partial motion: sliding joints rub against their motion, starting ones against their start."""
    rng = np.random.default_rng(seed)
    q = np.radians([rng.uniform(-130, -95), rng.uniform(-140, -105)])
    v = np.array([NO_MOTION, [0.0, rng.normal()], [rng.normal(), 0.0]][seed % 3])
    q_free = oracle.sigma(q, 1)
    D, C, gravity, rho, rho_dot = reduced(q_free, v)
    u = gravity + rng.normal(size=2) * 0.1
    force = friction_force(rpdr_model, EVERY, q, v, u)
    f = force.joint
    level, viscous = np.array([EVERY[name] for name in FREE]).T
    rates = rho @ v
    a = np.linalg.solve(D, u + rho.T @ f - C @ v - gravity)
    accelerations = rho @ a + rho_dot @ v
    dry = f + viscous * rates
    assert force.generalized == pytest.approx(rho.T @ f, abs=1e-12)
    assert np.all(np.abs(dry) <= level * (1 + 1e-7))
    without = rho @ np.linalg.solve(D, u - C @ v - gravity) + rho_dot @ v
    moving, starting = np.abs(rates) > 1e-9, np.abs(accelerations) > 1e-6 * np.abs(without).max()
    assert dry[moving] == pytest.approx(-level[moving] * np.sign(rates[moving]), abs=1e-12)
    started = ~moving & starting
    assert dry[started] == pytest.approx(-level[started] * np.sign(accelerations[started]), abs=1e-7)


@pytest.fixture(scope="module")
def swing(rpdr_model):
    """A free swing that friction of all four joints brings to rest."""
    start = HANGING + np.radians([25.0, 10.0])
    return ccpin.simulate(rpdr_model, None, start, duration=3.0, friction=EVERY, rtol=1e-8, atol=1e-10)


def test_energy_lost_is_work_of_friction(rpdr_model, swing):
    """E(0) − E(T) = Σ_j c_j (total variation of q′_j) + ∫ Σ_j b_j q̇′_j² dt, all four joints."""
    energy = mechanical_energy(rpdr_model, swing)
    q_free = swing.q_free[:, columns(rpdr_model)]
    level, viscous = np.array([EVERY[name] for name in FREE]).T
    rates = np.array([oracle.rho(x) @ v for x, v in zip(q_free, swing.v, strict=True)])
    power = rates**2 @ viscous
    work = np.abs(np.diff(q_free, axis=0)).sum(axis=0) @ level + np.sum(0.5 * (power[1:] + power[:-1])) * 1e-3
    assert energy[0] - energy[-1] > 0.05
    assert energy[0] - energy[-1] == pytest.approx(work, rel=1e-4)


def test_friction_never_gives_energy(rpdr_model, swing):
    """Mechanical energy never increases without motors, and f·q̇′ ≤ 0 at every sample."""
    assert np.diff(mechanical_energy(rpdr_model, swing)).max() <= 1e-9
    rubbing = joint_friction(rpdr_model.mechanism, EVERY)
    for q, v, near in zip(swing.q[::10], swing.v[::10], swing.q_free[::10], strict=True):
        force = friction_force(rpdr_model, rubbing, q, v, NO_MOTION, near)
        assert (force.joint * (rpdr_model.rho(near) @ v)[rubbing.index]).max() <= 1e-10


def test_friction_stops_the_swing(swing):
    """It comes to a halt in finite time, away from the equilibrium, and stays there without creeping."""
    still = np.flatnonzero(np.abs(swing.v).max(axis=1) == 0.0)
    after = still[still > 100]
    assert swing.status == "finished"
    assert after.size > 100
    assert np.ptp(swing.q[after[-1] - 50 :], axis=0).max() == 0.0
    assert swing.closure_error.max() <= 1e-10


def _time_stepping(q, duration, h):
    """Moreau's time-stepping with the closed forms.

    q̇⁺ = q̇ + h D⁻¹(ρᵀf − C q̇ − g), f_j ∈ −b_j q̇′_j − c_j Sign(q̇′⁺_j).
    """
    level, viscous = np.array([EVERY[name] for name in FREE]).T
    v, f = np.zeros(2), np.zeros(4)
    for _ in range(round(duration / h)):
        q_free = oracle.sigma(q, 1)
        D, C, g, rho, _ = reduced(q_free, v)
        inverse = np.linalg.inv(D)
        free = v + h * inverse @ (-rho.T @ (viscous * (rho @ v)) - C @ v - g)
        compliance = h * rho @ inverse @ rho.T
        for _ in range(60):  # projected Gauss–Seidel
            for j in range(4):
                rate = rho[j] @ free + compliance[j] @ f
                f[j] = np.clip(f[j] - rate / compliance[j, j], -level[j], level[j])
        v = free + h * inverse @ rho.T @ f
        q = q + h * v
    return q


@pytest.mark.slow
def test_time_stepping_converges_to_it(rpdr_model):
    """A first-order reference of another kind approaches the event-driven motion at first order, reversals included."""
    start = HANGING + np.radians([25.0, 10.0])
    motion = ccpin.simulate(rpdr_model, None, start, duration=0.8, friction=EVERY, sample_period=0.01)
    assert np.any(np.diff(np.sign(motion.v[1:-1, 0])) != 0)
    errors = [np.abs(_time_stepping(start, 0.8, h) - motion.q[-1]).max() for h in (4e-3, 2e-3, 1e-3)]
    assert errors[-1] < 2e-3
    assert np.polyfit(np.log([4, 2, 1]), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("name", ["slider_crank", "delta", "stewart"])
def test_every_joint_may_rub(name):
    """Also joints with several freedoms, by component: the energy lost is ∫ Σ c|q̇′| dt, and it only falls."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q = model.alpha(model.mechanism.q_reference)
    components = component_names(model.mechanism.tree)
    level = 0.1 * np.abs(model.gravity(q)).max() / len(components)
    friction = dict.fromkeys(components, (level, 0.0))
    motion = ccpin.simulate(model, None, q, duration=0.1, friction=friction, sample_period=5e-4, rtol=1e-8, atol=1e-10)
    energy = mechanical_energy(model, motion)
    rates = np.array([model.rho(near) @ v for near, v in zip(motion.q_free, motion.v, strict=True)])
    power = level * np.abs(rates).sum(axis=1)
    assert motion.status == "finished"
    assert np.diff(energy).max() <= 1e-9
    assert energy[0] - energy[-1] > 1e-5
    assert energy[0] - energy[-1] == pytest.approx(np.sum(0.5 * (power[1:] + power[:-1])) * 5e-4, rel=2e-3)


@pytest.mark.parametrize("rubbing", [["rocker"], ["crank", "coupler", "rocker"]])
def test_a_joint_that_turns_back_is_carried_through(rubbing):
    """A rocker turns at the ends of its swing and does not stop the crank: energy lost is the work of friction."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    friction = dict.fromkeys(rubbing, (2e-3, 1e-4))
    motion = ccpin.simulate(
        model, None, model.alpha(model.mechanism.q_reference), [8.0], duration=0.6, friction=friction
    )
    rocker = motion.v_free[:, model.mechanism.tree.names.index("rocker")]
    assert (rocker[1:] * rocker[:-1] < 0).any()
    assert np.abs(np.diff(motion.v[:, 0])).max() < 0.2
    energy, power = mechanical_energy(model, motion), (motion.friction * motion.v_free).sum(axis=1)
    assert energy[0] - energy[-1] == pytest.approx(-np.trapezoid(power, motion.t), rel=1e-4)


@pytest.mark.slow
@same_on_both
def test_loose_tolerances_keep_joints_at_rest(rpdr_model, swing):
    """A dependent joint at rest collects the integrator's error and is still at rest: same motion, to the tolerance."""
    start = HANGING + np.radians([25.0, 10.0])
    loose = ccpin.simulate(rpdr_model, None, start, duration=3.0, friction=EVERY, rtol=1e-4, atol=1e-5)
    assert loose.status == "finished"
    assert np.abs(loose.q - swing.q).max() < 5e-3


def test_viscous_friction_is_a_damping_law(rpdr_model):
    """Without Coulomb levels it is the motion under u = −b q̇."""
    start = HANGING + np.radians([15.0, 0.0])
    rubbing = ccpin.simulate(rpdr_model, None, start, duration=0.5, friction=(0.0, [0.03, 0.01]), sample_period=0.01)
    damped = ccpin.simulate(
        rpdr_model, lambda t, q, v: [-0.03 * v[0], -0.01 * v[1]], start, duration=0.5, sample_period=0.01
    )
    assert np.abs(rubbing.q - damped.q).max() < 1e-8


@pytest.mark.parametrize("method", ["DOP853", "Radau", "LSODA"])
def test_integrators_agree_across_events(rpdr_model, method):
    """Events do not depend on the integrator that meets them."""
    start = HANGING + np.radians([25.0, 10.0])
    common = {"duration": 0.5, "friction": EVERY, "sample_period": 0.01}
    first = ccpin.simulate(rpdr_model, None, start, **common)
    other = ccpin.simulate(rpdr_model, None, start, method=method, rtol=1e-7, atol=1e-9, **common)
    assert np.abs(first.q - other.q).max() < 1e-5


def test_halting_and_breaking_loose_without_end():
    """A law that pushes a carriage on whenever it does not move on, and back as soon as it does.

    It halts after v_0/(K + c), having gone v_0²/2(K + c), and there the motion ends; what was before is kept.
    """
    push, level, v_0 = 5.0, 0.9, 0.02
    motion = ccpin.simulate(
        carriage(),
        lambda t, q, v: np.array([push if v[0] <= 0 else -push]),
        [0.0],
        [v_0],
        duration=0.01,
        friction={"x": (level, 0.0)},
        sample_period=1e-3,
    )
    halts = v_0 / (push + level)
    assert (motion.status, type(motion.cause)) == ("failed", ConvergenceError)
    assert "friction: joints halt and break loose without end" in motion.message
    assert motion.t == pytest.approx([0.0, 1e-3, 2e-3, 3e-3, halts], abs=1e-6)
    assert motion.q[:-1, 0] == pytest.approx(v_0 * motion.t[:-1] - 0.5 * (push + level) * motion.t[:-1] ** 2, abs=1e-9)
    assert motion.q[-1, 0] == pytest.approx(0.5 * v_0 * halts, abs=1e-9)


@pytest.mark.parametrize("level", [1e-3, 10.0])
def test_joints_that_never_move_hold_nothing(level):
    """A Delta's platform does not turn: ρ's rows of its turns are zero but for rounding, whatever their friction."""
    turns = dict.fromkeys(("platform_roll", "platform_pitch", "platform_yaw"), (level, 0.0))
    model = ccpin.ReducedModel(ccpin.load("delta"))
    q = model.coordinates.integrate(model.alpha(model.mechanism.q_reference), [0.02, -0.01, 0.03])
    with_it, without = (
        ccpin.simulate(model, None, q, duration=0.1, friction=friction, sample_period=0.01, rtol=1e-11, atol=1e-13)
        for friction in (turns, {})
    )
    assert with_it.status == "finished"
    np.testing.assert_allclose(with_it.q, without.q, rtol=0, atol=1e-10)
    assert not with_it.friction.any()


def test_friction_does_not_depend_on_history(rpdr_model):
    """The same arguments give the same samples, bit for bit."""
    start = HANGING + np.radians([25.0, 10.0])
    once, again = (
        ccpin.simulate(rpdr_model, None, start, duration=0.3, friction=EVERY, sample_period=0.01) for _ in range(2)
    )
    assert np.array_equal(once.q, again.q)


def test_arrays_are_the_independent_joints(rpdr):
    """A pair of arrays or numbers means the independent joints in their order."""
    mapped, paired = joint_friction(rpdr, MOTORS), joint_friction(rpdr, (0.2, [0.02, 0.02]))
    assert paired.names == mapped.names == rpdr.independent
    assert np.array_equal(paired.index, mapped.index)
    assert np.array_equal(paired.coulomb, mapped.coulomb)
    assert np.array_equal(paired.viscous, mapped.viscous)
    assert joint_friction(rpdr, mapped) is mapped


@pytest.mark.parametrize(
    ("friction", "words"),
    [
        ({"elbow": (0.1, 0.0)}, "'elbow' is not one of the joints joint1"),
        ({"joint1": (-0.1, 0.0)}, "friction of 'joint1'"),
        ({"joint1": (np.inf, 0.0)}, "friction of 'joint1'"),
        ({"joint1": 0.1}, "two finite numbers"),
        (([0.1, 0.1, 0.1], 0.0), "coulomb has shape"),
        ((0.1, [0.1]), "viscous has shape"),
        (0.1, "pair of arrays"),
    ],
)
def test_bad_friction_is_named(rpdr_model, friction, words):
    """What is wrong, where, and what would be right."""
    with pytest.raises(InvalidInputError, match=words):
        ccpin.simulate(rpdr_model, None, POSE, duration=0.1, friction=friction)
