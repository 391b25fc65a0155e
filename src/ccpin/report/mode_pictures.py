"""The assembly modes over the reference's independent coordinates."""

from __future__ import annotations

from ccpin.dynamics import assembly_modes
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.pages.parts import figure, paragraphs, table
from ccpin.plotting.motion import plot_configuration_panels
from ccpin.report.settings import ReportSettings

_DRAWN = 4  # modes in the picture, at most
_SIGNS = {1: "> 0", -1: "< 0", 0: "redundant rows"}


def modes(model: ReducedModel, settings: ReportSettings) -> str:
    """The section as HTML."""
    mechanism = model.mechanism
    found = assembly_modes(model, model.alpha(mechanism.q_reference), budget=settings.modes_budget)
    count = len(found.modes)
    words = [
        f"{count} assembly mode{'' if count == 1 else 's'} found over the reference's independent coordinates: "
        f"{found.reason}. They are sampled; nothing proves that there are no more."
    ]
    if found.singular:
        words.append(f"{found.singular} starts ended at singular configurations, which belong to no mode.")
    rows = [
        (
            str(k) + (", the reference's" if mode.is_reference else ""),
            _SIGNS[mode.sign],
            f"{mode.rcond:.3g}",
            str(mode.hits),
            "yes" if mode.within_limits else "no",
        )
        for k, mode in enumerate(found.modes, start=1)
    ]
    drawn = found.modes[:_DRAWN]
    panels = [(f"mode {k}", [mode.q_free]) for k, mode in enumerate(drawn, start=1)]
    picture = (
        plot_configuration_panels(mechanism, panels, [mechanism.title], f"{mechanism.title}: assembly modes")
        if drawn
        else None
    )
    return (
        paragraphs(*words)
        + table(("mode", "det ψ_q′", "1/κ(ψ_q′)", "found from", "within limits"), rows)
        + (
            ""
            if picture is None
            else figure(picture, f"The first {len(drawn)} of them." if count > len(drawn) else "All.")
        )
    )
