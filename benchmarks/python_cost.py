"""σ, D C g and q̈ of the NumPy reference, as ratios to Pinocchio's constrained dynamics in the same run.

Usage: python -m benchmarks.python_cost [MODEL …]      (names of installed models, or files)
"""

import statistics
import sys
import time

import numpy as np
import pinocchio as pin

import ccpin

MODELS = ("rpdr", "delta", "stewart")
REPEATS, ROUNDS = 40, 9


def peer(mechanism, q_free, v_free, tau):
    """A call of Pinocchio's constrained dynamics with every loop as a 3d or 6d contact, tightly proximal."""
    model = mechanism.pin_model
    data, contacts = model.createData(), pin.StdVec_RigidConstraintModel()
    for closure in mechanism.closures:
        a, b = mechanism.tree.attachments[closure.link_a], mechanism.tree.attachments[closure.link_b]
        kind = pin.ContactType.CONTACT_3D if closure.kind == "spherical" else pin.ContactType.CONTACT_6D
        contacts.append(
            pin.RigidConstraintModel(
                kind,
                model,
                a.joint,
                pin.SE3(np.array(a.placement @ closure.placement_a)),
                b.joint,
                pin.SE3(np.array(b.placement @ closure.placement_b)),
                pin.ReferenceFrame.LOCAL,
            )
        )
    memory = pin.StdVec_RigidConstraintData()
    for contact in contacts:
        memory.append(contact.createData())
    pin.initConstraintDynamics(model, data, contacts, memory)
    settings = pin.ProximalSettings(1e-12, 1e-12, 10)
    return lambda: pin.constraintDynamics(model, data, q_free, v_free, tau, contacts, memory, settings)


def cost(calls):
    """Median processor seconds of each call, measured in turn so that drift of the machine's speed meets all alike."""
    samples = [[] for _ in calls]
    for _ in range(ROUNDS):
        for k, call in enumerate(calls):
            start = time.process_time()
            for _ in range(REPEATS):
                call()
            samples[k].append((time.process_time() - start) / REPEATS)
    return [statistics.median(sample) for sample in samples]


def main(names):
    """Print a row a model."""
    print(f"{'model':>24} {'peer µs':>8}   {'σ':>6} {'terms':>6} {'q̈':>6}   ratios to the peer; σ from 1e-2 rad away")
    for name in names:
        mechanism = ccpin.load(name)
        model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(7)
        q_free = mechanism.q_reference
        q = model.alpha(q_free)
        away = model.coordinates.integrate(q, 1e-2 * rng.uniform(-1, 1, model.n))
        guess = model.sigma(away, q_free)
        v, u = 0.1 * rng.standard_normal(model.n), 0.1 * rng.standard_normal(model.n_actuated)
        state = model.at(q, q_free)
        calls = [
            peer(mechanism, q_free, state.v_free(v), state.joint_efforts(u)),
            lambda: model.sigma(q, guess),  # noqa: B023
            lambda: model.terms(q, v, q_free),  # noqa: B023
            lambda: model.forward_dynamics(q, v, u, q_free),  # noqa: B023
        ]
        base, *ours = cost(calls)
        ratios = " ".join(f"{each / base:6.1f}" for each in ours)
        print(f"{str(name)[-24:]:>24} {1e6 * base:8.2f}   {ratios}")


if __name__ == "__main__":
    main(sys.argv[1:] or MODELS)
