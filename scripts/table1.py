"""Table I: radii of σ's domain about the paper's four centres, by every certificate there is, and the exact ones.

The exact radius is that of the largest square about the centre on which the RPDR's closed-form σ exists and is
nonsingular: 0 < √(λ² + μ²) < a₃ + a₄, the distance of the elbows. Theorem 2's radius depends on the quadratic form,
which the paper does not state; the one used here is printed.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

import ccpin
from ccpin.domain import certify, kantorovich_radius, theorem2
from ccpin.files import write_atomically

OUT = Path("out/domain")
CENTRES = np.radians([[-108.0, -72.0], [-108.0, -48.0], [-108.0, -120.0], [-70.0, -110.0]])
PAPER = [3.5, 0.13, 1.7, 0.31]
ARM, FOREARMS, BASE = 0.2794, 0.6096, 0.3048
EDGE = np.linspace(-1.0, 1.0, 2001)


def elbows(q: np.ndarray) -> np.ndarray:
    """√(λ² + μ²): distance of the elbows, for q of shape (..., 2)."""
    first, second = np.moveaxis(q, -1, 0)
    return np.hypot(ARM * (np.cos(second) - np.cos(first)) + BASE, ARM * (np.sin(second) - np.sin(first)))


def exact_radius(centre: np.ndarray) -> float:
    """Half width of the largest square on which σ exists and is nonsingular, by bisection on its edges."""

    def slack(radius: float) -> float:
        edges = np.concatenate(
            [[(EDGE[k], s) for k in range(len(EDGE))] + [(s, EDGE[k]) for k in range(len(EDGE))] for s in (-1, 1)]
        )
        return float(FOREARMS - elbows(centre + radius * edges).max())

    isolated = np.arccos(BASE / 2 / ARM) * np.array([[1.0, -1.0], [-1.0, 1.0]]) + [[0.0, np.pi], [0.0, -np.pi]]
    apart = np.remainder(isolated - centre + np.pi, 2 * np.pi) - np.pi
    stretched = brentq(slack, 1e-6, np.pi) if slack(np.pi) < 0 else np.pi
    return float(min(stretched, np.abs(apart).max(axis=1).min()))


def main(out: Path = OUT) -> None:
    """Compute and print the table; write it as JSON."""
    mechanism = ccpin.load("rpdr")
    model = ccpin.ReducedModel(mechanism)
    rows = []
    print("centre             paper  Theorem 2   one box,   one box,     atlas      exact")
    print("                                         reach     planar")
    for centre, paper in zip(CENTRES, PAPER, strict=True):
        q_free = model.sigma(centre)
        theorem = theorem2(mechanism, q_free)
        radii = [
            theorem.radius,
            kantorovich_radius(mechanism, q_free),
            kantorovich_radius(mechanism, q_free, bounds="planar"),
            certify(mechanism, centre, guess=q_free, max_depth=0).radius,
            exact_radius(centre),
        ]
        values = np.degrees(radii)
        place = f"({np.degrees(centre[0]):.0f}°, {np.degrees(centre[1]):.0f}°)"
        shown = "  ".join(f"{value:8.4f}°" for value in values)
        print(f"{place:<16}  {paper:5.2f}°  {shown}")
        names = ("theorem2", "one_box_reach", "one_box_planar", "atlas", "exact")
        rows.append(
            {
                "centre_deg": np.degrees(centre).tolist(),
                "paper_deg": paper,
                **dict(zip(names, values.tolist(), strict=True)),
            }
        )
    print(f"Theorem 2 in the quadratic form: {theorem.description}")
    write_atomically(out / "table1.json", "w", lambda file: json.dump(rows, file, indent=2))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
