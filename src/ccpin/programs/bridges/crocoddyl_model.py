"""Programs as differential action models of Crocoddyl's: x = (q, q̇), ẋ = (q̇, q̈), in Python on lanes.

In Python, since a model compiled against Crocoddyl's headers has to be built with the very Boost, Eigen and bindings
that the wheel was built with; what is left of Python is two calls a node, with nothing allocated.
"""

from __future__ import annotations

from typing import Any

import crocoddyl
import numpy as np

from ccpin.arrays import Array, instance
from ccpin.errors import InvalidInputError
from ccpin.programs.bridges.differentiated import STEP, parts_of, restricted
from ccpin.programs.lanes import CompiledProgram
from ccpin.programs.program import Program

_DEEPEST = 2.0**-8  # of the way to a configuration: Newton's steps are tried in parts of it no smaller
_WORD = "forward_dynamics"


def action_of(program: Program, costs: Any) -> Any:
    """The model of a program and costs, which fit one another (`differential_action`)."""
    instance(costs, "costs", crocoddyl.CostModelSum)
    inputs, outputs = ({port.name: port.size for port in side} for side in (program.inputs, program.outputs))
    fits = [*inputs] == ["q", "y", "v", "u"] and {_WORD, "sigma"} <= {*outputs} and program.corrections
    if not fits or parts_of(program).missing:
        raise InvalidInputError(
            "Crocoddyl takes record(model, ['forward_dynamics', 'sigma'], given='near', derivatives=('q', 'v', 'u'))"
        )
    if STEP in outputs:
        raise InvalidInputError("Crocoddyl's states are vectors (q, q̇): q must be numbers whose rates are q̇")
    if (costs.state.nx, costs.nu) != (2 * inputs["v"], inputs["u"]):
        raise InvalidInputError(
            f"the costs are of {costs.state.nx} numbers of the state and {costs.nu} controls, "
            f"not of {2 * inputs['v']} and {inputs['u']}"
        )
    return DifferentialAction(program, costs)


class _Row:
    """A compiled program over one row of arrays that are always the same."""

    def __init__(self, compiled: CompiledProgram) -> None:
        self.q, self.y, self.v, self.u = (np.zeros(port.shape) for port in compiled.program.inputs)
        self.outputs = {port.name: np.zeros(port.shape) for port in compiled.program.outputs}
        self.acceleration, self.sigma = self.outputs[_WORD], self.outputs["sigma"]
        self.status = np.zeros(1, dtype=np.int32)
        self._run = compiled.bound([self.q, self.y, self.v, self.u], [*self.outputs.values()], self.status)

    def fails(self) -> bool:
        """Run it, and whether the status is not 0."""
        self._run()
        return bool(self.status.item())


class DifferentialAction(crocoddyl.DifferentialActionModelAbstract):  # type: ignore[misc]
    """A mechanism with costs; made by `action_of`."""

    def __init__(self, program: Program, costs: Any) -> None:
        crocoddyl.DifferentialActionModelAbstract.__init__(self, costs.state, costs.nu, costs.nr)
        self.costs, self.n = costs, costs.state.nv
        self._zero = np.zeros(costs.nu)
        slopes = [f"{_WORD}_by_{key}" for key in "qvu"]
        values = CompiledProgram(restricted(program, [_WORD, "sigma"]))
        both = CompiledProgram(restricted(program, [_WORD, "sigma", *slopes]))
        self.values, self.both = _Row(values), _Row(both)
        first = program.inputs[0].size
        self.start = np.array(program.example[: first + program.inputs[1].size])
        self.recent = self.start[first:].copy()

    def createData(self) -> Any:  # noqa: D102
        return DifferentialActionData(self)

    def calc(self, data: Any, x: Array, u: Array | None = None) -> None:
        """q̈ and the cost."""
        self._moved(self.values, data, x, self._zero if u is None else u)
        data.xout = self.values.acceleration
        self._cost(data, x, u, self.costs.calc)
        data.cost = data.costs.cost

    def calcDiff(self, data: Any, x: Array, u: Array | None = None) -> None:
        """Their derivatives."""
        self._moved(self.both, data, x, self._zero if u is None else u)
        found, n = self.both.outputs, self.n
        data.slopes[:, :n] = found[f"{_WORD}_by_q"]
        data.slopes[:, n:] = found[f"{_WORD}_by_v"]
        data.Fx, data.Fu = data.slopes, found[f"{_WORD}_by_u"]
        self._cost(data, x, u, self.costs.calcDiff)

    def _cost(self, data: Any, x: Array, u: Array | None, does: Any) -> None:
        if u is None:
            does(data.costs, x)
        else:
            does(data.costs, x, u)

    def _moved(self, row: _Row, data: Any, x: Array, u: Array) -> None:
        """Run a row at a state: from the node's last one, from the last of all nodes, else in parts of the way."""
        n = self.n
        row.q[:], row.y[:], row.v[:], row.u[:] = x[:n], data.y, x[n:], u
        if row.fails():
            row.y[:] = self.recent
            if row.fails() and not self._walks(row, data, x[:n]):
                return
        self.recent[:] = data.y[:] = row.sigma
        data.q[:] = row.q

    def _walks(self, row: _Row, data: Any, q: Array) -> bool:
        """Whether the row goes from the node's last configuration to q; else it is NaN."""
        way, stride, q0, y0 = 0.0, 0.5, data.q.copy(), data.y.copy()
        while way < 1.0 and stride >= _DEEPEST:
            to = min(1.0, way + stride)
            row.q[:], row.y[:] = q0 + to * (q - q0) if to < 1.0 else q, y0
            if row.fails():
                stride *= 0.5
            else:
                way, y0 = to, row.sigma.copy()
        if way < 1.0:
            for output in row.outputs.values():
                output.fill(np.nan)
        return way == 1.0


class DifferentialActionData(crocoddyl.DifferentialActionDataAbstract):  # type: ignore[misc]
    """A node's data, with the last closed configuration and its costs'."""

    def __init__(self, model: DifferentialAction) -> None:
        crocoddyl.DifferentialActionDataAbstract.__init__(self, model)
        self.q, self.y = model.start[: model.n].copy(), model.start[model.n :].copy()
        self.slopes = np.zeros((model.n, 2 * model.n))
        self.shared = crocoddyl.DataCollectorAbstract()
        self.costs = model.costs.createData(self.shared)
        self.costs.shareMemory(self)
