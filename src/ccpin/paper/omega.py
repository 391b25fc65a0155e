"""Section II on the domain Ω: Theorem 2 with its worked example, Table I, Figs. 6 and 7, and the region 𝒟."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ccpin.domain import certify, singularities, theorem2
from ccpin.domain.theorem2.polynomials import Polynomial, QuadraticSystem
from ccpin.paper import printed
from ccpin.paper.extremes import extremes_figure, singular_figure
from ccpin.paper.item import Drawing, Item, apart, place
from ccpin.paper.study import CENTRES, GOAL, RADII, START, Study

_CORNERS = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])  # of a square
EXAMPLE_V = np.array([2.0, 2.0, 4.0, 2.0, 2.0, 8.0])
"""The worked example's v; its largest entry is c."""
ISOLATED = (56.944, 123.056)
"""Where the elbows meet, degrees, as printed; minus it is the other."""


def items(study: Study) -> Iterator[Item]:
    """Theorem 2 and what the paper draws of Ω."""
    yield _example()
    yield table_one(study)
    yield figure6(study)
    yield figure7(study)
    yield _region(study)


def _example() -> Item:
    """Unknowns x, y, u, v, w, s and xu − 1, xv − 2y, u² + v² − 1, x² − w, y² − s, sy − 3wy."""
    rows: tuple[dict[tuple[int, ...], float], ...] = (
        {(0, 2): 1.0, (): -1.0},
        {(0, 3): 1.0, (1,): -2.0},
        {(2, 2): 1.0, (3, 3): 1.0, (): -1.0},
        {(0, 0): 1.0, (4,): -1.0},
        {(1, 1): 1.0, (5,): -1.0},
        {(1, 5): 1.0, (1, 4): -3.0},
    )
    system = QuadraticSystem.from_polynomials("xyuvws", [Polynomial(row) for row in rows], free=1)
    return Item(
        "Theorem 2, example",
        "A system brought to degree two, and its c",
        "Unknowns (x, y, u, v, w, s), equations xu − 1, xv − 2y, u^2 + v^2 − 1, x^2 − w, y^2 − s, sy − 3wy with right "
        "side (0, 0, 0, 0, 0, r): v = (2, 2, 4, 2, 2, 8), c = 8.",
        "`QuadraticSystem.from_polynomials(…).v` and `.c`.",
        "all six entries of v",
        apart(system.v, EXAMPLE_V),
        "",
        0.0,
        "whole numbers",
        facts=(("v", ", ".join(f"{value:g}" for value in system.v)), ("c", f"{system.c:g}")),
    )


def table_one(study: Study) -> Item:
    """Table I: the printed radii beside every certificate and the exact radii."""
    found = study.radii
    head = ("centre (q_1, q_2)", "paper", "closest form", "Theorem 2", "one box", "one box, planar", "atlas", "exact")
    rows = [(place(one.centre), *(f"{value:.3f}°" for value in one[1:])) for one in found]
    return Item(
        "Table I",
        "Radii of squares that belong to Ω, by Theorem 2",
        "r = 3.5°, 0.13°, 1.7°, 0.31° about four centres. Which quadratic form gave them is not said; the sign of q_2 "
        "must be read negative.",
        "`ccpin.domain.theorem2`, `kantorovich_radius`, `certify`. The closest form we found to the printed radii is "
        "that of absolute link angles with unit scales: "
        + ", ".join(f"{one.closest:.2f}°" for one in found)
        + ". It is not the paper's: the ratios differ. Scaling the unknowns makes Theorem 2's radii larger, "
        "certificates in joint space larger still; an atlas reaches 99.9 % of the exact squares.",
        "by how much a printed radius exceeds what is proved by the atlas",
        max(0.0, *(one.paper - one.atlas for one in found)),
        "°",
        0.0,
        "every radius is a lower bound of the exact one, so no printed one may exceed it; the digits depend on a form "
        "the paper does not give",
        facts=tuple(
            (f"closest form / paper at {place(one.centre)}", f"{one.closest / one.paper:.2f}") for one in found
        ),
        rows=(head, *rows),
    )


def figure6(study: Study) -> Item:
    """Fig. 6: both kinds of singular configurations over the plane of (q1, q2), the region 𝒟, Table I's centres."""
    curves = singularities(study.mechanism)
    stretched = [curve.q for curve in curves if curve.kind == "fold"]
    points = np.degrees([curve.q[0] for curve in curves if curve.kind == "self-motion"])
    points = np.remainder(points + 180.0, 360.0) - 180.0
    printed_points = np.array([ISOLATED, (-ISOLATED[0], -ISOLATED[1])])
    ordered = points[np.argsort(-points[:, 0])]
    reach = float(printed.A[2] + printed.A[3])
    off = max(float(np.abs(printed.elbow_distance(q) - reach).max()) for q in stretched)
    drawn = singular_figure(study.mechanism, curves, (START, GOAL), CENTRES)
    return Item(
        "Fig. 6",
        "Singular configurations of the RPDR",
        "q_1 + q_3 − q_2 − q_4 = nπ: for odd n links 3 and 4 are stretched, on curves; for even n they lie on one "
        "another, at exactly two points, ±(56.944°, 123.056°), as a_1 = a_2 and a_3 = a_4. The region 𝒟 used for "
        "control contains none.",
        "`ccpin.domain.singularities` follows the curves of any mechanism with two coordinates; shaded is where the "
        "closed form has no σ, the elbows being further apart than a_3 + a_4.",
        "the isolated singularities",
        apart(ordered, printed_points),
        "°",
        5e-4,
        "half a unit of the last printed digit",
        facts=(
            ("isolated, n even", "; ".join(place(point, 4) for point in ordered)),
            ("distance of the elbows along the curves less a_3 + a_4, at most", f"{off:.1e} m"),
            ("curves, n odd", f"{len(stretched)}, of {sum(map(len, stretched))} points"),
        ),
        drawings=(Drawing("fig6", "Both kinds of singularity, 𝒟 and Table I's centres.", drawn),),
    )


def figure7(study: Study) -> Item:
    """Fig. 7: the robot at the centres of Table I and at the corners of the certified squares."""
    panels, worst = [], 0.0
    for centre, paper in zip(CENTRES, RADII, strict=True):
        q_free = study.model.sigma(centre)
        ours = theorem2(study.mechanism, q_free).radius
        poses = []
        for radius in (np.radians(paper), ours):
            corners = study.model.sigma_many(centre + radius * _CORNERS, q_free)
            poses.append(study.to_paper(corners))
            exact = [printed.sigma(q[:2]) for q in poses[-1]]
            turned = np.remainder(poses[-1] - exact + np.pi, 2 * np.pi) - np.pi
            worst = max(worst, float(np.abs(turned).max()))
        panels.append((centre, paper, float(np.degrees(ours)), study.to_paper(q_free), poses[0], poses[1]))
    return Item(
        "Fig. 7",
        "Extreme configurations of Ω",
        "The robot at the four corners of the squares that Theorem 2 certifies about Table I's centres.",
        "`model.sigma_many` at the corners of ours (solid) and of the paper's (dashed) squares; the inset shows the "
        "end effector in the paper's square.",
        "σ at the sixteen corners of either radius and the printed (39)–(40)",
        worst,
        "rad",
        1e-9,
        "an identity: both are σ on the branch that hangs down",
        drawings=(Drawing("fig7", "Centres and corners; radii ours against the paper's.", extremes_figure(panels)),),
    )


def _region(study: Study) -> Item:
    atlas = certify(study.mechanism, 0.5 * (START + GOAL), (START, GOAL))
    if not atlas.complete:  # Ctrl-C, at which a map ends with what it has
        raise KeyboardInterrupt
    share = atlas.certified_fraction
    return Item(
        "Region 𝒟",
        "−150° ≤ q_1 ≤ −90°, −160° ≤ q_2 ≤ −100° holds no singularity",
        "The region in which the experiments take place is free of singularities.",
        "`ccpin.domain.certify` covers it with boxes on each of which σ is proved to exist, to be unique on the "
        "branch and nonsingular.",
        "the part of 𝒟 that is not proved",
        1.0 - share,
        "",
        0.0,
        "a proof has no tolerance",
        facts=(("boxes", str(len(atlas.lower))), ("single-valued", "proved" if atlas.single_valued else "not proved")),
    )
