"""Which Newton step stays on its branch: a proof, not an estimate.

Let x be a configuration with ψ̄(x, q) = −g (11), ψ_q′ regular there with inverse Y, u = Y g Newton's step, and
G_s(e) = ψ̄(x ⊕ e, q) + (1 − s) g for s in [0, 1]: from a closed x its zeros lie over the straight line from α(x) to q;
from an open one φ and the way to q vanish together. Clusters share no row and no column of ψ, so each is treated alone.
In the Euclidean norm (lengths counted in the cluster's unit) let t ≥ |u|, N = Y ψ″(x)[u, ·], ν ≥ ‖N‖, s₂ ≥ ½|N u|, and
on the ball |e| ≤ t + ε let c ≥ ‖Y‖ sup‖ψ″‖, k ≥ ‖Y‖ sup‖ψ‴‖, k₂ ≥ ‖Y‖ sup‖ψ‴[u, u, ·]‖,
k₃ ≥ ‖Y‖ sup|ψ‴[u, u, u]|
(`ccpin.kinematics.curvature`).

*Theorem.* If for f in (0, 1] and an ε ≤ t

    f² s₂ + ⅙ f³ k₃ + (f ν + ½ f² k₂) ε + ½ (c + k f t) ε² + ⅙ k ε³ ≤ ε   and
    f ν + ½ f² k₂ + c ε + k (f t + ½ ε) ε < 1,

then ψ_q′ is regular in the whole tube {s u + e: 0 ≤ s ≤ f, |e| ≤ ε}, and there is one continuous path d(s) with d(0)
= 0 and G_s(s u + d(s)) = 0 for 0 ≤ s ≤ f; for each s it is the only zero in its slice of the tube.

*Proof.* By Taylor's formula T_s(d) = d − Y G_s(s u + d) is at most s² s₂ + s ν|d| + ½ c|d|² + ⅙ ‖Y‖|ψ‴[s u + d, s u +
d, s u + d]| in size, so it maps |d| ≤ ε into itself by the first inequality, and contracts by the second: its
derivative 1 − Y ψ_q′ has norm below one, so ψ_q′ is regular, Banach's theorem gives the zero, and it is continuous in
s. At s = 0 it is d = 0. Where ψ is tall, Y its pseudo-inverse, d(s) is analytic and solves all rows of ψ̄ if the
linkage has n freedoms at x.

So the zero at s = 1 is σ(q) on the branch of x, and a solution within ε of x ⊕ u is that zero. With ν = c t, s₂ = ½ c
t² and k = 0 this is the Newton–Kantorovich theorem, which needs no ψ″(x): it is tried first. Then the theorem as it
is, and in the norm |d|* = ‖Y‖|ψ_q′ d| of dependent displacements d, in which Y G has ‖Y‖|G|, N becomes ψ″(x)[u, Y ·],
and |d| ≤ |d|*: near singular points it reaches further. The theorem holds up to rounding, which is not enclosed:
contraction 0.9 stands for 1, ‖Y‖ times the tolerance of closed points is added to s₂.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, skew
from ccpin.description.rotations import log_bounds
from ccpin.kinematics.clusters import clusters
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.coordinates import Coordinate, IndependentCoordinates
from ccpin.kinematics.curvature import Curvature, unit_of
from ccpin.kinematics.linear import Factor
from ccpin.kinematics.loops import ResolvedTerm
from ccpin.kinematics.tree import TreeJoint

CONTRACTION = 0.9
SHORT = 0.1
SMALL = 0.6
LONGEST = 0.5
SHORTER = 0.8
ROUNDS = 12
TRIALS = 16
TINY = 1e-300


class End(NamedTuple):
    """Where a step ends in one cluster: the tube there.

    Attributes:
        columns: The cluster's.
        step: All of u, of shape (columns,).
        size: What the size of a displacement from f u is taken of: a matrix, of shape (·, columns).
        radius: ε.
    """

    columns: Indices
    step: Array
    size: Array
    radius: float


class Proof(NamedTuple):
    """What is proven of a Newton step.

    Attributes:
        part: Which part of the step stays on its branch: 1 all of it, 0 none that is worth while.
        ends: By cluster.
    """

    part: float
    ends: tuple[End, ...]

    def within(self, most: float) -> Proof:
        """The same for no more than a part of the step."""
        return self._replace(part=min(self.part, most))

    def holds(self, displacement: Array) -> bool:
        """Whether a solution at a displacement from the step's start is the one proven."""
        away = ((end.size @ (displacement[end.columns] - self.part * end.step), end.radius) for end in self.ends)
        return all(np.linalg.norm(size) <= radius for size, radius in away)


TRUSTED = Proof(1.0, ())


class ClusterRows(NamedTuple):
    """Which rows and columns of ψ_q′ a cluster has, and how they bend.

    Attributes:
        columns: All its components of q̇′.
        dependent, direct: Those solved for, and those that are components of q̇.
        gaps: The rows of ψ of these last.
        rows: Of φ, then of components in α.
        unit: Metres that count as 1.
        units, across: By column, by dependent column: metres or radians that count as 1.
        weights: By row, likewise.
        loops: Which loops it has.
        passed: Which of its columns each of them passes, of shape (loops, columns), 1.0 or 0.0.
        terms: By coupling that is not linear: its terms.
        components: Its independent components of joints.
        curved: Its dependent joints with quaternions or planes.
    """

    columns: Indices
    dependent: Indices
    direct: Indices
    gaps: Indices
    rows: Indices
    unit: float
    units: Array
    across: Array
    weights: Array
    loops: Indices
    passed: Array
    terms: tuple[tuple[ResolvedTerm, ...], ...]
    components: tuple[Coordinate, ...]
    curved: tuple[TreeJoint, ...]


class Bent(NamedTuple):
    """Bounds of |ψ″|, |ψ‴|, and of |ψ‴[u, u, ·]| and |ψ‴[u, u, u]| for the step u; times ‖Y‖: c, k, k₂, k₃."""

    second: float
    third: float
    along: float
    thrice: float

    def times(self, size: float) -> Bent:
        """Each times a size."""
        return Bent(*(size * bound for bound in self))


class _Start(NamedTuple):
    """A cluster at the start of a step.

    Attributes:
        cluster: Which.
        rows: ψ_q′, its rows.
        inverse: Y, from its rows to its dependent columns.
        step, size: u and t.
        inverse_size: ‖Y‖.
        noise: ‖Y‖ times the tolerance.
    """

    cluster: ClusterRows
    rows: Array
    inverse: Array
    step: Array
    size: float
    inverse_size: float
    noise: float

    @property
    def ball(self) -> float:
        """The radius of a ball that holds the tube."""
        return 2.0 * min(self.size, LONGEST) + 8.0 * self.noise


class Branches:
    """Proves Newton steps of one mechanism.

    Args:
        constraints: φ.
        coordinates: α.
        tolerance: Largest |ψ̄| of a configuration taken for closed.
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates, tolerance: float) -> None:
        self._constraints, self._coordinates, self._tolerance = constraints, coordinates, tolerance
        self.clusters = tuple(_clusters(constraints, coordinates))
        units = np.ones(len(constraints.loops))
        for cluster in self.clusters:
            units[cluster.loops] = cluster.unit
        self._curvature = Curvature(coordinates.tree, constraints.loops, units)

    def prove(self, at: ConstraintValue, psi: Array, gap: Array) -> Proof:
        """How much of the Newton step from a configuration stays on its branch, ψ_q′ and g = −ψ̄ there being given."""
        starts = [self._start(cluster, psi, gap) for cluster in self.clusters]
        whole = np.zeros(self._constraints.model.nv)
        radii = np.zeros(len(self._constraints.loops))
        for start in starts:
            whole[start.cluster.columns] = start.step
            radii[start.cluster.loops] = start.ball
        loops = self._curvature.bounds(at, radii)
        rate, part, ends = None, 1.0, []
        for start in starts:
            cluster, t, y = start.cluster, start.size, start.inverse_size
            bent = self._bounds(start, at.q_free, loops).times(y)
            kantorovich = Bent(bent.second, 0.0, 0.0, 0.0)
            found = tube(t, bent.second * t, 0.5 * bent.second * t**2, kantorovich, start.noise)
            size = np.diag(1.0 / cluster.units)
            if found is None:
                rate = self._rate(at, whole) if rate is None else rate
                turned = _turned(start, rate)
                found = longest(t, turned.before, turned.sag_before, bent, start.noise)
                other = longest(t, turned.after, turned.sag_after, bent, start.noise)
                if other.part > found.part:
                    found, size = other, y * start.rows[:, cluster.columns] / cluster.weights[:, None]
            part = min(part, found.part)
            ends.append(End(cluster.columns, start.step, size, found.radius))
        return Proof(part, tuple(ends))

    def short(self, factor: Factor, step: Array) -> bool:
        """Whether a step is far from where it could leave its branch, by estimates.

        It must be short, and ‖ψ_q′⁻¹‖ as told by a right side of no structure, times how the rows bend at the
        reference, times its length small. (½ is the largest value in the Newton–Kantorovich theorem; the bound of how
        rows bend is an overestimate, by two or more where there are several loops.)
        """
        rows, found = self._constraints.size + self._coordinates.n, []
        told = np.abs(factor.solve(np.concatenate([self._unstructured, np.zeros(rows - len(self._unstructured))])))
        for cluster, bent in zip(self.clusters, self._bent, strict=True):
            size = float(np.linalg.norm(step[cluster.columns] / cluster.units))
            inverse = float((told[cluster.dependent] / cluster.across).max())
            found.append(size <= SHORT and inverse * bent * size <= SMALL)
        return all(found)

    @cached_property
    def _unstructured(self) -> Array:
        """A right side of no structure, in units of the rows of φ."""
        weights = np.ones(self._constraints.size)
        for cluster in self.clusters:
            loops = cluster.rows < len(weights)
            weights[cluster.rows[loops]] = cluster.weights[loops]
        return np.asarray(
            weights * np.random.default_rng(5).choice([-1.0, 1.0], len(weights)) * np.linspace(0.6, 1.0, len(weights))
        )

    @cached_property
    def _bent(self) -> list[float]:
        """|ψ″| of each cluster around the reference."""
        at = self._constraints.value(self._coordinates.q_reference)
        loops = self._curvature.bounds(at, np.zeros(len(self._constraints.loops)))[:, 0] ** 2
        own, shared = loops
        return [float(own[c.loops].max(initial=0.0) + shared[c.loops].sum()) ** 0.5 for c in self.clusters]

    def _start(self, cluster: ClusterRows, psi: Array, gap: Array) -> _Start:
        rows = psi[cluster.rows]
        a = rows[:, cluster.dependent]
        inverse = np.linalg.inv(a) if len(a) == a.shape[1] else np.linalg.pinv(a)
        step = np.zeros(psi.shape[1])
        step[cluster.direct] = gap[cluster.gaps]
        step[cluster.dependent] = inverse @ (gap[cluster.rows] - rows[:, cluster.direct] @ step[cluster.direct])
        step = step[cluster.columns]
        size, weighted = (
            float(np.linalg.norm(step / cluster.units)),
            inverse / cluster.across[:, None] * cluster.weights,
        )
        inverse_size = float(np.linalg.norm(weighted))
        noise = inverse_size / min(cluster.unit, 1.0) * self._tolerance * len(cluster.rows) ** 0.5
        return _Start(cluster, rows, np.asarray(inverse, dtype=np.float64), step, size, inverse_size, noise)

    def _bounds(self, start: _Start, q_free: Array, loops: Array) -> Bent:
        """Of a cluster's rows within its ball, from those of each loop."""
        cluster, reference = start.cluster, self._coordinates.q_reference
        own, shared = loops[:, :, cluster.loops].transpose(1, 0, 2) ** 2
        others = [_slopes(cluster, terms, q_free, start.ball) for terms in cluster.terms]
        others += [component_bounds(part, q_free, reference, start.ball) for part in cluster.components]
        second, third = (np.array(others).reshape(-1, 2) ** 2).sum(axis=0)
        steps = cluster.passed @ (start.step / cluster.units) ** 2  # |u|² by loop
        along = (own[1] * steps**2).max(initial=0.0) + shared[1] @ steps**2 + third * start.size**4
        thrice = (own[1] + shared[1]) @ steps**3 + third * start.size**6
        whole = own.max(axis=1, initial=0.0) + shared.sum(axis=1) + [second, third]
        return Bent(*np.sqrt([*whole, along, min(thrice, along * start.size**2)]).tolist())

    def _rate(self, at: ConstraintValue, step: Array) -> Array:
        """ψ̇_q′ along a step, of shape (m + n, n′)."""
        alpha = self._coordinates.jacobian_rate(at.q_free, step)
        rows = self._constraints.rate(at, step)
        return np.concatenate([rows, np.zeros((self._coordinates.n, len(step))) if alpha is None else alpha])


class Tube(NamedTuple):
    """The part f of a step that the theorem holds for, and ε."""

    part: float
    radius: float


def tube(size: float, turning: float, sag: float, bent: Bent, noise: float, part: float = 1.0) -> Tube | None:
    """The theorem for given t, ν, s₂, bounds, ‖Y‖ times the tolerance, and f; ``None`` where no ε is found."""
    way, turned, along = part * size, part * turning, part**2 * bent.along
    start = part**2 * sag + part**3 * bent.thrice / 6.0 + 4.0 * noise
    radius = start
    for _ in range(ROUNDS):
        if not (radius <= way + 8.0 * noise and way <= LONGEST):
            return None
        need = start + (turned + 0.5 * along) * radius + 0.5 * (bent.second + bent.third * way) * radius**2
        need += bent.third * radius**3 / 6.0
        if need <= radius:
            contraction = turned + bent.second * radius + 0.5 * along + bent.third * (way + 0.5 * radius) * radius
            return Tube(part, radius) if contraction <= CONTRACTION else None
        radius = 1.05 * need
    return None


def longest(size: float, turning: float, sag: float, bent: Bent, noise: float) -> Tube:
    """The longest part of a step that the theorem is found to hold for."""
    root = (sag * bent.second) ** 0.5 + (0.5 * bent.along) ** 0.5  # a little more than what its terms allow one by one
    part = min(1.0, 1.2 * min(LONGEST / max(size, TINY), CONTRACTION / max(turning + root, TINY)))
    for _ in range(TRIALS):
        found = tube(size, turning, sag, bent, noise, part)
        if found is not None:
            return found
        part *= SHORTER
    return Tube(0.0, 0.0)


class _Turned(NamedTuple):
    """ν and s₂ of a step in the norm of displacements, ‖Y ψ″[u, ·]‖, and in that of rows, ‖ψ″[u, Y ·]‖."""

    before: float
    sag_before: float
    after: float
    sag_after: float


def _turned(start: _Start, rate: Array) -> _Turned:
    """From ψ̇_q′ along the step."""
    cluster, rows = start.cluster, rate[start.cluster.rows]
    bent = rows[:, cluster.columns] @ start.step
    turning = rows[:, cluster.dependent]
    for joint in cluster.curved:  # velocities in ψ̇_q′ are those of moving frames; here they are exponential coordinates
        at, where = (np.flatnonzero(np.isin(each, _components(joint))) for each in (cluster.dependent, cluster.columns))
        turning[:, at] -= 0.5 * start.rows[:, cluster.dependent[at]] @ _bracket(joint, start.step[where])
    units, weights = cluster.across, cluster.weights
    before, after = start.inverse @ turning, turning @ start.inverse
    return _Turned(
        float(np.linalg.norm(before * units / units[:, None])),
        0.5 * float(np.linalg.norm(start.inverse @ bent / units)),
        float(np.linalg.norm(after * weights / weights[:, None])),
        0.5 * start.inverse_size * float(np.linalg.norm(bent / weights)),
    )


def _clusters(constraints: Constraints, coordinates: IndependentCoordinates) -> Iterator[ClusterRows]:
    """The clusters that have something to solve for."""
    tree, loops, m = coordinates.tree, constraints.loops, constraints.size
    owner = [joint.number for joint in tree.joints for _ in joint.kind.steps]
    ties = [[*loop.path_a, *loop.path_b] for loop in loops]
    ties += [[owner[term.idx_v] for term in coupling.terms] for coupling in constraints.couplings]
    slides = np.array([slide for joint in tree.joints for slide in joint.kind.slides], dtype=bool)
    stops = np.cumsum([*(loop.size for loop in loops), *(1 for _ in constraints.couplings)], dtype=int)
    windows = [np.arange(a, b) for a, b in zip([0, *stops], stops, strict=False)]
    for cluster in clusters([0, *(joint.parent for joint in tree.joints)], ties):
        joints = [tree.joints[number - 1] for number in cluster.joints]
        inside = set(cluster.joints)
        columns = np.concatenate([_components(joint) for joint in joints])
        parts = [part for part in coordinates.parts if owner[part.v_free.start] in inside]
        whole, single = ([p for p in parts if (p.component is None) == each] for each in (True, False))
        direct = _joined(np.arange(part.v_free.start, part.v_free.stop) for part in whole)
        dependent = columns[~np.isin(columns, direct)]
        if not len(dependent):
            continue
        mine = [k for k, tie in enumerate(ties) if tie and tie[0] in inside]
        own = [k for k in mine if k < len(loops)]
        terms = [constraints.couplings[k - len(loops)].terms for k in mine if k >= len(loops)]
        unit = unit_of(tree, [loops[k] for k in own])
        lengths = [not turns for k in own for turns in loops[k].rows.direction_rows]
        lengths += [False] * len(terms) + [part.slides[0] for part in single]
        rows = _joined([*(windows[k] for k in mine), *(m + np.arange(p.v.start, p.v.stop) for p in single)])
        yield ClusterRows(
            columns,
            dependent,
            direct,
            m + _joined(np.arange(part.v.start, part.v.stop) for part in whole),
            rows,
            unit,
            np.where(slides[columns], unit, 1.0),
            np.where(slides[dependent], unit, 1.0),
            np.where(lengths, unit, 1.0),
            np.array(own, dtype=np.intp),
            np.array([loops[k].mask_a[columns] + loops[k].mask_b[columns] for k in own]).reshape(-1, len(columns)),
            tuple(each for each in terms if any(len(term.coefficients) > 2 for term in each)),
            tuple(single),
            tuple(j for j in joints if j.kind.unit and j.kind.nv > 1 and j.v.start in dependent),
        )


def _joined(windows: Iterator[Indices] | list[Indices]) -> Indices:
    return np.concatenate([np.empty(0, dtype=np.intp), *windows])


def _components(joint: TreeJoint) -> Indices:
    return np.arange(joint.v.start, joint.v.stop)


def _slopes(cluster: ClusterRows, terms: tuple[ResolvedTerm, ...], q_free: Array, radius: float) -> tuple[float, float]:
    """Bounds of a coupling's second and third derivative within a ball."""
    second = third = 0.0
    for term in terms:
        unit = float(cluster.units[np.searchsorted(cluster.columns, term.idx_v)])
        far, sizes = abs(term.angle(q_free)) + unit * radius, np.abs(term.coefficients)
        slopes = [np.polynomial.polynomial.polyval(far, np.polynomial.polynomial.polyder(sizes, k)) for k in (2, 3)]
        second, third = second + float(slopes[0]) * unit**2, third + float(slopes[1]) * unit**3
    return second, third


def component_bounds(part: Coordinate, q_free: Array, q_reference: Array, radius: float) -> tuple[float, float]:
    """The same for a row of α that reads one component of a joint's pose, in units of the cluster."""
    if part.slides[0]:
        return 1.0 + radius, 2.0 + radius
    if part.kind.unit != 4:
        return 0.0, 0.0
    vector = part.kind.rotation_vector(q_free[part.q_free], q_reference[part.q_free])
    return log_bounds(float(np.linalg.norm(vector)) + radius)


def _bracket(joint: TreeJoint, velocity: Array) -> Array:
    """ad_V of a joint's velocity V in its moving frame, over its own components."""
    linear, angular = joint.kind.twist(velocity).reshape(2, 3)
    whole = np.block([[skew(angular), skew(linear)], [np.zeros((3, 3)), skew(angular)]])
    return np.asarray(whole[np.ix_(joint.kind.entries, joint.kind.entries)])
