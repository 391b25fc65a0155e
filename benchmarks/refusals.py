"""``python -m benchmarks.refusals [MODEL …]``: what σ's refusals cost, far away and next to where ways end.

Far: q at random within π of the reference, each coordinate. Near: about the ends of straight ways out of the reference,
half along the way and half off it, at distances from 1e-5 to 0.1. At: the same at distances from 1e-9 to 1e-5, where
rounding decides whether a q is answered or refused. All from the reference, CPU time of `model.sigma` until the error
is raised. Before: the reference walks on in ever shorter steps; after: what the model does. Both in one run, the former
on the first `--walked` refusals of each kind; `changed` counts errors of another kind, and answers, among these.
`asked`: after how many the reference was asked.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from unittest.mock import patch

import numpy as np

import ccpin
from ccpin.arrays import Array
from ccpin.kinematics import parametrization

MODELS = ("rpdr", "delta", "stewart")
BEFORE, AFTER = "before", "after"
_WAY = 6.0  # rad: no straight way of these is longer
_EACH = 50  # queries about one end


def far(model: ccpin.ReducedModel, count: int, rng: np.random.Generator) -> Array:
    """q at random, of shape (count, n)."""
    return model.alpha(model.mechanism.q_reference) + rng.uniform(-np.pi, np.pi, (count, model.n))


def near(
    model: ccpin.ReducedModel, count: int, rng: np.random.Generator, least: float = -5.0, most: float = -1.0
) -> Array:
    """q about the ends of straight ways, at distances from 10^least to 10^most, of shape (count, n)."""
    start, ways = model.alpha(model.mechanism.q_reference), max(count // _EACH, 1)
    directions = rng.normal(size=(ways, model.n))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ends = np.array([start + _end(model, start, way) * way for way in directions])
    which, off = rng.integers(ways, size=count), rng.normal(size=(count, model.n))
    off /= np.linalg.norm(off, axis=1)[:, None]
    along = rng.choice([-1.0, 1.0], (count, 1)) * directions[which]
    offsets = np.where(rng.integers(2, size=(count, 1)) == 0, along, off)
    return ends[which] + 10.0 ** rng.uniform(least, most, (count, 1)) * offsets


KINDS = {"far": far, "near": near, "at": partial(near, least=-9.0, most=-5.0)}


def _end(model: ccpin.ReducedModel, start: Array, way: Array) -> float:
    """How far the core follows a straight way, to 1e-11."""
    least, most = 0.0, _WAY
    for _ in range(9):
        places = np.linspace(least, most, 21)
        found = model.core.sigma_many(start + places[:, None] * way, None)
        if found is None or found[1].all() or not found[1][0]:
            break
        first = int(np.argmin(found[1]))
        least, most = places[first - 1], places[first]
    return least


def refusal(call: Callable[[Array], object], q: Array) -> tuple[str, float]:
    """The error's name ("": none), and CPU milliseconds until it."""
    began, name = time.thread_time(), ""
    try:
        call(q)
    except ccpin.CcpinError as error:
        name = type(error).__name__
    return name, 1e3 * (time.thread_time() - began)


def rows(name: str, count: int, walked: int, seed: int) -> Iterator[str]:
    """A line of the table for each kind of query of one model."""
    model = ccpin.ReducedModel(ccpin.load(name))
    for kind, made in KINDS.items():
        queries = made(model, count, np.random.default_rng(seed))
        found = [refusal(model.sigma, q) for q in queries]
        refused = [k for k, (error, _) in enumerate(found) if error]
        asked = sum(model.core.sigma(q) is None and model.core.blocked(None, q) is None for q in queries)
        with patch.object(parametrization, "DeadEnds", lambda *_: lambda *_: None):
            old = {k: refusal(model.parametrization.sigma, queries[k]) for k in refused[:walked]}
        changed = sum(found[k][0] != error for k, (error, _) in old.items())
        times = {BEFORE: [t for _, t in old.values()], AFTER: [found[k][1] for k in refused]}
        quantiles = [np.quantile(times[each], part) for part in (0.5, 0.95) for each in (BEFORE, AFTER)]
        numbers = "".join(f"{value:9.2f}" for value in quantiles)
        yield f"{name:10}{kind:6}{count:8}{len(refused):9}{asked:8}{numbers}{len(old):9}{changed:9}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=MODELS)
    parser.add_argument("--queries", type=int, default=10_000, help="of each kind for each model")
    parser.add_argument("--walked", type=int, default=200, help="refusals of each that the reference repeats")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    heads = (BEFORE, AFTER, "95 %", "95 %", "walked", "changed")
    print(f"{'ms':16}{'queries':>8}{'refused':>9}{'asked':>8}" + "".join(f"{head:>9}" for head in heads))
    for name in asked.models:
        for line in rows(name, asked.queries, asked.walked, asked.seed):
            print(line, flush=True)


if __name__ == "__main__":
    main()
