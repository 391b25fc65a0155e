"""What the peers do with one closed loop, measured: ``python -m benchmarks.comparison`` prints it.

A four-bar (the installed ``four_bar``: its crank goes all the way round) swings for ten seconds from rest, without
motor or friction, so that its loop should stay closed and its energy the same. Then the loop is asked about where it
has no answer: the five-bar ``rpdr`` with its forearms in line, and a parallelogram with all its bars in line. Who is
not installed is skipped with a word.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import ccpin
from benchmarks.peers import NotForThisError, drake
from benchmarks.peers.mjcf import mujoco_model
from benchmarks.peers.pinocchio import contacts, memory
from ccpin import domain
from ccpin.errors import CcpinError

try:
    import mujoco
except ImportError:
    mujoco = None

START, STEP, SECONDS = 0.7, 1e-3, 10.0  # rad of the crank; s
BAUMGARTE = (1e4, 2e2)  # 1/s² and 1/s: critically damped, 10 ms
BASE, CRANK = 0.10, 0.04  # m, of the four-bar
FORCE = 1.0  # N m, of the torques at a singular configuration

Run = Callable[[int], np.ndarray]  # q′ and q̇′ after each of so many steps, of shape (steps + 1, 2 n′)


class Swing(NamedTuple):
    """What became of the loop.

    Attributes:
        who: The engine and how it was set.
        gap: The largest distance of the loop's ends, m.
        energy: The largest change of the energy, of the swing's.
        angle: How far the crank is from where ccpin at 1e-12 has it at the end, rad.
    """

    who: str
    gap: float
    energy: float
    angle: float


def swings(seconds: float = SECONDS) -> tuple[list[Swing], dict[str, str]]:
    """Everyone's ten seconds, and who is missing and why."""
    mechanism = ccpin.load("four_bar")
    steps = round(seconds / STEP)
    exact = _ccpin(mechanism, 1e-12)(steps)
    found, absent = [], dict[str, str]()
    for who, start in ENGINES.items():
        try:
            run = start(mechanism)
        except NotForThisError as reason:
            absent[who] = str(reason)
            continue
        found.append(_judged(who, mechanism, run(steps), exact))
    return found, absent


def _judged(who: str, mechanism: ccpin.Mechanism, states: np.ndarray, exact: np.ndarray) -> Swing:
    """By Pinocchio's kinematics and energies, whoever moved."""
    free, n, (loop,) = mechanism.pin_model, mechanism.pin_model.nq, contacts(mechanism)
    data = free.createData()
    gaps, energies = [], []
    for state in states:
        rotors = 0.5 * float(free.armature @ state[n:] ** 2)  # which Pinocchio's energy is without
        energies.append(pin.computeMechanicalEnergy(free, data, state[:n], state[n:]) + rotors)
        one = data.oMi[loop.joint1_id] * loop.joint1_placement.translation
        other = data.oMi[loop.joint2_id] * loop.joint2_placement.translation
        gaps.append(np.linalg.norm(one - other))
    swing = max(pin.computeKineticEnergy(free, data, state[:n], state[n:]) for state in exact)
    crank = mechanism.tree.joint("crank").q
    off = np.abs(states[-1, crank] - exact[-1, crank])
    return Swing(who, float(max(gaps)), float(np.ptp(energies) / swing), float(off[0]))


def _start(mechanism: ccpin.Mechanism) -> np.ndarray:
    return ccpin.ReducedModel(mechanism).sigma([START])


def _ccpin(mechanism: ccpin.Mechanism, rtol: float = 1e-9) -> Run:
    model = ccpin.ReducedModel(mechanism)

    def run(steps: int) -> np.ndarray:
        motion = ccpin.simulate(model, None, [START], duration=steps * STEP, sample_period=STEP, rtol=rtol)
        return np.hstack([motion.q_free, motion.v_free])

    return run


def _mujoco(stiff: bool) -> Callable[[ccpin.Mechanism], Run]:
    def start(mechanism: ccpin.Mechanism) -> Run:
        model = mujoco_model(mechanism, timestep=STEP, integrator="RK4" if stiff else "Euler")
        if not stiff:
            model.eq_solref[:], model.eq_solimp[:] = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)  # its defaults
        order = [mechanism.tree.joint(model.joint(k).name) for k in range(model.njnt)]

        def run(steps: int) -> np.ndarray:
            data, n = mujoco.MjData(model), mechanism.n_free
            q = _start(mechanism)
            data.qpos[:] = [q[joint.q][0] for joint in order]
            states = np.empty((steps + 1, 2 * n))
            for k in range(steps + 1):
                for at, joint in enumerate(order):
                    states[k, joint.q], states[k, n + joint.v.start] = data.qpos[at], data.qvel[at]
                mujoco.mj_step(model, data)
            return states

        return run

    return start


def _drake(mechanism: ccpin.Mechanism) -> Run:
    plant = drake.plant_of(mechanism, STEP, {})

    def run(steps: int) -> np.ndarray:
        context = plant.CreateDefaultContext()
        if plant.num_actuators():
            plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
        state = np.concatenate([_start(mechanism), np.zeros(mechanism.n_free)])
        states = np.empty((steps + 1, len(state)))
        for k in range(steps + 1):
            states[k] = state
            plant.SetPositionsAndVelocities(context, state)
            state = plant.EvalUniquePeriodicDiscreteUpdate(context).value(0)
        return states

    return run


def _pinocchio(gains: tuple[float, float], euler: bool = False) -> Callable[[ccpin.Mechanism], Run]:
    def start(mechanism: ccpin.Mechanism) -> Run:
        free, made = mechanism.pin_model, contacts(mechanism)
        data = free.createData()
        for contact in made:
            contact.m_baumgarte_parameters.Kp, contact.m_baumgarte_parameters.Kd = gains
        scratch, settings = memory(made), pin.ProximalSettings(1e-12, 1e-10, 5)
        pin.initConstraintDynamics(free, data, made, scratch)

        def rate(state: np.ndarray) -> np.ndarray:
            q, v = state[: free.nq], state[free.nq :]
            return np.concatenate([v, pin.constraintDynamics(free, data, q, v, 0 * v, made, scratch, settings)])

        def run(steps: int) -> np.ndarray:
            states = np.empty((steps + 1, free.nq + free.nv))
            states[0] = np.concatenate([_start(mechanism), np.zeros(free.nv)])
            for k, state in enumerate(states[:-1]):
                one = rate(state)
                if euler:  # with the new velocity, as Pinocchio's own example steps
                    v = state[free.nq :] + STEP * one[free.nq :]
                    states[k + 1] = np.concatenate([state[: free.nq] + STEP * v, v])
                    continue
                two = rate(state + STEP / 2 * one)
                three = rate(state + STEP / 2 * two)
                four = rate(state + STEP * three)
                states[k + 1] = state + STEP / 6 * (one + 2 * two + 2 * three + four)
            return states

        return run

    return start


ENGINES = {
    "ccpin": _ccpin,
    "MuJoCo, as it comes": _mujoco(stiff=False),
    "MuJoCo, RK4, stiffest": _mujoco(stiff=True),
    "Drake, SAP": _drake,
    "Pinocchio, Euler": _pinocchio((0.0, 0.0), euler=True),
    "Pinocchio, Euler, Baumgarte": _pinocchio(BAUMGARTE, euler=True),
    "Pinocchio, RK4": _pinocchio((0.0, 0.0)),
    "Pinocchio, RK4, Baumgarte": _pinocchio(BAUMGARTE),
}
"""All at steps of 1 ms; ccpin's steps are its own, at its default tolerance."""


class Asked(NamedTuple):
    """What somebody says of a configuration: the accelerations of all joints (rad/s²), or the words of an error."""

    who: str
    said: np.ndarray | str

    def __str__(self) -> str:
        if isinstance(self.said, str):
            return f"error: {self.said}"
        return "NaN" if np.isnan(self.said).any() else f"numbers, up to {np.abs(self.said).max():.3g} rad/s²"


def forearms_in_line() -> tuple[ccpin.Mechanism, np.ndarray]:
    """The five-bar with its forearms in line: its motors' angles do not tell where the tool goes from here."""
    mechanism = ccpin.load("rpdr")
    fold = next(curve for curve in domain.singularities(mechanism) if curve.kind == "fold")
    return mechanism, fold.q_free[len(fold.q_free) // 3]


def bars_in_line() -> tuple[ccpin.Mechanism, np.ndarray]:
    """A parallelogram with all four bars in line: from here it may go on as one, or as an antiparallelogram."""
    plain = ccpin.load("four_bar").description
    (pin_of_it,) = plain.closures
    ends = pin_of_it.placement_a.copy(), pin_of_it.placement_b.copy()
    ends[0][0, 3], ends[1][0, 3] = BASE, CRANK  # the lengths of coupler and rocker
    closure = replace(pin_of_it, placement_a=ends[0], placement_b=ends[1])
    pose = {"crank": (0.7,), "coupler": (-0.7,), "rocker": (0.7,)}
    return ccpin.load(replace(plain, closures=(closure,), reference=pose)), np.zeros(3)


def asked(mechanism: ccpin.Mechanism, q_free: np.ndarray) -> list[Asked]:
    """Everyone is asked what the joints do at rest under a torque at the first one."""
    tau = FORCE * np.eye(mechanism.n_free)[0]
    answers = {
        "ccpin": _asked_ccpin,
        "MuJoCo": _asked_mujoco,
        "Drake, SAP": _asked_drake,
        "Pinocchio, μ = 0": _asked_pinocchio(0.0),
        "Pinocchio, μ = 1e-10": _asked_pinocchio(1e-10),
    }
    found = list[Asked]()
    for who, answer in answers.items():
        try:
            found.append(Asked(who, answer(mechanism, q_free, tau)))
        except NotForThisError as reason:
            found.append(Asked(who, f"skipped: {reason}"))
        except CcpinError as error:
            found.append(Asked(who, str(error)))
    return found


def _asked_ccpin(mechanism: ccpin.Mechanism, q_free: np.ndarray, tau: np.ndarray) -> np.ndarray:
    model = ccpin.ReducedModel(mechanism)
    state, still = model.at(model.alpha(q_free), q_free), np.zeros(model.n)
    return state.a_free(still, state.forward_dynamics(still, np.zeros(model.n_actuated), loads=tau))


def _asked_mujoco(mechanism: ccpin.Mechanism, q_free: np.ndarray, tau: np.ndarray) -> np.ndarray:
    model = mujoco_model(mechanism)
    data = mujoco.MjData(model)
    for k in range(model.njnt):
        joint = mechanism.tree.joint(model.joint(k).name)
        data.qpos[k], data.qfrc_applied[k] = q_free[joint.q][0], tau[joint.v.start]
    mujoco.mj_forward(model, data)
    return data.qacc.copy()


def _asked_drake(mechanism: ccpin.Mechanism, q_free: np.ndarray, tau: np.ndarray) -> np.ndarray:
    plant = drake.plant_of(mechanism, STEP, {})
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, np.concatenate([q_free, 0 * tau]))
    plant.get_applied_generalized_force_input_port().FixValue(context, tau)
    if plant.num_actuators():
        plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
    return plant.EvalUniquePeriodicDiscreteUpdate(context).value(0)[len(q_free) :] / STEP


def _asked_pinocchio(mu: float) -> Callable[[ccpin.Mechanism, np.ndarray, np.ndarray], np.ndarray]:
    def answer(mechanism: ccpin.Mechanism, q_free: np.ndarray, tau: np.ndarray) -> np.ndarray:
        free, made = mechanism.pin_model, contacts(mechanism)
        data, scratch = free.createData(), memory(made)
        pin.initConstraintDynamics(free, data, made, scratch)
        settings = pin.ProximalSettings(1e-12, mu, 5)
        return pin.constraintDynamics(free, data, q_free, 0 * tau, tau, made, scratch, settings).copy()

    return answer


def main() -> None:
    """Print all that is measured."""
    found, absent = swings()
    print(f"{'ten seconds of a four-bar':30s}{'loop open by':>14s}{'energy off by':>15s}{'crank off by':>15s}")
    for who, gap, energy, angle in found:
        print(f"{who:30s}{gap:12.1e} m{energy:15.1e}{angle:11.1e} rad")
    for who, reason in absent.items():
        print(f"{who:30s}skipped: {reason}")
    for make in (forearms_in_line, bars_in_line):
        print(f"\n{make.__doc__}")
        for answer in asked(*make()):
            print(f"  {answer.who:24s}{answer}")


if __name__ == "__main__":
    main()
