"""`ccpin doctor`: what this machine and installation can do, and what is missing for the rest."""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

from ccpin.cli.command import add_command
from ccpin.cli.options import add_mechanism, load
from ccpin.errors import InvalidInputError
from ccpin.native import backend

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "firefox")
_REQUIREMENT = re.compile(r"[A-Za-z0-9_.\-]+")
_EXTRA = re.compile(r"""extra\s*==\s*["']([^"']+)""")


def add_doctor(commands: Any) -> None:
    """The command and its options."""
    example = "example: ccpin doctor delta --json"
    parser = add_command(commands, "doctor", example, _doctor)
    add_mechanism(parser, optional=True)


def _doctor(options: argparse.Namespace) -> int:
    facts = machine()
    if options.mechanism is not None:
        facts["meshes"] = meshes(options)
    print(json.dumps(facts, indent=2) if options.json else in_words(facts))
    return 0


def machine() -> dict[str, Any]:
    """What is installed and found: JSON-ready; ``None`` where something is missing."""
    try:
        computes = backend()._asdict()
    except InvalidInputError as error:
        computes = {"name": None, "reason": str(error)}
    return {
        "ccpin": metadata.version("ccpin"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "backend": computes,
        "compiler": _compiler(),
        "browser": next(filter(None, map(shutil.which, _BROWSERS)), None),
        "packages": _packages(),
    }


def meshes(options: argparse.Namespace) -> dict[str, Any]:
    """The mesh files a mechanism's links name, and those of them that are not there."""
    shapes = [visual.shape for link in load(options).description.links for visual in link.visuals]
    named = sorted({shape.mesh for shape in shapes if shape.mesh is not None})
    return {"named": len(named), "missing": [mesh for mesh in named if not Path(mesh).is_file()]}


def _compiler() -> str | None:
    """The C++ compiler that an installation from sources would use, and its version."""
    wanted = os.environ.get("CXX", "").split()[:1] or ["c++", "g++", "clang++"]
    program = next(filter(None, map(shutil.which, wanted)), None)
    if program is None:
        return None
    told = subprocess.run([program, "--version"], capture_output=True, text=True, check=False, timeout=20)
    return f"{program}: {told.stdout.splitlines()[0]}" if told.stdout else program


def _packages() -> dict[str, dict[str, str | None]]:
    """The installed version of each package ccpin names, ``None``: not installed; by the extra that asks for it."""
    found: dict[str, dict[str, str | None]] = {}
    for requirement in metadata.requires("ccpin") or ():
        name, extra = _REQUIREMENT.match(requirement), _EXTRA.search(requirement)
        if name is None or name[0] == "ccpin":
            continue
        try:
            version: str | None = metadata.version(name[0])
        except metadata.PackageNotFoundError:
            version = None
        found.setdefault(extra[1] if extra else "", {})[name[0]] = version
    return found


def in_words(facts: dict[str, Any]) -> str:
    """The findings as text for a terminal."""
    computes = facts["backend"]
    lines = [
        f"ccpin {facts['ccpin']}, Python {facts['python']}, {facts['platform']}, {facts['cores']} cores",
        f"computed by  {computes['name'] or 'nothing'}: {computes['reason']}",
        f"compiler     {facts['compiler'] or 'none found: installations from sources compute with NumPy'}",
        f"browser      {facts['browser'] or 'none found on the path: pages can be written, not opened from here'}",
    ]
    for extra, packages in facts["packages"].items():
        told = ", ".join(f"{name} {version or 'missing'}" for name, version in packages.items())
        missing = extra and None in packages.values()
        hint = f"  (pip install 'ccpin[{extra}]')" if missing else ""
        lines.append(f"{f'[{extra}]' if extra else 'packages':12s} {told}{hint}")
    if "meshes" in facts:
        gone = facts["meshes"]["missing"]
        lines.append(f"meshes       {facts['meshes']['named']} named, {len(gone)} missing")
        lines += [f"  missing: {mesh}" for mesh in gone]
    return "\n".join(lines)
