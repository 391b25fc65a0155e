"""Constants found from simulated logs: `python -m benchmarks.identification [MODEL …] [--runs N] [--consistent]`.

Each run is another robot: every body's ten numbers are up to a fifth off what the file says (all alike, so that they
stay a body's), every joint rubs, and the log has noise: a fiftieth of the efforts' root mean square, and of encoders
1e-5 rad or m. Told: how many of all 95 % intervals hold the true combination, the largest bias in deviations, the
efforts that the found constants miss on a motion that was not in the log (over their root mean square, noise apart),
beside those that the file's miss; `--consistent`: those of physically consistent constants, too.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

import ccpin
from ccpin.identification import Log, consistent, excitation, identify

MODELS = {"rpdr": (0.35, 3.0), "four_bar": (0.35, 3.0), "planar_3rrr": (0.2, 2.0), "delta": (0.3, 3.0)}
"""Half width of the box of q, and speed."""
RATE, DURATION, EFFORT, ENCODER, OFF = 1000.0, 5.0, 0.02, 1e-5, 0.2


def main(arguments: list[str] | None = None) -> None:
    """Print a model's lines each."""
    parser = argparse.ArgumentParser("python -m benchmarks.identification", description=__doc__)
    parser.add_argument("models", nargs="*", default=list(MODELS), help="installed models' names, or files")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--consistent", action="store_true")
    asked = parser.parse_args(arguments)
    for name in asked.models:
        told(name, asked.runs, asked.consistent)


def told(name: str, runs: int, consistently: bool) -> None:
    """Excite, log and identify one mechanism again and again."""
    model = ccpin.ReducedModel(ccpin.load(name))
    half, speed = MODELS.get(name, (0.15, 2.0))
    middle = model.alpha(model.mechanism.q_reference)
    box = {"lower": middle - half, "upper": middle + half, "speed": speed, "starts": 60, "iterations": 20}
    begin = time.perf_counter()
    shown, unseen = (excitation(model, DURATION, **box, seed=seed) for seed in (1, 2))
    print(f"{Path(name).stem}: {shown.told}; {time.perf_counter() - begin:.0f} s for two motions", flush=True)
    t, Y, states = along(model, shown)
    Y_unseen = along(model, unseen)[1]
    within, off, missed = [], [], []
    begin = time.perf_counter()
    for run in range(runs):
        draw = np.random.default_rng(run)
        truth = another(model, draw)
        tau = Y @ truth
        log = logged(model, t, states[0], tau, draw)
        found = identify(model, log)
        away = (found.values - found.multiples @ truth) / found.deviations
        within.append(np.abs(away) < 1.96)
        off.append(away)
        efforts = Y_unseen @ truth
        sets = [found.parameters.values, model.parameters.values]
        sets += [consistent(model, found).values] if consistently else []
        size = np.sqrt((efforts**2).mean())
        missed.append([np.sqrt(((Y_unseen @ each - efforts) ** 2).mean()) / size for each in sets])
    each = (time.perf_counter() - begin) / runs
    held, bias = 100.0 * np.mean(within), np.abs(np.mean(off, axis=0)).max()
    error = 100.0 * np.sqrt(np.mean(np.square(missed), axis=0))
    print(f"  {runs} robots, {np.size(within)} intervals: {held:.1f} % hold; mean error at most {bias:.2f} deviations")
    names = ("found", "stated", "consistent")
    print("  missed, unseen: " + ", ".join(f"{who} {x:.3g} %" for who, x in zip(names, error, strict=False)), end="")
    print(f"; {each:.1f} s a robot", flush=True)


def along(model: ccpin.ReducedModel, motion: Any) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Times, Y and (q, q̇, q̈) of a motion at the log's rate."""
    t = np.arange(0.0, DURATION, 1.0 / RATE)
    states = tuple(np.array(rows) for rows in zip(*map(motion.reference.at, t), strict=True))
    return t, model.regressor_many(*states), states


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


def logged(model: ccpin.ReducedModel, t: np.ndarray, q: np.ndarray, tau: np.ndarray, draw: np.random.Generator) -> Log:
    """Positions and efforts with noise, of a mechanism whose motors are on its coordinates."""
    names, size = model.mechanism.independent, np.sqrt((tau**2).mean(axis=0))
    assert names == model.mechanism.actuated
    columns = {f"q_{name}": q[:, k] + ENCODER * draw.normal(size=len(t)) for k, name in enumerate(names)}
    noise = EFFORT * size * draw.normal(size=tau.shape)
    return Log(t, columns | {f"u_{name}": (tau + noise)[:, k] for k, name in enumerate(names)})


if __name__ == "__main__":
    main()
