"""The compiled core beside Pinocchio's own constrained dynamics, in one process, the Python call included.

    python benchmarks/native_core.py [model …] [--json FILE]

Each figure is the median over rounds of CPU time, ours and Pinocchio's taken in turn within a round, so that a busy
machine slows both alike. Pinocchio solves for q̈ at a known q′ (`constraintDynamics`, proximal); the core is asked for
the same, for D, C and g, for σ from 1e-2 away, for batches with that σ in them, and for derivatives.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

import ccpin
from ccpin import native

MODELS = ("rpdr", "four_bar", "delta", "stewart")
ROUNDS, CALLS, BATCH = 25, 150, 1000


class Pinocchio:
    """`constraintDynamics` and its derivatives for a mechanism's loops, as point contacts (5-row loops too)."""

    def __init__(self, mechanism: ccpin.Mechanism) -> None:
        self.model = mechanism.pin_model
        self.contacts, self.memory = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop in mechanism.constraints().loops:
            ends = (loop.joint_a, pin.SE3(loop.frame_a), loop.joint_b, pin.SE3(loop.frame_b))
            kind = pin.ContactType.CONTACT_3D
            self.contacts.append(pin.RigidConstraintModel(kind, self.model, *ends, pin.ReferenceFrame.LOCAL))
            self.memory.append(self.contacts[-1].createData())
        self.data = self.model.createData()
        self.settings = pin.ProximalSettings(1e-12, 1e-10, 5)
        pin.initConstraintDynamics(self.model, self.data, self.contacts, self.memory)

    def acceleration(self, q_free: np.ndarray, v_free: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """q̈′ at a known q′."""
        arguments = (q_free, v_free, tau, self.contacts, self.memory, self.settings)
        return pin.constraintDynamics(self.model, self.data, *arguments)

    def derivatives(self, q_free: np.ndarray, v_free: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, ...]:
        """q̈′ and the contact forces by q′, q̇′ and τ′."""
        self.acceleration(q_free, v_free, tau)
        return pin.computeConstraintDynamicsDerivatives(self.model, self.data, self.contacts, self.memory)


def seconds(call: Callable[[], object], calls: int) -> float:
    """CPU time of one call."""
    began = time.process_time()
    for _ in range(calls):
        call()
    return (time.process_time() - began) / calls


def costs(name: str) -> dict[str, dict[str, float]]:
    """Microseconds, and the ratio to Pinocchio's, of every figure for one model."""
    mechanism = ccpin.load(name)
    model, kernel, rng = ccpin.ReducedModel(mechanism), native.kernel(mechanism), np.random.default_rng(0)
    if kernel is None:
        raise SystemExit(native.backend().reason)
    n, peer = model.n, Pinocchio(mechanism)
    q = model.alpha(mechanism.q_reference)
    q_free, near = model.sigma(q), model.sigma(q + 1e-2 / np.sqrt(n))
    v, u = rng.normal(size=n), rng.normal(size=model.n_actuated)
    v_free, tau = model.rho(q_free) @ v, model.at(q, q_free).joint_efforts(u)
    steps = rng.normal(size=(BATCH, n))
    Q = q + 1e-2 * steps / np.linalg.norm(steps, axis=1)[:, None]
    V, U = rng.normal(size=(BATCH, n)), rng.normal(size=(BATCH, model.n_actuated))
    peers = {
        "acceleration": (lambda: peer.acceleration(q_free, v_free, tau), CALLS),
        "derivatives": (lambda: peer.derivatives(q_free, v_free, tau), CALLS // 4),
    }
    ours = {
        "acceleration": ("acceleration", lambda: kernel.forward_dynamics(q_free, v, u), CALLS, 1),
        "D, C, g": ("acceleration", lambda: kernel.terms(q_free, v), CALLS, 1),
        "sigma from 1e-2": ("acceleration", lambda: kernel.sigma(q, near), CALLS, 1),
        "batch with sigma": ("acceleration", lambda: kernel.forward_dynamics_many(Q, V, U, q_free), 1, BATCH),
        "derivatives": ("derivatives", lambda: kernel.forward_dynamics_derivatives(q_free, v, u), CALLS // 4, 1),
    }
    taken = {key: np.empty(ROUNDS) for key in ours}
    ratios = {key: np.empty(ROUNDS) for key in ours}
    pinocchio = np.empty(ROUNDS)
    for k in range(ROUNDS):
        theirs = {key: seconds(call, calls) for key, (call, calls) in peers.items()}
        for key, (peer_key, call, calls, rows) in ours.items():
            taken[key][k] = seconds(call, calls) / rows
            ratios[key][k] = taken[key][k] / theirs[peer_key]
        pinocchio[k] = theirs["acceleration"]
    found = {"constraintDynamics": {"us": 1e6 * float(np.median(pinocchio)), "ratio": 1.0}}
    return found | {
        key: {"us": 1e6 * float(np.median(taken[key])), "ratio": float(np.median(ratios[key]))} for key in ours
    }


def main() -> None:
    """Print one table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("models", nargs="*", default=MODELS)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = {Path(name).stem: costs(name) for name in options.models}
    columns = list(next(iter(table.values())))
    print(f"{'µs (ratio)':14s}" + "".join(f"{column:>20s}" for column in columns))
    for name, row in table.items():
        print(f"{name:14s}" + "".join(f"{row[c]['us']:12.2f} ({row[c]['ratio']:.2f})".rjust(20) for c in columns))
    if options.json:
        options.json.write_text(json.dumps(table, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
