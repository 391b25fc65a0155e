"""Whether a wheel carries the core of these sources: `python native/fitting.py` prints their digest.

`python native/fitting.py WHEEL FOLDER` puts the wheel's core into the folder where it was built from the same sources,
and ends with status 1 where it was not. CMakeLists.txt writes the digest into every wheel.
"""

import hashlib
import sys
import zipfile
from pathlib import Path

DIGEST = "ccpin/native/_core.sha256"  # in a wheel
CORE = ("ccpin/native/_core.", (".so", ".pyd"))


def digest(folder: Path) -> str:
    """SHA-256 of the names and contents of what the core is built from."""
    sources = sorted(path for path in folder.iterdir() if path.suffix in (".cpp", ".hpp", ".txt"))
    each = [f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n" for path in sources]
    return hashlib.sha256("".join(each).encode()).hexdigest()


def take(wheel: Path, sources: Path, place: Path) -> bool:
    """Put a wheel's core into a folder if it is that of the sources; whether it is."""
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
        cores = [name for name in names if name.startswith(CORE[0]) and name.endswith(CORE[1])]
        if DIGEST not in names or file.read(DIGEST).decode().strip() != digest(sources) or not cores:
            return False
        for name in cores:
            (place / Path(name).name).write_bytes(file.read(name))
    return True


if __name__ == "__main__":
    here = Path(__file__).resolve().parent
    if len(sys.argv) == 1:
        sys.stdout.write(digest(here))
    else:
        sys.exit(not take(Path(sys.argv[1]), here, Path(sys.argv[2])))
