"""Straight-line programs of the reduced model: recorded once, evaluated anywhere.

A `Program` that was loaded needs NumPy alone; `record` needs the model. `as_function` makes a program a function of
CasADi, JAX or PyTorch, `differential_action` a model of Crocoddyl's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ccpin.programs.program import Answer, Port, Program

if TYPE_CHECKING:
    from ccpin.programs.bridges import as_function, differential_action
    from ccpin.programs.recorder import configuration, record

__all__ = ["Answer", "Port", "Program", "as_function", "configuration", "differential_action", "record"]
__dir__ = __all__.copy


def __getattr__(name: str) -> Any:
    if name in ("configuration", "record"):
        from ccpin.programs import recorder

        return getattr(recorder, name)
    if name in ("as_function", "differential_action"):
        from ccpin.programs import bridges

        return getattr(bridges, name)
    raise AttributeError(f"module 'ccpin.programs' has no attribute {name!r}")
