"""Adaptive tracking: what V does, what the projection does, whose memory it is, and the same in C."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import PointToPoint, Sampling, Waypoints
from ccpin.errors import DifferentSubjectsError, InvalidInputError, UnsupportedMechanismError
from ccpin.identification import AdaptiveTracking, with_constants
from ccpin.programs import configuration, record
from tests.oracles.finite_differences import derivative
from tests.support.closed import closed_near
from tests.support.exported import exported, self_tested
from tests.support.long_cases import later
from tests.support.places import ROOT

ANKLE = str(ROOT / "docs" / "howto" / "ankle.urdf")
HALF = {"rpdr": 0.3, ANKLE: 0.15}
TRUE = np.array([1.3, 0.7, 0.75, 1.25])  # factors of the RPDR's bodies


def stated(name):
    """A model whose joints have rotors, dampers and springs, and rub."""

    def physical(joint, k):
        springs = {"stiffness": 0.2 * k, "spring_reference": 0.1} if joint.kind == "revolute" else {}
        if joint.kind == "fixed":
            return joint
        return replace(joint, armature=1e-3 * k, damping=0.01 * k, friction=0.02 * k, **springs)

    description = ccpin.load(name).description
    joints = tuple(physical(joint, k) for k, joint in enumerate(description.joints, start=1))
    return ccpin.ReducedModel(ccpin.load(replace(description, joints=joints)))


def law_of(model, half=0.3, **changed):
    """A law that learns all that bodies and joints have."""
    start = model.alpha(model.mechanism.q_reference)
    way = half * np.resize([1.0, -0.7], model.n)
    reference = Waypoints(model, [0.0, 0.3, 0.7], [start, start + way, start])
    numbers = {"slope": 20.0, "K": np.linspace(1.0, 2.0, model.n), "gain": 500.0, "period": 1e-3}
    numbers |= {"adapted": ["body", "armature", "damping", "stiffness", "offset"], "bounds": 0.5} | changed
    return AdaptiveTracking(model, reference, **numbers)


def draws(law, rng, count, spread):
    """Random samples: t, a State, q̇, an estimate and the truth, strictly inside the box."""
    for state in (state for _, state in zip(range(count), closed_near(law.model, rng, spread), strict=False)):
        estimate, true = law.lower + (law.upper - law.lower) * rng.uniform(0.1, 0.9, (2, len(law.adapted)))
        yield rng.uniform(0.0, 0.7), state, rng.normal(size=law.model.n), estimate, true


def stored(law, plant, t, q, v, estimate, true):
    """V, by the plant's own mass matrix."""
    wanted = law.reference.at(t)
    s = v - wanted.v + law.slope @ (q - wanted.q)
    off = estimate - true
    return 0.5 * s @ plant.at(q, plant.mechanism.q_reference).D @ s + 0.5 * (off**2 / law.gain).sum()


@pytest.fixture(scope="module")
def rpdr():
    """The RPDR, and a law that learns how heavy its links are."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    return law_of(model, gain=2000.0, adapted="body", bounds=0.4)


@pytest.fixture(scope="module")
def plant(rpdr):
    """The robot as it is."""
    return ccpin.ReducedModel(ccpin.load(with_constants(rpdr.model, rpdr.constants(TRUE))))


@pytest.mark.parametrize("name", HALF)
def test_v_falls_by_what_k_and_the_dampers_take(name):
    """V̇ = −sᵀ(K + damping)s as T → 0, V by differences along the true robot's motion, at random states."""
    law = law_of(stated(name), HALF[name], period=1e-7)
    rng = np.random.default_rng(1)
    for t, state, v, estimate, true in draws(law, rng, 4, HALF[name]):
        told = law.constants(true)
        still = replace(told, values=np.where(np.char.startswith(told.names, "friction"), 0.0, told.values))
        plant = ccpin.ReducedModel(ccpin.load(with_constants(law.model, still)))
        step, own = law.step(t, state, v, estimate), plant.at(state.q, state.q_free)
        a, rate = own.forward_dynamics(v, step.effort), (step.estimate - estimate) / law.period
        slope = derivative(
            lambda h, at=(t, state.q, v, estimate, true, plant, a, rate): stored(
                law,
                at[5],
                at[0] + h,
                at[1] + h * at[2] + 0.5 * h * h * at[6],
                at[2] + h * at[6],
                at[3] + h * at[7],
                at[4],
            ),
            1e-4,
        )
        s = law.sliding(t, state.q, v)
        taken = s @ (law.K + own.damping) @ s
        scale = abs(taken) + np.abs(s * (own.D @ a)).sum()
        assert abs(slope + taken) <= 1e-6 * scale
        here = stored(law, plant, t, state.q, v, estimate, true)
        assert abs(law.lyapunov(t, state, v, estimate, true) - here) <= 1e-12 * here


def test_with_the_truth_it_is_the_inverse_dynamics():
    """Where π̂ = π the force is D q̈_r + C q̇_r + damping q̇_r + g − K s, of the robot's own terms."""
    model = stated(ANKLE)
    law = law_of(model, 0.15)
    for t, state, v, *_ in draws(law, np.random.default_rng(2), 5, 0.15):
        wanted, e = law.reference.at(t), law.error(t, state.q)
        v_r, a_r = wanted.v - law.slope @ e, wanted.a - law.slope @ (v - wanted.v)
        force = state.D @ a_r + (state.C(v) + state.damping) @ v_r + state.g - law.K @ (v - v_r)
        found = state.generalized_force(law.torque(t, state, v))
        assert np.abs(found - force).max() <= 1e-12 * np.abs(state.D @ a_r).max() + 1e-12 * np.abs(force).max()


def test_the_projection_stays_and_brings_no_point_of_the_box_farther(rpdr):
    """(π̂ − π)ᵀΓ⁻¹(π̂ − π) is never more after it, and the estimate never outside, however long the step."""
    far = law_of(rpdr.model, gain=2e6, adapted="body", bounds=0.4)
    moved = 0
    for t, state, v, estimate, true in draws(far, np.random.default_rng(3), 40, 0.3):
        found = far.step(t, state, v, estimate).estimate
        assert ((found >= far.lower) & (found <= far.upper)).all()
        wide = law_of(rpdr.model, gain=far.gain, adapted="body", bounds=(np.full(4, 1e-9), np.full(4, 1e9)))
        free = wide.step(t, state, v, estimate).estimate
        if (free <= 1e-9).any():
            continue  # the wide box holds it, too
        moved += bool((found != free).any())
        size = [((each - true) ** 2 / far.gain).sum() for each in (found, free)]
        assert size[0] <= size[1] * (1.0 + 1e-12)
    assert moved > 5


def test_a_run_is_nobody_else_s(rpdr, plant):
    """The same law again, a pickle, other output: the same motion to the last bit; and beside another's."""
    start = rpdr.near.q
    options = {"duration": 0.05, "rtol": 1e-6, "atol": 1e-8}
    first = ccpin.simulate(plant, rpdr, start, **options)
    learnt = rpdr.estimates(first).values
    assert np.abs(learnt[-1] - rpdr.initial).max() > 1e-3
    again = ccpin.simulate(plant, pickle.loads(pickle.dumps(rpdr)), start, sample_period=7.3e-4, **options)
    assert again.q[-1].tobytes() == first.q[-1].tobytes()
    assert again.u[-1].tobytes() == first.u[-1].tobytes()
    one, other = (ccpin.Simulator(plant, rpdr, rtol=1e-6, atol=1e-8) for _ in range(2))
    one.reset(start)
    other.reset(start, [0.3, 0.0])
    for k in range(1, 6):
        one.advance(0.01 * k)
        other.advance(0.01 * k)
    reached = one.sample().q
    np.testing.assert_allclose(reached, first.q[-1], rtol=0, atol=1e-13)
    one.reset(start)
    assert one.advance(0.05).q.tobytes() == reached.tobytes()
    np.testing.assert_array_equal(rpdr.initial, np.ones(4))


def test_what_a_run_remembers_is_written_by_nobody_and_begins_anew(rpdr, plant):
    """Neither the estimate nor the effort; given as a law to two motions it starts both from the law's first."""
    run, v = rpdr.begin(), np.array([0.1, -0.1])
    effort = run.torque(0.0, rpdr.near, v)
    for told in (run.estimate, effort):
        with pytest.raises(ValueError, match="read-only"):
            told[:] = 1.0
    assert run.torque(0.0, rpdr.near, v) is effort
    options = {"duration": 0.005, "rtol": 1e-6, "atol": 1e-8}
    motions = [ccpin.simulate(plant, law, rpdr.near.q, **options) for law in (rpdr, run, run)]
    assert len({motion.u.tobytes() for motion in motions}) == 1


def test_a_sweep_of_it_depends_on_no_order(rpdr, plant):
    """Each case begins with the first estimate."""

    def task(case):
        motion = ccpin.simulate(plant, rpdr, rpdr.near.q + case["off"], duration=0.01, rtol=1e-6, atol=1e-8)
        return {"q": motion.q[-1].tolist()}

    cases = [{"off": off} for off in (0.0, 0.01, 0.0)]
    first, other, again = ccpin.sweep(task, cases).results
    assert first == again != other


def test_estimates_are_those_of_the_run(rpdr, plant):
    """Replayed with its sampling; V of it; what is another run, or lacks samples, is refused."""
    loop = Sampling(1e-3, encoder_counts=400_000, velocity_cutoff=200.0, delay=1)
    options = {"duration": 0.03, "rtol": 1e-6, "atol": 1e-8}
    run, seen = rpdr.begin(), []

    class Watched(AdaptiveTracking):
        def begin(self):
            return run

    watched = law_of(rpdr.model, gain=2000.0, adapted="body", bounds=0.4)
    watched.__class__ = Watched
    simulator = ccpin.Simulator(plant, watched, sampling=loop, rtol=1e-6, atol=1e-8)
    simulator.reset(rpdr.near.q)
    for k in range(31):
        seen.append(run.estimate)
        simulator.advance(1e-3 * (k + 1))
    motion = ccpin.simulate(plant, rpdr, rpdr.near.q, sampling=loop, **options)
    found = rpdr.estimates(motion, sampling=loop, true=TRUE)
    np.testing.assert_allclose(found.values[1:], np.array(seen)[:30], rtol=0, atol=1e-12)
    for k in (0, 17, 30):
        wanted = stored(rpdr, plant, found.t[k], motion.q[k], motion.v[k], found.values[k], TRUE)
        assert abs(found.lyapunov[k] - wanted) <= 1e-12 * wanted
    with pytest.raises(InvalidInputError, match=r"asked again, the law gives efforts .* from the motion's"):
        rpdr.estimates(motion)
    with pytest.raises(InvalidInputError, match=r"sampling has another period than the law: 0\.002 s, not 0\.001 s"):
        rpdr.estimates(motion, sampling=Sampling(2e-3))
    coarse = ccpin.simulate(plant, rpdr, rpdr.near.q, sample_period=3e-3, **options)
    with pytest.raises(InvalidInputError, match=r"no sample at each of the law's, every 0\.001 s"):
        rpdr.estimates(coarse)
    other = ccpin.load("four_bar")
    foreign = ccpin.simulate(other, None, ccpin.ReducedModel(other).alpha(other.q_reference), duration=0.01)
    with pytest.raises(DifferentSubjectsError):
        rpdr.estimates(foreign)


def test_it_tracks_what_a_wrong_model_does_not(rpdr, plant):
    """The worst error of the first moves is little more than half of what is left where nothing is learnt."""
    worst = []
    for gain in (1e-9, 1000.0):
        law = law_of(rpdr.model, slope=15.0, K=[0.5, 0.5], gain=gain, adapted="body", bounds=0.4)
        motion = ccpin.simulate(plant, law, rpdr.near.q, duration=0.3)
        worst.append(max(np.abs(law.error(t, q)).max() for t, q in zip(motion.t, motion.q, strict=True)))
    assert worst[1] < 0.6 * worst[0]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"adapted": []}, "nothing to adapt"),
        ({"adapted": "mass:link9"}, "there is no constant 'mass:link9'"),
        ({"adapted": "weight"}, "weight"),
        ({"adapted": "friction:joint1", "bounds": ([0.0], [1.0])}, "dry friction is neither adapted nor compensated"),
        ({"adapted": "friction"}, "dry friction is neither adapted nor compensated"),
        ({"adapted": ["mass", "mass:link3"]}, "names a constant twice"),
        ({"adapted": ["body:link3", "mass:link3"]}, "has a body's factor and single ones"),
        ({"adapted": "damping"}, "all are stated as 0"),
        ({"adapted": "damping:joint1", "bounds": ([-0.1], [1.0])}, "bounds of damping:joint1: -0.1 is negative"),
        ({"adapted": "mass:link3", "bounds": ([0.4], [0.3])}, "bounds of mass:link3: 0.4 is not less than 0.3"),
        ({"adapted": "mass:link3", "bounds": ([0.2], [0.3], [0.4])}, r"pair \(lower, upper\), not 3"),
        ({"adapted": "mass:link3", "bounds": -0.2}, "bounds = -0.2 must be a share"),
        ({"adapted": "mass:link3", "gain": 0.0}, "gain must be positive"),
        ({"adapted": "mass:link3", "gain": [1.0, 2.0]}, "gain has shape"),
        ({"adapted": "mass:link3", "initial": [2.0]}, "initial = 2 of mass:link3 is outside its bounds"),
        ({"adapted": "mass:link3", "period": 0.0}, "period = 0.0 must be a positive number"),
        ({"adapted": "mass:link3", "slope": -1.0}, "slope must be symmetric positive definite"),
        ({"adapted": "mass:link3", "K": [[1.0, 2.0], [2.0, 1.0]]}, "K must be symmetric positive definite"),
    ],
)
def test_wrong_arguments(rpdr, changed, said):
    """Each is told."""
    with pytest.raises(InvalidInputError, match=said):
        law_of(rpdr.model, **({"bounds": 0.2} | changed))


def test_a_breakaway_level_is_dry_friction():
    stated = {"joint1": {"friction": 0.02, "breakaway": 0.04, "stribeck_speed": 0.1}}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints=stated))
    for adapted in ("stribeck", "stribeck:joint1"):
        with pytest.raises(InvalidInputError, match="dry friction is neither adapted nor compensated"):
            law_of(model, adapted=adapted)


def test_what_would_help_a_corner_is_told(rpdr):
    """A factor of 0, and a link that is a point mass, which no bounds make a body."""
    with pytest.raises(InvalidInputError, match=r"body:link1 = 0: .* definite; a factor must be above 0$"):
        law_of(rpdr.model, adapted="body", bounds=1.0)
    stated = rpdr.model.mechanism.description
    links = [
        replace(each, inertia=each.inertia and replace(each.inertia, rotational=np.zeros((3, 3))))
        for each in stated.links
    ]
    model = ccpin.ReducedModel(ccpin.load(replace(stated, links=tuple(links))))
    with pytest.raises(InvalidInputError, match="neither is what the model states of it"):
        law_of(model, adapted="body:link4", bounds=0.1)


def test_a_corner_that_no_body_has_is_refused(rpdr):
    """Body and corner by name: the least mass with the largest moment, Cauchy and Schwarz: h² ≤ m ∫x²."""
    values = dict(zip(rpdr.model.parameters.names, rpdr.model.parameters.values, strict=True))
    m, h, square = values["mass:link3"], values["mx:link3"], values["Izz:link3"] - 0.5 * values["Ixx:link3"]
    least = h * h / square  # of the mass, with the moment as it is

    def bounds(low, high):
        return {"adapted": ["mass:link3", "mx:link3"], "bounds": ([low, 0.5 * h], [2.0 * m, high])}

    law_of(rpdr.model, **bounds(1.001 * least, h))
    with pytest.raises(
        InvalidInputError, match=r"'link3' at a corner of the bounds, mass:link3 = 0\.17.*, mx:link3 = 0\.04"
    ):
        law_of(rpdr.model, **bounds(0.999 * least, h))
    with pytest.raises(InvalidInputError, match="'link3' at a corner of the bounds"):
        law_of(rpdr.model, **bounds(1.001 * least, 1.01 * h))


def test_where_it_cannot_run(rpdr, plant):
    """Another period than its own, fewer motors than motions; as a program of laws without a memory."""
    with pytest.raises(UnsupportedMechanismError, match=r"programs know .*, not AdaptiveTracking"):
        record(rpdr.model, "torque", law=rpdr)
    with pytest.raises(InvalidInputError, match=r"0\.001 s apart, and would be asked every 0\.002 s"):
        ccpin.simulate(plant, rpdr, rpdr.near.q, duration=0.1, sampling=Sampling(2e-3))
    simulator = ccpin.Simulator(plant, None)
    simulator.reset(rpdr.near.q)
    with pytest.raises(InvalidInputError, match=r"would be asked continuously: give sampling=Sampling\(0\.001\)"):
        simulator.law = rpdr
    with pytest.raises(InvalidInputError, match=r"v has shape \(3,\)"):
        rpdr.step(0.0, rpdr.near, np.zeros(3), rpdr.initial)
    run = rpdr.begin()
    run.torque(0.1, rpdr.near, np.zeros(2))
    with pytest.raises(InvalidInputError, match=r"a sample at t = 0\.05 s followed one at t = 0\.1 s"):
        run.torque(0.05, rpdr.near, np.zeros(2))
    weak = ccpin.ReducedModel(ccpin.load("rpdr", actuated=("joint1",)))
    with pytest.raises(UnsupportedMechanismError, match="needs as many motors"):
        law_of(weak, adapted="body")


# As a program.


def step_rows(law, program, count, rng, spread):
    """Inputs of the program side by side, and what the law does there."""
    rows, wanted = [], []
    for t, state, v, estimate, _ in draws(law, rng, count, spread):
        step, goal = law.step(t, state, v, estimate), law.reference.at(t)
        given = configuration(state, law.near) | {"v": v, "q_d": goal.q, "v_d": goal.v, "a_d": goal.a, "p": estimate}
        rows.append(np.concatenate([given[port.name] for port in program.inputs]))
        wanted.append(step)
    efforts, estimates = (np.array(column) for column in zip(*wanted, strict=True))
    return np.array(rows), efforts, estimates


@pytest.mark.parametrize("name", later(*HALF))
@pytest.mark.parametrize("count", later(100, 10_000))
def test_c_does_what_the_law_does(name, count, tmp_path):
    """u and π̂_{k+1} to 1e-12 at random closed states, of a law that learns everything; some estimates meet bounds."""
    law = law_of(stated(name), HALF[name], gain=2e5)
    program = law.program()
    rows, efforts, estimates = step_rows(law, program, count, np.random.default_rng(4), HALF[name])
    found, status = exported(program, tmp_path)(rows)
    assert (status == 0).all()
    motors = law.model.n_actuated
    assert np.abs(found[:, :motors] - efforts).max() <= 1e-12 * np.abs(efforts).max()
    assert np.abs((found[:, motors:] - estimates) / (law.upper - law.lower)).max() <= 1e-12
    assert (estimates == law.lower).any()
    assert (estimates == law.upper).any()


@pytest.mark.parametrize("given", ["closed", "near"])
def test_its_own_test_passes(rpdr, given, tmp_path):
    """As that of any exported program, with σ given or found."""
    said = self_tested(rpdr.program(given=given), tmp_path, name=f"adaptive_{given}")
    assert said == f"adaptive_{given}: 0 of 24 states wrong, 24 the same to the last bit\n"


@pytest.mark.parametrize("name", [*later("slider_crank", "delta", "four_bar", "bennett", "planar_3rrr")])
def test_other_mechanisms_programs(name):
    """Slides, balls, chains in space: the recorded regressor is the law's."""
    law = law_of(stated(name), 0.05)
    program = law.program()
    rows, efforts, estimates = step_rows(law, program, 5, np.random.default_rng(5), 0.05)
    sizes = np.cumsum([port.size for port in program.inputs])[:-1]
    found = program(**dict(zip((port.name for port in program.inputs), np.split(rows, sizes, axis=1), strict=True)))
    assert np.abs(found["torque"] - efforts).max() <= 1e-12 * np.abs(efforts).max()
    assert np.abs((found["estimate"] - estimates) / (law.upper - law.lower)).max() <= 1e-12


def test_a_set_point_holds(rpdr, plant):
    """At rest at a reference that is over, with the truth, u is g and nothing is learnt."""
    model, start = rpdr.model, rpdr.near.q
    law = AdaptiveTracking(
        model,
        PointToPoint(model, start - 0.1, start, 0.1),
        20.0,
        1.0,
        gain=1.0,
        period=1e-3,
        adapted="body",
        bounds=0.4,
    )
    here = plant.at(start, rpdr.near.q_free)
    step = law.step(1.0, here, np.zeros(2), TRUE)
    np.testing.assert_allclose(step.effort, here.g, rtol=0, atol=1e-12)
    np.testing.assert_allclose(step.estimate, TRUE, rtol=0, atol=1e-12)
