"""What a page was computed with."""

from __future__ import annotations

import platform
from importlib import metadata

from ccpin.native import backend

PACKAGES = ("ccpin", "pin", "numpy", "scipy", "matplotlib", "meshcat", "python-flint")


def versions() -> tuple[tuple[str, str], ...]:
    """(name, value) of packages, Python, the machine, and whether the compiled core computed."""
    found = []
    for name in PACKAGES:
        try:
            found.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            found.append((name, "not installed"))
    computes = "the compiled core" if backend().name == "native" else "NumPy"
    machine = f"{platform.system()} {platform.machine()}"
    return (*found, ("Python", platform.python_version()), ("machine", machine), ("computed by", computes))
