"""φ and its derivatives over balls, by products of rotations.

The closures meant are those of the mechanism whose rotations and axes are orthogonal and of unit length and lie within
2⁻⁵⁰ of the document's numbers, entry by entry; everything else is taken exactly as written.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.reading import Array, Integers, SerialChain, StatedClosures

_NEAR = arb(0, 2.0**-50)  # how far the mechanism's axes and rotations may be from the document's (above)


class JointTurn(NamedTuple):
    """One joint of a chain: the frame before it, and its axis k as a column, as [k]× and as [k]×²."""

    joint: int
    rotation: arb_mat
    translation: arb_mat
    axis: arb_mat
    skew: arb_mat
    square: arb_mat
    prismatic: bool


class Path(NamedTuple):
    """A chain in balls."""

    turns: tuple[JointTurn, ...]
    tip: arb_mat
    direction: bool
    weights: arb_mat


class TipMotion(NamedTuple):
    """A chain's tip x, and by joint its number, a, ∂x/∂θ and whether it slides."""

    x: arb_mat
    joints: tuple[tuple[int, arb_mat, arb_mat, bool], ...]


def exact(values: Array) -> arb_mat:
    """A matrix of doubles, as they are; a vector as a column."""
    rows = np.asarray(values, dtype=np.float64)
    rows = rows[:, None] if rows.ndim == 1 else rows
    return arb_mat(*rows.shape, [arb(float(x)) for x in rows.ravel()])


def cross(a: arb_mat, b: arb_mat) -> arb_mat:
    """a × b of columns."""
    x, y, z, u, v, w = a[0, 0], a[1, 0], a[2, 0], b[0, 0], b[1, 0], b[2, 0]
    return arb_mat(3, 1, [y * w - z * v, z * u - x * w, x * v - y * u])


class BallEquations(Protocol):
    """Rows of equations of some coordinates θ, over balls: what Theorem N and gluing speak of."""

    m: int
    n_free: int

    def motions(self, theta: list[arb]) -> Any:
        """What all that follows is made of."""

    def value(self, theta: list[arb], motions: Any) -> arb_mat:
        """The rows, (m, 1)."""

    def jacobian(self, motions: Any) -> arb_mat:
        """Their derivatives, (m, n′)."""

    def variation(self, motions: Any, direction: list[arb]) -> arb_mat:
        """The derivatives of these along a direction, (m, n′)."""

    def at(self, theta: Array) -> tuple[Array, Array]:
        """The rows and their derivatives in plain floating point."""


class BallClosures:
    """φ of a document."""

    def __init__(self, document: StatedClosures) -> None:
        self.m, self.n_free = document.couplings.shape
        self.paths = tuple(_path(chain) for chain in document.chains)
        self.couplings, self.offset = exact(document.couplings), exact(document.offset)
        self.moduli = document.moduli

    def motions(self, theta: list[arb]) -> list[TipMotion]:
        """The chains at θ, balls."""
        return [motion_of(path, theta) for path in self.paths]

    def value(self, theta: list[arb], motions: list[TipMotion]) -> arb_mat:
        """φ."""
        phi = self.couplings * arb_mat(self.n_free, 1, theta) + self.offset
        for row in np.flatnonzero(self.moduli):
            modulus = float(self.moduli[row])
            phi[int(row), 0] = phi[int(row), 0] - arb(modulus) * round(float(phi[int(row), 0].mid()) / modulus)
        for path, motion in zip(self.paths, motions, strict=True):
            phi = phi + path.weights * motion.x
        return phi

    def jacobian(self, motions: list[TipMotion]) -> arb_mat:
        """φ_θ, (m, n′)."""
        total = arb_mat(self.couplings)
        for path, motion in zip(self.paths, motions, strict=True):
            for joint, _, along, _ in motion.joints:
                self._add(total, joint, path.weights * along)
        return total

    def variation(self, motions: list[TipMotion], direction: list[arb]) -> arb_mat:
        """Σ_c ∂φ_θ/∂θ_c · d_c along a direction d, with the second derivatives that the motions have: (m, n′).

        ∂²x/∂θ_i∂θ_j = a_i × ∂x/∂θ_j for i ≤ j along a chain, so that the a_i d_i above a joint are summed first (moves
        that cancel do so exactly), and likewise the ∂x/∂θ_j d_j below it.
        """
        total = arb_mat(self.m, self.n_free)
        for path, motion in zip(self.paths, motions, strict=True):
            turning, changes = arb_mat(3, 1), []
            for joint, axis, along, slides in motion.joints:
                if not slides:
                    turning = turning + axis * direction[joint]
                changes.append(cross(turning, along))
            moving = arb_mat(3, 1)
            for k in range(len(motion.joints) - 1, -1, -1):
                joint, axis, along, slides = motion.joints[k]
                self._add(total, joint, path.weights * (changes[k] if slides else changes[k] + cross(axis, moving)))
                moving = moving + along * direction[joint]
        return total

    def second_variation(self, motions: list[TipMotion], one: list[arb], other: list[arb]) -> arb_mat:
        """Σ_bc ∂²φ_θ/∂θ_b∂θ_c · w_b d_c along two directions w and d: (m, n′).

        The derivative along d of what `variation` sums along w: an axis a moves by (Σ a d above it) × a, a column
        ∂x/∂θ by what `variation` says.
        """
        total = arb_mat(self.m, self.n_free)
        for path, motion in zip(self.paths, motions, strict=True):
            turned, first, second, mixed = (arb_mat(3, 1) for _ in range(4))
            passed = []
            for joint, axis, _, slides in motion.joints:
                moved = cross(second, axis)
                if not slides:
                    first, second = first + axis * one[joint], second + axis * other[joint]
                    mixed = mixed + moved * one[joint]
                passed.append((first, second, mixed, moved))
            below, beside = arb_mat(3, 1), arb_mat(3, 1)
            for k in range(len(motion.joints) - 1, -1, -1):
                joint, axis, along, slides = motion.joints[k]
                first, second, mixed, moved = passed[k]
                changed = cross(second, along)
                bent = cross(mixed, along)
                if not slides:
                    changed = changed + cross(axis, beside)
                    bent = bent + cross(moved, below) + cross(axis, turned)
                self._add(total, joint, path.weights * (bent + cross(first, changed)))
                turned = turned + changed * one[joint]
                below, beside = below + along * one[joint], beside + along * other[joint]
        return total

    def _add(self, total: arb_mat, column: int, what: arb_mat) -> None:
        for row in range(self.m):
            total[row, column] = total[row, column] + what[row, 0]

    def at(self, theta: Array) -> tuple[Array, Array]:
        """φ (m,) and φ_θ (m, n′) in plain floating point, to find what balls then prove."""
        balls = [arb(float(x)) for x in theta]
        motions = self.motions(balls)
        return floats(self.value(balls, motions))[:, 0], floats(self.jacobian(motions))


def columns(matrix: arb_mat, chosen: Integers) -> arb_mat:
    """Some columns of a matrix."""
    numbers = [int(c) for c in chosen]
    entries = [matrix[i, j] for i in range(matrix.nrows()) for j in numbers]
    return arb_mat(matrix.nrows(), len(numbers), entries)


def floats(matrix: arb_mat) -> Array:
    """The middles of a matrix of balls."""
    values = [float(matrix[i, j].mid()) for i in range(matrix.nrows()) for j in range(matrix.ncols())]
    return np.array(values).reshape(matrix.nrows(), matrix.ncols())


def inverse_of(matrix: Array) -> arb_mat | None:
    """About the inverse of a matrix, as doubles; ``None``: it has none."""
    try:
        return exact(np.linalg.inv(matrix).astype(np.float64))
    except np.linalg.LinAlgError:
        return None


def _path(chain: SerialChain) -> Path:
    turns = []
    for k, joint in enumerate(chain.joints):
        x, y, z = (arb(float(v)) + _NEAR for v in chain.axes[k])
        skew = arb_mat(3, 3, [arb(0), -z, y, z, arb(0), -x, -y, x, arb(0)])
        rotation = exact(chain.rotations[k])
        if not np.array_equal(chain.rotations[k], np.eye(3)):
            rotation = arb_mat(3, 3, [entry + _NEAR for entry in rotation.entries()])
        axis = arb_mat(3, 1, [x, y, z])
        translation = exact(chain.translations[k])
        turns.append(JointTurn(int(joint), rotation, translation, axis, skew, skew * skew, bool(chain.prismatic[k])))
    return Path(tuple(turns), exact(chain.tip), chain.direction, exact(chain.weights))


def motion_of(path: Path, theta: list[arb]) -> TipMotion:
    """A chain at θ. What lies behind a joint is summed from the tip: it knows nothing of what lies before it."""
    R, passed = exact(np.eye(3)), []
    for turn in path.turns:
        step = R * turn.translation
        R = R * turn.rotation
        axis, angle = R * turn.axis, theta[turn.joint]
        if turn.prismatic:
            step = step + axis * angle
        else:
            sine, cosine = angle.sin_cos()
            R = R + R * (turn.skew * sine + turn.square * (1 - cosine))
        passed.append((turn.joint, axis, step, turn.prismatic))
    x = R * path.tip
    joints = []
    for joint, axis, step, slides in reversed(passed):
        carried = arb_mat(3, 1) if path.direction else axis
        joints.append((joint, axis, carried if slides else cross(axis, x), slides))
        x = x if path.direction else x + step
    return TipMotion(x, tuple(reversed(joints)))
