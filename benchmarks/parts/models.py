"""One state of each model: q̈, D C g, σ, a step and derivatives, on both backends and in every peer, taken in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import cycle

import numpy as np

import ccpin
from benchmarks.measured import DRAKE, LCABA, MUJOCO, NATIVE, NUMPY, PINOCCHIO, Measured, Options, short_name
from benchmarks.peers import NotForThisError
from benchmarks.peers.drake import Drake
from benchmarks.peers.mujoco import MuJoCo
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import Place, difference, loaded, models_of, place
from benchmarks.timing import Timing, in_turn

PART = "models"
ACCELERATION, TERMS, SIGMA = "q̈ at a known q′", "D, C, g at a known q′", "σ from 1e-2 rad away"
WITH_SIGMA, STEP, DERIVATIVES = "q̈ with σ from 1e-2 rad away", "a step of 1 ms", "∂q̈ at a known q′"
KERNEL, ANEW = "kernel alone", "kernel, another q′ each time"
DIFFERENCES = "central differences, native"
ERROR = "q̈′ differs from the reference's by"
STEP_OF_DIFFERENCES = 1e-6  # rad, m: of central differences, near the cube root of a rounding
PERIOD, STRETCH = 1e-3, 20  # s a step, and steps before the motion begins anew
PEERS = {DERIVATIVES: (DERIVATIVES, PINOCCHIO), STEP: (STEP, MUJOCO)}
"""What ratios are to; otherwise Pinocchio's q̈."""

Call = tuple[str, str]  # quantity, who
Calls = dict[Call, Callable[[], object]]


def measure(options: Options) -> Iterator[Measured]:
    """All figures of every model there is."""
    for name in options.models:
        mechanism = loaded(name)
        if mechanism is None:
            yield Measured(PART, short_name(name), ACCELERATION, NATIVE, None, note="skipped: no such file")
        else:
            yield from figures(short_name(name), mechanism, options)


def figures(subject: str, mechanism: ccpin.Mechanism, options: Options) -> Iterator[Measured]:
    """The figures of one model."""
    models = models_of(mechanism)
    at = place(models[NUMPY])
    calls, notes = {}, dict[Call, str]()
    for who, model in models.items():
        calls |= {(quantity, who): call for quantity, call in ours(model, at).items()}
        if who == NATIVE:
            calls[ACCELERATION, KERNEL] = lambda core=model.core: core.forward_dynamics(at.q_free, at.v, at.u)
            calls[ACCELERATION, ANEW] = anew(model, at)  # what a State closes once is closed by each call
            calls[STEP, NATIVE] = Stepping(model, at)
    calls[DERIVATIVES, DIFFERENCES] = lambda: central_differences(next(iter(models.values())), at)
    others = list[Measured]()
    for who, (quantity, add) in PEER_CALLS.items():
        try:
            others += add(subject, mechanism, at, calls, notes)
        except NotForThisError as reason:
            others.append(Measured(PART, subject, quantity, who, None, note=str(reason)))
    times = in_turn(calls, options.rounds, options.slice_seconds)
    for (quantity, who), timing in times.items():
        peer = times.get(PEERS.get(quantity, (ACCELERATION, PINOCCHIO)))
        yield Measured(
            PART, subject, quantity, who, timing.seconds, "s", _ratio(timing, peer), notes.get((quantity, who), "")
        )
    yield from others


def ours(model: ccpin.ReducedModel, at: Place) -> dict[str, Callable[[], object]]:
    """ccpin's calls; a State keeps what it has computed, so D, C, g are asked of a new one each time."""
    state = model.at(at.q, at.q_free)
    new, point = type(state).of, state.point
    native = model.core.terms(at.q_free, at.v) is not None  # then one call gives all, whatever is kept
    return {
        ACCELERATION: lambda: state.forward_dynamics(at.v, at.u),
        TERMS: lambda: (state if native else new(model, state.q, point)).terms(at.v),
        SIGMA: lambda: model.sigma(at.q, at.near),
        WITH_SIGMA: lambda: model.forward_dynamics(at.q, at.v, at.u, at.near),
        DERIVATIVES: lambda: state.forward_dynamics_derivatives(at.v, at.u),
    }


def anew(model: ccpin.ReducedModel, at: Place) -> Callable[[], object]:
    """The kernel's q̈ at two closed configurations in turn."""
    core, places = model.core, cycle((at.q_free, at.near))
    return lambda: core.forward_dynamics(next(places), at.v, at.u)


class Stepping:
    """`Simulator.step` of 1 ms, error-controlled, with u held; back at the place after every twenty."""

    def __init__(self, model: ccpin.ReducedModel, at: Place) -> None:
        self.simulator, self.at, self.taken = ccpin.Simulator(model), at, STRETCH

    def __call__(self) -> None:
        """A step."""
        if self.taken == STRETCH:
            self.simulator.reset(self.at.q, self.at.v, near=self.at.q_free)
            self.taken = 0
        self.simulator.step(self.at.u, PERIOD)
        self.taken += 1


def central_differences(model: ccpin.ReducedModel, at: Place) -> np.ndarray:
    """[∂q̈/∂q ∂q̈/∂q̇ ∂q̈/∂u] by 2 (2n + motors) forward dynamics, each σ starting at the configuration itself."""
    h, move = STEP_OF_DIFFERENCES, model.coordinates.integrate
    pairs = [[(move(at.q, s * e), at.v, at.u) for s in (h, -h)] for e in np.eye(model.n)]
    pairs += [[(at.q, at.v + s * e, at.u) for s in (h, -h)] for e in np.eye(model.n)]
    pairs += [[(at.q, at.v, at.u + s * e) for s in (h, -h)] for e in np.eye(model.n_actuated)]
    found = [[model.forward_dynamics(*state, at.q_free) for state in pair] for pair in pairs]
    return np.array([(ahead - behind) / (2.0 * h) for ahead, behind in found]).T


def add_pinocchio(
    subject: str, mechanism: ccpin.Mechanism, at: Place, calls: Calls, notes: dict[Call, str]
) -> Iterator[Measured]:
    """Pinocchio's calls, and how far its q̈′ is from ours."""
    peer = Pinocchio(mechanism, at)
    peer.prepare_lcaba()
    calls |= {(ACCELERATION, PINOCCHIO): peer.acceleration, (ACCELERATION, LCABA): peer.lcaba}
    calls[DERIVATIVES, PINOCCHIO] = peer.derivatives
    notes |= {(ACCELERATION, PINOCCHIO): peer.note, (ACCELERATION, LCABA): peer.lcaba_note}
    for who, found in ((PINOCCHIO, peer.acceleration()), (LCABA, peer.lcaba())):
        yield Measured(PART, subject, ERROR, who, difference(found, at.a_free), "")


def add_mujoco(
    subject: str, mechanism: ccpin.Mechanism, at: Place, calls: Calls, notes: dict[Call, str]
) -> Iterator[Measured]:
    """`mj_forward` and `mj_step`; its loops are springs, so its q̈′ differs."""
    peer = MuJoCo(mechanism, at)
    calls |= {(ACCELERATION, MUJOCO): peer.forward, (STEP, MUJOCO): peer.step}
    yield Measured(PART, subject, ERROR, MUJOCO, difference(peer.forward(), at.a_free), "")


def add_drake(
    subject: str, mechanism: ccpin.Mechanism, at: Place, calls: Calls, notes: dict[Call, str]
) -> Iterator[Measured]:
    """A discrete step: Drake's loops exist in its SAP solver only."""
    calls[STEP, DRAKE] = Drake(mechanism, at).step
    yield from ()


PEER_CALLS = {
    PINOCCHIO: (ACCELERATION, add_pinocchio),
    MUJOCO: (ACCELERATION, add_mujoco),
    DRAKE: (STEP, add_drake),
}
"""What each peer is asked for first, and who adds its calls; raises a NotForThisError where it has none."""


def _ratio(timing: Timing, peer: Timing | None) -> float | None:
    return None if peer is None else timing.ratio(peer)
