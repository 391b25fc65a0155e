"""ψ of a mechanism as a polynomial system without a monomial above degree two, centred at a configuration.

The unknowns are u = cos Δ, s = sin Δ for each angle (u² + s² = 1), a displacement d for each prismatic joint, a
unit quaternion for each spherical joint, all measured from the centre, and one more for each product that would
otherwise pass degree two. The equations, in this order:

- identities: unit circles, unit quaternions, definitions of the products; they hold for every q′, closed or not;
- closures: the very rows of φ (`ccpin.description.closure_kinds`), and sin(D φ) for a coupling
  (`ccpin.domain.theorem2.couplings`);
- last n: a simple function of each independent coordinate equals its right side: sin(qᵢ − qᵢ⁰) for an angle,
  qᵢ − qᵢ⁰ for a displacement, twice the vector part of the quaternion of R₀ᵀR for a spherical joint.

Two forms are offered. ``"angles"`` keeps each joint's own angle. ``"absolute"`` sums the angles of successive
joints about parallel axes (`ccpin.domain.theorem2.trees`): planar loops become affine in direction vectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.description.closure_kinds import Gap
from ccpin.description.closure_kinds import Vector as ClosureVector
from ccpin.description.joint_kinds import split_component
from ccpin.domain.theorem2.couplings import coupling_row
from ccpin.domain.theorem2.polynomials import Polynomial, QuadraticSystem, combine
from ccpin.domain.theorem2.trees import Kinematics, SimpleTree, find_runs, simple_tree
from ccpin.domain.theorem2.unknowns import NOISE, Unknowns, Vector, plus
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.mechanism import Mechanism

Form = Literal["angles", "absolute"]
FORMS: tuple[Form, ...] = get_args(Form)
COEFFICIENT_ERROR = 1e-12
"""The coefficients' error, relative to the largest row sum, as it is taken to be (`radius` says what rests on it)."""


@dataclass(frozen=True, eq=False)
class QuadraticForm:
    """A mechanism's ψ in quadratic form.

    Attributes:
        form: Which form.
        system: The quadratic system, its right side zero at the centre.
        centre: The unknowns' values at the centre, of shape (N,).
        closures: Which equations are those of the loops and couplings.
        coordinates: Kinds of the last n equations: ``"angle"``, ``"displacement"`` or ``"rotation"``.
        unknowns: How each unknown depends on q′.
        error: Bound on the coefficients' relative error (to the largest row sum of coefficients).
    """

    form: Form
    system: QuadraticSystem
    centre: Array
    closures: slice
    coordinates: tuple[str, ...]
    unknowns: Unknowns
    error: float

    def lift(self, q_free: Array) -> Array:
        """The unknowns' values z(q′) at any configuration, closed or open, of shape (N,)."""
        return self.unknowns.lift(q_free)


def quadratic_form(mechanism: Mechanism, q_free: Array, form: Form) -> QuadraticForm:
    """Generate the quadratic form of a mechanism about a configuration q′ of shape (nq,).

    Joints on no loop and in no coupling do not enter: they move freely, whatever the others do.

    Raises:
        UnsupportedMechanismError: φ holds redundant rows; an independent coordinate is one component of a rotation
            vector; a coupling is not algebraic.
        InvalidInputError: An unknown form.
    """
    if form not in FORMS:
        raise InvalidInputError(f"unknown quadratic form '{form}'; those are {', '.join(FORMS)}")
    constraints = mechanism.constraints()
    _check_square(mechanism, constraints)
    tree = simple_tree(mechanism.tree)
    parts = {joint.name: tree.parts[joint.number] for joint in mechanism.tree.joints}
    numbers = {joint.name: number for number, joint in tree.joints.items()}
    on_loops = {j for loop in constraints.loops for j in tree.path((*loop.path_a, *loop.path_b))}
    coupled = {numbers[term.joint] for coupling in mechanism.couplings for term in coupling.terms}
    ancestors = {tree.parts[loop.ancestor][-1] for loop in constraints.loops}
    runs = find_runs(tree.joints, on_loops, ancestors, merge=form == "absolute")
    kinematics = Kinematics(tree.joints, runs, sorted(on_loops | coupled), q_free)
    closures = [row for loop in constraints.loops for row in _closure_rows(kinematics, loop, tree)]
    closures += [coupling_row(kinematics, coupling, numbers, q_free) for coupling in mechanism.couplings]
    last, kinds = _last_rows(kinematics, mechanism.independent, parts, numbers)
    identities = kinematics.unknowns.identities()
    rows = [row.cleaned(NOISE) for row in (*identities, *closures, *last)]
    system = QuadraticSystem.from_polynomials(kinematics.unknowns.names, rows, free=len(last))
    window = slice(len(identities), len(identities) + len(closures))
    return QuadraticForm(
        form=form,
        system=system,
        centre=frozen(kinematics.unknowns.centre),
        closures=window,
        coordinates=kinds,
        unknowns=kinematics.unknowns,
        error=COEFFICIENT_ERROR + 16.0 * _rigidity_defect(tree.joints, constraints.loops),
    )


def _check_square(mechanism: Mechanism, constraints: Constraints) -> None:
    needed = mechanism.n_free - mechanism.n
    if constraints.size != needed:
        raise UnsupportedMechanismError(
            f"mechanism '{mechanism.name}' keeps {constraints.size} closure rows of rank {needed}, and Theorem 2 needs "
            f"a square system: a certificate of {needed} of the rows would not be one of all, as the others are "
            "redundant by numerical rank only, not by proof"
        )


def _rigidity_defect(joints: dict[int, TreeJoint], loops: Sequence[ResolvedClosure]) -> float:
    """How far placements are from rotations: the largest entry of RᵀR − I, and of 1 − |axis|."""
    turns = [joint.placement[:3, :3] for joint in joints.values()]
    turns += [frame[:3, :3] for loop in loops for frame in (loop.frame_a, loop.frame_b)]
    axes = [abs(float(np.linalg.norm(joint.axis)) - 1.0) for joint in joints.values()]
    return max([*axes, *(float(np.abs(turn.T @ turn - np.eye(3)).max()) for turn in turns)])


def _closure_rows(kinematics: Kinematics, loop: ResolvedClosure, tree: SimpleTree) -> list[Polynomial]:
    """The rows of φ of one loop, in their order there."""
    chains = {"A": tree.path(loop.path_a), "B": tree.path(loop.path_b), "C": []}
    frames = {"A": loop.frame_a, "B": loop.frame_b, "C": np.eye(4)}
    ends = [kinematics.carried(chains[end], frames[end][:3, 3], point=True) for end in ("A", "B")]
    gap = plus(ends[1], ends[0], -1.0)

    def value(vector: ClosureVector) -> Vector:
        if isinstance(vector, Gap):
            return gap
        local = frames[vector.frame][:3, :3] @ vector.local
        return kinematics.carried(chains[vector.frame], local, point=False)

    return loop.rows.evaluate(value, kinematics.unknowns.dot, combine)


def _last_rows(
    kinematics: Kinematics, independent: tuple[str, ...], parts: dict[str, tuple[int, ...]], numbers: dict[str, int]
) -> tuple[list[Polynomial], tuple[str, ...]]:
    """The last n equations, and the kind of each: ``angle``, ``displacement`` or ``rotation``."""
    rows: list[Polynomial] = []
    kinds: list[str] = []
    for name in independent:
        joint, component = split_component(name, parts)
        if component and name not in numbers:
            raise UnsupportedMechanismError(
                f"'{name}' is one component of a rotation vector, which is no polynomial of the quaternion; make the "
                "whole joint independent, or other joints"
            )
        for j in (numbers[name],) if component else parts[joint]:
            variables, kind = kinematics.variables.get(j), kinematics.joints[j].kind
            if variables is None:
                continue
            if kind.nv == 1 and kind.sliding:
                rows, kinds = [*rows, variables[0]], [*kinds, "displacement"]
            elif kind.unit == 4:
                rows, kinds = [*rows, *(x.scaled(2.0) for x in variables[:3])], [*kinds, *3 * ["rotation"]]
            else:
                rows, kinds = [*rows, kinematics.turn(j)[1]], [*kinds, "angle"]
    return rows, tuple(kinds)
