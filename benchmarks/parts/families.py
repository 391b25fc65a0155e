"""How cost grows: n four-bars one on another, and side by side, up to 400 joints, with fitted exponents.

All members of a family are taken in turn, each round is fitted for itself, and the exponent is the rounds' median.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

import ccpin
from benchmarks.measured import LCABA, MUJOCO, NATIVE, PINOCCHIO, Measured, Options
from benchmarks.parts.models import ACCELERATION, SIGMA, TERMS, ours
from benchmarks.peers import NotForThisError
from benchmarks.peers.mujoco import MuJoCo
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import Place, backends, model_on, place
from benchmarks.timing import Timing, exponent, in_turn, timed
from ccpin import MechanismDescription
from tests.support import families

PART, LOAD, WHO = "families", "load", "ccpin"
FAMILIES = {"serial": families.serial, "parallel": families.parallel}
QUANTITIES = (SIGMA, ACCELERATION, TERMS)
FEWEST, LARGE = 3, 24  # sizes that a fit needs; joints from which it is made, where that leaves as many
EXPONENT = "exponent of {}"


class Key(NamedTuple):
    """Which figure of which member."""

    joints: int
    quantity: str
    who: str


def measure(options: Options) -> Iterator[Measured]:
    """Times of every member, then the exponents of their growth in joints."""
    for family, build in FAMILIES.items():
        times, calls = dict[Key, Timing](), dict[Key, Callable[[], object]]()
        for size in options.sizes:
            mechanism, timing = load(build(size), options.rounds)
            times[Key(mechanism.n_free, LOAD, WHO)] = timing
            calls |= member(mechanism, options)
        times |= in_turn(calls, options.rounds, options.slice_seconds)
        for key in sorted(times, key=lambda key: key.joints):
            peer = times.get(Key(key.joints, ACCELERATION, PINOCCHIO)) if key.quantity in QUANTITIES else None
            ratio = None if peer is None else times[key].ratio(peer)
            subject = f"{family}, {key.joints} joints"
            yield Measured(PART, subject, key.quantity, key.who, times[key].seconds, "s", ratio)
        yield from exponents(family, times)


def load(description: MechanismDescription, rounds: int) -> tuple[ccpin.Mechanism, Timing]:
    """The mechanism, and its loads' CPU time."""
    found = [timed(lambda: ccpin.load(description)) for _ in range(rounds)]
    return found[0][0], Timing(np.array([seconds for _, seconds in found]))


def member(mechanism: ccpin.Mechanism, options: Options) -> dict[Key, Callable[[], object]]:
    """What is timed of one member."""
    joints = mechanism.n_free
    names = [name for name in backends() if name == NATIVE or joints <= options.numpy_joints]
    models = {name: model_on(name, mechanism) for name in names}
    if not models:
        return {}
    at = place(next(iter(models.values())))
    calls = {
        Key(joints, quantity, who): call
        for who, model in models.items()
        for quantity, call in ours(model, at).items()
        if quantity in QUANTITIES
    }
    if joints > options.peer_joints:
        return calls
    return calls | {Key(joints, ACCELERATION, who): call for who, call in peers(mechanism, at).items()}


def peers(mechanism: ccpin.Mechanism, at: Place) -> dict[str, Callable[[], object]]:
    """What else computes q̈′ of a member; MuJoCo where it is installed."""
    pinocchio = Pinocchio(mechanism, at)
    pinocchio.prepare_lcaba()
    calls: dict[str, Callable[[], object]] = {PINOCCHIO: pinocchio.acceleration, LCABA: pinocchio.lcaba}
    try:
        return calls | {MUJOCO: MuJoCo(mechanism, at).forward}
    except NotForThisError:
        return calls


def exponents(family: str, times: Mapping[Key, Timing]) -> Iterator[Measured]:
    """One for each quantity of each who has enough sizes."""
    for quantity, who in dict.fromkeys((key.quantity, key.who) for key in times):
        mine = {key.joints: timing for key, timing in times.items() if (key.quantity, key.who) == (quantity, who)}
        large = {joints: timing for joints, timing in mine.items() if joints >= LARGE}
        fitted = large if len(large) >= FEWEST else mine
        if len(fitted) >= FEWEST:
            joints = [*fitted]
            rounds = np.array([timing.samples for timing in fitted.values()]).T
            slope = float(np.median([exponent(joints, seconds) for seconds in rounds]))
            subject = f"{family}, {joints[0]} to {joints[-1]} joints"
            yield Measured(PART, subject, EXPONENT.format(quantity), who, slope, "")
