"""One offline page about an estimate: what was found, how sure, and what it explains of each log."""

from __future__ import annotations

from collections.abc import Sequence

from ccpin.dynamics.parameters import DynamicParameters
from ccpin.identification.estimates.estimate import Estimate
from ccpin.identification.estimates.explained_efforts import Explained
from ccpin.identification.estimates.residual_figures import efforts_figure, friction_figure, residuals_figure
from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import figure, paragraphs, table

_CHANGED = 1e-12  # SI units: less is a solver's rounding


def estimate_page(
    estimate: Estimate,
    chosen: DynamicParameters,
    logs: Sequence[tuple[str, Explained, Explained]],
) -> str:
    """The page as HTML.

    Args:
        estimate: What its logs tell.
        chosen: The constants that were taken.
        logs: Of each log its name, what the description explains of it, and what the constants do.
    """
    model, (used, left) = estimate.model, estimate.samples
    told = (
        f"{len(estimate.values)} combinations of constants from {used} samples; {left} more were left out, at which a "
        "joint may have stood. A combination cannot be told apart further by these motions and sensors: all constants "
        "with the same value of it move alike."
    )
    rows = [
        [f"`{name}`", f"{value:.5g}", f"{off:.2g}", f"{said:.5g}", unit, f"{abs(value - said) / off:.1f}"]
        for name, value, off, said, unit in zip(
            estimate.combinations, estimate.values, estimate.deviations, estimate.stated, estimate.units, strict=True
        )
    ]
    head = ["combination", "found", "standard deviation", "stated", "unit", "apart, in deviations"]
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
            f"{joint} {100 * b:.3g} % by the file's constants, {100 * a:.3g} % by those taken"
            for joint, b, a in zip(after.names, before.share, after.share, strict=True)
        )
        body = paragraphs(f"Residuals over measured efforts (root mean squares, outliers included): {shares}.")
        sections.append(
            Section(
                f"log{k}",
                f"Residuals of {name}",
                body
                + figure(
                    efforts_figure(before, after),
                    f"Efforts of {name}, N m or N: measured, and by the constants taken; right, residuals by the "
                    "file's constants (stated) and by those taken. What is more than twenty standard deviations off "
                    "runs out of the picture",
                )
                + figure(
                    residuals_figure(after),
                    f"Residuals of {name} by the constants taken, outliers drawn at five standard deviations. Left, "
                    "beside Gaussian noise of their median size; middle, the band that 95 % of white noise keeps "
                    "within: outside of it noise is coloured, or the model does not hold; right, where friction that "
                    "is neither viscous nor Coulomb's would show",
                ),
            )
        )
    if estimate.stribeck:
        sections.append(Section("friction", "Friction that falls with speed", _friction(estimate)))
    if estimate.motors.names:
        sections.append(Section("motors", "Motors", _motors(estimate)))
    if any(estimate.added):
        sections.append(Section("added", "What was added", _added(estimate)))
    sections.append(Section("held-out", "Held-out samples", _unseen(estimate)))
    sections.append(Section("clocks", "Clocks", _clocks(estimate)))
    sections.append(Section("noise", "Noise and outliers", _noise(estimate)))
    sections.append(Section("constants", "Constants taken", table(["constant", "stated", "taken", "unit"], constants)))
    return render(f"{model.mechanism.title}: from logs to constants", "Y π = ρᵀSᵀu, weighted least squares", sections)


def _friction(estimate: Estimate) -> str:
    """Levels and speeds of each joint that was asked for, and the curves of those of which they are told."""
    told = (
        "[c + (s − c) exp(−(v/v_s)²)] sign v: Coulomb level c, breakaway level s and Stribeck speed v_s, N m or N "
        "and rad/s or m/s, with standard deviations; 95 % of the profile likelihood of v_s; and by how much less is "
        "left of the efforts than with Coulomb's level alone, in squares of their deviations, beside what two "
        "constants have to explain for their place."
    )
    rows = []
    for each in estimate.stribeck:
        levels = [f"{x:.4g} ± {off:.2g}" for x, off in zip(each.values, each.deviations, strict=True)]
        between = f"{each.interval[0]:.4g} to {each.interval[1]:.4g}"
        gain = f"{each.gain:.4g} of {each.due:.3g}"
        rows.append([f"`{each.joint}`", *([*levels, between] if not each.reason else [""] * 4), gain, each.reason])
    body = paragraphs(told) + table(["joint", "c", "s", "v_s", "v_s between", "explains", "why none"], rows)
    found = [each for each in estimate.stribeck if not each.reason]
    if not found:
        return body
    words = "Dry friction against speed, N m or N and rad/s or m/s, ± two standard deviations; upright, where v_s is"
    return body + figure(friction_figure(found), words)


def _motors(estimate: Estimate) -> str:
    """Factors of motors' efforts."""
    told = (
        "k: the true effort over what the column says. The standard deviation includes that of the scale, which motors "
        "and constants share. Efforts above are true ones, by these k."
    )
    of_k = estimate.motors
    rows = [
        [f"`{name}`", f"{k:.5g}", f"{off:.2g}"]
        for name, k, off in zip(of_k.names, of_k.values, of_k.deviations, strict=True)
    ]
    return paragraphs(told) + table(["motor", "k", "standard deviation"], rows)


def _added(estimate: Estimate) -> str:
    """What was known to be more in some of the logs."""
    told = "By how much constants were larger in a log than those found here: as stated, taken as exact."
    unit = dict(zip(estimate.parameters.names, estimate.parameters.units, strict=True))
    rows = [
        [late.log, f"`{name}`", f"{value:.5g}", unit[name]]
        for late, load in zip(estimate.delays, estimate.added, strict=True)
        for name, value in load.items()
    ]
    return paragraphs(told) + table(["log", "constant", "added", "unit"], rows)


def _unseen(estimate: Estimate) -> str:
    """Cross-validation, a line a part."""
    told = (
        "Efforts of each part by constants found from all other samples: root mean squares of the residuals, of "
        "those by the file's constants, and of the measured efforts, N m or N, coordinate by coordinate."
    )
    rows = [
        [
            each.where,
            str(each.samples),
            *(", ".join(f"{x:.3g}" for x in sizes) for sizes in each[2:] if sizes is not None),
        ]
        for each in estimate.held_out
    ]
    head = ["held out", "samples", "residuals", "by the file's", "measured"]
    without = any(each.coulomb is not None for each in estimate.held_out)
    return paragraphs(told) + table([*head, *(["without Stribeck's friction"] if without else [])], rows)


def _clocks(estimate: Estimate) -> str:
    """How late efforts are."""
    rows = [
        [each.log, *(f"{1e3 * x:.3g}" for x in (each.seconds, each.deviation, each.taken))] for each in estimate.delays
    ]
    told = "By how much the efforts' stamps of time are later than the positions': what leaves the least residuals."
    return paragraphs(told) + table(["log", "late, ms", "standard deviation, ms", "set right by, ms"], rows)


def _noise(estimate: Estimate) -> str:
    told_of = zip(estimate.delays, estimate.motions, strict=True)
    rows = [[late.log, f"`{name}`", f"{x:.3g}"] for late, motion in told_of for name, x in motion.noise.items()]
    efforts = ", ".join(f"{level:.3g}" for level in estimate.effort_noise)
    outliers = [*estimate.outliers, *(each for motion in estimate.motions for each in motion.outliers)]
    named = [[each.log, f"`{each.column}`", f"{each.t:.6g}", f"{each.off:.1f}"] for each in outliers[:50]]
    body = paragraphs(f"Standard deviation of the residuals, coordinate by coordinate: {efforts} N m or N.")
    body += table(["log", "column", "standard deviation about the motion"], rows)
    told = f"Samples left out as outliers: {len(outliers)}" + (", the first of them:" if len(outliers) > 50 else ".")
    return body + paragraphs(told) + (table(["log", "column", "t, s", "deviations"], named) if named else "")
