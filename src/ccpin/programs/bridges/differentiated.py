"""A recorded program taken apart: values, the derivatives that belong to them, and which are 0."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from ccpin.arrays import choice
from ccpin.errors import InvalidInputError
from ccpin.programs.evaluation import values_of
from ccpin.programs.folding import DOUBLES, folded
from ccpin.programs.instructions import Kind, ancestors
from ccpin.programs.program import SMALL_PIVOT, Port, Program, windows

STEP = "step_by_q"  # the tangent step that a change of q's numbers is, where q̇ is not their rate


class Differentiated(NamedTuple):
    """What a program computes, and what it was recorded to have as derivatives.

    Attributes:
        values: It without derivatives.
        slopes: It with derivatives alone; none where one is lacking.
        blocks: The name of ∂(output)/∂(input) among those, by their places; what is not there is 0.
        missing: Derivatives that were not recorded.
    """

    values: Program
    slopes: Program | None
    blocks: dict[tuple[int, int], str]
    missing: tuple[str, ...]


def parts_of(program: Program, outputs: str | Sequence[str] | None = None) -> Differentiated:
    """Values and derivatives of a program, or of some of its outputs."""
    names, inputs = {port.name for port in program.outputs}, [port.name for port in program.inputs]
    of = {f"{port.name}_by_{key}" for port in program.outputs for key in inputs} & names | ({STEP} & names)
    shown = [port.name for port in program.outputs if port.name not in of]
    if outputs is not None:
        asked = {
            choice(name, "outputs", tuple(shown)) for name in ((outputs,) if isinstance(outputs, str) else outputs)
        }
        shown = [name for name in shown if name in asked]
    blocks, missing = dict[tuple[int, int], str](), list[str]()
    for k, name in enumerate(shown):
        reads = _reads(program, name)
        for j, key in enumerate(inputs):
            if (word := f"{name}_by_{key}") in of:
                blocks[k, j] = word
            elif key != "y" and (key in reads or (key == "q" and "y" in reads)):
                missing.append(word)
    used = {*blocks.values(), *(names & {STEP})}
    return Differentiated(
        restricted(program, shown), None if missing else restricted(program, used), blocks, tuple(missing)
    )


def restricted(program: Program, names: Collection[str]) -> Program:
    """It with some of its outputs, in its order; the status stays what it was."""
    ports, results = list[Port](), list[int]()
    for port, window in zip(program.outputs, windows(program.outputs), strict=True):
        if port.name in names:
            ports.append(port)
            results += program.code.outputs[window]
    defined = {item.target: item.operands for item in program.code.instructions}
    asked = [*results, *program.corrections, *(pivot.number for pivot in program.pivots)]
    needed = ancestors(asked, lambda number: defined.get(number, ()))
    kept = tuple(item for item in program.code.instructions if item.target in needed)
    return replace(program, outputs=tuple(ports), code=program.code._replace(instructions=kept, outputs=tuple(results)))


def lacking(missing: Sequence[str]) -> InvalidInputError:
    """Why a function has no derivatives."""
    keys = sorted({word.rpartition("_by_")[2] for word in missing})
    return InvalidInputError(
        f"derivatives were not recorded: {', '.join(missing)}; record with derivatives={(*keys,)} or more"
    )


def evaluated(program: Program, columns: Sequence[Any], module: Any) -> tuple[list[Any], Any]:
    """Entries of the outputs, and whether they can be trusted, at entries of the inputs in a module's arithmetic."""
    watched = [*program.corrections, *(pivot.number for pivot in program.pivots)]
    shown = program.code.outputs
    code = folded(program.code._replace(outputs=(*shown, *watched)), DOUBLES)
    values = values_of(code, columns, module)
    trusted = module.true
    constant = {item.target for item in code.instructions if item.kind == Kind.CONSTANT}
    for pivot in program.pivots:
        if pivot.number not in constant:
            trusted = module.both(trusted, module.abs(values[pivot.number]) > SMALL_PIVOT * pivot.scale)
    if program.corrections:
        moved = sum(values[number] * values[number] for number in program.corrections)
        trusted = module.both(trusted, moved <= program.tolerance**2)
    if program.region is not None:
        for column, low, high in zip(columns, program.region.lower, program.region.upper, strict=True):
            trusted = module.both(trusted, module.both(column >= low, column <= high))
    return [values[number] for number in shown], trusted


def _reads(program: Program, name: str) -> set[str]:
    """The inputs that an output depends on."""
    used = restricted(replace(program, pivots=(), corrections=()), [name]).code.read
    pairs = zip(program.inputs, windows(program.inputs), strict=True)
    return {port.name for port, window in pairs if used & set(range(window.start, window.stop))}
