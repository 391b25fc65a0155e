"""Motors' constants found from simulated logs: `python -m benchmarks.motors [MODEL …] [--runs N] [--into FILE] …`.

Motions and noise are those of `benchmarks.identification`. Each robot's bodies are drawn from what `identify` is told
of them beforehand (masses known to 2 %, moments to 20 %, each number by itself), every joint rubs, and every motor's
effort is k times what its column says, k drawn between 0.85 and 1.15, of which nothing is told.

Told: how many of all 95 % intervals hold k, errors of k in deviations and in percent, those of their ratio to the
first motor's, which no scale is in, and the efforts (true ones, over their root mean square) missed on a motion that
was not in the log, with `motors=True`, without, and by the file's constants. `--effort`: noise of the efforts.
`--load`: nothing is told of bodies beforehand, but each motion is logged twice, and the second time the last body
carries another one as heavy, whose constants (the file's) are known.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import ccpin
from benchmarks import identification as bench
from ccpin.identification import Log, identify

MASS, MOMENT, OFF = 0.02, 0.2, 0.15
"""Deviations of masses and of moments, shares as `prior` takes them; and how far k is from 1."""


def main(arguments: list[str] | None = None) -> None:
    """Print a model's lines each."""
    parser = argparse.ArgumentParser("python -m benchmarks.motors", description=__doc__)
    parser.add_argument("models", nargs="*", default=["rpdr"], help="installed models' names, or files")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--effort", type=float, default=bench.EFFORT, help="noise, of the efforts' root mean square")
    parser.add_argument("--load", action="store_true")
    parser.add_argument("--into", type=Path, help="a file of JSON lines")
    asked = parser.parse_args(arguments)
    for name in asked.models:
        told(name, asked.runs, asked.effort, asked.load, asked.into)


def told(name: str, runs: int, effort: float, weighed: bool, into: Path | None = None) -> None:
    """Log and identify one mechanism again and again."""
    model = ccpin.ReducedModel(ccpin.load(name))
    shown, unseen = bench.motions(model, *bench.MODELS.get(name, (0.15, 2.0, 1)))
    moved, Y = [bench.along(model, each) for each in shown], bench.along(model, unseen).Y
    known, stated = beforehand(model), model.parameters.values
    loads = [{}, load(model)] if weighed else [{}]
    asked: dict[str, Any] = {"added": loads * len(moved)} if weighed else {"prior": known}

    def found_of(draw: np.random.Generator) -> dict[str, Any]:
        truth, k = another(model, known, draw), draw.uniform(1.0 - OFF, 1.0 + OFF, model.n)
        robots = [truth + model.parameters.plus(each).values - stated for each in loads]
        logs = [said(bench.logged(model, each, each.Y @ pi, draw, effort), k) for each in moved for pi in robots]
        found, plain = identify(model, logs, motors=True, **asked), identify(model, logs, **asked)
        of_k, efforts = found.motors, Y @ truth
        size = np.sqrt((efforts**2).mean())
        slopes = (np.eye(model.n) - np.outer(of_k.values / of_k.values[0], np.eye(model.n)[0]))[1:] / of_k.values[0]
        ratios = (of_k.values / of_k.values[0] - k / k[0])[1:]
        sets = (found.parameters.values, plain.parameters.values, stated)
        return {
            "k": k.tolist(),
            "found": of_k.values.tolist(),
            "deviations": of_k.deviations.tolist(),
            "ratios": (ratios / np.sqrt(np.diag(slopes @ of_k.covariance @ slopes.T))).tolist(),
            "missed": [float(np.sqrt(((Y @ each - efforts) ** 2).mean()) / size) for each in sets],
        }

    lines = bench.robots(found_of, runs, into, model=name, effort=effort, load=weighed)
    print(f"{Path(name).stem}: {summary(lines)}", flush=True)


def beforehand(model: ccpin.ReducedModel) -> dict[str, float]:
    """Deviations of the ten numbers of all bodies with mass, by name."""
    told, known = model.parameters, dict[str, float]()
    for first in np.flatnonzero([kind == "mass" for kind in told.kinds]):
        m, s = told.values[first], told.values[first + np.array([4, 6, 9])].sum() / 2.0
        sizes = [MASS * m, *[MOMENT * np.sqrt(m * s)] * 3, *[MOMENT * s] * 6]
        known |= {name: x for name, x in zip(told.names[first : first + 10], sizes, strict=True) if x > 0.0}
    return known


def load(model: ccpin.ReducedModel) -> dict[str, float]:
    """The ten numbers of the last body with mass."""
    told = model.parameters
    first = [place for place in np.flatnonzero([kind == "mass" for kind in told.kinds]) if told.values[place] > 0.0][-1]
    return dict(zip(told.names[first : first + 10], told.values[first : first + 10].tolist(), strict=True))


def another(model: ccpin.ReducedModel, known: dict[str, float], draw: np.random.Generator) -> np.ndarray:
    """Constants of a robot as likely as what is told of them."""
    values, columns = np.array(model.parameters.values), [model.parameters.names.index(name) for name in known]
    size = 0.01 * np.abs(values[columns]).max()
    values[columns] += np.array([*known.values()]) * draw.normal(size=len(columns))
    for kind in ("damping", "friction"):
        values[model.parameters.of(kind)] += size * draw.uniform(0.5, 1.5, len(model.parameters.of(kind)))
    return values


def said(log: Log, k: np.ndarray) -> Log:
    """A log by constants that are k times too small."""
    efforts = [name for name in log.columns if name[0] == "u"]
    return Log(log.t, dict(log.columns) | {name: log.columns[name] / x for name, x in zip(efforts, k, strict=True)})


def summary(lines: list[dict[str, Any]]) -> str:
    """What all robots of a model say together."""
    k, found, deviations = (np.array([line[key] for line in lines]) for key in ("k", "found", "deviations"))
    away, ratios = (found - k) / deviations, np.array([line["ratios"] for line in lines])
    error = 100.0 * np.sqrt(np.mean(np.square([line["missed"] for line in lines]), axis=0))
    return (
        f"{len(lines)} robots, noise {100.0 * lines[0]['effort']:g} %: {100.0 * np.mean(np.abs(away) < 1.96):.1f} % of "
        f"{away.size} intervals hold k; errors in deviations: RMS {np.sqrt(np.mean(away**2)):.2f}, mean "
        f"{away.mean():.2f}; {100.0 * np.sqrt(np.mean((found / k - 1.0) ** 2)):.2g} %; of ratios: "
        f"{100.0 * np.mean(np.abs(ratios) < 1.96):.1f} % hold, RMS {np.sqrt(np.mean(ratios**2)):.2f}, mean "
        f"{ratios.mean():.2f}\n  missed, unseen: with motors {error[0]:.3g} %, without {error[1]:.3g} %, by the file "
        f"{error[2]:.3g} %; {np.mean([line['s'] for line in lines]):.2f} s of one core a robot"
    )


if __name__ == "__main__":
    main()
