"""A program as a C99 header: one function, its ports and what it costs told above it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from ccpin.programs.c_code import Text, identifier, kernel_of, scalar_macros
from ccpin.programs.certified_region import OUTSIDE, CertifiedRegion
from ccpin.programs.program import Port, Program, windows
from ccpin.programs.sine_cosine import Precision

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while asm bool catch
class delete false friend main namespace new operator private protected public template this throw true try using
virtual and or not xor j0 j1 jn y0 y1 yn signgam printf fabs status out x k states wanted codes differs n wrong same
code failures exact
"""  # of C, C++ and <math.h>, and those that the text itself has


def is_taken(name: str) -> bool:
    """Whether C, C++ or <math.h> has the name, or the exported text uses it."""
    plain = name[:-1] if name[-1:] in ("f", "l") else name
    return (
        name in _WORDS.split()
        or {name, plain} & set(dir(math)) != set()
        or re.fullmatch(r"[tm]\d*|k", name) is not None
    )


def header(program: Program, name: str, precision: Precision) -> str:
    """The text of NAME.h."""
    kernel = kernel_of(program, name, precision)
    macros, text = _named(scalar_macros(precision), kernel.kernel, name, precision)
    codes = {"OK": 0, "SINGULAR": 1, "NOT_CONVERGED": 2} | ({} if program.region is None else {"OUTSIDE": OUTSIDE})
    guard, known = f"CCPIN_{name}_H", ", ".join(f"{name}_{word} = {value}" for word, value in codes.items())
    parts = [
        _comment(program, name, precision, kernel),
        f"#ifndef {guard}\n#define {guard}\n",
        "#include <math.h>\n",
        f"enum {{ {known} }};\n",
        *(f"#define {line}" for line in macros.values()),
        "",
        text,
        "",
        _function(program, name, precision),
        "",
        *(f"#undef {word}" for word in macros),
        f"\n#endif /* {guard} */\n",
    ]
    return "\n".join(parts)


def _named(macros: str, kernel: str, name: str, precision: Precision) -> tuple[dict[str, str], str]:
    """The macros that the kernel rests on, with names of its own, so that they meet no others; and the kernel."""
    words = ["BITS", *re.findall(r"^#define (\w+)", macros, re.MULTILINE)]
    types = {"R": precision.name, "S": precision.name, "I": "int"}
    told = types | {word: f"{name}_{word}" for word in words}

    def renamed(text: str) -> str:
        return re.sub(rf"\b({'|'.join(told)})\b", lambda found: told[found[1]], text)

    lines = [line.removeprefix("#define ") for line in renamed(macros).splitlines() if line.startswith("#define ")]
    return {re.split(r"\W", line)[0]: line for line in lines}, renamed(kernel)


def _function(program: Program, name: str, precision: Precision) -> str:
    """The one function that is called."""
    kind, names = precision.name, parameters(program, name)
    ports = [(port, names[k]) for k, port in enumerate((*program.inputs, *program.outputs))]
    reads, gives = ports[: len(program.inputs)], ports[len(program.inputs) :]
    taken = [f"const {kind} {word}[{port.size}]" for port, word in reads if port.size]
    given = [f"{kind} {word}[{port.size}]" for port, word in gives if port.size]
    lines = [f"{kind} x[{max(sum(p.size for p, _ in reads), 1)}], out[{max(sum(p.size for p, _ in gives), 1)}];"]
    lines += ["int status;", *(["x[0] = 0;"] if not taken else [])]
    for group, copy in ((reads, "x[{0} + k] = {1}[k]"), (gives, "{1}[k] = out[{0} + k]")):
        for (port, word), window in zip(group, windows(port for port, _ in group), strict=True):
            if port.size:
                lines.append(f"for (int k = 0; k < {port.size}; k++) {{ {copy.format(window.start, word)}; }}")
        if group is reads:
            lines.append(f"status = {name}_kernel(x, out);")
    lines.append("return status;")
    head = f"static inline int {name}({', '.join([*taken, *given]) or 'void'})"
    return "\n".join([head, "{", *(f"    {line}" for line in lines), "}"])


def parameters(program: Program, name: str) -> list[str]:
    """C's names of the ports, of which no two are one, and none the function's or one that begins like it."""
    found = list[str]()
    for port in (*program.inputs, *program.outputs):
        word = identifier(port.name)[:40]
        word = f"{word}_" if is_taken(word) else word
        word = f"p_{word}" if f"{word}_".startswith(f"{name}_") else word
        while word in found:
            word += "_"
        found.append(word)
    return found


def _comment(program: Program, name: str, precision: Precision, kernel: Text) -> str:
    """What the header says of itself."""
    size = np.dtype(precision.type).itemsize
    numbers = kernel.stack + sum(port.size for port in (*program.inputs, *program.outputs))
    counts = ", ".join(f"{count} {word}" for word, count in program.operations.items())
    known = {"gain": "acos, sqrt", "angle": "atan2", "root": "sqrt"}
    calls = ", ".join(word for kind, word in known.items() if kind in program.operations)
    system = {"gain", "angle"} & set(program.operations)
    bits = "acos and atan2 are <math.h>'s" if system else "the same bits wherever arithmetic is IEEE's"
    lines = [
        f"{name}.h: {program.name}",
        f"Written by ccpin from the program {program.digest}",
        "",
        *(line for k, port in enumerate(program.inputs) for line in _told("in ", port, parameters(program, name)[k])),
        *(
            line
            for k, port in enumerate(program.outputs, start=len(program.inputs))
            for line in _told("out", port, parameters(program, name)[k])
        ),
        *(
            ["q and y are of a closed configuration"]
            if not program.corrections
            else ["y is of a closed configuration near q on the same branch (the last one): sigma(q) is found from it"]
        ),
        *program.notes,
        "",
        "Returns one of",
        f"  {name}_OK: the outputs can be trusted",
        f"  {name}_SINGULAR: a solve divided by what is almost 0, or an angle is beyond {precision.reach:g} rad",
        *([f"  {name}_NOT_CONVERGED: the Newton steps of sigma had not converged"] if program.corrections else []),
        *([] if program.region is None else _certified(name, program.region)),
        "",
        f"Arithmetic: {precision.name}; {counts or 'none'}",
        f"Stack: {numbers * size} bytes of numbers, and what the compiler keeps; no heap, no globals",
        f"Calls: {calls or 'nothing'}; sine and cosine are its own, off by at most {precision.error:g} up to "
        f"{precision.reach:g} rad",
        f"Compile as C99 with -ffp-contract=off and without -ffast-math: {bits}",
        f"Test: cc -std=c99 -ffp-contract=off {name}_test.c -o {name}_test -lm && ./{name}_test",
    ]
    return "\n".join(["/*", *(f" * {_harmless(line)}".rstrip() for line in lines), " */"])


def _certified(name: str, region: CertifiedRegion) -> list[str]:
    """What was proved, and where."""
    lines = [f"  {name}_OUTSIDE: an input is outside the certified region, or no number", ""]
    return [
        *lines,
        "What its certificate says of it (ccpin verify replays one), before the region was made part of it:",
        *region.statement.splitlines(),
    ]


def _told(way: str, port: Port, word: str) -> Iterator[str]:
    """A port's lines."""
    shape = "".join(f"[{size}]" for size in port.shape)
    if not port.size:
        yield f"{way} {port.name} is empty, and left out"
        return
    plain = all(re.fullmatch(r"[\d,]*", entry) for entry in port.entries)
    yield (
        f"{way} {word}{shape}{', row by row' if len(port.shape) > 1 else ''}{f', {port.unit}' if port.unit else ''}"
        + ("" if plain else ": " + ", ".join(port.entries))
    )


def _harmless(line: str) -> str:
    """A line that ends no comment and hides nothing, whatever a mechanism is called."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in line)
    return re.sub(r"\?(?=\?)", "? ", shown).replace("*/", "* /").replace("/*", "/ *").rstrip("\\")
