"""What the compiled core is to reach, beside what was measured: met or missed.

A target that holds for several mechanisms is judged by the worst of them, which is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from benchmarks.measured import NATIVE, Measured
from benchmarks.parts import atlas, batches, families, models, simulated
from benchmarks.table import amount

Choice = Callable[[Measured], bool]


class Target(NamedTuple):
    """A limit on figures.

    Attributes:
        what: In words.
        limit: The largest value allowed; the smallest where `least`.
        figures: Which figures it is on.
        of_ratio: Whether the ratio counts rather than the value.
        least: Whether it is a lower limit.
    """

    what: str
    limit: float
    figures: Choice
    of_ratio: bool = False
    least: bool = False

    def value(self, figure: Measured) -> float | None:
        """The number that counts."""
        return figure.ratio if self.of_ratio else figure.value


class Verdict(NamedTuple):
    """A target beside its worst figure, and where it is missed, or met worst.

    `met` is ``None`` where nothing was measured.
    """

    target: Target
    met: bool | None
    found: str
    where: str


def _of(part: str, quantity: str, who: str = NATIVE, subject: str = "") -> Choice:
    def chosen(figure: Measured) -> bool:
        same = (figure.part, figure.quantity, figure.who) == (part, quantity, who)
        return same and figure.subject.startswith(subject)

    return chosen


def _growth(quantity: str, who: str = NATIVE) -> Choice:
    return _of(families.PART, families.EXPONENT.format(quantity), who)


RK45 = f"{NATIVE}, RK45"
TARGETS = (
    Target("q̈ at a known q′ / constraintDynamics", 0.6, _of(models.PART, models.ACCELERATION), True),
    Target("D, C, g / constraintDynamics", 1.3, _of(models.PART, models.TERMS), True),
    Target("σ from 1e-2 rad / constraintDynamics", 0.75, _of(models.PART, models.SIGMA), True),
    Target("∂q̈ / Pinocchio's derivatives", 2.0, _of(models.PART, models.DERIVATIVES), True),
    Target("a batch's row / a Python loop", 1.0, _of(batches.PART, batches.DYNAMICS), True),
    Target("a batch's row, RPDR / a Python loop", 0.5, _of(batches.PART, batches.DYNAMICS, NATIVE, "rpdr"), True),
    Target("two threads over one (of two free cores)", 1.6, _of(batches.PART, batches.THREADS), least=True),
    Target("exponent of σ", 1.15, _growth(models.SIGMA)),
    Target("exponent of q̈", 1.15, _growth(models.ACCELERATION)),
    Target("exponent of D, C, g", 1.35, _growth(models.TERMS)),
    Target("exponent of load", 1.5, _growth(families.LOAD, families.WHO)),
    Target("load of 64 loops", 1.0, lambda f: f.quantity == families.LOAD and f.subject.endswith(", 192 joints")),
    Target("the move, 1 s", 1e-2, _of(simulated.PART, simulated.COST, RK45)),
    Target("the move / MuJoCo RK4 at 1e-4", 0.1, _of(simulated.PART, simulated.COST, RK45), True),
    Target("the move's samples, core and NumPy", 1e-12, _of(simulated.PART, simulated.SAME, RK45)),
    Target("99.9 % of the RPDR's branch on the torus", 0.5, _of(atlas.PART, atlas.TO_SHARE, atlas.WHO)),
    Target("Delta, [−0.4, 0.7]³", 1.0, _of(atlas.PART, "map to depth 4", atlas.WHO, "delta")),
    Target("Delta's default map", 10.0, _of(atlas.PART, atlas.WHOLE, atlas.WHO)),
)


def verdicts(figures: Sequence[Measured]) -> list[Verdict]:
    """Every target beside its worst figure, and whether the move is more accurate than MuJoCo's."""
    return [*(_verdict(target, figures) for target in TARGETS), _more_accurate(figures)]


def checked(figures: Sequence[Measured]) -> str:
    """The verdicts as text."""
    words = {True: "met", False: "MISSED", None: "not measured"}
    lines = [
        f"{each.target.what:42}{'≥' if each.target.least else '≤'} {each.target.limit:<9.3g}"
        f"{words[each.met]:14}{each.found:12}{each.where}".rstrip()
        for each in verdicts(figures)
    ]
    return "\n".join(["== targets", *lines])


def _verdict(target: Target, figures: Sequence[Measured]) -> Verdict:
    chosen = [each for each in figures if target.figures(each) and target.value(each) is not None]
    if not chosen:
        return Verdict(target, None, "", "")
    worst = (min if target.least else max)(chosen, key=target.value)
    missed = [each for each in chosen if not _within(target, each)]
    where = ", ".join(f"{each.subject} {_number(target, each)}" for each in missed) or worst.subject
    return Verdict(target, not missed, _number(target, worst), where)


def _within(target: Target, figure: Measured) -> bool:
    value = target.value(figure)
    return value >= target.limit if target.least else value <= target.limit


def _number(target: Target, figure: Measured) -> str:
    return f"{figure.ratio:.2f}" if target.of_ratio else amount(figure.value, figure.unit)


def _more_accurate(figures: Sequence[Measured]) -> Verdict:
    """The error of the move over that of MuJoCo at its shorter step, a number below 1."""
    errors = {
        each.who: each.value for each in figures if (each.part, each.quantity) == (simulated.PART, simulated.ERROR)
    }
    target = Target("the move's error / MuJoCo RK4's at 1e-4", 1.0, lambda _: False)
    if RK45 not in errors or simulated.COMPARED not in errors:
        return Verdict(target, None, "", "")
    ratio = errors[RK45] / errors[simulated.COMPARED]
    return Verdict(target, ratio < 1.0, f"{ratio:.2f}", simulated.SUBJECT)
