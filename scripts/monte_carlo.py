"""The paper's first move (Section IV-B) where the robot is not the one the law was made for: a Monte Carlo study.

Every link's mass and inertia, the rotors and each joint's friction are drawn within ±20 % of what scripts/hardware.py
takes (a Latin hypercube); the PD law with simple gravity compensation (28) knows the nominal robot only. Writes the
rows, the table and a figure to out/monte_carlo and prints a summary; killed, it goes on where it was.
"""

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from tqdm import tqdm

import ccpin
from ccpin import plotting, sweep
from ccpin.control import PDSimpleGravity
from ccpin.description import scaled
from ccpin.simulation import latin_hypercube, set_point_metrics

OUT = Path("out/monte_carlo")
START, GOAL = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])  # the paper's first move
K_P, K_V = [11.0, 11.0], [0.65, 0.60]  # N m/rad and N m s/rad, the paper's
FRICTION = {"joint1": (0.2, 0.02), "joint2": (0.2, 0.02), "joint3": (0.02, 0.002), "joint4": (0.02, 0.002)}
LINKS = ("link1", "link2", "link3", "link4")
SPREAD = 0.2  # of each number, to both sides
CASES = 256  # robots
DURATION = 1.0  # s
SAMPLES = 51  # along a motion, for the picture
BAND = np.radians(2.0)


def move(case: dict[str, float], nominal: ccpin.ReducedModel) -> dict[str, object]:
    """One robot's move: set-point metrics, and its motion in degrees."""
    masses = {link: case[f"mass_{link}"] for link in LINKS}
    description = scaled(nominal.mechanism.settled(), masses=masses, armature=case["rotors"])
    robot = ccpin.ReducedModel(ccpin.load(description))
    friction = {joint: tuple(np.multiply(case[f"friction_{joint}"], pair)) for joint, pair in FRICTION.items()}
    law = PDSimpleGravity(nominal, GOAL, K_P, K_V)
    period = DURATION / (SAMPLES - 1)
    motion = ccpin.simulate(
        robot, law, START, duration=DURATION, friction=friction, rtol=1e-7, atol=1e-9, sample_period=period / 10
    )
    found = set_point_metrics(motion, robot, GOAL, BAND).as_json()
    degrees = np.degrees(motion.q[::10])
    return found | {"status": motion.status, "q1": degrees[:, 0].tolist(), "q2": degrees[:, 1].tolist()}


def draw(study) -> Figure:
    """Motions as bands, and what spreads: settling time, overshoot and the error that friction leaves."""
    rows = [row for row in study.results if row is not None]
    with rc_context(plotting.STYLE):
        figure = Figure(figsize=(11, 7), layout="constrained")
        figure.suptitle(f"RPDR, the paper's move on {len(rows)} robots within ±{100 * SPREAD:.0f} %")
        panels = figure.subplots(2, 2)
        t = np.linspace(0.0, DURATION, SAMPLES)
        for panel, name, goal, colour in zip(panels[0], ("q1", "q2"), np.degrees(GOAL), plotting.COLOURS, strict=False):
            low, *_, high = bands = np.percentile([row[name] for row in rows], [0, 5, 50, 95, 100], axis=0)
            panel.fill_between(t, low, high, color=colour, alpha=0.18, linewidth=0, label="all")
            panel.fill_between(t, bands[1], bands[3], color=colour, alpha=0.35, linewidth=0, label="5 % to 95 %")
            panel.plot(t, bands[2], color=colour, linewidth=1.6, label="median")
            panel.axhline(goal, linestyle="--", color="0.35", linewidth=1.0, label="goal")
            panel.set(xlabel="time [s]", ylabel=f"{name} [°]")
            panel.legend(loc="lower right", framealpha=0.85, edgecolor="none")
        settling = [1e3 * row["settling_time"] for row in rows if row["settling_time"] is not None]
        step = 1e3 * DURATION / (SAMPLES - 1) / 10
        panels[1, 0].hist(
            settling, np.arange(min(settling) - step / 2, max(settling) + step, step), color=plotting.COLOURS[2]
        )
        panels[1, 0].set(xlabel=f"within ±{np.degrees(BAND):.0f}° from [ms] on", ylabel="robots")
        error = np.degrees([row["steady_state_error"] for row in rows])
        for k, colour in enumerate(plotting.COLOURS[:2]):
            friction = [
                case[f"friction_joint{k + 1}"] for case, row in zip(study.cases, study.results, strict=True) if row
            ]
            panels[1, 1].plot(friction, error[:, k], ".", color=colour, label=f"joint{k + 1}")
        panels[1, 1].set(xlabel="friction of the joint, of nominal", ylabel="left at the end [°]")
        panels[1, 1].legend(loc="best", framealpha=0.85, edgecolor="none")
    return figure


def main(out: Path = OUT, count: int = CASES, workers: int | None = 2) -> None:
    """Run what is missing of the study, write it and tell what spreads."""
    nominal = ccpin.ReducedModel(ccpin.load("rpdr"))
    names = [*(f"mass_{link}" for link in LINKS), "rotors", *(f"friction_{joint}" for joint in FRICTION)]
    cases = latin_hypercube(dict.fromkeys(names, (1 - SPREAD, 1 + SPREAD)), count, seed=1)
    task = partial(move, nominal=nominal)
    with tqdm(total=count, unit="robot") as bar:
        study = sweep(
            task,
            cases,
            workers=workers,
            path=out / "rows.jsonl",
            name="move",
            progress=lambda p: bar.update(p.done - bar.n),
        )
    study.save(out / "table.csv")
    plotting.save(draw(study), out / "monte_carlo.png")
    table = study.table()
    settled = [time for time in table["settling_time"] if time is not None]
    print(f"RPDR, the paper's move on {count} robots within ±{100 * SPREAD:.0f} % of the nominal one: {study}")
    first, last = min(settled), max(settled)
    print(f"  within ±{np.degrees(BAND):.0f}°: {len(settled)} robots, from {first:.3f} s to {last:.3f} s on")
    for k in range(2):
        for word, told in (("overshoot", "overshoot"), ("steady_state_error", "left at the end")):
            found = np.degrees([x for x in table[f"{word}_{k}"] if x is not None])
            print(f"  joint{k + 1}: {told} {found.min():.2f}° to {found.max():.2f}°")
    print(f"  rows, table and figure in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
