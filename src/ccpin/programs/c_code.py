"""Programs as C: one text for one state at a time and for lanes of several, in double or float.

The arithmetic is written once over a type R; R is a number, or a vector of as many lanes as a register has. Nothing is
fused or reordered (the flags say so), so that every lane, every width and every machine with IEEE arithmetic gives the
same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.errors import CcpinError
from ccpin.programs.certified_region import OUTSIDE
from ccpin.programs.evaluation import gain_series
from ccpin.programs.folding import DOUBLES, folded
from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.programs.program import SMALL_PIVOT, Program
from ccpin.programs.sine_cosine import DOUBLE, Precision

PIECE = 1200  # operations a function of exported C: compilers take more than proportionally longer for more
_WORDS = {Kind.ADD: "+", Kind.SUBTRACT: "-", Kind.MULTIPLY: "*"}


class Text(NamedTuple):
    """C of one program.

    Attributes:
        name: Of its function, an identifier.
        kernel: sin and cos, the pieces and `NAME_kernel(x, out)` over R and I, whose meaning comes before it; it
            returns the status.
        stack: Numbers of type R that it keeps besides what a compiler keeps.
    """

    name: str
    kernel: str
    stack: int


def identifier(text: str) -> str:
    """A C identifier that reads as a text."""
    found = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in text).strip("_")
    while "__" in found:
        found = found.replace("__", "_")
    return f"p_{found}" if not found or found[0].isdigit() else found


def kernel_of(program: Program, name: str, precision: Precision = DOUBLE, size: int = PIECE) -> Text:
    """The arithmetic of a program over a type R, with a mask I of a comparison's type, in pieces of a size.

    Raises:
        InvalidInputError: What was proved of the program was not proved in the format.
        CcpinError: A constant is too large for the format.
    """
    if program.region is not None:
        program.region.require(precision.name)
    code = folded(program.code, DOUBLES)
    pieces = [code.instructions[k : k + size] for k in range(0, len(code.instructions), size)] or [()]
    writer = _Writer(program, code, name, precision)
    slots = _slots(pieces, code, program)
    bodies = [writer.piece(number, piece, slots, len(pieces) == 1) for number, piece in enumerate(pieces)]
    return Text(
        name,
        "\n".join([_trigonometry(name, precision), *writer.helpers(), *bodies, writer.kernel(len(pieces), slots)]),
        slots.places,
    )


class _Slots(NamedTuple):
    """Where values that outlive their piece are kept: value -> place, and how many places there are."""

    place: dict[int, int]
    places: int


def _slots(pieces: Sequence[Sequence[Instruction]], code: Code, program: Program) -> _Slots:
    """A place for every value that a later piece or the end reads, used again after its last use."""
    dies = dict[int, int]()
    for number, piece in enumerate(pieces):
        for item in piece:
            for operand in item.operands:
                dies[operand] = number
    for number in (*code.outputs, *program.corrections):
        dies[number] = len(pieces)
    constants = {item.target for item in code.instructions if item.kind == Kind.CONSTANT}
    free, place, count = list[int](), dict[int, int](), 0
    leaving: dict[int, list[int]] = {}
    for number, piece in enumerate(pieces):
        free += [place[value] for value in leaving.pop(number, [])]
        for item in piece:
            value = item.target
            if value in constants or dies.get(value, number) == number:
                continue
            place[value] = free.pop() if free else count
            count = max(count, place[value] + 1)
            leaving.setdefault(dies[value] + 1, []).append(value)
    return _Slots(place, count)


class _Writer:
    """Lines of C for instructions."""

    def __init__(self, program: Program, code: Code, name: str, precision: Precision) -> None:
        self._program, self._code, self._name, self._precision = program, code, name, precision
        self._constants = {item.target: item.constant for item in code.instructions if item.kind == Kind.CONSTANT}
        self._pivots = {pivot.number: pivot.scale for pivot in program.pivots}

    def helpers(self) -> list[str]:
        """Functions for what C has no operator for, where the program has it."""
        orders = {item.b: None for item in self._code.instructions if item.kind == Kind.GAIN}
        return [_gain(self._name, order, self._precision) for order in orders]

    def piece(self, number: int, items: Sequence[Instruction], slots: _Slots, alone: bool) -> str:
        """One function of the kernel."""
        lines, here = list[str](), {item.target for item in items}
        angles = {item.a: dict[int, int]() for item in items if item.kind in (Kind.SINE, Kind.COSINE)}
        for item in items:
            if item.kind in (Kind.SINE, Kind.COSINE):
                angles[item.a][item.kind] = item.target
        for item in items:
            for operand in item.operands:
                if operand not in here and operand in slots.place:
                    lines.append(f"const R t{operand} = m[{slots.place[operand]}];")
                    here.add(operand)
            if item.kind in (Kind.SINE, Kind.COSINE):
                pair = angles.pop(item.a, {})
                lines += self._sine_cosine(item.a, pair)
                new = list(pair.values())
            elif item.kind != Kind.CONSTANT:
                lines.append(f"const R t{item.target} = {self._value(item)};")
                new = [item.target]
            else:
                new = []
            lines += [f"m[{slots.place[value]}] = t{value};" for value in new if value in slots.place]
            for value in new:
                if value in self._pivots:
                    low = (SMALL_PIVOT * self._pivots[value]) ** 2
                    lines.append(f"ok &= ABOVE(t{value} * t{value}, {self._literal(low)});")
        head = f"static {'inline' if alone else 'APART'} I {self._name}_piece{number}(const R x[], R m[])"
        return _function(head, ["I ok = EVERY;", *lines, "(void)x;", "(void)m;", "return ok;"])

    def _sine_cosine(self, angle: int, pair: dict[int, int]) -> list[str]:
        """Both of an angle, where they are not there yet."""
        if not pair:
            return []
        names = [f"t{pair[kind]}" if kind in pair else f"unused{angle}" for kind in (Kind.SINE, Kind.COSINE)]
        call = f"{self._name}_sincos({self._operand(angle)}, &{names[0]}, &{names[1]});"
        reach = self._literal(self._precision.reach**2)
        within = f"ok &= ABOVE({reach}, {self._operand(angle)} * {self._operand(angle)});"
        unused = [f"(void){name};" for name in names if name.startswith("unused")]
        return [f"R {names[0]}, {names[1]};", call, *unused, within]

    def kernel(self, pieces: int, slots: _Slots) -> str:
        """All pieces, and the outputs; returns the status."""
        program = self._program
        lines = [f"R m[{max(slots.places, 1)}];", "I ok = EVERY;"]
        lines += [f"ok &= {self._name}_piece{number}(x, m);" for number in range(pieces)]
        lines += ["const I large = ok;"]
        if program.corrections:
            squares = " + ".join(f"{self._kept(k, slots)} * {self._kept(k, slots)}" for k in program.corrections)
            lines.append(f"ok &= ABOVE({self._literal(self._precision.converged(program.tolerance) ** 2)}, {squares});")
        lines += [f"out[{k}] = {self._kept(number, slots)};" for k, number in enumerate(self._code.outputs)]
        lines += ["(void)x;", "(void)out;", *self._status()]
        return _function(f"static inline I {self._name}_kernel(const R x[], R out[])", lines)

    def _status(self) -> list[str]:
        """0, 1 where a pivot was small, 2 where corrections were large, 3 outside the region."""
        region, status = self._program.region, "(~large & 1) | (large & ~ok & 2)"
        if region is None:
            return [f"return {status};"]
        ends = zip(*(end.tolist() for end in region.ends(self._precision)), strict=True)
        checks = [f"inside &= WITHIN(x[{k}], {self._literal(a)}, {self._literal(b)});" for k, (a, b) in enumerate(ends)]
        return ["I inside = EVERY;", *checks, f"return (~inside & {OUTSIDE}) | (inside & ({status}));"]

    def _kept(self, number: int, slots: _Slots) -> str:
        if number < self._code.inputs:
            return f"x[{number}]"
        if number in self._constants:
            return f"CONSTANT({self._literal(self._constants[number])})"
        return f"m[{slots.place[number]}]"

    def _value(self, item: Instruction) -> str:
        kind, a = item.kind, self._operand(item.a)
        if kind in _WORDS:
            return f"{a} {_WORDS[kind]} {self._operand(item.b)}"
        if kind == Kind.SCALE:
            return f"-{a}" if item.constant == -1 else f"{self._literal(item.constant)} * {a}"
        if kind == Kind.RECIPROCAL:
            return f"{self._literal(1.0)} / {a}"
        if kind == Kind.GAIN:
            return f"{self._name}_gain{item.b}({a})"
        if kind == Kind.ROOT:
            return f"ROOT({a})"
        return f"ANGLE({a}, {self._operand(item.b)})"

    def _operand(self, number: int) -> str:
        if number < self._code.inputs:
            return f"x[{number}]"
        return self._literal(self._constants[number]) if number in self._constants else f"t{number}"

    def _literal(self, value: object) -> str:
        return literal(float(value), self._precision)  # type: ignore[arg-type]


def literal(value: float, precision: Precision) -> str:
    """A number as C has it, rounded to the format; the negative in brackets.

    Raises:
        CcpinError: It is too large for the format.
    """
    with np.errstate(over="ignore"):
        held = precision.type(value)
    if not np.isfinite(held):
        raise CcpinError(f"a constant of the program, {value:g}, is no number of the format {precision.name}")
    text = f"{held!s}{precision.suffix}"
    return f"({text})" if text.startswith("-") else text


def _function(head: str, lines: Sequence[str]) -> str:
    return "\n".join([head, "{", *(f"    {line}" for line in lines), "}"])


def _trigonometry(name: str, precision: Precision) -> str:
    """Sine and cosine, as `sine_cosine` has them."""

    def number(value: float) -> str:
        return literal(value, precision)

    def horner(coefficients: Sequence[float]) -> str:
        text = number(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            text = f"({number(coefficient)} + z * {text})"
        return text

    big, one, half = number(precision.rounder), number(1.0), number(0.5)
    bits = 62 if precision.name == "double" else 30
    first, second, third = map(number, precision.parts)
    return f"""static inline void {name}_sincos(R x, R *sine, R *cosine)
{{
    const R near = x * {number(2.0 / math.pi)} + {big};
    const R k = near - {big};
    const R r = ((x - k * {first}) - k * {second}) - k * {third};
    const R z = r * r;
    const R s = r + (r * z) * {horner(precision.sine)};
    const R c = ({one} - {half} * z) + (z * z) * {horner(precision.cosine)};
#ifdef BITS
    const I n = BITS(near), odd = -(n & 1);
    const I first = (BITS(s) & ~odd) | (BITS(c) & odd), second = (BITS(c) & ~odd) | (BITS(s) & odd);
    *sine = (R)(first ^ ((n & 2) << {bits}));
    *cosine = (R)(second ^ (((n + 1) & 2) << {bits}));
#else
    const R h = k * {half}, w = k * {number(0.25)};
    const R e = h - ((h + {big}) - {big}), f = w - ((w + {big}) - {big});
    const R b = e + e;
    const R a = ({one} - b * b) * ({one} - {number(8.0)} * (f * f));
    *sine = s * a + c * b;
    *cosine = c * a - s * b;
#endif
}}"""


def _gain(name: str, order: int, precision: Precision) -> str:
    """A derivative of g(w) = 2 arccos(w)/√(1 − w²): of each lane by itself."""
    series = gain_series(order)
    terms = ", ".join(literal(value, precision) for value in series)
    return f"""static inline R {name}_gain{order}(R w)
{{
    static const S terms[{len(series)}] = {{{terms}}};
    R found = CONSTANT(0);
    for (int lane = 0; lane < LANES; lane++) {{
        const S at = LANE(w, lane);
        S g = 0;
        if (at < (S)0.5) {{
            const S rest = 1 - at * at;
            S last = 2 * ACOS(at) / SQRT(rest), next = (at * last - 2) / rest;
            g = {"last" if order == 0 else "next"};
            for (int k = 1; k < {order}; k++) {{
                g = ((S)(2 * k + 1) * at * next + (S)(k * k) * last) / rest;
                last = next;
                next = g;
            }}
            (void)next;
        }} else {{
            const S z = (1 - at) / 2;
            for (int k = {len(series) - 1}; k >= 0; k--) {{ g = g * z + terms[k]; }}
        }}
        LANE(found, lane) = g;
    }}
    return found;
}}"""


def scalar_macros(precision: Precision) -> str:
    """What the kernel's text rests on, for one state at a time."""
    suffix = precision.suffix
    return f"""typedef {precision.name} S;
typedef S R;
typedef int I;
#define APART inline
#define EVERY (-1)
#define CONSTANT(value) (value)
#define LANES 1
#define LANE(value, lane) (value)
#define ABOVE(a, b) (-((a) > (b)))
#define WITHIN(a, low, high) (-((a) >= (low) && (a) <= (high)))
#define ROOT(a) sqrt{suffix}(a)
#define ANGLE(a, b) atan2{suffix}(a, b)
#define SQRT(a) sqrt{suffix}(a)
#define ACOS(a) acos{suffix}(a)"""


def lane_macros(precision: Precision, lanes: int) -> str:
    """The same for vectors of so many lanes (GCC's and Clang's vector extension)."""
    suffix, mask = precision.suffix, {"double": "long long", "float": "int"}[precision.name]
    return f"""typedef {precision.name} S;
typedef S R __attribute__((vector_size({lanes} * sizeof(S))));
typedef {mask} I __attribute__((vector_size({lanes} * sizeof(S))));
#define LANES {lanes}
#define BITS(a) ((I)(a))
#define APART __attribute__((noinline))
#define EVERY ((I){{0}} - 1)
#define CONSTANT(value) ((R){{0}} + (value))
#define LANE(value, lane) ((value)[lane])
#define ABOVE(a, b) ((a) > (b))
#define WITHIN(a, low, high) (((a) >= (low)) & ((a) <= (high)))
#define SQRT(a) sqrt{suffix}(a)
#define ACOS(a) acos{suffix}(a)
static inline R ROOT(R a) {{ for (int k = 0; k < LANES; k++) a[k] = sqrt{suffix}(a[k]); return a; }}
static inline R ANGLE(R a, R b) {{ for (int k = 0; k < LANES; k++) a[k] = atan2{suffix}(a[k], b[k]); return a; }}"""
