"""Programs in CasADi, JAX and Crocoddyl: `python -m benchmarks.bridges [MODEL …]`; seconds of the processor.

CasADi: nodes and time of q̈ and of its Jacobian. JAX: the first call, a row of 4,096. Crocoddyl: an iteration
of FDDP over 100 nodes (RPDR), beside the same problem with a model in Python that calls the reduced model.
"""

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import ccpin
from ccpin import programs

MODELS = ("rpdr", str(Path(__file__).parents[1] / "docs/howto/ankle.urdf"), "delta")
ROWS, REPEATS, NODES, STEP = 4096, 9, 100, 0.005


def main(names: Sequence[str] = MODELS, rows: int = ROWS, repeats: int = REPEATS) -> None:
    """Print all figures."""
    for name in names:
        model = ccpin.ReducedModel(ccpin.load(name))
        program = programs.record(model, "forward_dynamics", derivatives=("q", "v", "u"))
        sizes = [port.size for port in program.inputs]
        row = np.split(np.array(program.example), np.cumsum(sizes)[:-1])
        print(Path(name).stem)
        print(f"  CasADi  {where_installed(partial(casadi, program, row, repeats))}")
        print(f"  JAX     {where_installed(partial(jax, program, row, rows, repeats))}")
    print(f"rpdr\n  Crocoddyl  {where_installed(partial(crocoddyl, repeats))}")


def where_installed(measure: Callable[[], str]) -> str:
    """What is measured, or why not: a package is not installed."""
    try:
        return measure()
    except (ImportError, ccpin.CcpinError) as error:
        return f"not measured: {error}"


def spent(does: Callable[[], Any], repeats: int, calls: int = 1) -> float:
    """The least seconds of the processor that one call takes."""
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(calls):
            does()
        found.append((time.process_time() - begin) / calls)
    return min(found)


def casadi(program: programs.Program, row: list[Any], repeats: int) -> str:
    """Nodes and microseconds, called through buffers."""
    value = programs.as_function(program, "casadi")
    told = []
    for function, given in ((value, row), (value.jacobian(), [*row, np.zeros(value.size1_out(0))])):
        buffer, run = function.buffer()
        kept = [np.ascontiguousarray(each, dtype=float) for each in given]
        found = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, array in enumerate(kept):
            buffer.set_arg(k, memoryview(array))
        for k, array in enumerate(found):
            if array.size:
                buffer.set_res(k, memoryview(array))
        told.append(f"{function.n_nodes():,} nodes, {1e6 * spent(run, repeats, 200):.1f} µs")
    return f"q̈ {told[0]}; its Jacobian {told[1]}"


def jax(program: programs.Program, row: list[Any], rows: int, repeats: int) -> str:
    """Seconds of the first call and nanoseconds a row, in double."""
    import jax

    jax.config.update("jax_enable_x64", True)
    table = [np.tile(each, (rows, 1)) for each in row]
    function = programs.as_function(program, "jax")
    value = jax.jit(jax.vmap(function))
    slopes = jax.jit(jax.vmap(jax.jacfwd(lambda *inputs: function(*inputs)["forward_dynamics"], argnums=(0, 2, 3))))
    told = []
    for does in (value, slopes):
        begin = time.perf_counter()
        jax.block_until_ready(does(*table))
        first = time.perf_counter() - begin
        each = spent(partial(lambda does: jax.block_until_ready(does(*table)), does), repeats)
        told.append(f"{first:.1f} s at first, {1e9 * each / rows:.0f} ns a row")
    return f"q̈ {told[0]}; its Jacobian {told[1]}"


def crocoddyl(repeats: int, nodes: int = NODES) -> str:
    """Milliseconds an iteration, of the program's model and of one that calls the reduced model."""
    import crocoddyl

    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    start, goal = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])
    n, state = model.n, crocoddyl.StateVector(2 * model.n)
    what = ("forward_dynamics", "sigma")
    program = programs.record(model, what, given="near", derivatives=("q", "v", "u"), near=model.at(start))

    def costs(position: float, speed: float, effort: float) -> Any:
        total = crocoddyl.CostModelSum(state, n)
        weights = crocoddyl.ActivationModelWeightedQuad(np.repeat([position, speed], n))
        reach = crocoddyl.ResidualModelState(state, np.r_[goal, np.zeros(n)], n)
        total.addCost("reach", crocoddyl.CostModelResidual(state, weights, reach), 1.0)
        total.addCost("effort", crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state, n)), effort)
        return total

    class Plain(crocoddyl.DifferentialActionModelAbstract):  # type: ignore[misc]
        def __init__(self, position: float, speed: float, effort: float) -> None:
            crocoddyl.DifferentialActionModelAbstract.__init__(self, state, n, 0)
            self.weights, self.effort = np.repeat([position, speed], n), effort

        def calc(self, data: Any, x: Any, u: Any = None) -> None:
            u = np.zeros(n) if u is None else u
            data.xout = model.forward_dynamics(x[:n], x[n:], u)
            off = x - np.r_[goal, np.zeros(n)]
            data.cost = 0.5 * (self.weights * off) @ off + 0.5 * self.effort * u @ u

        def calcDiff(self, data: Any, x: Any, u: Any = None) -> None:
            u = np.zeros(n) if u is None else u
            slopes = model.forward_dynamics_derivatives(x[:n], x[n:], u)
            data.Fx, data.Fu = np.hstack([slopes.da_dq, slopes.da_dv]), slopes.da_du
            data.Lx, data.Lu = self.weights * (x - np.r_[goal, np.zeros(n)]), self.effort * u
            data.Lxx, data.Luu = np.diag(self.weights), self.effort * np.eye(n)

    told, x0 = [], np.r_[start, np.zeros(n)]
    holding = model.inverse_dynamics(start, np.zeros(n), np.zeros(n))
    for made in (lambda *w: programs.differential_action(program, costs(*w)), Plain):
        running = crocoddyl.IntegratedActionModelEuler(made(1e-2, 1e-3, 1e-3), STEP)
        last = crocoddyl.IntegratedActionModelEuler(made(1e4, 1e2, 0.0), 0.0)
        solver = crocoddyl.SolverFDDP(crocoddyl.ShootingProblem(x0, [running] * nodes, last))
        solve = partial(solver.solve, [x0] * (nodes + 1), [holding] * nodes, 100)
        each = spent(solve, repeats) / max(solver.iter, 1)
        told.append(
            f"{1e3 * each:.2f} ms an iteration ({solver.iter}, {np.abs(solver.xs[-1][:n] - goal).max():.0e} off)"
        )
    return f"on lanes {told[0]}; the reduced model called from Python {told[1]}"


if __name__ == "__main__":
    main(sys.argv[1:] or MODELS)
