"""The reference configuration: closed, generic and within limits, found one cluster of joints at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Gap, PlaneNormal, Vector, rows_of
from ccpin.description.model import MechanismDescription
from ccpin.errors import DescriptionError, LoopNotClosedError
from ccpin.kinematics.clusters import ClusterTree, cut
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import IndependentCoordinates, component_names
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.parametrization import Parametrization
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.motion.idle import Idle, idle_motions
from ccpin.mechanism.motion.independence import MotionSpace
from ccpin.mechanism.motion.mobility import Tangent, generic_rank, tangent
from ccpin.mechanism.poses.branches import Settlement, told
from ccpin.mechanism.poses.loop_closing import TOLERANCE, close
from ccpin.mechanism.poses.pose_search import ClosedPose, NamedPoses, find_closed
from ccpin.mechanism.repair.open_poses import open_by
from ccpin.mechanism.repair.redundancy import Repair, Rounded

FROM_SINGULAR = "a step away from a singular closed pose"
STATED = "the stated pose"
_POOR = 1e-3  # independence of the wanted joints, below which a step away is looked at
_MOVED = 1e-3  # m or rad: a stated joint that moved less is not told


def stated_pose(
    tree: Tree, description: MechanismDescription, pose: Mapping[str, tuple[float, ...]] | None = None
) -> Array:
    """A pose, by default the description's reference, as a configuration (joints it leaves out are neutral).

    Raises:
        DescriptionError: A value has the wrong number of entries for its joint.
    """
    model = tree.model
    q_free = pin.neutral(model)
    for name, values in (description.reference if pose is None else pose).items():
        if name not in tree.names:
            continue
        joint = tree.joint(name)
        value = joint.kind.stated(np.array(values, dtype=np.float64))
        if value.size != joint.kind.nq:
            message = f"the reference value has {value.size} numbers; a {joint.kind.name} joint needs {joint.kind.nq}"
            raise DescriptionError(message, source=description.source, element=f"joint '{name}'")
        q_free[joint.q] = value
    return np.asarray(pin.normalize(model, q_free))


class Settled(NamedTuple):
    """A cluster at its reference.

    Attributes:
        part: The cluster.
        constraints: Its φ.
        closed: Its reference configuration, and how it was found.
        tangent: The velocities φ_q′ allows there; its rank is the generic one.
        repair: How its geometry was changed within the tolerance, if it was.
    """

    part: ClusterTree
    constraints: Constraints
    closed: ClosedPose
    tangent: Tangent
    repair: Repair | None = None

    @property
    def motion(self) -> MotionSpace:
        """The velocities it allows, by name."""
        tree = self.part.tree
        joints = tuple(joint.name for joint in tree.joints for _ in joint.kind.steps)
        places = tuple(self.part.v.tolist())
        basis = self.tangent.basis(self.tangent.rank)
        plain = tuple(slides or joint.kind.unit < 4 for joint in tree.joints for slides in joint.kind.slides)
        return MotionSpace(tuple(component_names(tree)), joints, places, basis, plain)


def settle(tree: Tree, description: MechanismDescription, wanted: Sequence[str], tolerance: float) -> list[Settled]:
    """Bring every cluster to a closed, nonsingular configuration where the wanted joints measure its motion.

    Raises:
        LoopNotClosedError: A loop does not close; it carries the whole configuration.
    """
    stated, settled = stated_pose(tree, description), []
    poses = [(f"the pose '{name}'", stated_pose(tree, description, pose)) for name, pose in description.poses.items()]
    for part in cut(tree, description.closures, description.couplings):
        try:
            others = [(name, pose[part.q]) for name, pose in poses]
            settled.append(_settle(part, stated[part.q], others, wanted, tolerance))
        except LoopNotClosedError as error:
            if error.q_free is not None:
                whole = stated.copy()
                whole[part.q] = error.q_free
                error.q_free = whole
            raise
    return settled


def _settle(part: ClusterTree, stated: Array, poses: NamedPoses, wanted: Sequence[str], tolerance: float) -> Settled:
    constraints = Constraints(part.tree, part.closures, part.couplings)
    nearly = max(TOLERANCE, open_by(constraints, tolerance))
    closed = find_closed(constraints, stated, nearly, poses=poses)[0]
    _check_across(constraints, closed.q_free, max(1e-6, 10 * nearly))
    repair = Rounded(part, tolerance).repaired(closed.q_free) if part.closures and tolerance else None
    if repair is not None:
        part, constraints = repair.part, Constraints(repair.part.tree, repair.part.closures, part.couplings)
        closed = closed._replace(q_free=repair.q_free)
    exact = close(constraints, closed.q_free)
    closed = closed._replace(q_free=exact.q_free) if exact.closed else find_closed(constraints, stated, poses=poses)[0]
    found = Settled(part, constraints, closed, tangent(constraints, closed.q_free), repair)
    regular = found.tangent.rank == min(constraints.size, constraints.model.nv)
    if not regular or found.motion.independence(wanted) < _POOR:
        found = _generic(found, wanted)
    return found


def _generic(found: Settled, wanted: Sequence[str]) -> Settled:
    """The same where φ_q′ has its generic rank and the wanted joints measure the motion well, else a step away."""
    rank, candidates = generic_rank(found.constraints, found.tangent)
    options = [found._replace(tangent=candidate) for candidate in candidates]
    scores = [option.motion.independence(wanted) for option in options]
    if options[0].tangent is found.tangent and scores[0] >= _POOR:
        return found
    quality = [score * candidate.conditioning(rank) for score, candidate in zip(scores, candidates, strict=True)]
    best = options[int(np.argmax(quality))]
    return best._replace(closed=found.closed._replace(q_free=best.tangent.q_free, start=FROM_SINGULAR))


def _check_across(constraints: Constraints, q_free: Array, tolerance: float) -> None:
    """Check a cluster's planar loops against the rows that planarity made superfluous.

    Raises:
        LoopNotClosedError: One is open across its plane, where nothing can close it.
    """
    planar = [loop for loop in constraints.loops if loop.normal is not None]
    if not planar:
        return
    poses = joint_poses(constraints.scratch, q_free)
    unreduced = {loop.closure.name: _unreduced(loop, poses) for loop in planar}
    errors = {name: max(rows) for name, rows in unreduced.items()}
    worst = max(errors, key=lambda name: errors[name])
    if errors[worst] > tolerance:
        gap, turn = unreduced[worst]
        open_by = f"{gap:.4g} m apart across it" if gap > tolerance else f"{turn:.4g} rad askew to it"
        raise LoopNotClosedError(
            f"loop '{worst}' can never close: its links move parallel to a plane, and its ends are {open_by} "
            f"(geometry tolerance {tolerance:.1e})",
            q_free=q_free,
            errors=errors,
            never=True,
        )


def _unreduced(loop: ResolvedClosure, poses: Array) -> tuple[float, float]:
    """The largest gap (m) and misalignment (rad) of a closure at world poses of the joints.

    Of all its rows, also those that planarity makes constant.
    """
    frames = {
        "A": poses[loop.joint_a] @ loop.frame_a,
        "B": poses[loop.joint_b] @ loop.frame_b,
        "C": poses[loop.ancestor],
    }

    def vector(v: Vector) -> Array:
        if isinstance(v, Gap):
            return np.asarray(frames["B"][:3, 3] - frames["A"][:3, 3])
        return np.asarray(frames[v.frame][:3, :3] @ v.local)

    def combine(terms: Iterable[tuple[float, float]]) -> float:
        return sum(weight * product for weight, product in terms)

    rows = rows_of(loop.closure, PlaneNormal())
    sizes = np.abs(rows.evaluate(vector, lambda x, y: float(x @ y), combine))
    turns = np.array(rows.direction_rows, dtype=bool)
    return float(sizes[~turns].max(initial=0.0)), float(sizes[turns].max(initial=0.0))


def idle(tree: Tree, settled: Sequence[Settled]) -> list[tuple[Settled, list[Idle]]]:
    """The mobilities of every cluster that move nothing but a body of a loop (`ccpin.mechanism.motion.idle`)."""
    masses = np.array([inertia.mass for inertia in tree.model.inertias][1:])
    heavy = set((1 + np.flatnonzero(masses > 1e-6 * masses.max(initial=0.0))).tolist())
    carriers = {found.part.cluster.parent for found in settled}
    poses = {0: np.eye(4)}
    motions = []
    for found in settled:
        joints = found.part.cluster.joints
        pose = poses[found.part.cluster.parent]
        own = joint_poses(found.constraints.scratch, found.closed.q_free)[1:]
        poses |= zip(joints, pose @ own, strict=True)
        here = [{k for k, joint in enumerate(joints, start=1) if joint in chosen} for chosen in (heavy, carriers)]
        motions.append((found, idle_motions(found.constraints, found.part.tree, found.tangent, pose, *here)))
    return motions


def check_independent(settled: Sequence[Settled], names: Sequence[str]) -> None:
    """Check cluster by cluster that the coordinates chosen fix the motion at the reference.

    Raises:
        SingularConfigurationError: They do not.
    """
    for found in settled:
        tree, q_free = found.part.tree, found.closed.q_free
        own = tuple(name for name in names if tree.split(name)[0] in tree.names)
        Parametrization(found.constraints, IndependentCoordinates(tree, own, q_free), q_free).at(q_free)


def how_moved(tree: Tree, description: MechanismDescription, q_reference: Array) -> list[str]:
    """A sentence saying by how much stated joints had to move to close the loops, the one moved most first."""
    stated, moved = stated_pose(tree, description), list[tuple[float, str]]()
    for name in description.reference:
        if name not in tree.names:
            continue
        joint = tree.joint(name)
        far = np.abs(joint.kind.difference(stated[joint.q], q_reference[joint.q]))
        most = int(far.argmax())
        if far[most] > _MOVED:
            told = f"{far[most]:.3g} m" if joint.kind.slides[most] else f"{np.degrees(far[most]):.3g}°"
            moved.append((float(far[most]), f"{name} by {told}"))
    if not moved:
        return []
    first = ", ".join(text for _, text in sorted(moved, reverse=True)[:3])
    more = f" and {len(moved) - 3} more" if len(moved) > 3 else ""
    return [f"the stated pose was moved to close the loops: {first}{more}"]


def other_branches(
    settled: Sequence[Settled], tree: Tree, description: MechanismDescription, independent: Sequence[str]
) -> list[str]:
    """A sentence naming other branches that lie next to an open stated pose (`ccpin.mechanism.poses.branches`)."""
    stated = stated_pose(tree, description)
    clusters = [Settlement(s.part.tree, s.constraints, stated[s.part.q], s.closed.q_free) for s in settled]
    return told(clusters, independent)


def how_closed(settled: Sequence[Settled]) -> list[str]:
    """Sentences saying how the reference was found, where it is not the stated pose within all limits."""
    notes = [found.repair.note for found in settled if found.repair is not None]
    if not all(found.closed.within_limits for found in settled):
        notes.append("the reference configuration lies outside some joint limits: none inside was found")
    starts: dict[str, list[str]] = {}
    for found in settled:
        if found.part.ties:
            starts.setdefault(found.closed.start, []).extend(found.part.ties)
    for start in (start for start in starts if start != STATED):
        which = "the loops" if len(starts) == 1 else ", ".join(starts[start])
        notes.append(f"{which} were closed from {start}")
        if start == FROM_SINGULAR:
            notes.append(
                "branches of σ meet at that pose, so which of them the reference lies on is arbitrary; a stated pose "
                '(<group_state name="reference">) chooses'
            )
    return notes
