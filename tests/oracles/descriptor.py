"""Two other ways to the motion of a closed chain: the descriptor form (19) solved directly, and Pinocchio's solver.

The constraint rows here are written anew from the meaning of each closure kind: every row is the scalar product
of two moving vectors, twice differentiated. They are neither reduced for planar loops nor scaled as ccpin's are,
and of ccpin they use only the description and the Pinocchio model with a frame of each link's name.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp


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


def cross(a, b):
    """a × b; NumPy's own costs ten times as much on vectors of three."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


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
            turning = cross(alpha, arm) + cross(omega, cross(omega, arm))
            return Vector(arm, -pin.skew(arm) @ jacobian[3:], cross(omega, arm), turning)

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


class Course(NamedTuple):
    """Where a motion has come to: q′, q̇′ and the largest residual of φ before it was removed."""

    q_free: np.ndarray
    v_free: np.ndarray
    drift: float


def integrate(description, model, q_free, v_free, duration, *, leg=0.02, rtol=1e-12, load=None):
    """The passive motion by (19) in all n′ coordinates at once, of index one, projected onto φ = 0 after every leg.

    No independent coordinates are chosen anywhere: over a leg x is the tangent step q′ = q′₀ ⊕ x. What else acts is
    load(q′, q̇′), of shape (n′,).
    """
    drift = 0.0
    for _ in range(round(duration / leg)):
        start = q_free

        def rate(_, state, start=start):
            x, v = np.split(state, 2)
            at = pin.integrate(model, start, x)
            slope = np.linalg.solve(pin.dIntegrate(model, start, x)[1], v)
            return np.concatenate([slope, released(description, model, at, v, load)])

        state = np.concatenate([np.zeros(model.nv), v_free])
        found = solve_ivp(rate, (0.0, leg), state, method="DOP853", rtol=rtol, atol=1e-13)
        assert found.success, found.message
        x, v_free = np.split(found.y[:, -1], 2)
        q_free, v_free, open_by = projected(description, model, pin.integrate(model, start, x), v_free)
        drift = max(drift, open_by)
    return Course(q_free, v_free, drift)


def released(description, model, q_free, v_free, load=None):
    """q̈′ of (19) without motors, by the null space of φ_q′: redundant rows and unlike masses do no harm."""
    found = rows(description, model, q_free, v_free)
    jacobian, drift = np.array([row.gradient for row in found]), np.array([row.drift for row in found])
    left, singular, directions = np.linalg.svd(jacobian)
    rank = int(np.count_nonzero(singular > 1e-9 * singular[0]))
    a = -directions[:rank].T @ ((left[:, :rank].T @ drift) / singular[:rank])
    allowed = directions[rank:].T
    mass = pin.crba(model, model.createData(), q_free)
    force = passive(description, model, q_free, v_free) - pin.rnea(model, model.createData(), q_free, v_free, a)
    if load is not None:
        force += load(q_free, v_free)
    return a + allowed @ np.linalg.solve(allowed.T @ mass @ allowed, allowed.T @ force)


def projected(description, model, q_free, v_free):
    """The nearest closed configuration and admissible velocity, and how far φ was open."""
    open_by = 0.0
    for _ in range(3):
        found = rows(description, model, q_free, v_free)
        jacobian, value = np.array([row.gradient for row in found]), np.array([row.value for row in found])
        open_by = max(open_by, float(np.abs(value).max()))
        q_free = pin.integrate(model, q_free, -np.linalg.lstsq(jacobian, value, rcond=1e-9)[0])
    return q_free, v_free - np.linalg.lstsq(jacobian, jacobian @ v_free, rcond=1e-9)[0], open_by
