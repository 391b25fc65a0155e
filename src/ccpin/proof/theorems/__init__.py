"""The theorems that certificates stand on, one file each with its proof; `index.md` lists them.

They are files, not docstrings: documents carry them, also those that `python -OO` writes.
"""

from __future__ import annotations

from importlib.resources import files


def theorem(name: str) -> str:
    """The text of a theorem's file, e.g. ``theorem("theorem_n")``."""
    return files(__name__).joinpath(f"{name}.md").read_text(encoding="utf-8")


def theorems(*names: str) -> str:
    """The texts of several, one after the other."""
    return "\n".join(map(theorem, names))
