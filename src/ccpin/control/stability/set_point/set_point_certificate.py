"""What Theorem 3 says of a set point: the verdict, its level, and where a state is in it.

The level is that of a fact, `SublevelProved`, over its cells; over a plain region it is an estimate from samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.certified_cells import holding
from ccpin.control.stability.set_point.flood import Limit
from ccpin.control.stability.set_point.set_point_reading import equations_of
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.domain.closures.system import Reading
from ccpin.dynamics.drives import too_weak
from ccpin.errors import CcpinError
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.assumptions import limits_left_out, mass_assumed, rubbing, without_dry_friction
from ccpin.proof.facts import Fact, is_fact
from ccpin.proof.newton import Boxes, predict
from ccpin.proof.verdict import Judged, Verdict

_LIMITS = {
    "domain": "the edge of the domain",
    "gain": "where ‖∂g/∂q‖ is not below the gains (or motors elsewhere than on q lose their grip)",
    "budget": "the number of cells allowed",
    "depth": "how often a cell may be halved",
    "interrupted": "the interruption",
    "refused": "what was found and did not hold when it was to be proved",
}
_FAILED = {
    "domain": "no cell around q_d lies in the domain: its edge, or what could not be proved of it, comes too near",
    "gain": "‖∂g/∂q‖ could not be bounded below k on the cells around q_d",
    "budget": "the cells allowed were spent before ‖∂g/∂q‖ was bounded below k around q_d",
    "depth": "‖∂g/∂q‖ could not be bounded below k on cells around q_d as small as allowed",
    "interrupted": "the work was interrupted before ‖∂g/∂q‖ was bounded below k around q_d",
    "refused": "a level was found, and did not hold when it was to be proved",
}
_CLEAR = 1e-9  # of the gain: refuted by more than rounding


@dataclass(frozen=True, eq=False, repr=False)
class SetPointCertificate(Judged):
    """What Theorem 3 says of a set point.

    Attributes:
        law: The law.
        verdict: ``"proven"``: every motion that starts in B₂ converges to q_d; where a joint states dry friction, it
            stays there and comes to rest, at q_d or where friction holds it. ``"refuted"``: at q_d itself K_p + ∂g/∂q
            is not positive definite, or ‖∂g/∂q‖ ≥ k, so there is no B₂ of Theorem 3 about it, however small.
            ``"undecided"``: neither; `reason` says what was spent and what more would do.
        level: c in joules; 0 where none was found, an estimate where not `rigorous`.
        level_domain: The largest level found with 𝒬 in the domain, whatever the gains (at least `level`); what is more
            than `level` is what a search found, not proved again.
        beta: β over the cells that meet 𝒬; at q_d alone where there is no level.
        slope: ‖∂g/∂q‖₂ at q_d.
        gain: k, the least eigenvalue of K_p.
        stiffness: Least eigenvalue of K_p + ∂g/∂q at q_d; the set point is unstable where it is negative.
        rigorous: Whether `level` and `beta` are bounds (else estimates from samples).
        method: How they were found, in words.
        limit: What keeps c from being larger: the domain, the gain condition, the number of cells, their depth, Ctrl-C;
            ``"refused"``: what a search found was not proved.
        touch: Where, of shape (n,).
        proved: How many cells were proved for it, beyond an atlas's own.
        radii: How far each constant of a set of robots may be off the model's, of shape (p,); ``None``: it is about the
            model alone. For a set it is proved of every robot in it whose D is positive definite, and whose dampers and
            dry friction are not negative.
    """

    law: PDSimpleGravity
    level: float
    level_domain: float
    beta: float
    slope: float
    gain: float
    stiffness: float
    rigorous: bool
    method: str
    limit: Limit
    touch: Array
    proved: int
    _region: MemberCells | SampledRegion | None = field(repr=False)
    radii: Array | None = None

    @property
    def rest(self) -> float:
        """How far from q_d robots of the set may come to rest, ‖q − q_d‖₂ (dry friction apart), proved with the level.

        It is 0 where there is the model alone, infinite where nothing is proved.
        """
        if self.sublevel is None:
            return 0.0 if self.radii is None else np.inf
        return float(self.sublevel.found["rest"][0])

    @property
    def verdict(self) -> Verdict:
        """See the attributes."""
        if self.stiffness < -_CLEAR * self.gain or self.slope > (1.0 + _CLEAR) * self.gain:
            return "refuted"
        return "proven" if self._is_fact else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        if self.verdict == "refuted":
            if self.stiffness < 0.0:
                told = without_dry_friction(self.law.model.mechanism)
                return f"K_p + ∂g/∂q has the eigenvalue {self.stiffness:.6g} at q_d: the set point is not stable{told}"
            return (
                f"the gain condition fails at q_d: ‖∂g/∂q‖ = {self.slope:.6g} is not below k = {self.gain:.6g}; so "
                f"Theorem 3 says nothing of it (K_p + ∂g/∂q has the least eigenvalue {self.stiffness:.6g} there)"
            )
        told = f"c is limited by {_LIMITS[self.limit]}{self._unlimited}"
        if self.verdict == "proven":
            more = "" if self.limit in ("domain", "gain") else f"; {self._more}"
            about = "" if self.radii is None else "of each robot of the set, "
            return f"{about}every motion with 𝒱 < {self.level:.6g} J around q_d {self._end}; {told}{more}"
        if not self.rigorous:
            return f"nothing is proved: on samples c is about {self.level:.6g} J, {told}; over an atlas it is proved"
        return f"{_FAILED[self.limit]}; {self._more}{self._unlimited}"

    @property
    def sublevel(self) -> Fact | None:
        """The fact about the level, the cells and β (`SublevelProved`); without it none is proven."""
        return self._region.sublevel if isinstance(self._region, MemberCells) else None

    def replay(self) -> SetPointCertificate:
        """The same, its level proved once more from its data alone; one that was pickled is undecided until then.

        Raises:
            NotProvedError: It does not hold.
        """
        region = self._region
        if not isinstance(region, MemberCells):
            return self
        return replace(self, _region=replace(region, sublevel=region.sublevel.replay()))

    @cached_property
    def _is_fact(self) -> bool:
        """Whether the level and β are those of a fact, which is about the law."""
        region = self._region
        if not isinstance(region, MemberCells) or not is_fact(region.sublevel, SublevelProved):
            return False
        fact = region.sublevel
        told = (self.level, self.beta) == (fact.found["level"][0], fact.found["beta"][0])
        return self.rigorous and told and equations_of(self.law, region.reading, self.radii).digest == fact.digest

    @property
    def assumes(self) -> tuple[str, ...]:
        """Limits taken not to be met, and that D is positive definite where that is open (friction: `reason`)."""
        mechanism = self.law.model.mechanism
        return limits_left_out(mechanism) + mass_assumed(mechanism)

    @cached_property
    def _unlimited(self) -> str:
        """That efforts are taken as unlimited, where the motors' limits do not hold it still at q_d."""
        model = self.law.model
        weak = too_weak(model.mechanism, {"at q_d": self.law.q_free_d}, model.free_system)
        return f"; efforts are taken as unlimited, and {weak}" if weak else ""

    @property
    def _end(self) -> str:
        names = rubbing(self.law.model.mechanism)
        place = "q_d" if self.radii is None else f"a point at most {self.rest:.3g} from q_d"
        if not names:
            return "converges" if self.radii is None else f"converges to {place}"
        return (
            f"stays there and comes to rest, at {place} or beside it where the dry friction of {', '.join(names)} "
            "holds it"
        )

    @property
    def _more(self) -> str:
        if self.limit == "domain":
            return f"{self.proved} cells were proved: give a domain with q_d inside it"
        if self.limit == "interrupted":
            return f"{self.proved} cells were proved: more time would do more"
        return f"{self.proved} cells were proved: a larger max_depth or budget, or larger gains, would do more"

    @property
    def cells(self) -> tuple[Array, Array]:
        """Lower and upper corners, (K, n) each, of the cells that hold 𝒬 (the region, where only sampled)."""
        if self._region is None:
            empty = np.empty((0, self.law.model.n))
            return empty, empty
        return np.atleast_2d(self._region.lower), np.atleast_2d(self._region.upper)

    def contains(self, q: ArrayLike, v: ArrayLike | None = None) -> bool:
        """Whether the state (q, v) (default at rest) is in B₂: q in cells whose part of {U < c} is 𝒬's, and 𝒱 < c.

        Of a set of robots: whether it is in every one's.
        """
        point = checked_q(self.law.model.coordinates, q)
        velocity = np.zeros(self.law.model.n) if v is None else vector(v, "v", self.law.model.n)
        near = None if self._region is None else self._region.near(point)
        return near is not None and self._highest(point, velocity, near) < self.level

    def _highest(self, q: Array, v: Array, near: Array) -> float:
        """The largest 𝒱 of a robot of the set: 𝒱 is linear in constants."""
        law, model = self.law, self.law.model
        value = law.lyapunov(q, v, near)
        if self.radii is None:
            return value
        rise = model.at(q, near).energy_regressor(v) - model.at(law.q_d, law.q_free_d).energy_regressor(0.0 * v)
        return value + float(np.abs(rise) @ self.radii)


@dataclass(frozen=True, eq=False)
class MemberCells:
    """Cells of a fact that hold 𝒬: those in which {U < c} is a part of it."""

    reading: Reading
    sublevel: Fact

    @cached_property
    def lower(self) -> Array:
        """Lower corners, of shape (K, n)."""
        return np.asarray(self.sublevel.claim.lower[self.sublevel.found["within"]])

    @cached_property
    def upper(self) -> Array:
        """Upper corners, of shape (K, n)."""
        return np.asarray(self.sublevel.claim.upper[self.sublevel.found["within"]])

    def near(self, q: Array) -> Array | None:
        """A configuration in the tube of the cell that holds q; ``None`` where there is no cell."""
        inside = holding(self.lower, self.upper, q)
        if not inside.size:
            return None
        boxes: Boxes = self.sublevel.premises[0].claim.boxes
        box, system = boxes.take(np.flatnonzero(self.sublevel.found["within"])[inside[:1]]), self.reading.system
        theta = predict(self.reading.problem, box, q[None] - box.centre[:, system.independent])
        return np.asarray(self.reading.configuration(theta[0]))


@dataclass(frozen=True, eq=False)
class SampledRegion:
    """A plain region."""

    law: PDSimpleGravity
    lower: Array
    upper: Array

    def near(self, q: Array) -> Array | None:
        """σ(q) from q_d, where q is inside and can be reached."""
        if not np.all((self.lower <= q) & (q <= self.upper)):
            return None
        try:
            return self.law.model.sigma(q, self.law.q_free_d)
        except CcpinError:
            return None
