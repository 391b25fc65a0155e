"""The figure: ratios of each model, growth in joints, and what the paper's move costs for what accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.measured import DRAKE, LCABA, MUJOCO, NATIVE, NUMPY, PINOCCHIO, Measured
from benchmarks.parts import families, models, simulated

DPI = 200  # dots an inch: 3,000 wide, for screens of two dots a pixel
COLOURS = {
    NATIVE: "#c2410c",
    NUMPY: "#a8a29e",
    PINOCCHIO: "#1d4ed8",
    LCABA: "#60a5fa",
    MUJOCO: "#15803d",
    DRAKE: "#7e22ce",
}
BARS = (  # quantity, who, label, hatch
    (models.ACCELERATION, NATIVE, "ccpin, q̈", ""),
    (models.TERMS, NATIVE, "ccpin, D C g", "//"),
    (models.SIGMA, NATIVE, "ccpin, σ", ".."),
    (models.ACCELERATION, LCABA, "lcaba", ""),
    (models.ACCELERATION, MUJOCO, "MuJoCo, mj_forward", ""),
    (models.STEP, DRAKE, "Drake, a step", ""),
)
LINES = (  # quantity, who, label, marker
    (models.ACCELERATION, NATIVE, "ccpin, q̈", "o-"),
    (models.SIGMA, NATIVE, "ccpin, σ", "s--"),
    (models.TERMS, NATIVE, "ccpin, D C g", "^:"),
    (models.ACCELERATION, LCABA, "lcaba", "o-"),
    (models.ACCELERATION, MUJOCO, "MuJoCo", "o-"),
    (models.ACCELERATION, PINOCCHIO, "constraintDynamics", "o-"),
)
SPOTS = {"": 8, "DOP853": -16, "NumPy": -16}  # points above (below) a point of the last panel, for its label


def draw(figures: Sequence[Measured], path: Path) -> None:
    """Write the picture; a part that was not measured leaves its panel empty."""
    picture = Figure(figsize=(15.0, 5.2), layout="constrained")
    bars, lines, points = picture.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
    _ratios(bars, figures)
    _growth(lines, figures)
    _move(points, figures)
    for axes in (bars, lines, points):
        axes.grid(alpha=0.25, which="major")
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    picture.savefig(path, dpi=DPI)


def _ratios(axes: Axes, figures: Sequence[Measured]) -> None:
    found = {each[1:4]: each.ratio for each in figures if each.part == models.PART and each.ratio is not None}
    names = list(dict.fromkeys(subject for subject, *_ in found))
    width = 0.8 / len(BARS)
    for k, (quantity, who, label, hatch) in enumerate(BARS):
        heights = [found.get((name, quantity, who)) for name in names]
        places = [i + (k - (len(BARS) - 1) / 2) * width for i in range(len(names))]
        drawn = [(x, height) for x, height in zip(places, heights, strict=True) if height is not None]
        if drawn:
            axes.bar(*zip(*drawn, strict=True), width, label=label, color=COLOURS[who], hatch=hatch, edgecolor="white")
    axes.axhline(1.0, color=COLOURS[PINOCCHIO], lw=1.5, label="constraintDynamics")
    axes.set_yscale("log")
    axes.set_yticks([0.2, 0.5, 1, 2, 5, 10, 20, 50], ["0.2", "0.5", "1", "2", "5", "10", "20", "50"])
    axes.minorticks_off()
    axes.set_ylim(0.2, 100.0)  # room for the legend
    axes.set_xticks(range(len(names)), names)
    axes.set_title("CPU time of one call, over Pinocchio's constraintDynamics")
    if names:
        axes.legend(ncols=2, fontsize="small", loc="upper right")


def _growth(axes: Axes, figures: Sequence[Measured]) -> None:
    mine = [each for each in figures if each.part == families.PART and each.subject.startswith("serial")]
    for quantity, who, label, style in LINES:
        chosen = [each for each in mine if (each.quantity, each.who) == (quantity, who) and each.value is not None]
        name = families.EXPONENT.format(quantity)
        slope = next((each.value for each in mine if (each.quantity, each.who) == (name, who)), None)
        if chosen:
            joints = [int(each.subject.split()[1]) for each in chosen]
            power = "" if slope is None else f"  ~ joints$^{{{slope:.2f}}}$"
            axes.plot(
                joints, [1e6 * each.value for each in chosen], style, ms=4, color=COLOURS[who], label=label + power
            )
    axes.set(xscale="log", yscale="log", xlabel="joints", ylabel="µs")
    axes.set_title("Four-bars standing on one another")
    if mine:
        axes.legend(fontsize="small")


def _move(axes: Axes, figures: Sequence[Measured]) -> None:
    mine = {each[2:4]: each.value for each in figures if each.part == simulated.PART and each.value is not None}
    everyone = [who for quantity, who in mine if quantity == simulated.COST and (simulated.ERROR, who) in mine]
    for who in everyone:
        point = 1e3 * mine[simulated.COST, who], mine[simulated.ERROR, who]
        colour = next((colour for name, colour in COLOURS.items() if who.startswith(name)), "black")
        axes.plot(*point, "o", color=colour, ms=7)
        text = who.replace(NATIVE, "ccpin").replace(NUMPY, "ccpin on NumPy")
        where = SPOTS["DOP853" if "DOP853" in who else "NumPy" if who.startswith(NUMPY) else ""]
        axes.annotate(text, point, textcoords="offset points", fontsize="small", ha="center", xytext=(0, where))
    axes.set(xscale="log", yscale="log", xlabel="CPU time, ms", ylabel="largest error of q, rad")
    axes.margins(x=0.25, y=0.12)
    axes.set_title("The paper's move, one second, 1,001 samples")
