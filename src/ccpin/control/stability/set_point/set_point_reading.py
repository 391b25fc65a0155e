"""What is read off a mechanism and its law for Theorem 3: bodies and springs, and the law's numbers."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.control.laws import PDSimpleGravity
from ccpin.control.stability.set_point.potential import BodiesAndSprings
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.well import SetPoint
from ccpin.domain.closures.scalar_coordinates import elementary_joints
from ccpin.domain.closures.system import Reading, chain_of, steps_along
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.equations import closures_of


def equations_of(law: PDSimpleGravity, reading: Reading) -> SetPointEquations:
    """What is claimed of a law over closures that are read off its mechanism.

    Raises:
        NotProvedError: They are none.
    """
    model, theta = law.model, reading.theta(law.q_free_d)
    theta[reading.system.independent] = law.q_d
    masses = masses_of(model.mechanism, reading, model.gravity_vector)
    return SetPointEquations(closures_of(reading.problem), masses, theta, set_point_of(law))


def masses_of(mechanism: Mechanism, reading: Reading, gravity: Array | None = None) -> BodiesAndSprings:
    """The bodies and springs of a mechanism in the chart of its closures, under gravity (m/s²; default the file's).

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
    return BodiesAndSprings(tuple(chains), _padded(joints.stiffness, size), _padded(joints.spring_reference, size))


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
