"""Where and when figures were taken."""

from __future__ import annotations

import os
import platform
import sys
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("ccpin", "pin", "mujoco", "drake", "numpy", "scipy")


def machine() -> dict[str, str]:
    """The processor, its load, the date, and the versions of what was measured."""
    about = {
        "date": date.today().isoformat(),
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "load average": " ".join(f"{each:.1f}" for each in os.getloadavg()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": sys.version.split()[0],
        "BLAS threads": os.environ.get("OPENBLAS_NUM_THREADS", "not limited"),
    }
    return about | {package: _version(package) for package in PACKAGES}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
