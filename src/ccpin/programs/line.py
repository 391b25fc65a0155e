"""Programs whose σ starts a step along a line from a known configuration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ccpin.programs.lowering import Pivot
from ccpin.programs.program import Port, Program, windows
from ccpin.programs.tape import Node, Tape


def from_a_line(program: Program, names: Sequence[str]) -> Program:
    """A program given `"near"` with an output `"sigma"`, started at y₀ + slope (q − q₀), of q, q0, y, slope, ….

    Its outputs are those named and `"bend"`: |σ − y₁|² and |y₁ − y₀|², y₁ being where it started.
    """
    q, y, *others = program.inputs
    columns = tuple(f"{row},{column}" for row in y.entries for column in q.entries)
    ports = (q, q._replace(name="q0"), y, Port("slope", (y.size, q.size), "", columns), *others)
    tape = Tape(sum(port.size for port in ports))
    numbers = np.array(tape.inputs, dtype=object)
    at, start, known, slope, *rest = (numbers[window] for window in windows(ports))
    first = known + slope.reshape(y.size, q.size) @ (at - start)
    pairs = zip(program.outputs, windows(program.outputs), strict=True)
    named = {port.name: program.code.outputs[window] for port, window in pairs}
    wanted = [number for name in names for number in named[name]]
    asked = [wanted, named["sigma"], program.corrections, [pivot.number for pivot in program.pivots]]
    code = program.code._replace(outputs=tuple(number for group in asked for number in group))
    values = np.array(tape.inlined(code, [*at, *first, *(node for each in rest for node in each)]), dtype=object)
    shown, sigma, corrections, pivots = np.split(values, np.cumsum([len(group) for group in asked])[:-1])
    off, along = sigma - first, first - known
    scales = [pivot.scale for pivot in program.pivots]
    sizes = {node.index: size for node, size in zip(pivots, scales, strict=True) if isinstance(node, Node)}
    by_name = {port.name: port for port in program.outputs}
    given = program.example
    return Program(
        program.name,
        ports,
        (*(by_name[name] for name in names), Port("bend", (2,), "", ("off the line", "along it"))),
        tape.code([*shown, off @ off, along @ along], [*corrections, *pivots]),
        tuple(Pivot(number, size) for number, size in sizes.items()),
        tuple(tape.node(each).index for each in corrections),
        program.tolerance,
        (*given[: q.size], *given[: q.size + y.size], *np.zeros(y.size * q.size).tolist(), *given[q.size + y.size :]),
    )
