"""The page of the documentation, made from what was measured: nothing on it is written by hand but its frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchmarks.measured import Measured
from benchmarks.table import markdown, notes
from benchmarks.targets import Verdict, verdicts

HEAD = """# What it costs

![Ratios of each model, growth in joints, and the paper's move](benchmarks.png)

CPU time of one process, the Python call included; everyone is taken in turn within a round, and the figure is the
median of the rounds. In brackets: the ratio to the peer's time, the median of the rounds; the peer is Pinocchio's
`constraintDynamics` (for ∂q̈ its derivatives, for batches a Python loop over it, for a step `mj_step`, ours being
error-controlled at 1e-9, for the paper's move MuJoCo's RK4 at 1e-4). `native` is a model or State with the compiled
core behind it, `kernel alone` that core itself (at one State, whose q′ it closes once; `another q′ each time` closes
it in every call), `numpy` the NumPy reference ([native.md](native.md)). Made, from the project's root with its test
extra installed, by

    export OPENBLAS_NUM_THREADS=1
    python -m benchmarks --others FOLDER --check --json docs/benchmarks.json
    python -m benchmarks --read docs/benchmarks.json --figure docs/benchmarks.png --page docs/benchmarks.md

where FOLDER holds cassie_like and digit_like of example-parallel-robots; without it, and without Drake
(`pip install drake`), these are skipped with a word. `python -m benchmarks models simulated` measures some parts only.

Peers at their best: Pinocchio with the fastest proximal settings whose q̈′ agrees with the reference (1e-9, `lcaba` 1e-6
where it can), contact rows fitting each closure; MuJoCo with Newton's solver, no contacts, loops as stiff as the step
allows, `mj_forward` for q̈, and runs in C with its own servo motors; Drake with its discrete SAP solver, in which alone
its loops exist, and its own PD motors. MuJoCo's and Drake's loops are stiff springs, so their q̈ is not quite the
constrained one. `central differences` are 2 (2n + motors) forward dynamics of the core.
"""

EXPLAINED = {
    "models": """One state of each model, from a State that is known already where it says so; σ starts from a closed
configuration 1e-2 rad away.""",
    "families": """n four-bars standing on one another (serial) or side by side (parallel), 3n joints. Exponents are
fitted to the members of 24 joints and more, every round for itself.""",
    "batches": "Each row finds its own σ from 1e-2 rad away; the loop over Pinocchio is given q′. Threads: wall clock.",
    "memory": "The highest resident size of a process of its own.",
    "simulated": """The paper's move with the set-point law (28): CPU time, and the largest error in q at 1,001 samples
against the closed forms (31)–(40) integrated to 1e-13.""",
    "accuracy": "The worst of all samples.",
    "certificates": "What is proved of σ over a region, in shares that sum to 100 %; CPU time, taken once.",
    "atlas": "Certified maps, squares, balls and paths; CPU time, taken once.",
    "load": "A file read, checked, closed and analysed.",
    "lanes": "Programs in lanes of vectors, by the system's C compiler, beside one call of the peer.",
    "walks": "What a walk of ccpin's own passes through.",
}
WORDS = {True: "met", False: "**missed**"}


def page(figures: Sequence[Measured], machine: Mapping[str, str]) -> str:
    """The whole page."""
    where = "\n".join(f"| {key} | {value} |" for key, value in machine.items())
    parts = dict.fromkeys(each.part for each in figures)
    blocks = [
        HEAD,
        f"## Where and when\n\n| | |\n| --- | --- |\n{where}\n",
        _targets(verdicts(figures)),
        *(_part(part, [each for each in figures if each.part == part]) for part in parts),
    ]
    return "\n".join(blocks)


def _targets(found: Sequence[Verdict]) -> str:
    measured = [each for each in found if each.met is not None]
    rows = "\n".join(_row(each, each.met) for each in measured if each.met is not None)
    missed = [f"- {each.target.what}: {each.where}" for each in measured if not each.met]
    said = "\n".join(["What misses its target here:\n", *missed]) if missed else "Nothing misses its target here."
    absent = [each.target.what for each in found if each.met is None]
    if absent:
        said += f"\n\nNot measured: {'; '.join(absent)}."
    head = "| what | target | the worst | of | |\n| --- | --- | --- | --- | --- |"
    return f"## Targets\n\n{said}\n\n{head}\n{rows}\n"


def _row(verdict: Verdict, met: bool) -> str:
    target = verdict.target
    sign = "≥" if target.least else "≤"
    return f"| {target.what} | {sign} {target.limit:g} | {verdict.found} | {verdict.where} | {WORDS[met]} |"


def _part(part: str, figures: Sequence[Measured]) -> str:
    said = "".join(f"\n- {note}" for note in notes(figures))
    return f"## {part}\n\n{EXPLAINED[part]}\n\n{markdown(figures)}\n" + (f"{said}\n" if said else "")
