"""C text compiled by the system's compiler and loaded: only when asked for, kept where nobody else can write.

A library lies in a folder of its own with its digest beside it, both put there at once or not at all. The cache is
`ccpin/programs` under XDG_CACHE_HOME or ~/.cache; it and every library must be the user's and writable by nobody else.
"""

from __future__ import annotations

import ctypes
import os
import platform
import shlex
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from ccpin.errors import CcpinError

LIBRARY, DIGEST = "program.so", "sha256"  # names of the two files
_FLAGS = (
    "-std=gnu99",
    "-fno-fast-math",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-shared",
    "-fPIC",
    "-Wno-psabi",
)  # after the compiler's own words, whose looser arithmetic they take back


class NoCompilerError(CcpinError):
    """No C compiler, or none that compiles."""


def loaded(
    text: Callable[[], str], made_of: str, flags: Sequence[str], examined: Callable[[ctypes.CDLL], bool]
) -> ctypes.CDLL:
    """The library of a C text.

    Args:
        text: The text, which is asked for where the library is not there yet.
        made_of: A digest of all that decides the text.
        flags: Of optimisation and of the machine.
        examined: Whether a library that was just compiled does what it should.

    Raises:
        NoCompilerError: There is no compiler (`CC`, cc, gcc or clang), it fails, or it makes what does something else.
        CcpinError: The cache cannot be trusted.
    """
    command = compiler()
    held = os.stat(command[0])
    about = (*command, held.st_size, held.st_mtime_ns, platform.system(), platform.machine(), *_FLAGS, *flags, made_of)
    folder = _cache() / sha256("\0".join(map(str, about)).encode()).hexdigest()
    if not _is_own(folder):
        _compile(text(), [*command, *_FLAGS, *flags], folder, examined)
    return ctypes.CDLL(str(folder / LIBRARY))


def compiler() -> list[str]:
    """The C compiler's path, and words that `CC` has after it.

    Raises:
        NoCompilerError: There is none, or none on a system with users and folders of theirs.
    """
    if not hasattr(os, "getuid"):
        raise NoCompilerError("programs are compiled on Linux and macOS: elsewhere they run in NumPy")
    if given := os.environ.get("CC", "").strip():
        try:
            words = shlex.split(given)
        except ValueError as error:
            raise NoCompilerError(f"CC={given!r} is no command: {error}") from None
        if found := shutil.which(words[0]):
            return [found, *words[1:]]
        raise NoCompilerError(f"CC={given!r}, and there is no program '{words[0]}'")
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found]
    raise NoCompilerError("there is no C compiler (cc, gcc or clang)")


def _cache() -> Path:
    """The folder, of mode 700 and the user's.

    Raises:
        CcpinError: It is somebody else's, is none, or cannot be made.
    """
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ccpin" / "programs"
    try:
        home.mkdir(parents=True, exist_ok=True, mode=0o700)
        held = home.lstat()
        if not stat.S_ISDIR(held.st_mode) or held.st_uid != os.getuid():
            raise CcpinError(
                f"{home} belongs to somebody else or is a link: nothing is compiled into it or run from it"
            )
        if held.st_mode & 0o077:
            home.chmod(0o700)
    except OSError as error:
        raise CcpinError(f"there is no folder {home} for compiled programs: {error}") from None
    return home


def _is_own(folder: Path) -> bool:
    """Whether a library is there, is the user's alone, and is what was compiled."""
    try:
        for path in (folder, folder / LIBRARY, folder / DIGEST):
            held = path.lstat()
            if stat.S_ISLNK(held.st_mode) or held.st_uid != os.getuid() or held.st_mode & 0o022:
                return False
        return (folder / DIGEST).read_text() == sha256((folder / LIBRARY).read_bytes()).hexdigest()
    except (OSError, ValueError):
        return False


def _compile(text: str, command: Sequence[str], folder: Path, examined: Callable[[ctypes.CDLL], bool]) -> None:
    """Compile a text into a folder of the cache, whole or not at all.

    Raises:
        NoCompilerError: It fails.
    """
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix="making-") as place:
        made = Path(place) / "made"
        made.mkdir(mode=0o700)
        library, written = made / LIBRARY, Path(place) / "program.c"
        written.write_text(text)
        try:
            whole = [*command, "-o", str(library), str(written), "-lm"]
            done = subprocess.run(whole, capture_output=True, text=True, errors="replace", check=False, cwd=place)
        except OSError as error:
            raise NoCompilerError(f"{command[0]} does not start: {error}") from None
        if done.returncode:
            how = f"killed by signal {-done.returncode}" if done.returncode < 0 else done.stderr.strip()[:400]
            raise NoCompilerError(f"{command[0]} does not compile the program: {how}")
        try:
            library.chmod(0o700)
            right = examined(ctypes.CDLL(str(library)))
        except (OSError, AttributeError) as error:
            raise NoCompilerError(f"{command[0]} says it compiled the program, but it does not load: {error}") from None
        if not right:
            raise NoCompilerError(f"{command[0]} compiles the program to something else: its example does not come out")
        (made / DIGEST).write_text(sha256(library.read_bytes()).hexdigest())
        _put(made, folder, Path(place) / "old")


def _put(made: Path, folder: Path, aside: Path) -> None:
    """Move a folder to its place: what was wrong there is moved aside, what another process just put there stays.

    Raises:
        NoCompilerError: Neither can be done.
    """
    for _ in range(3):
        with suppress(OSError):
            made.rename(folder)
        if _is_own(folder):
            return
        with suppress(OSError):
            folder.rename(aside)
    raise NoCompilerError(f"{folder} cannot be replaced")
