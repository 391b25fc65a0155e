"""What is read off a mechanism and its law for Theorem 3: bodies and springs, and the law's numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.potential import BodiesAndSprings
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.well import SetPoint
from ccpin.domain.closures.scalar_coordinates import elementary_joints
from ccpin.domain.closures.system import Reading, chain_of, steps_along
from ccpin.dynamics.parameters import BODY
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.chains import Chain
from ccpin.proof.equations import closures_of


def equations_of(law: PDSimpleGravity, reading: Reading, radii: Array | None = None) -> SetPointEquations:
    """What is claimed of a law over closures that are read off its mechanism, whose constants may be off by radii (p,).

    Raises:
        NotProvedError: They are none.
    """
    masses = masses_of(law.model.mechanism, reading, law.model.gravity_vector, radii)
    return SetPointEquations(closures_of(reading.problem), masses, theta_of(law, reading), set_point_of(law))


def theta_of(law: PDSimpleGravity, reading: Reading) -> Array:
    """θ of the law's configuration, of shape (n′,)."""
    theta = reading.theta(law.q_free_d)
    theta[reading.system.independent] = law.q_d
    return theta


def radii_of(model: ReducedModel, constants: tuple[ArrayLike, ArrayLike] | None) -> Array | None:
    """How far constants between two bounds may be off the model's, of shape (p,); ``None``: not at all.

    Raises:
        InvalidInputError: Bounds that are none, or a robot between them has a negative mass throughout.
        UnsupportedMechanismError: A spring's constants are not given exactly.
    """
    if constants is None:
        return None
    told = model.parameters
    if not (isinstance(constants, tuple) and len(constants) == 2):
        raise InvalidInputError("constants must be a pair (lower, upper), as `Estimate.box` gives it")
    lower, upper = (vector(values, "constants", len(told)) for values in constants)
    if np.any(lower > upper):
        raise InvalidInputError("constants: a lower bound is above the upper one")
    radii = np.maximum(np.abs(lower - told.values), np.abs(upper - told.values))
    springs = told.of("stiffness", "offset")
    if np.any(radii[springs]):
        name = told.names[springs[int(np.argmax(radii[springs]))]]
        raise UnsupportedMechanismError(f"'{name}' must be the model's: a set's springs are not bounded")
    return radii


def masses_of(
    mechanism: Mechanism, reading: Reading, gravity: Array | None = None, radii: Array | None = None
) -> BodiesAndSprings:
    """The bodies and springs of a mechanism in the chart of its closures, under gravity (m/s²; default the file's).

    Where its constants may be off by radii (p,), masses and first moments are spread.

    Raises:
        UnsupportedMechanismError: No movable link has mass, or a ball joint has a spring.
    """
    model, joints, size = mechanism.tree.model, mechanism.joints, reading.system.n_free
    for joint in mechanism.tree.joints:
        if joint.stated.stiffness and joint.kind.unit:
            raise UnsupportedMechanismError(f"the spring of the {joint.kind.name} joint '{joint.name}' is not bounded")
    elementary = elementary_joints(mechanism, reading.chart)
    gravity = np.asarray(model.gravity.linear) if gravity is None else gravity
    chains = []
    for number, inertia in enumerate(model.inertias):
        if number == 0 or inertia.mass == 0.0:
            continue
        path = steps_along(elementary, list(model.supports[number])[1:])
        chains.append(chain_of(path, np.asarray(inertia.lever), False, -inertia.mass * gravity[None]))
    if not chains:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: no movable link has mass, so there is no potential to bound"
        )
    springs = _padded(joints.stiffness, size), _padded(joints.spring_reference, size)
    if radii is None:
        return BodiesAndSprings(tuple(chains), *springs)
    spread = list[tuple[Chain, ...]]()
    for joint in mechanism.tree.joints:
        path = steps_along(elementary, list(model.supports[joint.number])[1:])
        mass, *moments = radii[BODY * (joint.number - 1) :][:4]
        for radius, ends in ((mass, (np.zeros(3),)), *zip(moments, ((e, 0.0 * e) for e in np.eye(3)), strict=True)):
            weights = (-radius * gravity[None], radius * gravity[None])
            if radius:
                spread.append(tuple(chain_of(path, *each) for each in zip(ends, (False, False), weights, strict=False)))
    return BodiesAndSprings(tuple(chains), *springs, tuple(spread))


def set_point_of(law: PDSimpleGravity) -> SetPoint:
    """The numbers of a law."""
    mechanism, still = law.model.mechanism, np.zeros(law.model.n)
    on_q = mechanism.actuated == mechanism.independent
    potential_d = float(law.model.energy(law.q_d, still, law.q_free_d).potential)
    motors = None if on_q else mechanism.actuation
    return SetPoint(law.q_d, law.K_p, law.K_v, law.gravity_d, potential_d, motors)


def _padded(values: Array, size: int) -> Array:
    """Values of the joints (n′,), zero for the angles of rods, of shape (size,)."""
    return np.concatenate([values, np.zeros(size - len(values))])
