"""`ccpin simulate`: set-point motions, once or in cycles, with their figures and data."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import shtab

from ccpin.arrays import Array
from ccpin.cli.command import INTERRUPTED, add_command, complete, count, nonnegative, positive
from ccpin.cli.laws import add_law, law_of
from ccpin.cli.options import add_bench, add_mechanism, add_vector, bench_settings, load, vector
from ccpin.cli.progress import busy
from ccpin.cli.reaching import explained
from ccpin.control import ControlLaw
from ccpin.dynamics.drives import HELD
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.files import write_atomically
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation import Settling, exceeded, supervise
from ccpin.simulation.integration.simulator import METHODS, Simulator
from ccpin.simulation.results.limit_violations import at_effort_limits, shares_in_words
from ccpin.simulation.results.metrics import band_in_words, set_point_metrics
from ccpin.simulation.results.trajectory import Trajectory
from ccpin.simulation.studies.supervision import SupervisedMotion

_EXAMPLES = """\
example: ccpin simulate rpdr --goal-deg -90 -100 --out out
         ccpin simulate rpdr --start-deg -150 -160 --goal-deg -90 -100 --kp 11 --kv 0.65 0.60 --cycles 1 --wait 0.1"""


def add_simulate(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "simulate", _EXAMPLES, _simulate)
    add_mechanism(parser)
    add_vector(parser, "start", "where the motion starts at rest (default: the reference)")
    add_vector(parser, "goal", "the set point (default: the start)")
    add_law(parser)
    parser.add_argument("--duration", type=positive, default=1.0, metavar="S", help="seconds (default 1)")
    parser.add_argument("--cycles", type=count, metavar="N", help="go to the goal and back N times")
    parser.add_argument("--wait", type=nonnegative, default=2.5, metavar="S", help="wait at each end of a cycle")
    parser.add_argument("--settle-deg", type=positive, default=1.0, metavar="DEG", help="a cycle's band of arrival")
    parser.add_argument("--settle-speed", type=positive, default=0.01, metavar="V", help="and its speed, rad/s or m/s")
    parser.add_argument("--band-deg", type=positive, default=2.0, metavar="DEG", help="band of the settling time")
    parser.add_argument("--method", choices=METHODS, default="RK45", help="SciPy's integrator")
    parser.add_argument("--rtol", type=positive, default=1e-9, help="relative tolerance (default 1e-9)")
    parser.add_argument("--atol", type=positive, default=1e-11, help="absolute tolerance (default 1e-11)")
    written = "write figures, CSV, npz, metrics and animation there"
    complete(parser.add_argument("--out", type=Path, metavar="DIR", help=written), shtab.DIRECTORY)
    add_bench(parser)


def _simulate(options: argparse.Namespace) -> int:
    mechanism = load(options)
    model = ReducedModel(mechanism)
    with explained(options, model, options.goal_deg is not None or options.start_deg is not None):
        return _moved(options, mechanism, model)


def _moved(options: argparse.Namespace, mechanism: Mechanism, model: ReducedModel) -> int:
    start, goal = vector(options, "start", mechanism), vector(options, "goal", mechanism)
    start = model.alpha(mechanism.q_reference) if start is None else start
    goal = start if goal is None else goal
    settings = {"method": options.method, "rtol": options.rtol, "atol": options.atol} | bench_settings(options, model)
    if options.cycles is None:
        law = law_of(model, options, goal, model.sigma(start))
        simulator, until = Simulator(model, law, **settings), options.duration
        simulator.reset(start)
        with busy(options.json, "simulating", lambda: simulator.t / until):
            trajectory = simulator.run(until)
        moves = [(goal, trajectory)]
        goals = np.broadcast_to(goal, trajectory.q.shape)
    else:
        motion = _cycles(model, options, start, goal, settings)
        trajectory, moves = motion.trajectory, [(move.goal, move.trajectory) for move in motion.moves]
        ends = np.array([move.end for move in motion.moves])
        goals = np.array([move.goal for move in motion.moves])[np.searchsorted(ends[:-1], trajectory.t)]
    band = np.radians(options.band_deg)
    metrics = [set_point_metrics(part, model, target, band).as_json() for target, part in moves]
    result = {name: getattr(trajectory, name) for name in ("status", "message", "evaluations")} | {"moves": metrics}
    result["notes"] = list(trajectory.notes)
    result["exceeded"] = [one._asdict() for one in exceeded(model, trajectory)]
    if options.out is not None:
        with busy(options.json, "drawing"):
            _write(options.out, mechanism, trajectory, goals, result)
    print(
        json.dumps(result, indent=2) if options.json else _motion_in_words(mechanism, trajectory, result, options.out)
    )
    if trajectory.status == "interrupted":
        return INTERRUPTED
    return 0 if trajectory.status in ("finished", "settled") else 1


def _cycles(
    model: ReducedModel, options: argparse.Namespace, start: Array, goal: Array, settings: dict[str, Any]
) -> SupervisedMotion:
    goals: list[Array] = [goal, start] * options.cycles
    begun: list[Array] = []

    def law_to(target: Array, q_free: Array) -> ControlLaw:
        begun.append(target)
        return law_of(model, options, target, q_free)

    with busy(options.json, "simulating", lambda: (len(begun) - 1) / len(goals)):
        return supervise(
            model,
            law_to,
            start,
            goals,
            wait=options.wait,
            settling=Settling(goal, band=np.radians(options.settle_deg), speed=options.settle_speed),
            **settings,
        )


def _write(out: Path, mechanism: Mechanism, trajectory: Trajectory, goals: Array, result: dict[str, Any]) -> None:
    """The motion, as text and in pictures too unless whoever pressed Ctrl-C waits."""
    trajectory.save(out / "motion.npz")
    write_atomically(out / "metrics.json", "w", lambda file: json.dump(result, file, indent=2))
    if trajectory.status == "interrupted":
        return
    from ccpin import plotting, visualization

    trajectory.save(out / "motion.csv")
    plotting.save(plotting.plot_motion(trajectory, mechanism, goals), out / "motion.png")
    ends = [trajectory.q_free[0], trajectory.q_free[-1]]
    plotting.save(plotting.plot_configurations(mechanism, ends, ["start", "end"]), out / "configurations.png")
    visualization.animate(mechanism, trajectory.t, trajectory.q_free, out / "animation.html")


def _motion_in_words(mechanism: Mechanism, trajectory: Trajectory, result: dict[str, Any], out: Path | None) -> str:
    cut = shares_in_words(at_effort_limits(mechanism, trajectory.u))
    lines = [note for note in trajectory.notes if HELD in note]
    lines += [f"efforts at their limits: {cut} of the samples (--effort-limits ignore leaves them out)"] if cut else []
    lines += [
        f"{one['quantity']} of {one['joint']} beyond {one['limit']:.4g}: {one['extreme']:.4g}"
        for one in result["exceeded"]
    ]
    lines += [
        f"{mechanism.name}: {trajectory.status}, {trajectory.message} ({trajectory.evaluations} evaluations)",
        f"largest closure error {trajectory.closure_error.max():.1e}",
    ]
    for k, metric in enumerate(result["moves"], start=1):
        settled, band, off = metric["settling_time"], band_in_words(mechanism, metric["band"]), _off(mechanism, metric)
        lines.append(
            f"move {k}: "
            + (f"not within ±{band}" if settled is None else f"within ±{band} from {settled:.3f} s on")
            + f", {off} off at the end, peak effort {np.round(metric['peak_torque'], 3).tolist()}"
        )
    lines += [f"note: {note}" for note in trajectory.notes if note.startswith("stepped in Python")]
    if out is not None:
        pictures = "figures, data and animation" if trajectory.status != "interrupted" else "what was computed is"
        lines.append(f"{pictures} in {out}/")
    return "\n".join(lines)


def _off(mechanism: Mechanism, metric: dict[str, Any]) -> str:
    """How far off each coordinate is at a move's end: angles in degrees, lengths in millimetres."""
    slides = [slide for part in mechanism.parametrization().coordinates.parts for slide in part.slides]
    units = [(1e3, " mm") if slide else (np.degrees(1.0), "°") for slide in slides]
    errors = zip(metric["steady_state_error"], units, strict=True)
    off = [f"{scale * error:.2f}{unit}" for error, (scale, unit) in errors]
    return " and ".join(filter(None, [", ".join(off[:-1]), *off[-1:]]))
