"""Gains for a set point: K_p above ‖∂g/∂q‖ (Theorem 3), K_v for a damping ratio of the linearised loop.

About q_d the closed loop D q̈ + C q̇ + g(q) = K_p q̃ − K_v q̇ + g(q_d) is, to first order in x = q − q_d,

    D ẍ + K_v ẋ + (K_p + ∂g/∂q) x = 0        (D and ∂g/∂q at q_d; C q̇ is of second order).

With Φ the modes, (K_p + ∂g/∂q)Φ = DΦΩ², ΦᵀDΦ = I, the gain K_v = Φ⁻ᵀ 2ζΩ Φ⁻¹ turns it into z̈ + 2ζω_i ż + ω_i² z = 0
in x = Φz: every mode has the damping ratio ζ.

At rest at q the law asks for K_p q̃ + g(q_d), at most Σ_j |K_p,ij| max|q̃_j| + |g_i(q_d)| over the domain: what that is
beyond a motor's limit cannot be had from everywhere in it, and Theorem 3 knows of no limits. Where the motors are not
on the independent joints, u = (ρᵀSᵀ)⁺τ changes with q: over an atlas |u_i| ≤ ‖u‖₂ ≤ ‖τ‖₂/s with s the least singular
value of ρᵀSᵀ over its cells (a bound; infinite where it is not shown to be positive). Over a plain region it is taken
at q_d, an estimate as all there is.
"""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from ccpin.arrays import Array, number, positive
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.cell_facts import proved_of_cells
from ccpin.control.stability.set_point.certified_cells import CellStore, aligned
from ccpin.control.stability.set_point.flood import FloodLimits
from ccpin.control.stability.set_point.sampled_region import checked_region, sample_region
from ccpin.control.stability.set_point.set_point_cells import SlopeBounded
from ccpin.control.stability.set_point.set_point_reading import equations_of, radii_of
from ccpin.control.stability.set_point.starting_cells import cells_around, cells_of_atlas
from ccpin.control.stability.set_point.theorem3 import require_certifiable
from ccpin.covering.region import Corners
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.closures.packing import require_about
from ccpin.dynamics.drives import motor_units
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError, UnattainableGainsError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.facts import Fact, NotProvedError, is_fact
from ccpin.proof.verdict import Verdict

_ABOVE = 1.5  # of ‖∂g/∂q‖₂ at the set point: above 1, K_p + ∂g/∂q is positive definite there
_NO_SLOPE = 1e-12  # N m/rad or N/m: gravity does not act
_CELLS = 2000  # proved by default, after which the bound is taken as it is: more sharpen it
_CELLS_OF_A_SET = 500  # alike, where no cell's centre bears out what a set of robots adds
_ACCURACY = 0.05  # of a bound: near enough to what a cell's centre shows
_TORN = "on the atlas V is no function: boxes meet only with a turn of a joint that has a spring; pass a smaller one"


class Gains(NamedTuple):
    """Suggested gains.

    Attributes:
        K_p: margin · β · I, N m/rad or N/m, of shape (n, n).
        K_v: Symmetric positive definite, N m s/rad or N s/m, of shape (n, n).
        beta: sup ‖∂g/∂q‖₂ over the domain, or a bound of it.
        beta_seen: The largest ‖∂g/∂q‖₂ among the points looked at: β is between it and `beta`.
        steepest: q near which that bound is largest: what asks for such gains, of shape (n,).
        frequencies: ω of the linearised loop's modes in rad/s, ascending, of shape (n,).
        effort: The largest |u| asked for from rest anywhere in the domain, of shape (motors,); over an atlas a bound.
        effort_limit: What the motors can give either way (infinite where nothing is stated), of shape (motors,).
        reason: What limits the gains, in a sentence.
        proved: The fact about β over the atlas's cells (`SlopeBounded`); ``None`` where it was sampled, or says nothing
            of V on all of the atlas.
    """

    K_p: Array
    K_v: Array
    beta: float
    beta_seen: float
    steepest: Array
    frequencies: Array
    effort: Array
    effort_limit: Array
    reason: str
    proved: Fact | None = None

    @property
    def verdict(self) -> Verdict:
        """``"proven"`` where ‖∂g/∂q‖ < K_p is proved on the domain, ``"undecided"`` where it was sampled.

        What was pickled is undecided until ``gains._replace(proved=gains.proved.replay())``.
        """
        if not is_fact(self.proved, SlopeBounded) or not self.beta >= self.proved.found["beta"][0]:
            return "undecided"
        return "proven" if np.linalg.eigvalsh(0.5 * (self.K_p + self.K_p.T))[0] > self.beta else "undecided"


def local_gains(
    model: ReducedModel | Mechanism,
    q_d: ArrayLike,
    *,
    frequency: float = 10.0,
    damping: float = 1.0,
    near: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """K_p = ω² D + 1.5 ‖∂g/∂q‖₂ I and K_v for a damping ratio, at a set point alone.

    It is a stable set point (K_p above ∂g/∂q there) approached at ω or somewhat faster. How far from it that holds is
    for `certify_set_point` to say.

    Args:
        model: The reduced model, or a mechanism.
        q_d: The set point, of shape (n,).
        frequency: ω, rad/s.
        damping: ζ of every mode.
        near: Chooses the assembly mode of σ(q_d).

    Returns:
        K_p and K_v, of shape (n, n) each.

    Raises:
        InvalidInputError: A bad frequency or damping, or as `PDSimpleGravity`.
    """
    positive(frequency, "frequency"), positive(damping, "damping")
    model = model_of(model)
    law = PDSimpleGravity(model, q_d, np.ones(model.n), np.ones(model.n), near)
    mass = model.terms(law.q_d, np.zeros(model.n), law.q_free_d).D
    slope = model.gravity_derivative(law.q_d, law.q_free_d)
    stiffness = frequency**2 * mass + _ABOVE * float(np.linalg.norm(slope, 2)) * np.eye(model.n)
    return stiffness, _damped(mass, stiffness + slope, damping)[0]


def _damped(mass: Array, stiffness: Array, damping: float) -> tuple[Array, Array]:
    """K_v that gives every mode of D ẍ + K_v ẋ + K x = 0 a damping ratio, and their frequencies."""
    squares, modes = linalg.eigh(0.5 * (stiffness + stiffness.T), mass)
    frequencies, pulled = np.sqrt(squares), mass @ modes
    return pulled @ np.diag(2.0 * damping * frequencies) @ pulled.T, frequencies


def suggest_gains(
    model: ReducedModel | Mechanism,
    q_d: ArrayLike,
    domain: Atlas | Corners | None = None,
    *,
    constants: tuple[ArrayLike, ArrayLike] | None = None,
    margin: float = 1.5,
    damping: float = 0.7,
    fastest: float = 1e4,
    near: ArrayLike | None = None,
) -> Gains:
    """The smallest K_p with a margin over β on a domain, and K_v for a damping ratio at q_d.

    Args:
        model: The reduced model, or a mechanism.
        q_d: The set point, of shape (n,).
        domain: An atlas (β is bounded, to 5 % where 2000 cells beyond its own suffice); ``None``: a cell laid around
            q_d as `certify_set_point` lays its first, somewhat smaller than the largest that can be proved (`reason`
            says how large it is); or a region (lower, upper) over which β is sampled. Where a domain ends near a
            singularity β is large or far from sharp: `reason` says so, and a smaller one is what helps.
        constants: Bounds (lower, upper) of the constants of a set of robots, as for `certify_law`: β is then that of
            every robot of the set; all else is the model's. Over an atlas, or without a domain.
        margin: K_p over β, above 1.
        damping: ζ of every mode, above 0.
        fastest: The largest ω of the loop's modes that there may be, rad/s.
        near: Chooses the assembly mode of σ(q_d).

    Raises:
        DifferentSubjectsError: The atlas is of other closures than the model.
        UnattainableGainsError: They ask motors from rest somewhere in the domain for more than the file says they have,
            or make a mode faster than `fastest`; it has the gains, and says what limits them.
        InvalidInputError: A bad margin, damping or `fastest`, q_d outside of the domain, or gravity does not act there
            (β = 0).
        UnsupportedMechanismError, SingularConfigurationError: Without a domain: as for `certify_law`.
        UnreachableError: σ does not exist on all of a region.
    """
    number(margin, "margin", "a number above 1", 1.0), positive(damping, "damping"), positive(fastest, "fastest")
    model = model_of(model)
    ones = np.ones(model.n)
    law = PDSimpleGravity(model, q_d, ones, ones, near)
    radii = radii_of(model, constants)
    if domain is None:
        over = _over_one_cell(law, radii)
    elif isinstance(domain, Atlas):
        over = _over_atlas(law, domain, radii)
    elif radii is None:
        over = _over_samples(law, domain)
    else:
        raise InvalidInputError("of a set of robots nothing is sampled: give an atlas, or no domain")
    if not over.slope.bound > _NO_SLOPE:
        raise InvalidInputError("gravity has no slope on the domain (β = 0): any positive K_p satisfies Theorem 3")
    stiffness = margin * over.slope.bound * np.eye(model.n)
    mass = model.terms(law.q_d, np.zeros(model.n), law.q_free_d).D
    slope_here = model.gravity_derivative(law.q_d, law.q_free_d)
    damper, frequencies = _damped(mass, stiffness + slope_here, damping)
    gains = Gains(
        K_p=stiffness,
        K_v=damper,
        beta=over.slope.bound,
        beta_seen=over.slope.seen,
        steepest=over.slope.at,
        frequencies=frequencies,
        effort=over.effort(law, np.abs(stiffness)),
        effort_limit=np.abs(model.mechanism.motors.limits).min(axis=1),
        reason="; ".join([over.limited, *over.doubt]),
        proved=None if over.doubt else over.proved,
    )
    beyond = _what_is_too_much(model, gains, fastest)
    if beyond:
        slides = dict.fromkeys(slide for part in model.coordinates.parts for slide in part.slides)
        unit = " or ".join("N/m" if slide else "N m/rad" for slide in slides)
        raise UnattainableGainsError(f"K_p = {stiffness[0, 0]:.4g} I {unit} {beyond}: {gains.reason}", gains)
    return gains


class _Steepness(NamedTuple):
    """What is known of ‖∂g/∂q‖ over a domain.

    Attributes:
        slope: β, what was seen of it, and where.
        limited: What limits the gains, in a sentence.
        lower, upper: The box about the domain, of shape (n,) each.
        proved: The fact about β (`SlopeBounded`), if there is one.
        doubt: Why β is not proven, where it might have been.
    """

    slope: SlopeBound
    limited: str
    lower: Array
    upper: Array
    proved: Fact | None = None
    doubt: tuple[str, ...] = ()

    def effort(self, law: PDSimpleGravity, stiffness: Array) -> Array:
        """The largest |u| asked for from rest, of shape (motors,): a bound where β is a fact, else with ρ at q_d."""
        farthest = np.maximum(np.abs(law.q_d - self.lower), np.abs(self.upper - law.q_d))
        asked = stiffness @ farthest + np.abs(law.gravity_d)
        grip = np.inf if self.proved is None else float(self.proved.found["effort"][0])
        return _leverage(law) @ asked if np.isinf(grip) else np.full(law.model.n_actuated, _norm_over(asked, grip))


def _over_samples(law: PDSimpleGravity, region: Corners) -> _Steepness:
    """What samples of a region show: nothing is proved."""
    lower, upper = checked_region(law.model, region, law.q_d)
    samples = sample_region(law.model, lower, upper, law.q_free_d)
    worst = int(np.argmax(samples.norm))
    slope = SlopeBound(float(samples.norm[worst]), float(samples.norm[worst]), samples.q[worst], 0)
    limited = f"on samples ‖∂g/∂q‖ is at most {slope.bound:.4g}, {_place(slope)}: nothing is proved"
    return _Steepness(slope, limited, lower, upper)


def _over_atlas(law: PDSimpleGravity, atlas: Atlas, radii: Array | None) -> _Steepness:
    """What is proved of an atlas's cells."""
    require_about("gains over an atlas", atlas, law.model)
    return _over_cells(law, cells_of_atlas(law, atlas, radii), atlas.lower, atlas.upper, radii)


def _over_one_cell(law: PDSimpleGravity, radii: Array | None) -> _Steepness:
    """What is proved of a cell laid around q_d as `certify_law` lays its first, but for any ‖∂g/∂q‖ on it."""
    require_certifiable(law)
    n, slope = law.model.n, float(np.linalg.norm(law.model.gravity_derivative(law.q_d, law.q_free_d), 2))
    if not slope > _NO_SLOPE:
        raise InvalidInputError("gravity has no slope at q_d, so no domain suggests itself: give one")
    trial = PDSimpleGravity(law.model, law.q_d, np.full(n, _ABOVE * slope), np.ones(n), law.q_free_d)
    store = cells_around(trial, np.inf, FloodLimits(0, _CELLS), radii)
    cell = store[0]
    over = _over_cells(trial, store, cell.lower[None], cell.upper[None], radii)
    half = ", ".join(f"{value:.3g}" for value in 0.5 * (cell.upper - cell.lower))
    return over._replace(limited=f"over q_d ± ({half}): {over.limited}")


def _over_cells(law: PDSimpleGravity, store: CellStore, lower: Array, upper: Array, radii: Array | None) -> _Steepness:
    """What is proved of all cells of a domain of these corners, of shape (K, n) each."""
    slope = gravity_slope_over(store) if radii is None else gravity_slope_over(store, _CELLS_OF_A_SET)
    proved, doubt = None, [] if store.whole else [_TORN]
    try:
        proved = _proved(law, store, (lower, upper), slope.cells, radii)
        slope = slope._replace(bound=float(proved.found["beta"][0]))
    except NotProvedError as error:
        doubt.append(f"that was found, and did not hold when it was to be proved: {error}")
    return _Steepness(slope, _what_limits(slope), lower.min(axis=0), upper.max(axis=0), proved, tuple(doubt))


def _proved(
    law: PDSimpleGravity, store: CellStore, over: tuple[Array, Array], cells: tuple[int, ...], radii: Array | None
) -> Fact:
    """The fact about a domain's cells, by those that were proved for it."""
    equations = equations_of(law, store.reading, radii)
    return proved_of_cells(SlopeBounded, equations, store, cells, *aligned(*over))


def _leverage(law: PDSimpleGravity) -> Array:
    """|(ρᵀSᵀ)⁺| at q_d, of shape (motors, n): what motors give for one unit of each generalized force.

    It is the same everywhere where the motors sit on q.
    """
    transmission = law.near.reference.transmission
    return np.eye(law.model.n) if transmission is None else np.asarray(np.abs(np.linalg.pinv(transmission)))


def _norm_over(asked: Array, grip: float) -> float:
    """‖τ‖₂/s, infinite where s is not positive."""
    return float(np.linalg.norm(asked)) / grip if grip > 0.0 else np.inf


def _place(slope: SlopeBound) -> str:
    return f"near q = ({', '.join(f'{value:.4g}' for value in slope.at)})"


def _what_limits(slope: SlopeBound) -> str:
    """What limits the gains over an atlas."""
    if slope.bound <= 2.0 * slope.seen:
        return f"K_p is limited by ‖∂g/∂q‖ ≤ {slope.bound:.4g} {_place(slope)}"
    return (
        f"sup ‖∂g/∂q‖ is between {slope.seen:.4g} and {slope.bound:.4g} ({slope.proved} cells proved): the domain ends "
        f"near a singularity {_place(slope)}, where it grows without bound; pass a smaller one"
    )


def _what_is_too_much(model: ReducedModel, gains: Gains, fastest: float) -> str:
    """Which motors cannot give what gains ask for from rest, or which mode is too fast; nothing where none is."""
    motors = model.mechanism.motors
    units = [
        unit if gear == 1.0 else f"units of {gear:g} {unit}"
        for unit, gear in zip(motor_units(model.mechanism), motors.gears, strict=True)
    ]
    each = zip(motors.each, gains.effort, gains.effort_limit, units, strict=True)
    beyond = [
        f"{motor.joint} for up to {asked:.4g} of its {most:.4g} {unit}"
        for motor, asked, most, unit in each
        if asked > most
    ]
    if beyond:
        return f"asks {', '.join(beyond)} from rest in the domain"
    if gains.frequencies[-1] > fastest:
        return f"makes a mode of {gains.frequencies[-1]:.4g} rad/s, faster than {fastest:.4g}"
    return ""


class SlopeBound(NamedTuple):
    """The largest ‖∂g/∂q‖₂ at the centres of cells, a bound over them, and where it is largest.

    Also how many cells were proved for it, and which (by number) it is over.
    """

    seen: float
    bound: float
    at: Array
    proved: int
    cells: tuple[int, ...] = ()


def gravity_slope_over(store: CellStore, cells: int = _CELLS) -> SlopeBound:
    """A bound of sup ‖∂g/∂q‖₂ over proved cells: the one with the largest is halved until its centre bears it out."""
    heap = [(-cell.well.beta, k) for k, cell in enumerate(store.cells) if cell.well is not None]
    heapq.heapify(heap)
    seen, bound, number = 0.0, 0.0, 0
    while heap:
        bound, number = -heap[0][0], heap[0][1]
        seen = max(seen, float(np.linalg.norm(store.well(number).hessian - store.law.K_p, 2)))
        if bound <= (1.0 + _ACCURACY) * seen + 1e-12 or store.proved >= cells:
            break
        children = store.halve_proved(number)
        if children is None:
            break
        heapq.heappop(heap)
        for child in children:
            heapq.heappush(heap, (-store.well(child).beta, child))
    over = tuple(sorted(k for _, k in heap))
    return SlopeBound(seen, bound, 0.5 * (store[number].lower + store[number].upper), store.proved, over)
