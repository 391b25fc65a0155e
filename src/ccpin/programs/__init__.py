"""Straight-line programs of the reduced model: recorded once, evaluated anywhere.

A `Program` that was loaded needs NumPy alone; `record` needs the model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ccpin.programs.program import Answer, Port, Program

if TYPE_CHECKING:
    from ccpin.programs.recorder import configuration, record

__all__ = ["Answer", "Port", "Program", "configuration", "record"]
__dir__ = __all__.copy


def __getattr__(name: str) -> Any:
    if name in ("configuration", "record"):
        from ccpin.programs import recorder

        return getattr(recorder, name)
    raise AttributeError(f"module 'ccpin.programs' has no attribute {name!r}")
