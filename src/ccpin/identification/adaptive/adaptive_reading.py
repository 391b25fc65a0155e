"""What is read off a mechanism for claims about adaptive laws: its bodies' frames, and which constants these have."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Indices
from ccpin.domain.closures.scalar_coordinates import elementary_joints
from ccpin.domain.closures.system import Reading, chain_of, steps_along
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.chains import Chain

_OF_JOINTS = ("armature", "damping", "stiffness", "offset")


def frames_on(mechanism: Mechanism, reading: Reading) -> tuple[Chain, ...]:
    """The origin and the axes of each body's frame as tips, four a body, in the order of its joints."""
    elementary, supports = elementary_joints(mechanism, reading.chart), mechanism.tree.model.supports
    chains = list[Chain]()
    for joint in mechanism.tree.joints:
        path = steps_along(elementary, list(supports[joint.number])[1:])
        chains.append(chain_of(path, np.zeros(3), False, np.zeros((1, 3))))
        chains += [chain_of(path, axis, True, np.zeros((1, 3))) for axis in np.eye(3)]
    return tuple(chains)


def constants_of(parameters: DynamicParameters) -> Indices:
    """Where the constants that claims are about stand among all: bodies' tens, then joints' by kind; no friction."""
    return np.concatenate([parameters.of("inertia"), *(parameters.of(kind) for kind in _OF_JOINTS)])
