"""`load` and `Mechanism`: a closed, analysed closed-chain mechanism, immutable and picklable."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Protocol

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, Record
from ccpin.description import read_description
from ccpin.description.checks import check
from ccpin.description.model import Coupling, LoopClosure, MechanismDescription
from ccpin.errors import (
    DescriptionError,
    IndependentSetError,
    InvalidInputError,
    LoopNotClosedError,
    NoLoopError,
    SingularConfigurationError,
    UnsupportedMechanismError,
)
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import Parametrization
from ccpin.kinematics.tree import Tree, build_tree
from ccpin.mechanism.closing import Closed, find_closed
from ccpin.mechanism.from_pinocchio import describe_pinocchio
from ccpin.mechanism.mobility import Mobility, conditioning, generic_rank, idle_motions, independence, null_space
from ccpin.mechanism.selection import choose_independent


@dataclass(frozen=True, eq=False)
class Mechanism(Record):
    """A closed-chain mechanism: the free system, its closures, and which coordinates are independent.

    Nothing in it can be written to; it is equal to itself only, hashable and picklable.

    Attributes:
        description: What the file says.
        tree: The free system Σ′ as the Pinocchio model ccpin computes with, and where each link sits.
        independent: Names of the independent joints (or ``joint:axis`` components), in the order of q.
        actuated: Names of the actuated joints, in the order of u.
        q_reference: A closed, nonsingular configuration, of shape (nq,); defines the default assembly mode.
        mobility: The mobility analysis.
        notes: What readers and analysis had to assume, in sentences.
    """

    description: MechanismDescription
    tree: Tree
    independent: tuple[str, ...]
    actuated: tuple[str, ...]
    q_reference: Array
    mobility: Mobility
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The mechanism's name in its file."""
        return self.description.name

    @cached_property
    def pin_model(self) -> pin.Model:
        """A copy of the free system's Pinocchio model, the caller's own: ccpin reads nothing written to it.

        One copy a mechanism, made when first asked for; a pickle does not carry it.
        """
        return self.tree.model.copy()

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """The loop closures."""
        return self.description.closures

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """The joint couplings."""
        return self.description.couplings

    @property
    def nq(self) -> int:
        """Size of a configuration q′."""
        return int(self.tree.model.nq)

    @property
    def n_free(self) -> int:
        """n′, the number of velocity components of the free system."""
        return int(self.tree.model.nv)

    @property
    def n(self) -> int:
        """The number of independent velocities."""
        return self.mobility.mobility

    @property
    def actuation(self) -> Array:
        """S of shape (motors, n′), constant: u enters the free system as Sᵀu.

        Raises:
            UnsupportedMechanismError: A single component of a joint is actuated, so that S depends on q′
                (`State.joint_efforts` gives Sᵀu then).
        """
        coordinates = IndependentCoordinates(self.tree, self.actuated, self.q_reference)
        if not coordinates.constant:
            raise UnsupportedMechanismError("S is not constant: a single component of a joint is actuated")
        return coordinates.jacobian(self.q_reference)

    def __repr__(self) -> str:
        return f"Mechanism({', '.join(f'{key}: {value}' for key, value in self._summary())})"

    def _repr_html_(self) -> str:
        """A small table for notebooks."""
        gravity = ", ".join(f"{g:g}" for g in self.description.gravity)
        rows = [*self._summary(), ("gravity", f"({gravity}) m/s²"), *(("note", note) for note in self.notes)]
        cells = (f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows)
        return f"<table>{''.join(cells)}</table>"

    def _summary(self) -> list[tuple[str, str]]:
        """What identifies the mechanism to its reader, in words."""
        lists = {
            "loops": [closure.name for closure in self.closures],
            "couplings": [coupling.name for coupling in self.couplings],
            "independent": self.independent,
            "actuated": self.actuated,
        }
        sizes = [("name", self.name), ("n", str(self.n)), ("n′", str(self.n_free))]
        return sizes + [(key, " ".join(names)) for key, names in lists.items() if names]

    def constraints(self) -> Constraints:
        """φ; one for all who ask."""
        return self._parametrization.constraints

    def parametrization(self) -> Parametrization:
        """ψ, σ, ρ; one for all who ask."""
        return self._parametrization

    @cached_property
    def _parametrization(self) -> Parametrization:
        coordinates = IndependentCoordinates(self.tree, self.independent, self.q_reference)
        return Parametrization(Constraints(self.tree, self.closures, self.couplings), coordinates, self.q_reference)


class HasMechanism(Protocol):
    """What a mechanism can be read off: a `ReducedModel`, say."""

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""


def mechanism_of(thing: Mechanism | HasMechanism) -> Mechanism:
    """The mechanism itself, or that of a model.

    Raises:
        InvalidInputError: It is neither.
    """
    found = getattr(thing, "mechanism", thing)
    if not isinstance(found, Mechanism):
        raise InvalidInputError(f"a mechanism (`ccpin.load`) or a ReducedModel is needed, not {type(thing).__name__}")
    return found


_FROM_SINGULAR = "a step away from a singular closed pose"


def load(
    path: str | Path | MechanismDescription | pin.Model,
    *,
    closures: Iterable[LoopClosure] | None = None,
    couplings: Iterable[Coupling] | None = None,
    independent: Sequence[str] | None = None,
    actuated: Sequence[str] | None = None,
    floating_base: bool = False,
    format: str | None = None,
    model: str | None = None,
    include_root: str | Path | None = None,
    xacro_arguments: Mapping[str, str] | None = None,
    geometry: pin.GeometryModel | None = None,
    constraints: Iterable[object] = (),
) -> Mechanism:
    """Load a mechanism from a file, an installed model's name, a description or a Pinocchio model.

    Args:
        path: A file (URDF with loop elements, SDFormat, toolbox-parallel-robots YAML, MJCF), the name of a model that
            comes with ccpin (``"rpdr"``), a `MechanismDescription`, or a `pinocchio.Model`.
        closures: Loop closures, in addition to the file's.
        couplings: Joint couplings, in addition to the file's.
        independent: The independent joints in the order of q; default what the file marks, completed if it marks
            only motors (the completion is among the mechanism's notes).
        actuated: The actuated joints in the order of u; default the file's motors, else the independent joints.
        floating_base: Free the root link with a 6-dof joint named ``root_joint``.
        format: ``"urdf"``, ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` to override detection from the content.
        model: Which model of an SDFormat file to read, where it holds several.
        include_root: The folder an SDFormat file may include others from; default its own.
        xacro_arguments: Values of a xacro file's arguments (the extra ``[xacro]``).
        geometry: What to draw of a `pinocchio.Model`.
        constraints: Pinocchio's constraint models that close the loops of a `pinocchio.Model`.

    Raises:
        DescriptionNotFoundError, InvalidXmlError, DescriptionError: The file is absent, malformed or unsound.
        NoLoopError: It declares no closure and no coupling.
        LoopNotClosedError: No closed configuration was found.
        IndependentSetError: The independent or actuated joints named cannot be used.
    """
    _check_arguments(path, independent, actuated)
    if isinstance(path, MechanismDescription):
        description = path
    elif isinstance(path, pin.Model):
        description = describe_pinocchio(path, geometry=geometry, constraints=constraints)
    else:
        description = read_description(
            path, format, model=model, include_root=include_root, xacro_arguments=xacro_arguments
        )
    if description is path or closures or couplings:
        description = check(
            replace(
                description,
                closures=description.closures + tuple(closures or ()),
                couplings=description.couplings + tuple(couplings or ()),
            )
        )
    if not description.closures and not description.couplings:
        raise NoLoopError(_no_loop_message(description), source=description.source)
    try:
        return _analysed(description, build_tree(description, floating_base), independent, actuated)
    except MemoryError:
        message = f"{description.source or description.name}: {len(description.joints)} joints do not fit into memory"
        raise UnsupportedMechanismError(message) from None
    except (IndependentSetError, LoopNotClosedError, SingularConfigurationError, UnsupportedMechanismError) as error:
        error.args = (f"{description.source or description.name}: {error}",)
        raise


def _analysed(
    description: MechanismDescription, tree: Tree, independent: Sequence[str] | None, actuated: Sequence[str] | None
) -> Mechanism:
    """Close the loops, count the motions, settle who measures and who drives them."""
    constraints = Constraints(tree, description.closures, description.couplings)
    wanted = tuple(independent) if independent is not None else (description.independent or ())
    closed, rank = _reference(tree, constraints, description, wanted)
    choice = choose_independent(tree, constraints, description, closed.q_free, rank, independent, actuated)
    basis = null_space(constraints, closed.q_free, rank)
    mobility = Mobility(
        n_free=int(tree.model.nv),
        rows=constraints.size,
        rank=rank,
        mobility=int(tree.model.nv) - rank,
        idle=tuple(idle_motions(tree, constraints, closed.q_free, basis)),
        notes=choice.notes,
    )
    notes = list(description.notes + choice.notes)
    if not closed.within_limits:
        notes.append("the reference configuration lies outside some joint limits: none inside was found")
    if closed.start != "the stated pose":
        notes.append(f"the loops were closed from {closed.start}")
    if closed.start == _FROM_SINGULAR:
        notes.append(
            "branches of σ meet at that pose, so which of them the reference lies on is arbitrary; a stated pose "
            '(<group_state name="reference">) chooses'
        )
    chosen = choice.independent, choice.actuated, closed.q_free
    mechanism = Mechanism(description, tree, *chosen, mobility, tuple(dict.fromkeys(notes)))
    IndependentCoordinates(tree, mechanism.actuated, closed.q_free)  # refuses names that cannot be actuated
    mechanism.parametrization().at(closed.q_free)
    return mechanism


def _check_arguments(path: object, independent: object, actuated: object) -> None:
    if not isinstance(path, str | Path | MechanismDescription | pin.Model):
        known = "a path, a model's name, a description or a pinocchio.Model"
        raise InvalidInputError(f"load takes {known}, not {type(path).__name__}")
    for role, names in (("independent", independent), ("actuated", actuated)):
        if isinstance(names, str) or (names is not None and not all(isinstance(n, str) for n in names)):  # type: ignore[attr-defined]
            raise InvalidInputError(f"{role} must be a sequence of joint names, e.g. ['joint1', 'joint2']")


def _no_loop_message(description: MechanismDescription) -> str:
    if description.independent is not None and len(description.independent) < len(description.joints):
        return (
            'joints are marked dependent (independent="false") but no <loop> or <coupling> says what they depend on; '
            "add the loops to the file, a robot.yaml beside it, or pass closures="
        )
    return (
        "no loop closure and no coupling is declared, so there is nothing to reduce; add <loop> elements or closures="
    )


def stated_pose(tree: Tree, description: MechanismDescription) -> Array:
    """The description's reference pose as a configuration (joints it leaves out are neutral).

    Raises:
        DescriptionError: A value has the wrong number of entries for its joint.
    """
    model = tree.model
    q_free = pin.neutral(model)
    for name, values in description.reference.items():
        if name not in tree.names:
            continue
        joint = tree.joint(name)
        value = joint.kind.stated(np.array(values, dtype=np.float64))
        if value.size != joint.kind.nq:
            message = f"the reference value has {value.size} numbers; a {joint.kind.name} joint needs {joint.kind.nq}"
            raise DescriptionError(message, source=description.source, element=f"joint '{name}'")
        q_free[joint.q] = value
    return np.asarray(pin.normalize(model, q_free))


def _reference(
    tree: Tree, constraints: Constraints, description: MechanismDescription, wanted: tuple[str, ...]
) -> tuple[Closed, int]:
    """A closed, nonsingular configuration, checked against the rows that planarity made superfluous."""
    closed = find_closed(constraints, stated_pose(tree, description))[0]
    rank, candidates = generic_rank(constraints, closed.q_free)
    names = [name for name in wanted if tree.split(name)[0] in tree.names]
    scores = [independence(tree, null_space(constraints, q, rank), names) for q in candidates]
    if candidates[0] is not closed.q_free or scores[0] < 1e-3:
        quality = [score * conditioning(constraints, q, rank) for score, q in zip(scores, candidates, strict=True)]
        best = candidates[int(np.argmax(quality))]
        closed = closed._replace(q_free=best, start=_FROM_SINGULAR)
    complete = Constraints(tree, description.closures, description.couplings, reduce_planar=False)
    residual = complete.residual(closed.q_free)
    errors = {name: float(np.abs(residual[rows]).max()) for name, rows in complete.row_slices().items()}
    worst = max(errors, key=lambda name: errors[name])
    if errors[worst] > 1e-6:
        message = (
            f"loop '{worst}' can never close: its links move parallel to a plane, and its ends are {errors[worst]:.4g} "
            "(m or rad) apart across it"
        )
        raise LoopNotClosedError(message, q_free=closed.q_free, errors=errors)
    return closed, rank
