"""φ(q_j, y; p) of a transmission over many pairs at once: recorded with p as inputs, closed, and differentiated.

Of x = (q_j, y), the numbers that hold a configuration, y follows q_j and the geometry p by implicit differentiation,

    ∂y/∂q_j = −φ_y⁻¹ φ_q_j,    ∂y/∂p = −φ_y⁻¹ φ_p,

with the derivatives of the recorded rows, which are exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, solve_many
from ccpin.errors import CcpinError, ConvergenceError
from ccpin.programs.evaluation import values_of
from ccpin.programs.recording.constants import Constants, Parameter
from ccpin.programs.recording.recorded_mechanism import all_rows, closure_equations, independent_rows, numbering
from ccpin.programs.tape import Tape
from ccpin.transmission.transmission import Transmission

_MOST_STEPS = 12  # of Newton
_CLOSED = 1e-12  # of the extent, or rad


class ClosedPairs(NamedTuple):
    """N pairs of a geometry p, closed.

    Attributes:
        joints: q_j, of shape (N, n).
        x: The numbers of configurations, of shape (N, n_x).
        motors: q_m, of shape (N, n).
        by_joints: J = ∂q_m/∂q_j, of shape (N, n, n).
        by_numbers: ∂q_m/∂p, of shape (N, n, k).
        x_by_joints, x_by_numbers: The same of x.
        signs: Those of det φ_y, which no continuous motion changes, of shape (N,).
    """

    joints: Array
    x: Array
    motors: Array
    by_joints: Array
    by_numbers: Array
    x_by_joints: Array
    x_by_numbers: Array
    signs: Array


class GeometryEquations:
    """The equations of a transmission whose geometry has some numbers open.

    Args:
        transmission: The transmission.
        numbers: p.
    """

    def __init__(self, transmission: Transmission, numbers: Sequence[Parameter]) -> None:
        model = transmission.joint_model
        self._transmission, self._reference = transmission, model.mechanism.q_reference
        self._own = own = numbering(model, self._reference)
        size, k = len(own.near), len(numbers)
        tape = Tape(size + k)
        x, p = np.split(np.array(tape.inputs, dtype=object), [size])
        constants = Constants(model, dict(zip(numbers, p, strict=True)))
        rows = all_rows(tape, model, own, x, constants)
        phi = closure_equations(tape, own, x, [rows[row] for row in independent_rows(model, self._reference)[0]])
        slopes = [tape.derivative(phi, {column: 1}) for column in range(size + k)]
        self._code = tape.code([*phi, *(entry for column in slopes for entry in column)])
        self._shape = size + k + 1, len(phi)
        self._q, self._y = list(own.q.places), list(own.dependent)
        names = {joint.name: place for joint, place in zip(model.mechanism.tree.joints, own.joints, strict=True)}
        self._motors = [names[name].x.start for name in transmission.motors]
        self._tolerance = _CLOSED * max(1.0, model.mechanism.constraints().extent)

    def start(self, joints: Array) -> Array:
        """The numbers at joints' displacements of shape (N, n), of the file's geometry, on the reference's branch.

        Raises:
            ConvergenceError: It does not close at one of them, or a singular configuration is in the way.
        """
        side = self._transmission.joint_side
        try:
            found = self._transmission.joint_model.sigma_many(np.array([side.configuration(q) for q in joints]))
        except CcpinError as error:
            raise ConvergenceError(f"the stated linkage cannot be moved to all pairs: {error}") from error
        x = np.array([self._own.numbers(q_free) for q_free in found])
        x[:, self._q] = joints
        return x

    def closed(self, x: Array, p: Array, signs: Array | None = None) -> ClosedPairs:
        """Newton's method on y from numbers near by, q_j held.

        Raises:
            ConvergenceError: It does not settle at a pair, or on another branch than that of these signs.
        """
        x, n, size = x.copy(), len(self._q), len(self._own.near)
        for _ in range(_MOST_STEPS):
            with np.errstate(all="ignore"):  # what is not finite does not settle
                phi, slopes = self._at(x, p)
                step = solve_many(slopes[:, :, self._y], phi)
            x[:, self._y] -= step
            if np.abs(step).max(initial=0.0) <= self._tolerance:
                break
        else:
            raise ConvergenceError("the linkage does not close at a pair")
        _, slopes = self._at(x, p)
        own = np.sign(np.linalg.det(slopes[:, :, self._y]))
        if not own.all() or (signs is not None and (own != signs).any()):
            raise ConvergenceError("the linkage closes at a pair on another branch")
        right = np.concatenate([slopes[:, :, self._q], slopes[:, :, size:]], axis=2)
        by = np.zeros((len(x), size, right.shape[2]))
        by[:, self._y] = -np.linalg.solve(slopes[:, :, self._y], right)
        by[:, self._q, :n] = np.eye(n)
        moved = by[:, self._motors]
        return ClosedPairs(
            x[:, self._q], x, x[:, self._motors], moved[:, :, :n], moved[:, :, n:], by[:, :, :n], by[:, :, n:], own
        )

    def _at(self, x: Array, p: Array) -> tuple[Array, Array]:
        """φ, of shape (N, m), and its derivatives by x and p, (N, m, n_x + k)."""
        values = values_of(self._code, [*x.T, *p], np)
        found = np.array([np.broadcast_to(values[place], len(x)) for place in self._code.outputs])
        table = found.reshape(*self._shape, len(x))
        return table[0].T, np.moveaxis(table[1:], 2, 0).transpose(0, 2, 1)
