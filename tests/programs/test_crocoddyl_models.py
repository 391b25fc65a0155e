"""Programs as Crocoddyl's models: the model's values and derivatives, and its optima."""

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import CcpinError, InvalidInputError
from tests.support.ball_joint import ball_joint
from tests.support.bridged import close, model, recorded, states_of
from tests.support.long_cases import later

crocoddyl = pytest.importorskip("crocoddyl", reason="what is tested is a model of Crocoddyl's")
WHAT = ("forward_dynamics", "sigma")


def costs_of(reduced, goal, weights, effort=1e-3):
    """½ Σ w (x − goal)² + ½ effort |u|²."""
    state, motors = crocoddyl.StateVector(2 * reduced.n), reduced.n_actuated
    total = crocoddyl.CostModelSum(state, motors)
    weighted = crocoddyl.ActivationModelWeightedQuad(np.repeat(weights, reduced.n))
    reach = crocoddyl.ResidualModelState(state, np.r_[goal, np.zeros(reduced.n)], motors)
    total.addCost("x", crocoddyl.CostModelResidual(state, weighted, reach), 1.0)
    if effort:
        total.addCost("u", crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state, motors)), effort)
    return total


@pytest.mark.parametrize("name", later("rpdr", "ankle", "delta"))
def test_values_and_derivatives_are_the_model_s(name):
    """One after the other from wherever the last one was."""
    reduced = model(name)
    action = programs.differential_action(
        recorded(name, WHAT, "near"), costs_of(reduced, np.zeros(reduced.n), [2.0, 3.0])
    )
    data = action.createData()
    found, rows = states_of(reduced)
    for state, q, _, v, u in zip(found, *rows, strict=True):
        x = np.r_[q, v]
        action.calc(data, x, u)
        action.calcDiff(data, x, u)
        exact = state.forward_dynamics_derivatives(v, u)
        close(data.xout, state.forward_dynamics(v, u), 1e-9)
        close(data.Fx, np.hstack([exact.da_dq, exact.da_dv]), 1e-8)
        close(data.Fu, exact.da_du, 1e-9)
        weights = np.repeat([2.0, 3.0], reduced.n)
        assert data.cost == pytest.approx(0.5 * (weights * x) @ x + 0.5e-3 * u @ u, rel=1e-12)
        close(data.Lx, weights * x)
        close(data.Lu, 1e-3 * u)
        close(data.Lxx, np.diag(weights))
    action.calc(data, x)
    assert data.cost == pytest.approx(0.5 * (weights * x) @ x, rel=1e-12)


def test_far_states_are_gone_to_in_halves_and_what_is_out_of_reach_is_not_a_number():
    reduced = model("rpdr")
    action = programs.differential_action(recorded("rpdr", WHAT, "near"), costs_of(reduced, np.zeros(2), [1.0, 1.0]))
    data = action.createData()
    start = reduced.alpha(reduced.mechanism.q_reference)
    far = start + np.radians([40.0, 20.0])
    state = reduced.at(far, reduced.mechanism.q_reference)
    program = recorded("rpdr", WHAT, "near")
    y = np.array(program.example[2:4])
    assert program(q=far, y=y, v=np.zeros(2), u=np.zeros(2)).status == 2  # not in one go
    action.calc(data, np.r_[far, 0.0, 0.0], np.zeros(2))
    close(data.xout, state.forward_dynamics(np.zeros(2), np.zeros(2)), 1e-9)
    beyond = start + np.array([0.0, 2.5])
    with pytest.raises(CcpinError):
        reduced.at(beyond, reduced.mechanism.q_reference)
    action.calc(data, np.r_[beyond, 0.0, 0.0], np.zeros(2))
    assert np.isnan(data.xout).all()
    action.calc(data, np.r_[far, 0.0, 0.0], np.zeros(2))  # nothing of it stays
    close(data.xout, state.forward_dynamics(np.zeros(2), np.zeros(2)), 1e-9)


@pytest.mark.parametrize("integrated", [crocoddyl.IntegratedActionModelEuler, crocoddyl.IntegratedActionModelRK])
def test_an_action_model_s_derivatives(integrated):
    """Crocoddyl's own integrators around it; central differences of their next states."""
    reduced = model("rpdr")
    action = programs.differential_action(recorded("rpdr", WHAT, "near"), costs_of(reduced, np.zeros(2), [1.0, 1.0]))
    kind = (crocoddyl.RKType.four,) if integrated is crocoddyl.IntegratedActionModelRK else ()
    step = integrated(action, *kind, 5e-3)
    data = step.createData()
    _, ((q,), _, (v,), (u,)) = states_of(reduced, 1)
    x, h = np.r_[q, v], 1e-5

    def after(x, u):
        step.calc(data, x, u)
        return data.xnext.copy()

    step.calc(data, x, u)
    step.calcDiff(data, x, u)
    by_x, by_u = data.Fx.copy(), data.Fu.copy()
    central = np.array([(after(x + h * e, u) - after(x - h * e, u)) / (2 * h) for e in np.eye(4)]).T
    np.testing.assert_allclose(by_x, central, atol=1e-8)
    central = np.array([(after(x, u + h * e) - after(x, u - h * e)) / (2 * h) for e in np.eye(2)]).T
    np.testing.assert_allclose(by_u, central, atol=1e-8)


def test_a_move_solved_is_the_mechanism_s_move():
    """FDDP's torques, played back to the reduced model by the same rule, lead to the goal."""
    reduced = model("rpdr")
    start, goal = np.radians([-120.0, -130.0]), np.radians([-90.0, -100.0])
    program = programs.record(reduced, WHAT, given="near", derivatives=("q", "v", "u"), near=reduced.at(start))
    along = programs.differential_action(program, costs_of(reduced, goal, [1e-2, 1e-3]))
    arrived = programs.differential_action(program, costs_of(reduced, goal, [1e4, 1e2], 0.0))
    dt, x0 = 0.01, np.r_[start, 0.0, 0.0]
    nodes = [crocoddyl.IntegratedActionModelEuler(along, dt)] * 40
    problem = crocoddyl.ShootingProblem(x0, nodes, crocoddyl.IntegratedActionModelEuler(arrived, 0.0))
    solver = crocoddyl.SolverFDDP(problem)
    assert solver.solve([x0] * 41, [np.zeros(2)] * 40, 100)
    q, v, state = start, np.zeros(2), None
    for u in solver.us:
        state = reduced.at(q, state)
        v = v + dt * state.forward_dynamics(v, u)
        q = q + dt * v
    close(q, solver.xs[-1][:2], 1e-7)
    np.testing.assert_allclose(q, goal, atol=1e-3)


def test_what_does_not_fit_is_told():
    reduced = model("rpdr")
    costs = costs_of(reduced, np.zeros(2), [1.0, 1.0])
    for program in (recorded("rpdr"), recorded("rpdr", WHAT), programs.record(reduced, WHAT, given="near")):
        with pytest.raises(InvalidInputError, match="Crocoddyl takes record"):
            programs.differential_action(program, costs)
    with pytest.raises(InvalidInputError, match="numbers of the state"):
        programs.differential_action(recorded("delta", WHAT, "near"), costs)
    whole = ccpin.ReducedModel(ball_joint().mechanism)
    program = programs.record(whole, WHAT, given="near", derivatives=("q", "v", "u"))
    with pytest.raises(InvalidInputError, match="vectors"):
        programs.differential_action(program, costs)
