"""The assembly modes over one q, and which of them the mechanism is in."""

from __future__ import annotations

from typing import Any

from ccpin.arrays import whole
from ccpin.dynamics.state import State
from ccpin.errors import ConvergenceError, InvalidInputError, SingularConfigurationError
from ccpin.mechanism.poses.same_pose import Likeness


class Branches:
    """Modes that can be switched between; each waits where it was last, and is led to the mechanism's q when asked for.

    Args:
        likeness: Tells whether two configurations are one pose.
        states: The modes found.
        here: Where the mechanism was when they were sought; a mode of its own if none of them is it.
    """

    def __init__(self, likeness: Likeness, states: list[State], here: State) -> None:
        poses = likeness.poses(here.q_free)
        same = [likeness.alike(poses, likeness.poses(state.q_free)) for state in states]
        self._states: list[State] = [*states] if any(same) else [*states, here]
        self.own = same.index(True) if any(same) else len(states)

    @classmethod
    def unknown(cls) -> Branches:
        """None found yet."""
        branches = cls.__new__(cls)
        branches._states, branches.own = [], 0
        return branches

    def take(self, number: object, here: State) -> State:
        """The State of another mode over where the mechanism is; the one it leaves waits here.

        Raises:
            InvalidInputError: There is no such mode, or a singularity lies on the straight way from where it waits.
        """
        k = whole(number, "mode", 0)  # type: ignore[arg-type]
        if k >= len(self._states):
            raise InvalidInputError(f"there is no mode {k + 1}; {len(self._states)} are known")
        self._states[self.own] = here
        try:
            self._states[k] = here.model.at(here.q, self._states[k])
        except (ConvergenceError, SingularConfigurationError) as error:
            raise InvalidInputError(f"mode {k + 1} was not followed to here, search anew: {error}") from None
        self.own = k
        return self._states[k]

    def told(self) -> dict[str, Any]:
        """The sign of det ψ_q′ in each (0: no det), and the mechanism's own."""
        return {"signs": [int(state.point.factor.sign) for state in self._states], "own": self.own}
