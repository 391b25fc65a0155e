"""A mechanism as MuJoCo's model at its best: ccpin's own MJCF, with stiff loops, no needless rows and no contacts."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import ccpin
from benchmarks.peers import NotForThisError
from ccpin.errors import CcpinError

try:
    import mujoco
except ImportError:
    mujoco = None

ITERATIONS, TOLERANCE = 20, 1e-14  # of MuJoCo's solver: to rounding, as we solve
STIFF = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp


class Servo(NamedTuple):
    """A motor whose effort is offset − stiffness q − damping q̇ of its joint."""

    offset: float
    stiffness: float
    damping: float


def mujoco_model(
    mechanism: ccpin.Mechanism,
    *,
    timestep: float = 1e-3,
    integrator: str = "Euler",
    servos: dict[str, Servo] | None = None,
) -> mujoco.MjModel:
    """The compiled model; loops close as fast as a step allows, planar ones by their common point alone.

    Args:
        mechanism: The mechanism.
        timestep: In seconds.
        integrator: ``"Euler"`` or ``"RK4"``.
        servos: Motors by joint; default none.

    Raises:
        NotForThisError: MuJoCo is not installed, or has no such joint or closure.
    """
    if mujoco is None:
        raise NotForThisError("MuJoCo is not installed")
    planar = {loop.closure.name for loop in mechanism.constraints().loops if loop.normal is not None}
    closures = tuple(
        replace(each, kind="spherical") if each.name in planar else each for each in mechanism.description.closures
    )
    bare = tuple(replace(link, visuals=()) for link in mechanism.description.links)
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "mechanism.xml"
            ccpin.load(replace(mechanism.settled(), closures=closures, links=bare)).save(file)
            made = mujoco.MjSpec.from_file(str(file))
    except (CcpinError, ValueError) as error:
        raise NotForThisError(f"MuJoCo cannot have it: {error}") from None
    made.compiler.fusestatic = True
    made.option.timestep, made.option.integrator = (
        timestep,
        getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"),
    )
    made.option.iterations, made.option.tolerance = ITERATIONS, TOLERANCE
    made.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for equality in made.equalities:
        equality.solref[:], equality.solimp[:] = (2.0 * timestep, 1.0), STIFF
    for motor in list(made.actuators):
        made.delete(motor)
    for joint, (offset, stiffness, damping) in (servos or {}).items():
        motor = made.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0], motor.biasprm[:3] = 0.0, (offset, -stiffness, -damping)
    for joint in made.joints:
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    return made.compile()
