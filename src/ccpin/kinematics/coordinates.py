"""The independent coordinates q = α(q′) (7), with α_q′ and its rate.

A joint named as independent contributes its whole configuration to q and its velocity to v: an angle or a length
for 1-dof joints, (cosine, sine) for a continuous joint, a unit quaternion for a spherical one. A single
component of a multi-dof joint is named ``joint:axis`` (rx, ry, rz for rotations, tx, ty, tz for translations);
its coordinate is the component of the rotation vector log(R_refᵀ R) from the reference configuration, or of the
position in the joint's own frame, and its velocity is that coordinate's rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import IndependentSetError
from ccpin.kinematics.tree import Tree

COMPONENTS: dict[str, tuple[str, ...]] = {
    "spherical": ("rx", "ry", "rz"),
    "planar": ("tx", "ty", "rz"),
    "floating": ("tx", "ty", "tz", "rx", "ry", "rz"),
}


class _Part(NamedTuple):
    """One independent coordinate: where it sits in q′, q̇′ (whole joints) or which component it is."""

    name: str
    kind: str
    component: str | None
    q_free: slice
    v_free: slice
    q: slice
    v: slice

    @property
    def turns(self) -> bool:
        """Whether the coordinate is an angle read off a circle, known up to whole turns only."""
        return self.kind == "planar" and self.component == "rz"


def component_names(tree: Tree) -> list[str]:
    """The name of every velocity component of the free system, in order: ``joint`` or ``joint:axis``."""
    names: list[str] = []
    for joint in list(tree.model.names)[1:]:
        parts = COMPONENTS.get(tree.kinds[joint])
        names += [joint] if parts is None else [f"{joint}:{part}" for part in parts]
    return names


class IndependentCoordinates:
    """α: q′ → q for a set of joints and joint components.

    Args:
        tree: The free system.
        names: Independent joints or components, in the order of q.
        q_reference: Where the charts of single components are centred, of shape (nq,).

    Attributes:
        nq: Size of q. n: number of independent velocities.
        scalar: Whether every coordinate is a plain number equal to its own tangent (no quaternions or circles).

    Raises:
        IndependentSetError: An unknown or repeated name.
    """

    def __init__(self, tree: Tree, names: tuple[str, ...], q_reference: Array) -> None:
        self.tree = tree
        self.names = names
        self.q_reference = q_reference
        self.parts = self._resolve(names)
        self.nq = self.parts[-1].q.stop if self.parts else 0
        self.n = self.parts[-1].v.stop if self.parts else 0
        whole = [part for part in self.parts if part.component is None]
        self.scalar = all(part.q_free.stop - part.q_free.start == 1 for part in whole)
        self.constant = len(whole) == len(self.parts)
        self._selection = np.zeros((self.n, tree.model.nv))
        for part in whole:
            self._selection[part.v, part.v_free] = np.eye(part.v.stop - part.v.start)
        self._selection.flags.writeable = False
        self._index = np.array([part.q_free.start for part in whole], dtype=int)

    def _resolve(self, names: tuple[str, ...]) -> tuple[_Part, ...]:
        model, parts, nq, nv, taken = self.tree.model, [], 0, 0, set[str]()
        for name in names:
            joint, _, component = name.partition(":")
            if joint not in self.tree.kinds:
                raise IndependentSetError(
                    f"'{joint}' is not a movable joint; the movable joints are {', '.join(self.tree.kinds)}"
                )
            kind = self.tree.kinds[joint]
            if component and component not in COMPONENTS.get(kind, ()):
                known = ", ".join(COMPONENTS.get(kind, ())) or "none: name the joint alone"
                raise IndependentSetError(f"'{name}': components of the {kind} joint '{joint}' are {known}")
            if name in taken or (component and joint in taken) or any(t.startswith(f"{name}:") for t in taken):
                raise IndependentSetError(f"'{name}' is named twice")
            taken.add(name)
            j = model.getJointId(joint)
            q_free = slice(int(model.idx_qs[j]), int(model.idx_qs[j] + model.nqs[j]))
            v_free = slice(int(model.idx_vs[j]), int(model.idx_vs[j] + model.nvs[j]))
            dq, dv = (1, 1) if component else (q_free.stop - q_free.start, v_free.stop - v_free.start)
            parts.append(_Part(name, kind, component or None, q_free, v_free, slice(nq, nq + dq), slice(nv, nv + dv)))
            nq, nv = nq + dq, nv + dv
        return tuple(parts)

    def alpha(self, q_free: Array) -> Array:
        """Q = α(q′) (7), of shape (nq,)."""
        if self.scalar and self.constant:
            return np.asarray(q_free[self._index])
        q = np.empty(self.nq)
        for part in self.parts:
            q[part.q] = q_free[part.q_free] if part.component is None else self._coordinate(part, q_free)
        return q

    def jacobian(self, q_free: Array) -> Array:
        """α_q′, of shape (n, n′): a constant selection where whole joints are independent."""
        if self.constant:
            return self._selection
        jacobian = self._selection.copy()
        for part in self.parts:
            if part.component is not None:
                jacobian[part.v, part.v_free] = self._row(part, q_free)
        return jacobian

    def jacobian_rate(self, q_free: Array, v_free: Array) -> Array | None:
        """d/dt α_q′ along q̇′, of shape (n, n′), or ``None`` where it is zero."""
        if self.constant:
            return None
        rate = np.zeros_like(self._selection)
        for part in self.parts:
            if part.component is not None:
                rate[part.v, part.v_free] = self._row_rate(part, q_free, v_free)
        return rate

    def embed(self, q: Array, q_free: Array) -> Array:
        """Return q′ with its whole independent joints set to q (components are left as they are)."""
        embedded = q_free.copy()
        for part in self.parts:
            if part.component is None:
                embedded[part.q_free] = q[part.q]
        return embedded

    def difference(self, q_from: Array, q_to: Array) -> Array:
        """The tangent vector, of shape (n,), that leads from one q to another."""
        if self.scalar:
            return q_to - q_from
        difference = np.empty(self.n)
        for part in self.parts:
            if part.component is None:
                difference[part.v] = _configuration_difference(part, q_from[part.q], q_to[part.q])
            else:
                step = q_to[part.q] - q_from[part.q]
                difference[part.v] = np.remainder(step + np.pi, 2 * np.pi) - np.pi if part.turns else step
        return difference

    def integrate(self, q: Array, step: Array) -> Array:
        """Move q along a tangent vector of shape (n,), staying on its manifold."""
        if self.scalar:
            return q + step
        moved = pin.integrate(self.tree.model, self.embed(q, self.q_reference), self._selection.T @ step)
        result = q.copy()
        for part in self.parts:
            result[part.q] = q[part.q] + step[part.v] if part.component is not None else moved[part.q_free]
        return result

    def rate(self, q: Array, v: Array) -> Array:
        """d/dt q for a velocity v, of shape (nq,): v itself for plain coordinates, ½ q ⊗ ω for a quaternion."""
        if self.scalar:
            return v
        rate = np.empty(self.nq)
        for part in self.parts:
            rate[part.q] = v[part.v] if part.component is not None else _configuration_rate(part, q[part.q], v[part.v])
        return rate

    def normalize(self, q: Array) -> Array:
        """Bring circles and quaternions in q back to unit length."""
        if self.scalar:
            return q
        result = q.copy()
        for part in self.parts:
            if part.component is None:
                unit = _unit_window(part)
                if unit is not None:
                    result[unit] = result[unit] / np.linalg.norm(result[unit])
        return result

    def off_manifold(self, q: Array) -> float:
        """How far the circles and quaternions in q are from unit length."""
        windows = [_unit_window(part) for part in self.parts if part.component is None]
        return max((abs(float(np.linalg.norm(q[w])) - 1.0) for w in windows if w is not None), default=0.0)

    def _rotation_vector(self, part: _Part, q_free: Array) -> Array:
        window = slice(part.q_free.stop - 4, part.q_free.stop)
        reference, now = pin.Quaternion(self.q_reference[window]), pin.Quaternion(q_free[window])
        return np.asarray(pin.log3(reference.matrix().T @ now.matrix()))

    def _coordinate(self, part: _Part, q_free: Array) -> float:
        assert part.component is not None
        axis = "xyz".index(part.component[1])
        configuration = q_free[part.q_free]
        if part.component[0] == "t":
            return float(configuration[axis])
        if part.kind == "planar":
            return float(np.arctan2(configuration[3], configuration[2]))
        return float(self._rotation_vector(part, q_free)[axis])

    def _row(self, part: _Part, q_free: Array) -> Array:
        assert part.component is not None
        axis = "xyz".index(part.component[1])
        configuration = q_free[part.q_free]
        row = np.zeros(part.v_free.stop - part.v_free.start)
        if part.kind == "planar":
            cosine, sine = configuration[2:]
            row[:] = ((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0))[axis]
        elif part.component[0] == "t":
            row[:3] = pin.Quaternion(configuration[3:]).matrix()[axis]
        else:
            row[-3:] = _log_jacobian(self._rotation_vector(part, q_free))[axis]
        return row

    def _row_rate(self, part: _Part, q_free: Array, v_free: Array) -> Array:
        assert part.component is not None
        axis = "xyz".index(part.component[1])
        configuration, velocity = q_free[part.q_free], v_free[part.v_free]
        rate = np.zeros(len(velocity))
        if part.kind == "planar":
            cosine, sine = configuration[2:] * velocity[2]
            rate[:] = ((-sine, -cosine, 0.0), (cosine, -sine, 0.0), (0.0, 0.0, 0.0))[axis]
        elif part.component[0] == "t":
            rate[:3] = (pin.Quaternion(configuration[3:]).matrix() @ pin.skew(velocity[3:]))[axis]
        else:
            rate[-3:] = _log_jacobian_rate(self._rotation_vector(part, q_free), velocity[-3:])[axis]
        return rate


def _unit_window(part: _Part) -> slice | None:
    size = {"continuous": 2, "spherical": 4, "planar": 2, "floating": 4}.get(part.kind)
    return None if size is None else slice(part.q.stop - size, part.q.stop)


def _configuration_rate(part: _Part, q: Array, v: Array) -> Array:
    """d/dt of a whole joint's configuration; rotational velocities are in the moving frame."""
    if part.kind == "continuous":
        return np.array([-q[1] * v[0], q[0] * v[0]])
    if part.kind == "planar":
        cosine, sine = q[2:]
        return np.array([cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], -sine * v[2], cosine * v[2]])
    if part.kind not in ("spherical", "floating"):
        return v
    x, y, z, w = q[-4:]
    quaternion = 0.5 * np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) @ v[-3:]
    if part.kind == "spherical":
        return np.asarray(quaternion)
    return np.concatenate([pin.Quaternion(q[-4:]).matrix() @ v[:3], quaternion])


def _configuration_difference(part: _Part, q_from: Array, q_to: Array) -> Array:
    """The velocity that leads a whole joint from one configuration to another in unit time.

    Circles are done here: Pinocchio's logarithm of a plane rotation returns exactly 0 for angles below 1.5e-8 where
    rounding has made cos² + sin² exceed one.
    """
    if part.kind == "continuous":
        return np.array([_angle_between(q_from, q_to)])
    if part.kind == "planar":
        angle = _angle_between(q_from[2:], q_to[2:])
        half = 0.5 * angle
        a = half / np.tan(half) if abs(half) > 1e-4 else 1.0 - half * half / 3.0
        cosine, sine = q_from[2:]
        x, y = np.array([[cosine, sine], [-sine, cosine]]) @ (q_to[:2] - q_from[:2])
        return np.array([a * x + half * y, a * y - half * x, angle])
    if part.kind == "spherical":
        return np.asarray(pin.log3(pin.Quaternion(q_from).matrix().T @ pin.Quaternion(q_to).matrix()))
    if part.kind == "floating":
        return np.asarray(pin.log6(pin.XYZQUATToSE3(q_from).actInv(pin.XYZQUATToSE3(q_to))).vector)
    return q_to - q_from


def _angle_between(circle_from: Array, circle_to: Array) -> float:
    (c0, s0), (c1, s1) = circle_from, circle_to
    return float(np.arctan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1))


def _log_jacobian(r: Array) -> Array:
    """J with d/dt log(R) = J ω, ω in the body frame: I + ½[r]× + c(θ)[r]ײ."""
    cross = pin.skew(r)
    return np.asarray(np.eye(3) + 0.5 * cross + _c(float(np.linalg.norm(r)))[0] * cross @ cross)


def _log_jacobian_rate(r: Array, omega: Array) -> Array:
    r_rate = _log_jacobian(r) @ omega
    cross, cross_rate = pin.skew(r), pin.skew(r_rate)
    c, c_over_theta = _c(float(np.linalg.norm(r)))
    turning = c_over_theta * float(r @ r_rate)
    return np.asarray(0.5 * cross_rate + turning * cross @ cross + c * (cross_rate @ cross + cross @ cross_rate))


def _c(theta: float) -> tuple[float, float]:
    """C = 1/θ² − (1 + cos θ)/(2θ sin θ), and c′(θ)/θ."""
    if theta < 0.05:
        t = theta * theta
        return 1 / 12 + t / 720 + t * t / 30240 + t**3 / 1209600, 1 / 360 + t / 7560 + t * t / 201600
    half = 0.5 * theta
    cot = 1.0 / np.tan(half)
    c = 1 / theta**2 - cot / (2 * theta)
    slope = -2 / theta**3 + cot / (2 * theta**2) + (1 + cot * cot) / (4 * theta)
    return c, slope / theta
