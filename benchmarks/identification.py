"""Constants found from simulated logs: `python -m benchmarks.identification [MODEL …] [--runs N] [--into FILE] …`.

Each run is another robot: every body's ten numbers are up to a fifth off what the file says (all alike, so that they
stay a body's), every joint rubs, and the log has noise: a fiftieth of the efforts' root mean square, and of encoders
1e-5 rad or 1e-6 m. All robots of a model make the same motions of 5 s, a log each; their efforts are Y π, which for the
first one is held against the inverse dynamics of the changed description.

Told: how many of all 95 % intervals hold the true combination, the root mean square and the largest mean of errors in
standard deviations, the efforts that the found constants miss on a motion that was not in the log (over their root mean
square, noise apart), beside those that the file's miss; `--consistent`: those of physically consistent constants, too.
`--into FILE` appends a line of JSON a robot as it is found, and a second run goes on where the first one ended.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import ccpin
from ccpin.identification import Log, consistent, excitation, identify, with_constants

MODELS = {
    "rpdr": (0.35, 3.0, 1),
    "four_bar": (0.35, 3.0, 1),
    "slider_crank": (0.35, 3.0, 1),
    "planar_3rrr": (0.2, 2.0, 1),
    "delta": (0.3, 3.0, 2),
    "bennett": (0.35, 3.0, 1),
    "sarrus": (0.35, 3.0, 1),
    "docs/howto/ankle.urdf": (0.3, 3.0, 1),
    "stewart": (0.03, 0.3, 2),
    "hexa": (0.03, 0.5, 2),
}
"""Half width of the box of q, speed, and how many motions: two of what has more constants than one shows well."""
RATE, DURATION, EFFORT, OFF = 500.0, 5.0, 0.02, 0.2
ENCODER = {False: 1e-5, True: 1e-6}
"""Of a joint that turns, rad, or slides, m."""
NAMES = ("found", "stated", "consistent")


class Moved(NamedTuple):
    """Times, Y and (q, q̇, q̈) of a motion."""

    t: np.ndarray
    Y: np.ndarray
    states: tuple[np.ndarray, ...]


def main(arguments: list[str] | None = None) -> None:
    """Print a model's lines each."""
    parser = argparse.ArgumentParser("python -m benchmarks.identification", description=__doc__)
    parser.add_argument("models", nargs="*", default=list(MODELS), help="installed models' names, or files")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--consistent", action="store_true")
    parser.add_argument("--into", type=Path, help="a file of JSON lines")
    asked = parser.parse_args(arguments)
    for name in asked.models:
        told(name, asked.runs, asked.consistent, asked.into)


def told(name: str, runs: int, consistently: bool, into: Path | None = None) -> None:
    """Excite, log and identify one mechanism again and again."""
    model = ccpin.ReducedModel(ccpin.load(name))
    shown, unseen = motions(model, *MODELS.get(name, (0.15, 2.0, 1)))
    moved = [along(model, each) for each in shown]
    Y_unseen = along(model, unseen).Y
    check(model, moved[0].states, moved[0].Y)
    print(f"{Path(name).stem}: {len(shown)} × {DURATION:g} s; {shown[0].told}", flush=True)

    def found_of(draw: np.random.Generator) -> dict[str, Any]:
        truth = another(model, draw)
        found = identify(model, [logged(model, each, each.Y @ truth, draw) for each in moved])
        sets = [found.parameters.values, model.parameters.values]
        sets += [consistent(model, found).values] if consistently else []
        efforts = Y_unseen @ truth
        size = np.sqrt((efforts**2).mean())
        return {
            "combinations": [each.split()[0] for each in found.combinations],
            "away": [np.round(found.multiples @ (each - truth) / found.deviations, 4).tolist() for each in sets[::2]],
            "missed": [float(np.sqrt(((Y_unseen @ each - efforts) ** 2).mean()) / size) for each in sets],
        }

    print(summary(robots(found_of, runs, into, model=name, consistent=consistently)), flush=True)


def robots(
    found_of: Callable[[np.random.Generator], dict[str, Any]], runs: int, into: Path | None, **told: Any
) -> list[dict[str, Any]]:
    """What was found of robots, a line each: of those that a file has, told so, then of others, drawn by number."""
    lines = [line for line in read(into) if all(line.get(name) == value for name, value in told.items())]
    for run in range(len(lines), runs):
        begin = time.process_time()
        found = found_of(np.random.default_rng(run))
        lines.append({**told, "run": run, **found, "s": round(time.process_time() - begin, 3)})
        if into is not None:
            with into.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    return lines


def summary(lines: list[dict[str, Any]]) -> str:
    """What all robots of a model say together."""
    off, by_name = np.concatenate([line["away"][0] for line in lines]), defaultdict(list)
    for line in lines:
        for name, away in zip(line["combinations"], line["away"][0], strict=True):
            by_name[name].append(away)
    mean = max((abs(float(np.mean(each))) for each in by_name.values() if 2 * len(each) > len(lines)), default=np.nan)
    error = 100.0 * np.sqrt(np.mean(np.square([line["missed"] for line in lines]), axis=0))
    rms = [np.sqrt(np.mean(np.square(np.concatenate(each)))) for each in zip(*(x["away"] for x in lines), strict=True)]
    missed = ", ".join(f"{who} {x:.3g} %" for who, x in zip(NAMES, error, strict=False))
    return (
        f"  {len(lines)} robots, {off.size} intervals: {100.0 * np.mean(np.abs(off) < 1.96):.1f} % hold; errors in "
        f"deviations: RMS {', consistent '.join(f'{x:.2f}' for x in rms)}, mean at most {mean:.2f}\n"
        f"  missed, unseen: {missed}; {np.mean([line['s'] for line in lines]):.2f} s of one core a robot"
    )


def read(path: Path | None) -> list[dict[str, Any]]:
    """Lines of an earlier run."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path is not None and path.exists() else []


def motions(model: ccpin.ReducedModel, half: float, speed: float, count: int) -> tuple[list[Any], Any]:
    """Motions that show constants well, the first one improved, and another one that was not made to."""
    middle = model.alpha(model.mechanism.q_reference)
    box = {"lower": middle - half, "upper": middle + half, "speed": speed}
    shown = [excitation(model, DURATION, **box, starts=60, iterations=20 // model.n, seed=1)]
    shown += [excitation(model, DURATION, **box, starts=20, iterations=0, seed=2 + k) for k in range(1, count)]
    return shown, excitation(model, DURATION, **box, starts=5, iterations=0, seed=2)


def along(model: ccpin.ReducedModel, motion: Any) -> Moved:
    """A motion at the log's rate."""
    t = np.arange(0.0, DURATION, 1.0 / RATE)
    states = tuple(np.array(rows) for rows in zip(*map(motion.reference.at, t), strict=True))
    return Moved(t, model.regressor_many(*states), states)


def check(model: ccpin.ReducedModel, states: tuple[np.ndarray, ...], Y: np.ndarray) -> None:
    """The first robot's efforts are inverse dynamics of its description, and friction."""
    told, pi = model.parameters, another(model, np.random.default_rng(0))
    changed = with_constants(model, type(told)(told.names, told.kinds, told.units, pi))
    robot = ccpin.ReducedModel(ccpin.load(changed))
    q, v, a = (block[::50] for block in states)
    there = robot.terms_many(q, v)
    rubbing = robot.mechanism.joints.friction * np.sign(np.einsum("sij,sj->si", there.rho, v))
    efforts = robot.inverse_dynamics_many(q, v, a) + np.einsum("sij,si->sj", there.rho, rubbing)
    assert np.abs(efforts - Y[::50] @ pi).max() <= 1e-9 * np.abs(efforts).max()


def another(model: ccpin.ReducedModel, draw: np.random.Generator) -> np.ndarray:
    """Constants of a robot that is not quite what its file says."""
    parameters = model.parameters
    values = np.array(parameters.values)
    for first in np.flatnonzero([kind == "mass" for kind in parameters.kinds]):
        values[first : first + 10] *= 1.0 + OFF * draw.uniform(-1.0, 1.0)
    size = 0.01 * np.abs(values[parameters.of("inertia")]).max()
    for kind in ("damping", "friction"):
        values[parameters.of(kind)] += size * draw.uniform(0.5, 1.5, len(parameters.of(kind)))
    return values


def logged(
    model: ccpin.ReducedModel, moved: Moved, tau: np.ndarray, draw: np.random.Generator, effort: float = EFFORT
) -> Log:
    """Positions and efforts with noise, of a mechanism whose motors are on its coordinates."""
    t, q = moved.t, moved.states[0]
    names, size = model.mechanism.independent, np.sqrt((tau**2).mean(axis=0))
    assert names == model.mechanism.actuated
    encoders = [ENCODER[model.mechanism.tree.joint(name).kind.sliding] for name in names]
    columns = {f"q_{name}": q[:, k] + encoders[k] * draw.normal(size=len(t)) for k, name in enumerate(names)}
    noise = effort * size * draw.normal(size=tau.shape)
    return Log(t, columns | {f"u_{name}": (tau + noise)[:, k] for k, name in enumerate(names)})


if __name__ == "__main__":
    main()
