"""Points of a mechanism that can be taken hold of and dragged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, numbers
from ccpin.dynamics.end_effector import EndEffector
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import ConvergenceError, InvalidInputError, SingularConfigurationError, UnreachableTargetError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.wireframe import plane_of_motion

TOOLS = ("end_effector", "effector", "tool", "platform", "coupler", "foot", "toe", "hand", "flange")
"""Words in a name that make it the first choice of what is worth dragging, best first."""
MISSED = 1e-4
"""A drag ended short of the hand by less than this, of the mechanism's size, is no miss."""


class Drag(NamedTuple):
    """Where a drag led: the State, and what is to be said where the hand went further (else ``None``)."""

    state: State
    words: str | None


class Handle:
    """A point of a link that a hand drags; the mechanism follows through σ on its own branch.

    Args:
        model: The reduced model.
        name: What it is called.
        link: Its link.
        point: Where on the link, m, of shape (3,).
        size: The mechanism's, m.
    """

    def __init__(self, model: ReducedModel, name: str, link: str, point: Array, size: float) -> None:
        self.name, self.link = name, link
        self._effector, self._size = EndEffector(model, link, point), size
        self._plane = plane_of_motion(model.mechanism)

    def at(self, q_free: Array) -> Array:
        """Where it is in the world, m, of shape (3,)."""
        return np.asarray(self._effector.point.pose(q_free)[:3, 3])

    def drag(self, here: State, target: object) -> Drag:
        """As near to a point of the world (3,) as the mechanism gets; with six coordinates or more, without turning.

        Raises:
            InvalidInputError: The target is not three finite numbers.
        """
        wanted = numbers(target, "target")  # type: ignore[arg-type]
        if wanted.shape != (3,) or not np.isfinite(wanted).all():
            raise InvalidInputError("a point to drag to is three finite numbers (m)")
        pose = self._effector.point.pose(here.q_free)
        if self._plane is not None:
            wanted = pose[:3, 3] + self._plane.T @ (self._plane @ (wanted - pose[:3, 3]))
        whole = pose.copy()
        whole[:3, 3] = wanted
        model = self._effector.model
        try:
            found = self._effector.solve(whole if model.n >= 6 else wanted, here)
            return Drag(model.at(found.q, found.q_free), None)
        except UnreachableTargetError as error:
            nearest = model.at(error.q, error.q_free)
            missed = error.distance > MISSED * self._size and model.n > 1
            words = f"'{self.name}' reaches no further on this branch: {1e3 * error.distance:.1f} mm are left"
            return Drag(nearest, words if missed else None)
        except (ConvergenceError, SingularConfigurationError) as error:
            return Drag(here, str(error))


def handles_of(model: ReducedModel, size: float) -> tuple[Handle, ...]:
    """What can be dragged: where loops close, and every moving link; the likeliest tool first."""
    mechanism = model.mechanism
    places = dict(_places(mechanism))
    ranked = sorted(places, key=_rank)
    return tuple(Handle(model, name, *places[name], size) for name in ranked)


def _rank(name: str) -> int:
    return next((k for k, word in enumerate(TOOLS) if word in name.lower() and "frame" not in name), len(TOOLS))


def _places(mechanism: Mechanism) -> list[tuple[str, tuple[str, Array]]]:
    """(name, (link, point)) of moving links at their centres of mass and of loops' points, which come to overrule."""
    moving = {name for name, at in mechanism.tree.attachments.items() if at.joint > 0}
    places: list[tuple[str, tuple[str, Array]]] = []
    for closure in mechanism.closures:
        carried = [(name, placement[:3, 3]) for name, placement in closure.ends if name in moving]
        places += [(closure.name, end) for end in carried[:1]]
    named = {name for name, _ in places}
    for link in mechanism.description.links:
        if link.name in moving and link.name not in named:
            centre = link.inertia.com if link.inertia is not None and link.inertia.mass > 0 else None
            if centre is not None or not link.name.endswith("frame"):
                places.append((link.name, (link.name, np.zeros(3) if centre is None else np.asarray(centre))))
    return places
