"""Batches: 1e5 rows with σ from 1e-2 rad away in each, on one and two threads, beside a Python loop over Pinocchio."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

import ccpin
from benchmarks.measured import LOOP, NATIVE, NUMPY, Measured, Options, short_name
from benchmarks.peers import NotForThisError
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import batch, loaded, models_of, place
from benchmarks.timing import Timing, timed

PART = "batches"
DYNAMICS, TERMS, SIGMA, DERIVATIVES = "a row of q̈", "a row of D, C, g", "a row of σ", "a row of ∂q̈"
THREADS = "two threads over one (wall clock)"
ROUNDS, NUMPY_ROWS = 3, 200  # at most: the reference takes milliseconds a row
FEWER = 10  # derivatives are taken of so many times fewer rows

Run = tuple[Callable[[int], object], int]  # called with the number of threads; how many rows it does


def measure(options: Options) -> Iterator[Measured]:
    """CPU seconds a row; ratios to the loop, in which q′ is known already."""
    for name in options.models:
        mechanism = loaded(name)
        if mechanism is not None:
            yield from figures(short_name(name), mechanism, options)


def figures(subject: str, mechanism: ccpin.Mechanism, options: Options) -> Iterator[Measured]:
    """One model's figures: every batch and the loop in turn, some rounds of it."""
    models = models_of(mechanism)
    at = place(models[NUMPY])
    given = batch(models[NUMPY], at, options.rows)
    runs: dict[tuple[str, str], Run] = {}
    try:
        peer = Pinocchio(mechanism, at)
        rows = [np.repeat(each[None], options.rows, axis=0) for each in (at.q_free, at.v_free, at.tau)]
        runs[DYNAMICS, LOOP] = (lambda _: peer.loop(*rows), options.rows)
    except NotForThisError:
        pass
    for who, model in models.items():
        count = options.rows if who == NATIVE else min(options.rows, NUMPY_ROWS)
        few = max(1, count // FEWER)
        runs |= {(quantity, who): (run, count) for quantity, run in batches(model, given, at.q_free, count).items()}
        runs[DERIVATIVES, who] = (derivatives(model, given, at.q_free, few), few)
    samples: dict[tuple[str, str], list[float]] = {key: [] for key in runs}
    for _ in range(min(options.rounds, ROUNDS)):
        for key, (run, count) in runs.items():
            samples[key].append(timed(lambda r=run: r(1))[1] / count)
    times = {key: Timing(np.array(found)) for key, found in samples.items()}
    loop = times.get((DYNAMICS, LOOP))
    for (quantity, who), timing in times.items():
        ratio = None if loop is None else timing.ratio(loop)
        note = f"{options.rows} rows" if (quantity, who) == (DYNAMICS, NATIVE) else ""
        yield Measured(PART, subject, quantity, who, timing.seconds, "s", ratio, note)
    if NATIVE in models:
        run, _ = runs[DYNAMICS, NATIVE]
        run(2)  # the first time on two threads, each takes memory of its own
        pairs = [[timed(lambda n=n: run(n), time.perf_counter)[1] for n in (1, 2)] for _ in range(options.rounds)]
        yield Measured(PART, subject, THREADS, NATIVE, float(np.median([one / two for one, two in pairs])), "")


def batches(
    model: ccpin.ReducedModel, given: tuple[np.ndarray, ...], near: np.ndarray, count: int
) -> dict[str, Callable[[int], object]]:
    """The batched calls on some rows of q, q̇ and u."""
    q, v, u = (np.ascontiguousarray(each[:count]) for each in given)
    return {
        DYNAMICS: lambda threads: model.forward_dynamics_many(q, v, u, near, threads=threads),
        SIGMA: lambda threads: model.sigma_many(q, near, threads=threads),
        TERMS: lambda threads: model.terms_many(q, v, near, threads=threads),
    }


def derivatives(
    model: ccpin.ReducedModel, given: tuple[np.ndarray, ...], near: np.ndarray, count: int
) -> Callable[[int], object]:
    """The batched derivatives on some rows."""
    q, v, u = (np.ascontiguousarray(each[:count]) for each in given)
    return lambda threads: model.forward_dynamics_derivatives_many(q, v, u, near, threads=threads)
