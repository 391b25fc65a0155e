"""What is read off a mechanism for its free system: bodies as tips with mass, and what acts on the joints."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.masses import BodiesOnJoints, Tip
from ccpin.domain.closures.scalar_coordinates import elementary_joints
from ccpin.domain.closures.system import Reading, chain_of, steps_along
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism

_DATA = 1e-14  # what eigenvalues of a body's second moments may be off by, of the largest


def bodies_on_joints_of(mechanism: Mechanism, reading: Reading, gravity: Array) -> BodiesOnJoints:
    """The free system of a mechanism whose joints turn about or slide along one axis each.

    Raises:
        UnsupportedMechanismError: A joint of another kind, no closures, or one that keeps a distance.
    """
    plural = next((joint for joint in mechanism.tree.joints if joint.kind.nv != 1), None)
    if plural is not None:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: the {plural.kind.name} joint '{plural.name}' has several freedoms, whose error has no "
            "size that does not depend on a chart; describe it as joints about one axis each"
        )
    if not reading.system.m:
        raise UnsupportedMechanismError(f"{mechanism.name} has no dependent coordinates, so σ cannot be off")
    if reading.rods:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: a closure that keeps a distance is certified as a rod, which the law does not compute "
            "with; describe it as a link on joints"
        )
    tips = list[Tip]()
    elementary, model = elementary_joints(mechanism, reading.chart), mechanism.tree.model
    for number, inertia in enumerate(model.inertias):
        path = steps_along(elementary, list(model.supports[number])[1:]) if number else []
        if inertia.mass and path:
            tips.append(Tip(chain_of(path, inertia.lever, False, np.zeros((1, 3))), inertia.mass, 0.0, gravity))
        if np.any(inertia.inertia) and any(not step.prismatic for step in path):
            about = np.asarray(inertia.inertia)
            moments, axes = np.linalg.eigh(0.5 * np.trace(about) * np.eye(3) - about)
            doubt = _DATA * float(np.abs(moments).max())
            chains = (chain_of(path, axis, True, np.zeros((1, 3))) for axis in axes.T)
            tips += [Tip(chain, m, doubt, np.zeros(3)) for chain, m in zip(chains, moments, strict=True)]
    joints = mechanism.joints
    return BodiesOnJoints(tuple(tips), joints.armature, joints.damping, joints.stiffness, joints.spring_reference)
