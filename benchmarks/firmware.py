"""Instructions of exported programs on a Cortex-M4F, counted in qemu: `python -m benchmarks.firmware`.

Debian brings the tools: gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm. qemu models no cycles: with
`-icount shift=0` an instruction takes a nanosecond, and SysTick counts them, 40 a tick. A run repeats exactly.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ccpin
from ccpin import control, programs

COMPILER, MACHINE = "arm-none-eabi-gcc", "qemu-system-arm"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
TICK, TIMES = 40, 50  # instructions a tick of SysTick at 25 MHz, calls that are counted
ANKLE = Path(__file__).parents[1] / "docs" / "howto" / "ankle.urdf"

SCRIPT = """ENTRY(start)
MEMORY { code (rx) : ORIGIN = 0, LENGTH = 4M  data (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
SECTIONS { .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) } > code .data : { *(.data*) *(.bss*) *(COMMON) } > data
/DISCARD/ : { *(.ARM*) *(.comment) } }
"""
MAIN = """#include <stdint.h>
#include <string.h>
#include "{name}.h"
void start(void);
__attribute__((section(".vectors"), used)) static const uintptr_t vectors[2] = {{0x20400000u, (uintptr_t)start}};
static const float states[{rows}][{reads}] = {{{numbers}}};
static void ask(int what, const void *with)
{{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = with;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}}
static void tell(uint32_t word)
{{
    char text[10];
    for (int k = 0; k < 8; k++) text[k] = "0123456789abcdef"[(word >> (28 - 4 * k)) & 15];
    text[8] = '\\n';
    text[9] = 0;
    ask(4, text);
}}
static int __attribute__((noinline)) body(const float *x, float *out) {{ return {name}({places}); }}
static int __attribute__((noinline)) empty(const float *x, float *out) {{ return x == out; }}
static uint32_t ticks(int (*volatile call)(const float *, float *), float *out)
{{
    volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010u;
    systick[1] = 0xFFFFFF;
    systick[2] = 0;
    systick[0] = 5;
    const uint32_t before = systick[2];
    for (int k = 0; k < {times}; k++) call(states[k % {rows}], out);
    return before - systick[2];
}}
void start(void)
{{
    float out[{gives}];
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm__ volatile("dsb\\nisb");
    tell(ticks(body, out) - ticks(empty, out));
    for (int n = 0; n < {rows}; n++) {{
        tell((uint32_t)body(states[n], out));
        for (int k = 0; k < {gives}; k++) {{
            uint32_t word;
            memcpy(&word, out + k, 4);
            tell(word);
        }}
    }}
    ask(0x18, (const void *)0x20026);
    for (;;) {{ }}
}}
"""


class Counted(NamedTuple):
    """What a program costs on the machine.

    Attributes:
        instructions: Of one call, the mean over states.
        bytes: Of code and constants.
        outputs, status: At the program's test states, of shape (N, outputs) and (N,).
    """

    instructions: float
    bytes: int
    outputs: np.ndarray
    status: np.ndarray


def absent() -> list[str]:
    """Tools that are not there."""
    return [tool for tool in (COMPILER, MACHINE) if shutil.which(tool) is None]


def states(program: programs.Program) -> np.ndarray:
    """Inputs at closed states, of shape (N, inputs); y is a little off where σ is found."""
    rows = np.array([program.example, *program.around])
    ends = np.cumsum([0, *(port.size for port in program.inputs)])
    if program.corrections:
        rows[:, ends[1] : ends[2]] += 0.02 * (rows[0, ends[1] : ends[2]] - rows[:, ends[1] : ends[2]])
    return rows


def arguments(program: programs.Program, given: str, out: str) -> list[str]:
    """What the exported function is called with, where all inputs and all outputs are one array each."""
    found = list[str]()
    for ports, word in ((program.inputs, given), (program.outputs, out)):
        starts = np.cumsum([0, *(port.size for port in ports)])
        found += [f"{word} + {start}" for start, port in zip(starts, ports, strict=False) if port.size]
    return found


def counted(program: programs.Program) -> Counted:
    """A program compiled for the Cortex-M4F in float, and run there."""
    rows, name = states(program).astype(np.float32), "firmware"
    sizes = [port.size for port in (*program.inputs, *program.outputs)]
    reads = sum(sizes[: len(program.inputs)])
    places = ", ".join(arguments(program, "x", "out"))
    gives = sum(sizes) - reads
    numbers = ", ".join("{" + ", ".join(f"{float(value).hex()}f" for value in row) + "}" for row in rows)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        programs.export(program, folder, name=name, format="float")
        told = {"name": name, "rows": len(rows), "reads": reads, "gives": gives, "times": TIMES}
        (folder / "main.c").write_text(MAIN.format(**told, numbers=numbers, places=places))
        (folder / "ram.ld").write_text(SCRIPT)
        command = [COMPILER, *FLAGS, "-nostartfiles", "-T", "ram.ld", "main.c", "-o", "run.elf", "-lm"]
        subprocess.run(command, check=True, cwd=folder)
        subprocess.run([COMPILER, *FLAGS, "-c", "main.c"], check=True, cwd=folder)
        told_size = subprocess.run(["arm-none-eabi-size", "main.o"], check=True, cwd=folder, capture_output=True)
        run = [MACHINE, "-machine", "mps2-an386", "-cpu", "cortex-m4", "-icount", "shift=0", "-nographic"]
        run += ["-monitor", "none", "-serial", "none"]
        run += ["-semihosting-config", "enable=on,target=native", "-kernel", "run.elf"]
        done = subprocess.run(run, check=True, cwd=folder, capture_output=True, timeout=120, stdin=subprocess.DEVNULL)
    words = [int(line, 16) for line in (done.stdout + done.stderr).decode().split()]
    table = np.array(words[1:], dtype=np.uint32).reshape(len(rows), 1 + gives)
    code = int(told_size.stdout.split()[6]) - rows.nbytes
    outputs = np.ascontiguousarray(table[:, 1:]).view(np.float32)
    return Counted(words[0] * TICK / TIMES, code, outputs, table[:, 0].astype(np.int64))


def controllers(model: ccpin.ReducedModel) -> Iterator[tuple[str, programs.Program]]:
    """σ by two Newton steps, alone and with the laws (28) and (30)."""
    goal = model.alpha(model.mechanism.q_reference)
    gains = control.local_gains(model, goal)
    yield "sigma", programs.record(model, "sigma", given="near", steps=2)
    for word, law in (("(28)", control.PDSimpleGravity), ("(30)", control.PDFullGravity)):
        made = law(model, goal, *gains)
        yield f"sigma and {word}", programs.record(model, ["sigma", "torque"], given="near", steps=2, law=made)


def float_error(program: programs.Program, found: np.ndarray) -> float:
    """The largest error of float's answers against double's, relative to each output's largest entry."""
    rows = states(program).astype(np.float32).astype(np.float64)
    parts = np.split(rows, np.cumsum([port.size for port in program.inputs])[:-1], axis=1)
    wanted = program(**{port.name: part for port, part in zip(program.inputs, parts, strict=True)})
    errors, first = list[float](), 0
    for port in program.outputs:
        expected = wanted[port.name].reshape(len(rows), -1)
        errors.append(np.abs(found[:, first : first + port.size] - expected).max() / np.abs(expected).max())
        first += port.size
    return max(errors)


def main() -> None:
    """A table."""
    print("mechanism  program          operations  instructions  bytes  float's error")
    for name in ("rpdr", str(ANKLE)):
        model = ccpin.ReducedModel(ccpin.load(name))
        for word, program in controllers(model):
            cost = counted(program)
            made = f"{sum(program.operations.values()):>10}  {cost.instructions:>12.0f}  {cost.bytes:>5}"
            told = f"{float_error(program, cost.outputs):>13.1e}"
            print(f"{model.mechanism.name:<9}  {word:<15}  {made}  {told}")


if __name__ == "__main__":
    if gone := absent():
        raise SystemExit(f"not here: {', '.join(gone)}")
    main()
