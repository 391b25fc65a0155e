"""Experiment 2 of Section IV-B: back and forth between two corners, waiting 2.5 s at each (Fig. 10).

Writes the figure, data and metrics of every move to out/repetitive and prints a summary.
"""

import json
import sys
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting
from ccpin.files import write_atomically
from ccpin.simulation import set_point_metrics, supervise

OUT = Path("out/repetitive")
Q_I = np.radians([-150.0, -160.0])
Q_F = np.radians([-90.0, -100.0])
K_P = [11.0, 11.0]
K_V = [0.65, 0.60]
CYCLES = 2
WAIT = 2.5
BAND = np.radians(2.0)


def main(out: Path = OUT) -> None:
    """Simulate the cycles under a supervisor that switches q_d once the motion has settled and waited."""
    mechanism = ccpin.load("rpdr")
    model = ccpin.ReducedModel(mechanism)
    motion = supervise(
        model,
        lambda goal, q_free: ccpin.control.PDSimpleGravity(model, goal, K_P, K_V, q_free),
        Q_I,
        [Q_F, Q_I] * CYCLES,
        wait=WAIT,
    )
    trajectory = motion.trajectory
    metrics = [set_point_metrics(move.trajectory, model, move.goal, BAND) for move in motion.moves]
    goals = np.array([next(m.goal for m in motion.moves if t <= m.end) for t in trajectory.t])

    trajectory.save(out / "motion.csv")
    trajectory.save(out / "motion.npz")
    write_atomically(out / "metrics.json", "w", lambda file: json.dump([m.as_json() for m in metrics], file, indent=2))
    figure = plotting.plot_motion(trajectory, mechanism, goals, f"RPDR, {CYCLES} cycles (Fig. 10)")
    plotting.save(figure, out / "fig10.png")

    print(f"RPDR, repetitive motion: {trajectory.t[-1]:.2f} s, {len(motion.moves)} moves")
    for move, metric in zip(motion.moves, metrics, strict=True):
        print(
            f"  to {np.degrees(move.goal).round(0)}° at {move.start:6.2f} s: within ±{np.degrees(BAND):.0f}° "
            f"after {metric.settling_time:.3f} s, peak torque {metric.peak_torque.round(2)} N m"
        )
    print(f"  figure and data in {out}/")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
