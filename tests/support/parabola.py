"""Closed loops small enough to know everything of: σ(q) = √q of φ = y² − q, σ(q) = c q, and plain linear ones."""

from types import SimpleNamespace

import numpy as np

from ccpin.programs.instructions import Code
from ccpin.programs.tape import Tape
from ccpin.validated.arithmetic.programs import in_balls
from ccpin.validated.loop_equations import ClosedLoopEquations


def parabola():
    """Y² = q; q̈ = y q̇, so F(q, v) = (v, √q v)."""
    tape = Tape(3)
    q, y, v = tape.inputs
    speed = tape.solve([[2 * y]], [[v]])[0, 0]
    return loop(tape, 2, 1, [y * y - q], [v, speed, y * v])


def lines(*slopes):
    """X_k = c_k q for dependent coordinates."""
    tape = Tape(2 + len(slopes))
    q, *x, v = tape.inputs
    slopes = [exact(c) for c in slopes]
    return loop(
        tape,
        1 + len(slopes),
        1,
        [a - q * c for a, c in zip(x, slopes, strict=True)],
        [v, *(v * c for c in slopes), q * 0 + v],
    )


def linear(stiffness, damping):
    """Nothing depends: q̈ = −Kq − Cv."""
    n = len(stiffness)
    tape = Tape(2 * n)
    q, v = tape.inputs[:n], tape.inputs[n:]
    pull = [
        sum((x * exact(-K[k]) for k, x in enumerate(q)), 0) + sum((x * exact(-C[k]) for k, x in enumerate(v)), 0)
        for K, C in zip(stiffness, damping, strict=True)
    ]
    return loop(tape, n, n, [], [*v, *pull])


def circle(measured):
    """A point that goes round q² + y² = 1 evenly, measured by q (0) or by y (1): singular where the other is 0."""
    tape = Tape(3)
    *x, v = tape.inputs
    own, other = x[measured], x[1 - measured]
    rate = tape.solve([[other]], [[own * v * -1]])[0, 0]
    rates = [None, None]
    rates[measured], rates[1 - measured] = v, rate
    fall = (v * v + rate * rate) * own * -1
    closure, jacobian = in_balls(tape, [x[0] * x[0] + x[1] * x[1] - 1]), in_balls(tape, [other * 2])
    programs = {"field": [*rates, fall], "drift": [*rates, 0], "energies": [v * v + rate * rate, 0]}
    recorded = {name: in_balls(tape, outputs) for name, outputs in programs.items()}
    return ClosedLoopEquations(2, 1, (measured,), closure=closure, jacobian=jacobian, free="circle", **recorded)


class KnownLoop(SimpleNamespace):
    """What a `ClosedLoop` and its equations tell, as far as it is asked for."""

    at_rest = ClosedLoopEquations.at_rest
    at_a_sample = ClosedLoopEquations.at_a_sample

    @property
    def equations(self):
        return self

    own = equations


def equations(one, **more):
    """The equations of such a loop as claims are about them; nothing but what is asked for is regular or not."""
    inputs = one.field.inputs
    rest = {
        "jacobian": Code(inputs, inputs, (), ()),
        "drift": Code(inputs, inputs, (), (0,) * inputs),
        "energies": Code(inputs, inputs, (), (0, 0)),
        "efforts": one.efforts,
        "left_out": one.left_out,
    }
    return ClosedLoopEquations(one.n_x, one.n, one.independent, one.field, one.closure, **rest | more)


def exact(value):
    from ccpin.programs.recording.recorded_tree import rational

    return rational(value)


def loop(tape, n_x, n, closure, field, **more):
    """A closed loop of recorded rows and rates; the first n numbers are q."""
    known = {
        "wrapped": (),
        "upright": (),
        "efforts": None,
        "turns": (),
        "left_out": None,
        "scalar": True,
    }
    return KnownLoop(
        n_x=n_x,
        n=n,
        independent=tuple(range(n)),
        dependent=tuple(range(n, n_x)),
        closure=in_balls(tape, closure),
        field=in_balls(tape, field),
        near=np.zeros(n_x),
        **known | more,
    )
