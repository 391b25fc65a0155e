"""A mechanism's own MJCF file run in MuJoCo beside the reduced model: how far its soft loops open, and where it goes.

MuJoCo holds a closure by a spring and a damper (solref, solimp), so its loops are open by a little while forces act,
and the motion is another by a little. Both are measured here, of the file as it was written.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array, positive, vector
from ccpin.control.control_law import HeldEffort
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.simulation.integration.single_run import simulate
from ccpin.simulation.results.trajectory import Trajectory

if TYPE_CHECKING:
    import mujoco

SAMPLE = 0.01  # s between comparisons
_GENTLE = 0.3  # rad/s² or m/s² of every independent coordinate at the start, as far as the motors can
_KEY = "reference"  # the keyframe that the writer makes of the closed reference


class MujocoRun(NamedTuple):
    """What a run of MuJoCo's came to.

    Attributes:
        gap: The farthest that the ends of a closure (or of a rod) came apart, m; infinite, like the two below, where
            MuJoCo became unstable.
        turned: The largest difference of a turning joint's displacement from ours, rad; where spins are locked that are
            free in the file, of an independent one's.
        slid: The same of sliding joints, m.
        seconds: How long both ran; less than was asked for where ours ended at a singular configuration.
        u: What the motors gave, held.
    """

    gap: float
    turned: float
    slid: float
    seconds: float
    u: Array

    def __str__(self) -> str:
        if math.isinf(self.gap):
            return f"MuJoCo becomes unstable after {self.seconds:.3g} s"
        off = [f"{math.degrees(self.turned):.2g}°"] + ([f"{self.slid:.2g} m"] if self.slid else [])
        return f"loops open by {self.gap:.2g} m, joints off by {' and '.join(off)} within {self.seconds:.3g} s"


def run_in_mujoco(
    model: Mechanism | HasMechanism, file: str | Path, *, u: ArrayLike | None = None, duration: float = 1.0
) -> MujocoRun:
    """Run a mechanism's MJCF file in MuJoCo from its keyframe "reference", at rest, with u held, and so the model.

    Args:
        model: The mechanism, or its reduced model.
        file: What `Mechanism.save` wrote of it as MJCF.
        u: What every motor gives all along, of shape (motors,); default what begins with 0.3 rad/s² (or m/s²) of each
            independent coordinate, as far as motors and their bounds go.
        duration: Seconds.

    Raises:
        CcpinError: MuJoCo is not installed (``pip install 'ccpin[mujoco]'``), or refuses the file.
        InvalidInputError: The file has no such keyframe or lacks a joint or motor of the mechanism's, u has another
            size, or `duration` is not positive.
    """
    reduced = model if isinstance(model, ReducedModel) else ReducedModel(mechanism_of(model))
    mechanism, until = reduced.mechanism, positive(duration, "duration")
    if not isinstance(file, str | Path):
        raise InvalidInputError(f"file must be a path, not {type(file).__name__}")
    if not math.isfinite(until):
        raise InvalidInputError("duration must be finite")
    held = _gentle(reduced) if u is None else np.array(vector(u, "u", reduced.n_actuated))
    engine = _compiled(Path(file))
    every = max(1, math.ceil(SAMPLE / engine.opt.timestep - 1e-9))
    q = reduced.alpha(mechanism.q_reference)
    sample = every * float(engine.opt.timestep)
    ours = simulate(reduced, HeldEffort(held), q, duration=max(until, sample), sample_period=sample)
    import mujoco

    mujoco.set_mju_user_warning(lambda _: None)  # else they go to a file MUJOCO_LOG.TXT in the working folder
    try:
        return _beside(mechanism, engine, ours, held, every)
    finally:
        mujoco.set_mju_user_warning(None)


def _gentle(model: ReducedModel) -> Array:
    """u by which the reference begins to move with `_GENTLE`, in the least-squares sense, within the motors' bounds."""
    rest, n = np.zeros(model.n), model.n_actuated
    if not n:
        return np.zeros(0)
    state = model.at(model.alpha(model.mechanism.q_reference))
    alone = state.forward_dynamics(rest, np.zeros(n))
    columns = np.column_stack([state.forward_dynamics(rest, unit) - alone for unit in np.eye(n)])
    u = np.linalg.lstsq(columns, _GENTLE - alone, rcond=None)[0]
    return np.clip(u, *model.mechanism.motors.limits.T)


def _compiled(file: Path) -> mujoco.MjModel:
    try:
        import mujoco
    except ImportError as error:
        raise CcpinError(f"MuJoCo is not installed ({error}): pip install 'ccpin[mujoco]'") from error
    try:
        return mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        raise CcpinError(f"MuJoCo refuses '{file}': {error}") from error


def _beside(mechanism: Mechanism, engine: Any, ours: Trajectory, u: Array, every: int) -> MujocoRun:
    import mujoco

    data, probe = mujoco.MjData(engine), mujoco.MjData(engine)
    key = mujoco.mj_name2id(engine, mujoco.mjtObj.mjOBJ_KEY, _KEY)
    if key < 0:
        raise InvalidInputError(f"the file has no keyframe '{_KEY}': it is none of those that ccpin writes")
    mujoco.mj_resetDataKeyframe(engine, data, key)
    data.ctrl[:] = _inputs(mechanism, engine, u)
    chosen = {mechanism.tree.split(name)[0] for name in mechanism.independent}
    compared = [each for each in mechanism.tree.joints if not mechanism.locked or each.name in chosen]
    joints = [_Compared.of(engine, joint) for joint in compared]
    unstable = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    worst = np.zeros(3)
    for k, q_free in enumerate(ours.q_free):
        if k and not math.isclose(ours.t[k] - ours.t[k - 1], every * engine.opt.timestep, rel_tol=1e-6):
            break  # the last sample of a motion that ended early
        for _ in range(every if k else 0):
            mujoco.mj_step(engine, data)
        if any(data.warning[int(kind)].number for kind in unstable):
            return MujocoRun(math.inf, math.inf, math.inf, float(ours.t[k - 1]), u)
        probe.qpos[:] = data.qpos
        mujoco.mj_fwdPosition(engine, probe)
        off = [joint.off(data.qpos, q_free) for joint in joints]
        worst = np.maximum(worst, [_gap(engine, probe), *np.max([(0.0, 0.0), *off], axis=0)])
    seconds = float(data.time)
    return MujocoRun(float(worst[0]), float(worst[1]), float(worst[2]), seconds, u)


def _inputs(mechanism: Mechanism, engine: Any, u: Array) -> Array:
    """u in the order of MuJoCo's actuators."""
    driven = {mechanism.tree.split(name)[0]: value for name, value in zip(mechanism.actuated, u, strict=True)}
    names = [engine.joint(engine.actuator(k).trnid[0]).name for k in range(engine.nu)]
    if sorted(names) != sorted(driven):
        raise InvalidInputError(
            f"the file's motors are on {', '.join(names) or 'no joints'}, not on {', '.join(driven)}"
        )
    return np.array([driven[name] for name in names])


class _Compared(NamedTuple):
    """Where a joint's displacement stands here and there."""

    joint: TreeJoint
    kind: str
    at: int

    @classmethod
    def of(cls, engine: Any, joint: TreeJoint) -> _Compared:
        """A joint of both.

        Raises:
            InvalidInputError: The file has no such joint.
        """
        import mujoco

        number = mujoco.mj_name2id(engine, mujoco.mjtObj.mjOBJ_JOINT, joint.name)
        if number < 0:
            raise InvalidInputError(f"the file has no joint '{joint.name}'")
        return cls(joint, joint.stated.kind, int(engine.jnt_qposadr[number]))

    def off(self, qpos: Array, q_free: Array) -> tuple[float, float]:
        """The difference of displacements, rad and m."""
        mine = self.joint.kind.told(q_free[self.joint.q])
        if self.kind == "prismatic":
            return 0.0, abs(float(qpos[self.at]) - mine[0])
        if self.kind == "spherical":
            w, x, y, z = qpos[self.at : self.at + 4]
            return float((Rotation.from_quat([x, y, z, w]) * Rotation.from_quat(mine).inv()).magnitude()), 0.0
        if self.kind in ("revolute", "continuous"):
            return abs(math.remainder(float(qpos[self.at]) - mine[0], 2.0 * math.pi)), 0.0
        return 0.0, 0.0  # a free body's pose is that of the joints below it and the loops'


def _gap(engine: Any, data: Any) -> float:
    """The farthest apart that an equality's ends are: of points and welds their distance, of rods that of lengths."""
    import mujoco

    kinds = {int(kind) for kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD, mujoco.mjtEq.mjEQ_TENDON)}
    rows: dict[int, list[float]] = {}
    for row in range(data.ne):
        rows.setdefault(int(data.efc_id[row]), []).append(float(data.efc_pos[row]))
    held = [values[:3] for number, values in rows.items() if int(engine.eq_type[number]) in kinds]
    return max((math.hypot(*values) for values in held), default=0.0)
