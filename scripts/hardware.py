"""Experiment 1 of Section IV-B as the hardware ran it: joint friction, encoders, filter, a sampled law (Fig. 9).

The paper's gains and poses; it gives no figures for friction and electronics, so these are plausible ones for such
a robot. Writes the figures, data and metrics to out/hardware and prints a summary.
"""

import json
import time
from pathlib import Path

import numpy as np

import ccpin
from ccpin import paper, plotting
from ccpin.files import write_atomically
from ccpin.simulation import set_point_metrics

OUT = Path("out/hardware")
DURATION = 1.0  # s
BAND = np.radians(2.0)


def main(out: Path = OUT) -> None:
    """Run the motion on the ideal robot and on the bench, with and without friction compensation."""
    study = paper.Study()
    model, law = study.model, study.law
    runs = {
        "ideal": (law, {}),
        "bench": (law, study.bench_options),
        "bench_towards_goal": (study.towards_goal, study.bench_options),
        "bench_by_error": (study.by_error, study.bench_options),
    }
    metrics = {}
    friction = study.bench_options["friction"]
    print(f"RPDR, point to point with the bench on: friction {friction}, {study.bench_options['sampling']}")
    for name, (controller, bench) in runs.items():
        began = time.process_time()
        motion = ccpin.simulate(model, controller, study.start, duration=DURATION, **bench)
        cost = (time.process_time() - began) / DURATION
        metrics[name] = set_point_metrics(motion, model, study.goal, BAND).as_json()
        motion.save(out / f"{name}.csv")
        title = f"RPDR, point to point (Fig. 9): {name.replace('_', ' ')}"
        plotting.save(plotting.plot_motion(motion, model, study.goal, title), out / f"fig9_{name}.png")
        settled = metrics[name]["settling_time"]
        print(
            f"  {name:18s} "
            + ("not within the band" if settled is None else f"within ±{np.degrees(BAND):.0f}° from {settled:.3f} s on")
            + f", overshoot {np.degrees(metrics[name]['overshoot']).round(1)}°"
            + f", left at the end {np.degrees(metrics[name]['steady_state_error']).round(2)}°"
            + f", {cost:.1f} s of CPU a simulated second"
        )
    write_atomically(out / "metrics.json", "w", lambda file: json.dump(metrics, file, indent=2))
    print(
        "  friction alone explains up to "
        f"{np.degrees(friction['joint1'][0] / law.K_p[0, 0]):.2f}° (Coulomb level / K_p)"
    )
    print(f"  figures and data in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
