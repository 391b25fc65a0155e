"""MuJoCo on the same mechanism: its forward dynamics, a step, and a run of the paper's move in C."""

from __future__ import annotations

import numpy as np

import ccpin
from benchmarks.peers.mjcf import Servo, mujoco_model
from benchmarks.subjects import Place

try:
    import mujoco
    from mujoco import rollout
except ImportError:
    mujoco = None


class MuJoCo:
    """The mechanism at a place; loops are as stiff as a step of 1 ms allows.

    Raises:
        NotForThisError: MuJoCo is not installed, or cannot have the mechanism.
    """

    def __init__(self, mechanism: ccpin.Mechanism, at: Place) -> None:
        self.at, self.model = at, mujoco_model(mechanism)
        self.data = mujoco.MjData(self.model)
        self.data.qfrc_applied[:] = at.tau

    def forward(self) -> np.ndarray:
        """q̈′ at the place, by `mj_forward`."""
        self.data.qpos[:], self.data.qvel[:] = self.at.q_free, self.at.v_free
        mujoco.mj_forward(self.model, self.data)
        return self.data.qacc

    def step(self) -> None:
        """One `mj_step` of 1 ms from the place."""
        self.data.qpos[:], self.data.qvel[:] = self.at.q_free, self.at.v_free
        mujoco.mj_step(self.model, self.data)


class Move:
    """A controlled motion with RK4, all in C: the motors' laws are MuJoCo's own affine actuators."""

    def __init__(self, mechanism: ccpin.Mechanism, servos: dict[str, Servo], start: np.ndarray, step: float) -> None:
        self.model = mujoco_model(mechanism, timestep=step, integrator="RK4", servos=servos)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = start
        self.initial = np.empty(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(self.model, self.data, self.initial, mujoco.mjtState.mjSTATE_FULLPHYSICS)

    def run(self, steps: int) -> np.ndarray:
        """q′ before and after every step, of shape (steps + 1, nq)."""
        states, _ = rollout.rollout(self.model, self.data, initial_state=self.initial[None], nstep=steps)
        whole = np.vstack([self.initial, states[0]])
        return whole[:, 1 : 1 + self.model.nq]  # the state begins with time
