"""Which file a path means: the file itself, an installed model, or the one that a folder holds."""

from __future__ import annotations

import re
from importlib.resources import files
from itertools import islice
from pathlib import Path

from ccpin.description.names import nearest
from ccpin.errors import DescriptionNotFoundError

_IN_A_FOLDER = ("robot.yaml", "robot.urdf", "robot.xml")
"""What is looked for in a folder, in this order: a robot.yaml is about the robot.urdf beside it."""
_BESIDE = 1000
"""How many names of a folder are looked through for one that was meant."""
_READ = 128 * 1024
"""How many bytes of a YAML."""


def installed_models() -> dict[str, Path]:
    """The mechanisms that come with ccpin: their files by name."""
    packaged = Path(str(files("ccpin"))) / "models"
    checkout = Path(__file__).resolve().parents[3] / "models"
    folder = packaged if packaged.is_dir() else checkout
    return {path.stem: path for path in sorted(folder.glob("*.urdf"))}


def find_file(path: str | Path) -> Path:
    """Resolve a path or an installed model's name.

    Raises:
        DescriptionNotFoundError: Neither exists.
    """
    try:
        candidate = Path(path)
        if candidate.exists():
            return candidate
        models = installed_models()
        if str(path) in models:
            return models[str(path)]
    except (OSError, ValueError, TypeError) as error:
        raise DescriptionNotFoundError(f"not a usable path: {error}", source=str(path)[:200]) from None
    meant = nearest(str(path), [*models, *_beside(candidate)])
    hint = f"did you mean '{meant}'? " if meant else ""
    known = f"no such file, and no installed model of that name; {hint}models are {', '.join(models)}"
    raise DescriptionNotFoundError(known, source=str(path))


def _beside(path: Path) -> list[str]:
    """What there is in a path's folder, as the path would be written."""
    try:
        return [str(path.parent / other.name) for other in islice(path.parent.iterdir(), _BESIDE)]
    except OSError:
        return []


def closing_file_of(urdf: str | None) -> Path | None:
    """The YAML beside a URDF that declares its loops (`ccpin.description.toolbox`); ``None`` where there is none."""
    path = Path(urdf or "")
    if path.suffix.lower() != ".urdf" or not path.is_file():
        return None
    beside = [path.parent / Path(name).name for name in sorted(_beside(path))]
    others = [other.name for other in beside if other.suffix.lower() == ".urdf" and other.name != path.name]
    if path.name != "robot.urdf" and others:
        return None
    return next(
        (other for other in beside if other.suffix.lower() in (".yaml", ".yml") and _declares_loops(other)), None
    )


def _declares_loops(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return re.search(rb"^closed_loop\s*:", file.read(_READ), re.MULTILINE) is not None
    except OSError:
        return False


def read_file(path: str | Path) -> tuple[Path, bytes]:
    """The file that a path, a folder or an installed model's name means, and what is in it.

    Raises:
        DescriptionNotFoundError: There is none, or it cannot be read.
    """
    file = find_file(path)
    if file.is_dir():
        file = _file_in(file)
    if not file.is_file():
        raise DescriptionNotFoundError("neither a file nor a folder (a device or a pipe, perhaps)", source=str(file))
    try:
        return file, file.read_bytes()
    except OSError as error:
        raise DescriptionNotFoundError(f"cannot be read: {error.strerror}", source=str(file)) from None


def _file_in(folder: Path) -> Path:
    for name in _IN_A_FOLDER:
        if (folder / name).is_file():
            return folder / name
    from ccpin.description.sdf.includes import model_in

    found = model_in(folder)
    if found is not None:
        return found
    known = f"{', '.join(_IN_A_FOLDER)} or model.sdf"
    raise DescriptionNotFoundError(f"the folder holds no {known}", source=str(folder))
