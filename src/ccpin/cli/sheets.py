"""What is told of sheets, as facts and in words."""

from __future__ import annotations

from typing import Any

SHEET_SHARES = ("counted", "certified", "empty", "singular", "undecided")


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
