"""Programs as functions of JAX's arrays, with `custom_jvp` of recorded derivatives.

On a processor they are run in lanes, called back by XLA: XLA's own code for them computes what is used twice again and
again (0.2 ms a state for the two-rod ankle). On other devices they are written out in JAX.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp

from ccpin.errors import InvalidInputError
from ccpin.programs.bridges.differentiated import STEP, Differentiated, evaluated, lacking, parts_of
from ccpin.programs.bridges.row_programs import RowProgram, in_order, leading
from ccpin.programs.program import Program, windows

_JAX = SimpleNamespace(
    sin=jnp.sin, cos=jnp.cos, sqrt=jnp.sqrt, arctan2=jnp.arctan2, arccos=jnp.arccos, minimum=jnp.minimum,
    maximum=jnp.maximum, where=jnp.where, abs=jnp.abs, both=jnp.logical_and, true=True,
)  # fmt: skip


def function_of(program: Program, outputs: str | Sequence[str] | None = None) -> Callable[..., dict[str, Any]]:
    """A program as a function of arrays (…, *shape); a dictionary of arrays (…, *shape)."""
    parts = parts_of(program, outputs)
    value = _runner(parts.values)
    slope = None if parts.slopes is None else _runner(parts.slopes)

    def slopes_at(arrays: list[Any]) -> dict[str, Any]:
        if slope is None:
            raise lacking(parts.missing)
        return slope(arrays)

    def first(primals: Any, tangents: Any) -> Any:
        (arrays,), (moved,) = primals, tangents
        values = function(arrays)
        return values, _moved(parts, slopes(arrays), values, moved)

    def second(primals: Any, tangents: Any) -> Any:
        raise InvalidInputError(f"second derivatives of '{program.name}' are not recorded")

    function, slopes = jax.custom_jvp(value), jax.custom_jvp(slopes_at)
    function.defjvp(first)
    slopes.defjvp(second)

    def called(*placed: Any, **named: Any) -> Any:
        arrays = [jnp.asarray(value) for value in in_order(program, placed, named)]
        batch, kind = leading(program, [array.shape for array in arrays]), jnp.result_type(float, *arrays)
        pairs = zip(arrays, program.inputs, strict=True)
        return function([jnp.broadcast_to(array.astype(kind), (*batch, *port.shape)) for array, port in pairs])

    return called


def _runner(program: Program) -> Callable[[list[Any]], dict[str, Any]]:
    """A program over arrays of one batch, as this machine's default device runs it best."""
    if jax.default_backend() != "cpu":
        return lambda arrays: written_out(program, arrays)
    rows, names = RowProgram(program), [port.name for port in program.outputs]

    def run(arrays: list[Any]) -> dict[str, Any]:
        batch = arrays[0].shape[: arrays[0].ndim - len(program.inputs[0].shape)]
        gives = [jax.ShapeDtypeStruct((*batch, *port.shape), arrays[0].dtype) for port in program.outputs]
        return dict(zip(names, jax.pure_callback(rows, gives, *arrays, vmap_method="broadcast_all"), strict=True))

    return run


def _moved(parts: Differentiated, slopes: dict[str, Any], values: dict[str, Any], moved: list[Any]) -> dict[str, Any]:
    """Σ ∂(output)/∂(input) · change, for every output."""
    found = {name: jnp.zeros_like(value) for name, value in values.items()}
    for (k, j), word in parts.blocks.items():
        output, key = parts.values.outputs[k], parts.values.inputs[j]
        step = moved[j].reshape(*moved[j].shape[: moved[j].ndim - len(key.shape)], key.size)
        if key.name == "q" and STEP in slopes:
            step = (slopes[STEP] * step[..., None, :]).sum(-1)
        wide = step.reshape(*step.shape[:-1], *[1] * len(output.shape), step.shape[-1])
        found[output.name] = found[output.name] + (slopes[word] * wide).sum(-1)
    return found


def written_out(program: Program, arrays: list[Any]) -> dict[str, Any]:
    """Outputs at arrays of one batch as JAX's own operations, NaN where they cannot be trusted."""
    batch, kind = arrays[0].shape[: arrays[0].ndim - len(program.inputs[0].shape)], arrays[0].dtype
    flat = [array.reshape(*batch, port.size) for array, port in zip(arrays, program.inputs, strict=True)]
    entries, trusted = evaluated(program, [array[..., k] for array in flat for k in range(array.shape[-1])], _JAX)
    found = dict[str, Any]()
    for port, window in zip(program.outputs, windows(program.outputs), strict=True):
        wide = [jnp.broadcast_to(jnp.asarray(entry, kind), batch) for entry in entries[window]]
        table = jnp.stack(wide, axis=-1) if wide else jnp.zeros((*batch, 0), kind)
        found[port.name] = jnp.where(jnp.asarray(trusted)[..., None], table, jnp.nan).reshape(*batch, *port.shape)
    return found
