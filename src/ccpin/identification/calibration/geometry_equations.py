"""φ(q, y; p) of a mechanism over many poses at once: recorded with p as inputs, closed, and differentiated.

Of x = (q, y), the numbers that hold a configuration, y follows q and the geometry p by implicit differentiation,

    ∂y/∂q = −φ_y⁻¹ φ_q,    ∂y/∂p = −φ_y⁻¹ φ_p,    d h(x, p) = h_x dx + h_p dp,

with the derivatives of the recorded rows, and of what is seen of a configuration, h, which are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, solve_many
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError, ConvergenceError
from ccpin.kinematics.tree import Tree
from ccpin.programs.evaluation import values_of
from ccpin.programs.instructions import Code
from ccpin.programs.recording.constants import Constants, Parameter
from ccpin.programs.recording.recorded_mechanism import (
    Numbering,
    all_rows,
    closure_equations,
    independent_rows,
    numbering,
)
from ccpin.programs.recording.recorded_tree import ExactJoint, Table, exact, exact_placement, poses
from ccpin.programs.tape import Expression, Tape

_MOST_STEPS = 12  # of Newton
_CLOSED = 1e-12  # of the extent, or rad


class OpenGeometry(NamedTuple):
    """A mechanism of open geometry on a tape, of which sensors take what they see.

    Attributes:
        tape: The tape.
        tree: The mechanism's tree.
        joints: Its joints, with places in x.
        x: The numbers.
        bodies: Poses of joints' bodies, by number.
    """

    tape: Tape
    tree: Tree
    joints: Sequence[ExactJoint]
    x: Table
    bodies: dict[int, Table]

    def displacement(self, joint: str) -> Expression:
        """Of a joint of one freedom, rad or m."""
        return self.x[self.joints[self.tree.joint(joint).number - 1].x.start]

    def pose(self, link: str, point: ArrayLike) -> tuple[Table, Table]:
        """Where a point of a link is, of shape (3,), and its axes as columns, (3, 3), in the world."""
        attached = self.tree.attachments[link]
        whole = self.bodies[attached.joint] @ exact_placement(attached.placement)
        return whole[:3, :3] @ exact(point) + whole[:3, 3], whole[:3, :3]


class ClosedPoses(NamedTuple):
    """N poses of a geometry p, closed.

    Attributes:
        x: The numbers of configurations, of shape (N, n_x).
        x_by_q, x_by_numbers: ∂x/∂q and ∂x/∂p, of shape (N, n_x, n) and (N, n_x, k).
        seen: h, of shape (N, w).
        by_q, by_numbers: dh/dq and dh/dp, of shape (N, w, n) and (N, w, k).
        signs: Those of det φ_y, which no continuous motion changes, of shape (N,).
    """

    x: Array
    x_by_q: Array
    x_by_numbers: Array
    seen: Array
    by_q: Array
    by_numbers: Array
    signs: Array


class GeometryEquations:
    """The equations of a mechanism whose geometry has some numbers open.

    Args:
        model: The model, whose coordinates are plain numbers or angles on circles.
        numbers: p.
        watch: h, of the mechanism recorded.
    """

    def __init__(
        self, model: ReducedModel, numbers: Sequence[Parameter], watch: Callable[[OpenGeometry], Sequence[Expression]]
    ) -> None:
        reference = model.mechanism.q_reference
        self._model, self._own = model, numbering(model, reference)
        own, size, k = self._own, len(self._own.near), len(numbers)
        tape = Tape(size + k)
        x, p = np.split(np.array(tape.inputs, dtype=object), [size])
        constants = Constants(model, dict(zip(numbers, p, strict=True)))
        rows = all_rows(tape, model, own, x, constants)
        phi = closure_equations(tape, own, x, [rows[row] for row in independent_rows(model, reference)[0]])
        joints = constants.joints(own.joints)
        seen = list(watch(OpenGeometry(tape, model.mechanism.tree, joints, x, poses(tape, joints, x))))
        self._q, self._y = list(own.q.places), list(own.dependent)
        self._newton = _WithSlopes(tape, phi, self._y)
        self._whole = _WithSlopes(tape, [*phi, *seen], range(size + k))
        self._tolerance = _CLOSED * max(1.0, model.mechanism.constraints().extent)

    @property
    def numbering(self) -> Numbering:
        """How x holds a configuration."""
        return self._own

    def start(self, q: Array) -> Array:
        """The numbers at displacements q of shape (N, n), of the file's geometry, on the reference's branch.

        Raises:
            ConvergenceError: It does not close at one of them, or a singular configuration is in the way.
        """
        try:
            found = self._model.sigma_many(coordinates_at(self._model, q))
        except CcpinError as error:
            raise ConvergenceError(f"the stated linkage cannot be moved to all poses: {error}") from error
        x = np.array([self._own.numbers(q_free) for q_free in found])
        x[:, self._q] = q
        return x

    def closed(self, x: Array, p: Array, signs: Array | None = None) -> ClosedPoses:
        """Newton's method on y from numbers near by, q held.

        Raises:
            ConvergenceError: It does not settle at a pose, or on another branch than that of these signs.
        """
        x, n, size, m = x.copy(), len(self._q), len(self._own.near), len(self._y)
        for _ in range(_MOST_STEPS):
            with np.errstate(all="ignore"):  # what is not finite does not settle
                phi, slopes = self._newton.at(x, p)
                step = solve_many(slopes, phi)
            x[:, self._y] -= step
            if np.abs(step).max(initial=0.0) <= self._tolerance:
                break
        else:
            raise ConvergenceError("the linkage does not close at a pose")
        values, slopes = self._whole.at(x, p)
        phi_y = slopes[:, :m, self._y]
        own = np.sign(np.linalg.det(phi_y))
        if not own.all() or (signs is not None and (own != signs).any()):
            raise ConvergenceError("the linkage closes at a pose on another branch")
        right = np.concatenate([slopes[:, :m, self._q], slopes[:, :m, size:]], axis=2)
        by = np.zeros((len(x), size, right.shape[2]))
        by[:, self._y] = -np.linalg.solve(phi_y, right)
        by[:, self._q, :n] = np.eye(n)
        moved = slopes[:, m:, :size] @ by
        moved[:, :, n:] += slopes[:, m:, size:]
        return ClosedPoses(x, by[:, :, :n], by[:, :, n:], values[:, m:], moved[:, :, :n], moved[:, :, n:], own)


def coordinates_at(model: ReducedModel, q: Array) -> Array:
    """The coordinates as a model has them, of joints' displacements of shape (N, n): of a circle (cos, sin)."""
    columns = list[Array]()
    for part in model.coordinates.parts:
        moved = q[:, part.v]
        columns += [np.cos(moved), np.sin(moved)] if part.whole is not None else [moved]
    return np.concatenate(columns, axis=1)


class _WithSlopes:
    """Expressions and their derivatives by some inputs, over many rows."""

    def __init__(self, tape: Tape, expressions: Sequence[Expression], columns: Sequence[int]) -> None:
        slopes = [tape.derivative(expressions, {column: 1}) for column in columns]
        self._code: Code = tape.code([*expressions, *(entry for column in slopes for entry in column)])
        self._shape = len(slopes) + 1, len(expressions)

    def at(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Values, of shape (N, e), and derivatives, (N, e, columns)."""
        values = values_of(self._code, [*x.T, *p], np)
        found = np.array([np.broadcast_to(values[place], len(x)) for place in self._code.outputs])
        table = found.reshape(*self._shape, len(x))
        return table[0].T, np.moveaxis(table[1:], 2, 0).transpose(0, 2, 1)
