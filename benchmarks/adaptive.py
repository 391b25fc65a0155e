"""Tracking with masses that are wrong: `python -m benchmarks.adaptive [--runs N] [--gain G] [--figure FILE]`.

The RPDR follows a smooth reference at 1 kHz. What the laws take for true is its drawing; the robot's links are 30 %
heavier and lighter. `AdaptiveTracking`, which learns a factor of each link, stands beside PD+ of the same feedback
(K_p = KΛ, K_v = K) and computed torque (K_p = Λ², K_v = 2Λ), of the drawing and of the robot. Told: RMS and peak of the
joints' errors over the whole time, and over the second half.

What a second of it takes is told of the RPDR, a Delta and the ankle of two rods, every link's factor learnt: whole in
the compiled core, stepped in Python over the core's q̈, and by the NumPy reference alone.

Then N robots (1,000), each with factors of its own anywhere in the box and a start of its own, a second each, in lanes
of a compiled program, and a tenth of them in the core as well: how far V = ½ sᵀD s + ½ π̃ᵀΓ⁻¹π̃ ever is above
V(0) − ∫ sᵀK s dt, and above what it was before. In continuous time it never is; with a period T it may be, by what goes
to 0 with T: it is told for three periods.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import ccpin
from benchmarks.measured import NATIVE, NUMPY
from benchmarks.subjects import backend
from ccpin.control import ComputedTorque, PDPlus, Sampling, Waypoints
from ccpin.identification import AdaptiveTracking, with_constants
from ccpin.programs import compiled, configuration, record

PERIOD, SLOPE, K, GAMMA, SHARE = 1e-3, 20.0, 0.5, 5000.0, 0.4
TRUE = np.array([1.3, 0.7, 0.7, 1.3])  # factors of link1, link3, link2, link4
LEGS = np.array([[0.45, -0.35], [-0.1, 0.3], [0.4, 0.2], [-0.3, -0.35], [0.25, -0.1], [0.0, 0.0]])
LEG, ROUNDS = 0.25, 4
PACED = {"rpdr": 1.0, "delta": 0.2, str(Path(__file__).parents[1] / "docs" / "howto" / "ankle.urdf"): 0.3}  # how far


def main(arguments: list[str] | None = None) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser("python -m benchmarks.adaptive", description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--gain", type=float, default=GAMMA)
    parser.add_argument("--figure", type=Path)
    asked = parser.parse_args(arguments)
    law = adaptive(ccpin.ReducedModel(ccpin.load("rpdr")), PERIOD, asked.gain)
    motions = tracked(law)
    if asked.figure is not None:
        drawn(law, motions).savefig(asked.figure, dpi=110)
    paces()
    if asked.runs:
        rises(law, asked.runs, asked.gain)


def adaptive(model: ccpin.ReducedModel, period: float, gain: float, size: float = 1.0) -> AdaptiveTracking:
    """The law, that knows nothing but the drawing at first."""
    start = model.alpha(model.mechanism.q_reference)
    legs = size * np.take(LEGS, np.arange(model.n) % 2, axis=1)
    places = np.vstack([start, start + np.tile(legs, (ROUNDS, 1))])
    reference = Waypoints(model, LEG * np.arange(len(places)), places)
    learnt = {"gain": gain, "adapted": "body", "bounds": SHARE}
    return AdaptiveTracking(model, reference, SLOPE, np.full(model.n, K), period=period, **learnt)


def tracked(law: AdaptiveTracking) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times, errors and, of the adaptive law, estimates of all laws."""
    drawing, reference = law.model, law.reference
    robot = ccpin.ReducedModel(ccpin.load(with_constants(drawing, law.constants(TRUE))))
    found = dict[str, tuple[np.ndarray, np.ndarray]]()
    gains = {"PD+": (PDPlus, K * SLOPE, K), "computed torque": (ComputedTorque, SLOPE**2, 2.0 * SLOPE)}
    for name, (kind, K_p, K_v) in gains.items():
        for whose, model in (("the drawing's", drawing), ("the robot's", robot)):
            other = kind(model, reference, K_p=K_p, K_v=K_v)
            motion = ccpin.simulate(
                robot, other, law.near.q, duration=reference.duration, sample_period=PERIOD, sampling=Sampling(PERIOD)
            )
            goals = np.array([reference.at(t).q for t in motion.t])
            found[f"{name}, {whose} masses"] = motion.q - goals, np.empty(0)
    found["adaptive"] = learning(law, robot)
    print(f"RPDR at {1 / PERIOD:g} Hz, {reference.duration:g} s, errors of the joints in mrad")
    print(f"{'':36s} {'RMS':>8s} {'peak':>8s} {'RMS':>8s} {'peak':>8s}")
    print(f"{'':36s} {'all':>17s} {'second half':>17s}")
    for name, (errors, _) in found.items():
        parts = (1e3 * errors, 1e3 * errors[len(errors) // 2 :])
        told = [f"{value:8.3f}" for e in parts for value in (np.sqrt((e**2).mean()), np.abs(e).max())]
        print(f"{name:36s} {' '.join(told)}", flush=True)
    return found


def learning(law: AdaptiveTracking, robot: ccpin.ReducedModel) -> tuple[np.ndarray, np.ndarray]:
    """Errors and estimates at all samples."""
    motion = ccpin.simulate(robot, law, law.near.q, duration=law.reference.duration, sample_period=law.period)
    told = law.estimates(motion)
    return told.e, told.values


def paces() -> None:
    """CPU time of a simulated second, least of three."""
    print(f"{'':12s} ms of a processor for a simulated second at {1 / PERIOD:g} Hz (links learnt)")
    print(f"{'':12s} {'core':>8s} {'Python over the core':>22s} {'NumPy':>8s}")
    for name, size in PACED.items():
        spent, count = [], 0
        for which, whole, duration in ((NATIVE, True, 1.0), (NATIVE, False, 0.2), (NUMPY, True, 0.02)):
            with backend(which):
                mechanism = ccpin.load(name)
                own = ccpin.load(mechanism.description, independent=mechanism.actuated)
                law = adaptive(ccpin.ReducedModel(own), PERIOD, 500.0, size)
            count, times = len(law.adapted), []
            for _ in range(3):
                simulator = ccpin.Simulator(law.model, law)
                simulator.reset(law.near.q)
                began = time.process_time()
                if whole:
                    simulator.run(duration)
                else:
                    simulator.advance(duration)
                times.append((time.process_time() - began) / duration)
            spent.append(1e3 * min(times))
        print(f"{Path(name).stem:12s} {spent[0]:8.0f} {spent[1]:22.0f} {spent[2]:8.0f}   {count} links", flush=True)


def rises(law: AdaptiveTracking, runs: int, gain: float) -> None:
    """How far V is above what it was before, for three periods."""
    draw = np.random.default_rng(0)
    true = draw.uniform(law.lower, law.upper, (runs, len(law.adapted)))
    away = draw.uniform(-1.0, 1.0, (2, runs, law.model.n))
    for period in (PERIOD, PERIOD / 2, PERIOD / 4):
        own, some = adaptive(law.model, period, gain), -(-runs // 10)
        for where, along, count in (("lanes", lyapunov_in_lanes, runs), ("the core", lyapunov_in_core, some)):
            began = time.process_time()
            V, taken = along(own, true[:count], 0.05 * away[0, :count], 0.5 * away[1, :count])
            rise = (V - np.minimum.accumulate(V, axis=0)).max()
            spent = 0.5 * period * np.cumsum(taken[1:] + taken[:-1], axis=0)
            above = (V[1:] - (V[0] - spent)).max()
            print(
                f"V at {V.size} samples, {1 / period:g} Hz, {count} robots in {where}, "
                f"{time.process_time() - began:.1f} s: at most {V[0].max():.3g} J at first and {V[-1].max():.3g} J at "
                f"last; above V(0) - int s'Ks dt by {above:.2e} J at most, above what it was before by {rise:.2e} J at "
                "most",
                flush=True,
            )


def lyapunov_in_core(
    law: AdaptiveTracking, true: np.ndarray, q_off: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """V and sᵀK s of a second of many robots, each a model of its own, of shape (samples, runs) each."""
    found, taken = [], []
    for theta, off, rate in zip(true, q_off, v, strict=True):
        robot = ccpin.ReducedModel(ccpin.load(with_constants(law.model, law.constants(theta))))
        motion = ccpin.simulate(robot, law, law.near.q + off, rate, duration=1.0, sample_period=law.period)
        told, D = law.estimates(motion), robot.terms_many(motion.q, motion.v).D
        s, away = told.s, told.values - theta
        found.append(0.5 * np.einsum("si,sij,sj->s", s, D, s) + 0.5 * (away**2 / law.gain).sum(axis=1))
        taken.append(np.einsum("si,ij,sj->s", s, law.K, s))
    return np.array(found).T[:-1], np.array(taken).T[:-1]


def lyapunov_in_lanes(
    law: AdaptiveTracking, true: np.ndarray, q_off: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """V and sᵀK s of a second of many robots, of shape (samples, runs) each."""
    model, reference = law.model, law.reference
    links = tuple(f"mass:{name.partition(':')[2]}" for name in law.adapted)
    own = compiled(law.program())
    step, mass = (compiled(record(model, what, parameters=links, near=law.near)) for what in ("step", "mass"))
    masses = true * np.array([model.parameters.values[model.parameters.names.index(name)] for name in links])
    starts = [configuration(model.at(law.near.q + off, law.near), law.near) for off in q_off]
    q, y = (np.array([start[name] for start in starts]) for name in ("q", "y"))
    estimate, found, taken = np.tile(law.initial, (len(true), 1)), [], []
    for k in range(round(1.0 / law.period)):
        wanted = reference.at(k * law.period)
        D, status = mass(q, y, masses)
        s = v - wanted.v + (q - wanted.q) @ law.slope.T
        off = estimate - true
        found.append(0.5 * np.einsum("si,sij,sj->s", s, D, s) + 0.5 * (off**2 / law.gain).sum(axis=1))
        taken.append(np.einsum("si,ij,sj->s", s, law.K, s))
        u, estimate, told = own(q, y, v, *wanted, estimate)
        q, y, v, done = step(q, y, v, u, masses, np.array([law.period]))
        if (status != 0).any() or (told != 0).any() or (done != 0).any():
            raise RuntimeError("a motion left its branch")
    return np.array(found), np.array(taken)


def drawn(law: AdaptiveTracking, motions: dict[str, Any]) -> Figure:
    """Errors of the worse joint, and estimates beside the truth."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    for name in ("PD+, the drawing's masses", "PD+, the robot's masses", "adaptive"):
        errors = motions[name][0]
        above.plot(law.period * np.arange(len(errors)), 1e3 * np.abs(errors).max(axis=1), label=name, lw=1.0)
    above.set_ylabel("largest |e|, mrad")
    above.legend(loc="upper right", fontsize="small", framealpha=1.0)
    estimates = motions["adaptive"][1]
    for k, name in enumerate(law.adapted):
        (line,) = below.plot(law.period * np.arange(len(estimates)), estimates[:, k], label=name, lw=1.2)
        below.axhline(TRUE[k], color=line.get_color(), ls=":", lw=1.0)
    below.set_ylabel("factor learnt (dotted: true)")
    below.set_xlabel("t, s")
    below.set_ylim(law.lower.min(), law.upper.max() + 0.15)
    below.legend(loc="upper center", ncols=4, fontsize="small")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    main()
