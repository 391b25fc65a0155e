"""One offline page about an estimate: what was found, how sure, and what it explains of each log."""

from __future__ import annotations

from collections.abc import Sequence

from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.identification.estimation import Estimate
from ccpin.identification.explained_efforts import Explained
from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import figure, paragraphs, table
from ccpin.plotting.style import COLOURS, Figure, drawing

_CHANGED = 1e-12  # SI units: less is a solver's rounding


def estimate_page(
    model: ReducedModel,
    estimate: Estimate,
    chosen: DynamicParameters,
    logs: Sequence[tuple[str, Explained, Explained]],
) -> str:
    """The page as HTML.

    Args:
        model: The mechanism as it is described.
        estimate: What its logs tell.
        chosen: The constants that were taken.
        logs: Of each log its name, what the description explains of it, and what the constants do.
    """
    used, left = estimate.samples
    told = (
        f"{len(estimate.values)} combinations of constants from {used} samples; {left} more were left out, at which a "
        "joint may have stood. A combination cannot be told apart further by these motions and sensors: all constants "
        "with the same value of it move alike."
    )
    rows = [
        [f"`{name}`", f"{value:.5g}", f"{off:.2g}", f"{said:.5g}", f"{abs(value - said) / off:.1f}"]
        for name, value, off, said in zip(
            estimate.combinations, estimate.values, estimate.deviations, estimate.stated, strict=True
        )
    ]
    head = ["combination", "found", "standard deviation", "stated", "apart, in deviations"]
    constants = [
        [f"`{name}`", f"{said:.5g}", f"{value:.5g}", unit]
        for name, said, value, unit in zip(
            chosen.names, model.parameters.values, chosen.values, chosen.units, strict=True
        )
        if abs(value - said) > _CHANGED
    ]
    sections = [Section("found", "What the logs tell", paragraphs(told) + table(head, rows))]
    for k, (name, before, after) in enumerate(logs):
        shares = ", ".join(
            f"{joint} {100 * b:.3g} % before, {100 * a:.3g} % now"
            for joint, b, a in zip(after.names, before.share, after.share, strict=True)
        )
        body = paragraphs(f"Left unexplained, of the measured root mean square: {shares}.")
        sections.append(
            Section(
                f"log{k}",
                f"What is left of {name}",
                body
                + figure(
                    _left(before, after),
                    f"Efforts of {name} as measured and as told, N m or N; right, what is left of them",
                ),
            )
        )
    sections.append(Section("noise", "Noise and outliers", _noise(estimate)))
    sections.append(Section("constants", "Constants taken", table(["constant", "stated", "taken", "unit"], constants)))
    return render(f"{model.mechanism.title}: from logs to constants", "Y π = ρᵀSᵀu, weighted least squares", sections)


def _left(before: Explained, after: Explained) -> Figure:
    """Measured and told efforts of each coordinate, and below them what is left."""
    n = len(after.names)
    with drawing("", (9.0, 2.6 * n)) as drawn:
        panels = drawn.subplots(n, 2, squeeze=False, sharex=True)
        for k, name in enumerate(after.names):
            left, right = panels[k]
            left.plot(after.t, after.measured[:, k], color=COLOURS[0], linewidth=0.8, label="measured")
            left.plot(after.t, after.told[:, k], color=COLOURS[1], linewidth=1.2, label="told")
            left.set(ylabel=f"effort at {name}")
            right.plot(before.t, (before.measured - before.told)[:, k], color=COLOURS[2], linewidth=0.6, label="stated")
            right.plot(after.t, (after.measured - after.told)[:, k], color=COLOURS[1], linewidth=0.6, label="taken")
            right.set(ylabel=f"left at {name}")
        for axes in panels[0]:
            axes.legend(loc="upper right", fontsize=8)
        for axes in panels[-1]:
            axes.set(xlabel="t [s]")
    return drawn


def _noise(estimate: Estimate) -> str:
    rows = [[f"`{name}`", f"{level:.3g}"] for motion in estimate.motions for name, level in motion.noise.items()]
    efforts = ", ".join(f"{level:.3g}" for level in estimate.effort_noise)
    outliers = [each for motion in estimate.motions for each in motion.outliers]
    named = [[f"`{each.column}`", f"{each.t:.6g}", f"{each.off:.1f}"] for each in outliers[:50]]
    body = paragraphs(f"What is left of each generalised force has a standard deviation of {efforts} N m or N.")
    body += table(["column", "standard deviation about the motion"], rows)
    told = f"{len(outliers)} samples were left out as outliers" + (", the first 50 of them:" if named else ".")
    return body + paragraphs(told) + (table(["column", "t, s", "deviations"], named) if named else "")
