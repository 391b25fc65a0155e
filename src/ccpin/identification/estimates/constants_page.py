"""One offline page about an estimate: what was found, how sure, and what it explains of each log."""

from __future__ import annotations

from collections.abc import Sequence

from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.identification.estimates.estimation import Estimate
from ccpin.identification.estimates.explained_efforts import Explained
from ccpin.identification.estimates.residual_figures import efforts_figure, residuals_figure
from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import figure, paragraphs, table

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
        body = paragraphs(f"Left unexplained, of the measured root mean square, outliers included: {shares}.")
        sections.append(
            Section(
                f"log{k}",
                f"What is left of {name}",
                body
                + figure(
                    efforts_figure(before, after),
                    f"Efforts of {name} as measured and as told, N m or N; right, what is left of them",
                )
                + figure(
                    residuals_figure(after),
                    f"What the constants taken leave of {name}, outliers drawn at five standard deviations. Left, "
                    "beside Gaussian noise of its median size; middle, the band that 95 % of white noise keeps within: "
                    "what leaves it no constant explains, or noise hangs together; right, where friction that is "
                    "not Coulomb's and viscous would show",
                ),
            )
        )
    sections.append(Section("held-out", "What was not seen", _unseen(estimate)))
    sections.append(Section("clocks", "Clocks", _clocks(estimate)))
    sections.append(Section("noise", "Noise and outliers", _noise(estimate)))
    sections.append(Section("constants", "Constants taken", table(["constant", "stated", "taken", "unit"], constants)))
    return render(f"{model.mechanism.title}: from logs to constants", "Y π = ρᵀSᵀu, weighted least squares", sections)


def _unseen(estimate: Estimate) -> str:
    """Cross-validation, a line a part."""
    told = (
        "Each part was told by constants found from all other samples; root mean squares of what is missed, of what "
        "the file's constants miss, and of what was measured, N m or N, coordinate by coordinate."
    )
    rows = [
        [each.where, str(each.samples), *(", ".join(f"{x:.3g}" for x in sizes) for sizes in each[2:])]
        for each in estimate.held_out
    ]
    return paragraphs(told) + table(["held out", "samples", "missed", "by the file's", "measured"], rows)


def _clocks(estimate: Estimate) -> str:
    """How late efforts are."""
    rows = [
        [each.log, *(f"{1e3 * x:.3g}" for x in (each.seconds, each.deviation, each.taken))] for each in estimate.delays
    ]
    told = "By how much stamps of efforts are later than those of positions, by what leaves least of the efforts."
    return paragraphs(told) + table(["log", "late, ms", "standard deviation, ms", "set right by, ms"], rows)


def _noise(estimate: Estimate) -> str:
    rows = [[f"`{name}`", f"{level:.3g}"] for motion in estimate.motions for name, level in motion.noise.items()]
    efforts = ", ".join(f"{level:.3g}" for level in estimate.effort_noise)
    outliers = [*estimate.outliers, *(each for motion in estimate.motions for each in motion.outliers)]
    named = [[f"`{each.column}`", f"{each.t:.6g}", f"{each.off:.1f}"] for each in outliers[:50]]
    body = paragraphs(f"What is left of each generalised force has a standard deviation of {efforts} N m or N.")
    body += table(["column", "standard deviation about the motion"], rows)
    told = f"{len(outliers)} samples were left out as outliers" + (", the first 50 of them:" if named else ".")
    return body + paragraphs(told) + (table(["column", "t, s", "deviations"], named) if named else "")
