"""Drake's MultibodyPlant on the same mechanism: loops are constraints of its discrete SAP solver, so it steps."""

from __future__ import annotations

import numpy as np

import ccpin
from benchmarks.peers import NotForThisError
from benchmarks.peers.mjcf import Servo
from benchmarks.subjects import Place

try:
    import pydrake.math as drake_math
    import pydrake.multibody.plant as drake_plant
    import pydrake.multibody.tree as drake_tree
    from pydrake.systems.analysis import Simulator
except ImportError:
    drake_plant = None

ABSENT = "Drake is not installed (pip install drake)"


class Drake:
    """The mechanism at a place, with a step of 1 ms.

    Raises:
        NotForThisError: Drake is not installed, or cannot have the mechanism.
    """

    def __init__(self, mechanism: ccpin.Mechanism, at: Place) -> None:
        self.plant = plant_of(mechanism, 1e-3, {})
        self.context, self.at = self.plant.CreateDefaultContext(), at
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, at.tau)

    def step(self) -> np.ndarray:
        """One update from the place; q′ and q̇′ after it."""
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([self.at.q_free, self.at.v_free]))
        return self.plant.EvalUniquePeriodicDiscreteUpdate(self.context).value(0)


class Move:
    """A controlled motion; the motors' laws are Drake's own implicit PD controllers."""

    def __init__(self, mechanism: ccpin.Mechanism, servos: dict[str, Servo], start: np.ndarray, step: float) -> None:
        self.plant, self.start, self.step, self.servos = plant_of(mechanism, step, servos), start, step, servos

    def run(self, steps: int, sample: float) -> np.ndarray:
        """q′ at every sample, of shape (samples, nq)."""
        context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(context, self.start)
        offsets = np.array([servo.offset for servo in self.servos.values()])
        zeros = np.zeros(2 * len(offsets))
        self.plant.get_actuation_input_port().FixValue(context, offsets)
        self.plant.get_desired_state_input_port(drake_tree.default_model_instance()).FixValue(context, zeros)
        simulator = Simulator(self.plant, context)
        simulator.Initialize()
        count = round(steps * self.step / sample)
        found = np.empty((count + 1, len(self.start)))
        found[0] = self.start
        for k in range(1, count + 1):
            simulator.AdvanceTo(k * sample)
            found[k] = self.plant.GetPositions(context)
        return found


def plant_of(mechanism: ccpin.Mechanism, step: float, servos: dict[str, Servo]) -> drake_plant.MultibodyPlant:
    """The finished plant; positions are in the order of q′.

    Raises:
        NotForThisError: As for `Drake`.
    """
    if drake_plant is None:
        raise NotForThisError(ABSENT)
    plant = drake_plant.MultibodyPlant(step)
    plant.set_discrete_contact_approximation(drake_plant.DiscreteContactApproximation.kSap)
    plant.SetUseSampledOutputPorts(False)
    bodies = {0: plant.world_body()}
    for joint in mechanism.tree.joints:
        _add_joint(plant, mechanism, joint.number, bodies, servos)
    for loop in mechanism.constraints().loops:
        kind, a, b = loop.closure.kind, bodies[loop.joint_a], bodies[loop.joint_b]
        if kind == "fixed":
            plant.AddWeldConstraint(a, _transform(loop.frame_a), b, _transform(loop.frame_b))
        elif kind == "spherical" or loop.normal is not None:
            plant.AddBallConstraint(a, np.array(loop.frame_a[:3, 3]), b, np.array(loop.frame_b[:3, 3]))
        else:
            raise NotForThisError(f"this builder has no Drake constraint for a {kind} closure")
    plant.mutable_gravity_field().set_gravity_vector(np.array(mechanism.description.gravity))
    plant.Finalize()
    return plant


def _add_joint(
    plant: drake_plant.MultibodyPlant,
    mechanism: ccpin.Mechanism,
    number: int,
    bodies: dict[int, drake_tree.RigidBody],
    servos: dict[str, Servo],
) -> None:
    """A joint with the body it carries and, where it has a rotor or a servo, its motor."""
    joint, model = mechanism.tree.joints[number - 1], mechanism.pin_model
    if joint.kind.nv != 1 or joint.kind.nq != 1:
        raise NotForThisError(f"this builder has no Drake joint for a {joint.kind.name} joint")
    inertia = _inertia(model.inertias[number])
    bodies[number] = plant.AddRigidBody(f"{joint.name}/body", drake_tree.default_model_instance(), inertia)
    parent = bodies[joint.parent].body_frame()
    frame = plant.AddFrame(drake_tree.FixedOffsetFrame(f"{joint.name}/frame", parent, _transform(joint.placement)))
    axis = joint.kind.directions(np.array(joint.axis))[0]
    kind = drake_tree.PrismaticJoint if joint.kind.sliding else drake_tree.RevoluteJoint
    made = plant.AddJoint(kind(joint.name, frame, bodies[number].body_frame(), axis))
    armature = float(model.armature[joint.v.start])
    if armature or joint.name in servos:
        motor = plant.AddJointActuator(joint.name, made)
        motor.set_default_rotor_inertia(armature)
        motor.set_default_gear_ratio(1.0)
        if joint.name in servos:
            servo = servos[joint.name]
            motor.set_controller_gains(drake_tree.PdControllerGains(p=servo.stiffness, d=servo.damping))


def _transform(placement: np.ndarray) -> drake_math.RigidTransform:
    return drake_math.RigidTransform(np.array(placement))


def _inertia(inertia: object) -> drake_tree.SpatialInertia:
    if inertia.mass <= 0:
        return drake_tree.SpatialInertia.Zero()
    moments = np.array(inertia.inertia)[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    about_com = drake_tree.RotationalInertia(*moments)
    return drake_tree.SpatialInertia.MakeFromCentralInertia(inertia.mass, np.array(inertia.lever), about_com)
