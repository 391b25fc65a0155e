"""What `certify_program` found: facts about a program, and what is read off them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.certified_region import CertifiedRegion
from ccpin.programs.program import SMALL_PIVOT, Port, Program, windows
from ccpin.programs.recordings import record
from ccpin.programs.sine_cosine import PRECISIONS
from ccpin.proof.facts import Fact, is_fact, prove
from ccpin.proof.verdict import Judged, Verdict, not_known_of
from ccpin.validated.programs.branch_claim import BranchOverCells
from ccpin.validated.programs.certificate_documents import read_certificate, write_certificate
from ccpin.validated.programs.error_sweeps import FORMATS
from ccpin.validated.programs.guarding import example_rows, tube_hull
from ccpin.validated.programs.rounding_claim import ProgramComputed

_NOTHING = np.zeros(0)


def bounded(program: Program) -> list[Port]:
    """The inputs but q, y and p."""
    return [port for port in program.inputs if port.name not in ("q", "y", "p")]


def bounds_of(program: Program, bounds: Mapping[str, ArrayLike]) -> Array:
    """Bounds of all inputs but q, y and p, side by side.

    Raises:
        InvalidInputError: They are not the program's, or not numbers from 0 on.
    """
    ports = bounded(program)
    if sorted(bounds) != sorted(port.name for port in ports):
        names = ", ".join(port.name for port in ports) or "nothing else"
        raise InvalidInputError(f"bounds must be of what the program reads besides q, y and p: {names}")
    found = [_NOTHING]
    for port in ports:
        try:
            found.append(np.broadcast_to(np.asarray(bounds[port.name], dtype=np.float64), (port.size,)))
        except (ValueError, TypeError):
            raise InvalidInputError(f"bounds['{port.name}'] must be a number, or {port.size} of them") from None
    most = np.concatenate(found)
    if not (np.isfinite(most).all() and np.all(most >= 0.0)):
        raise InvalidInputError("bounds: every number must be finite, and 0 at least")
    return most


@dataclass(frozen=True, eq=False, repr=False)
class ProgramCertificate(Judged):
    """What was proved of a program over a region.

    Attributes:
        program: The program.
        lower, upper: The box of q, and of constants p after it where these are inputs.
        bounds: Of the absolute values of what it reads besides q, y and p, side by side.
        branch: The fact that σ is one function over the box, if there is one.
        steps: The fact that the program's Newton steps find it; ``None`` where it has none.
        computed: Facts about its arithmetic, one a format.
        stopped: What could not be proved; nothing where all was.
        start: How far y may be from σ(q), of shape (y,).
    """

    program: Program
    lower: Array
    upper: Array
    bounds: Array
    branch: Fact | None
    steps: Fact | None
    computed: tuple[Fact, ...]
    stopped: str = ""
    start: Array = field(default_factory=lambda: _NOTHING)

    @property
    def verdict(self) -> Verdict:
        """``"proven"``, or ``"undecided"``: so it is of one that was pickled, until it is replayed."""
        return "proven" if self._known else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        if not self._known:
            return self.stopped or not_known_of("this program and region")
        assert self.branch is not None
        errors = ", ".join(f"{name} within {self._off(fact):.2g}" for name, fact in self._by_format.items())
        return f"{len(self.branch.claim.centre)} cells; {errors} of the exact outputs; {self._status}"

    @cached_property
    def _known(self) -> bool:
        """Whether the facts are facts, about this program and region."""
        branch, steps = self.branch, self.steps
        if not is_fact(branch, BranchOverCells) or not self.computed:
            return False
        due = (branch, steps) if branch.claim.equations.source.steps else (branch,)
        return self._about(branch.claim) and all(self._rests(fact, due) for fact in self.computed)

    def _about(self, claim: BranchOverCells) -> bool:
        """Whether a branch is that of this program over this box."""
        made, program = claim.equations.made, self.program
        same = (made.code, made.pivots, made.corrections) == (program.code, program.pivots, program.corrections)
        ports = tuple((port.name, port.size) for port in program.inputs)
        same = same and ports == claim.equations.source.ports
        same = same and program.region is None  # one with a region has another status
        return same and np.array_equal(claim.lower, self.lower) and np.array_equal(claim.upper, self.upper)

    def _rests(self, fact: Fact, due: Sequence[Fact | None]) -> bool:
        """Whether something is a fact about these inputs, on this branch and of these steps."""
        if not is_fact(fact, ProgramComputed):
            return False
        claim, same = fact.claim, fact.premises == tuple(due)  # facts are equal to themselves alone
        return same and np.array_equal(claim.start, self.start) and np.array_equal(claim.bounds, self.bounds)

    @property
    def _by_format(self) -> dict[str, Fact]:
        return {FORMATS[int(fact.claim.format[0])].name: fact for fact in self.computed}

    @property
    def off(self) -> float:
        """The largest error of an output in the first format, as a share of its range."""
        fact = self.computed[0]
        return self._share(fact)

    def _share(self, fact: Fact) -> float:
        size = np.abs(fact.found["range"]).max()
        return float(fact.found["error"].max() / size) if size else 0.0

    def _off(self, fact: Fact) -> float:
        return float(fact.found["error"].max())

    def error(self, format: str = "double") -> dict[str, Array]:
        """What computed outputs are off by at most, by name, each of its port's shape."""
        return self._by_port(self._fact(format).found["error"])

    def ranges(self, format: str = "double") -> dict[str, tuple[Array, Array]]:
        """Where outputs are, lower and upper numbers, by name."""
        lower, upper = map(self._by_port, self._fact(format).found["range"])
        return {name: (lower[name], upper[name]) for name in lower}

    def bits(self, format: str = "double") -> dict[str, int]:
        """For fixed point: bits before the point, sign apart, of outputs by name, and of all that is computed."""
        found = self._fact(format).found
        most = {name: float(np.max(np.abs(ends))) for name, ends in self.ranges(format).items()}
        return {name: _bits(size) for name, size in (most | {"everything": float(found["size"].max())}).items()}

    def always_trusted(self, format: str = "double") -> bool:
        """Whether the program's status is proved to be 0 all over the region."""
        return self._possible(format) == [0]

    def _possible(self, format: str) -> list[int]:
        """What the status may be in the region: pivots are squared, as corrections are, before they are compared."""
        found, least = self._fact(format).found, {each.name: each.least for each in FORMATS}[format]
        due = np.array([max(SMALL_PIVOT * abs(pivot.scale), math.sqrt(least)) for pivot in self.program.pivots])
        large = np.all(found["pivots"] > 2.0 * due)
        most = PRECISIONS[format].converged(self.program.tolerance)
        near = found["correction"][0] <= 0.9 * most or not self.program.corrections
        return [0, *([] if large else [1]), *([] if near else [2])]

    def _fact(self, format: str) -> Fact:
        known = self._by_format
        if format not in known or not self._known:
            raise InvalidInputError(f"nothing is proved in '{format}': {self.reason}")
        return known[format]

    def _by_port(self, numbers: Array) -> dict[str, Array]:
        pairs = zip(self.program.outputs, windows(self.program.outputs), strict=True)
        return {port.name: numbers[window].reshape(port.shape) for port, window in pairs}

    @property
    def _status(self) -> str:
        sure = [name for name in self._by_format if self.always_trusted(name)]
        may = " or ".join(map(str, self._possible(next(iter(self._by_format)))[1:]))
        return f"status is 0 in {' and '.join(sure)}" if sure else f"status may be {may}"

    def statement(self) -> str:
        """A few lines that say what was proved, for whoever has the program alone."""
        if not self._known:
            return f"undecided: {self.reason}"
        assert self.branch is not None
        count, others = self.program.inputs[0].size, bounded(self.program)
        lines = [f"Proved for every q in the box {_box(self.lower[:count], self.upper[:count])},"]
        if count < len(self.lower):
            lines.append(f"p in the box {_box(self.lower[count:], self.upper[count:])},")
        sigma = "σ(q)" if count == len(self.lower) else "σ(q, p)"
        lines.append(f"y within {_numbers(self.start)} of one continuous branch of {sigma},")
        for port, window in zip(others, windows(others), strict=True):
            lines.append(f"|{port.name}| ≤ {_numbers(self.bounds[window])} ({port.unit}):")
        if self.steps is not None:
            lines.append(
                f"its {self.steps.claim.equations.source.steps} Newton steps and one more end, exact, within "
                f"{_up(float((self.steps.found['errors'][:, -1:] * self.start).max()))} of {sigma};"
            )
        for name, fact in self._by_format.items():
            pivots, size = fact.found["pivots"], float(fact.found["size"].max())
            least = _down(float(pivots.min(initial=math.inf)))
            status = " or ".join(map(str, self._possible(name)))
            lines.append(
                f"in {name} it divides by no less than {least}, no value exceeds {_up(size)}, status is {status},"
            )
            errors = self.error(name)
            told = ", ".join(f"{port.name} {_up(float(errors[port.name].max()))}" for port in self.program.outputs)
            lines.append(f"  outputs are off by at most: {told};")
        lines.append("inputs being numbers of the format, nothing fused or reordered, its own sine and cosine.")
        lines.append(f"program {self.program.digest}")
        return "\n".join(lines)

    def guarded(self) -> Program:
        """The program, with the statement, and with status 3 where an input is out of the region.

        What is checked is q, p, the bounds of all else, and that y is no farther from the branch than it may be at some
        q of the box. Its examples are states in the region.

        Raises:
            InvalidInputError: Nothing is proved.
        """
        if not self._known:
            raise InvalidInputError(f"nothing is proved of the program, so that no region is certified: {self.reason}")
        assert self.branch is not None
        ends = tube_hull(self.branch, self.start)
        arranged = self.branch.claim.equations.arranged
        lower = tuple(arranged(self.lower.tolist(), ends[0].tolist(), (-self.bounds).tolist()))
        upper = tuple(arranged(self.upper.tolist(), ends[1].tolist(), self.bounds.tolist()))
        region = CertifiedRegion(lower, upper, tuple(self._by_format), self.statement())
        first, *others = example_rows(self.branch, self.bounds)
        return replace(self.program, region=region, example=first, around=tuple(others))

    def save(self, path: str | Path) -> None:
        """Write it as a document (``.json``, else npz), which `load` reads and ``ccpin verify`` replays.

        Raises:
            InvalidInputError: Nothing is proved, or the file cannot be written.
        """
        if not self._known:
            raise InvalidInputError(f"there is nothing to save: {self.reason}")
        assert self.branch is not None
        found = {name: getattr(self, name) for name in ("lower", "upper", "bounds", "start")}
        write_certificate(path, self.program, found, self.branch.claim, list(self._by_format))

    @classmethod
    def load(cls, path: str | Path) -> ProgramCertificate:
        """What `save` wrote, undecided until it is replayed.

        Raises:
            InvalidInputError: The file is none, or is damaged.
        """
        program, found, claims = read_certificate(path)
        lower, upper, bounds, start = (found[name] for name in ("lower", "upper", "bounds", "start"))
        return cls(program, lower, upper, bounds, claims.branch, claims.steps, claims.computed, start=start)

    def is_about(self, mechanism: Mechanism) -> bool:
        """Whether the closures are a mechanism's, operation by operation, as they are recorded today."""
        symbols = [port.entries for port in self.program.inputs if port.name == "p"]
        try:
            today = record(ReducedModel(mechanism), "closure", parameters=symbols[0] if symbols else ()).source
        except CcpinError:
            return False
        own = self.program.source
        if own is None or today is None or own.independent != today.independent:
            return False
        return own.closure._replace(size=0) == today.closure._replace(size=0)

    def replay(self) -> ProgramCertificate:
        """The same with every fact proved once more from its data.

        Raises:
            NotProvedError: One is none.
        """
        if not self.computed:
            return self
        first = self.computed[0].replay()
        others = (prove(fact.claim, *first.premises) for fact in self.computed[1:])
        steps = first.premises[1] if len(first.premises) > 1 else None
        return replace(self, branch=first.premises[0], steps=steps, computed=(first, *others))


def _bits(size: float) -> int:
    """Bits before the point for numbers up to a size."""
    return max(0, math.floor(math.log2(size)) + 1) if size > 0.0 else 0


def _up(value: float) -> str:
    """A number rounded up to two digits."""
    if not value:
        return "0"
    digits = 1 - math.floor(math.log10(value))
    scaled = math.ceil(value * 10.0**digits * (1 + 1e-9))
    return f"{scaled * 10.0**-digits:.2g}"


def _down(value: float) -> str:
    """A number rounded down to two digits."""
    if not value or math.isinf(value):
        return f"{value:g}"
    digits = 1 - math.floor(math.log10(value))
    return f"{math.floor(value * 10.0**digits * (1 - 1e-9)) * 10.0**-digits:.2g}"


def _numbers(values: Array) -> str:
    same = len(values) > 0 and np.all(values == values[0])
    return f"{values[0]!s}" if same else f"({', '.join(map(str, values.tolist()))})"


def _box(lower: Array, upper: Array) -> str:
    return " × ".join(f"[{a!r}, {b!r}]" for a, b in zip(lower.tolist(), upper.tolist(), strict=True))
