"""Theorem 3 as a tool: from which states does a PD law with simple gravity compensation reach its set point?

Theorem 3 of `ccpin/proof/theorems/set_point.md`, with what dry friction leaves of it. A flood (`Flood`) proposes cells;
that a level is proven is a fact, `SublevelProved`, and the theorem says who checks which of its hypotheses.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import least_eigenvalue, listener, whole
from ccpin.control.control_law import kind_of
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.cell_facts import proved_of_cells
from ccpin.control.stability.set_point.flood import Flood, Flooded, FloodLimits
from ccpin.control.stability.set_point.sampled_region import checked_region, sample_region
from ccpin.control.stability.set_point.set_point_certificate import MemberCells, SampledRegion, SetPointCertificate
from ccpin.control.stability.set_point.set_point_reading import equations_of, radii_of
from ccpin.control.stability.set_point.starting_cells import cells_around, cells_of_atlas
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.control.stability.set_point.well import Well
from ccpin.covering.region import Corners
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.closures.packing import require_about
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.facts import NotProvedError
from ccpin.work import stoppable

# By n, depth and cells: more reach a larger c and take longer.
_BY_COORDINATES = {1: FloodLimits(12, 400), 2: FloodLimits(14, 2000), 3: FloodLimits(9, 1500)}
_ONE_BOX = FloodLimits(0, 1)  # for more coordinates: the cell about q_d alone


def certify_set_point(
    model: ReducedModel | Mechanism,
    q_d: ArrayLike,
    K_p: ArrayLike,
    K_v: ArrayLike,
    domain: Atlas | Corners | None = None,
    *,
    constants: tuple[ArrayLike, ArrayLike] | None = None,
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
        constants: As for `certify_law`.
        near: Chooses the assembly mode of σ(q_d).
        max_depth: As for `certify_law`.
        budget: As for `certify_law`.
        progress: As for `certify_law`.

    Raises:
        InvalidInputError, UnsupportedMechanismError, UnreachableError, SingularConfigurationError: As `certify_law`
            and `PDSimpleGravity` do.
    """
    law = PDSimpleGravity(model, q_d, K_p, K_v, near)
    return certify_law(law, domain, constants=constants, max_depth=max_depth, budget=budget, progress=progress)


def certify_law(
    law: PDSimpleGravity,
    domain: Atlas | Corners | None = None,
    *,
    constants: tuple[ArrayLike, ArrayLike] | None = None,
    max_depth: int | None = None,
    budget: int | None = None,
    progress: Callable[[Flooded], None] | None = None,
) -> SetPointCertificate:
    """Theorem 3 for a law: β, the gain condition, and the largest c found with B₂ in the domain.

    With `constants` it is Theorem 3 for a set of robots under this one law, whose g(q_d) is the model's: each comes to
    rest near q_d, where the certificate's `rest` says.

    Args:
        law: PD with simple gravity compensation: the model, q_d, K_p and K_v.
        domain: A certified atlas on whose branch q_d lies; ``None``: cells are proved around q_d as far as needed
            (with more than three coordinates a single box, unless they are allowed more); or a plain region
            (lower, upper), taken to lie in Ω, over which everything is only sampled.
        constants: Bounds (lower, upper) of all p constants (`ReducedModel.parameters`) of a set of robots, as
            `Estimate.box` gives them; what is proved is so of all with constants no farther from the model's.
        max_depth: How often a cell may be halved; default by the number of coordinates.
        budget: How many cells may be proved beyond the atlas's own boxes; default by the number of coordinates, and as
            many more as the atlas has.
        progress: Called before every cell with how far it is; what it raises ends the work.

    Returns:
        The certificate; after Ctrl-C what was proved so far, with the limit ``"interrupted"``.

    Raises:
        InvalidInputError: Another law, or q_d is not in the domain or not on its branch; bounds of constants that are
            none, or over a plain region.
        DifferentSubjectsError: The atlas is of other closures than the law's model; its masses may be others.
        UnsupportedMechanismError: Coordinates that are not plain numbers, motors on joints of several freedoms, or
            closures that cannot be certified (a plain region works for these); springs whose constants are not exact.
        UnreachableError, SingularConfigurationError: σ does not exist on all of a plain region.
    """
    require_certifiable(law)
    radii = radii_of(law.model, constants)
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
        if radii is not None:
            raise InvalidInputError("of a set of robots nothing is sampled: give an atlas, or no domain")
        return _sampled(law, domain, gain, least, norm_d)
    told = listener(progress)
    with stoppable() as stop:

        def go_on(flooded: Flooded) -> bool:
            told(flooded)
            return not stop.is_set()

        store = cells_around(law, gain, limits, radii) if domain is None else cells_of_atlas(law, domain, radii)
        found = Flood(store, lambda well: well.beta < gain and well.effort > 0.0, limits, go_on).run(law.q_d)
        level_domain, proved, sublevel, limit = found.level, store.proved, None, found.limit
        if found.level > 0.0:
            try:
                equations = equations_of(law, store.reading, radii)
                sublevel = proved_of_cells(SublevelProved, equations, store, found.members)
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
        _region=None if sublevel is None else MemberCells(store.reading, sublevel),
        radii=radii,
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
        _region=SampledRegion(law, lower, upper),
    )


def require_certifiable(law: PDSimpleGravity) -> None:
    """Check that Theorem 3 speaks of a law, as far as its kind, coordinates and motors go.

    Raises:
        InvalidInputError: Another law than PD with simple gravity compensation.
        UnsupportedMechanismError: Coordinates that are not plain numbers, or motors on joints of several freedoms.
    """
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
