"""The two sides of a transmission: the joints of the serial robot, and the motors; named, or found where evident."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, records
from ccpin.errors import IndependentSetError, SingularConfigurationError
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.mechanism.mechanism import Mechanism

_SINGULAR = 1e-9  # of the largest singular value of the rates: what measures no better measures nothing


class Sides(NamedTuple):
    """Names of the joints and of the motors' joints, as many each as there are motions."""

    joints: tuple[str, ...]
    motors: tuple[str, ...]


class Side:
    """Joints of one freedom each, whose displacements are plain numbers: of a continuous joint its angle.

    Args:
        mechanism: The mechanism.
        names: The joints.

    Attributes:
        coordinates: α of these joints.
        slides: Which of them slide.
        units: rad or m of each.
        rows: Where their velocities stand in q̇′.
    """

    def __init__(self, mechanism: Mechanism, names: tuple[str, ...]) -> None:
        self.names = names
        self.coordinates = IndependentCoordinates(mechanism.tree, names, mechanism.q_reference)
        self.slides = tuple(part.slides[0] for part in self.coordinates.parts)
        self.units = tuple("m" if slides else "rad" for slides in self.slides)
        self.rows = np.array([part.v_free.start for part in self.coordinates.parts], dtype=np.intp)
        self._circles = [part for part in self.coordinates.parts if part.whole is not None]

    def positions(self, q: Array) -> Array:
        """Displacements of coordinates as the model has them, of shape (n,), rad or m; circles in (−π, π]."""
        if not self._circles:
            return q
        found = np.empty(self.coordinates.n)
        for part in self.coordinates.parts:
            found[part.v] = np.arctan2(q[part.q][1], q[part.q][0]) if part.whole is not None else q[part.q]
        return found

    def configuration(self, positions: Array) -> Array:
        """The coordinates as the model has them, of displacements of shape (n,)."""
        if not self._circles:
            return positions
        q = np.empty(self.coordinates.nq)
        for part in self.coordinates.parts:
            angle = positions[part.v]
            q[part.q] = [np.cos(angle[0]), np.sin(angle[0])] if part.whole is not None else angle
        return q


def sides_of(mechanism: Mechanism, joints: Sequence[str] | None, motors: Sequence[str] | None) -> Sides:
    """The sides as they are named; what is not named as far as it is evident.

    Motors are those that the file states. Joints are the independent coordinates where these are not the motors; else
    the joints of that end of each loop (or coupling) which no motor moves, of several loops those that they share where
    all are too many, and motors that are in no loop.

    Raises:
        IndependentSetError: There are not as many as motions, a joint has other than one freedom, or the joints or
            motors do not measure the motion.
    """
    stated = mechanism.actuated if mechanism.description.actuated or mechanism.independent != mechanism.actuated else ()
    driven = stated if motors is None else records(motors, "motors", str)
    _check(mechanism, "motors", driven)
    if joints is not None:
        led = records(joints, "joints", str)
    elif set(mechanism.independent) != set(driven):
        led = mechanism.independent
    else:
        led = _serial(mechanism, set(driven), mechanism.n)
    _check(mechanism, "joints", led)
    return Sides(tuple(led), tuple(driven))


def _serial(mechanism: Mechanism, motors: set[str], n: int) -> tuple[str, ...]:
    """Joints at the ends of loops that no motor moves, and motors in no loop, in the tree's order."""
    times, looped = Counter[str](), set[str]()
    for ends in _ends(mechanism):
        looped.update(*ends)
        free = [end for end in ends if end and not motors.intersection(end)]
        if len(free) == 1:
            times.update(free[0])
    found = {*times} | (motors - looped)
    if len(found) > n:
        found = {name for name, number in times.items() if number > 1} | (motors - looped)
    return tuple(name for name in mechanism.tree.names if name in found)


def _ends(mechanism: Mechanism) -> Iterator[tuple[list[str], ...]]:
    """The two ends of each loop, as joints from where they part; what a coupling relates: with motors, and without."""
    tree, motors = mechanism.tree, set(mechanism.actuated)
    for closure in mechanism.closures:
        ways = []
        for link in (closure.link_a, closure.link_b):
            way, number = [], tree.attachments[link].joint
            while number:
                way.append(tree.joints[number - 1].name)
                number = tree.joints[number - 1].parent
            ways.append(way)
        shared = set(ways[0]).intersection(ways[1])
        yield tuple([name for name in way if name not in shared] for way in ways)
    for coupling in mechanism.couplings:
        names = [term.joint for term in coupling.terms]
        yield [n for n in names if n in motors], [n for n in names if n not in motors]


def _check(mechanism: Mechanism, side: str, names: tuple[str, ...]) -> None:
    """Raise where a side is none.

    Raises:
        IndependentSetError: It is none; the message names candidates.
    """
    tree, n = mechanism.tree, mechanism.n
    candidates = [
        j.name for j in tree.joints if j.kind.nv == 1 and (side == "motors") == (j.name in mechanism.actuated)
    ]
    known = f"name {n} by {side}=…; candidates: {', '.join(candidates) or 'none'}"
    if len(names) != n:
        whole = [j for j in tree.joints if j.kind.nv > 1 and j.name in mechanism.independent]
        if whole:
            raise IndependentSetError(
                f"'{whole[0].name}' is a motion of {whole[0].kind.nv} freedoms: a transmission stands on a fixed base, "
                "its joints have one freedom each: lock it, or load the robot without it"
            )
        found = ", ".join(names) or "none"
        raise IndependentSetError(f"a transmission of {n} motions has {n} {side}; evident or named: {found}. {known}")
    coordinates = IndependentCoordinates(tree, tuple(names), mechanism.q_reference)
    for part in coordinates.parts:
        if len(part.slides) != 1 or part.kind.nv != 1:
            raise IndependentSetError(f"'{part.name}' is no joint of one freedom; {known}")
    try:
        rho = mechanism.parametrization().at(mechanism.q_reference).rho
    except SingularConfigurationError:
        return  # said where a posture is asked for
    sizes = np.linalg.svd(coordinates.jacobian(mechanism.q_reference) @ rho, compute_uv=False)
    if n and sizes[-1] <= _SINGULAR * sizes[0]:
        raise IndependentSetError(f"{', '.join(names)} do not measure the motion at the reference; {known}")
