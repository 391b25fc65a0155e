"""Points of links that meet a plane: the simplest unilateral law, compliant, with regularised friction.

At depth δ below the plane, with the point's velocity ẋ = −δ̇ n + v_t,

    F = k δ max(0, 1 + c δ̇) (n − μ v_t / √(v_t² + v_s²)).

The normal force is Hunt and Crossley's, as that of the stops (`limits`): continuous, never pulling. Below v_s the
friction is that of a damper: a point at rest under a tangential load creeps at a small part of v_s. (Dry friction in
joints is not smoothed, `stick_slip`.) The corner of a body is a point; a foot is several.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccpin.arrays import Array, number, positive, vector
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import LinkPoint

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Contact:
    """A point of a link above a plane.

    Attributes:
        link: The link.
        point: The point in the link's frame, m.
        stiffness: k, N/m.
        dissipation: c, s/m.
        friction: μ.
        slip: v_s, m/s: friction is full above it and a damper below.
        normal: The plane's normal n in the world, towards the free side; of any length.
        height: The plane's place along its normal, m: {x : n·x = height}.

    Raises:
        InvalidInputError: A number out of its range, or a normal of no length.
    """

    link: str
    point: Vector = (0.0, 0.0, 0.0)
    stiffness: float = 1e5
    dissipation: float = 0.5
    friction: float = 0.0
    slip: float = 1e-2
    normal: Vector = (0.0, 0.0, 1.0)
    height: float = 0.0

    def __post_init__(self) -> None:
        where = f"contact of '{self.link}'"
        for name in ("stiffness", "slip"):
            positive(getattr(self, name), f"{where}: {name}")
        for name in ("dissipation", "friction"):
            number(getattr(self, name), f"{where}: {name}", "a number, 0 or more", -1e-300)
        number(self.height, f"{where}: height")
        vector(self.point, f"{where}: point", 3)
        normal = vector(self.normal, f"{where}: normal", 3)
        if not normal.any():
            raise InvalidInputError(f"{where}: the normal has no length")
        object.__setattr__(self, "normal", tuple((normal / np.linalg.norm(normal)).tolist()))


class ContactForces:
    """Contacts of a mechanism's links, as forces on the free system.

    Args:
        model: The reduced model.
        contacts: Which.

    Attributes:
        names: Of each.

    Raises:
        InvalidInputError: An unknown link, one that never moves, or what is no `Contact`.
    """

    def __init__(self, model: ReducedModel, contacts: Sequence[Contact]) -> None:
        tree = model.mechanism.tree
        self._each = [(contact, LinkPoint(tree, contact.link, contact.point)) for contact in contacts]
        self._size = model.mechanism.n_free
        links = [contact.link for contact in contacts]
        self.names = tuple(
            f"'{link}' on the plane" if links.count(link) == 1 else f"'{link}' at {contact.point} on the plane"
            for contact, link in zip(contacts, links, strict=True)
        )

    def gaps(self, t: float, state: State, v: Array) -> Array:
        """How far each point is above its plane, negative below, m, of shape (contacts,)."""
        places = [point.pose(state.q_free)[:3, 3] for _, point in self._each]
        pairs = zip(self._each, places, strict=True)
        return np.array([np.dot(contact.normal, place) - contact.height for (contact, _), place in pairs])

    def forces(self, t: float, state: State, v: Array) -> Array:
        """F on each point, in world axes, N, of shape (contacts, 3)."""
        forces = np.zeros((len(self._each), 3))
        for k in np.flatnonzero(self.gaps(t, state, v) < 0):
            forces[k] = self._touching(int(k), state, v)[0]
        return forces

    def loads(self, t: float, state: State, v: Array) -> Array:
        """Jᵀ F on the free system's joints, N m or N, of shape (n′,)."""
        loads = np.zeros(self._size)
        for k in np.flatnonzero(self.gaps(t, state, v) < 0):
            force, jacobian = self._touching(int(k), state, v)
            loads += jacobian.T @ force
        return loads

    def potential(self, state: State) -> float:
        """½ Σ k δ², J."""
        depth = np.maximum(0.0, -self.gaps(0.0, state, np.empty(0)))
        stiffness = np.array([contact.stiffness for contact, _ in self._each])
        return float(0.5 * stiffness @ depth**2)

    def _touching(self, k: int, state: State, v: Array) -> tuple[Array, Array]:
        """F and the Jacobian of a point below its plane."""
        contact, point = self._each[k]
        normal = np.array(contact.normal)
        jacobian = point.jacobian(state.q_free)[:3]
        velocity = jacobian @ state.v_free(v)
        depth = contact.height - normal @ point.pose(state.q_free)[:3, 3]
        sinking = -(normal @ velocity)
        push = float(contact.stiffness * depth) * max(0.0, 1.0 + contact.dissipation * float(sinking))
        sliding = velocity + sinking * normal
        drag = contact.friction / np.sqrt(sliding @ sliding + contact.slip**2)
        return push * (normal - drag * sliding), jacobian
