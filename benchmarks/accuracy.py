"""How accurate the reduced model is on the RPDR, in figures: against closed forms, other engines and energy.

Run from the project's root with the test extra installed: ``python -m benchmarks.accuracy``. Every figure is the worst
of its samples; the tests hold the same quantities to their limits.
"""

from dataclasses import replace

import numpy as np

import ccpin
from tests.oracles import descriptor
from tests.oracles import rpdr as oracle

COUNT = 1000
START, GOAL = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])
HANGING = np.radians([-82.180, -97.823])
GAINS = ([11.0, 11.0], [0.65, 0.60])


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference relative to the largest entry."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def closed_forms(model: ccpin.ReducedModel, mode: int) -> dict[str, float]:
    """Worst relative errors of σ, ρ, ρ̇, D, C, g against (31)-(40) at random states of one assembly mode."""
    names = list(model.mechanism.pin_model.names)[1:]
    columns = [names.index(name) for name in oracle.FREE]
    generator = np.random.default_rng(50 + mode)
    worst = dict.fromkeys(("sigma", "rho", "rho_dot", "D", "C", "g"), 0.0)
    for expected in oracle.random_configurations(generator, COUNT, mode):
        v = generator.normal(scale=3.0, size=2)
        guess = np.empty(4)
        guess[columns] = expected + 1e-3
        terms = model.terms(expected[:2], v, guess)
        mass, coriolis, gravity = oracle.reduced_terms(expected, v)
        pairs = {
            "sigma": (terms.q_free[columns], expected),
            "rho": (terms.rho[columns], oracle.rho(expected)),
            "rho_dot": (terms.rho_dot[columns], oracle.rho_dot(expected, v)),
            "D": (terms.D, mass),
            "C": (terms.C, coriolis),
            "g": (terms.g, gravity),
        }
        for name, pair in pairs.items():
            worst[name] = max(worst[name], relative(*pair))
    return worst


def engines(model: ccpin.ReducedModel, mode: int) -> tuple[float, float]:
    """Worst relative errors of q̈ and of φ_q′ᵀλ against a direct solution of (19) and Pinocchio's."""
    mechanism = model.mechanism
    spherical = replace(mechanism.description, closures=(replace(mechanism.closures[0], kind="spherical"),))
    generator = np.random.default_rng(60 + mode)
    names = list(mechanism.pin_model.names)[1:]
    columns = [names.index(name) for name in oracle.FREE]
    worst_a = worst_force = 0.0
    for expected in oracle.random_configurations(generator, 200, mode):
        v, u = generator.normal(scale=3.0, size=2), generator.normal(size=2)
        q_free = np.empty(4)
        q_free[columns] = expected
        point = model.at(expected[:2], q_free)
        a = model.forward_dynamics(expected[:2], v, u, q_free)
        force = mechanism.constraints().value(point.q_free).jacobian.T @ model.constraint_forces(
            expected[:2], v, u, q_free
        )
        for solve, description in ((descriptor.direct, mechanism.description), (descriptor.pinocchio, spherical)):
            tau = point.joint_efforts(u)
            other = solve(description, mechanism.pin_model, point.q_free, point.rho @ v, tau)
            worst_a = max(worst_a, relative(a, other.a_free[[names.index(name) for name in mechanism.independent]]))
            worst_force = max(worst_force, relative(force, other.force))
    return worst_a, worst_force


def main() -> None:
    """Print every figure."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    for mode in (1, -1):
        worst = closed_forms(model, mode)
        print(f"mode {mode:+d}, {COUNT} states, relative: " + ", ".join(f"{k} {e:.1e}" for k, e in worst.items()))
        print("  against (19) and Pinocchio, 200 states: q̈ {:.1e}, φ_q′ᵀλ {:.1e}".format(*engines(model, mode)))
    law = ccpin.control.PDSimpleGravity(model, GOAL, *GAINS)
    motion = ccpin.simulate(model, law, START, duration=1.0)
    finer = ccpin.simulate(model, law, START, duration=1.0, rtol=5e-10, atol=5e-12)
    outside = np.abs(motion.q - GOAL).max(axis=1) > np.radians(2.0)
    lyapunov = [law.lyapunov(*state) for state in zip(motion.q, motion.v, motion.q_free, strict=True)]
    print(f"point to point: within ±2° from {motion.t[np.flatnonzero(outside)[-1] + 1]:.3f} s on")
    print(f"  ‖φ‖ ≤ {motion.closure_error.max():.1e}")
    print(f"  halving the tolerance moves samples by {np.abs(finer.q - motion.q).max():.1e} rad")
    print(f"  𝒱 from {lyapunov[0]:.3f} J, largest increase {np.diff(lyapunov).max():.1e} J")
    start = HANGING + np.radians([5.0, 0.0])
    swing = ccpin.simulate(model, None, start, duration=60.0, method="DOP853", sample_period=0.02)
    energy = np.array([sum(model.energy(*state)) for state in zip(swing.q, swing.v, swing.q_free, strict=True)])
    rest = sum(model.energy(HANGING, np.zeros(2)))
    drift = np.abs(energy - energy[0]).max()
    swung = drift / (energy[0] - rest)
    print(f"60 s of swinging: energy drift {swung:.1e} of the swing's, {drift / abs(energy[0]):.1e} of E")
    print(f"  ‖φ‖ ≤ {swing.closure_error.max():.1e}")


if __name__ == "__main__":
    main()
