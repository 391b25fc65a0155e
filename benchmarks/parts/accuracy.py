"""How accurate the RPDR's reduced model is: against closed forms, other engines and energy. The worst of all samples.

The tests hold the same quantities to their limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import ccpin
from benchmarks.measured import Measured, Options
from benchmarks.subjects import difference, models_of
from tests.oracles import descriptor
from tests.oracles import rpdr as oracle
from tests.support.paper import GOAL, K_P, K_V, MODES, START, order, to_free

PART = "accuracy"
STATES, SWING_SECONDS = 1000, 60.0  # random states; a minute, in which drift of energy and closure shows
HANGING = np.radians([-82.180, -97.823])


def measure(options: Options) -> Iterator[Measured]:
    """Each backend against the closed forms; then the descriptor form, Pinocchio, and energy."""
    count = STATES if options.deep else 5
    models = models_of(ccpin.load("rpdr"))
    for who, model in models.items():
        for mode in MODES:
            for name, worst in closed_forms(model, mode, count).items():
                yield Measured(PART, f"rpdr, mode {mode:+d}", f"{name} against (31)–(40), relative", who, worst, "")
    who, model = next(iter(models.items()))
    for mode in MODES:
        for name, worst in engines(model, mode, max(2, count // 5)).items():
            yield Measured(PART, f"rpdr, mode {mode:+d}", name, who, worst, "")
    yield from move(model, who)
    yield from swing(model, who, SWING_SECONDS if options.deep else 0.1)


def closed_forms(model: ccpin.ReducedModel, mode: int, count: int) -> dict[str, float]:
    """Worst relative errors of σ, ρ, ρ̇, D, C, g against (31)-(40) at random states of one assembly mode."""
    columns, generator = order(model.mechanism), np.random.default_rng(50 + mode)
    worst: dict[str, float] = {}
    for expected in oracle.random_configurations(generator, count, mode):
        v = generator.normal(scale=3.0, size=2)
        terms = model.terms(expected[:2], v, to_free(model.mechanism, expected + 1e-3))
        mass, coriolis, gravity = oracle.reduced_terms(expected, v)
        pairs = {
            "σ": (terms.q_free[columns], expected),
            "ρ": (terms.rho[columns], oracle.rho(expected)),
            "ρ̇": (terms.rho_dot[columns], oracle.rho_dot(expected, v)),
            "D": (terms.D, mass),
            "C": (terms.C, coriolis),
            "g": (terms.g, gravity),
        }
        worst = {name: max(worst.get(name, 0.0), difference(*pair)) for name, pair in pairs.items()}
    return worst


def engines(model: ccpin.ReducedModel, mode: int, count: int) -> dict[str, float]:
    """Worst relative errors of q̈ and of φ_q′ᵀλ against a direct solution of (19) and Pinocchio's."""
    mechanism = model.mechanism
    spherical = replace(mechanism.description, closures=(replace(mechanism.closures[0], kind="spherical"),))
    generator, names = np.random.default_rng(60 + mode), mechanism.tree.names
    independent = [names.index(name) for name in mechanism.independent]
    worst_a = worst_force = 0.0
    for expected in oracle.random_configurations(generator, count, mode):
        v, u = generator.normal(scale=3.0, size=2), generator.normal(size=2)
        state = model.at(expected[:2], to_free(mechanism, expected))
        jacobian = mechanism.constraints().value(state.q_free).jacobian
        a, force = state.forward_dynamics(v, u), jacobian.T @ state.constraint_forces(v, u)
        for solve, description in ((descriptor.direct, mechanism.description), (descriptor.pinocchio, spherical)):
            arguments = (state.q_free, state.v_free(v), state.joint_efforts(u))
            other = solve(description, mechanism.pin_model, *arguments)
            worst_a = max(worst_a, difference(a, other.a_free[independent]))
            worst_force = max(worst_force, difference(force, other.force))
    kind = "against (19) and Pinocchio, relative"
    return {f"q̈ {kind}": worst_a, f"φ_q′ᵀλ {kind}": worst_force}


def move(model: ccpin.ReducedModel, who: str) -> Iterator[Measured]:
    """The paper's point-to-point move: closure, and how fast 𝒱 falls."""
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    motion = ccpin.simulate(model, law, START, duration=1.0)
    outside = np.abs(motion.q - GOAL).max(axis=1) > np.radians(2.0)
    lyapunov = [law.lyapunov(*state) for state in zip(motion.q, motion.v, motion.q_free, strict=True)]
    settled = float(motion.t[np.flatnonzero(outside)[-1] + 1])
    yield Measured(PART, "point to point", "within ±2° from … on", who, settled)
    yield Measured(PART, "point to point", "largest ‖φ‖", who, float(motion.closure_error.max()), "m")
    yield Measured(PART, "point to point", "largest increase of 𝒱, J", who, float(np.diff(lyapunov).max()), "")


def swing(model: ccpin.ReducedModel, who: str, duration: float) -> Iterator[Measured]:
    """Free swinging from 5° beside the rest: energy kept, relative to the swing's own."""
    start = HANGING + np.radians([5.0, 0.0])
    motion = ccpin.simulate(model, None, start, duration=duration, method="DOP853", sample_period=0.02)
    energy = np.array([sum(model.energy(*state)) for state in zip(motion.q, motion.v, motion.q_free, strict=True)])
    rest = sum(model.energy(HANGING, np.zeros(2)))
    drift = float(np.abs(energy - energy[0]).max()) / (energy[0] - rest)
    subject = f"{duration:g} s of swinging"
    yield Measured(PART, subject, "drift of energy, of the swing's", who, drift, "")
    yield Measured(PART, subject, "largest ‖φ‖", who, float(motion.closure_error.max()), "m")
