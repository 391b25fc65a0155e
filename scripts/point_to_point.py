"""Experiment 1 of Section IV-B: the RPDR from one corner of its region to the opposite one (Figs. 8 and 9).

Writes figures, data, metrics and an animation to out/point_to_point and prints a summary.
"""

import json
from pathlib import Path

import numpy as np

from ccpin import paper, plotting, visualization
from ccpin.files import write_atomically
from ccpin.simulation import lyapunov_along, set_point_metrics

OUT = Path("out/point_to_point")
BAND = np.radians(2.0)


def main(out: Path = OUT) -> None:
    """Simulate the motion under PD with simple gravity compensation (28) and write everything there is to see."""
    study = paper.Study()
    trajectory = study.ideal
    metrics = set_point_metrics(trajectory, study.model, study.goal, BAND)
    trajectory.save(out / "motion.csv")
    trajectory.save(out / "motion.npz")
    write_atomically(out / "metrics.json", "w", lambda file: json.dump(metrics.as_json(), file, indent=2))
    for item in (paper.figure8(study), paper.figure9(study)):
        for drawing in item.drawings:
            plotting.save(drawing.figure, out / f"{drawing.name}.png")
    drawn = {"title": "RPDR, point to point", "trace": "end_effector"}
    visualization.animate(study.mechanism, trajectory.t, trajectory.q_free, out / "animation.html", **drawn)

    history = lyapunov_along(study.law, trajectory)
    print(f"RPDR, point to point: {trajectory.message} in {trajectory.evaluations} evaluations")
    print(f"  within ±{np.degrees(BAND):.0f}° of the goal from {metrics.settling_time:.3f} s on")
    print(f"  overshoot {np.degrees(metrics.overshoot).round(2)}°, peak torque {metrics.peak_torque.round(2)} N m")
    print(f"  largest closure error {metrics.largest_closure_error:.1e}")
    print(f"  Lyapunov function from {history.V[0]:.2f} J, largest increase {np.diff(history.V).max():.1e} J")
    print(f"  figures, data and animation in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
