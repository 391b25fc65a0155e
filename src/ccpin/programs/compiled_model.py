"""A reduced model's batches by compiled programs, and by the core where those do not answer.

σ starts at the configuration `near` (q₀, y₀), a step along the line first: y₀ + (∂y/∂q)(q − q₀), then Newton's steps.
A row is answered by the program where |q − q₀| ≤ `REACH`, its solves divided by nothing small, the last correction was
so small that what is left is rounding, and σ lies where the line led: within `BENT` of the way along it, which the
other branch of a fold does not. All other rows are the core's, and so are all refusals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from threading import RLock
from typing import Any, NamedTuple, overload

import numpy as np

from ccpin.arrays import Array, Mask, choice, instance, whole
from ccpin.dynamics.batches import Failures, Rows, completed, rows, together
from ccpin.dynamics.derivatives import ForwardDynamicsDerivatives
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, ReducedTerms, State
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.compiling import compiler
from ccpin.programs.lanes import CompiledProgram, width
from ccpin.programs.line import from_a_line
from ccpin.programs.numbers import NumbersOfRows
from ccpin.programs.program import Program
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recordings import record
from ccpin.programs.sine_cosine import Format

REACH = 0.1  # of |q − q₀| in each number, rad or m
BENT = 0.25  # of |y₁ − y₀| along the line: how far from there σ(q) may be
STEPS, ROUNDED = 2, 2e-9  # Newton's steps; the last correction δ leaves δ^{3/2}, which is rounding


class LaneBackend(NamedTuple):
    """What computes batches.

    Attributes:
        name: `"lanes"`, or the model's own backend's.
        reason: Why, in one line.
    """

    name: str
    reason: str


class CompiledModel:
    """Batches of a reduced model with the signatures and the answers of its own `…_many`.

    `near` may also be a configuration for each row, of shape (N, nq). A method's program is recorded and compiled when
    it is first called. Where there is no compiler, or q is no list of numbers, the model's core does all.

    Args:
        model: A reduced model, or a mechanism.

    Attributes:
        model: The model.
        backend: What computes, and why.
    """

    def __init__(self, model: ReducedModel | Mechanism) -> None:
        self.model = instance(model_of(model), "model", ReducedModel)
        own = self.model.backend
        self._own, self.backend = numbering(self.model, self.model.mechanism.q_reference), LaneBackend(*own)
        self._numbers = NumbersOfRows(self.model, self._own)
        self._made, self._lock = dict[str, CompiledProgram](), RLock()
        if not self._own.q.scalar:
            self.backend = LaneBackend(own.name, "q has whole balls or carriages: its batches are the core's")
            return
        try:
            command = compiler()
        except CcpinError as error:
            self.backend = LaneBackend(own.name, f"{error}: batches are the core's")
            return
        self.backend = LaneBackend("lanes", f"{width().name}, compiled by {command[0]}; {own.name} where it declines")

    def __reduce__(self) -> tuple[type[CompiledModel], tuple[ReducedModel]]:
        return CompiledModel, (self.model,)

    def sigma_many(self, Q: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None) -> Array:
        """σ of each row of Q (N, model.nq), of shape (N, nq)."""
        given = [rows(Q, "Q", self.model.nq)]
        return self._many("sigma", given, near, threads, [(self.model.mechanism.nq,)], failures)[0]

    def forward_dynamics_many(
        self, Q: Rows, V: Rows, U: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> Array:
        """`forward_dynamics` of each row of Q, V and U, of shape (N, n)."""
        model = self.model
        given = [rows(Q, "Q", model.nq), rows(V, "V", model.n), rows(U, "U", model.n_actuated)]
        return self._many("forward_dynamics", given, near, threads, [(model.n,)], failures)[0]

    def inverse_dynamics_many(
        self, Q: Rows, V: Rows, A: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> Array:
        """`inverse_dynamics` of each row of Q, V and A, of shape (N, motors)."""
        model = self.model
        given = [rows(Q, "Q", model.nq), rows(V, "V", model.n), rows(A, "A", model.n)]
        return self._many("inverse_dynamics", given, near, threads, [(model.n_actuated,)], failures)[0]

    def forward_dynamics_derivatives_many(
        self, Q: Rows, V: Rows, U: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> ForwardDynamicsDerivatives:
        """`forward_dynamics_derivatives` of each row of Q, V and U; every field has a leading axis of length N."""
        model, n = self.model, self.model.n
        given = [rows(Q, "Q", model.nq), rows(V, "V", n), rows(U, "U", model.n_actuated)]
        shapes = (n, n), (n, n), (n, model.n_actuated)
        found = self._many("forward_dynamics_derivatives", given, near, threads, shapes, failures)
        return ForwardDynamicsDerivatives(*found)

    def terms_many(
        self, Q: Rows, V: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> ReducedTerms:
        """`terms` of each row of Q and V; every field has a leading axis of length N."""
        n, n_free = self.model.n, self.model.mechanism.n_free
        shapes = (self.model.mechanism.nq,), (n_free,), (n_free, n), (n_free, n), (n, n), (n, n), (n,)
        given = [rows(Q, "Q", self.model.nq), rows(V, "V", n)]
        return ReducedTerms(*self._many("terms", given, near, threads, shapes, failures))

    def _many(
        self,
        name: str,
        given: list[Array],
        near: Near,
        threads: int,
        shapes: Sequence[tuple[int, ...]],
        failures: Failures | None,
    ) -> list[Array]:
        """Rows by the program, then by the core, then one by one by the reference, which explains."""
        count, threads = together(*given), whole(threads, "threads")
        held = self._starts(near, count)
        fields, answered = self._by_program(name, given, held, threads, shapes)
        rest = np.flatnonzero(~answered)
        if len(rest) and held.ndim == 1:
            place = near.q_free if isinstance(near, State) else near
            found = getattr(self.model.core, f"{name}_many")(*(array[rest] for array in given), place, threads)
            if found is not None:
                answers = (found[0],) if len(shapes) == 1 else found[0]
                finite = np.logical_and.reduce([np.isfinite(array[rest]).all(axis=1) for array in given])
                for field, answer in zip(fields, answers, strict=True):
                    field[rest] = answer
                answered[rest] = found[1] & finite

        def alone(row: int) -> Sequence[Array]:
            branch = near if held.ndim == 1 else held[row]
            answer = getattr(self.model, name)(*(array[row] for array in given), branch)
            return (answer,) if len(shapes) == 1 else answer

        return completed((fields, answered), alone, count, shapes, failures)

    def _starts(self, near: Near, count: int) -> Array:
        """The configuration that all rows start at, or one for each.

        Raises:
            InvalidInputError: Another shape.
        """
        nq = self.model.mechanism.nq
        if near is None:
            return self.model.mechanism.q_reference
        if isinstance(near, State):
            return self.model.at(near).q_free
        held = np.asarray(near, dtype=np.float64)
        if held.shape not in ((nq,), (count, nq)):
            raise InvalidInputError(f"near has shape {held.shape}; it must be ({nq},) or ({count}, {nq})")
        return held

    def _by_program(
        self, name: str, given: list[Array], held: Array, threads: int, shapes: Sequence[tuple[int, ...]]
    ) -> tuple[list[Array], Mask]:
        """The program's answers, and which rows they are for."""
        count = len(given[0])
        programs = self._programs(name)
        if programs is None or not count:
            return [np.full((count, *shape), np.nan) for shape in shapes], np.zeros(count, dtype=np.bool_)
        slope, program = programs
        q0, y0, closed = self._numbers.start(np.atleast_2d(held))
        _, along, status = slope(q0, y0, threads=threads)
        starts = (q0, y0, along) if held.ndim == 2 else (q0[0], y0[0], along[0])
        q, known = self._numbers.independent(given[0], starts[0])
        *found, bend, done = program(q, *starts, *given[1:], threads=threads)
        with np.errstate(invalid="ignore"):
            near = (np.abs(q - starts[0]) <= REACH).all(axis=1) & (bend[:, 0] <= BENT**2 * bend[:, 1] + ROUNDED**2)
        answered = near & known & closed & (status == 0) & (done == 0)
        if name in ("sigma", "terms"):
            found[0] = self._numbers.q_free(q, found[0])
        for array in (*given, *found):
            if not np.isfinite(array).all():
                answered &= np.isfinite(array).reshape(count, -1).all(axis=1)
        return found, answered

    def _programs(self, name: str) -> tuple[CompiledProgram, CompiledProgram] | None:
        """∂y/∂q at starts, and the program of a method; ``None`` where the core does all."""
        with self._lock:
            if self.backend.name != "lanes":
                return None
            try:
                if not self._made:
                    slope = record(self.model, "sigma", derivatives=("q",))
                    self._made[""] = CompiledProgram(slope)
                if name not in self._made:
                    self._made[name] = CompiledProgram(self._recorded(name))
            except CcpinError as error:
                self.backend = LaneBackend(self.model.backend.name, f"{error}: batches are the core's")
                return None
            return self._made[""], self._made[name]

    def _recorded(self, name: str) -> Program:
        what, by, wanted = _RECORDED[name]
        near = record(self.model, ("sigma", *what), given="near", steps=STEPS, derivatives=by)
        return from_a_line(replace(near, tolerance=ROUNDED), wanted)


_TERMS = ("v_free", "rho", "rho_dot", "mass", "coriolis", "gravity")
_RECORDED: dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {
    "sigma": ((), (), ("sigma",)),
    "forward_dynamics": (("forward_dynamics",), (), ("forward_dynamics",)),
    "inverse_dynamics": (("inverse_dynamics",), (), ("inverse_dynamics",)),
    "forward_dynamics_derivatives": (
        ("forward_dynamics",),
        ("q", "v", "u"),
        ("forward_dynamics_by_q", "forward_dynamics_by_v", "forward_dynamics_by_u"),
    ),
    "terms": (_TERMS, (), ("sigma", *_TERMS)),
}  # what is recorded beside σ, its derivatives, and the outputs that are fields of the answer


@overload
def compiled(subject: Program, format: Format = "double") -> CompiledProgram: ...
@overload
def compiled(subject: ReducedModel | Mechanism) -> CompiledModel: ...
def compiled(subject: Any, format: Format = "double") -> CompiledModel | CompiledProgram:
    """A program, or a model's batches, in lanes of vectors by the system's C compiler.

    The arithmetic is the program's, operation by operation: nothing is fused or reordered, so that every row has the
    same bits wherever it stands and on whatever vectors. Libraries are kept in `ccpin/programs` under XDG_CACHE_HOME or
    ~/.cache, a folder that only the user can enter; `CC` names the compiler.

    Args:
        subject: A program, or a reduced model or mechanism.
        format: `"double"` or `"float"`, of a program's arithmetic; a model's is double.

    Returns:
        For a program, a function of its inputs, each of shape (N, …) or one for all, that gives its outputs in order
        and the status, (N,). For a model, an object with its `sigma_many`, `forward_dynamics_many`,
        `inverse_dynamics_many`, `forward_dynamics_derivatives_many` and `terms_many`, and `backend`.

    Raises:
        InvalidInputError: It is neither, or a model in single precision.
        CcpinError: There is no C compiler, or it fails, for a program; a model's core then does all.
    """
    if isinstance(subject, Program):
        return CompiledProgram(subject, format)
    choice(format, "format of a model", ("double",))
    return CompiledModel(subject)
