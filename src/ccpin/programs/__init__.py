"""Straight-line programs of the reduced model: recorded once, evaluated anywhere.

`load` and a loaded `Program` need NumPy alone; `record` needs the model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ccpin.programs.program import Answer, Port, Program, load

if TYPE_CHECKING:
    from ccpin.programs.exporting import export
    from ccpin.programs.recorder import record

__all__ = ["Answer", "Port", "Program", "export", "load", "record"]
__dir__ = __all__.copy


def __getattr__(name: str) -> Any:
    if name == "export":
        from ccpin.programs.exporting import export

        return export
    if name == "record":
        from ccpin.programs.recorder import record

        return record
    raise AttributeError(f"module 'ccpin.programs' has no attribute {name!r}")
