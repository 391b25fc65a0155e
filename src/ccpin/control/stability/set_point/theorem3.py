"""Theorem 3 as a tool: from which states does a PD law with simple gravity compensation reach its set point?

Theorem 3 of `ccpin/proof/theorems/set_point.md`, with what dry friction leaves of it. A flood (`Flood`) proposes cells;
that a level is proven is a fact, `SublevelProved`, and the theorem says who checks which of its hypotheses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, listener, vector, whole
from ccpin.control.laws import PDSimpleGravity, kind_of, least_eigenvalue
from ccpin.control.stability.set_point.cell_facts import proved_of_cells
from ccpin.control.stability.set_point.certified_cells import holding
from ccpin.control.stability.set_point.flood import Flood, Flooded, FloodLimits, Limit
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.starting_cells import cells_around, cells_of_atlas
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.control.stability.set_point.well import Well, checked_region, sample_region
from ccpin.covering.region import Corners
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.closures.packing import require_about
from ccpin.domain.closures.system import Reading
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.assumptions import limits_left_out, mass_assumed, rubbing, without_dry_friction
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.facts import Fact, NotProvedError
from ccpin.proof.newton import Boxes, predict
from ccpin.proof.verdict import Verdict
from ccpin.work import stoppable

# By n, depth and cells: more reach a larger c and take longer.
_BY_COORDINATES = {1: FloodLimits(12, 400), 2: FloodLimits(14, 2000), 3: FloodLimits(9, 1500)}
_ONE_BOX = FloodLimits(0, 1)  # for more coordinates: the cell about q_d alone
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


@dataclass(frozen=True, eq=False)
class SetPointCertificate:
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
    _region: _MemberCells | _SampledRegion | None = field(repr=False)

    def __repr__(self) -> str:
        return f"SetPointCertificate({self.verdict}: {self.reason})"

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
        told = f"c is limited by {_LIMITS[self.limit]}"
        if self.verdict == "proven":
            more = "" if self.limit in ("domain", "gain") else f"; {self._more}"
            return f"every motion with 𝒱 < {self.level:.6g} J around q_d {self._end}; {told}{more}"
        if not self.rigorous:
            return f"nothing is proved: on samples c is about {self.level:.6g} J, {told}; over an atlas it is proved"
        return f"{_FAILED[self.limit]}; {self._more}"

    @property
    def sublevel(self) -> Fact | None:
        """The fact about the level, the cells and β (`SublevelProved`); without it none is proven."""
        return self._region.sublevel if isinstance(self._region, _MemberCells) else None

    @cached_property
    def _is_fact(self) -> bool:
        """Whether the level and β are those of a fact, which is about the law."""
        region = self._region
        if not isinstance(region, _MemberCells) or type(region.sublevel) is not Fact:
            return False
        fact = region.sublevel
        if type(fact.claim) is not SublevelProved:
            return False
        told = (self.level, self.beta) == (fact.found["level"][0], fact.found["beta"][0])
        return self.rigorous and told and SetPointEquations.of(self.law, region.reading).digest == fact.digest

    @property
    def assumes(self) -> tuple[str, ...]:
        """Limits taken not to be met, and that D is positive definite where that is open (friction: `reason`)."""
        mechanism = self.law.model.mechanism
        return limits_left_out(mechanism) + mass_assumed(mechanism)

    @property
    def _end(self) -> str:
        names = rubbing(self.law.model.mechanism)
        if not names:
            return "converges"
        return (
            f"stays there and comes to rest, at q_d or beside it where the dry friction of {', '.join(names)} holds it"
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
        """Whether the state (q, v) (default at rest) is in B₂: q in cells whose part of {U < c} is 𝒬's, and 𝒱 < c."""
        point = checked_q(self.law.model.coordinates, q)
        velocity = np.zeros(self.law.model.n) if v is None else vector(v, "v", self.law.model.n)
        near = None if self._region is None else self._region.near(point)
        return near is not None and self.law.lyapunov(point, velocity, near) < self.level


@dataclass(frozen=True, eq=False)
class _MemberCells:
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
class _SampledRegion:
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


def certify_set_point(
    model: ReducedModel | Mechanism,
    q_d: ArrayLike,
    K_p: ArrayLike,
    K_v: ArrayLike,
    domain: Atlas | Corners | None = None,
    *,
    near: ArrayLike | None = None,
    max_depth: int | None = None,
    budget: int | None = None,
    progress: Callable[[Flooded], None] | None = None,
) -> SetPointCertificate:
    """Theorem 3 for PD with simple gravity compensation (28) at a set point: `certify_law` of that law.

    Args:
        model: The reduced model, or a mechanism.
        q_d: The set point, of shape (n,).
        K_p: Proportional gains, as for `PDSimpleGravity`.
        K_v: Velocity gains, alike.
        domain: As for `certify_law`.
        near: Chooses the assembly mode of σ(q_d).
        max_depth: As for `certify_law`.
        budget: As for `certify_law`.
        progress: As for `certify_law`.

    Raises:
        InvalidInputError, UnsupportedMechanismError, UnreachableError, SingularConfigurationError: As `certify_law`
            and `PDSimpleGravity` do.
    """
    law = PDSimpleGravity(model, q_d, K_p, K_v, near)
    return certify_law(law, domain, max_depth=max_depth, budget=budget, progress=progress)


def certify_law(
    law: PDSimpleGravity,
    domain: Atlas | Corners | None = None,
    *,
    max_depth: int | None = None,
    budget: int | None = None,
    progress: Callable[[Flooded], None] | None = None,
) -> SetPointCertificate:
    """Theorem 3 for a law: β, the gain condition, and the largest c found with B₂ in the domain.

    Args:
        law: PD with simple gravity compensation: the model, q_d, K_p and K_v.
        domain: A certified atlas on whose branch q_d lies; ``None``: cells are proved around q_d as far as needed
            (with more than three coordinates a single box, unless they are allowed more); or a plain region
            (lower, upper), taken to lie in Ω, over which everything is only sampled.
        max_depth: How often a cell may be halved; default by the number of coordinates.
        budget: How many cells may be proved beyond the atlas's own boxes; default by the number of coordinates, and as
            many more as the atlas has.
        progress: Called before every cell with how far it is; what it raises ends the work.

    Returns:
        The certificate; after Ctrl-C what was proved so far, with the limit ``"interrupted"``.

    Raises:
        InvalidInputError: Another law, or q_d is not in the domain or not on its branch.
        DifferentSubjectsError: The atlas is of other closures than the law's model; its masses may be others.
        UnsupportedMechanismError: Coordinates that are not plain numbers, motors on joints of several freedoms, or
            closures that cannot be certified (a plain region works for these).
        UnreachableError, SingularConfigurationError: σ does not exist on all of a plain region.
    """
    _check(law)
    if isinstance(domain, Atlas):
        require_about("a certified set point", domain, law.model)
    own = len(domain.boxes.kappa) if isinstance(domain, Atlas) else 0
    usual = _BY_COORDINATES.get(law.model.n, _ONE_BOX)
    limits = FloodLimits(
        usual.depth if max_depth is None else whole(max_depth, "max_depth", 0),
        usual.cells + own if budget is None else whole(budget, "budget", 0),
    )
    stiffness = law.model.gravity_derivative(law.q_d, law.q_free_d)
    gain = least_eigenvalue(law.K_p)
    least = float(np.linalg.eigvalsh(law.K_p + stiffness)[0])
    norm_d = float(np.linalg.norm(stiffness, 2))
    if domain is not None and not isinstance(domain, Atlas):
        return _sampled(law, domain, gain, least, norm_d)
    told = listener(progress)
    with stoppable() as stop:

        def go_on(flooded: Flooded) -> bool:
            told(flooded)
            return not stop.is_set()

        store = cells_around(law, gain, limits) if domain is None else cells_of_atlas(law, domain)
        found = Flood(store, lambda well: well.beta < gain and well.effort > 0.0, limits, go_on).run(law.q_d)
        level_domain, proved, sublevel, limit = found.level, store.proved, None, found.limit
        if found.level > 0.0:
            try:
                sublevel = proved_of_cells(
                    SublevelProved, SetPointEquations.of(law, store.reading), store, found.members
                )
            except NotProvedError:
                limit = "refused"
        if found.limit in ("gain", "depth"):
            more = limits._replace(cells=limits.cells + store.proved)
            level_domain = max(level_domain, Flood(store, _forceful, more, go_on).run(law.q_d).level)
    level, beta = (0.0, norm_d) if sublevel is None else (float(sublevel.found[x][0]) for x in ("level", "beta"))
    around = f"cells proved around q_d, {limits.cells} at most"
    return SetPointCertificate(
        law=law,
        level=level,
        level_domain=max(level, level_domain),
        beta=beta,
        slope=norm_d,
        gain=gain,
        stiffness=least,
        rigorous=True,
        method=around if domain is None else f"the {own} boxes of an atlas, halved where needed",
        limit=limit,
        touch=found.point,
        proved=proved,
        _region=None if sublevel is None else _MemberCells(store.reading, sublevel),
    )


def _forceful(well: Well) -> bool:
    return well.effort > 0.0


def _sampled(law: PDSimpleGravity, region: Corners, gain: float, least: float, norm_d: float) -> SetPointCertificate:
    """The same figures from a grid: the least U on the edge, and among samples where the gain condition fails."""
    lower, upper = checked_region(law.model, region, law.q_d)
    samples = sample_region(law.model, lower, upper, law.q_free_d)
    error = law.q_d - samples.q
    potential_d = law.model.energy(law.q_d, np.zeros(law.model.n), law.q_free_d).potential
    well = samples.potential - potential_d + error @ law.gravity_d + 0.5 * np.sum((error @ law.K_p) * error, axis=1)
    edge = np.where(samples.edge, well, np.inf)
    failing = np.where(samples.norm >= gain, well, np.inf)
    level_domain, stop = float(edge.min()), float(failing.min())
    level = 0.0 if norm_d >= gain else max(0.0, min(level_domain, stop))
    inside = well < level
    return SetPointCertificate(
        law=law,
        level=level,
        level_domain=max(level_domain, 0.0),
        beta=max(norm_d, float(np.max(samples.norm, initial=0.0, where=inside))),
        slope=norm_d,
        gain=gain,
        stiffness=least,
        rigorous=False,
        method=f"sampled at {len(samples.q)} points of the region, nothing is proved",
        limit="gain" if norm_d >= gain or stop < level_domain else "domain",
        touch=samples.q[int(np.argmin(np.minimum(edge, failing)))],
        proved=0,
        _region=_SampledRegion(law, lower, upper),
    )


def _check(law: PDSimpleGravity) -> None:
    if kind_of(law) != "pd":
        raise InvalidInputError("Theorem 3 is about PD with simple gravity compensation: pass a PDSimpleGravity law")
    mechanism, coordinates = law.model.mechanism, law.model.coordinates
    plural = [name for name in mechanism.actuated if mechanism.tree.joint(mechanism.tree.split(name)[0]).kind.nv != 1]
    if plural and mechanism.actuated != mechanism.independent:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: Theorem 3 is certified for motors on 1-dof joints; '{plural[0]}' has several freedoms: "
            "load it with independent= set to the motors"
        )
    if not (coordinates.scalar and coordinates.constant):
        raise UnsupportedMechanismError(
            f"{mechanism.name}: Theorem 3 is certified for revolute and prismatic independent joints only "
            "(q̃ = q_d − q is not smooth on circles and rotations)"
        )
