"""Two other ways to the motion of a closed chain: the descriptor form (19) solved directly, and Pinocchio's solver.

The constraint rows here are written anew from the meaning of each closure kind: every row is the scalar product
of two moving vectors, twice differentiated. They are neither reduced for planar loops nor scaled as ccpin's are,
and of ccpin they use only the description and the Pinocchio model with a frame of each link's name.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin


class Motion(NamedTuple):
    """q̈′, the constraints' generalized force φ_q′ᵀλ, of shape (n′,) each, and the solver's own λ."""

    a_free: np.ndarray
    force: np.ndarray
    multipliers: np.ndarray


class Vector(NamedTuple):
    """A moving vector x in world axes: x, ∂x/∂q̇′, ẋ, and ẍ for q̈′ = 0."""

    x: np.ndarray
    jacobian: np.ndarray
    rate: np.ndarray
    drift: np.ndarray

    def __sub__(self, other):
        return Vector(*(a - b for a, b in zip(self, other, strict=True)))


class Row(NamedTuple):
    """One scalar constraint: value, gradient, and second derivative for q̈′ = 0."""

    value: float
    gradient: np.ndarray
    drift: float


def dot(a, b):
    """The row a·b."""
    drift = a.drift @ b.x + 2.0 * a.rate @ b.rate + a.x @ b.drift
    return Row(a.x @ b.x, b.x @ a.jacobian + a.x @ b.jacobian, drift)


class End:
    """One end of a closure in motion: its origin and its axes x, y, z."""

    def __init__(self, model, data, link, placement):
        frame = model.getFrameId(link)
        world = pin.LOCAL_WORLD_ALIGNED
        pose = data.oMf[frame]
        jacobian = pin.getFrameJacobian(model, data, frame, world)
        velocity = pin.getFrameVelocity(model, data, frame, world)
        acceleration = pin.getFrameClassicalAcceleration(model, data, frame, world)
        omega, alpha = velocity.angular, acceleration.angular

        def carried(arm):
            turning = np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
            return Vector(arm, -pin.skew(arm) @ jacobian[3:], np.cross(omega, arm), turning)

        lever = carried(pose.rotation @ placement[:3, 3])
        self.p = Vector(
            pose.translation + lever.x,
            jacobian[:3] + lever.jacobian,
            velocity.linear + lever.rate,
            acceleration.linear + lever.drift,
        )
        self.x, self.y, self.z = (carried(axis) for axis in (pose.rotation @ placement[:3, :3]).T)


def constant(x, nv):
    return Vector(x, np.zeros((3, nv)), np.zeros(3), np.zeros(3))


def closure_rows(closure, a, b, nv):
    """The rows a closure kind means."""
    gap = b.p - a.p
    meeting = [dot(constant(e, nv), gap) for e in np.eye(3)]
    same_axis = [dot(a.z, b.x), dot(a.z, b.y)]
    same_rotation = [dot(a.x, b.y), dot(a.y, b.z), dot(a.z, b.x)]
    return {
        "spherical": lambda: meeting,
        "revolute": lambda: meeting + same_axis,
        "fixed": lambda: meeting + same_rotation,
        "prismatic": lambda: [*same_rotation, dot(a.x, gap), dot(a.y, gap)],
        "cylindrical": lambda: [*same_axis, dot(a.x, gap), dot(a.y, gap)],
        "universal": lambda: [*meeting, dot(a.x, b.y)],
        "planar": lambda: [*same_axis, dot(a.z, gap)],
        "perpendicular": lambda: [dot(a.x, b.y)],
        "in_plane": lambda: [dot(a.x, gap)],
        "distance": lambda: [dot(gap, gap)._replace(value=gap.x @ gap.x - closure.length**2)],
    }[closure.kind]()


def coupling_row(model, coupling, q_free, v_free):
    """Σ of polynomials in joint displacements (an angle on the circle is read in (−π, π])."""
    value, drift, gradient = 0.0, 0.0, np.zeros(model.nv)
    for term in coupling.terms:
        joint = model.joints[model.getJointId(term.joint)]
        at = q_free[joint.idx_q : joint.idx_q + joint.nq]
        polynomial = np.polynomial.Polynomial(term.coefficients)
        theta = (np.arctan2(at[1], at[0]) if joint.nq == 2 else at[0]) - term.reference
        value += polynomial(theta)
        gradient[joint.idx_v] += polynomial.deriv(1)(theta)
        drift += polynomial.deriv(2)(theta) * v_free[joint.idx_v] ** 2
    return Row(value, gradient, drift)


def rows(description, model, q_free, v_free):
    """All constraint rows at a state."""
    data = model.createData()
    pin.forwardKinematics(model, data, q_free, v_free, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q_free)
    pin.updateFramePlacements(model, data)
    result = []
    for closure in description.closures:
        a = End(model, data, closure.link_a, closure.placement_a)
        b = End(model, data, closure.link_b, closure.placement_b)
        result += closure_rows(closure, a, b, model.nv)
    return result + [coupling_row(model, coupling, q_free, v_free) for coupling in description.couplings]


def passive(description, model, q_free, v_free):
    """What the joints' springs and dampers do to q′, −k (θ − θ₀) − b q̇′, joint by joint of the description."""
    force = np.zeros(model.nv)
    for stated in description.joints:
        if stated.kind == "fixed":
            continue
        joint = model.joints[model.getJointId(stated.name)]
        window = slice(joint.idx_v, joint.idx_v + joint.nv)
        force[window] -= stated.damping * v_free[window]
        if stated.stiffness:
            assert joint.nq == 1
            force[joint.idx_v] -= stated.stiffness * (q_free[joint.idx_q] - stated.spring_reference)
    return force


def direct(description, model, q_free, v_free, tau):
    """Solve (19) as it stands; λ of least norm where rows are redundant."""
    found = rows(description, model, q_free, v_free)
    jacobian, drift = np.array([row.gradient for row in found]), np.array([row.drift for row in found])
    mass = pin.crba(model, model.createData(), q_free)
    bias = pin.nonLinearEffects(model, model.createData(), q_free, v_free)
    m = len(found)
    matrix = np.block([[mass, -jacobian.T], [jacobian, np.zeros((m, m))]])
    solution = np.linalg.lstsq(matrix, np.concatenate([tau - bias, -drift]), rcond=1e-11)[0]
    return Motion(solution[: model.nv], jacobian.T @ solution[model.nv :], solution[model.nv :])


def pinocchio(description, model, q_free, v_free, tau):
    """Pinocchio's proximal constrained dynamics, for spherical and fixed closures; λ in world axes."""
    types = {"spherical": pin.ContactType.CONTACT_3D, "fixed": pin.ContactType.CONTACT_6D}
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in description.closures:
        a, b = (model.frames[model.getFrameId(link)] for link in (closure.link_a, closure.link_b))
        contact = pin.RigidConstraintModel(
            types[closure.kind],
            model,
            a.parentJoint,
            a.placement * pin.SE3(np.array(closure.placement_a)),
            b.parentJoint,
            b.placement * pin.SE3(np.array(closure.placement_b)),
            pin.LOCAL_WORLD_ALIGNED if closure.kind == "spherical" else pin.LOCAL,
        )
        models.append(contact)
        datas.append(contact.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 10)
    a_free = np.array(pin.constraintDynamics(model, data, q_free, v_free, tau, models, datas, settings))
    force = pin.rnea(model, model.createData(), q_free, v_free, a_free) - tau
    return Motion(a_free, force, np.array(data.lambda_c))
