"""The RPDR's links for the largest certified square about (60°, 115°): arms and forearms as factors of those it has.

Each proposal's square is certified, so the answer is a theorem about that robot, whatever the search missed. Writes
the trials to out/design_rpdr.csv and prints the best.
"""

from pathlib import Path

import numpy as np

from ccpin import domain

OUT = Path("out")
CENTRE = np.radians([60.0, 115.0])
LINKS = {"arms": ("link1", "link2"), "forearms": ("link3", "link4")}
RANGES = {"arms": (0.7, 1.3), "forearms": (0.7, 1.3)}
EVALUATIONS = 60  # designs tried
RESOLUTION = 1e-3  # of the square's half width: fifty times coarser than by default, for sixty squares


def main(evaluations=EVALUATIONS, out=OUT):
    """Search, certify and tell."""
    build = domain.scaled_links("rpdr", LINKS)
    found = domain.design(build, RANGES, square, start={"arms": 1.0, "forearms": 1.0}, evaluations=evaluations)
    out.mkdir(parents=True, exist_ok=True)
    rows = [[*trial.dimensions.values(), np.degrees(trial.figure)] for trial in found.trials]
    np.savetxt(out / "design_rpdr.csv", rows, delimiter=",", header="arms,forearms,half width (deg)", comments="")
    print(f"as built      ±{np.degrees(found.trials[0].figure):.2f}°")
    print(f"best          ±{np.degrees(found.figure):.2f}°  {found.dimensions}  {found.certificate}")
    return found


def square(mechanism):
    """The largest certified square about the centre."""
    return domain.certify(mechanism, CENTRE, max_depth=0, resolution=RESOLUTION)


if __name__ == "__main__":
    main()
