"""`certify_effort_box`: limits of joint efforts that motors keep all over a region, proved; and the search for them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, instance, vector, whole
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs.program_sources import slopes_of
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recordings import record
from ccpin.proof.facts import Fact, NotProvedError, is_fact, prove
from ccpin.proof.verdict import Judged, Verdict, not_known_of
from ccpin.transmission.effort_box_claim import EffortBoxHeld, balance
from ccpin.transmission.motor_bounds import stated_efforts
from ccpin.transmission.posture import Posture
from ccpin.transmission.transmission import Transmission
from ccpin.validated.programs.branch_claim import CELLS, BranchOverCells, cells_of, tubes
from ccpin.validated.programs.certifying import corners_of
from ccpin.validated.programs.program_equations import ProgramEquations, runnable
from ccpin.validated.programs.proposals import proposed_branch

_BETTER = 1.02  # of the box before: else a finer cut is not worth it
_BELOW = 1.0 - 1e-9  # of the box that bounds allow: room for rounding


@dataclass(frozen=True, eq=False, repr=False)
class EffortBoxCertificate(Judged):
    """Whether motors hold every |τ_j| ≤ box over a region of the joints: statics of a linkage without weight.

    Attributes:
        transmission: Of what.
        lower, upper: The region of q_j.
        box: Half-widths b of the joints' efforts, N m or N.
        room: What each motor gives either way.
        held: The fact, if there is one.
        witness: A posture of the region at which a corner of the box asks too much of a motor; ``None``: none is known.
        stopped: What could not be proved; nothing where all was.
    """

    transmission: Transmission
    lower: Array
    upper: Array
    box: Array
    room: Array
    held: Fact | None
    witness: Posture | None = None
    stopped: str = ""

    @property
    def verdict(self) -> Verdict:
        """``"proven"``, ``"refuted"`` (a `witness` shows it), or ``"undecided"``: so of one that was pickled."""
        return "proven" if self._known else "refuted" if self.witness is not None else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        if self._known:
            assert self.held is not None
            limits = ", ".join(f"{name} ±{b:.4g}" for name, b in zip(self.transmission.joints, self.box, strict=True))
            return f"motors hold {limits} over {len(self.held.claim.preconditioner)} cells"
        if self.witness is not None:
            return f"a corner of the box asks too much of a motor at {self.witness!r}"
        return self.stopped or not_known_of("this box and region")

    @cached_property
    def _known(self) -> bool:
        """Whether the fact is one, about this box and region."""
        fact = self.held
        if not is_fact(fact, EffortBoxHeld) or not is_fact(fact.premises[0], BranchOverCells):
            return False
        claim, branch = fact.claim, fact.premises[0].claim
        told = ((claim.box, self.box), (claim.room, self.room), (branch.lower, self.lower), (branch.upper, self.upper))
        if not all(np.array_equal(a, b) for a, b in told):
            return False
        try:
            equations, motors = _equations_of(self.transmission, self.transmission.at(0.5 * (self.lower + self.upper)))
        except CcpinError:
            return False
        return equations.digest == fact.digest and np.array_equal(claim.motors, motors)


def certify_effort_box(
    transmission: Transmission,
    region: tuple[ArrayLike, ArrayLike],
    box: ArrayLike | None = None,
    *,
    shape: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    max_cells: int = 4096,
) -> EffortBoxCertificate:
    """Limits of joint efforts that the motors keep at every posture of a region, proved (Theorem B).

    A box of efforts, each joint for itself, so that it may stand as limits in a serial model of the robot. With it the
    region is free of singular postures of either kind. Statics of a linkage without weight, friction aside: take what
    it needs off `effort`.

    Args:
        transmission: The transmission.
        region: Lower and upper q_j, of shape (n,) each, about the reference's branch.
        box: Half-widths to be proved, N m or N, of shape (n,); default the largest of a shape that can be.
        shape: Half-widths up to a common factor; default those of the largest box at the region's middle.
        effort: Largest efforts of the motors behind their gears; default the mechanism's.
        max_cells: Into how many cells the region is cut at most.

    Raises:
        InvalidInputError: A region or box that is none, no limit of effort stated, or motors that give one way only.
        UnreachableError, SingularConfigurationError: The region's middle is not on the reference's branch.
    """
    instance(transmission, "transmission", Transmission)
    model, n = transmission.joint_model, transmission.n
    lower, upper = corners_of(region, "region", n)
    least, most = stated_efforts(model, transmission.motors, effort)
    room = np.minimum(most, -least)
    if not (room > 0.0).all():
        raise InvalidInputError(f"every motor must give both ways: {least} … {most}")
    middle = transmission.at(0.5 * (lower + upper))
    wanted = (
        middle.torque_polytope(effort=room, friction=0.0).largest_box()
        if shape is None
        else _positive(shape, "shape", n)
    )
    wanted = wanted if box is None else _positive(box, "box", n)
    cells, (best, stopped) = whole(max_cells, "max_cells"), (None, "no cut was tried")
    search = _BoxSearch(transmission, middle, lower, upper, room)
    count = 1
    while count**n <= cells:
        found, told = search.cut(count, wanted, fixed=box is not None)
        stopped = told if found is None else stopped
        if found is not None:
            worth = best is None or found.claim.box[0] > _BETTER * best.claim.box[0]
            best = found if best is None or found.claim.box[0] > best.claim.box[0] else best
            if box is not None or not worth:
                break
        count *= 2
    if best is not None:
        return EffortBoxCertificate(transmission, lower, upper, best.claim.box, room, best)
    witness = search.witness(wanted) if box is not None else None
    told = f"with up to {cells} cells: {stopped}; raise max_cells"
    return EffortBoxCertificate(transmission, lower, upper, wanted, room, None, witness, told)


def _positive(value: ArrayLike, name: str, n: int) -> Array:
    found = vector(value, name, n)
    if not (found > 0.0).all():
        raise InvalidInputError(f"{name} = {found} must be positive")
    return found


def _equations_of(transmission: Transmission, middle: Posture) -> tuple[ProgramEquations, Indices]:
    """The mechanism's closures in the joints' coordinates, about a posture, and the motors' places in their numbers."""
    model = transmission.joint_model
    program = record(model, "rho", near=middle.state)
    assert program.source is not None
    held, tree = numbering(model, middle.state.q_free), model.mechanism.tree
    places = {tree.joints[joint.number - 1].name: joint.x.start for joint in held.joints}
    motors = np.array([places[name] for name in transmission.motors], dtype=np.intp)
    return ProgramEquations(program.source), motors


class _BoxSearch:
    """Finer and finer cuts of a region, with matrices to precondition M by."""

    def __init__(self, transmission: Transmission, middle: Posture, lower: Array, upper: Array, room: Array) -> None:
        self._transmission, self._middle = transmission, middle
        self._lower, self._upper, self._room = lower, upper, room
        self._equations, self._motors = _equations_of(transmission, middle)

    def cut(self, count: int, wanted: Array, fixed: bool) -> tuple[Fact | None, str]:
        """The fact with so many cells along each axis, of the box wanted or as large a multiple as bounds allow."""
        try:
            branch = prove(proposed_branch(self._equations, self._lower, self._upper, [count] * len(self._lower)))
            matrices = self._matrices(branch)
            if fixed:
                return prove(EffortBoxHeld(self._equations, self._motors, wanted, self._room, matrices), branch), ""
            tried = EffortBoxHeld(self._equations, self._motors, wanted, np.full_like(wanted, 1e300), matrices)
            used = prove(tried, branch).found["used"].max(axis=0)
            box = wanted * (float((self._room / used).min()) * _BELOW)
            return prove(EffortBoxHeld(self._equations, self._motors, box, self._room, matrices), branch), ""
        except NotProvedError as error:
            return None, str(error)

    def _matrices(self, branch: Fact) -> Array:
        """M⁻¹ in the middle of each cell."""
        claim, source = branch.claim, self._equations.source
        cells = cells_of(claim.lower, claim.upper, claim.counts)
        by_q, found = runnable(slopes_of(source.closure, source.independent)), []
        for first in range(0, len(cells.centre), CELLS):
            part = slice(first, first + CELLS)
            nowhere = cells._replace(half=np.zeros_like(cells.half))
            q, y = tubes(claim, nowhere, part, np.zeros_like(claim.radius[part]))
            rows = balance(self._equations, self._motors.tolist(), by_q, q, y)
            matrix = np.stack([np.stack([entry.mid for entry in row], axis=-1) for row in rows], axis=-2)
            try:
                found.append(np.linalg.inv(matrix))
            except np.linalg.LinAlgError:
                raise NotProvedError("a cell in the middle of which the motors do not hold the joints") from None
        return np.concatenate(found)

    def witness(self, box: Array) -> Posture | None:
        """A posture among corners and middle of the region at which the box is not held."""
        ends = zip(
            self._lower.tolist(), (0.5 * (self._lower + self._upper)).tolist(), self._upper.tolist(), strict=True
        )
        for q in product(*ends):
            try:
                posture = self._transmission.at(q, self._middle)
                asked = np.abs(posture.inverse.T) @ box
            except CcpinError:
                continue
            if (asked > self._room * (1.0 + 1e-9)).any():
                return posture
        return None
