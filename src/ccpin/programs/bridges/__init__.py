"""A program as a function of CasADi, JAX or PyTorch, or as a model of Crocoddyl's, with its recorded derivatives.

What a function is, in all of them: q ↦ f(q, σ(q), …), where y says which branch σ is of (and is σ(q), or near it, as
the program was recorded). Its derivative by q is thus total, with y moving along by implicit differentiation, and its
derivative by y is 0, exactly. Where the program's status is not 0 every value and derivative is NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from ccpin.arrays import choice, instance
from ccpin.errors import CcpinError
from ccpin.programs.program import Program

Library = Literal["casadi", "jax", "torch"]


def as_function(program: Program, library: Library, outputs: str | Sequence[str] | None = None) -> Any:
    """A program as a function of another library, differentiable by what was recorded.

    Inputs and outputs are the program's, by name; derivatives (`NAME_by_q`, …) are no outputs, but what the library
    gets when it differentiates: `record(model, what, derivatives=("q", "v", "u"))`. By q they are total, y = σ(q)
    moving along, and by y they are 0: y says which branch is meant. So what moves q while y stays, as an optimiser
    does, has to be of a program `given="near"`; `given="closed"` is for those who hand on the y of each q. A function
    some of whose derivatives were not recorded has none, and no function has second ones: asking for them is an error
    of the library, not a number. Where the status is not 0, all outputs and derivatives are NaN.

    Args:
        program: The program.
        library: `"casadi"`: a `casadi.Function` with named inputs and outputs, arrays flattened row by row;
            `"jax"`: a function of arrays (…, *shape), by place or name, that gives a dictionary, for `jit`, `vmap`,
            `grad`, `jacfwd`; `"torch"`: one of tensors (…, *shape), by place or name, that gives a dictionary.
        outputs: The names of those that are asked for, in the program's order, default all.

    Raises:
        InvalidInputError: No such library or output.
        CcpinError: The library is not installed; the message names the extra that brings it.
    """
    program = instance(program, "program", Program)
    choice(library, "library", ("casadi", "jax", "torch"))
    try:
        if library == "casadi":
            from ccpin.programs.bridges.casadi_function import function_of as made
        elif library == "jax":
            from ccpin.programs.bridges.jax_function import function_of as made
        else:
            from ccpin.programs.bridges.torch_function import function_of as made
    except ModuleNotFoundError as error:
        raise CcpinError(f"{library} is not installed: pip install 'ccpin[{library}]' ({error})") from None
    return made(program, outputs)


def differential_action(program: Program, costs: Any) -> Any:
    """A `crocoddyl.DifferentialActionModelAbstract` of x = (q, q̇), for Crocoddyl's integrators (Euler, RK).

    Every node keeps the y of the last state that it was asked for, and goes on from there; where σ's steps do not reach
    the next state, from the node's before it, else in parts of the way. Where that fails q̈ is NaN, at which solvers
    shorten their step.

    Args:
        program: `record(model, ["forward_dynamics", "sigma"], given="near", derivatives=("q", "v", "u"))`.
        costs: A `crocoddyl.CostModelSum` over `crocoddyl.StateVector(2n)` and as many controls as motors.

    Raises:
        InvalidInputError: The program is another one, its q is no vector (balls), or the costs do not fit.
        NoCompilerError: There is no C compiler.
        CcpinError: Crocoddyl is not installed: the extra `crocoddyl` brings it.
    """
    program = instance(program, "program", Program)
    try:
        from ccpin.programs.bridges.crocoddyl_model import action_of
    except ModuleNotFoundError as error:
        raise CcpinError(f"crocoddyl is not installed: pip install 'ccpin[crocoddyl]' ({error})") from None
    return action_of(program, costs)
