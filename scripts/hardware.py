"""Experiment 1 of Section IV-B as the hardware ran it: joint friction, encoders, filter, a sampled law (Fig. 9).

The paper's gains and poses; it gives no figures for friction and electronics, so these are plausible ones for such
a robot. Writes the figures, data and metrics to out/hardware and prints a summary.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting
from ccpin.control import CoulombCompensation, Sampling
from ccpin.files import write_atomically
from ccpin.simulation import set_point_metrics

OUT = Path("out/hardware")
Q_START = np.radians([-150.0, -160.0])
Q_GOAL = np.radians([-90.0, -100.0])
K_P = [11.0, 11.0]
K_V = [0.65, 0.60]
DURATION = 1.0
BAND = np.radians(2.0)
FRICTION = {"joint1": (0.2, 0.02), "joint2": (0.2, 0.02), "joint3": (0.02, 0.002), "joint4": (0.02, 0.002)}
ESTIMATE = 0.16  # Coulomb friction of a motor's joint as the controller knows it, N m
WIDTH = 0.02  # where compensation by the error fades out, rad
SAMPLING = Sampling(1e-3, encoder_counts=4096, velocity_cutoff=100.0, saturation=12.0, delay=1)
BENCH = {"friction": FRICTION, "sampling": SAMPLING}


def main(out: Path = OUT) -> None:
    """Run the motion on the ideal robot and on the bench, with and without friction compensation."""
    mechanism = ccpin.load("rpdr")
    model = ccpin.ReducedModel(mechanism)
    law = ccpin.control.PDSimpleGravity(model, Q_GOAL, K_P, K_V)
    towards_goal = CoulombCompensation(law, ESTIMATE, Q_START)
    by_error = CoulombCompensation(law, ESTIMATE, width=WIDTH)
    runs = {
        "ideal": (law, {}),
        "bench": (law, BENCH),
        "bench_towards_goal": (towards_goal, BENCH),
        "bench_by_error": (by_error, BENCH),
    }
    metrics = {}
    print(f"RPDR, point to point with the bench on: friction {FRICTION}, {SAMPLING}")
    for name, (controller, bench) in runs.items():
        began = time.process_time()
        motion = ccpin.simulate(model, controller, Q_START, duration=DURATION, **bench)
        cost = (time.process_time() - began) / DURATION
        metrics[name] = set_point_metrics(motion, model, Q_GOAL, BAND).as_json()
        motion.save(out / f"{name}.csv")
        title = f"RPDR, point to point (Fig. 9): {name.replace('_', ' ')}"
        plotting.save(plotting.plot_motion(motion, mechanism, Q_GOAL, title), out / f"fig9_{name}.png")
        settled = metrics[name]["settling_time"]
        print(
            f"  {name:18s} "
            + ("not within the band" if settled is None else f"within ±{np.degrees(BAND):.0f}° from {settled:.3f} s on")
            + f", overshoot {np.degrees(metrics[name]['overshoot']).round(1)}°"
            + f", left at the end {np.degrees(metrics[name]['steady_state_error']).round(2)}°"
            + f", {cost:.1f} s of CPU a simulated second"
        )
    write_atomically(out / "metrics.json", "w", lambda file: json.dump(metrics, file, indent=2))
    print(f"  friction alone explains up to {np.degrees(FRICTION['joint1'][0] / K_P[0]):.2f}° (Coulomb level / K_p)")
    print(f"  figures and data in {out}/")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
