"""One step of the motion with u held, on a tape: Runge and Kutta's of order 4 over (x, q̇), and closed at its end.

    ẋ = Γ(x) ρ(x) q̇ (13),    q̈ = D⁻¹(ρᵀSᵀu − C q̇ − damping q̇ − g) (22)

are smooth beside the closed configurations too, on which the order rests. A step leaves them by no more than its own
error, O(h⁵); one Newton step of φ(q, y) = 0 in y takes that to O(h¹⁰), and its length says whether h was too long.
"""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ccpin.programs.program_sources import slopes_of
from ccpin.programs.quantities import QUANTITIES, TapedModel
from ccpin.programs.recording.recorded_tree import Table, rational
from ccpin.programs.tape import Expression, Tape

RATES = ("x_rate", "forward_dynamics")


class Step(NamedTuple):
    """What a step leads to, and the Newton step at its end."""

    q: Table
    y: Table
    v: Table
    correction: Table


def stepped(scene: TapedModel, tape: Tape, at: dict[str, Table]) -> Step:
    """The step on a tape from "q", "y", "v" with "u" held over "h", of shape (1,), and parameters "p" if any."""
    own, n, given = scene.own, scene.model.n, scene.inputs
    rates = scene.tape.code([entry for name in RATES for entry in QUANTITIES[name].record(scene)])
    closure = scene.tape.code(scene.recorded.closure)
    size, h, half = len(own.near), at["h"][0], rational(0.5)
    x = np.zeros(size, dtype=object)
    x[list(own.q.places)], x[list(own.dependent)] = at["q"], at["y"]

    def arguments(x: Table, v: Table) -> list[Expression]:
        held = {"x": x, "v": v, "u": at["u"], "a": np.zeros(n, dtype=object), "p": at.get("p", given["p"])}
        return [entry for name in given for entry in held[name]]

    def slope(x: Table, v: Table) -> tuple[Table, Table]:
        found = np.array(tape.inlined(rates, arguments(x, v)), dtype=object)
        return found[:size], found[size:]

    v = at["v"]
    first = slope(x, v)
    second = slope(x + first[0] * (h * half), v + first[1] * (h * half))
    third = slope(x + second[0] * (h * half), v + second[1] * (h * half))
    fourth = slope(x + third[0] * h, v + third[1] * h)
    ends = [
        start + (a + (b + c) * 2 + d) * (h * Fraction(1, 6))
        for start, a, b, c, d in zip((x, v), first, second, third, fourth, strict=True)
    ]
    x, v = _of_unit_length(scene, ends[0]), ends[1]
    at_end, m = arguments(x, v), len(own.dependent)
    rows = np.array(tape.inlined(closure, at_end), dtype=object)
    matrix = np.array(tape.inlined(slopes_of(closure, own.dependent), at_end), dtype=object).reshape(m, m)
    correction = tape.solve(matrix, rows[:, None])[:, 0]
    return Step(x[list(own.q.places)], x[list(own.dependent)] - correction, v, correction)


def _of_unit_length(scene: TapedModel, x: Table) -> Table:
    """The numbers with the quaternions among q a Newton step of |p|² = 1 along p nearer to unit length."""
    x, places = x.copy(), set(scene.own.q.places)
    for joint in scene.own.joints:
        if joint.kind.unit == 4 and joint.x.stop - 1 in places:
            p = x[joint.x.stop - 4 : joint.x.stop]
            x[joint.x.stop - 4 : joint.x.stop] = p * ((3 - p @ p) * rational(0.5))
    return x
