"""A certificate in a file, whatever kind it is of, and what is told of each kind: as facts, for JSON, and in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

SHEET_SHARES = ("counted", "certified", "empty", "singular", "undecided")


def document(path: Path) -> Any:
    """The atlas, the sheets or the cover of singular curves in a file.

    Raises:
        InvalidInputError: It is none.
    """
    from ccpin.containers import format_of
    from ccpin.domain import Atlas, SheetAtlas, SingularCover
    from ccpin.domain.documents.kinds import CURVES, SHEETS

    stated = format_of(path)
    for kind, document in ((SHEETS, SheetAtlas), (CURVES, SingularCover)):
        if stated == kind.schema.format:
            return document.load(path)
    return Atlas.load(path)


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


def sheet_facts(atlas: Any) -> dict[str, Any]:
    """The facts, for JSON."""
    facts: dict[str, Any] = {f"{share}_fraction": getattr(atlas, f"{share}_fraction") for share in SHEET_SHARES}
    sheets = [{"layers": s.layers, "boxes": len(s.boxes), "area": s.area, "sign": s.sign} for s in atlas.sheets]
    return facts | {
        "counts": sorted({int(k) for k in atlas.count if k >= 0}),
        "sheets": sheets,
        "complete": atlas.complete,
    }


def sheets_in_words(facts: dict[str, Any]) -> str:
    """The same, in words."""
    shares = ", ".join(f"{100 * facts[f'{share}_fraction']:.3f} % {share}" for share in SHEET_SHARES)
    numbers = ", ".join(str(count) for count in facts["counts"])
    lines = [f"{shares} of the region", f"assembly modes over one q, proved: {numbers or 'nowhere'}"]
    for k, sheet in enumerate(facts["sheets"]):
        told = f"sheet {k}: {sheet['boxes']} boxes, area {sheet['area']:.6g}, sign of det {sheet['sign']:+d}"
        lines.append(told + (f", {sheet['layers']} layers" if sheet["layers"] > 1 else ""))
    return "\n".join(lines + ([] if facts["complete"] else ["interrupted: what is listed is proved"]))
