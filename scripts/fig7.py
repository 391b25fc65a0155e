"""Fig. 7: the extreme configurations of Ω around the four centres of Table I.

Each drawing shows the RPDR at a centre and at the four corners of the square that Theorem 2 certifies around it.
"""

import sys
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting
from ccpin.domain import theorem2_radius

OUT = Path("out/domain")
CENTRES = np.radians([[-108.0, -72.0], [-108.0, -48.0], [-108.0, -120.0], [-70.0, -110.0]])
CORNERS = np.array([[0, 0], [-1, -1], [-1, 1], [1, -1], [1, 1]])
LABELS = ["centre", "(−, −)", "(−, +)", "(+, −)", "(+, +)"]


def main(out: Path = OUT) -> None:
    """Compute the radii and draw the corners."""
    mechanism = ccpin.load("rpdr")
    model = ccpin.ReducedModel(mechanism)
    panels = []
    for centre in CENTRES:
        q_free = model.sigma(centre)
        radius = theorem2_radius(mechanism, q_free)
        corners = model.sigma_many(centre + radius * CORNERS, q_free)
        first, second = np.degrees(centre)
        panels.append((f"({first:.0f}°, {second:.0f}°), r = {np.degrees(radius):.2f}°", corners))
        print(panels[-1][0])
    figure = plotting.plot_configuration_panels(mechanism, panels, LABELS, "RPDR, extreme configurations of Ω (Fig. 7)")
    plotting.save(figure, out / "fig7.png")
    print(f"figure in {out}/")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
