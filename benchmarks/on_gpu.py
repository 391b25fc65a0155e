"""Programs on a GPU beside lanes on its host's processor, and many steps beside MJX.

On a machine with ccpin and MuJoCo, `python -m benchmarks.on_gpu --write FOLDER [MODEL …]` records programs and draws
closed states. On the one with the GPU, `python -m benchmarks.on_gpu FOLDER` runs them; it needs NumPy, CuPy and a C
compiler, and where they are installed it sets JAX, PyTorch and MJX beside. Times are of CUDA's events, of data that
stays on the GPU; `bits` counts numbers of which GPU and lanes differ in any bit, refused rows among them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ccpin import programs
from ccpin.programs import Program, cuda, lanes

MODELS = ("rpdr", "docs/howto/ankle.urdf", "delta", "stewart")
QUANTITIES = {"accelerations": ("forward_dynamics", "closed"), "with_sigma": ("forward_dynamics", "near")}
DRAWN, ROWS, ROUNDS = 4096, 2**20, 5  # states drawn; rows on the GPU, of these again and again
ENVIRONMENTS, STEPS, STEP = (4096, 65536, 2**20), 100, 1e-3
FORMATS = ("double", "float")
LONGEST = 45.0  # seconds that another's compiler may take


class Recorded(NamedTuple):
    """A program, rows of its inputs, one column an input's entry, and what compilers made of it."""

    name: str
    program: Program
    rows: np.ndarray
    format: str
    kernel: cuda.CudaProgram
    lanes: Any
    seconds: float


def write(folder: Path, models: list[str]) -> None:
    """Programs, states and MuJoCo's models of some mechanisms."""
    from benchmarks.many_steps import placed, swinging
    from benchmarks.peers import NotForThisError

    folder.mkdir(parents=True, exist_ok=True)
    for given in models:
        name, held, rng = Path(given).stem, swinging(given, DRAWN), np.random.default_rng(1)
        closed = [
            programs.configuration(held.model.at(q, near=near)) for q, near in zip(held.q, held.q_free, strict=True)
        ]
        for what, (quantity, known) in {**QUANTITIES, "step": ("step", "closed")}.items():
            program = programs.record(held.model, quantity, given=known)
            drawn = {key: np.array([each[key] for each in closed]) for key in ("q", "y")}
            if known == "near":
                drawn["y"] += 0.01 * rng.normal(size=drawn["y"].shape)
            drawn["h"] = np.full((DRAWN, 1), STEP)
            for key, size in (("v", held.model.n), ("u", held.model.n_actuated)):
                drawn[key] = rng.normal(size=(DRAWN, size))
            program.save(folder / f"{name}.{what}.json")
            np.save(folder / f"{name}.{what}.npy", np.hstack([drawn[port.name] for port in program.inputs]))
        try:
            import mujoco

            model, places = placed(held, "Euler")
        except (ImportError, NotForThisError) as error:
            print(f"{name}: without MuJoCo's model: {error}")
            continue
        mujoco.mj_saveModel(model, str(folder / f"{name}.mjb"))
        np.save(folder / f"{name}.qpos.npy", held.q_free[:, places])


def program_of(folder: Path, name: str, what: str) -> tuple[Program, np.ndarray]:
    """What was written."""
    return Program.load(folder / f"{name}.{what}.json"), np.load(folder / f"{name}.{what}.npy")


def built(folder: Path, name: str, what: str, format: str) -> Recorded:
    """A program for the GPU and for the processor."""
    program, rows = program_of(folder, name, what)
    began = time.perf_counter()
    kernel = cuda.CudaProgram(program, format)
    seconds = time.perf_counter() - began
    return Recorded(f"{name} {what}", program, rows, format, kernel, lanes.CompiledProgram(program, format), seconds)


def inputs(program: Program, rows: np.ndarray, count: int) -> list[np.ndarray]:
    """So many rows for each input, of shape (count, entries)."""
    ends = np.cumsum([port.size for port in program.inputs])[:-1]
    return np.split(np.resize(rows, (count, rows.shape[1])), ends, axis=1)


def timed(run: Callable[[], object]) -> float:
    """Milliseconds on the GPU, the best of some rounds after one that is not counted."""
    import cupy

    run()
    found = list[float]()
    for _ in range(ROUNDS):
        first, last = cupy.cuda.Event(), cupy.cuda.Event()
        first.record()
        run()
        last.record()
        last.synchronize()
        found.append(cupy.cuda.get_elapsed_time(first, last))
    return min(found)


def wall(run: Callable[[], object]) -> float:
    """Milliseconds by the wall's clock, the best of some rounds after one that is not counted."""
    run()
    found = list[float]()
    for _ in range(ROUNDS):
        began = time.perf_counter()
        run()
        found.append(time.perf_counter() - began)
    return 1e3 * min(found)


def rows_line(recorded: Recorded) -> str:
    """A program of rows by themselves."""
    import cupy

    _, program, rows, format, kernel, lanes, seconds = recorded
    given, kind = inputs(program, rows, ROWS), np.float64 if format == "double" else np.float32
    columns = [cupy.asarray(np.ascontiguousarray(each.T, dtype=kind)) for each in given]
    wanted, found = lanes(*inputs(program, rows, DRAWN)), kernel(*columns)
    bits = sum(differing(a, cupy.asnumpy(b)[..., :DRAWN].T) for a, b in zip(wanted, found, strict=True))
    host = [np.asfortranarray(each, dtype=kind) for each in given]
    one, all_of = (wall(lambda threads=n: lanes(*host, threads=threads)) for n in (1, os.cpu_count() or 1))
    gpu = timed(lambda: kernel(*columns))
    return (
        f"{recorded.name:28s}{format:8s}{kernel.registers:6d}{kernel.local_bytes:8d}{bits:8d}{1e6 * gpu / ROWS:12.3f}"
        f"{one / gpu:12.0f}{all_of / gpu:12.1f}{seconds:10.1f}"
    )


def differing(a: np.ndarray, b: np.ndarray) -> int:
    """Numbers that are not the same, NaN for NaN."""
    a = a.reshape(len(a), -1)
    return int(np.count_nonzero(~((a == b.reshape(a.shape)) | (np.isnan(a) & np.isnan(b.reshape(a.shape))))))


def steps_lines(recorded: Recorded) -> Iterator[str]:
    """Many steps from rest of many mechanisms at once."""
    import cupy

    _, program, rows, format, kernel, lanes, _ = recorded
    kind = np.float64 if format == "double" else np.float32
    for environments in ENVIRONMENTS:
        q, y, v, u, h = inputs(program, rows, environments)
        start, held = [q, y, 0.0 * v], [0.0 * u, h]
        on_gpu, kept = (
            [cupy.asarray(np.ascontiguousarray(each.T, dtype=kind)) for each in group] for group in (start, held)
        )

        def run(state: Any = on_gpu, kept: Any = kept) -> Any:
            worst = 0
            for _ in range(STEPS):
                *state, status = kernel(*state, *kept)
                worst = cupy.maximum(worst, status)
            return state, worst

        state, worst = run()
        few = [each[:DRAWN] for each in start]
        for _ in range(STEPS):
            *few, _ = lanes(*few, *(each[:DRAWN] for each in held))
        bits = sum(differing(a, cupy.asnumpy(b).T[:DRAWN]) for a, b in zip(few, state, strict=True))
        rate, refused = environments * STEPS / timed(run) * 1e3, int(cupy.count_nonzero(worst))
        yield f"{recorded.name:28s}{format:8s}{environments:10d}{rate / 1e6:14.1f}{bits:8d}{refused:9d}"


def beside(folder: Path, name: str, who: str) -> None:
    """One line of another, in a process of its own."""
    began = time.perf_counter()
    if who == "mjx":
        import jax
        import mujoco
        from mujoco import mjx

        jax.config.update("jax_enable_x64", True)
        model = mujoco.MjModel.from_binary_path(str(folder / f"{name}.mjb"))
        on_device, first = mjx.put_model(model), mjx.put_data(model, mujoco.MjData(model))
        for environments in ENVIRONMENTS[:2]:
            qpos = np.load(folder / f"{name}.qpos.npy")
            starts = jax.numpy.asarray(np.resize(qpos, (environments, qpos.shape[1])))

            def one(qpos: Any) -> Any:
                data = first.replace(qpos=qpos)
                return jax.lax.fori_loop(0, STEPS, lambda _, each: mjx.step(on_device, each), data).qpos

            run = jax.jit(jax.vmap(one))
            run(starts).block_until_ready()
            made = time.perf_counter() - began
            rate = environments * STEPS / wall(lambda run=run, s=starts: run(s).block_until_ready()) * 1e3
            print(
                f"{name:10s}MJX, Euler, double{environments:10d}{rate / 1e6:14.2f}   compiled in {made:.0f} s",
                flush=True,
            )
        return
    program, rows = program_of(folder, name, "accelerations")
    given = inputs(program, rows, ROWS)
    if who == "jax":
        import jax

        jax.config.update("jax_enable_x64", True)
        function = jax.jit(programs.as_function(program, "jax"))
        given = [jax.numpy.asarray(each) for each in given]
        found = function(*given)["forward_dynamics"].block_until_ready()
        made = time.perf_counter() - began
        ms = wall(lambda: function(*given)["forward_dynamics"].block_until_ready())
    else:
        import torch

        if who != "torch":
            sys.modules["cupy"] = None  # type: ignore[assignment]
        function = programs.as_function(program, "torch")
        given = [torch.asarray(each, device="cuda") for each in given]
        found = function(*given)["forward_dynamics"].cpu()
        made = time.perf_counter() - began

        def run() -> None:
            function(*given)
            torch.cuda.synchronize()

        ms = wall(run)
    wanted = lanes.CompiledProgram(program)(*inputs(program, rows, DRAWN))[0]
    off = np.abs(np.asarray(found)[:DRAWN] - wanted).max() / np.abs(wanted).max()
    print(
        f"{name:10s}{who:20s}{1e6 * ms / ROWS:12.3f} ns a row, {off:.0e} off, first answer after {made:.1f} s",
        flush=True,
    )


def main(arguments: list[str] | None = None) -> None:
    """Write, or run and print."""
    parser = argparse.ArgumentParser("python -m benchmarks.on_gpu", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("models", nargs="*", default=list(MODELS))
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--beside", help=argparse.SUPPRESS)
    asked = parser.parse_args(arguments)
    names = [Path(each).stem for each in asked.models]
    if asked.write:
        return write(asked.folder, asked.models)
    if asked.beside:
        return beside(asked.folder, names[0], asked.beside)
    import cupy

    print(cupy.cuda.runtime.getDeviceProperties(0)["name"].decode(), "beside", os.cpu_count(), "cores")
    words, widths = (
        ("regs", "local", "bits", "ns a row", "of a core", "of all", "built, s"),
        (6, 8, 8, 12, 12, 12, 10),
    )
    heads = zip(words, widths, strict=True)
    print(" " * 36 + "".join(f"{head:>{wide}s}" for head, wide in heads))
    wanted = [(name, what, format) for name in names for what in (*QUANTITIES, "step") for format in FORMATS]
    with ThreadPoolExecutor() as pool:
        everything = list(pool.map(lambda each: built(asked.folder, *each), wanted))
    for recorded in everything:
        if not recorded.name.endswith("step"):
            print(rows_line(recorded), flush=True)
    print(f"\n{'':28s}{'':8s}{'at once':>10s}{'million/s':>14s}{'bits':>8s}{'refused':>9s}")
    for recorded in everything:
        if recorded.name.endswith("step"):
            for line in steps_lines(recorded):
                print(line, flush=True)
    print()
    for who, some in (("torch", names), ("torch, no CuPy", names), ("mjx", names), ("jax", names[:2])):
        for name in some:
            command = [sys.executable, "-m", "benchmarks.on_gpu", str(asked.folder), name, "--beside", who]
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
                said = done.stdout.rstrip() or f"{name:10s}{who}: {(done.stderr.strip() or '?').splitlines()[-1][:160]}"
            except subprocess.TimeoutExpired:
                said = f"{name:10s}{who}: not within {LONGEST:.0f} s"
            print(said, flush=True)


if __name__ == "__main__":
    main()
