"""Set-point and tracking laws side by side, on the RPDR and on a Delta: settling, overshoot, torque, cost a sample.

Each robot makes one move, commanded as a step to the PD laws and computed torque, and as a quintic reference to PD
with on-line gravity, PD+ and computed torque. Writes a figure, a table and its numbers to out/compare_laws.
"""

import json
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

import ccpin
from ccpin import plotting
from ccpin.control import (
    ComputedTorque,
    Hold,
    Measurement,
    PDFullGravity,
    PDOnlineGravity,
    PDPlus,
    PDSimpleGravity,
    PointToPoint,
)
from ccpin.files import write_atomically
from ccpin.plotting import COLOURS, STYLE
from ccpin.simulation import set_point_metrics

OUT = Path("out/compare_laws")
BAND = np.radians(2.0)
SAMPLE_PERIOD = 2e-3  # s
PASSES = 3  # of which the best is told: other work on the machine slows some
WIDTHS = (4.0, 1.6, 1.6, 1.6, 4.0, 1.6)  # wide where another law covers the curve


class Case(NamedTuple):
    """A robot, its move and its gains; K_p, K_v for the PD laws, ω (1/s) for computed torque: K_p = ω², K_v = 2ω."""

    robot: str
    start: np.ndarray
    goal: np.ndarray
    K_p: list[float]
    K_v: list[float]
    omega: float
    move: float
    duration: float


CASES = (
    Case("rpdr", np.radians([-150, -160]), np.radians([-90, -100]), [11.0] * 2, [0.65, 0.60], 20.0, 0.3, 0.8),
    Case("delta", np.array([-0.2, 0.1, 0.0]), np.array([0.4, -0.1, 0.3]), [300.0] * 3, [25.0] * 3, 20.0, 0.3, 0.8),
)


def laws(model, case):
    """Each law by its name in the table."""
    step, smooth = Hold(model, case.goal), PointToPoint(model, case.start, case.goal, case.move)
    gains = case.K_p, case.K_v
    poles = [case.omega**2] * model.n, [2 * case.omega] * model.n
    return {
        "PD, simple gravity (28), step": PDSimpleGravity(model, case.goal, *gains),
        "PD, full gravity (30), step": PDFullGravity(model, case.goal, *gains),
        "computed torque, step": ComputedTorque(model, step, *poles),
        "PD, on-line gravity, quintic": PDOnlineGravity(model, smooth, *gains),
        "PD+, quintic": PDPlus(model, smooth, *gains),
        "computed torque, quintic": ComputedTorque(model, smooth, *poles),
    }


def cost(law, motion):
    """Processor time of one torque in microseconds, σ warm-started from the sample before as a controller would.

    The median over the samples, in the best of three passes.
    """
    medians = []
    for _ in range(PASSES):
        taken = []
        for k in range(1, len(motion.t)):
            begin = time.thread_time_ns()
            law.torque(motion.t[k], Measurement(motion.q[k], motion.q_free[k - 1]), motion.v[k])
            taken.append(time.thread_time_ns() - begin)
        medians.append(1e-3 * float(np.median(taken)))
    return min(medians)


def tracking_error(law, motion):
    """Largest |q_d − q| along the move, radians; none for a step."""
    if isinstance(law, PDSimpleGravity | PDFullGravity) or isinstance(law.reference, Hold):
        return None
    return max(float(np.abs(law.error(t, q)).max()) for t, q in zip(motion.t, motion.q, strict=True))


def compare(case):
    """Simulate every law; returns motions and rows of the table."""
    model = ccpin.ReducedModel(ccpin.load(case.robot))
    motions, rows = {}, []
    for name, law in laws(model, case).items():
        motion = ccpin.simulate(
            model, law, case.start, duration=case.duration, rtol=1e-7, atol=1e-9, sample_period=SAMPLE_PERIOD
        )
        metrics = set_point_metrics(motion, model, case.goal, BAND).as_json()
        extra = {"tracking_error": tracking_error(law, motion), "cost_us": cost(law, motion)}
        rows.append({"robot": case.robot, "law": name, **metrics, **extra})
        motions[name] = motion
    return motions, rows


def table(rows):
    """The rows as text."""
    lines = [f"{'robot':6} {'law':30} {'settled s':>9} {'overshoot °':>11} {'peak N m':>8} {'error °':>8} {'µs':>6}"]
    for row in rows:
        settled = "–" if row["settling_time"] is None else f"{row['settling_time']:.3f}"
        error = "–" if row["tracking_error"] is None else f"{np.degrees(row['tracking_error']):.3f}"
        overshoot, peak = np.degrees(max(row["overshoot"])), max(row["peak_torque"])
        lines.append(
            f"{row['robot']:6} {row['law']:30} {settled:>9} {overshoot:11.2f} {peak:8.2f} {error:>8} "
            f"{row['cost_us']:6.1f}"
        )
    return "\n".join(lines)


def draw(results):
    """Distance from the goal and effort against time, one column a robot."""
    with rc_context(STYLE):
        figure = Figure(figsize=(11.0, 7.4), layout="constrained")
        axes = figure.subplots(2, len(CASES), sharex="col", squeeze=False)
        for column, (case, motions) in enumerate(zip(CASES, results, strict=True)):
            for k, (name, motion) in enumerate(motions.items()):
                style = {"color": COLOURS[k], "linestyle": "-" if "step" in name else "--", "linewidth": WIDTHS[k]}
                distance = np.degrees(np.abs(motion.q - case.goal).max(axis=1))
                axes[0, column].plot(motion.t, distance, label=name, **style)
                axes[1, column].plot(motion.t, np.abs(motion.u).max(axis=1), **style)
            axes[0, column].axhline(np.degrees(BAND), color="0.5", linewidth=0.8)
            axes[0, column].set_title({"rpdr": "RPDR", "delta": "Delta"}[case.robot])
            axes[0, column].set_ylabel("largest |q − goal| [°]")
            axes[1, column].set_ylabel("largest |u| [N m]")
            axes[1, column].set_yscale("log")
            axes[1, column].set_xlabel("time [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        figure.suptitle(f"One move, six laws (grey line: the ±{np.degrees(BAND):.0f}° band)")
    return figure


def main(out: Path = OUT) -> None:
    """Compare the laws on both robots and write figure, table and numbers."""
    results, rows = [], []
    for case in CASES:
        motions, its_rows = compare(case)
        results.append(motions)
        rows += its_rows
    text = table(rows)
    write_atomically(out / "table.txt", "w", lambda file: file.write(text + "\n"))
    write_atomically(out / "table.json", "w", lambda file: json.dump(rows, file, indent=2))
    plotting.save(draw(results), out / "laws.png")
    print(text)
    print(f"figure, table and numbers in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
