"""Certificates of programs as documents: what claims are made of, and nothing that was found.

A document holds a program, what it was put together of, the region, the tubes of its branch and the formats. All that
a certificate says is proved of these numbers when it is replayed: a forged document is refused, undecided or true.
Nothing in it says that the program is a mechanism's: who wants to know records it again, and compares digests.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ccpin.containers import NamedArrays, told_of
from ccpin.errors import InvalidInputError
from ccpin.programs.instructions import Code, Instruction, Kind, LinearSystem
from ccpin.programs.program import WORDS, Program, program_of_text
from ccpin.programs.program_sources import ProgramSource
from ccpin.programs.written_numbers import count_of, rational_of, rational_text
from ccpin.proof.facts import Unproved
from ccpin.proof.theorems import theorems
from ccpin.schemas import Field, Schema
from ccpin.validated.programs.branch_claim import BranchOverCells
from ccpin.validated.programs.error_sweeps import FORMATS
from ccpin.validated.programs.program_equations import ProgramEquations
from ccpin.validated.programs.rounding_claim import ProgramComputed
from ccpin.validated.programs.steps_claim import StepsFindSigma

CERTIFIED_PROGRAM = Schema(
    "a program's certificate",
    "ccpin-program-1",
    {"theorem": str, "program": str, "source": str, "formats": [str]},
    {
        "lower": Field("f", "Q", "θ"),
        "upper": Field("f", "Q", "θ"),
        "bounds": Field("f", "W", "of the input", 0),
        "start": Field("f", "Y", "θ", 0),
        "counts": Field("i", "Q", "", 1),
        "centre": Field("f", "B Y", "θ"),
        "slopes": Field("f", "B Y Q"),
        "radius": Field("f", "B Y", "θ", 0),
        "preconditioner": Field("f", "B Y Y"),
    },
)
_THEOREMS = ("program_branch", "program_steps", "program_rounding", "sine_cosine")
_TUBES = ("counts", "centre", "slopes", "radius", "preconditioner")
_WORDS = {**WORDS, Kind.INPUT: "input", Kind.SOLVE: "solve", Kind.PART: "part"}
_KINDS = {word: kind for kind, word in _WORDS.items()}
_MANY, _DIGITS = 64, 4000  # Newton's steps, and digits of a constant: more are a means to fill a memory


class StatedClaims(NamedTuple):
    """What a document claims, unproved; as facts until they are replayed, as pickled ones are.

    Attributes:
        branch: The branch over cells.
        steps: What Newton's steps find; ``None`` where there are none.
        computed: What is computed, one a format.
    """

    branch: Any
    steps: Any
    computed: tuple[Any, ...]


def write_certificate(
    path: str | Path, program: Program, found: NamedArrays, branch: Any, formats: Sequence[str]
) -> None:
    """Write a document: `found` are region, bounds and start, `branch` the claim about the branch.

    Raises:
        InvalidInputError: It cannot be written.
    """
    tubes = {name: getattr(branch, name) for name in _TUBES}
    header = {
        "theorem": theorems(*_THEOREMS), "program": program.text,
        "source": _source_text(branch.equations.source), "formats": list(formats),
    }  # fmt: skip
    CERTIFIED_PROGRAM.write(path, header, found | tubes)


def read_certificate(path: str | Path) -> tuple[Program, NamedArrays, StatedClaims]:
    """The program, region, bounds and start of a document, and what is claimed of them.

    Raises:
        InvalidInputError: It is none; the file is named.
    """
    header, arrays = CERTIFIED_PROGRAM.read(path)
    with told_of(path):
        program, source = program_of_text(header["program"]), _source_of(json.loads(header["source"]))
        equations = ProgramEquations(source)
        names = [each.name for each in FORMATS]
        numbers = [names.index(name) for name in header["formats"]]
        if not numbers or len(set(numbers)) < len(numbers):
            raise InvalidInputError("formats must be some of double and float, each once")
        tubes = (arrays.pop(name) for name in _TUBES)
        branch = Unproved(BranchOverCells(equations, arrays["lower"], arrays["upper"], *tubes))
        steps = Unproved(StepsFindSigma(equations, arrays["start"]), (branch,)) if source.steps else None
        premises = (branch,) if steps is None else (branch, steps)
        computed = tuple(
            Unproved(ProgramComputed(equations, arrays["start"], arrays["bounds"], np.array([number])), premises)
            for number in numbers
        )
        return replace(program, source=source), arrays, StatedClaims(branch, steps, computed)


def _source_text(source: ProgramSource) -> str:
    codes = {name: _written(getattr(source, name)) for name in ("closure", "inner")}
    return json.dumps(source._asdict() | codes, allow_nan=False)


def _written(code: Code) -> dict[str, Any]:
    lines = []
    for item in code.instructions:
        constant = None if item.constant is None else rational_text(item.constant)
        lines.append([_WORDS[item.kind], item.target, item.a, item.b, constant])
    return code._asdict() | {"instructions": lines}


def _source_of(document: Mapping[str, Any]) -> ProgramSource:
    """The source of a document.

    Raises:
        ValueError, TypeError, LookupError: It is none.
    """
    found = dict(document)
    found |= {name: _code_of(found[name]) for name in ("closure", "inner")}
    found |= {name: _counts(found[name]) for name in ("independent", "sizes")}
    found["ports"] = tuple((_text(name), count_of(size)) for name, size in found["ports"])
    found["samples"] = tuple(tuple(map(_number, row)) for row in found["samples"])
    if count_of(found["steps"]) > _MANY:
        raise ValueError(f"more than {_MANY} steps")
    return ProgramSource(**found)


def _code_of(document: Any) -> Code:
    size, inputs = count_of(document["size"]), count_of(document["inputs"])
    if inputs > size:
        raise ValueError(f"a program of {size} values")
    return Code(size, inputs, tuple(map(_instruction, document["instructions"])), _counts(document["outputs"]))


def _instruction(entry: Any) -> Instruction:
    word, target, a, b, constant = entry
    kind = _KINDS[word]
    if kind == Kind.SOLVE:
        b = LinearSystem(*(tuple(map(_counts, table)) for table in b))
    elif b is not None:
        count_of(b)
    if a is not None:
        count_of(a)
    if kind in (Kind.CONSTANT, Kind.SCALE):
        constant = rational_of(constant, _DIGITS)
    elif constant is not None:
        raise ValueError("a constant of an operation that has none")
    return Instruction(kind, count_of(target), a, b, constant)


def _counts(values: Any) -> tuple[int, ...]:
    return tuple(map(count_of, values))


def _text(value: Any) -> str:
    if type(value) is not str:
        raise ValueError(f"{value!r:.40} is no name")
    return value


def _number(value: Any) -> float:
    if type(value) is not float or not math.isfinite(value):
        raise ValueError(f"{value!r:.40} is no number")
    return value
