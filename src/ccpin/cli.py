"""The command line: arguments to package calls, results to the terminal; no mathematics."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import ccpin
from ccpin.control import ControlLaw, NoTorque, PDFullGravity, PDSimpleGravity
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.files import write_atomically
from ccpin.mechanism import Mechanism
from ccpin.metrics import set_point_metrics
from ccpin.modes import assembly_modes
from ccpin.report import in_words, summary
from ccpin.simulation import METHODS, Settling
from ccpin.supervision import SupervisedMotion, supervise
from ccpin.trajectory import Trajectory, load_npz


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 1 a CcpinError, 2 wrong usage, 130 interrupted)."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options) or 0)
    except CcpinError as error:
        if options.json:
            print(json.dumps({"error": type(error).__name__, "message": str(error)}))
        else:
            print(f"ccpin: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("ccpin: interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="ccpin", description="Reduced models of closed-chain mechanisms.")
    parser.add_argument("--version", action="version", version=f"ccpin {ccpin.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")
    _add_info(commands)
    _add_modes(commands)
    _add_simulate(commands)
    _add_view(commands)
    return parser


def _add_mechanism(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mechanism", help="a file (URDF with loops, robot.yaml, MJCF) or an installed model's name")
    parser.add_argument("--independent", nargs="+", metavar="JOINT", help="independent joints, in the order of q")
    parser.add_argument("--actuated", nargs="+", metavar="JOINT", help="actuated joints, in the order of u")
    parser.add_argument("--floating-base", action="store_true", help="free the root link")
    parser.add_argument("--format", choices=("urdf", "mjcf", "toolbox"), help="instead of telling it from the content")
    parser.add_argument("--json", action="store_true", help="print machine-readable JSON (SI units, radians)")


def _load(options: argparse.Namespace) -> Mechanism:
    return ccpin.load(
        options.mechanism,
        independent=options.independent,
        actuated=options.actuated,
        floating_base=options.floating_base,
        format=options.format,
    )


def _add_vector(parser: argparse.ArgumentParser, name: str, help_text: str) -> None:
    """A vector option in SI units and its twin in degrees."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(f"--{name}", nargs="+", type=float, metavar="Q", help=f"{help_text}, rad or m")
    group.add_argument(f"--{name}-deg", nargs="+", type=float, metavar="DEG", help=f"{help_text}, degrees")


def _vector(options: argparse.Namespace, name: str) -> np.ndarray | None:
    plain, degrees = getattr(options, name), getattr(options, f"{name}_deg")
    if degrees is not None:
        return np.asarray(np.radians(degrees), dtype=np.float64)
    return None if plain is None else np.array(plain, dtype=np.float64)


def _add_info(commands: Any) -> None:
    parser = commands.add_parser("info", help="what was loaded: sizes, mobility, joints, conditioning")
    _add_mechanism(parser)
    parser.set_defaults(run=_info)


def _info(options: argparse.Namespace) -> None:
    facts = summary(_load(options))
    print(json.dumps(facts, indent=2) if options.json else in_words(facts))


def _add_modes(commands: Any) -> None:
    parser = commands.add_parser("modes", help="the assembly modes over a given q")
    _add_mechanism(parser)
    _add_vector(parser, "q", "independent coordinates (default: the reference's)")
    parser.set_defaults(run=_modes)


def _modes(options: argparse.Namespace) -> None:
    mechanism = _load(options)
    model = ccpin.ReducedModel(mechanism)
    q = _vector(options, "q")
    found = assembly_modes(model, model.alpha(mechanism.q_reference) if q is None else q)
    if options.json:
        modes = [mode._asdict() | {"q_free": mode.q_free.tolist()} for mode in found.modes]
        print(json.dumps({"modes": modes, "starts": found.starts, "singular": found.singular}, indent=2))
        return
    print(f"{len(found.modes)} assembly modes found from {found.starts} starts (sampled, not proved complete)")
    for k, mode in enumerate(found.modes, start=1):
        reference = ", the reference's" if mode.is_reference else ""
        print(f"mode {k}{reference}: sign det ψ_q′ = {mode.sign:+d}, 1/κ = {mode.rcond:.3g}")
        print(f"  q′ = {np.array2string(mode.q_free, precision=6, separator=', ')}")


def _add_simulate(commands: Any) -> None:
    parser = commands.add_parser("simulate", help="a set-point motion, once or in cycles, with figures and data")
    _add_mechanism(parser)
    _add_vector(parser, "start", "where the motion starts at rest (default: the reference)")
    _add_vector(parser, "goal", "the set point (default: the start)")
    parser.add_argument("--law", choices=("simple", "full", "none"), default="simple", help="gravity compensation")
    parser.add_argument("--kp", nargs="+", type=float, metavar="K", help="proportional gains, one or n")
    parser.add_argument("--kv", nargs="+", type=float, metavar="K", help="velocity gains, one or n")
    parser.add_argument("--duration", type=float, default=1.0, metavar="S", help="seconds (default 1)")
    parser.add_argument("--cycles", type=int, metavar="N", help="go to the goal and back N times")
    parser.add_argument("--wait", type=float, default=2.5, metavar="S", help="wait at each end of a cycle")
    parser.add_argument("--band-deg", type=float, default=2.0, metavar="DEG", help="band of the settling time")
    parser.add_argument("--method", choices=METHODS, default="RK45", help="SciPy's integrator")
    parser.add_argument("--rtol", type=float, default=1e-9)
    parser.add_argument("--atol", type=float, default=1e-11)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write figures, CSV, npz, metrics and animation there")
    parser.set_defaults(run=_simulate)


def _simulate(options: argparse.Namespace) -> int:
    mechanism = _load(options)
    model = ccpin.ReducedModel(mechanism)
    start, goal = _vector(options, "start"), _vector(options, "goal")
    start = model.alpha(mechanism.q_reference) if start is None else start
    goal = start if goal is None else goal
    settings = {"method": options.method, "rtol": options.rtol, "atol": options.atol}
    if options.cycles is None:
        law = _law(model, options, goal, model.sigma(start))
        trajectory = ccpin.simulate(model, law, start, duration=options.duration, **settings)
        moves = [(goal, trajectory)]
        goals = np.broadcast_to(goal, trajectory.q.shape)
    else:
        motion = _cycles(model, options, start, goal, settings)
        trajectory, moves = motion.trajectory, [(move.goal, move.trajectory) for move in motion.moves]
        goals = np.array([next(m.goal for m in motion.moves if t <= m.end) for t in trajectory.t])
    band = np.radians(options.band_deg)
    metrics = [set_point_metrics(part, model.coordinates, target, band).as_json() for target, part in moves]
    result = {
        "status": trajectory.status,
        "message": trajectory.message,
        "evaluations": trajectory.evaluations,
        "moves": metrics,
    }
    if options.out is not None:
        _write(options.out, mechanism, trajectory, goals, result)
    print(
        json.dumps(result, indent=2) if options.json else _motion_in_words(mechanism, trajectory, result, options.out)
    )
    return 0 if trajectory.status in ("finished", "settled") else 1


def _law(model: ccpin.ReducedModel, options: argparse.Namespace, goal: np.ndarray, q_free: np.ndarray) -> ControlLaw:
    if options.law == "none":
        return NoTorque(model)
    if options.kp is None or options.kv is None:
        raise InvalidInputError("the PD law needs --kp and --kv (one number, or one for each independent velocity)")
    kp, kv = (np.array(k * model.n if len(k) == 1 else k) for k in (options.kp, options.kv))
    law = PDSimpleGravity if options.law == "simple" else PDFullGravity
    return law(model, goal, kp, kv, q_free)


def _cycles(
    model: ccpin.ReducedModel,
    options: argparse.Namespace,
    start: np.ndarray,
    goal: np.ndarray,
    settings: dict[str, Any],
) -> SupervisedMotion:
    if options.cycles < 1:
        raise InvalidInputError("--cycles must be at least 1")
    return supervise(
        model,
        lambda target, q_free: _law(model, options, target, q_free),
        start,
        [goal, start] * options.cycles,
        wait=options.wait,
        settling=Settling(goal=goal),
        **settings,
    )


def _write(out: Path, mechanism: Mechanism, trajectory: Trajectory, goals: np.ndarray, result: dict[str, Any]) -> None:
    from ccpin import plotting, visualization

    trajectory.save_csv(out / "motion.csv", mechanism)
    trajectory.save_npz(out / "motion.npz")
    write_atomically(out / "metrics.json", "w", lambda file: json.dump(result, file, indent=2))
    plotting.save(plotting.plot_motion(trajectory, mechanism, goals), out / "motion.png")
    ends = [trajectory.q_free[0], trajectory.q_free[-1]]
    plotting.save(plotting.plot_configurations(mechanism, ends, ["start", "end"]), out / "configurations.png")
    visualization.animate(mechanism, trajectory.t, trajectory.q_free, out / "animation.html")


def _motion_in_words(mechanism: Mechanism, trajectory: Trajectory, result: dict[str, Any], out: Path | None) -> str:
    lines = [
        f"{mechanism.name}: {trajectory.status}, {trajectory.message} ({trajectory.evaluations} evaluations)",
        f"largest closure error {trajectory.closure_error.max():.1e}",
    ]
    for k, metric in enumerate(result["moves"], start=1):
        settled = metric["settling_time"]
        lines.append(
            f"move {k}: "
            + ("not within the band at the end" if settled is None else f"within the band from {settled:.3f} s on")
            + f", peak effort {np.round(metric['peak_torque'], 3).tolist()}"
        )
    if out is not None:
        lines.append(f"figures, data and animation in {out}/")
    return "\n".join(lines)


def _add_view(commands: Any) -> None:
    parser = commands.add_parser("view", help="show the mechanism, or play a trajectory, in MeshCat")
    _add_mechanism(parser)
    parser.add_argument("--trajectory", type=Path, metavar="NPZ", help="a motion.npz to play")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a self-contained page instead of serving one")
    parser.add_argument("--no-browser", action="store_true", help="serve without opening a browser")
    parser.add_argument("--speed", type=float, default=1.0, help="playing speed (default 1)")
    parser.set_defaults(run=_view)


def _view(options: argparse.Namespace) -> None:
    from ccpin import visualization

    mechanism = _load(options)
    motion = None if options.trajectory is None else load_npz(options.trajectory)
    if options.html is not None:
        if motion is None:
            visualization.snapshot_html(mechanism, None, options.html)
        else:
            visualization.animate(mechanism, motion.t, motion.q_free, options.html, speed=options.speed)
        print(json.dumps({"html": str(options.html)}) if options.json else f"wrote {options.html}")
        return
    q_free, t = (None, None) if motion is None else (motion.q_free, motion.t)
    with visualization.view(mechanism, q_free, t, speed=options.speed, open_browser=not options.no_browser) as viewer:
        print(
            json.dumps({"url": viewer.url}) if options.json else f"serving {viewer.url}  (Ctrl-C ends it)", flush=True
        )
        viewer.wait()


if __name__ == "__main__":
    sys.exit(main())
