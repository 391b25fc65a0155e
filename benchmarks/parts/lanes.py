"""Programs in lanes: a row of q̈ at a known q′, with σ from 1e-2 rad away, in single precision, and on two threads.

And a step of one of thousands of Gymnasium environments, of the wall clock, with all that starts anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

import ccpin
from benchmarks.measured import NATIVE, PINOCCHIO, Measured, Options, short_name
from benchmarks.peers import NotForThisError
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import AWAY, loaded, place
from benchmarks.timing import timed
from ccpin import programs
from ccpin.errors import CcpinError

PART, LANES = "lanes", "lanes"
CALLS, ROUNDS, STEPS = 200, 25, 2  # of the peer in one timing; rounds; Newton's steps of σ
MOST = 65_536  # rows of a batch, which stay in the processor's cache
LARGE = 4  # times as many for two threads, whose start is tens of microseconds
ENVIRONMENTS, EPISODE, EFFORT = 4096, 100, 0.5  # at once; steps of 20 ms, each of 10 integrator's steps; N m or N
THREADS = {"one thread": 1, "two threads": 2}
TRAINED = ("rpdr", str(Path(__file__).parents[2] / "docs/howto/ankle.urdf"))


def measure(options: Options) -> Iterator[Measured]:
    """Seconds a row, and ratios to Pinocchio's constraintDynamics in the same rounds."""
    for name in options.models:
        free = loaded(name)
        if free is not None:
            yield from figures(short_name(name), ccpin.ReducedModel(ccpin.load(name)), free, options)
    for name in TRAINED if options.deep else TRAINED[:1]:
        yield from environments(name, options)


def figures(subject: str, model: ccpin.ReducedModel, free: ccpin.Mechanism, options: Options) -> Iterator[Measured]:
    """One model's figures; the peer has the spins that the model leaves out."""
    count = min(options.rows, MOST)
    runs: dict[str, Callable[[], object]] = {}
    try:
        peer = Pinocchio(free, place(ccpin.ReducedModel(free)))
        runs[PINOCCHIO] = lambda: [peer.acceleration() for _ in range(CALLS)]
    except NotForThisError:
        pass
    closed, y, near = rows(model, count)
    for quantity, given, format, start in (
        ("a row of q̈ at a known q′", "closed", "double", y),
        ("a row of q̈ at a known q′, single precision", "closed", "float", y),
        ("a row of q̈ with σ", "near", "double", near),
        ("a row of q̈ with σ, single precision", "near", "float", near),
    ):
        program = programs.record(model, "forward_dynamics", given=given, steps=STEPS)
        try:
            made, seconds = timed(lambda p=program, f=format: programs.compiled(p, f), time.perf_counter)
        except CcpinError as error:
            yield Measured(PART, subject, quantity, LANES, None, note=str(error))
            return
        kind = np.float64 if format == "double" else np.float32
        q, v, u = (each.astype(kind, order="F") for each in closed)
        held = start.astype(kind, order="F")
        runs[quantity] = lambda made=made, q=q, held=held, v=v, u=u: made(q, held, v, u)
        note = f"{sum(program.operations.values())} operations; 0 where the cache had it"
        yield Measured(PART, subject, f"{quantity}: compiling", LANES, seconds, note=note)
        if quantity == "a row of q̈ at a known q′":
            many = [np.asfortranarray(np.tile(each, (LARGE, 1))) for each in (q, held, v, u)]
            for threads in THREADS:
                runs[threads] = partial(made, *many, threads=THREADS[threads])
    whole = programs.compiled(model)
    about = model.alpha(model.mechanism.q_reference)
    rng = np.random.default_rng(2)
    Q = about + AWAY * rng.uniform(-1, 1, (count, model.n)) if model.nq == model.n else None
    if Q is not None:
        V, U = rng.normal(size=(count, model.n)), rng.normal(size=(count, model.n_actuated))
        runs["a row of forward_dynamics_many"] = lambda: whole.forward_dynamics_many(Q, V, U)
        few = slice(0, min(count, 4096))
        runs["core"] = lambda: model.forward_dynamics_many(Q[few], V[few], U[few])
    samples: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for _ in range(min(options.rounds, ROUNDS)):
        for name, run in runs.items():
            each = {PINOCCHIO: CALLS, "core": min(count, 4096)}.get(name, count * LARGE if name in THREADS else count)
            samples[name].append(timed(run, time.perf_counter)[1] / each)
    times = {name: np.array(found) for name, found in samples.items()}
    loop, core = times.pop(PINOCCHIO, None), times.pop("core", None)
    one, two = (times.pop(name) for name in THREADS)
    if loop is not None:
        yield Measured(PART, subject, "q̈", PINOCCHIO, float(np.median(loop)), note=peer.note)
    for name, found in times.items():
        ratio = None if loop is None else float(np.median(found / loop))
        yield Measured(PART, subject, name, LANES, float(np.median(found)), "s", ratio, f"{count} rows")
    if core is not None:
        yield Measured(PART, subject, "a row of forward_dynamics_many", NATIVE, float(np.median(core)))
    gain = float(np.median(one / two))
    yield Measured(PART, subject, "two threads over one (wall clock)", LANES, gain, "", note=f"{LARGE * count} rows")


def rows(model: ccpin.ReducedModel, count: int) -> tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray]:
    """(q, q̇, u) of rows about the reference, y there, and y of configurations `AWAY` from them."""
    sigma = programs.record(model, "sigma", given="near", steps=4)
    rng, n = np.random.default_rng(1), model.n
    example = np.array(sigma.example)
    q = example[:n] + 0.1 * rng.uniform(-1, 1, (256, n))
    found, beside = (sigma(q=each, y=example[n:]) for each in (q, q + AWAY / np.sqrt(n)))
    sound = (found.status == 0) & (beside.status == 0)
    q, y, near = (
        np.tile(each[sound], (-(-count // int(sound.sum())), 1))[:count]
        for each in (q, found["sigma"], beside["sigma"])
    )
    return (q, rng.normal(size=(count, n)), rng.normal(size=(count, model.n_actuated))), y, near


def environments(name: str, options: Options) -> Iterator[Measured]:
    """Seconds a step of one of many environments: whole episodes of random efforts, each of them started anew."""
    subject = short_name(name)
    try:
        from ccpin.gym import MechanismVectorEnv
    except CcpinError as error:
        yield Measured(PART, subject, "an environment's step", LANES, None, note=str(error))
        return
    count = min(ENVIRONMENTS, options.rows)
    for word, threads in THREADS.items():
        envs = MechanismVectorEnv(name, count, horizon=EPISODE, effort=EFFORT, threads=threads)
        envs.action_space.seed(0)
        actions = [envs.action_space.sample() for _ in range(EPISODE if options.deep else 2)]
        envs.reset(seed=0)
        stamps, ended = [time.perf_counter()], 0
        for _ in range(min(options.rounds, 3)):
            for action in actions:
                _, _, over, _, _ = envs.step(action)
                ended += int(over.sum())
            stamps.append(time.perf_counter())
        seconds = float(np.median([b - a for a, b in pairwise(stamps)])) / (count * len(actions))
        note = f"{1.0 / seconds:,.0f} steps/s of {count} at once, {envs.backend}, {ended} ended before their time"
        yield Measured(PART, subject, f"an environment's step, {word}", LANES, seconds, note=note)
