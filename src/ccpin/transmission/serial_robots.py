"""`serial_robot`: the mechanism as a serial robot to train on: no linkage, its inertia and limits at the joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, vector, whole
from ccpin.description.formats import format_of, write_description
from ccpin.description.model import MechanismDescription
from ccpin.errors import InvalidInputError
from ccpin.files import write_text
from ccpin.programs.program import Program
from ccpin.transmission.equivalent_masses import Additions, equivalent
from ccpin.transmission.motor_limits import LimitsCertificate
from ccpin.transmission.posture import Posture
from ccpin.transmission.serial_misfits import SerialErrors, most, serial_errors
from ccpin.transmission.serial_models import added_alone, serial_alone
from ccpin.transmission.serial_parts import (
    bare_joints,
    described,
    ground_of,
    kept_links,
    places_of,
    with_additions,
    with_all_limits,
)
from ccpin.transmission.serial_proof import compare_over, errors_of, largest
from ccpin.transmission.serial_range import effort_limits, motor_speeds, reached, speed_limits
from ccpin.transmission.serial_words import in_words, is_proved
from ccpin.transmission.side_programs import side_program
from ccpin.transmission.transmission import Transmission
from ccpin.validated.programs.program_certificate import ProgramCertificate

WRITTEN_AS = ("urdf", "sdf", "mjcf")
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
        held: The certificate that motors hold `effort`; ``None``, or undecided: it is of samples, with a margin.
        compared: The certificate of `errors` and `speed`; ``None``, or undecided: they are of samples, with a margin.
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
    held: LimitsCertificate | None
    compared: ProgramCertificate | None

    def __repr__(self) -> str:
        return "\n".join(self.told())

    @cached_property
    def to_motors(self) -> Program:
        """q_j, q̇_j, τ_j ↦ q_m, q̇_m, τ_m: what a policy asks of its joints, sent to the motors.

        Beside them it takes y, the other numbers of a closed configuration near by, and gives y of the next call as
        `sigma`. τ_m = J⁻ᵀ τ_j: nothing more is due for rods and rotors, which the serial robot has at its joints.
        """
        return side_program(self.transmission, "motors")

    @cached_property
    def to_joints(self) -> Program:
        """q_m, q̇_m, τ_m ↦ q_j, q̇_j, τ_j: what encoders of the motors say, as a policy is to see it."""
        return side_program(self.transmission, "joints")

    def told(self) -> Iterator[str]:
        """What it is and by how much it is not the mechanism, in lines."""
        return in_words(self)

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
            "effort_proved": is_proved(self.held),
            "errors_and_speed_proved": is_proved(self.compared),
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
            described, notes = with_all_limits(described)
            moved = {joint.child for joint in described.joints}
            light = [link.name for link in described.links if link.name in moved and link.inertia is None]
            if light:
                notes += (f"{', '.join(light)}: no mass; MuJoCo refuses such links of a URDF: give it the MJCF",)
        if wanted != "mjcf" and self.added.armatures.any():
            told = ", ".join(
                f"{j.name} {j.armature:.4g}" for j in described.joints if j.name in self.transmission.joints
            )
            notes += (f"few read a rotor inertia from {wanted.upper()}: state armature to the simulator: {told}",)
        notes += write_description(described, path, wanted, meshes=meshes)
        text = Path(path).read_text(encoding="utf-8")
        first, _, rest = text.partition("\n")
        lines = "\n     ".join(line.replace("--", "- -") for line in self.told())
        write_text(path, f"{first}\n<!-- {lines} -->\n{rest}")
        return notes


def serial_robot(
    transmission: Transmission,
    region: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    at: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    count: int | None = None,
    max_cells: int = 0,
) -> SerialRobot:
    """The serial robot that a trainer wants: the linkage gone, its mass, inertia and limits at links and joints.

    Links that the joints alone carry stay, with all that they and their joints state. What the linkage adds to D and g
    is put on them as masses, second moments and armatures, none negative (`ccpin.transmission.equivalent_masses`);
    dampers and dry friction of the linkage as the joints' own, as felt there. Limits are those that the motors keep at
    all postures, efforts as statics. Limits, and by how much D, C q̇, g and damping are off, are of a grid of postures,
    with twice what second differences say of the places between: an estimate. With `max_cells` they are proved all over
    the region (Theorems B, Q and E) where so many cells are enough; what the robot tells says which it is.

    Args:
        transmission: The transmission; its joints carry one another, nothing else does.
        region: Lower and upper q_j, of shape (n,) each; default the limits of the joints, drawn towards the reference
            until all of it is reached and no other joint leaves its limits.
        at: Where D is to be the mechanism's, and g as nearly as may be; default a fit over the region.
        effort: Largest efforts of the motors behind their gears; default the mechanism's.
        speed: Largest speeds of the motors' joints; default the mechanism's.
        count: Postures along each joint, 3 or more.
        max_cells: Into how many cells the region is cut at most for proofs; 0: nothing is proved.

    Raises:
        CcpinError: What proves is not installed (the extra `validated`), and `max_cells` is not 0.
        InvalidInputError: A joint that is carried by others than the joints; a region that is none, is not reached or
            that other joints' limits do not allow.
        UnreachableError, SingularConfigurationError: `at` is not on the reference's branch.
    """
    n = instance(transmission, "transmission", Transmission).n
    links = kept_links(transmission)
    cells = whole(max_cells, "max_cells", 0)
    points = _COUNTS.get(n, 3) if count is None else whole(count, "count", 3)
    fastest = motor_speeds(transmission, speed)
    found = reached(transmission, region, points)
    home = None if at is None else transmission.at(vector(at, "at", n))
    efforts, held = effort_limits(transmission, found, points, effort, cells)
    bare = bare_joints(transmission)
    added = equivalent(
        serial_alone(transmission, links, bare, Additions((), (), np.zeros(n))),
        found.grid,
        home,
        places_of(transmission, links),
        ground_of(transmission, links),
    )
    joints = with_additions(transmission, bare, added, found, home)
    compared = None
    if cells:
        box = found.lower, found.upper
        compared = compare_over(added_alone(transmission, links, joints, added), transmission, box, cells)
    if is_proved(compared):
        assert compared is not None
        errors, rates = errors_of(compared), largest(compared)["rho"][transmission.motor_side.rows]
    else:
        errors = serial_errors(serial_alone(transmission, links, joints, added), found.grid, points)
        rates = most(np.array([posture.jacobian for posture in found.grid]), points, n)
    speeds = speed_limits(found, rates, fastest)
    limited = {
        name: replace(joint, effort=_least(joint.effort, most_effort), velocity=_least(joint.velocity, most_speed))
        for (name, joint), most_effort, most_speed in zip(joints.items(), efforts, speeds, strict=True)
    }
    ends = [np.array([getattr(joint, it) for joint in limited.values()]) for it in ("effort", "velocity")]
    description = described(transmission, links, limited, added)
    return SerialRobot(
        transmission, description, added, found.lower, found.upper, home, errors, ends[0], ends[1], held, compared
    )


def _least(stated: float, found: Array) -> float:
    """The lesser limit; a joint without a motor often states 0, which is none."""
    return min(stated or np.inf, found.item())
