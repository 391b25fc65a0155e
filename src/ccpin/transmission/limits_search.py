"""The search for motors' limits over a region: finer and finer cuts, and matrices to precondition by."""

from __future__ import annotations

from itertools import product
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.errors import CcpinError, UnsupportedMechanismError
from ccpin.programs.program_sources import slopes_of
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recordings import record
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.transmission.motor_limits_claim import EffortsHeld, MotorLimits, SpeedsHeld
from ccpin.transmission.posture import Posture
from ccpin.transmission.transmission import Transmission
from ccpin.validated.programs.branch_claim import CELLS, cells_of, tubes
from ccpin.validated.programs.program_equations import ProgramEquations, runnable
from ccpin.validated.programs.proposals import proposed_branch

_BETTER = 1.02  # of what was before: else a finer cut is not worth it
_BELOW = 1.0 - 1e-9  # of what bounds allow: room for rounding
CLAIMS: dict[str, type[MotorLimits]] = {"effort": EffortsHeld, "speed": SpeedsHeld}
FORMS: tuple[Literal["box", "ellipsoid"], ...] = ("box", "ellipsoid")


class Sought(NamedTuple):
    """What is asked about.

    Attributes:
        of, form: The words.
        room: What each motor has either way.
        friction: Dry friction of the motors' joints; of speeds none.
    """

    of: str
    form: str
    room: Array
    friction: Array

    def used(self, posture: Posture, size: Array) -> Array:
        """What a size asks of the motors at a posture, friction of theirs besides."""
        by_joints = (posture.inverse.T if self.of == "effort" else posture.jacobian) @ size
        norm = np.abs(by_joints).sum(axis=1) if self.form == "box" else np.linalg.norm(by_joints, axis=1)
        return np.asarray(norm + self.friction)


def largest(middle: Posture, sought: Sought) -> Array:
    """The size of the largest box or ellipsoid at a posture."""
    if sought.of == "speed":
        polytope = middle.speed_polytope(speed=sought.room)
    else:
        polytope = middle.torque_polytope(effort=sought.room, friction=sought.friction)
    if sought.form == "box":
        return np.diag(polytope.largest_box())
    return np.asarray(polytope.map * (0.5 * (polytope.upper - polytope.lower)))


class About(NamedTuple):
    """What claims are about: the closures, the motors' places, and friction of numbers in the order of (q, y)."""

    equations: ProgramEquations
    motors: Indices
    friction: Array


def about(transmission: Transmission, middle: Posture, friction: Array, of: str) -> About:
    """The mechanism's closures in the joints' coordinates, about a posture; friction as stated, of motors as given.

    Friction in joints of the serial robot is its own; that of speeds is none.

    Raises:
        UnsupportedMechanismError: Friction of a joint whose velocities are no rates of the numbers.
    """
    model = transmission.joint_model
    program = record(model, "rho", near=middle.state)
    source = program.source
    assert source is not None
    held, tree = numbering(model, middle.state.q_free), model.mechanism.tree
    joints = {tree.joints[joint.number - 1].name: joint for joint in held.joints}
    levels = np.zeros(len(held.near))
    for name, joint in joints.items():
        own = of == "speed" or name in transmission.joints
        level = 0.0 if own else tree.joints[joint.number - 1].stated.breakaway_level
        if level and joint.turning_axes:
            raise UnsupportedMechanismError(f"dry friction of joint '{name}', which turns about several axes")
        levels[joint.x] = level
    motors = np.array([joints[name].x.start for name in transmission.motors], dtype=np.intp)
    levels[motors] = friction
    return About(ProgramEquations(source), motors, levels[[*source.independent, *source.dependent]])


class LimitsSearch:
    """Finer and finer cuts of a region, with matrices to precondition M by."""

    def __init__(self, transmission: Transmission, middle: Posture, lower: Array, upper: Array, sought: Sought) -> None:
        self._transmission, self._middle = transmission, middle
        self._lower, self._upper, self._sought = lower, upper, sought
        self._about = about(transmission, middle, sought.friction, sought.of)

    def best(self, wanted: Array, fixed: bool, max_cells: int) -> tuple[Fact | None, str]:
        """The fact of what is wanted, or of its largest multiple that so many cells prove; or why there is none."""
        found, told, count = None, "no cut was tried", 1
        while count ** len(self._lower) <= max_cells:
            made, why = self.cut(count, wanted, fixed)
            count *= 2
            if made is None:
                told = why
                continue
            worth = found is None or _scale(made) > _BETTER * _scale(found)
            found = made if found is None or _scale(made) > _scale(found) else found
            if fixed or not worth:
                break
        return found, "" if found is not None else f"with up to {max_cells} cells: {told}; raise max_cells"

    def cut(self, count: int, wanted: Array, fixed: bool) -> tuple[Fact | None, str]:
        """The fact with so many cells along each axis, of what is wanted or as large a multiple as bounds allow."""
        room = self._sought.room
        try:
            branch = prove(proposed_branch(self._about.equations, self._lower, self._upper, [count] * len(self._lower)))
            matrices = self._matrices(branch)
            if fixed:
                return prove(self._claim(wanted, room, matrices), branch), ""
            found = prove(self._claim(wanted, np.full_like(room, 1e300), matrices), branch).found
            scale = float(((room - found["lost"]) / found["asked"]).min()) * _BELOW
            if scale <= 0.0:
                return None, "friction takes all that a motor gives"
            return prove(self._claim(wanted * scale, room, matrices), branch), ""
        except NotProvedError as error:
            return None, str(error)

    def _claim(self, size: Array, room: Array, matrices: Array) -> MotorLimits:
        equations, motors, friction = self._about
        kind, rounded = CLAIMS[self._sought.of], np.array([self._sought.form == "ellipsoid"])
        return kind(equations, motors, size, rounded, friction, room, matrices)

    def _matrices(self, branch: Fact) -> Array:
        """M⁻¹ in the middle of each cell."""
        claim, source = branch.claim, self._about.equations.source
        empty = self._claim(np.eye(len(claim.lower)), self._sought.room, np.zeros((0, 0, 0)))
        cells = cells_of(claim.lower, claim.upper, claim.counts)
        by_q, found = runnable(slopes_of(source.closure, source.independent)), []
        for first in range(0, len(cells.centre), CELLS):
            part = slice(first, first + CELLS)
            nowhere = cells._replace(half=np.zeros_like(cells.half))
            q, y = tubes(claim, nowhere, part, np.zeros_like(claim.radius[part]))
            rows = empty.matrix(by_q, q, y)
            matrix = np.stack([np.stack([entry.mid for entry in row], axis=-1) for row in rows], axis=-2)
            try:
                found.append(np.linalg.inv(matrix))
            except np.linalg.LinAlgError:
                raise NotProvedError("a cell in the middle of which the motors do not hold the joints") from None
        return np.concatenate(found)

    def witness(self, size: Array) -> Posture | None:
        """A posture among corners and middle of the region at which a motor has too little."""
        ends = zip(
            self._lower.tolist(), (0.5 * (self._lower + self._upper)).tolist(), self._upper.tolist(), strict=True
        )
        for q in product(*ends):
            try:
                posture = self._transmission.at(q, self._middle)
                asked = self._sought.used(posture, size)
            except CcpinError:
                continue
            if (asked > self._sought.room * (1.0 + 1e-9)).any():
                return posture
        return None


def _scale(fact: Fact) -> float:
    return float(np.linalg.norm(fact.claim.size))
