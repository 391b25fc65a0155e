"""Certified paths: σ stays on its branch along a tube about a path, or where that cannot be proved and why.

A stretch of the path between two parameters is covered by one box of Theorem N (`boxes`) with p = 1 + n parameters,

    q = q_c + s d + w,  |s| ≤ 1,  |w| ≤ tube + deviation of the path from its chord + its jump at the beginning,

d half the chord. The deviation holds the rounding of the polynomials (`pieces`), so the path is that of their
coefficients, exactly; where it jumps from one piece to the next, by 1e-9 at most, it is taken to go straight.
Consecutive boxes contain the tube's cross section at their common parameter, a connected set, and are glued where the
earlier one ends; the first is glued to the closed configuration at the start. So along the tube σ continues from
the start in one way only, meets no singularity and is smooth. Should the path cross itself the tube is to
be thought of as not meeting itself there: σ may be different the second time round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly

from ccpin.arrays import Array, numbers
from ccpin.covering.proposals.solving import newton
from ccpin.domain.closures.seeds import seed_at_coordinates
from ccpin.domain.closures.system import Reading
from ccpin.domain.paths.pieces import pieces_of
from ccpin.domain.paths.refutation import empty_witness, singular_witness
from ccpin.domain.paths.walker import SHORTEST, TRIES, Walker
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.chords import chord_of, points_of
from ccpin.proof.equations import BoundsName, Problem, closure_values
from ccpin.proof.facts import Fact, is_fact
from ccpin.proof.newton import Boxes, solve_in_boxes
from ccpin.proof.paths import Followed, follows
from ccpin.proof.verdict import Judged, Verdict, Witness, not_known_of

_AHEAD = np.array([1.0, 0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4])  # of what is left of the piece
_BACK = (1, 3, 6, 12)  # strides before the end of a walk
_SAMPLES = 100  # of what is left of the path
_STRAIGHT = 1e-13  # the rounding that every chord's deviation is given


@dataclass(frozen=True, eq=False, repr=False)
class CertifiedPath(Judged):
    """What was proved of a path.

    Attributes:
        reached: The parameter up to which the path is certified.
        proved: The fact that it is (`ccpin.proof.paths`); ``None`` where nothing is.
        told: What the walk came to, in a sentence.
        witness: Where the claim fails, if it was refuted.
        rcond: Reciprocal condition number of φ_y at `reached`.
        tried: How many boxes were tried.
        times: Parameters between the boxes, of shape (B + 1,).
        tube: Half widths of the tube, of shape (n,).
        boxes: The boxes, in order.
        pieces: The path, a polynomial between two knots.
        reading: The closures, and how their coordinates and configurations correspond.
    """

    reached: float
    proved: Fact | None
    told: str
    witness: Witness | None
    rcond: float
    tried: int
    times: Array
    tube: Array
    boxes: Boxes
    pieces: PPoly
    reading: Reading

    @property
    def verdict(self) -> Verdict:
        """``"proven"``: σ stays on its branch along the whole tube. ``"refuted"``: it does not, as `witness` shows.

        So it is where the branch meets a singular configuration in the tube (`refutation`), or some q of the path has
        no closed configuration at all. ``"undecided"``: neither was proved.
        """
        if is_fact(self.proved, Followed) and follows(self.proved, self.pieces):
            return "proven"
        return "undecided" if self.witness is None else "refuted"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        return self.told if self.proved is None or is_fact(self.proved, Followed) else not_known_of("this path")

    def replay(self) -> CertifiedPath:
        """The same, proved once more from its data alone; one that was pickled is undecided until then.

        Raises:
            NotProvedError: It does not hold.
        """
        return self if self.proved is None else replace(self, proved=self.proved.replay())

    @property
    def problem(self) -> Problem:
        """The closures."""
        return self.reading.problem

    def sigma(self, t: ArrayLike) -> Array:
        """q′ = σ(q(t)) along the certified part: (nq,) for a number, (K, nq) for an array (K,).

        Raises:
            InvalidInputError: A parameter lies outside of the certified part.
        """
        at = np.atleast_1d(numbers(t, "t"))
        if not np.all((at >= self.times[0]) & (at <= self.reached)) or not len(self.boxes.kappa):
            raise InvalidInputError(
                f"the path is certified for parameters from {self.times[0]:.9g} to {self.reached:.9g}"
            )
        number = np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.boxes.kappa) - 1)
        boxes, system = self.boxes.take(number), self.problem.system
        q = self.pieces(at)
        start, end = self.times[number], self.times[number + 1]
        s = 2.0 * (at - start) / (end - start) - 1.0
        along = boxes.directions[:, system.independent, 0]
        across = q - boxes.centre[:, system.independent] - s[:, None] * along
        delta = np.concatenate([s[:, None], across], axis=1)
        theta = newton(self.problem, solve_in_boxes(self.problem, boxes, delta).theta, 1).theta
        q_free = self.reading.configuration(theta)
        return np.asarray(q_free[0] if np.ndim(t) == 0 else q_free)


def certify_path(
    mechanism: Mechanism | HasMechanism,
    path: ArrayLike | PPoly | BSpline,
    tube: ArrayLike = 1e-3,
    near: Array | None = None,
    *,
    bounds: BoundsName = "auto",
) -> CertifiedPath:
    """Prove that σ stays on its branch along a tube about a path.

    Args:
        mechanism: A mechanism (or its model) with scalar independent coordinates, any number of them.
        path: Waypoints of shape (K, n), parameter 0 … K − 1, or a SciPy `PPoly` (`CubicSpline` …) or `BSpline` with
            values of shape (n,), of degree 50 at most; rad and m. A BSpline is read as its Taylor polynomials
            (`CertifiedPath.pieces`), which are then the path.
        tube: Half width of the tube in each coordinate: a number or shape (n,).
        near: A closed configuration on the branch wanted near the path's start, of shape (nq,); default the
            reference.
        bounds: ``"auto"``, ``"reach"`` or ``"planar"``.

    Returns:
        The proof, or where it ends and why.

    Raises:
        InvalidInputError: Path or tube is malformed.
        UnreachableError, SingularConfigurationError: σ at the path's start does not exist, or is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    mechanism = mechanism_of(mechanism)
    pieces = pieces_of(path, mechanism.n)
    try:
        widths = np.broadcast_to(numbers(tube, "tube"), (mechanism.n,)).copy()
    except ValueError:
        widths = np.array([np.nan])
    if not (np.all(np.isfinite(widths)) and np.all(widths >= 0.0)):
        raise InvalidInputError(f"tube must be a nonnegative number or {mechanism.n} of them; it is {tube!r}")
    seed = seed_at_coordinates(mechanism, pieces(pieces.x[0]), near)
    reading = seed.reading.bounded(bounds)
    walker = Walker(reading.problem, pieces, widths, seed.theta)
    stopped = walker.walk()
    proved = walker.proved()
    if proved is None:
        walker, stopped = walker.back(len(walker.times) - 1), float(pieces.x[1])
    witness = None if stopped is None else _refuted(walker, reading, stopped)
    return CertifiedPath(
        reached=walker.here,
        proved=proved,
        told=_reason(walker, stopped, witness),
        witness=witness,
        rcond=walker.rcond(),
        tried=walker.tried,
        times=np.array(walker.times),
        tube=widths,
        boxes=walker.boxes,
        pieces=pieces,
        reading=reading,
    )


def _refuted(walker: Walker, reading: Reading, knot: float) -> Witness | None:
    """A place in the tube ahead at which the claim is proved to fail, seen from here or from some steps before."""
    for steps in (0, *_BACK):
        if steps < len(walker.times):
            before = walker.back(steps)
            found = singular_witness(before, reading, _targets(before, min(knot, _next_knot(before))))
            if found is not None:
                return found
    ahead, rounding = points_of(walker.pieces, np.linspace(walker.here, walker.pieces.x[-1], _SAMPLES))
    in_tube = np.all(rounding <= np.maximum(walker.tube, _STRAIGHT), axis=1)
    return empty_witness(walker.problem, ahead[in_tube]) if in_tube.any() else None


def _next_knot(walker: Walker) -> float:
    """Where the piece that the walker is about to enter ends."""
    knots = walker.pieces.x
    return float(knots[min(int(np.searchsorted(knots, walker.here, side="right")), len(knots) - 1)])


def _targets(walker: Walker, knot: float) -> list[Array]:
    """Points q such that the segment from the walker's place to them lies in the tube, the more likely ones first.

    Ahead on the path, and at the tube's corner on either side of the image of the fold that is near: its normal is
    uᵀφ_q, u the left singular vector of φ_y's smallest singular value.
    """
    system, here = walker.problem.system, walker.here
    jacobian = closure_values(walker.problem, walker.theta[None])[1][0]
    normal = np.linalg.svd(jacobian[:, system.dependent])[0][:, -1] @ jacobian[:, system.independent]
    corner = walker.tube * np.sign(normal)
    corners = [side * corner for side in (1.0, -1.0)] if np.any(corner) else []
    start, ahead, targets = walker.theta[system.independent], list[Array](), list[Array]()
    for end in here + (knot - here) * _AHEAD:
        chord = chord_of(walker.pieces, here, float(end))
        away = chord.deviation + np.abs(chord.start - start)  # where the path jumps the segment begins beside it
        if np.all(away <= np.maximum(walker.tube, _STRAIGHT)):
            ahead = ahead or [chord.end]
            shares = np.max(away / np.maximum(walker.tube, 1e-300), where=walker.tube > 0.0, initial=0.0)
            room = max(0.0, 1.0 - float(shares))
            targets += [chord.end + room * aside for aside in corners]
    return [*ahead, *(start + aside for aside in corners), *targets]


def _reason(walker: Walker, knot: float | None, witness: Witness | None) -> str:
    """The verdict in a sentence: what was spent, and what more would do."""
    spent = f"{len(walker.times) - 1} boxes of {walker.tried} tried"
    if knot is None:
        return f"σ stays on its branch along the whole tube: {spent}"
    if witness is not None and witness.kind == "empty":
        return f"the path leaves the workspace: no configuration closes the loops at q = {witness.q.tolist()}"
    if witness is not None:
        return (
            f"the branch is singular in the tube, at q = {witness.q.tolist()} (to {witness.error:.1e}); it is "
            f"certified up to parameter {walker.here:.9g}"
        )
    place = f"at parameter {walker.here:.9g}, q = {walker.theta[walker.problem.system.independent].tolist()}"
    condition = f"the reciprocal condition number of φ_y is {walker.rcond():.1e}; {spent}"
    span = float(walker.pieces.x[-1] - walker.pieces.x[0])
    if walker.step(knot, SHORTEST * span * TRIES, np.zeros_like(walker.tube)) is not None:
        width = f"a tube of half width {walker.tube.max():.3g}"
        return f"{width} is too wide {place}: {condition}; a narrower tube= goes farther"
    return f"no box could be proved {place}: {condition}; a path that keeps clear of the singularity there would do"
