"""What each motor drives at a configuration, and what standing still there takes of it.

At rest (22) is ρᵀSᵀu = g, of gravity and springs. With a motor for each freedom u is one. With more there are many, and
whether one of them is within the limits is a linear programme. With fewer there is one only where g is zero along what
no motor drives. Joints' friction, which would help, is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.dynamics.free_system import FreeSystem
from ccpin.dynamics.plausibility import Finding
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.mechanism.mechanism import Mechanism

_ROUNDING = 1e-9  # of the largest entry, or of weight times size: less is none
_LOOSE = 1e-6  # of a unit velocity: what moves no faster stands still
_ENOUGH = 1.0 + 1e-6  # of a limit: what a linear programme may be off
_NAMED = 3
HELD = "hold it still"
"""In every sentence that tells of motors too weak to."""


class Drive(NamedTuple):
    """A motor, and what its effort does at a configuration when all else rests.

    Attributes:
        motor, joint: Its name, and that of the joint that it is on.
        coordinates: The independent coordinates that it drives.
        unit: Of its effort on the joint: N m, or N where that slides.
        limits: Of that effort, from and to; infinite where none is stated.
        standing: That effort when all stands still; ``None`` where nothing pulls at the freedoms, or no efforts of the
            motors hold them.
    """

    motor: str
    joint: str
    coordinates: tuple[str, ...]
    unit: str
    limits: tuple[float, float]
    standing: float | None

    @property
    def limited(self) -> bool:
        """Whether a limit is stated."""
        return bool(np.isfinite(self.limits).any())

    @property
    def share(self) -> float:
        """Of its limit, what standing still takes: above 1 the limit does not suffice."""
        effort, (lower, upper) = self.standing or 0.0, self.limits
        if lower > 0.0 or upper < 0.0:
            return 1.0 if lower <= effort <= upper else np.inf
        limit = upper if effort > 0.0 else -lower
        return 0.0 if not effort else abs(effort) / limit if limit else np.inf

    def told(self) -> tuple[str, str]:
        """The effort with its unit, and the limit or both: without signs where the limit is the same either way."""
        effort, (lower, upper) = self.standing or 0.0, self.limits
        if lower == -upper:
            return f"{abs(effort):.3g} {self.unit}", f"limit {upper:.4g} {self.unit}"
        return f"{effort:.3g} {self.unit}", f"limits {lower:.4g} … {upper:.4g} {self.unit}"


class Drives(NamedTuple):
    """What all motors do at a configuration.

    Attributes:
        each: The motors.
        driven: The rank of ρᵀSᵀ: how many of the n freedoms they drive.
        loose: The coordinates of what moves where no motor does.
        balanced: Whether efforts of the motors, however large, hold it still.
    """

    each: tuple[Drive, ...]
    driven: int
    loose: tuple[str, ...]
    balanced: bool

    @property
    def shared(self) -> bool:
        """Whether there are many efforts that hold it still, as motors can work against each other."""
        return len(self.each) > self.driven


def drives_of(mechanism: Mechanism, q_free: Array | None = None, free: FreeSystem | None = None) -> Drives:
    """What ρᵀSᵀ takes each motor's effort to at a configuration, and the efforts at rest there; S is of unit gears.

    Args:
        mechanism: The mechanism.
        q_free: A closed configuration, of shape (nq,); default the reference.
        free: What pulls; default the description's gravity, and the springs.
    """
    tree, centre = mechanism.tree, mechanism.q_reference
    here = centre if q_free is None else q_free
    rho = mechanism.parametrization().at(here).rho
    motors, coordinates = (IndependentCoordinates(tree, x, centre) for x in (mechanism.actuated, mechanism.independent))
    acts, names = motors.jacobian(here) @ rho, _of_each_velocity(coordinates)
    _, singular, right = np.linalg.svd(acts if acts.size else np.zeros((1, len(names))))
    driven = int(np.sum(singular > _ROUNDING * singular.max(initial=0.0)))
    loose = _named(names, np.abs(right[driven:]).max(axis=0, initial=0.0) > _LOOSE)
    limits = mechanism.motors.joint_limits
    load = _load(mechanism, FreeSystem(tree) if free is None else free, here, rho)
    standing, balanced = _standing(*load, acts.T, limits, len(acts) > driven)
    of_each = zip(
        mechanism.motors.each, _of_each_velocity(motors), acts, motor_units(mechanism), limits, standing, strict=True
    )
    each = [
        Drive(motor.name, joint, _moved(names, row), unit, (float(lower), float(upper)), effort)
        for motor, joint, row, unit, (lower, upper), effort in of_each
    ]
    return Drives(tuple(each), driven, loose, balanced)


def motor_units(mechanism: Mechanism) -> list[str]:
    """Of each motor's effort on its joint: N m, or N where that slides."""
    motors = IndependentCoordinates(mechanism.tree, mechanism.actuated, mechanism.q_reference)
    return ["N" if slides else "N m" for part in motors.parts for slides in part.slides]


def _load(mechanism: Mechanism, free: FreeSystem, q_free: Array, rho: Array) -> tuple[Array, float]:
    """g = ρᵀg′, and what it would be of were it not rounding."""
    pull = free.gravity(q_free)
    mass = sum(inertia.mass for inertia in mechanism.tree.model.inertias)
    weight = mass * float(np.linalg.norm(free.model.gravity.linear))
    return rho.T @ pull, weight * mechanism.description.size + np.abs(pull).max(initial=0.0)


def _standing(
    load: Array, least: float, transmission: Array, limits: Array, shared: bool
) -> tuple[list[float | None], bool]:
    """Efforts u on the motors' joints with ρᵀSᵀu = g, within limits (motors, 2) if any are, else of least norm.

    Returns:
        u, of ``None`` where g is zero or no u will do, and whether one will.
    """
    none: list[float | None] = [None] * len(limits)
    if not (np.abs(load) > _ROUNDING * least).any():
        return none, True
    efforts = np.asarray(np.linalg.lstsq(transmission, load, rcond=None)[0])
    if (np.abs(transmission @ efforts - load) > _ROUNDING * least).any():
        return none, False
    if shared and not _within(efforts, limits):
        from scipy.optimize import linprog

        size = np.abs(load).max()
        found = linprog(np.zeros(len(limits)), A_eq=transmission, b_eq=load / size, bounds=limits / size)
        efforts = size * found.x if found.success else efforts
    return [float(u) if abs(u) > _ROUNDING * np.abs(efforts).max() else 0.0 for u in efforts], True


def _within(efforts: Array, limits: Array) -> bool:
    return bool(((limits[:, 0] <= efforts) & (efforts <= limits[:, 1])).all())


def of_standing(mechanism: Mechanism, drives: Drives, floats: bool) -> Iterator[Finding]:
    """Motors that cannot carry what they drive, at rest at the reference."""
    if not drives.balanced:
        if floats:
            yield Finding("note", "what standing still takes is not told: it depends on what carries the base")
        else:
            yield Finding("doubtful", "no efforts of the motors hold it still")
    weak = _weak(drives)
    told = [_shared(drives)] if weak and drives.shared else map(_lacking, weak)
    yield from (Finding("doubtful", sentence) for sentence in told)
    if weak:
        yield Finding("note", remedy(mechanism, weak[0]))


def too_weak(mechanism: Mechanism, poses: Mapping[str, Array], free: FreeSystem | None = None) -> str:
    """That motors cannot carry what they drive at rest, and what to do about it; empty where they can.

    Args:
        mechanism: The mechanism.
        poses: Closed configurations q′, of shape (nq,), by where they are: ``"at the goal"``.
        free: What pulls there, as for `drives_of`.

    Returns:
        The words of `of_standing`, of the motor and pose for which a limit suffices least, and which motors besides.
    """
    every = [(where, drives_of(mechanism, q_free, free)) for where, q_free in poses.items()]
    weak = [(drive.share, k, drive) for k, (_, drives) in enumerate(every) for drive in _weak(drives)]
    if not weak:
        return ""
    _, k, worst = max(weak, key=lambda one: one[0])
    where, drives = every[k]
    told = _shared(drives, f" {where}") if drives.shared else _lacking(worst, f" {where}")
    others = [] if drives.shared else [name for name in dict.fromkeys(x.motor for *_, x in weak) if name != worst.motor]
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    too = f" (nor can {', '.join(others[:_NAMED])}{more})" if others else ""
    return f"{told}{too}; {remedy(mechanism, worst)}"


def remedy(mechanism: Mechanism, drive: Drive) -> str:
    """What to do about a limit that whatever wrote the file put in for want of a number."""
    joint = mechanism.tree.split(drive.joint)[0]
    stated = f'joints={{"{joint}": {{"effort": …}}}}'
    if (mechanism.tree.joint(joint).stated.effort or np.inf) > _ENOUGH * np.abs(drive.limits).max():
        stated = f'motors={{"{joint}": {{"lower": …, "upper": …}}}}'
    return (
        f"if the limit is a placeholder, state the motor's own, ccpin.load(…, {stated}), or simulate without any: "
        '--effort-limits ignore, in Python limits=Limits(effort="ignore")'
    )


def _weak(drives: Drives) -> list[Drive]:
    return [drive for drive in drives.each if drive.standing is not None and drive.share > _ENOUGH]


def _lacking(drive: Drive, where: str = "") -> str:
    effort, limit = drive.told()
    return f"motor '{drive.motor}' cannot {HELD}{where}: that takes {effort} ({limit})"


def _shared(drives: Drives, where: str = "") -> str:
    return f"however {len(drives.each)} motors share it, their limits do not {HELD}{where}"


def moving_mass(mechanism: Mechanism) -> float:
    """The mass, kg, of all bodies that some q̇ moves at the reference."""
    model, here = mechanism.tree.model, mechanism.q_reference
    moves = np.zeros(model.njoints, dtype=bool)
    with mechanism.tree.scratch.lent() as data:
        for v_free in mechanism.parametrization().at(here).rho.T:
            pin.forwardKinematics(model, data, here, v_free)
            moves |= [np.linalg.norm(v.vector) > _LOOSE * np.linalg.norm(v_free) for v in data.v]
    return float(sum(inertia.mass for inertia, moved in zip(model.inertias, moves, strict=True) if moved))


def _of_each_velocity(coordinates: IndependentCoordinates) -> list[str]:
    """The coordinate's name for each of its velocities."""
    return [part.name for part in coordinates.parts for _ in range(part.v.stop - part.v.start)]


def _moved(names: list[str], row: Array) -> tuple[str, ...]:
    """The names of what is not zero in a row."""
    return _named(names, np.abs(row) > _ROUNDING * np.abs(row).max(initial=0.0))


def _named(names: list[str], which: Array) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for name, is_so in zip(names, which, strict=True) if is_so))
