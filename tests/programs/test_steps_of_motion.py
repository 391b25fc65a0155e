"""`record(…, "step")`: of order 4, on the simulator's motion, closed after ten thousand steps."""

import numpy as np
import pytest

import ccpin
from ccpin import Simulator, programs
from ccpin.errors import InvalidInputError
from ccpin.programs.compiling import NoCompilerError
from ccpin.programs.lanes import CompiledProgram
from ccpin.programs.recording.recorded_mechanism import numbering
from tests.support.long_cases import later

TIME = 0.08  # s


@pytest.fixture(scope="module")
def step(model):
    """Its step."""
    return programs.record(model, "step")


def start(model):
    """Where a motion begins: q, y, q̇, u and the state."""
    own = numbering(model, model.mechanism.q_reference)
    state = model.at(model.alpha(model.mechanism.q_reference) + 0.1)
    x = own.numbers(state.q_free)
    return x[list(own.q.places)], x[list(own.dependent)], np.array([1.0, -2.0]), np.array([0.3, -0.2]), state


def after(step, q, y, v, u, count):
    """q and q̇ after so many steps."""
    for _ in range(count):
        told = step(q=q, y=y, v=v, u=u, h=[TIME / count])
        assert told.status == 0
        q, y, v = told["q_next"], told["y_next"], told["v_next"]
    return np.concatenate([q, v])


def test_it_is_of_order_four(model, step):
    """Against a simulation of tolerance 1e-12, half the step has a sixteenth of the error."""
    q, y, v, u, state = start(model)
    simulator = Simulator(model, method="DOP853", rtol=1e-12, atol=1e-13, friction={})
    simulator.reset(q, v, near=state)
    sample = simulator.step(u, TIME)
    wanted = np.concatenate([sample.q, sample.v])
    errors = [np.abs(after(step, q, y, v, u, count) - wanted).max() for count in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.6) & (orders < 4.6)), (orders, errors)
    assert errors[-1] < 1e-7


@pytest.mark.parametrize("count", later(2_000, 10_000))
def test_it_stays_closed(model, step, count):
    """After thousands of steps of a swinging mechanism every loop is closed to 1e-12, and energy is where it was."""
    try:
        run = CompiledProgram(step)
    except NoCompilerError as error:
        pytest.skip(str(error))
    closure = programs.record(model, ["closure", "energy"])
    q, y, v, u, _ = start(model)
    v, u = 0.3 * v, 0.0 * u
    if model.mechanism.joints.friction is not None:
        assert all(joint.stated.damping == 0.0 for joint in model.mechanism.tree.joints)
    before = closure(q=q, y=y, v=v)["energy"].sum()
    for _ in range(count):
        (q,), (y,), (v,), (status,) = run(q, y, v, u, [1e-4])
        assert status == 0
    told = closure(q=q, y=y, v=v)
    assert np.abs(told["closure"]).max() <= 1e-12
    assert abs(told["energy"].sum() - before) < 1e-9 * (1.0 + abs(before))


def test_single_precision_goes_on():
    """Corrections that are a float's rounding are no sign of too long a step: an ankle's loops stay closed to it."""
    ankle = ccpin.ReducedModel(ccpin.load("docs/howto/ankle.urdf"))
    program, closure = programs.record(ankle, "step"), programs.record(ankle, "closure")
    try:
        run = CompiledProgram(program, "float")
    except NoCompilerError as error:
        pytest.skip(str(error))
    start = ankle.alpha(ankle.mechanism.q_reference)
    places = start + 0.02 * np.random.default_rng(0).normal(size=(64, 2))
    closed = [programs.configuration(ankle.at(q)) for q in places]
    q, y = (np.array([each[name] for each in closed]) for name in "qy")
    v, u = np.zeros_like(q), np.zeros(2)
    for _ in range(200):
        q, y, v, status = run(q, y, v, u, [1e-3])
        assert not status.any()
    assert max(np.abs(closure(q=a, y=b)["closure"]).max() for a, b in zip(q, y, strict=True)) < 1e-6


def test_too_long_a_step_is_told(model, step):
    """Status 2 where the Newton step at its end was no small one."""
    q, y, v, u, _ = start(model)
    assert step(q=q, y=y, v=10 * v, u=u, h=[0.05]).status != 0


def test_it_is_recorded_alone(model):
    """With other quantities, derivatives or an open configuration it is refused."""
    for asked in ({"what": ("step", "rho")}, {"what": "step", "derivatives": "q"}, {"what": "step", "given": "near"}):
        with pytest.raises(InvalidInputError, match="recorded alone"):
            programs.record(model, **asked)
