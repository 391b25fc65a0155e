"""What motors feel of bodies, by Pinocchio's regressor of a tree and closures' Jacobians: of ccpin the description."""

import numpy as np
import pinocchio as pin

from ccpin.dynamics.parameters import INERTIAL


def motions(description, independent, gravity, count, rng, spread):
    """Rows ρᵀY′ over the ten constants of each body, and their names: at `count` closed states about the reference.

    Joints are hinges and slides; closures are balls or pins in a plane, couplings sums.
    """
    names, model = [joint.name for joint in description.joints], pin.Model()
    model.gravity.linear = np.array(gravity, dtype=float)
    bodies = {description.root: 0}
    for joint in description.joints:
        kind = (_SLIDE if joint.kind == "prismatic" else _HINGE)(joint.axis)
        bodies[joint.child] = model.addJoint(bodies[joint.parent], kind, pin.SE3(joint.placement), joint.name)
    pins = [
        [
            model.addFrame(pin.Frame(f"{loop.name}{k}", bodies[link], 0, pin.SE3(place), pin.FrameType.OP_FRAME))
            for k, (link, place) in enumerate(loop.ends)
        ]
        for loop in description.closures
    ]
    sums = np.zeros((len(description.couplings), model.nv))
    for line, coupling in zip(sums, description.couplings, strict=True):
        line[[names.index(term.joint) for term in coupling.terms]] = [term.coefficients[1] for term in coupling.terms]
    data, free = model.createData(), [names.index(name) for name in independent]
    held = [k for k in range(model.nv) if k not in free]
    start = np.array([description.reference.get(name, (0.0,))[0] for name in names])

    def closing(told):
        return np.concatenate([*(told(a) - told(b) for a, b in pins)]) if pins else np.zeros(0)

    rows = []
    for _ in range(count):
        q = start.copy()
        q[free] += spread * rng.uniform(-1.0, 1.0, len(free))
        for _ in range(30):
            J = _jacobian(model, data, q, pins, sums)
            gap = np.concatenate([closing(lambda frame: data.oMf[frame].translation), sums @ q])
            q[held] -= np.linalg.lstsq(J[:, held], gap, rcond=None)[0]
        assert np.abs(gap).max() < 1e-13
        rho = np.zeros((model.nv, len(free)))
        rho[free], rho[held] = np.eye(len(free)), -np.linalg.lstsq(J[:, held], J[:, free], rcond=None)[0]
        v, a = (rho @ rng.normal(size=len(free)) for _ in range(2))
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        bias = closing(lambda frame: pin.getFrameClassicalAcceleration(model, data, frame, _WORLD).linear)
        a[held] -= np.linalg.lstsq(J[:, held], np.concatenate([bias, np.zeros(len(sums))]), rcond=None)[0]
        rows.append(rho.T @ pin.computeJointTorqueRegressor(model, data, q, v, a))
    return np.vstack(rows), [f"{kind}:{joint.child}" for joint in description.joints for kind in INERTIAL]


def rank(rows):
    """The rank of rows whose singular values leave a gap of a factor of 1e5 about 1e-10."""
    size = np.linalg.norm(rows, axis=0)
    values = np.linalg.svd(rows / np.where(size > 1e-10 * size.max(), size, np.inf), compute_uv=False)
    found = int(np.sum(values > 1e-10 * values[0]))
    assert found == len(values) or values[found] < 1e-5 * values[found - 1]
    return found


_WORLD = pin.LOCAL_WORLD_ALIGNED
_HINGE, _SLIDE = pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned


def _jacobian(model, data, q, pins, sums):
    """Of the pins' gaps and the sums."""
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    ends = [[pin.getFrameJacobian(model, data, frame, _WORLD)[:3] for frame in pair] for pair in pins]
    return np.vstack([*(a - b for a, b in ends), sums])
