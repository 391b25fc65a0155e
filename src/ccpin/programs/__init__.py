"""Straight-line programs of the reduced model: recorded once, evaluated anywhere.

A `Program` that was loaded needs NumPy alone; `record` needs the model. `as_function` makes a program a function of
CasADi, JAX or PyTorch, `differential_action` a model of Crocoddyl's.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ccpin.programs.program import Answer, Port, Program

if TYPE_CHECKING:
    from ccpin.programs.bridges import as_function, differential_action
    from ccpin.programs.compiled_model import compiled
    from ccpin.programs.exporting import export
    from ccpin.programs.recordings import configuration, record

_WHERE = {  # what is imported with the first use of a name
    "as_function": "bridges",
    "compiled": "compiled_model",
    "configuration": "recordings",
    "differential_action": "bridges",
    "export": "exporting",
    "record": "recordings",
}
__all__ = [
    "Answer",
    "Port",
    "Program",
    "as_function",
    "compiled",
    "configuration",
    "differential_action",
    "export",
    "record",
]
__dir__ = __all__.copy


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(importlib.import_module(f"ccpin.programs.{_WHERE[name]}"), name)
    raise AttributeError(f"module 'ccpin.programs' has no attribute {name!r}")
