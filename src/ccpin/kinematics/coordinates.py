"""The independent coordinates q = α(q′) (7), with α_q′, its rate and the derivative of α̇_q′ q̇′, all exact.

A joint named as independent contributes its whole configuration to q and its velocity to v: an angle or a length
for 1-dof joints, (cosine, sine) for a continuous joint, a unit quaternion for a spherical one. A single
component of a multi-dof joint is named ``joint:axis`` (rx, ry, rz for rotations, tx, ty, tz for translations);
its coordinate is the component of the rotation vector log(R_refᵀ R) from the reference configuration, or of the
position in the joint's own frame, and its velocity is that coordinate's rate.

With (v, ω) the velocity of the joint's moving frame in its own axes, R its rotation and r the rotation vector, the
rates of these coordinates are entries of R v and of J(r) ω (`ccpin.description.rotations`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, skew, vector
from ccpin.description.joint_kinds import JointKind
from ccpin.description.names import choices
from ccpin.description.rotations import log_bias_derivative, log_jacobian, log_jacobian_rate
from ccpin.errors import IndependentSetError, InvalidInputError
from ccpin.kinematics.tree import Tree, TreeJoint

_OFF = 1e-6  # from unit length: quaternions and (cosine, sine) pairs farther off are refused, nearer ones normalised


class Coordinate(NamedTuple):
    """One independent coordinate: a window of q′ and q̇′, or a component of a joint that is neither.

    Attributes:
        name: As the caller named it.
        kind: Its joint's kind.
        component: ``None`` for a whole joint and for a component that is a plain number of q′.
        slides: Whether each of its velocities is a slide (m/s) rather than a turn.
        q_free, v_free: Where it (or the joint of the component) stands in q′ and q̇′.
        q, v: Where it stands in q and v.
    """

    name: str
    kind: JointKind
    component: str | None
    slides: tuple[bool, ...]
    q_free: slice
    v_free: slice
    q: slice
    v: slice

    @property
    def whole(self) -> JointKind | None:
        """The kind of a joint that is independent as a whole, on its manifold; ``None`` for plain numbers."""
        return self.kind if self.component is None and self.kind.unit else None

    @property
    def wraps(self) -> bool:
        """Whether the coordinate is an angle read off a circle, known up to whole turns only."""
        return self.component is not None and self.kind.unit == 2 and not self.slides[0]


def component_names(tree: Tree) -> list[str]:
    """The name of every velocity component of the free system, in order: ``joint`` or ``joint:axis``."""
    parts = ((joint.name, joint.kind.components) for joint in tree.joints)
    return [name for joint, axes in parts for name in ([f"{joint}:{axis}" for axis in axes] or [joint])]


class IndependentCoordinates:
    """α: q′ → q for a set of joints and joint components.

    Args:
        tree: The free system.
        names: Independent joints or components, in the order of q.
        q_reference: Where the charts of single components are centred, of shape (nq,).

    Attributes:
        nq: Size of q. n: number of independent velocities.
        scalar: Whether every coordinate is a plain number equal to its own tangent (no quaternions or circles).
        constant: Whether α is a selection of entries of q′, so that α_q′ is constant.

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
        self._units = [slice(p.q.stop - p.whole.unit, p.q.stop) for p in self.parts if p.whole is not None]
        self.scalar = all(part.whole is None for part in self.parts)
        selected = [part for part in self.parts if part.component is None]
        self.constant = len(selected) == len(self.parts)
        self._selection = np.zeros((self.n, tree.model.nv))
        for part in selected:
            self._selection[part.v, part.v_free] = np.eye(part.v.stop - part.v.start)
        self._selection.flags.writeable = False
        self._index = np.array([i for part in selected for i in range(part.q_free.start, part.q_free.stop)], dtype=int)

    def _resolve(self, names: tuple[str, ...]) -> tuple[Coordinate, ...]:
        parts, nq, nv, taken, split = [], 0, 0, set[str](), set[str]()
        for name in names:
            joint = self._joint_of(name)
            component = self.tree.split(name)[1] or None
            if name in taken or (joint.name in taken if component else name in split):
                raise IndependentSetError(f"'{name}' is named twice")
            taken.add(name)
            if component:
                split.add(joint.name)
            kind, q_free, v_free, slides = joint.kind, joint.q, joint.v, joint.kind.slides
            dq, dv = (1, 1) if component else (kind.nq, kind.nv)
            if component:
                k = kind.components.index(component)
                slides = (slides[k],)
                if not kind.unit:
                    component, q_free, v_free = None, _entry(q_free, k), _entry(v_free, k)
            window = slice(nq, nq + dq), slice(nv, nv + dv)
            parts.append(Coordinate(name, kind, component, slides, q_free, v_free, *window))
            nq, nv = nq + dq, nv + dv
        return tuple(parts)

    def _joint_of(self, name: str) -> TreeJoint:
        joint, component = self.tree.split(name)
        if joint not in self.tree.names:
            raise IndependentSetError(f"'{joint}' is not a movable joint; {choices(joint, self.tree.names)}")
        kind = self.tree.joint(joint).kind
        if component and component not in kind.components:
            known = ", ".join(kind.components) or "none: name the joint alone"
            raise IndependentSetError(f"'{name}': components of the {kind.name} joint '{joint}' are {known}")
        return self.tree.joint(joint)

    def alpha(self, q_free: Array) -> Array:
        """q = α(q′) (7), of shape (model.nq,)."""
        if self.constant:
            return np.asarray(q_free[self._index])
        q = np.empty(self.nq)
        for part in self.parts:
            q[part.q] = q_free[part.q_free] if part.component is None else self._coordinate(part, q_free)
        return q

    def jacobian(self, q_free: Array) -> Array:
        """α_q′, of shape (n, n′): a constant selection where whole joints are independent."""
        return self._selection if self.constant else self._selection + self.component_jacobian(q_free)

    def component_jacobian(self, q_free: Array) -> Array:
        """The rows of α_q′ that belong to components and are not constant, of shape (n, n′); the others are zero."""
        jacobian = np.zeros_like(self._selection)
        for part in self.parts:
            if part.component is not None:
                q = q_free[part.q_free]
                rows = part.kind.rotation(q) if part.slides[0] else log_jacobian(self.rotation_vector(part, q))
                jacobian[part.v, part.v_free] = _row(part, rows)
        return jacobian

    def jacobian_rate(self, q_free: Array, v_free: Array) -> Array | None:
        """d/dt α_q′ along q̇′, of shape (n, n′), or ``None`` where it is zero."""
        if self.constant:
            return None
        rate = np.zeros_like(self._selection)
        for part in self.parts:
            if part.component is not None:
                q, omega = q_free[part.q_free], part.kind.twist(v_free[part.v_free])[3:]
                if part.slides[0]:
                    rows = part.kind.rotation(q) @ skew(omega)
                else:
                    rows = log_jacobian_rate(self.rotation_vector(part, q), omega)
                rate[part.v, part.v_free] = _row(part, rows)
        return rate

    def readings(self, q_free: Array, v_free: Array, a_free: Array) -> tuple[Array, Array, Array]:
        """q, q̇ and q̈ of a motion of the free system, row by row: α(q′), α_q′ q̇′ and α_q′ q̈′ + α̇_q′ q̇′."""
        if self.constant:
            return q_free[:, self._index], v_free @ self._selection.T, a_free @ self._selection.T
        q, v, a = np.empty((len(q_free), self.nq)), np.empty((len(q_free), self.n)), np.empty((len(q_free), self.n))
        for k, (x, w, b) in enumerate(zip(q_free, v_free, a_free, strict=True)):
            jacobian, rate = self.jacobian(x), self.jacobian_rate(x, w)
            q[k], v[k], a[k] = self.alpha(x), jacobian @ w, jacobian @ b + (0.0 if rate is None else rate @ w)
        return q, v, a

    def bias_derivative(self, q_free: Array, v_free: Array, dq: Array, dv: Array) -> Array:
        """D(α̇_q′ q̇′) where q′ moves along tangent steps `dq` and q̇′ changes by `dv`, each (n′, k); of shape (n, k)."""
        derivative = np.zeros((self.n, dq.shape[1]))
        for part in self.parts:
            if part.component is None:
                continue
            q, v_local, omega = q_free[part.q_free], *part.kind.twist(v_free[part.v_free]).reshape(2, 3)
            steps, (dv_local, domega) = (part.kind.twist(d[part.v_free]).reshape(2, 3, -1) for d in (dq, dv))
            turns, axis = steps[1], _axis(part)
            if part.slides[0]:
                turning = np.cross(turns.T, np.cross(omega, v_local)).T + skew(omega) @ dv_local
                derivative[part.v] = (part.kind.rotation(q) @ (turning + np.cross(domega.T, v_local).T))[axis]
            else:
                r = self.rotation_vector(part, q)
                changes = zip(turns.T, domega.T, strict=True)
                derivative[part.v] = [log_bias_derivative(r, omega, *change)[axis] for change in changes]
        return derivative

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
            if part.whole is not None:
                difference[part.v] = part.whole.difference(q_from[part.q], q_to[part.q])
            else:
                step = q_to[part.q] - q_from[part.q]
                difference[part.v] = np.remainder(step + np.pi, 2 * np.pi) - np.pi if part.wraps else step
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
        """d/dt q for a velocity v, of shape (model.nq,): v itself for plain coordinates, ½ q ⊗ ω for a quaternion."""
        if self.scalar:
            return v
        rate = np.empty(self.nq)
        for part in self.parts:
            rate[part.q] = v[part.v] if part.whole is None else part.whole.rate(q[part.q], v[part.v])
        return rate

    def normalize(self, q: Array) -> Array:
        """Bring circles and quaternions in q back to unit length."""
        result = q.copy()
        for unit in self._units:
            result[unit] = result[unit] / np.linalg.norm(result[unit])
        return result

    def off_manifold(self, q: Array) -> float:
        """How far the circles and quaternions in q are from unit length."""
        return max((abs(float(np.linalg.norm(q[unit])) - 1.0) for unit in self._units), default=0.0)

    def turned(self, q_free: Array) -> float:
        """The longest rotation vector of a joint whose single turns are coordinates, rad; at π they jump."""
        parts = [part for part in self.parts if part.component is not None and not part.wraps and not part.slides[0]]
        return max((float(np.linalg.norm(self.rotation_vector(p, q_free[p.q_free]))) for p in parts), default=0.0)

    def rotation_vector(self, part: Coordinate, q: Array) -> Array:
        """r of a joint's own q: from the reference for a quaternion, from the circle's own zero otherwise."""
        return part.kind.rotation_vector(q, self.q_reference[part.q_free] if part.kind.unit == 4 else None)

    def _coordinate(self, part: Coordinate, q_free: Array) -> float:
        q = q_free[part.q_free]
        if part.slides[0]:
            return float(q[part.kind.components.index(part.component)])
        return float(self.rotation_vector(part, q)[_axis(part)])


def checked_q(coordinates: IndependentCoordinates, q: ArrayLike, name: str = "q") -> Array:
    """Return q as a float64 vector on its manifold, of shape (coordinates.nq,).

    Raises:
        InvalidInputError: Wrong shape, not finite, or a circle or quaternion that is not of unit length.
    """
    array = vector(q, name, coordinates.nq)
    if coordinates.scalar:
        return array
    if coordinates.off_manifold(array) > _OFF:
        raise InvalidInputError(f"{name} holds a quaternion or (cosine, sine) pair that is not of unit length")
    return coordinates.normalize(array)


def checked_configuration(model: pin.Model, q_free: ArrayLike, name: str = "q_free") -> Array:
    """Return a configuration q′ as a float64 vector, of shape (nq,).

    Raises:
        InvalidInputError: Wrong shape, not finite, or a circle or quaternion that is not of unit length.
    """
    array = vector(q_free, name, model.nq)
    if model.nq != model.nv and not pin.isNormalized(model, array, _OFF):
        raise InvalidInputError(f"{name} holds a quaternion or (cosine, sine) pair that is not of unit length")
    return array


def _entry(window: slice, k: int) -> slice:
    return slice(window.start + k, window.start + k + 1)


def _axis(part: Coordinate) -> int:
    assert part.component is not None
    return "xyz".index(part.component[1])


def _row(part: Coordinate, rows: Array) -> Array:
    """A component's row of R (slides) or J (turns) as a row over its joint's velocity components."""
    whole = np.zeros(6)
    whole[slice(0, 3) if part.slides[0] else slice(3, 6)] = rows[_axis(part)]
    return whole[part.kind.entries]
