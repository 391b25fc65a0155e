"""Programs as JAX's functions: values, jit, vmap, grad; the recorded derivatives; NaN if refused."""

import numpy as np
import pytest

from ccpin import programs
from ccpin.errors import InvalidInputError
from tests.support.ball_joint import ball_joint
from tests.support.bridged import CASES, close, model, recorded, states_of
from tests.support.long_cases import later

jax = pytest.importorskip("jax", reason="what is tested is a function of JAX's")
jnp = jax.numpy


@pytest.fixture(autouse=True)
def _in_double():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.mark.parametrize("name", later(*CASES))
def test_values_and_jacobians_are_the_model_s(name):
    """A batch under jit and vmap, forward and reverse; by y it is 0."""
    reduced = model(name)
    function = programs.as_function(recorded(name), "jax")
    found, rows = states_of(reduced)

    def acceleration(*inputs):
        return function(*inputs)["forward_dynamics"]

    values = jax.jit(jax.vmap(acceleration))(*rows)
    for made in (jax.jacfwd, jax.jacrev):
        by = jax.jit(jax.vmap(made(acceleration, argnums=(0, 1, 2, 3))))(*rows)
        for k, state in enumerate(found):
            v, u = rows[2][k], rows[3][k]
            exact = state.forward_dynamics_derivatives(v, u)
            close(values[k], state.forward_dynamics(v, u))
            close(by[0][k], exact.da_dq, 1e-10)
            close(by[2][k], exact.da_dv, 1e-10)
            close(by[3][k], exact.da_du, 1e-10)
            assert not by[1][k].any()


@pytest.mark.parametrize("name", later("rpdr", "ankle"))
def test_arrays_with_leading_axes_and_names(name):
    program = recorded(name)
    function = programs.as_function(program, "jax")
    _, (q, y, v, u) = states_of(model(name))
    expected = program(q=q, y=y, v=v, u=u)["forward_dynamics"]
    close(function(u=u, v=v, y=y, q=q)["forward_dynamics"], expected)
    close(function(q.reshape(2, 2, -1), y.reshape(2, 2, -1), v[0], u[0])["forward_dynamics"][0, 0], expected[0])
    single = function(*(row.astype(np.float32) for row in (q, y, v, u)))["forward_dynamics"]
    assert single.dtype == jnp.float32
    close(single, expected, 1e-4)
    with pytest.raises(InvalidInputError, match="q, y, v, u"):
        function(q, y, v)
    with pytest.raises(InvalidInputError, match="end in the shape"):
        function(q[:, :1], y, v, u)
    with pytest.raises(InvalidInputError, match="rows"):
        function(q[:3], y, v, u)


def test_it_is_the_same_written_out():
    """For devices that do not call back: JAX's own operations."""
    from ccpin.programs.bridges.differentiated import parts_of
    from ccpin.programs.bridges.jax_function import written_out

    program = recorded("rpdr", ("forward_dynamics", "sigma"), "near")
    _, rows = states_of(model("rpdr"))
    rows[1] = rows[1] + np.array([0.0, 1e-3, 0.4, 0.0])[:, None]  # the third is refused
    parts = parts_of(program)
    for part in (parts.values, parts.slopes):
        found = written_out(part, [jnp.asarray(row) for row in rows])
        answer = part(**dict(zip("qyvu", rows, strict=True)))
        assert answer.status.tolist() == [0, 0, 2, 0]
        for name, table in found.items():
            assert np.isnan(table[2]).all()
            close(np.delete(table, 2, 0), np.delete(answer[name], 2, 0), 1e-11)


def test_a_motion_differentiated_through_all_its_steps():
    """The gradient of where 20 steps lead, y going along as it does in a loop; central differences beside."""
    program = recorded("rpdr", ("forward_dynamics", "sigma"), "near")
    function = programs.as_function(program, "jax")
    _, rows = states_of(model("rpdr"), 1)
    q, y, v, u = (jnp.asarray(row[0]) for row in rows)

    def end(u):
        def step(state, _):
            q, y, v = state
            found = function(q, y, v, u)
            v = v + 2e-3 * found["forward_dynamics"]
            return (q + 2e-3 * v, found["sigma"], v), None

        (q_end, *_), _ = jax.lax.scan(step, (q, y, v), None, length=20)
        return (q_end**2).sum()

    found, h = jax.jit(jax.grad(end))(u), 1e-4
    for k in range(2):
        step = h * jnp.eye(2)[k]
        assert found[k] == pytest.approx(float((end(u + step) - end(u - step)) / (2 * h)), rel=1e-6)


def test_what_is_refused_is_not_a_number():
    program = recorded("rpdr", ("forward_dynamics", "sigma"), "near")
    function = programs.as_function(program, "jax")
    _, rows = states_of(model("rpdr"))
    rows[1] = rows[1] + np.array([0.0, 0.0, 0.4, 0.0])[:, None]
    out = function(*rows)["forward_dynamics"]
    assert np.isnan(out).any(axis=1).tolist() == [False, False, True, False]
    by_u = jax.vmap(jax.jacfwd(lambda *inputs: function(*inputs)["forward_dynamics"], argnums=3))(*rows)
    assert np.isnan(by_u).all(axis=(1, 2)).tolist() == [False, False, True, False]


def test_q_by_its_numbers_where_its_rate_is_another():
    """A ball among q has four numbers; CasADi's Jacobian, which is held against the model elsewhere, says the same."""
    pytest.importorskip("casadi", reason="CasADi's function is what is compared with")
    import ccpin

    reduced = ccpin.ReducedModel(ball_joint().mechanism)
    program = programs.record(reduced, "gravity", derivatives=("q",))
    _, ((q,), (y,), *_) = states_of(reduced, 1)
    found = jax.jacfwd(lambda q: programs.as_function(program, "jax")(q, y)["gravity"])(q)
    close(found, np.array(programs.as_function(program, "casadi").jacobian()(q, y, 0)[0]))


def test_derivatives_that_were_not_recorded_are_told():
    _, rows = states_of(model("rpdr"), 1)
    q, y, v, u = (row[0] for row in rows)
    function = programs.as_function(programs.record(model("rpdr"), "forward_dynamics", derivatives=("v",)), "jax")
    with pytest.raises(InvalidInputError, match=r"forward_dynamics_by_q.*derivatives=\('q', 'u'\)"):
        jax.jacfwd(lambda v: function(q, y, v, u)["forward_dynamics"])(v)
    function = programs.as_function(recorded("rpdr"), "jax")
    with pytest.raises(InvalidInputError, match="second derivatives"):
        jax.hessian(lambda q: function(q, y, v, u)["forward_dynamics"].sum())(q)


def test_without_a_compiler_it_is_numpy(monkeypatch):
    from ccpin.programs import lanes
    from ccpin.programs.compiling import NoCompilerError

    def none(*arguments):
        raise NoCompilerError("there is none")

    _, rows = states_of(model("rpdr"))
    expected = programs.as_function(recorded("rpdr"), "jax")(*rows)["forward_dynamics"]
    monkeypatch.setattr(lanes, "CompiledProgram", none)
    close(programs.as_function(recorded("rpdr"), "jax")(*rows)["forward_dynamics"], expected)
