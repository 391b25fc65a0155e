"""Programs as functions of PyTorch's tensors, with an `autograd.Function` of recorded derivatives.

Tensors of a processor are run in lanes, those of a GPU by the kernel of `ccpin.programs.cuda` where CuPy is installed;
on other devices, and without CuPy, programs are written out in PyTorch's operations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import torch

from ccpin.errors import InvalidInputError
from ccpin.programs.bridges.differentiated import STEP, Differentiated, evaluated, lacking, parts_of
from ccpin.programs.bridges.row_programs import RowProgram, in_order, leading
from ccpin.programs.cuda import CudaProgram
from ccpin.programs.program import Program, windows
from ccpin.programs.sine_cosine import Format

_TORCH = SimpleNamespace(
    sin=torch.sin, cos=torch.cos, sqrt=torch.sqrt, arctan2=torch.atan2, arccos=torch.acos,
    minimum=lambda a, b: torch.clamp(a, max=b), maximum=lambda a, b: torch.clamp(a, min=b), where=torch.where,
    abs=torch.abs, both=lambda a, b: b if a is True else a & b, true=True,
)  # fmt: skip


def function_of(program: Program, outputs: str | Sequence[str] | None = None) -> Callable[..., dict[str, Any]]:
    """A program as a function of tensors (…, *shape); a dictionary of tensors (…, *shape)."""
    parts = parts_of(program, outputs)
    names = [port.name for port in parts.values.outputs]
    value = _runner(parts.values)
    slope = None if parts.slopes is None else _runner(parts.slopes)

    class RecordedSlopes(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, *tensors: Any) -> Any:
            if slope is None:
                raise lacking(parts.missing)
            return tuple(slope(tensors))

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> Any:
            raise InvalidInputError(f"second derivatives of '{program.name}' are not recorded")

    class Recorded(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, *tensors: Any) -> Any:
            ctx.save_for_backward(*tensors)
            return tuple(value(tensors))

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> Any:
            return _pulled(parts, RecordedSlopes.apply(*ctx.saved_tensors), weights, ctx.saved_tensors)

    def called(*placed: Any, **named: Any) -> dict[str, Any]:
        tensors = [torch.as_tensor(value) for value in in_order(program, placed, named)]
        batch, kind = leading(program, [tuple(tensor.shape) for tensor in tensors]), _kind(tensors)
        pairs = zip(tensors, program.inputs, strict=True)
        wide = [tensor.to(kind).expand(*batch, *port.shape) for tensor, port in pairs]
        return dict(zip(names, Recorded.apply(*wide), strict=True))

    return called


def _kind(tensors: list[Any]) -> Any:
    kind = tensors[0].dtype
    for tensor in tensors[1:]:
        kind = torch.promote_types(kind, tensor.dtype)
    return kind if kind.is_floating_point else torch.get_default_dtype()


_FORMATS: dict[Any, Format] = {torch.float64: "double", torch.float32: "float"}
_CUPY = find_spec("cupy") is not None


def _runner(program: Program) -> Callable[[Any], list[Any]]:
    """A program over tensors of one batch, as their device runs it best."""
    rows = RowProgram(program)

    @cache
    def on_gpu(index: int, format: Format) -> CudaProgram:
        import cupy

        with cupy.cuda.Device(index):
            return CudaProgram(program, format)

    def run(tensors: Any) -> list[Any]:
        device, kind = tensors[0].device, tensors[0].dtype
        if device.type == "cpu":
            return [torch.from_numpy(found) for found in rows(*(tensor.detach().numpy() for tensor in tensors))]
        if device.type == "cuda" and kind in _FORMATS and _CUPY:
            return _launched(on_gpu(device.index, _FORMATS[kind]), tensors)
        return written_out(program, tensors)

    return run


def _launched(kernel: CudaProgram, tensors: Any) -> list[Any]:
    """A kernel's outputs at tensors of one batch, on PyTorch's stream, NaN where its status is not 0."""
    import cupy

    ports, outputs, device = kernel.program.inputs, kernel.program.outputs, tensors[0].device
    batch = tensors[0].shape[: tensors[0].ndim - len(ports[0].shape)]
    rows, pairs = math.prod(batch), zip(tensors, ports, strict=True)
    columns = [tensor.detach().reshape(rows, port.size).T for tensor, port in pairs]
    stream = torch.cuda.current_stream(device)
    with cupy.cuda.Device(device.index), cupy.cuda.ExternalStream(stream.cuda_stream):
        *found, status = map(torch.from_dlpack, kernel(*columns))
    refused = status != 0
    return [
        table.masked_fill_(refused, math.nan).T.reshape(*batch, *port.shape)
        for table, port in zip(found, outputs, strict=True)
    ]


def _pulled(parts: Differentiated, tables: Any, weights: Any, tensors: Any) -> tuple[Any, ...]:
    """Σ weightᵀ ∂(output)/∂(input), for every input."""
    assert parts.slopes is not None
    slopes = dict(zip([port.name for port in parts.slopes.outputs], tables, strict=True))
    found: list[Any] = [torch.zeros_like(tensor) for tensor in tensors]
    for (k, j), word in parts.blocks.items():
        output, key, table = parts.values.outputs[k], parts.values.inputs[j], slopes[word]
        batch = tensors[j].shape[: tensors[j].ndim - len(key.shape)]
        flat = table.reshape(*batch, output.size, table.shape[-1])
        pulled = (weights[k].reshape(*batch, output.size, 1) * flat).sum(-2)
        if key.name == "q" and STEP in slopes:
            pulled = (pulled[..., :, None] * slopes[STEP]).sum(-2)
        found[j] = found[j] + pulled.reshape(tensors[j].shape)
    return tuple(found)


def written_out(program: Program, tensors: Any) -> list[Any]:
    """Outputs at tensors of one batch as PyTorch's own operations, NaN where they cannot be trusted."""
    like = tensors[0]
    batch = like.shape[: like.ndim - len(program.inputs[0].shape)]
    flat = [tensor.reshape(*batch, port.size) for tensor, port in zip(tensors, program.inputs, strict=True)]
    columns = [tensor[..., k] for tensor in flat for k in range(tensor.shape[-1])]
    entries, trusted = evaluated(program, columns, _TORCH)
    found = list[Any]()
    for port, window in zip(program.outputs, windows(program.outputs), strict=True):
        wide = [torch.as_tensor(x, dtype=like.dtype, device=like.device).expand(batch) for x in entries[window]]
        table = torch.stack(wide, dim=-1) if wide else like.new_zeros((*batch, 0))
        if trusted is not True:
            table = torch.where(trusted[..., None], table, math.nan)
        found.append(table.reshape(*batch, *port.shape))
    return found
