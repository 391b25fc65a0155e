"""What is told of a cover of singular curves, as facts and in words."""

from __future__ import annotations

from typing import Any


def curve_facts(cover: Any) -> dict[str, Any]:
    """The facts, for JSON."""
    curves = [
        {"kind": curve.kind, "closed": curve.closed, "tubes": len(curve.radius), "error": float(curve.error.max())}
        for curve in cover.curves
    ]
    facts: dict[str, Any] = {"verdict": cover.verdict, "reason": cover.reason, "curves": curves}
    return facts | {"uncovered": len(cover.uncovered.lower), "complete": cover.complete}


def curves_in_words(facts: dict[str, Any]) -> str:
    """The same, in words."""
    lines = [f"{facts['verdict']}: {facts['reason']}"]
    for k, curve in enumerate(facts["curves"]):
        ends = "closed" if curve["closed"] else "open"
        lines.append(
            f"curve {k}: {curve['kind']}, {ends}, {curve['tubes']} tubes, known to {curve['error']:.1e} (rad or m)"
        )
    return "\n".join(lines)
