"""A recorded program: named inputs and outputs, straight-line arithmetic between them, NumPy to run it."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from hashlib import sha256
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.files import write_text
from ccpin.programs.certified_region import OUTSIDE, CertifiedRegion, region_of
from ccpin.programs.evaluation import values_of
from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.programs.lowering import Pivot
from ccpin.programs.sine_cosine import DOUBLE
from ccpin.programs.written_numbers import count_of, rational_of, rational_text

if TYPE_CHECKING:
    from ccpin.programs.program_sources import ProgramSource

_OPERANDS = {  # how many an instruction of a word has: of sine and cosine the second is the other of them
    "constant": (0,), "add": (2,), "subtract": (2,), "multiply": (2,), "scale": (1,), "sine": (1, 2), "cosine": (1, 2),
    "gain": (2,), "root": (1,), "reciprocal": (1,), "angle": (2,),
}  # fmt: skip
WORDS: dict[int, str] = {getattr(Kind, word.upper()): word for word in _OPERANDS}
_FORMAT, _VERSION = "ccpin.program", 1
_DIGITS = 400  # of a constant
_NONE = (  # what reading no program raises
    OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError,
)  # fmt: skip
SMALL_PIVOT = 1e-6  # of its size at the samples: a state at which a solve divides by less is refused


class Port(NamedTuple):
    """A named array that a program reads or writes.

    Attributes:
        name: Its name.
        shape: Its shape.
        unit: The unit of every entry, or of each, row by row.
        entries: What each entry is, row by row.
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    entries: tuple[str, ...]

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return math.prod(self.shape)


def windows(ports: Iterable[Port]) -> list[slice]:
    """Where the numbers of each port stand among those of all, side by side."""
    ends = list(accumulate((port.size for port in ports), initial=0))
    return [slice(*pair) for pair in pairwise(ends)]


class Answer(Mapping[str, Array]):
    """Outputs by name; `status` is 0 where they can be trusted.

    Attributes:
        status: 0; 1 where a solve divided by what is almost 0, or an angle is none or beyond 1e5 rad, where compiled
            sines are wrong; 2 where Newton's steps of σ had not converged; 3 outside the region of a program with one.
    """

    def __init__(self, outputs: dict[str, Array], status: Any) -> None:
        self._outputs, self.status = outputs, status

    def __getitem__(self, name: str) -> Array:
        return self._outputs[name]

    def __iter__(self) -> Any:
        return iter(self._outputs)

    def __len__(self) -> int:
        return len(self._outputs)

    def __repr__(self) -> str:
        return f"Answer({', '.join(f'{name} {np.shape(value)}' for name, value in self.items())}, status={self.status})"


@dataclass(frozen=True, eq=False)
class Program:
    """Straight-line arithmetic from named inputs to named outputs.

    Attributes:
        name: What it is of.
        inputs, outputs: The ports, in the order of the numbers.
        code: The instructions, without linear solves.
        pivots: Values that solves divide by.
        corrections: Numbers of the last corrections of σ's Newton steps; none where q′ is given closed.
        tolerance: The length of those from which on the steps had not converged.
        example: Inputs at which it was recorded, in the order of the numbers.
        around: Inputs at closed states about it, alike.
        notes: What else whoever calls it has to know, a line each.
        source: What it was put together of; programs that were loaded have none.
        region: Outside of which its status is 3; none where nothing was proved of it.
    """

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    code: Code
    pivots: tuple[Pivot, ...] = ()
    corrections: tuple[int, ...] = ()
    tolerance: float = 0.0
    example: tuple[float, ...] = ()
    around: tuple[tuple[float, ...], ...] = ()
    notes: tuple[str, ...] = ()
    source: ProgramSource | None = None
    region: CertifiedRegion | None = None

    def __call__(self, **inputs: ArrayLike) -> Answer:
        """The outputs at inputs of the ports' shapes, or of many at once along a first axis more."""
        given, many = self._numbers(inputs)
        rows = len(given)
        with np.errstate(all="ignore"):
            values = values_of(self.code, list(given.T), np)
            status = self._status(values, rows)
        found = dict[str, Array]()
        for port, window in zip(self.outputs, windows(self.outputs), strict=True):
            columns = [values[k] for k in self.code.outputs[window]]
            table = (
                np.stack([np.broadcast_to(column, (rows,)) for column in columns], axis=1)
                if columns
                else np.empty((rows, 0))
            )
            shaped = table.reshape(rows, *port.shape)
            found[port.name] = shaped if many else shaped[0]
        return Answer(found, status if many else int(status[0]))

    def _status(self, values: list[Any], rows: int) -> Any:
        """0, 1, 2 or 3 for every row."""
        divides = np.zeros(rows, dtype=np.bool_)
        for angle in {item.a: None for item in self.code.instructions if item.kind in (Kind.SINE, Kind.COSINE)}:
            divides |= ~(np.square(values[angle]) < DOUBLE.reach**2)
        for pivot in self.pivots:
            divides |= ~(np.square(values[pivot.number]) > (SMALL_PIVOT * pivot.scale) ** 2)
        moved = np.zeros(rows)
        for number in self.corrections:
            moved = moved + values[number] ** 2
        stays = moved < self.tolerance**2 if self.corrections else True
        status = np.where(divides, 1, np.where(stays, 0, 2))
        if self.region is None:
            return status
        return np.where(self.region.holds(values[: self.code.inputs], DOUBLE), status, OUTSIDE)

    def _numbers(self, inputs: dict[str, ArrayLike]) -> tuple[Array, bool]:
        """All inputs side by side, of shape (N, inputs), and whether there were many."""
        known = [port.name for port in self.inputs]
        if sorted(inputs) != sorted(known):
            raise InvalidInputError(
                f"the inputs of '{self.name}' are {', '.join(known)}, not {', '.join(inputs) or 'none'}"
            )
        given = [(port, numbers(inputs[port.name], port.name)) for port in self.inputs]
        many = any(value.ndim > len(port.shape) for port, value in given)
        for port, value in given:
            if value.shape[value.ndim - len(port.shape) :] != port.shape or value.ndim > len(port.shape) + 1:
                raise InvalidInputError(f"{port.name} must be of shape {port.shape}, or (N, …), not {value.shape}")
        rows = max((len(value) for port, value in given if value.ndim > len(port.shape)), default=1)
        wide = [value if value.ndim > len(port.shape) else value[None] for port, value in given]
        if any(len(value) not in (1, rows) for value in wide):
            raise InvalidInputError(f"inputs of different numbers of rows: {[len(value) for value in wide]}")
        columns = [np.broadcast_to(value, (rows, *value.shape[1:])).reshape(rows, -1) for value in wide]
        return np.hstack(columns) if columns else np.empty((1, 0)), many

    @property
    def operations(self) -> dict[str, int]:
        """How many operations of each kind it makes, constants apart."""
        counts = Counter(WORDS[item.kind] for item in self.code.instructions if item.kind != Kind.CONSTANT)
        return dict(sorted(counts.items()))

    @property
    def digest(self) -> str:
        """A fingerprint of all that it computes."""
        return _digest(self._document())

    def __repr__(self) -> str:
        ports = (", ".join(f"{port.name} {port.shape}" for port in group) for group in (self.inputs, self.outputs))
        where = "" if self.region is None else ", refused outside a region"
        return "Program({}: {} → {}; {} operations{})".format(self.name, *ports, sum(self.operations.values()), where)

    def __str__(self) -> str:
        """It as mathematics, a line a value."""
        names = dict(enumerate(_entries(self.inputs)))
        reads, gives = (", ".join(port.name for port in group) for group in (self.inputs, self.outputs))
        lines = [f"{self.name}: {reads} ↦ {gives}"]
        for item in self.code.instructions:
            names[item.target] = f"t{item.target}" if item.kind != Kind.CONSTANT else _short(item.constant)
            if item.kind != Kind.CONSTANT:
                lines.append(f"{names[item.target]} = {_formula(item, names)}")
        lines += [f"{entry} = {names[k]}" for entry, k in zip(_entries(self.outputs), self.code.outputs, strict=True)]
        return "\n".join(lines)

    def save(self, path: str | Path) -> None:
        """Write it as JSON, with its digest; `load` reads it again."""
        write_text(path, self.text)

    @property
    def text(self) -> str:
        """The JSON that `save` writes."""
        document = self._document()
        return json.dumps(document | {"digest": _digest(document)})

    @classmethod
    def load(cls, path: str | Path) -> Program:
        """A program that `save` wrote; NumPy alone runs it.

        Raises:
            CcpinError: The file is none, is damaged, or of a later version.
        """
        try:
            return program_of_text(Path(path).read_bytes())
        except _NONE as error:
            raise CcpinError(f"{path} is no program of ccpin's: {error}") from None

    def _document(self) -> dict[str, Any]:
        return {
            "format": _FORMAT, "version": _VERSION, "name": self.name,
            "inputs": [port._asdict() for port in self.inputs], "outputs": [port._asdict() for port in self.outputs],
            "size": self.code.size, "results": list(self.code.outputs),
            "instructions": [_written(item) for item in self.code.instructions],
            "pivots": [[pivot.number, pivot.scale.hex()] for pivot in self.pivots],
            "corrections": list(self.corrections), "tolerance": self.tolerance.hex(),
            "example": [value.hex() for value in self.example],
            "around": [[value.hex() for value in row] for row in self.around], "notes": list(self.notes),
            **({} if self.region is None else {"region": self.region.document()}),
        }  # fmt: skip


def _digest(document: dict[str, Any]) -> str:
    return sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def program_of_text(text: str | bytes) -> Program:
    """The program of a JSON text.

    Raises:
        ValueError, LookupError, TypeError, AttributeError, ArithmeticError: It is none, or was changed.
    """
    document = json.loads(text)
    program = _program_of(document)
    if document.get("digest") != program.digest:
        raise ValueError("it was changed since it was written: its digest is another")
    return program


def _program_of(document: Any) -> Program:
    """The program of a document.

    Raises:
        ValueError: It is none.
    """
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise ValueError("it says nothing of ccpin.program")
    if document["version"] != _VERSION or type(document["version"]) is not int:
        raise ValueError(f"it is of version {document['version']}, this ccpin reads {_VERSION}")
    reads, gives = (tuple(map(_port_of, document[side])) for side in ("inputs", "outputs"))
    count, size = sum(port.size for port in reads), count_of(document["size"])
    instructions, defined = list[Instruction](), set(range(count))
    for entry in document["instructions"]:
        item = _read(entry)
        if not defined.issuperset(item.operands) or item.target in defined or not count <= item.target < size:
            raise ValueError(f"instruction {entry} has operands that are not there")
        defined.add(item.target)
        instructions.append(item)
    results, corrections = (tuple(map(count_of, document[key])) for key in ("results", "corrections"))
    pivots = tuple(Pivot(count_of(number), _number(scale, 0.0)) for number, scale in document["pivots"])
    asked = {*results, *corrections, *(pivot.number for pivot in pivots)}
    if not defined.issuperset(asked) or len(results) != sum(port.size for port in gives):
        raise ValueError("its outputs are not there")
    code = Code(size, count, tuple(instructions), results)
    example, *rows = (tuple(map(_number, row)) for row in (document["example"], *document["around"]))
    if any(len(row) != count for row in (example, *rows)) or len({port.name for port in reads}) < len(reads):
        raise ValueError("examples of other inputs, or two of one name")
    tolerance, notes, name = _number(document["tolerance"]), tuple(map(str, document["notes"])), str(document["name"])
    region = region_of(document["region"], count) if "region" in document else None
    return Program(name, reads, gives, code, pivots, corrections, tolerance, example, tuple(rows), notes, region=region)


def _port_of(entry: Any) -> Port:
    shape, entries = tuple(map(count_of, entry["shape"])), tuple(map(str, entry["entries"]))
    port = Port(str(entry["name"]), shape, str(entry["unit"]), entries)
    if len(entries) != port.size:
        raise ValueError(f"{port.name} has {len(entries)} entries for {port.size} numbers")
    return port


def _number(text: str, above: float = -math.inf) -> float:
    """A finite number that `float.hex` wrote."""
    value = float.fromhex(text)
    if not above < value < math.inf:
        raise ValueError(f"{text!r} is no finite number" + (f" above {above:g}" if above > -math.inf else ""))
    return value


def _written(item: Instruction) -> list[Any]:
    constant = [] if item.constant is None else [rational_text(item.constant)]
    operands = [item.a, item.b] if item.kind == Kind.GAIN else list(item.operands)
    return [WORDS[item.kind], item.target, *operands, *constant]


def _read(entry: Any) -> Instruction:
    word, target, *rest = entry
    counts, kind, constant = _OPERANDS[word], getattr(Kind, word.upper()), None
    if kind in (Kind.CONSTANT, Kind.SCALE):
        *rest, text = rest
        constant = rational_of(text, _DIGITS)
        if abs(constant) >= 2**1000:
            raise ValueError(f"a constant of {len(text)} letters that no double is near")
    operands = tuple(map(count_of, rest))
    if len(operands) not in counts:
        raise ValueError(f"'{word}' of {len(operands)} operands")
    a, b = (*operands, None, None)[:2]
    return Instruction(kind, count_of(target), a, b, constant)


def _entries(ports: Sequence[Port]) -> list[str]:
    return [f"{port.name}[{entry}]" for port in ports for entry in port.entries]


def _formula(item: Instruction, names: Mapping[int, str]) -> str:
    a = names[item.a] if item.a is not None else ""
    kind = item.kind
    if sign := {Kind.ADD: "+", Kind.SUBTRACT: "−", Kind.MULTIPLY: "·"}.get(kind):
        return f"{a} {sign} {names[item.b]}"
    if kind == Kind.SCALE:
        return f"{_short(item.constant)} · {a}"
    if kind == Kind.ANGLE:
        return f"atan2({a}, {names[item.b]})"
    if kind == Kind.GAIN:
        return f"g{'′' * item.b}({a})"
    return {Kind.SINE: f"sin({a})", Kind.COSINE: f"cos({a})", Kind.RECIPROCAL: f"1/{a}", Kind.ROOT: f"√{a}"}[kind]


def _short(value: Fraction) -> str:
    return f"{float(value):.6g}"
