"""`Mechanism`: a closed, analysed closed-chain mechanism, immutable and picklable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import pinocchio as pin

from ccpin.arrays import Array, Record, frozen
from ccpin.description.formats import write_description
from ccpin.description.model import Coupling, LoopClosure, MechanismDescription
from ccpin.displays import table
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import Parametrization
from ccpin.kinematics.tree import ROOT_JOINT, Tree, build_tree
from ccpin.mechanism.motion.mobility import Mobility
from ccpin.mechanism.physics import JointPhysics, Motors, joint_physics, motors_of
from ccpin.mechanism.pinocchio.writer import constraint_models
from ccpin.proof.digests import Digests, digest

_ANYTHING = ("robot", "model", "scene", "assembly")
"""What a file of any mechanism might be called."""


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
        locked: Joints and components held still: those asked for, then the spins that move nothing but themselves.
        held: The description with such spins locked, which the tree is of; ``None`` where there are none.
    """

    description: MechanismDescription
    tree: Tree
    independent: tuple[str, ...]
    actuated: tuple[str, ...]
    q_reference: Array
    mobility: Mobility
    notes: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    held: MechanismDescription | None = None

    @property
    def name(self) -> str:
        """The mechanism's name in its file."""
        return self.description.name

    @property
    def title(self) -> str:
        """What heads its pictures: its file's name; where that could be any mechanism's, its folder's; else `name`."""
        source = Path(self.description.source or self.name)
        return source.parent.name or self.name if source.stem in _ANYTHING else source.stem

    @cached_property
    def pin_model(self) -> pin.Model:
        """The free system's Pinocchio model, the caller's own: ccpin reads nothing written to it.

        One copy a mechanism, made when first asked for; a pickle does not carry it. Bodies whose spin is locked have
        all of their inertia here (`ccpin.mechanism.loading.locking`).
        """
        if self.held is None:
            return self.tree.model.copy()
        whole = replace(self.held, links=self.description.links)
        return build_tree(whole, ROOT_JOINT in self.tree.names).model

    @property
    def closures(self) -> tuple[LoopClosure, ...]:
        """The loop closures."""
        return self.description.closures

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """The joint couplings."""
        return self.description.couplings

    @property
    def locks(self) -> tuple[LoopClosure, ...]:
        """The rows of φ that hold idle spins where no whole joint could be fixed; they are not among the closures."""
        return () if self.held is None else self.held.closures[len(self.closures) :]

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

    @cached_property
    def joints(self) -> JointPhysics:
        """Damping, friction, springs, rotor inertias and limits of the free system's joints, of shape (n′,) each."""
        return joint_physics(self.tree)

    @cached_property
    def motors(self) -> Motors:
        """The motors in the order of u: what is stated of each, gears and bounds of u."""
        return motors_of(self.description, self.tree, self.actuated)

    @property
    def position_limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the entries of q′, of shape (nq,) each, ±∞ where there is none."""
        return frozen(self.tree.model.lowerPositionLimit), frozen(self.tree.model.upperPositionLimit)

    @property
    def direct(self) -> bool:
        """Whether u acts on the independent velocities themselves, ρᵀSᵀu = u: motors on them, in order, of gear 1."""
        return self.actuated == self.independent and bool((self.motors.gears == 1.0).all())

    @property
    def actuation(self) -> Array:
        """S of shape (motors, n′), constant, gears included: u enters the free system as Sᵀu.

        Raises:
            UnsupportedMechanismError: A single component of a joint is actuated, so that S depends on q′
                (`State.joint_efforts` gives Sᵀu then).
        """
        coordinates = IndependentCoordinates(self.tree, self.actuated, self.q_reference)
        if not coordinates.constant:
            raise UnsupportedMechanismError("S is not constant: a single component of a joint is actuated")
        return self.motors.gears[:, None] * coordinates.jacobian(self.q_reference)

    @cached_property
    def digests(self) -> Digests:
        """What it is about, but for gravity, which a model states (`ccpin.proof.digests`).

        Of closures and independent coordinates, of the dynamics, and of what a simulated plant reads besides.
        """
        tree, physics, motors = self.tree, self.joints, self.motors
        masses: list[Any] = [(body.mass, body.lever, body.inertia) for body in tree.model.inertias]
        moved = ("damping", "stiffness", "spring_reference", "armature")
        stribeck = ("breakaway", "stribeck_speed") if (physics.breakaway > physics.friction).any() else ()
        kept = ("friction", *stribeck, "effort", "velocity")
        return Digests(
            name=f"mechanism '{self.name}'",
            closures=digest((tree, (*self.closures, *self.locks), self.couplings, self.independent)),
            dynamics=digest((masses, {name: getattr(physics, name) for name in moved}, self.actuated, motors.gears)),
            plant=digest(({name: getattr(physics, name) for name in kept}, self.position_limits, motors.limits)),
        )

    def save(
        self, path: str | Path, format: str | None = None, *, loops: str = "as_stated", meshes: str = "kept"
    ) -> tuple[str, ...]:
        """Write the mechanism to a file, with the independent and actuated joints and the reference chosen here.

        Args:
            path: The file; its suffix tells the format where `format` does not (.urdf, .sdf, .xml, .yaml).
            format: ``"urdf"`` (with URDF+ loops), ``"sdf"``, ``"mjcf"``, ``"toolbox"`` (robot.yaml with
                robot.urdf), ``"drake"`` or ``"isaac"`` (URDFs whose loops these read).
            loops: Of MJCF: ``"as_stated"``, or ``"tight"`` for loops that MuJoCo keeps closed and motions that are
                those of the mechanism (`ccpin.description.mjcf.tightening`).
            meshes: ``"kept"`` where they are, or ``"copied"`` into a folder ``meshes`` beside the file.

        Returns:
            What the mechanism states and the format has no place for, in sentences like `notes`.

        Raises:
            InvalidInputError: The format is none of these, a word is none of those, or a file cannot be written.
            DescriptionError: The format has no words for something, by name.
        """
        return write_description(self.settled(), path, format, loops=loops, meshes=meshes)

    def pinocchio_constraints(self) -> list[pin.RigidConstraintModel]:
        """The closures as constraint models of `pin_model`, for Pinocchio's own solvers: the caller's, made anew.

        A spherical closure is a 3D contact, a fixed one a 6D contact, a revolute one two 3D contacts on its axis
        (their six rows have rank five: give the solver a proximal step). Ends are in the joints' frames. Spins that are
        locked here are free there: nothing else moves with them.

        Raises:
            UnsupportedMechanismError: A closure of another kind, or a coupling.
        """
        return constraint_models(Constraints(self.tree, self.closures, self.couplings))

    def settled(self) -> MechanismDescription:
        """The description with what was chosen here: independent and actuated joints, and the closed reference.

        Components of a joint cannot be marked in a description: with such coordinates nothing is. Idle spins are as
        the file has them, for whoever reads it to lock or not; joints locked on request are fixed.
        """
        own = {joint.name for joint in self.description.joints}
        chosen = self.independent if own.issuperset(self.independent) else None
        poses = {} if self.held is None else dict(self.description.reference)
        poses |= {joint.name: joint.kind.told(self.q_reference[joint.q]) for joint in self.tree.joints}
        return replace(
            self.description,
            independent=chosen,
            independent_is_default=False,
            actuated=self.actuated if own.issuperset(self.actuated) else self.description.actuated,
            reference={name: pose for name, pose in poses.items() if name in own},
        )

    def __repr__(self) -> str:
        return f"Mechanism({', '.join(f'{key}: {value}' for key, value in self._summary())})"

    def _repr_html_(self) -> str:
        """A small table for notebooks."""
        gravity = ", ".join(f"{g:g}" for g in self.description.gravity)
        return table([*self._summary(), ("gravity", f"({gravity}) m/s²"), *(("note", note) for note in self.notes)])

    def _summary(self) -> list[tuple[str, str]]:
        """What identifies the mechanism to its reader, in words."""
        lists = {
            "loops": [closure.name for closure in self.closures],
            "couplings": [coupling.name for coupling in self.couplings],
            "independent": self.independent,
            "actuated": self.actuated,
            "locked": self.locked,
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
        return Parametrization(
            Constraints(self.tree, (*self.closures, *self.locks), self.couplings), coordinates, self.q_reference
        )


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
