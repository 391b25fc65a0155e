"""Fig. 6: the RPDR's (q1, q2) square with both kinds of singularity and the region 𝒟 used for control.

Beyond the paper's figure, the serial singularities of the end effector (an arm stretched or folded) are drawn dashed.
"""

import sys
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting
from ccpin.domain import serial_singularities, singularities

OUT = Path("out/domain")
TIP = (0.3048, 0.0, 0.0)
REGION = np.radians([[-150.0, -160.0], [-90.0, -100.0]])


def main(out: Path = OUT) -> None:
    """Follow the singular curves and draw them."""
    mechanism = ccpin.load("rpdr")
    curves = singularities(mechanism) + serial_singularities(mechanism, "link3", TIP)
    region = (*REGION, r"$\mathcal{D}$")
    figure = plotting.plot_singularities(mechanism, curves, [region], "RPDR, singular configurations (Fig. 6)")
    plotting.save(figure, out / "fig6.png")
    for curve in curves:
        place = (
            f"{len(curve.q)} points" if curve.kind != "self-motion" else f"at q = {np.degrees(curve.q[0]).round(3)}°"
        )
        print(f"{curve.kind}: {place}, {'closed' if curve.closed else 'open'}")
    print(f"figure in {out}/")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
