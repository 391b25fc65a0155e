"""`certify_limits`: efforts that motors hold, or speeds that they have, all over a region, proved."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, choice, corners, instance, matrix, numbers, one_each, vector, whole
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.proof.facts import Fact, is_fact
from ccpin.proof.verdict import Judged, Verdict, not_known_of
from ccpin.simulation.plant.motors import MotorModel
from ccpin.transmission.limits_search import CLAIMS, FORMS, LimitsSearch, Sought, about, largest
from ccpin.transmission.motor_bounds import stated_efforts, stated_speeds, up_to_speed
from ccpin.transmission.posture import Posture
from ccpin.transmission.transmission import Transmission
from ccpin.validated.programs.branch_claim import BranchOverCells


@dataclass(frozen=True, eq=False, repr=False)
class LimitsCertificate(Judged):
    """Whether motors hold a box (ellipsoid) of joint efforts, or have one of joint speeds, over a region of the joints.

    Efforts are those of a linkage without weight, past dry friction of its joints.

    Attributes:
        transmission: Of what.
        lower, upper: The region of q_j.
        of: ``"effort"`` or ``"speed"``.
        form: ``"box"`` or ``"ellipsoid"``.
        size: L of {L t}, of shape (n, n), N m or N (rad/s, m/s): |t_j| ≤ 1 of a box, Σt_j² ≤ 1 of an ellipsoid.
        room: What each motor has either way.
        friction: Dry friction of the motors' joints that is met.
        held: The fact, if there is one.
        witness: A posture of the region at which it asks too much of a motor; ``None``: none is known.
        stopped: What could not be proved; nothing where all was.
    """

    transmission: Transmission
    lower: Array
    upper: Array
    of: str
    form: str
    size: Array
    room: Array
    friction: Array
    held: Fact | None
    witness: Posture | None = None
    stopped: str = ""

    @property
    def half_widths(self) -> Array:
        """How far it reaches along each joint, of shape (n,): of a box |x_j| ≤ these is all of it."""
        return np.asarray(np.abs(self.size).sum(axis=1) if self.form == "box" else np.linalg.norm(self.size, axis=1))

    @property
    def verdict(self) -> Verdict:
        """``"proven"``, ``"refuted"`` (a `witness` shows it), or ``"undecided"``: so of one that was pickled."""
        return "proven" if self._known else "refuted" if self.witness is not None else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        shape = "a box" if self.form == "box" else "an ellipsoid"
        if self._known:
            assert self.held is not None
            named = zip(self.transmission.joints, self.half_widths, strict=True)
            limits = ", ".join(f"{name} ±{width:.4g}" for name, width in named)
            does = "hold" if self.of == "effort" else "have speeds"
            within = " (an ellipsoid)" if self.form == "ellipsoid" else ""
            return f"motors {does} {limits}{within} over {len(self.held.claim.preconditioner)} cells"
        if self.witness is not None:
            return f"{shape} of {self.of}s asks too much of a motor at {self.witness!r}"
        return self.stopped or not_known_of(f"this {self.form} and region")

    @cached_property
    def _known(self) -> bool:
        """Whether the fact is one, about this size and region."""
        fact, kind = self.held, CLAIMS.get(self.of)
        if kind is None or not is_fact(fact, kind) or not is_fact(fact.premises[0], BranchOverCells):
            return False
        claim, branch = fact.claim, fact.premises[0].claim
        told = (
            (claim.size, self.size),
            (claim.room, self.room),
            (branch.lower, self.lower),
            (branch.upper, self.upper),
        )
        if not all(np.array_equal(a, b) for a, b in told) or claim.rounded.tolist() != [self.form == "ellipsoid"]:
            return False
        try:
            middle = self.transmission.at(0.5 * (self.lower + self.upper))
            equations, motors, friction = about(self.transmission, middle, self.friction, self.of)
        except CcpinError:
            return False
        same = np.array_equal(claim.motors, motors) and np.array_equal(claim.friction, friction)
        return same and equations.digest == fact.digest


def certify_limits(
    transmission: Transmission,
    region: tuple[ArrayLike, ArrayLike],
    of: Literal["effort", "speed"] = "effort",
    size: ArrayLike | None = None,
    *,
    form: Literal["box", "ellipsoid"] = "box",
    shape: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    friction: ArrayLike | None = None,
    motors: MotorModel | None = None,
    max_cells: int = 4096,
) -> LimitsCertificate:
    """Limits of joint efforts, or speeds, that the motors keep at every posture of a region, proved (Theorem B).

    A box is limits of each joint for itself, as a serial model of the robot states them; an ellipsoid is one limit of
    all together. With efforts the region is free of singular postures of either kind. Efforts are statics of a linkage
    without weight, past the dry friction of the motors' and of the linkage's joints: what weight, and what moving
    takes, is to be taken off `effort`.

    Args:
        transmission: The transmission.
        region: Lower and upper q_j, of shape (n,) each, about the reference's branch.
        of: ``"effort"`` or ``"speed"``, of the joints.
        size: What is to be proved: half-widths (semi-axes along the joints), N m or N, rad/s or m/s, of shape (n,), or
            L of an ellipsoid {L t : |t| ≤ 1}, (n, n); default the largest of a shape that can be.
        form: ``"box"`` or ``"ellipsoid"``.
        shape: A size up to a factor; default that of the largest in the region's middle.
        effort: Largest efforts of the motors behind their gears; default the mechanism's.
        speed: Largest speeds of their joints; default, of speeds, the file's. Of efforts: they are to be there up to
            these speeds, damping of the motors' joints being taken off; default at rest.
        friction: Dry friction of the motors' joints, one number or one each; default what the file states.
        motors: Their torque–speed line, in units of u (`ccpin.simulation.MotorModel`), for efforts at a `speed`.
        max_cells: Into how many cells the region is cut at most.

    Raises:
        InvalidInputError: A region or size that is none, no limit stated, motors that give one way only or nothing.
        UnsupportedMechanismError: Dry friction of a joint of several turns.
        UnreachableError, SingularConfigurationError: The region's middle is not on the reference's branch.
    """
    n = instance(transmission, "transmission", Transmission).n
    lower, upper = corners(region, "region", n)
    choice(of, "of", tuple(CLAIMS))
    choice(form, "form", FORMS)
    given = None if size is None else _size(size, "size", n, form)
    wanted = None if shape is None else _size(shape, "shape", n, form)
    sought = _sought(transmission, of, form, effort, speed, friction, motors)
    middle = transmission.at(0.5 * (lower + upper))
    search = LimitsSearch(transmission, middle, lower, upper, sought)
    wanted = given if given is not None else wanted if wanted is not None else largest(middle, sought)
    best, told = search.best(wanted, given is not None, whole(max_cells, "max_cells"))
    witness = search.witness(wanted) if best is None and given is not None else None
    proved = wanted if best is None else best.claim.size
    return LimitsCertificate(
        transmission, lower, upper, of, form, proved, sought.room, sought.friction, best, witness, told
    )


def _sought(
    transmission: Transmission,
    of: str,
    form: str,
    effort: ArrayLike | None,
    speed: ArrayLike | None,
    friction: ArrayLike | None,
    motors: MotorModel | None,
) -> Sought:
    """Limits of the motors.

    Raises:
        InvalidInputError: They are none.
    """
    model, names, rows = transmission.joint_model, transmission.motors, transmission.motor_side.rows
    if of == "speed":
        if any(each is not None for each in (effort, friction, motors)):
            raise InvalidInputError("of='speed' asks for no effort, friction or motors")
        return Sought(of, form, stated_speeds(model, names, rows, speed), np.zeros(transmission.n))
    least, most = stated_efforts(model, names, effort)
    stated = model.mechanism.joints
    level = np.array(stated.breakaway[rows]) if friction is None else one_each(friction, "friction", len(names))
    fastest = np.zeros(transmission.n) if speed is None else one_each(speed, "speed", len(names))
    room = up_to_speed(model, motors, stated.damping[rows], fastest, np.minimum(most, -least))
    if not (room > level).all():
        raise InvalidInputError(f"every motor must give both ways past friction {level}: {least} … {most}, left {room}")
    return Sought(of, form, room, level)


def _size(value: ArrayLike, name: str, n: int, form: str) -> Array:
    """L, of shape (n, n)."""
    if form == "ellipsoid" and numbers(value, name).ndim == 2:
        found = matrix(value, name, (n, n))
        if not np.linalg.det(found):
            raise InvalidInputError(f"{name} = {found} is flat")
        return found
    widths = vector(value, name, n)
    if not (widths > 0.0).all():
        raise InvalidInputError(f"{name} = {widths} must be positive")
    return np.diag(widths)
