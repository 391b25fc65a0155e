"""What claims about identification are about: closed motions of a mechanism, its bodies' twists, and its structure.

Whether they are a mechanism's is not asked here: theorems are about these numbers, which cannot change.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

from ccpin.dynamics.parameters import BODY
from ccpin.identification.combinations.vanishing import ClosedEnds, JoinedBody, identities
from ccpin.programs.instructions import Code
from ccpin.programs.recording.recorded_tree import Table
from ccpin.proof.digests import digest
from ccpin.proof.facts import known, require
from ccpin.validated.arithmetic.balls import Ball, ball, flint
from ccpin.validated.arithmetic.programs import require_program, words
from ccpin.validated.arithmetic.series import values
from ccpin.validated.loop_equations import ClosedLoopEquations

_ROTOR, _DAMPER, _FRICTION, _SPRING, _OFFSET = range(5)  # a joint's own constants, in order


class Seen(NamedTuple):
    """What a configuration shows, in balls.

    Bodies' twists for each unit q̇, then for each virtual motion, gravity in their axes; joints' rates alike, ρ to begin
    with; and stretches.
    """

    twists: list[list[list[Ball]]]
    gravity: list[list[Ball]]
    rho: list[list[Ball]]
    stretches: list[list[Ball]]


@known
@dataclass(frozen=True, eq=False)
class IdentificationEquations:
    """A mechanism's closures as programs over (x, q̇), and what of its motions the constants π stand beside.

    Attributes:
        loop: Its closures.
        motions: Twists of each body for unit q̇ and virtual motions one after the other (linear, angular, about its
            origin in its axes), gravity in its axes, ρ and the joints' virtual rates row by row, and the displacements
            of joints that can have springs.
        bodies: The bodies and joints.
        ends: Closures over which inertia may be handed.
        gravity: In world axes.
        virtual: How many virtual motions there are: what is measured besides u is the work of it along them.
        held: Whether the wrench that holds the world is measured.
    """

    loop: ClosedLoopEquations
    motions: Code
    bodies: tuple[JoinedBody, ...]
    ends: tuple[ClosedEnds, ...]
    gravity: tuple[Fraction, ...]
    virtual: int = 0
    held: bool = False

    def __post_init__(self) -> None:
        require(type(self.loop) is ClosedLoopEquations, "no closures")
        require_program(self.motions, self.loop.field.inputs)
        require([type(part) is tuple for part in (self.bodies, self.ends, self.gravity)], "what could be changed")
        require([type(body) is JoinedBody for body in self.bodies], "bodies that are none")
        require([0 <= body.parent <= k for k, body in enumerate(self.bodies)], "a body before the one that carries it")
        require([type(each) is ClosedEnds for each in self.ends], "closures that are none")
        require([0 <= end <= len(self.bodies) for each in self.ends for end in each[:2]], "a closure of no body")
        require(type(self.virtual) is int and self.virtual >= 0 and type(self.held) is bool, "sensors that are none")
        freedoms, columns = sum(len(body.slides) for body in self.bodies), self.loop.n + self.virtual
        stretches = sum(self.stretched)
        due = len(self.bodies) * (6 * columns + 3) + freedoms * columns + stretches
        require(len(self.motions.outputs) == due, "motions of other bodies")

    @property
    def sizes(self) -> Mapping[str, int]:
        """P: how many constants."""
        return {"P": BODY * len(self.bodies) + sum(len(body.kinds) for body in self.bodies)}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all programs and numbers."""
        structure = self.bodies, self.ends, self.gravity, self.virtual, self.held
        return digest((self.loop.digest, repr(words(self.motions)), repr(structure)))

    @cached_property
    def identities(self) -> Table:
        """Combinations without effect that structure shows, of shape (K, p)."""
        return identities(self.bodies, self.ends, self.gravity, self.held)

    def forms(self, state: Sequence[Ball]) -> list[list[Ball]]:
        """Linear forms of π at a state (x, q̇), of length p each: they vanish on every z with Y z ≡ 0.

        Entries of D, of g, of the dampers' ρᵀBρ, and of friction along q̇.
        """
        n, columns = self.loop.n, range(self.loop.n + self.virtual)
        seen, v = self.seen(state), state[self.loop.n_x : self.loop.n_x + n]
        nothing = [ball(0)] * (BODY * len(self.bodies))
        ways = [_sign(sum((a * b for a, b in zip(row, v, strict=False)), ball(0))) for row in seen.rho]
        rubbed = [[*row, way] for row, way in zip(seen.rho, ways, strict=True)]
        friction = [self._form(nothing, seen._replace(rho=rubbed), _FRICTION, (i, len(columns))) for i in columns]
        return [*self.smooth_forms(seen), *friction]

    @property
    def stretched(self) -> list[int]:
        """By how many numbers each joint's spring is stretched."""
        return [*map(_stretched, self.bodies)]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """(i, j) of the entries of D and B, i ≤ j; i also a virtual motion, j not."""
        n = self.loop.n
        return [(i, j) for i in range(n + self.virtual) for j in range(i if i < n else 0, n)]

    def smooth_forms(self, seen: Seen) -> list[list[Ball]]:
        """Those of D, of g and of the dampers, which know no signs."""
        masses = [self._form(_masses(seen, i, j), seen, _ROTOR, (i, j)) for i, j in self.pairs]
        weights = [self._form(_weights(seen, i), seen, _SPRING, (i,)) for i in range(self.loop.n + self.virtual)]
        nothing = [ball(0)] * (BODY * len(self.bodies))
        dampers = [self._form(nothing, seen, _DAMPER, pair) for pair in self.pairs]
        return [*masses, *weights, *dampers]

    @property
    def frictions(self) -> list[tuple[int, tuple[int, ...]]]:
        """Of each joint where its Coulomb level stands among the constants, and its rates among those of all joints."""
        found, place, rate = list[tuple[int, tuple[int, ...]]](), BODY * len(self.bodies), 0
        for body in self.bodies:
            found.append((place + _FRICTION, tuple(range(rate, rate + len(body.slides)))))
            place, rate = place + len(body.kinds), rate + len(body.slides)
        return found

    def _form(self, bodies: Sequence[Ball], seen: Seen, kind: int, axes: tuple[int, ...]) -> list[Ball]:
        """A form's entries of bodies, and of the joints: ρ_i ρ_j summed of one kind, or a pull along ρ_i of springs."""
        found, stretches = list(bodies), iter(seen.stretches)
        place = 0
        for body in self.bodies:
            rows = seen.rho[place : place + len(body.slides)]
            place += len(body.slides)
            own = [ball(0)] * len(body.kinds)
            pulled = next(stretches) if _stretched(body) else []
            if kind != _SPRING:
                own[kind] = sum((row[axes[0]] * row[axes[1]] for row in rows), ball(0))
            elif pulled:
                own[_SPRING] = sum((row[axes[0]] * s for row, s in zip(rows, pulled, strict=True)), ball(0))
                if len(own) > _OFFSET:
                    own[_OFFSET] = -rows[0][axes[0]]
            found += own
        return found

    def seen(self, state: Sequence[Ball]) -> Seen:
        """What a configuration shows, over a box of its numbers."""
        return self.arranged(values(self.motions, self.loop.at_rest(state)))

    def arranged(self, outputs: Sequence[Ball]) -> Seen:
        """The outputs of `motions`."""
        n, count = self.loop.n + self.virtual, len(self.bodies)
        told: Iterator[Ball] = iter(outputs)

        def table(rows: int, columns: int) -> list[list[Ball]]:
            return [[next(told) for _ in range(columns)] for _ in range(rows)]

        twists = [table(n, 6) for _ in range(count)]
        gravity = table(count, 3)
        rho = table(sum(len(body.slides) for body in self.bodies), n)
        return Seen(twists, gravity, rho, [table(1, k)[0] for k in self.stretched if k])


def _stretched(body: JoinedBody) -> int:
    """How many numbers a joint's spring is stretched by: of a ball three, 0 where it can have none."""
    return len(body.slides) if len(body.kinds) > _SPRING else 0


def _masses(seen: Seen, i: int, j: int) -> list[Ball]:
    """G_iᵀ M G_j by the ten numbers of each body."""
    found = list[Ball]()
    for twists in seen.twists:
        (v, w), (a, b) = ((twists[k][:3], twists[k][3:]) for k in (i, j))
        cross = [x + y for x, y in zip(_cross(v, b), _cross(a, w), strict=True)]
        found += [sum((x * y for x, y in zip(v, a, strict=True)), ball(0)), *cross]
        for k, m in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)):
            found.append(w[k] * b[k] if k == m else w[k] * b[m] + w[m] * b[k])
    return found


def _weights(seen: Seen, i: int) -> list[Ball]:
    """∂V/∂q_i by the ten numbers of each body: −γ·(m v + ω × h), gravity γ in its axes."""
    found = list[Ball]()
    for twists, gravity in zip(seen.twists, seen.gravity, strict=True):
        v, w = twists[i][:3], twists[i][3:]
        found += [-sum((x * y for x, y in zip(gravity, v, strict=True)), ball(0)), *(-x for x in _cross(gravity, w))]
        found += [ball(0)] * 6
    return found


def _cross(a: Sequence[Ball], b: Sequence[Ball]) -> list[Ball]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _sign(x: Ball) -> Ball:
    """±1, or all between where a ball holds 0."""
    return ball(1) if x > 0 else ball(-1) if x < 0 else flint().arb(0, 1)
