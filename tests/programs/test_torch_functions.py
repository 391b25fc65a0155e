"""Programs as PyTorch's functions: batches, recorded derivatives, NaN if refused."""

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import InvalidInputError
from tests.support.ball_joint import ball_joint
from tests.support.bridged import CASES, close, model, recorded, states_of

torch = pytest.importorskip("torch", reason="what is tested is a function of PyTorch's")
pytestmark = pytest.mark.slow


def tensors(rows):
    return [torch.tensor(row, requires_grad=True) for row in rows]


@pytest.mark.parametrize("name", CASES)
def test_values_and_jacobians_are_the_model_s(name):
    reduced = model(name)
    function = programs.as_function(recorded(name), "torch")
    found, rows = states_of(reduced)
    inputs = tensors(rows)
    out = function(*inputs)["forward_dynamics"]
    for i in range(reduced.n):
        by = torch.autograd.grad(out[:, i].sum(), inputs, retain_graph=True)
        for k, state in enumerate(found):
            v, u = rows[2][k], rows[3][k]
            exact = state.forward_dynamics_derivatives(v, u)
            close(out[k].detach(), state.forward_dynamics(v, u))
            for j, slope in ((0, exact.da_dq), (2, exact.da_dv), (3, exact.da_du)):
                scale = max(1.0, float(np.abs(slope).max()))
                np.testing.assert_allclose(by[j][k].numpy(), slope[i], rtol=0.0, atol=1e-10 * scale)
            assert not by[1][k].any()


def test_tensors_with_leading_axes_and_names():
    program = recorded("rpdr")
    function = programs.as_function(program, "torch")
    _, rows = states_of(model("rpdr"))
    q, y, v, u = (torch.tensor(row) for row in rows)
    expected = program(**dict(zip("qyvu", rows, strict=True)))["forward_dynamics"]
    close(function(u=u, v=v, y=y, q=q)["forward_dynamics"], expected)
    close(function(q.reshape(2, 2, 2), y.reshape(2, 2, 2), v[0], u[0])["forward_dynamics"][0, 0], expected[0])
    single = function(*(tensor.float() for tensor in (q, y, v, u)))["forward_dynamics"]
    assert single.dtype == torch.float32
    close(single, expected, 1e-4)
    with pytest.raises(InvalidInputError, match="end in the shape"):
        function(q[:, :1], y, v, u)


def test_it_is_the_same_written_out():
    """For other devices: PyTorch's own operations."""
    from ccpin.programs.bridges.differentiated import parts_of
    from ccpin.programs.bridges.torch_function import written_out

    program = recorded("ankle", ("forward_dynamics", "sigma"), "near")
    _, rows = states_of(model("ankle"))
    rows[1] = rows[1] + np.array([0.0, 1e-3, 0.4, 0.0])[:, None]
    parts = parts_of(program)
    for part in (parts.values, parts.slopes):
        answer = part(**dict(zip("qyvu", rows, strict=True)))
        assert answer.status.tolist() == [0, 0, 2, 0]
        for name, table in zip(answer, written_out(part, [torch.tensor(row) for row in rows]), strict=True):
            assert np.isnan(table[2]).all()
            close(np.delete(table.numpy(), 2, 0), np.delete(answer[name], 2, 0), 1e-10)


def test_what_is_refused_is_not_a_number():
    function = programs.as_function(recorded("rpdr", ("forward_dynamics", "sigma"), "near"), "torch")
    _, rows = states_of(model("rpdr"))
    rows[1] = rows[1] + np.array([0.0, 0.0, 0.4, 0.0])[:, None]
    inputs = tensors(rows)
    out = function(*inputs)["forward_dynamics"]
    assert torch.isnan(out).any(dim=1).tolist() == [False, False, True, False]
    by_u = torch.autograd.grad(out.sum(), inputs[3])[0]
    assert torch.isnan(by_u).all(dim=1).tolist() == [False, False, True, False]


def test_q_by_its_numbers_where_its_rate_is_another():
    """A ball among q has four numbers; CasADi's Jacobian, which is held against the model elsewhere, says the same."""
    pytest.importorskip("casadi", reason="CasADi's function is what is compared with")
    reduced = ccpin.ReducedModel(ball_joint().mechanism)
    program = programs.record(reduced, "gravity", derivatives=("q",))
    _, ((q,), (y,), *_) = states_of(reduced, 1)
    function = programs.as_function(program, "torch")
    found = torch.autograd.functional.jacobian(lambda q: function(q, torch.tensor(y))["gravity"], torch.tensor(q))
    close(found, np.array(programs.as_function(program, "casadi").jacobian()(q, y, 0)[0]))


def test_derivatives_that_were_not_recorded_are_told():
    _, rows = states_of(model("rpdr"), 1)
    function = programs.as_function(programs.record(model("rpdr"), "forward_dynamics", derivatives=("v",)), "torch")
    out = function(*tensors(rows))["forward_dynamics"].sum()
    with pytest.raises(InvalidInputError, match="forward_dynamics_by_q"):
        out.backward()
    function = programs.as_function(recorded("rpdr"), "torch")
    q, y, v, u = tensors(rows)
    with pytest.raises(InvalidInputError, match="second derivatives"):
        torch.autograd.functional.hessian(lambda q: function(q, y, v, u)["forward_dynamics"].sum(), q)
