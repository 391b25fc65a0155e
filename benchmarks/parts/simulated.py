"""The paper's move, one simulated second with 1,001 samples: CPU time, and the error against a reference at 1e-13.

The reference is the closed forms (31)–(40) of the paper in NumPy, which share nothing with ccpin, integrated by
DOP853; its own error is judged by integrating it a second time at twice the tolerance. Peers get their best: MuJoCo
and Drake run in C++ with their own servo motors, Pinocchio's constrained dynamics SciPy's RK45 as ccpin's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import ccpin
from benchmarks.measured import DRAKE, MUJOCO, NATIVE, NUMPY, PINOCCHIO, Measured, Options
from benchmarks.peers import NotForThisError, drake, mujoco
from benchmarks.peers.mjcf import Servo
from benchmarks.peers.pinocchio import contacts, memory
from benchmarks.subjects import models_of
from benchmarks.timing import Timing
from ccpin.control import Measurement
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V, START, to_paper

PART, SUBJECT, RUBBING = "simulated", "the paper's move, 1 s", "the same with dry friction of all joints"
COST, ERROR, CLOSURE, SAME = "CPU time", "largest error of q", "largest ‖φ‖", "samples differ from NumPy's by"
REFERENCE = "closed forms (31)–(40), DOP853"
SAMPLE, COUNT = 1e-3, 1000  # s between samples; a second in all
MOST_ROUNDS = 5  # of whole motions, which take seconds in some peers
METHODS, STEPS = ("RK45", "DOP853"), (1e-3, 1e-4)
RK4 = "MuJoCo RK4 at {:g}".format
SAP = "Drake SAP at {:g}".format
COMPARED = RK4(1e-4)
TIMES = np.arange(COUNT + 1) * SAMPLE
FRICTION = {"joint1": (0.03, 0.002), "joint2": (0.02, 0.001), "joint3": (0.01, 0.003), "joint4": (0.015, 0.0)}

Runner = Callable[[], np.ndarray]  # q′ at the samples, of shape (1001, 4)


class Runners(NamedTuple):
    """All who run the move, and those who cannot, with the reason."""

    runs: dict[str, Runner]
    absent: dict[str, str]


def measure(options: Options) -> Iterator[Measured]:
    """Costs taken in turn, errors, and how far both backends' samples are apart."""
    mechanism = ccpin.load("rpdr")
    models = models_of(mechanism)
    exact, own = reference(models[NUMPY])
    runs, absent = runners(mechanism, models, options)
    samples = {who: run() for who, run in runs.items()}
    costs = costs_of(runs, min(options.rounds, MOST_ROUNDS))
    peer = costs.get(COMPARED)
    for who, timing in costs.items():
        ratio = None if peer is None else timing.ratio(peer)
        yield Measured(PART, SUBJECT, COST, who, timing.seconds, "s", ratio)
    for who, found in samples.items():
        q = found[:, [mechanism.tree.names.index(name) for name in mechanism.independent]]
        yield Measured(PART, SUBJECT, ERROR, who, float(np.abs(q - exact).max()), "rad")
    yield Measured(PART, SUBJECT, ERROR, REFERENCE, own, "rad", note="against itself at half the tolerance")
    for who, found in samples.items():
        gap = max(float(np.linalg.norm(oracle.phi(to_paper(mechanism, q_free)))) for q_free in found)
        yield Measured(PART, SUBJECT, CLOSURE, who, gap, "m")
    if NATIVE in models:
        apart = float(np.abs(samples[f"{NATIVE}, RK45"] - samples[f"{NUMPY}, RK45"]).max())
        yield Measured(PART, SUBJECT, SAME, f"{NATIVE}, RK45", apart, "rad")
    yield from rubbing(models)
    for who, reason in absent.items():
        yield Measured(PART, SUBJECT, COST, who, None, note=reason)


def rubbing(models: dict[str, ccpin.ReducedModel]) -> Iterator[Measured]:
    """The move with friction of driven and passive joints: both backends, and how far their samples are apart."""
    runs = {who: ours(model, "RK45", FRICTION) for who, model in models.items()}
    samples = {who: run() for who, run in runs.items()}
    costs = costs_of(runs, 2)
    for who, timing in costs.items():
        yield Measured(PART, RUBBING, COST, who, timing.seconds, "s", timing.ratio(costs[NUMPY]))
    if NATIVE in models:
        apart = float(np.abs(samples[NATIVE] - samples[NUMPY]).max())
        yield Measured(PART, RUBBING, SAME, NATIVE, apart, "rad")


def costs_of(runs: dict[str, Runner], rounds: int) -> dict[str, Timing]:
    """CPU seconds of every run, a round a time."""
    samples: dict[str, list[float]] = {who: [] for who in runs}
    for _ in range(rounds):
        for who, run in runs.items():
            began = time.process_time()
            run()
            samples[who].append(time.process_time() - began)
    return {who: Timing(np.array(found)) for who, found in samples.items()}


def reference(model: ccpin.ReducedModel) -> tuple[np.ndarray, float]:
    """q at the samples, of shape (1001, 2), and how far it moves when the tolerance is doubled."""
    mode = float(np.sign(np.sin(oracle.fold(to_paper(model.mechanism, model.sigma(START))))))
    at_goal = oracle.sigma(GOAL, mode)
    gravity = oracle.rho(at_goal).T @ oracle.gravity(at_goal)

    def derivative(t: float, state: np.ndarray) -> np.ndarray:
        q, v = state[:2], state[2:]
        mass, coriolis, pull = oracle.reduced_terms(oracle.sigma(q, mode), v)
        u = K_P * (GOAL - q) - K_V * v + gravity  # (28)
        return np.concatenate([v, np.linalg.solve(mass, u - coriolis @ v - pull)])

    start, span = np.concatenate([START, np.zeros(2)]), (0.0, TIMES[-1])
    found = [
        solve_ivp(derivative, span, start, method="DOP853", rtol=rtol, atol=1e-15, t_eval=TIMES, max_step=2e-3).y[:2].T
        for rtol in (5e-14, 1e-13)
    ]
    return found[0], float(np.abs(found[0] - found[1]).max())


def runners(mechanism: ccpin.Mechanism, models: dict[str, ccpin.ReducedModel], options: Options) -> Runners:
    """Everyone's run."""
    runs: dict[str, Runner] = {}
    for who, model in models.items():
        for method in METHODS if who == NATIVE else METHODS[:1]:
            runs[f"{who}, {method}"] = ours(model, method)
    runs[f"{PINOCCHIO}, SciPy's RK45"] = constrained(models[NUMPY])
    start = models[NUMPY].sigma(START)
    pull = models[NUMPY].gravity(GOAL)
    laws = zip(mechanism.independent, K_P, GOAL, K_V, pull, strict=True)
    servos = {name: Servo(float(p * goal + g), float(p), float(d)) for name, p, goal, d, g in laws}
    absent = dict[str, str]()
    for step in STEPS if options.deep else STEPS[:1]:
        skip, steps = round(SAMPLE / step), round(TIMES[-1] / step)
        try:
            move = mujoco.Move(mechanism, servos, start, step)
            runs[RK4(step)] = lambda m=move, n=steps, k=skip: m.run(n)[::k]
        except NotForThisError as reason:
            absent[MUJOCO] = str(reason)
        try:
            other = drake.Move(mechanism, servos, start, step)
            runs[SAP(step)] = lambda m=other, n=steps: m.run(n, SAMPLE)
        except NotForThisError as reason:
            absent[DRAKE] = str(reason)
    return Runners(runs, absent)


def ours(model: ccpin.ReducedModel, method: str, friction: Mapping[str, tuple[float, float]] | None = None) -> Runner:
    """`ccpin.simulate`, with its law made beforehand."""
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    return lambda: ccpin.simulate(model, law, START, duration=TIMES[-1], method=method, friction=friction).q_free


def constrained(model: ccpin.ReducedModel) -> Runner:
    """Pinocchio's constrained dynamics on the free system, with Baumgarte's stabilisation."""
    mechanism, free = model.mechanism, model.mechanism.pin_model
    made, data = contacts(mechanism), free.createData()
    for contact in made:
        contact.m_baumgarte_parameters.Kp, contact.m_baumgarte_parameters.Kd = 1e4, 2e2
    scratch, settings = memory(made), pin.ProximalSettings(1e-12, 1e-12, 1)
    pin.initConstraintDynamics(free, data, made, scratch)
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    select, motors = [free.idx_qs[free.getJointId(name)] for name in mechanism.independent], mechanism.actuation

    def derivative(t: float, state: np.ndarray) -> np.ndarray:
        q, v = state[: free.nq], state[free.nq :]
        tau = motors.T @ law.torque(t, Measurement(q[select]), v[select])
        a = pin.constraintDynamics(free, data, q, v, tau, made, scratch, settings)
        return np.concatenate([v, a])

    start = np.concatenate([model.sigma(START), np.zeros(free.nv)])
    options = {"method": "RK45", "rtol": 1e-9, "atol": 1e-11, "t_eval": TIMES}
    return lambda: solve_ivp(derivative, (0.0, TIMES[-1]), start, **options).y[: free.nq].T
