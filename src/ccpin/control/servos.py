"""The loops that a file closes around its motors, played as a law: MJCF's position, velocity and general actuators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.control.control_law import ControlLaw, Measurement, of_own
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import State
from ccpin.errors import UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism


class Servos(ControlLaw):
    """u = g·input + b₀ + b₁·gear·θ + b₂·gear·θ̇ of each motor's own joint; u = input without a loop.

    Inputs and u are cut off at their bounds.

    Args:
        model: The reduced model, or a mechanism.
        inputs: The motors' inputs (MuJoCo's ctrl), of shape (motors,), constant or a function of time: a goal in rad or
            m for a position servo, a speed for a velocity servo, u itself for a plain motor.

    Raises:
        InvalidInputError: Inputs that are constant and of the wrong shape or not finite.
        UnsupportedMechanismError: A motor's loop has a state or is no such sum (a muscle, an integrator), states its
            damping by a ratio, or drives a joint of several velocities.
    """

    def __init__(self, model: ReducedModel | Mechanism, inputs: ArrayLike | Callable[[float], ArrayLike]) -> None:
        self.model = model_of(model)
        self._constant_inputs = not callable(inputs)
        if not callable(inputs):
            constant = np.array(vector(inputs, "inputs", self.model.n_actuated))
            self._inputs: Callable[[float], ArrayLike] = lambda t: constant
        else:
            self._inputs = inputs
        motors, tree = self.model.mechanism.motors, self.model.mechanism.tree
        joints = [tree.joint(motor.joint.partition(":")[0]) for motor in motors.each]
        terms = []
        for motor, joint in zip(motors.each, joints, strict=True):
            servo = motor.kind != "motor"
            if servo and (
                joint.kind.nq != 1 or "gain" not in motor.gains or {"dynprm", "dampratio"} & set(motor.gains)
            ):
                raise UnsupportedMechanismError(
                    f"the loop of motor '{motor.name}' ({motor.kind}) is not a gain, a constant and a feedback of its "
                    "joint's displacement and velocity: write it as a function (t, q, v) → u"
                )
            gain, bias = (motor.gains["gain"][0], motor.gains["bias"]) if servo else (1.0, (0.0, 0.0, 0.0))
            terms.append((gain, bias[0], bias[1] * motor.gear, bias[2] * motor.gear))
        self._gain, self._constant, self._by_q, self._by_v = np.reshape(terms, (-1, 4)).T
        self._inputs_within = np.reshape([m.gains.get("inputs", (-np.inf, np.inf)) for m in motors.each], (-1, 2)).T
        self._q = np.array([joint.q.start for joint in joints], dtype=np.intp)
        self._v = np.array([joint.v.start for joint in joints], dtype=np.intp)
        self._lower, self._upper = motors.limits.T

    def torque(self, t: float, state: State | Measurement, v: Array) -> Array:
        """u, of shape (motors,)."""
        inputs = np.clip(vector(self._inputs(t), "inputs", self.model.n_actuated), *self._inputs_within)
        own = of_own(self.model, state, None)
        theta, rate = own.q_free[self._q], own.v_free(v)[self._v]
        u = self._gain * inputs + self._constant + self._by_q * theta + self._by_v * rate
        return np.asarray(np.clip(u, self._lower, self._upper))

    def next_switch(self, t: float) -> float | None:
        """Never where the inputs are constant, else not known."""
        return np.inf if self._constant_inputs else None
