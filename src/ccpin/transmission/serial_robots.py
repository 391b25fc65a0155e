"""`serial_robot`: the mechanism as a serial robot to train on: no linkage, its inertia and limits at the joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, vector, whole
from ccpin.description.formats import format_of, write_description
from ccpin.description.model import Joint, MechanismDescription
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.files import write_atomically
from ccpin.programs.program import Program
from ccpin.programs.recordings import record
from ccpin.transmission.effort_box import EffortBoxCertificate
from ccpin.transmission.equivalent_masses import Additions, equivalent
from ccpin.transmission.linkage import massless, stated_of, stated_otherwise
from ccpin.transmission.posture import Posture
from ccpin.transmission.serial_misfits import SerialErrors, serial_errors
from ccpin.transmission.serial_parts import described, ground_of, kept_links, places_of
from ccpin.transmission.serial_range import effort_limits, reached, speed_limits
from ccpin.transmission.transmission import Transmission

WRITTEN_AS = ("urdf", "sdf", "mjcf")
_NO_LIMIT = 1e9  # N m, rad/s
_COUNTS = {1: 33, 2: 13, 3: 7}  # postures along each joint


@dataclass(frozen=True, eq=False, repr=False)
class SerialRobot:
    """A serial robot that stands for a closed chain, and by how much it does not.

    Attributes:
        transmission: What it stands for.
        description: The robot: joints with limits, armature, damping and friction; links with the linkage's mass.
        added: What was added to its links and joints.
        lower, upper: The range, rad or m, of shape (n,): its limits of position.
        at: Where D is the mechanism's; ``None``: it was fitted over the range.
        errors: The largest differences over the range.
        effort, speed: Its limits, N m or N and rad/s or m/s, of shape (n,); ∞ where none is stated of the motors.
        held: The certificate of `effort` where there is one; ``None`` or undecided: the limits are of samples.
    """

    transmission: Transmission
    description: MechanismDescription
    added: Additions
    lower: Array
    upper: Array
    at: Posture | None
    errors: SerialErrors
    effort: Array
    speed: Array
    held: EffortBoxCertificate | None

    def __repr__(self) -> str:
        return "\n".join(self.told())

    @property
    def proved(self) -> bool:
        """Whether motors are proved to hold `effort` all over the range."""
        return self.held is not None and self.held.verdict == "proven"

    @cached_property
    def motor_map(self) -> Program:
        """q_j and a closed configuration near by → the numbers that depend (the motors' among them), and ρ.

        Rows of ρ that are the motors' make J: τ_m = J⁻ᵀ τ_j, q̇_m = J q̇_j.
        """
        return record(self.transmission.joint_model, ("sigma", "rho"), given="near")

    def told(self) -> Iterator[str]:
        """What it is and by how much it is not the mechanism, in lines."""
        joints, errors = self.transmission.joints, self.errors
        name = self.transmission.joint_model.mechanism.name
        yield f"{name} as a serial robot of {', '.join(joints)}; driven through {', '.join(self.transmission.motors)}"
        met = "fitted over the range" if self.at is None else f"D is the mechanism's at {_row(self.at.q_joint)}"
        yield f"range {_row(self.lower)} … {_row(self.upper)}; {met}; largest differences over it, sampled:"
        parts = [f"D {100 * errors.share:.3g} %"]
        for what, each, unit in (
            ("C q̇", errors.velocity, "per (rad/s)²"),
            ("g", errors.gravity, ""),
            ("damping", errors.damping, ""),
        ):
            if each.any():
                parts.append(f"{what} ±{_row(each if each.ndim == 1 else each.max(axis=1))} {unit}".rstrip())
        yield "  " + "; ".join(parts)
        for what, limits, how in (
            ("efforts", self.effort, "proved" if self.proved else "sampled, with margin"),
            ("speeds", self.speed, "sampled, with margin"),
        ):
            yield f"  {what} ±{_row(limits)} ({how})" if np.isfinite(limits).all() else f"  {what}: none stated"
        yield f"  armatures added {_row(self.added.armatures)}"
        for link in dict.fromkeys(point.link for point in self.added.masses):
            points = [point for point in self.added.masses if point.link == link]
            yield f"  mass added to {link} {sum(point.mass for point in points):.4g} kg at {len(points)} points"

    def as_json(self) -> dict[str, Any]:
        """Range, limits, armatures and errors as numbers and lists; ``None`` stands for ∞."""
        limits = {
            name: [x if np.isfinite(x) else None for x in each.tolist()]
            for name, each in (("effort", self.effort), ("speed", self.speed))
        }
        return {
            "joints": list(self.transmission.joints),
            "range": [self.lower.tolist(), self.upper.tolist()],
            "at": None if self.at is None else self.at.q_joint.tolist(),
            **limits,
            "effort_proved": self.proved,
            "armature_added": self.added.armatures.tolist(),
            "errors": {name: np.asarray(each).tolist() for name, each in self.errors._asdict().items()},
        }

    def save(self, path: str | Path, format: str | None = None, *, meshes: str = "kept") -> tuple[str, ...]:
        """Write it as URDF, SDF or MJCF, with what `told` says as a comment; returns what was not written.

        Args:
            path: The file; its suffix tells the format where `format` does not (.urdf, .sdf, .xml).
            format: ``"urdf"``, ``"sdf"`` or ``"mjcf"``.
            meshes: As of `Mechanism.save`.

        Raises:
            InvalidInputError: Another format, or the file cannot be written.
            DescriptionError: The format has no words for something, by name.
        """
        wanted = format_of(path) if format is None and isinstance(path, str | Path) else format
        if wanted not in WRITTEN_AS:
            raise InvalidInputError(f"a serial robot is written as one of {', '.join(WRITTEN_AS)}, not {wanted!r:.80}")
        described, notes = self.description, tuple[str, ...]()
        if wanted == "urdf":
            described, notes = _bounded(described)
        notes += write_description(described, path, wanted, meshes=meshes)
        text = Path(path).read_text(encoding="utf-8")
        first, _, rest = text.partition("\n")
        lines = "\n     ".join(line.replace("--", "- -") for line in self.told())
        write_atomically(path, "w", lambda file: file.write(f"{first}\n<!-- {lines} -->\n{rest}"))
        return notes


def serial_robot(
    transmission: Transmission,
    region: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    at: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    count: int | None = None,
    max_cells: int = 256,
) -> SerialRobot:
    """The serial robot that a trainer wants: the linkage gone, its mass, inertia and limits at links and joints.

    Links that the joints alone carry stay, with all that they and their joints state. What the linkage adds to D and g
    is put on them as masses, second moments and armatures, none negative (`ccpin.transmission.equivalent_masses`);
    dampers and dry friction of the linkage as the joints' own, as felt there. Limits are those that the motors keep at
    all postures: efforts as statics (proved where `certify_effort_box` can), speeds of samples.

    Args:
        transmission: The transmission; its joints carry one another, nothing else does.
        region: Lower and upper q_j, of shape (n,) each; default the limits of the joints, drawn towards the reference
            until all of it is reached and no other joint leaves its limits.
        at: Where D is to be the mechanism's, and g as nearly as may be; default a fit over the region.
        effort: Largest efforts of the motors behind their gears; default the mechanism's.
        speed: Largest speeds of the motors' joints; default the mechanism's.
        count: Postures along each joint, 3 or more.
        max_cells: Of `certify_effort_box`.

    Raises:
        InvalidInputError: A joint that is carried by others than the joints; a region that is none, is not reached or
            that other joints' limits do not allow.
        UnreachableError, SingularConfigurationError: `at` is not on the reference's branch.
    """
    model, n = instance(transmission, "transmission", Transmission).joint_model, transmission.n
    links = kept_links(transmission)
    cells = whole(max_cells, "max_cells")
    points = _COUNTS.get(n, 3) if count is None else whole(count, "count", 3)
    found = reached(transmission, region, points)
    home = None if at is None else transmission.at(vector(at, "at", n))
    bare = {
        joint.name: replace(joint, armature=0.0) if joint.name in transmission.motors else joint
        for joint in stated_of(model.mechanism).joints
        if joint.name in transmission.joints
    }
    added = equivalent(
        _with_parts(transmission, links, bare, Additions((), (), np.zeros(n))),
        found.grid,
        home,
        places_of(transmission, links),
        ground_of(transmission, links),
    )
    efforts, held = effort_limits(transmission, found, points, effort, cells)
    speeds = speed_limits(transmission, found, points, speed)
    felt = found.grid if home is None else (home,)
    damping = np.mean([np.diag(posture.state.damping) for posture in felt], axis=0)
    level = np.mean([np.abs(posture.state.rho).T @ model.mechanism.joints.friction for posture in felt], axis=0)
    joints = {}
    for k, name in enumerate(transmission.joints):
        joint = bare[name]
        joints[name] = replace(
            joint,
            kind="revolute" if joint.kind == "continuous" else joint.kind,
            lower=found.lower[k].item(), upper=found.upper[k].item(),
            effort=_least(joint.effort, efforts[k]), velocity=_least(joint.velocity, speeds[k]),
            armature=joint.armature + added.armatures[k].item(),
            damping=damping[k].item(), friction=level[k].item(),
        )  # fmt: skip
    errors = serial_errors(_with_parts(transmission, links, joints, added), found.grid, points)
    effort_box, speed_box = (np.array([getattr(j, what) for j in joints.values()]) for what in ("effort", "velocity"))
    description = described(transmission, links, joints, added)
    return SerialRobot(
        transmission, description, added, found.lower, found.upper, home, errors, effort_box, speed_box, held
    )


def _with_parts(
    transmission: Transmission, links: Set[str], joints: Mapping[str, Joint], added: Additions
) -> ReducedModel:
    """The serial robot alone, in the mechanism's coordinates."""
    return stated_otherwise(
        transmission.joint_model,
        lambda link: added.on(link) if link.name in links else replace(link, inertia=None),
        lambda joint: replace(joints[joint.name], kind=joint.kind) if joint.name in joints else massless(joint),
    )


def _bounded(description: MechanismDescription) -> tuple[MechanismDescription, tuple[str, ...]]:
    """With a number for each limit, and a sentence where one was none: URDF's parsers refuse a joint without."""

    def number(limit: float) -> float:
        return limit if np.isfinite(limit) else _NO_LIMIT

    own = tuple(
        j
        if j.name not in (description.independent or ())
        else replace(j, effort=number(j.effort), velocity=number(j.velocity))
        for j in description.joints
    )
    if all(
        a is b or (a.effort, a.velocity) == (b.effort, b.velocity) for a, b in zip(own, description.joints, strict=True)
    ):
        return description, ()
    told = f"URDF's parsers want limits of effort and velocity: {_NO_LIMIT:g} stands where none is stated of the motors"
    return replace(description, joints=own), (told,)


def _least(stated: float, found: Array) -> float:
    """The lesser limit; a joint without a motor often states 0, which is none."""
    return min(stated or np.inf, found.item())


def _row(values: Array) -> str:
    return " ".join(f"{value:.4g}" for value in np.atleast_1d(values).tolist())
