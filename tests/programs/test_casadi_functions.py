"""Programs as CasADi's functions: the model's values, its Jacobians however CasADi asks for them, NaN if refused."""

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import InvalidInputError
from ccpin.programs.bridges.differentiated import restricted
from ccpin.programs.evaluation import values_of
from tests.support.ball_joint import ball_joint
from tests.support.bridged import CASES, close, model, recorded, states_of
from tests.support.long_cases import later

ca = pytest.importorskip("casadi", reason="what is tested is a function of CasADi's")

QUIET = {
    "ipopt.print_level": 0,
    "print_time": False,
    "ipopt.sb": "yes",
    "ipopt.hessian_approximation": "limited-memory",
}


def flat(value):
    return np.array(value).ravel()


@pytest.mark.parametrize("name", later(*CASES))
def test_values_and_jacobians_are_the_model_s(name):
    reduced, program = model(name), recorded(name)
    function = programs.as_function(program, "casadi")
    jacobian = function.jacobian()
    found, rows = states_of(reduced)
    for state, *inputs in zip(found, *rows, strict=True):
        _, _, v, u = inputs
        named = dict(zip("qyvu", inputs, strict=True))
        close(flat(function(**named)["forward_dynamics"]), state.forward_dynamics(v, u))
        exact = state.forward_dynamics_derivatives(v, u)
        by = dict(zip(jacobian.name_out(), jacobian(*inputs, 0), strict=True))
        close(by["jac_forward_dynamics_q"], exact.da_dq, 1e-10)
        close(by["jac_forward_dynamics_v"], exact.da_dv, 1e-10)
        close(by["jac_forward_dynamics_u"], exact.da_du, 1e-10)
        assert by["jac_forward_dynamics_y"].nnz() == 0


@pytest.mark.parametrize("name", later("rpdr", "ankle", "delta"))
def test_every_way_of_asking_gives_the_recorded_derivative(name):
    """Along a graph, in an SX graph, forward, reverse, and of many states at once: y moves along."""
    reduced, program = model(name), recorded(name)
    function = programs.as_function(program, "casadi")
    (state, *_), rows = states_of(reduced, 3)
    q, y, v, u = (row[0] for row in rows)
    exact = state.forward_dynamics_derivatives(v, u)
    n, way = reduced.n, np.arange(1.0, reduced.n + 1.0)
    for kind in (ca.MX, ca.SX):
        Q = kind.sym("Q", n)
        out = function(Q, y, v, u)
        for expression, expected in (
            (ca.jacobian(out, Q), exact.da_dq),
            (ca.jtimes(out, Q, way), exact.da_dq @ way),
            (ca.jtimes(out, Q, way, True), exact.da_dq.T @ way),
            (ca.gradient(ca.sumsqr(out), Q), 2.0 * exact.da_dq.T @ state.forward_dynamics(v, u)),
        ):
            found = np.array(ca.Function("f", [Q], [expression])(q))
            close(found.reshape(np.shape(expected)), expected, 1e-10)
    many = function.map(3)
    Q = ca.MX.sym("Q", n, 3)
    table = np.array(ca.Function("f", [Q], [ca.jacobian(many(Q, *(r.T for r in rows[1:])), Q)])(rows[0].T))
    close(table[:n, :n], exact.da_dq, 1e-10)
    assert not table[:n, n:].any()


def test_a_jacobian_is_not_thinned_by_what_holds_y_still():
    """σ's value is y itself (given closed), in which q does not occur; its derivative by q is full all the same."""
    reduced, h = model("rpdr"), 1e-5
    program = programs.record(reduced, ("sigma", "closure"), derivatives=("q",))
    function = programs.as_function(program, "casadi")
    (state,), ((q,), (y,), *_) = states_of(reduced, 1)
    ends = [[programs.configuration(reduced.at(state.q + sign * h * e))["y"] for sign in (1, -1)] for e in np.eye(2)]
    moved = np.array([(ahead - behind) / (2 * h) for ahead, behind in ends]).T
    Q = ca.MX.sym("Q", 2)
    sigma, closure = (ca.Function("f", [Q], [ca.jacobian(out, Q)])(q) for out in function(Q, y))
    np.testing.assert_allclose(np.array(sigma), moved, atol=1e-8)
    assert np.abs(moved).min() > 0.01  # nothing of it is 0
    np.testing.assert_allclose(np.array(closure), 0.0, atol=1e-14)


@pytest.mark.parametrize("name", later("rpdr", "planar_3rrr", "ankle", "delta"))
def test_jacobians_are_complex_steps_through_the_same_arithmetic(name):
    """Of the values alone, along (1, ∂σ) for q, and along v and u."""
    reduced = model(name)
    program = recorded(name, ("forward_dynamics", "sigma"))
    jacobian = programs.as_function(program, "casadi").jacobian()
    _, rows = states_of(reduced, 1)
    inputs = [row[0] for row in rows]
    by = dict(zip(jacobian.name_out(), map(np.array, jacobian(*inputs, 0, 0)), strict=True))
    values = restricted(program, ["forward_dynamics"]).code
    for key, ways in (
        ("q", [(e, by["jac_sigma_q"] @ e, 0 * inputs[2], 0 * inputs[3]) for e in np.eye(reduced.n)]),
        ("v", [(0 * inputs[0], 0 * inputs[1], e, 0 * inputs[3]) for e in np.eye(reduced.n)]),
        ("u", [(0 * inputs[0], 0 * inputs[1], 0 * inputs[2], e) for e in np.eye(reduced.n_actuated)]),
    ):
        for k, way in enumerate(ways):
            moved = np.concatenate(inputs) + 1e-30j * np.concatenate(way)
            found = values_of(values, list(moved), np)
            step = np.array([np.imag(found[number]) for number in values.outputs]) / 1e-30
            close(by[f"jac_forward_dynamics_{key}"][:, k], step, 1e-11)


def test_q_by_its_numbers_where_its_rate_is_another():
    """A ball among q: its quaternion's numbers are four, its tangent steps three; central differences beside."""
    reduced = ccpin.ReducedModel(ball_joint().mechanism)
    program = programs.record(reduced, "gravity", derivatives=("q",))
    function = programs.as_function(program, "casadi")
    (state,), ((q,), (y,), *_) = states_of(reduced, 1)
    found = np.array(function.jacobian()(q, y, 0)[0])
    assert found.shape == (reduced.n, len(q))
    assert len(q) > reduced.n
    step = 1e-5 * np.random.default_rng(2).normal(size=reduced.n)
    ends = [reduced.at(reduced.coordinates.integrate(state.q, sign * step), state) for sign in (1.0, -1.0)]
    ahead, behind = (programs.configuration(end)["q"] for end in ends)
    np.testing.assert_allclose(found @ (ahead - behind), ends[0].g - ends[1].g, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(found @ q, 0.0, atol=1e-9)  # its length says nothing


def test_sigma_s_steps_have_the_derivatives_of_what_they_converge_to():
    program = recorded("rpdr", ("forward_dynamics", "sigma"), "near")
    function = programs.as_function(program, "casadi")
    (state,), ((q,), (y,), (v,), (u,)) = states_of(model("rpdr"), 1)
    inputs = (q, y + 2e-3, v, u)
    close(flat(function(*inputs)[0]), state.forward_dynamics(v, u), 1e-9)
    close(flat(function(*inputs)[1]), y, 1e-10)
    jacobian = function.jacobian()
    by = dict(zip(jacobian.name_out(), jacobian(*inputs, 0, 0), strict=True))
    close(by["jac_forward_dynamics_q"], state.forward_dynamics_derivatives(v, u).da_dq, 1e-8)
    assert by["jac_sigma_y"].nnz() == 0


def test_what_is_refused_is_not_a_number():
    """Too far for σ's steps: values and Jacobians are NaN; IPOPT shortens its step there."""
    program = recorded("rpdr", ("forward_dynamics", "sigma"), "near")
    function = programs.as_function(program, "casadi")
    _, ((q,), (y,), (v,), (u,)) = states_of(model("rpdr"), 1)
    assert program(q=q, y=y + 0.4, v=v, u=u).status == 2
    assert np.isnan(np.array(function(q, y + 0.4, v, u)[0])).all()
    assert np.isnan(np.array(function.jacobian()(q, y + 0.4, v, u, 0, 0)[0])).all()


def test_an_optimiser_gets_no_second_derivative():
    """None is recorded: CasADi says so, where the Hessian of what is written out would hold y still."""
    function = programs.as_function(recorded("rpdr", ("forward_dynamics", "sigma"), "near"), "casadi")
    Q = ca.MX.sym("Q", 2)
    _, ((q,), (y,), (v,), (u,)) = states_of(model("rpdr"), 1)
    with pytest.raises(RuntimeError, match="Derivatives cannot be calculated for jac_"):
        ca.hessian(ca.sumsqr(function(Q, y, v, u)[0]), Q)
    wanted = model("rpdr").forward_dynamics(q, v, u)
    problem = {"x": Q, "f": 1e-3 * ca.sumsqr(function(Q, y, v, u)[0] - wanted)}
    solver = ca.nlpsol("solver", "ipopt", problem, QUIET)
    close(flat(solver(x0=q + 0.02)["x"]), q, 1e-5)
    assert solver.stats()["success"]


def test_derivatives_that_were_not_recorded_are_told():
    program = programs.record(model("rpdr"), "forward_dynamics", derivatives=("v",))
    function = programs.as_function(program, "casadi")
    _, ((q,), (y,), (v,), (u,)) = states_of(model("rpdr"), 1)
    close(flat(function(q, y, v, u)), program(q=q, y=y, v=v, u=u)["forward_dynamics"])
    V = ca.MX.sym("V", 2)
    with pytest.raises(RuntimeError, match="Derivatives cannot be calculated"):
        ca.jacobian(function(q, y, V, u), V)


def test_some_of_the_outputs():
    """A point's position without its Jacobian, whose derivative is not recorded."""
    reduced = model("delta")
    tip = ccpin.EndEffector(reduced, "platform")
    program = programs.record(reduced, "tip", derivatives=("q",), points={"tip": tip})
    function = programs.as_function(program, "casadi", ["tip"])
    assert function.name_out() == ["tip"]
    (state,), ((q,), (y,), *_) = states_of(reduced, 1)
    close(flat(function(q, y)), tip.pose(state)[:3, 3])
    close(np.array(function.jacobian()(q, y, 0)[0]), tip.jacobian(state)[:3], 1e-11)
    with pytest.raises(InvalidInputError, match="outputs"):
        programs.as_function(program, "casadi", ["tap"])


def test_outputs_are_in_the_program_s_order():
    """However they were asked for: each with its own derivatives."""
    program, (_, ((q,), (y,), (v,), _)) = recorded("rpdr", ("gravity", "energy")), states_of(model("rpdr"), 1)
    function = programs.as_function(program, "casadi", ("energy", "gravity"))
    assert function.name_out() == ["gravity", "energy"]
    jacobian = function.jacobian()
    by = dict(zip(jacobian.name_out(), jacobian(q, y, v, 0, 0), strict=True))
    answer = program(q=q, y=y, v=v)
    close(np.array(by["jac_energy_v"]), answer["energy_by_v"])
    close(np.array(by["jac_gravity_q"]), answer["gravity_by_q"])
    assert by["jac_gravity_v"].nnz() == 0


def test_the_expressions_that_acados_takes():
    """ẋ = f(x, u; y): its sensitivities by jtimes, as acados makes them, as C that CasADi writes."""
    reduced, program = model("rpdr"), recorded("rpdr", ("forward_dynamics", "sigma"), "near")
    function = programs.as_function(program, "casadi")
    x, u, y, S = ca.MX.sym("x", 4), ca.MX.sym("u", 2), ca.MX.sym("y", 2), ca.MX.sym("S", 4, 4)
    f_expl = ca.vertcat(x[2:], function(q=x[:2], y=y, v=x[2:], u=u)["forward_dynamics"])
    forward = ca.Function("vde", [x, S, u, y], [f_expl, ca.jtimes(f_expl, x, S)])
    code = ca.CodeGenerator("vde.c")
    code.add(forward)
    assert "vde(" in code.dump()
    (state,), ((q,), (near,), (v,), (torque,)) = states_of(reduced, 1)
    _, moved = forward(np.r_[q, v], np.eye(4), torque, near)
    exact = state.forward_dynamics_derivatives(v, torque)
    close(np.array(moved), np.block([[np.zeros((2, 2)), np.eye(2)], [exact.da_dq, exact.da_dv]]), 1e-8)


@pytest.mark.slow
def test_delta_s_jacobian_stays_small():
    """Written out and differentiated by CasADi it has 469,014 nodes."""
    jacobian = programs.as_function(recorded("delta"), "casadi").jacobian()
    assert jacobian.n_nodes() < 469_014 / 10


def test_libraries_that_are_none_are_told():
    with pytest.raises(InvalidInputError, match="library"):
        programs.as_function(recorded("rpdr"), "tensorflow")
    with pytest.raises(InvalidInputError, match="program"):
        programs.as_function("rpdr", "casadi")
