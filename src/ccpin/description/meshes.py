"""Finding the mesh files a description names."""

from __future__ import annotations

from pathlib import Path


def find_mesh(name: str, source: str | None) -> Path | None:
    """Resolve a mesh's file name next to and above the source file.

    It is plain, or stands behind ``file://``, ``package://`` or ``model://``.
    """
    if not name or "\0" in name or source is None:
        return None
    folder = Path(source).parent
    plain = name.split("://", 1)[-1].lstrip("/") if "://" in name else name
    candidates = [Path(name.removeprefix("file://"))] if name.startswith(("/", "file:///")) else []
    candidates += [base / plain for base in (folder, *folder.resolve().parents[:4])]
    try:
        return next((path.resolve() for path in candidates if path.is_file()), None)
    except OSError:
        return None
