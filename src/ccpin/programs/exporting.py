"""`export`: a program as files of another language."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from ccpin.arrays import choice, instance
from ccpin.errors import InvalidInputError
from ccpin.files import writable_folder, write_text
from ccpin.programs.c_code import identifier
from ccpin.programs.c_export import header, is_taken
from ccpin.programs.c_self_test import self_test
from ccpin.programs.program import Program
from ccpin.programs.sine_cosine import PRECISIONS, Format, Precision

Target = Callable[[Program, str, Precision], dict[str, str]]


def _c(program: Program, name: str, precision: Precision) -> dict[str, str]:
    return {f"{name}.h": header(program, name, precision), f"{name}_test.c": self_test(program, name, precision)}


def _json(program: Program, name: str, precision: Precision) -> dict[str, str]:
    return {f"{name}.json": program.text}


TARGETS: dict[str, Target] = {"c": _c, "json": _json}  # the texts of a program's files, by their names
_LONGEST = 48  # letters of a name, so that all that stands on it differs within C's 63


def export(
    program: Program,
    folder: str | Path,
    target: str = "c",
    *,
    name: str | None = None,
    format: Format = "double",
) -> tuple[Path, ...]:
    """Write a program's files into a folder, which is made where it is absent.

    Args:
        program: The program.
        folder: Where to.
        target: `"c"`: NAME.h (C99, no heap, no globals; the function NAME) and NAME_test.c, a program that tests it
            and ends with 0 where all is as it was computed here; `"json"`: NAME.json, as `Program.save` writes it.
        name: Of function and files, default made of the program's: letters, digits and _, a letter first.
        format: Of C's arithmetic.

    Returns:
        The files.

    Raises:
        InvalidInputError: No such target or format, a name that is no name in C, or a folder that cannot be written to.
        CcpinError: A constant of the program is too large for the format.
    """
    program = instance(program, "program", Program)
    write = TARGETS[choice(target, "target", tuple(TARGETS))]
    precision = PRECISIONS[choice(format, "format", tuple(PRECISIONS))]
    called = identifier(program.name)[:_LONGEST].rstrip("_") if name is None else _c_name(name)
    texts = write(program, called, precision)
    into = writable_folder(folder, "folder")
    paths = tuple(into / file for file in texts)
    for path, text in zip(paths, texts.values(), strict=True):
        write_text(path, text)
    return paths


def _c_name(name: str) -> str:
    """A name that C takes for a function.

    Raises:
        InvalidInputError: It is none.
    """
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,47}", name) or is_taken(name):
        raise InvalidInputError(
            f"name must be a C function's: at most {_LONGEST} letters, digits and _, a letter first, and no word that "
            f"C has already; it is {name!r}"
        )
    return name
