"""How cost grows: n four-bars one on another, and side by side, up to 400 joints, with fitted exponents."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import ccpin
from benchmarks.measured import LCABA, MUJOCO, NATIVE, PINOCCHIO, Measured, Options
from benchmarks.parts.models import ACCELERATION, SIGMA, TERMS, ours
from benchmarks.peers import NotForThisError
from benchmarks.peers.mujoco import MuJoCo
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import Place, backends, model_on, place
from benchmarks.timing import exponent, in_turn, timed
from ccpin.description import MechanismDescription
from tests.support import families

PART, LOAD = "families", "load"
FAMILIES = {"serial": families.serial, "parallel": families.parallel}
QUANTITIES = (SIGMA, ACCELERATION, TERMS)
FEWEST, LARGE = 3, 24  # sizes that a fit needs; joints from which it is made, where that leaves as many
LOADS, LONG = 3, 2.0  # how often a load is timed, in all no longer than that many seconds
EXPONENT = "exponent of {}"


class Point(NamedTuple):
    """One figure of one member of a family."""

    quantity: str
    who: str
    joints: int
    seconds: float


def measure(options: Options) -> Iterator[Measured]:
    """Times of every member, then the exponents of their growth in joints."""
    for family, build in FAMILIES.items():
        points = list[Point]()
        for size in options.sizes:
            found = list(member(build(size), options))
            points += found
            for each in found:
                yield Measured(PART, f"{family}, {each.joints} joints", each.quantity, each.who, each.seconds)
        for quantity, who in dict.fromkeys((each.quantity, each.who) for each in points):
            mine = [each for each in points if (each.quantity, each.who) == (quantity, who)]
            large = [each for each in mine if each.joints >= LARGE]
            fitted = large if len(large) >= FEWEST else mine
            if len(fitted) >= FEWEST:
                joints = [each.joints for each in fitted]
                slope = exponent(joints, [each.seconds for each in fitted])
                note = f"{joints[0]} to {joints[-1]} joints"
                yield Measured(PART, family, EXPONENT.format(quantity), who, slope, "", note=note)


def member(description: MechanismDescription, options: Options) -> Iterator[Point]:
    """The figures of one member, all in turn, after its load."""
    mechanism, seconds = load(description)
    joints = mechanism.n_free
    yield Point(LOAD, "ccpin", joints, seconds)
    names = [name for name in backends() if name == NATIVE or joints <= options.numpy_joints]
    models = {name: model_on(name, mechanism) for name in names}
    if not models:
        return
    at = place(next(iter(models.values())))
    calls = {(q, who): call for who, model in models.items() for q, call in ours(model, at).items() if q in QUANTITIES}
    if joints <= options.peer_joints:
        calls |= {(ACCELERATION, who): call for who, call in peers(mechanism, at).items()}
    for (quantity, who), timing in in_turn(calls, options.rounds, options.slice_seconds).items():
        yield Point(quantity, who, joints, timing.seconds)


def load(description: MechanismDescription) -> tuple[ccpin.Mechanism, float]:
    """The mechanism, and the least CPU time of some loads."""
    mechanism, seconds = timed(lambda: ccpin.load(description))
    again = min(LOADS - 1, int(LONG / seconds))
    return mechanism, min([seconds, *(timed(lambda: ccpin.load(description))[1] for _ in range(again))])


def peers(mechanism: ccpin.Mechanism, at: Place) -> dict[str, Callable[[], object]]:
    """What else computes q̈′ of a member; MuJoCo where it is installed."""
    pinocchio = Pinocchio(mechanism, at)
    pinocchio.prepare_lcaba()
    calls: dict[str, Callable[[], object]] = {PINOCCHIO: pinocchio.acceleration, LCABA: pinocchio.lcaba}
    try:
        return calls | {MUJOCO: MuJoCo(mechanism, at).forward}
    except NotForThisError:
        return calls
