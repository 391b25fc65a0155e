"""What can be recorded of a model: each quantity a line in a table, made of what `recorded_model` says.

Every quantity is a function of the numbers x of a closed configuration, and of q̇, u or q̈ where it needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import choice
from ccpin.control.control_law import ControlLaw
from ccpin.control.references import ReferenceState
from ccpin.dynamics.end_effector import EndEffector
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.programs.program_sources import REFERENCE
from ccpin.programs.recording.constants import Constants, Parameter
from ccpin.programs.recording.recorded_laws import (
    efforts,
    goal_of,
    law_terms,
    recorded_law,
    reference_force,
    transmission,
)
from ccpin.programs.recording.recorded_mechanism import Numbering, RecordedModel, recorded_model
from ccpin.programs.recording.recorded_tree import Table, exact, exact_placement, rational
from ccpin.programs.tape import Tape


class TapedModel(NamedTuple):
    """A model on a tape, and what quantities are recorded from.

    Attributes:
        tape: The tape; its inputs are x, then those of `inputs`.
        model: The model.
        own: The numbers x.
        recorded: The model's closures and dynamics.
        inputs: x, v = q̇, u and a = q̈, each of shape (n_x,), (n,) or (motors,), and parameters p; where a law's
            reference moves also q_d, q̇_d, q̈_d, and g(q_d), of shape (n,) each.
        law: The law, where one is recorded.
        points: Points of links, by the names of their outputs.
        across: Places in x of the joints whose displacements are asked for.
        constants: The constants, some of them parameters.
    """

    tape: Tape
    model: ReducedModel
    own: Numbering
    recorded: RecordedModel
    inputs: dict[str, Table]
    law: ControlLaw | None
    points: dict[str, EndEffector]
    across: tuple[int, ...]
    constants: Constants


class Quantity(NamedTuple):
    """One thing that can be recorded.

    Attributes:
        unit: Its unit, where all entries have one.
        needs: Which inputs it reads besides the configuration.
        record: Its entries, an array of expressions.
    """

    unit: str
    needs: tuple[str, ...]
    record: Callable[[TapedModel], Table]


def taped_model(
    model: ReducedModel,
    own: Numbering,
    near: Any,
    law: ControlLaw | None,
    points: dict[str, EndEffector],
    parameters: Sequence[Parameter] = (),
    moving: bool = False,
    across: Sequence[str] = (),
) -> TapedModel:
    """A fresh tape with a model on it; of a law whose reference is `moving` that is an input."""
    sizes = {"x": len(own.near), "v": model.n, "u": model.n_actuated, "a": model.n, "p": len(parameters)}
    sizes |= {"h": 0, **dict.fromkeys(REFERENCE, model.n)} if moving else {}  # in the order of `INPUTS`
    tape = Tape(sum(sizes.values()))
    ends = np.cumsum(list(sizes.values()))[:-1]
    inputs = dict(zip(sizes, np.split(np.array(tape.inputs, dtype=object), ends), strict=True))
    constants = Constants(model, dict(zip(parameters, inputs["p"], strict=True)))
    recorded = recorded_model(tape, model, own, (inputs["x"], inputs["v"]), near, constants)
    return TapedModel(tape, model, own, recorded, inputs, law, points, _places_of(model, own, across), constants)


def _places_of(model: ReducedModel, own: Numbering, names: Sequence[str]) -> tuple[int, ...]:
    """Where the displacements of joints of one freedom stand in x.

    Raises:
        InvalidInputError: A name of no such joint.
    """
    tree = model.mechanism.tree
    held = {tree.joints[joint.number - 1].name: joint for joint in own.joints if joint.x.stop - joint.x.start == 1}
    return tuple(held[choice(name, "across", tuple(held))].x.start for name in names)


def forward(scene: TapedModel) -> Table:
    """q̈ = D⁻¹(ρᵀSᵀu − C q̇ − damping q̇ − g) (22)."""
    terms = scene.recorded.terms
    across, u = transmission(scene.model, scene.recorded.motion.rho), scene.inputs["u"]
    force = u if across is None else across @ u
    return scene.tape.solve(terms.mass, (force - terms.bias)[:, None])[:, 0]


def generalized_force(scene: TapedModel) -> Table:
    """τ = D q̈ + C q̇ + damping q̇ + g (22)."""
    return scene.recorded.terms.mass @ scene.inputs["a"] + scene.recorded.terms.bias


def inverse(scene: TapedModel) -> Table:
    """The u of least norm with ρᵀSᵀu = τ."""
    return efforts(scene.tape, transmission(scene.model, scene.recorded.motion.rho), generalized_force(scene))


def _rho_dot(scene: TapedModel) -> Table:
    """ρ̇ along q̇."""
    rho, way = scene.recorded.motion.rho, dict(enumerate(scene.recorded.motion.x_rate))
    return np.array(scene.tape.derivative(rho.ravel().tolist(), way, held=False), dtype=object).reshape(rho.shape)


def _mass_inverse(scene: TapedModel) -> Table:
    return scene.tape.solve(scene.recorded.terms.mass, np.eye(scene.model.n, dtype=object))


def _energy(scene: TapedModel) -> Table:
    return np.array([scene.recorded.terms.kinetic, scene.recorded.terms.potential], dtype=object)


def _velocity_force(scene: TapedModel) -> Table:
    """C q̇ + damping q̇."""
    return scene.recorded.terms.velocity


def damping(scene: TapedModel) -> Table:
    """ρᵀB′ρ."""
    stated = [scene.constants.damping(joint) for joint in scene.own.joints for _ in range(joint.kind.nv)]
    rho = scene.recorded.motion.rho
    return rho.T @ (np.array(stated, dtype=object)[:, None] * rho)


def _coriolis(scene: TapedModel) -> Table:
    """C = ½ ∂(C q̇)/∂q̇: of Christoffel symbols, which are symmetric, so that Ḋ − 2C is skew (Lemma III.1).

    Raises:
        UnsupportedMechanismError: q̇ is not the rate of q's numbers: what is symmetric is then another matrix.
    """
    if not scene.own.q.scalar:
        raise UnsupportedMechanismError("C(q, q̇) is recorded where q̇ is the rate of q, not of a whole ball or carriage")
    return (along(scene, _velocity_force(scene), "v") - damping(scene)) * rational(0.5)


def along(scene: TapedModel, entries: Table, by: str) -> Table:
    """∂(entries)/∂(input), of the entries' shape and one more axis; by "q" along tangent steps, y moving with them."""
    if by == "q":
        ways = [dict(enumerate(column)) for column in (scene.recorded.rates @ scene.recorded.motion.rho).T]
    else:
        ways = [{node.index: 1} for node in scene.inputs[by]]
    columns = [scene.tape.derivative(entries.ravel().tolist(), way, held=False) for way in ways]
    return np.array(columns, dtype=object).reshape(len(ways), *entries.shape).transpose(*range(1, entries.ndim + 1), 0)


def _torque(scene: TapedModel) -> Table:
    """u of the law."""
    told, own, given = recorded_law(scene.law, scene.model), scene.own, scene.inputs
    state, still = (given["x"][list(own.q.places)], given["v"]), np.zeros(scene.model.n, dtype=object)
    if "q_d" in given:
        *wanted, constant = (given[name] for name in REFERENCE)
    else:
        wanted, constant = [goal_of(scene.tape, told, own.q, own.near), still, still], exact(told.constant)
    told = told._replace(constant=constant)
    terms = scene.recorded.terms
    force = reference_force(told, ReferenceState(*wanted), state, terms, lambda v: _force_of_coriolis(scene, v))
    return efforts(scene.tape, transmission(scene.model, scene.recorded.motion.rho), force)


def _force_of_coriolis(scene: TapedModel, velocity: Table) -> Table:
    """(C + damping) w: half of what the bias force, 2 C w + damping w, changes along w, and half of damping w."""
    way = {node.index: entry for node, entry in zip(scene.inputs["v"], velocity, strict=True)}
    change = scene.tape.derivative(scene.recorded.terms.bias.tolist(), way, held=False)
    return (np.array(change, dtype=object) + damping(scene) @ velocity) * rational(0.5)


def _lyapunov(scene: TapedModel) -> Table:
    """𝒱 + V(q_d) with the law's own g(q_d)."""
    told, state = recorded_law(scene.law, scene.model), (scene.inputs["x"], scene.inputs["v"])
    if told.kind != "pd" or "q_d" in scene.inputs:
        raise UnsupportedMechanismError(
            f"𝒱 is recorded of PDSimpleGravity (28) with a constant q_d, not of {type(scene.law).__name__}"
        )
    return np.array(
        [law_terms(scene.tape, scene.law, scene.own.q, state, scene.recorded.terms, scene.own.near).lyapunov],
        dtype=object,
    )


def pose_of(scene: TapedModel, end: EndEffector) -> Table:
    """The link's axes at the point, 4×4, in the world."""
    attached = scene.model.mechanism.tree.attachments[end.link]
    placed = scene.recorded.frames[attached.joint] @ exact_placement(attached.placement)
    placed[:3, 3] = placed[:3, 3] + placed[:3, :3] @ exact(end.point.offset)
    return placed


def jacobian_of(scene: TapedModel, pose: Table) -> Table:
    """J with twist (linear, angular) = J q̇ in world axes, of shape (6, n)."""
    rates = along(scene, pose[:3], "q")
    turned = np.einsum("ijk,lj->ilk", rates[:, :3], pose[:3, :3])
    return np.vstack([rates[:, 3], turned[2, 1], turned[0, 2], turned[1, 0]])


def _across(scene: TapedModel) -> Table:
    return scene.inputs["x"][list(scene.across)]


def _across_jacobian(scene: TapedModel) -> Table:
    """∂(displacements)/∂q, a row a joint."""
    return along(scene, _across(scene), "q")


def _across_inverse(scene: TapedModel) -> Table:
    """The inverse of that.

    Raises:
        InvalidInputError: There are not as many joints as motions.
    """
    if len(scene.across) != scene.model.n:
        raise InvalidInputError(f"'across_inverse' is of {scene.model.n} joints: name them by across=")
    return scene.tape.solve(_across_jacobian(scene), np.eye(scene.model.n, dtype=object))


def _sigma(scene: TapedModel) -> Table:
    return scene.inputs["x"][list(scene.own.dependent)]


QUANTITIES = {
    "sigma": Quantity("", (), _sigma),
    "closure": Quantity("", (), lambda scene: np.array(scene.recorded.closure, dtype=object)),
    "rho": Quantity("", (), lambda scene: scene.recorded.motion.rho),
    "rho_dot": Quantity("", ("v",), _rho_dot),
    "v_free": Quantity("", ("v",), lambda scene: scene.recorded.motion.v_free),
    "bias": Quantity("", ("v",), lambda scene: scene.recorded.motion.bias),
    "x_rate": Quantity("", ("v",), lambda scene: scene.recorded.motion.x_rate),
    "mass": Quantity("", (), lambda scene: scene.recorded.terms.mass),
    "mass_inverse": Quantity("", (), _mass_inverse),
    "gravity": Quantity("", (), lambda scene: scene.recorded.terms.gravity),
    "coriolis": Quantity("", ("v",), _coriolis),
    "velocity_force": Quantity("", ("v",), _velocity_force),
    "forward_dynamics": Quantity("", ("v", "u"), forward),
    "generalized_force": Quantity("", ("v", "a"), generalized_force),
    "inverse_dynamics": Quantity("", ("v", "a"), inverse),
    "across": Quantity("", (), _across),
    "across_jacobian": Quantity("", (), _across_jacobian),
    "across_inverse": Quantity("", (), _across_inverse),
    "energy": Quantity("J", ("v",), _energy),
    "torque": Quantity("N m or N", ("v",), _torque),
    "lyapunov": Quantity("J", ("v",), _lyapunov),
}
