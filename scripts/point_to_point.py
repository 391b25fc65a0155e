"""Experiment 1 of Section IV-B: the RPDR from one corner of its region to the opposite one (Figs. 8 and 9).

Writes figures, data, metrics and an animation to out/point_to_point and prints a summary.
"""

import json
import sys
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting, visualization
from ccpin.files import write_atomically
from ccpin.simulation import set_point_metrics

OUT = Path("out/point_to_point")
Q_START = np.radians([-150.0, -160.0])
Q_GOAL = np.radians([-90.0, -100.0])
K_P = [11.0, 11.0]
K_V = [0.65, 0.60]
DURATION = 1.0
BAND = np.radians(2.0)


def main(out: Path = OUT) -> None:
    """Simulate the motion under PD with simple gravity compensation (28) and write everything there is to see."""
    mechanism = ccpin.load("rpdr")
    model = ccpin.ReducedModel(mechanism)
    law = ccpin.control.PDSimpleGravity(model, Q_GOAL, K_P, K_V)
    trajectory = ccpin.simulate(model, law, Q_START, duration=DURATION)
    metrics = set_point_metrics(trajectory, model, Q_GOAL, BAND)

    trajectory.save(out / "motion.csv")
    trajectory.save(out / "motion.npz")
    write_atomically(out / "metrics.json", "w", lambda file: json.dump(metrics.as_json(), file, indent=2))
    plotting.save(
        plotting.plot_motion(trajectory, mechanism, Q_GOAL, "RPDR, point to point (Fig. 9)"), out / "fig9.png"
    )
    ends = [trajectory.q_free[0], trajectory.q_free[-1]]
    figure = plotting.plot_configurations(mechanism, ends, ["start", "goal"], "RPDR, start and goal (Fig. 8)")
    plotting.save(figure, out / "fig8.png")
    drawn = {"title": "RPDR, point to point", "trace": "end_effector"}
    visualization.animate(mechanism, trajectory.t, trajectory.q_free, out / "animation.html", **drawn)

    lyapunov = [law.lyapunov(*state) for state in zip(trajectory.q, trajectory.v, trajectory.q_free, strict=True)]
    print(f"RPDR, point to point: {trajectory.message} in {trajectory.evaluations} evaluations")
    print(f"  within ±{np.degrees(BAND):.0f}° of the goal from {metrics.settling_time:.3f} s on")
    print(f"  overshoot {np.degrees(metrics.overshoot).round(2)}°, peak torque {metrics.peak_torque.round(2)} N m")
    print(f"  largest closure error {metrics.largest_closure_error:.1e}")
    print(f"  Lyapunov function from {lyapunov[0]:.2f} J, largest increase {np.diff(lyapunov).max():.1e} J")
    print(f"  figures, data and animation in {out}/")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
