"""Pages of the documentation as blocks that are files, programs and terminal sessions, and how each is run."""

import contextlib
import io
import re
import runpy
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from ccpin.cli import main
from tests.support.places import ROOT

FENCE = re.compile(
    r'^(?P<indent> *)```(?P<language>\w+)(?: title="(?P<title>[^"]+)")?[^\n]*\n(?P<text>.*?)^(?P=indent)```',
    re.M | re.S,
)
FILES = re.compile(r"<!-- files: ([\w./, ]+) -->")
SNIPPET = re.compile(r'^--8<-- "([\w./]+)"$', re.M)
NEEDS = re.compile(r"<!-- needs: ([\w., ]+) -->")
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if FENCE.search(path.read_text(encoding="utf-8"))
}


class Block(NamedTuple):
    """One fenced block of a page."""

    language: str
    title: str | None
    text: str
    line: int


def blocks(page):
    """The fenced blocks of a page in its order."""
    text = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(text):
        body = re.sub(f"^{found['indent']}", "", found["text"], flags=re.M)
        body = SNIPPET.sub(lambda named: (ROOT / named[1]).read_text(encoding="utf-8"), body)
        yield Block(found["language"], found["title"], body, text.count("\n", 0, found.start()) + 1)


def needs(page):
    """The packages and programs (chromium, gcc) a page says its code needs beside ccpin's own."""
    return [name.strip() for line in NEEDS.findall(page.read_text(encoding="utf-8")) for name in line.split(",")]


def files(page):
    """The files of the repository that a page's code works on."""
    return [ROOT / name.strip() for line in FILES.findall(page.read_text(encoding="utf-8")) for name in line.split(",")]


def run(page):
    """Run a page in the working folder as a reader would: files saved, programs run, commands typed, output compared.

    A block with a title is a file of that name. Python without one runs in one namespace for the whole page, and a
    ``text`` block after it is what it prints. In ``console`` blocks lines after ``$`` are commands, all others what
    they print; in ``sh`` blocks every line is a command. A line … in what is printed stands for lines left out.
    """
    for file in files(page):
        shutil.copy(file, file.name)
    namespace, printed = {"__name__": "page"}, ""
    for block in blocks(page):
        where = f"{page}:{block.line}"
        if block.title is not None:
            target = Path(block.title)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            out = io.StringIO()
            source = "\n" * block.line + block.text
            with contextlib.redirect_stdout(out):
                exec(compile(source, str(page), "exec"), namespace)  # the page's own code, as its reader runs it
            printed = out.getvalue()
        elif block.language == "text":
            assert alike(printed, block.text), f"{where} says otherwise than its code prints:\n{printed}"
        elif block.language == "console":
            for command, expected in session(block.text):
                said = typed(command, where)
                assert not expected or alike(said, expected), f"{where}: `{command}` prints otherwise:\n{said}"
        elif block.language == "sh":
            for line in block.text.splitlines():
                typed(line.partition("  #")[0], where)


def session(text):
    """The commands of a console block, each with what is shown below it."""
    for part in re.split(r"^\$ ", text, flags=re.M)[1:]:
        command, _, expected = part.replace("\\\n", " ").partition("\n")
        yield command, expected


def typed(command, where):
    """Type a command; what it prints. Package managers, servers and scripts of the repository are not started."""
    program, *arguments = shlex.split(command)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        if program == "ccpin" and arguments[0] not in MINUTES:
            try:
                code = main(arguments)
            except SystemExit as end:  # --help, --version, --print-completion
                code = end.code
            assert code == 0, f"{where}: `{command}` ends with {code}"
        elif program == "python" and arguments[0].endswith(".py"):
            runpy.run_path(arguments[0], run_name="__main__")
        elif program.startswith("./"):
            out.write(subprocess.run([program, *arguments], capture_output=True, text=True, check=True).stdout)
        elif program != "ccpin":
            assert program in OTHERS, f"{where}: nobody runs `{command}`"
            OTHERS[program](arguments)
    return out.getvalue()


MINUTES = ("paper",)  # its own tests run it


def _installs(arguments):
    """An extra that is asked for is one that there is."""
    known = re.findall(r"^(\w+) = \[", (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M)
    for extra in re.findall(r"\[([\w,]+)\]", " ".join(arguments)):
        assert set(extra.split(",")) <= set(known), f"no extra [{extra}]"


def _script(arguments):
    """A script of the repository is there."""
    assert (ROOT / arguments[0]).is_file(), arguments[0]


def _compiles(arguments):
    """A file that the page made; warnings that it makes errors are some."""
    subprocess.run(["gcc", *arguments], check=True)


OTHERS = {
    "gcc": _compiles,
    "pip": _installs,
    "sh": _script,
    "cd": lambda arguments: None,
    "git": lambda arguments: None,
    "eval": lambda arguments: None,
    "dask": lambda arguments: None,
    "zensical": lambda arguments: None,
}


def alike(said, expected):
    """Whether a text is as a page shows it: a line … stands for any lines, or none; spaces at line ends for nothing."""
    said, expected = ("".join(f"{line.rstrip()}\n" for line in text.strip().splitlines()) for text in (said, expected))
    shown = re.split(r"^…\n", expected, flags=re.M)
    return re.fullmatch(r"(?:.*\n)*?".join(map(re.escape, shown)), said) is not None
