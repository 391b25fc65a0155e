"""What leads from one side of a transmission to the other as a program: displacements, rates and efforts."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.programs.program import Port, Program
from ccpin.programs.quantities import QUANTITIES, taped_model
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recordings import configuration, program_of
from ccpin.transmission.transmission import Transmission

_STEPS = 2  # Newton's, one more with the last matrix following
_UNITS = {"q": {"rad": "rad", "m": "m"}, "v": {"rad": "rad/s", "m": "m/s"}, "u": {"rad": "N m", "m": "N"}}
_GEARS = "efforts of motors are behind their gears (gear × the motor's own), and not clipped to their limits"


def side_program(transmission: Transmission, to: Literal["joints", "motors"]) -> Program:
    """q, q̇ and efforts of one side, and a closed configuration near by ↦ those of the other.

    With ρ the rows of (14) of the other side's joints, in this side's coordinates: v_to = ρ v, u_to = ρ⁻ᵀ u, so that
    u·v = u_to·v_to. `sigma` is the y of the next call. Efforts are statics of a linkage without weight: those of a
    serial robot to which the linkage's inertia and weight were added.

    Args:
        transmission: The transmission.
        to: The side that it leads to.
    """
    sides = {"joints": transmission.joint_side, "motors": transmission.motor_side}
    models = {"joints": transmission.joint_model, "motors": transmission.motor_model}
    start = "motors" if to == "joints" else "joints"
    mechanism, side, other = models[start].mechanism, sides[start], sides[to]
    model = ReducedModel(replace(mechanism, actuated=side.names), models[start].gravity_vector)  # u: efforts of q
    about = model.at(model.alpha(mechanism.q_reference), mechanism.q_reference)
    scene = taped_model(model, numbering(model, about.q_free), about.q_free, None, {})
    places = {mechanism.tree.joints[joint.number - 1].name: joint.x.start for joint in scene.own.joints}
    rho, given = scene.recorded.motion.rho[other.rows], scene.inputs
    y = QUANTITIES["sigma"].record(scene)
    found = {
        "q": given["x"][[places[name] for name in other.names]],
        "v": rho @ given["v"],
        "u": scene.tape.solve(rho.T, given["u"][:, None])[:, 0],
    }
    shown = [Port("sigma", y.shape, "", tuple(map(str, range(len(y)))))]
    for key, table in found.items():
        units = dict.fromkeys(_UNITS[key][unit] for unit in other.units)
        shown.append(Port(f"{key}_{to}", table.shape, " or ".join(units), other.names))
    outputs = {"sigma": y} | {f"{key}_{to}": table for key, table in found.items()}
    first = ", ".join(f"{key} = {value.tolist()}" for key, value in configuration(about).items())
    notes = _GEARS, f"a configuration to start from: {first}"
    return program_of(scene, about, f"{mechanism.name}: to {to}", outputs, tuple(shown), _STEPS, notes=notes)
