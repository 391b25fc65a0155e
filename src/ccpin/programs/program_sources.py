"""How a program is put together of what was recorded: σ's Newton steps, then what is evaluated at their end, no solves.

What a program is made of is data (`ProgramSource`), so that whoever has it can put the same program together and knows
which of its values are what.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.programs.instructions import Code
from ccpin.programs.lowering import Pivot, lowered
from ccpin.programs.tape import Expression, Tape

Table = Any  # an array of expressions
REFERENCE = ("q_d", "v_d", "a_d", "g_d")  # of laws whose reference moves
INPUTS = ("v", "u", "a", "p", "h", *REFERENCE)  # of what is recorded, after x


class ProgramSource(NamedTuple):
    """What a program is made of.

    Attributes:
        closure: As many equations of x (and p) as numbers y of it depend; further inputs are not read.
        inner: The outputs as functions of x and `INPUTS`, with linear solves.
        independent: Places of q in x.
        sizes: Of x, v, u, a and p; of a step's h after them; of a law's reference after that (`INPUTS`).
        ports: The program's inputs by name, with sizes: q, y, then those of `INPUTS` that are read.
        steps: Newton steps of σ, one more with the last matrix following; 0 where y is given closed.
        samples: Of the program's inputs, at which pivots are chosen, of shape (N, inputs), row by row.
        checked: How many of the last outputs of `inner` are corrections of y, and no outputs.
    """

    closure: Code
    inner: Code
    independent: tuple[int, ...]
    sizes: tuple[int, ...]
    ports: tuple[tuple[str, int], ...]
    steps: int
    samples: tuple[tuple[float, ...], ...]
    checked: int = 0

    @property
    def dependent(self) -> tuple[int, ...]:
        """Places of y in x, in order."""
        return tuple(k for k in range(self.sizes[0]) if k not in self.independent)


class Assembled(NamedTuple):
    """A program put together.

    Attributes:
        code: Instructions without linear solves, and the outputs.
        pivots: Values that solves divide by.
        iterates: Numbers of the values of y after each Newton step of σ, and after the one more; none where y is given.
        corrections: Numbers of the last corrections of y.
    """

    code: Code
    pivots: tuple[Pivot, ...]
    iterates: tuple[tuple[int, ...], ...]
    corrections: tuple[int, ...]


def assembled(source: ProgramSource) -> Assembled:
    """The program of a source."""
    names, sizes = zip(*source.ports, strict=True)
    tape = Tape(sum(sizes))
    given = dict(zip(names, np.split(np.array(tape.inputs, dtype=object), np.cumsum(sizes)[:-1]), strict=True))
    q, y = given["q"], given["y"]
    due = zip(INPUTS, source.sizes[1:], strict=False)
    others = [entry for name, size in due for entry in given.get(name, np.zeros(size, dtype=object))]
    iterates, correction = _newton(tape, source, (q, y), others) if source.steps else ([], [])
    end = iterates[-1] if iterates else y
    results = tape.inlined(source.inner, [*_placed(source, q, end), *others])
    if source.checked:
        results, correction = results[: -source.checked], results[-source.checked :]
    asked = [*results, *(entry for each in iterates for entry in each), *correction]
    done = lowered(tape.code(asked), np.array(source.samples))
    outputs, m = done.code.outputs, len(y)
    shown, rest = outputs[: len(results)], outputs[len(results) :]
    rows = tuple(rest[m * k : m * (k + 1)] for k in range(len(iterates)))
    return Assembled(done.code._replace(outputs=shown), done.pivots, rows, rest[m * len(iterates) :])


def slopes_of(closure: Code, columns: tuple[int, ...]) -> Code:
    """The derivatives of equations by some of their inputs, row by row."""
    tape = Tape(closure.inputs)
    rows = tape.inlined(closure, tape.inputs)
    found = [tape.derivative(rows, {k: 1}) for k in columns]
    return tape.code([entry for row in zip(*found, strict=True) for entry in row])


def bend_of(closure: Code, columns: tuple[int, ...]) -> Code:
    """The rates of those derivatives along a direction η of the same inputs, which are the last of its inputs."""
    tape = Tape(closure.inputs + len(columns))
    rows = tape.inlined(closure, tape.inputs[: closure.inputs])
    table = [tape.derivative(rows, {k: 1}) for k in columns]
    way = dict(zip(columns, tape.inputs[closure.inputs :], strict=True))
    return tape.code(tape.derivative([entry for row in zip(*table, strict=True) for entry in row], way))


def _newton(
    tape: Tape, source: ProgramSource, start: tuple[Table, Table], others: list[Expression]
) -> tuple[list[Table], Table]:
    """Y after each of so many Newton steps of φ(q, y) = 0 and after one more with the last matrix; its correction."""
    slopes = slopes_of(source.closure, source.dependent)
    q, y = start
    m, found, matrix, correction = len(y), list[Table](), None, y
    for step in range(source.steps + 1):
        at = [*_placed(source, q, y), *others]
        residual = np.array(tape.inlined(source.closure, at), dtype=object)
        if step < source.steps:
            matrix = np.array(tape.inlined(slopes, at), dtype=object).reshape(m, m)
        correction = tape.solve(matrix, residual[:, None])[:, 0]
        y = y - correction
        found.append(y)
    return found, correction


def _placed(source: ProgramSource, q: Table, y: Table) -> list[Expression]:
    x = np.zeros(source.sizes[0], dtype=object)
    x[list(source.independent)], x[list(source.dependent)] = q, y
    return x.tolist()
