"""Whether what a file states is a mechanism: its loops close, its limits admit that, its masses are some body's.

Each finding has a weight. *wrong*: no mechanism is as the file states, and the finding's numbers show it. *doubtful*:
that is not shown, and a person has to look. *note*: worth knowing. The verdict is ``refuted`` with a finding that is
wrong, else ``undecided`` with one that is doubtful, else ``proven``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.changes.reference_pose import Pose, with_reference
from ccpin.description.checks import of_no_body
from ccpin.description.elements.graph import without_strays
from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import MechanismDescription
from ccpin.dynamics.drives import Drives, drives_of, of_standing
from ccpin.dynamics.free_system import FreeSystem
from ccpin.dynamics.plausibility import Finding, in_radians, of_axes, of_limits, of_units
from ccpin.errors import IndependentSetError, LoopNotClosedError
from ccpin.kinematics.tree import Tree, build_tree
from ccpin.mechanism.loading.loader import load
from ccpin.mechanism.loading.reference_search import stated_pose
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.poses.closure_gaps import ClosureGap, gaps

_ROUNDING = 1e-9  # of the largest entry, or rad or m: less is none
_OPEN, _TURNED = 1e-3, 1e-2  # of the mechanism's size, and rad: a stated pose more open than that is no rounded one
_MASSLESS = 1e-13  # of the largest principal value of D, scaled to a unit diagonal: a smaller one is none
_NAMED = 6


class Soundness(NamedTuple):
    """What was found of a description.

    Attributes:
        stated: The closures' gaps where the file (or the caller) says the mechanism stands, before anything is moved.
        assembled: The same after assembling, or at the least open pose found; empty where there is none to tell of.
        mechanism: What was assembled, if the loops close.
        drives: What the motors do; ``None`` where nothing closed.
        findings: All that was found, the gravest first.
    """

    stated: tuple[ClosureGap, ...]
    assembled: tuple[ClosureGap, ...]
    mechanism: Mechanism | None
    drives: Drives | None
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> str:
        """proven, undecided or refuted."""
        weights = {finding.weight for finding in self.findings}
        return "refuted" if "wrong" in weights else "undecided" if "doubtful" in weights else "proven"


def examine(
    description: MechanismDescription, *, reference: Pose | None = None, floating_base: bool = False, **wishes: Any
) -> Soundness:
    """Look through a description, assemble it, and say what was found; `wishes` are further arguments of `load`.

    Raises:
        CcpinError: It cannot be loaded for another reason than that its loops do not close.
    """
    posed = description if reference is None else with_reference(description, reference)
    posed = without_strays(posed, wishes.get("independent") or ())
    tree = build_tree(posed, floating_base)
    here = stated_pose(tree, posed)
    stated = gaps(tree, posed.closures, here)
    found = [*_of_bodies(posed), *of_units(posed), *of_limits(posed), *_of_stated_pose(tree, posed, stated)]
    if posed.actuated is None and wishes.get("actuated") is None:
        found.append(Finding("note", "no motor is stated: the independent joints are taken to have one each"))
    try:
        mechanism, unlike = _loaded(posed, floating_base=floating_base, **wishes)
    except LoopNotClosedError as error:
        found += of_axes(tree, posed, here)
        least = error.q_free
        assembled = gaps(tree, posed.closures, least) if np.shape(least) == (tree.model.nq,) else ()
        found.append(Finding("wrong" if error.never else "doubtful", str(error)))
        return Soundness(stated, assembled, None, None, _sorted(found))
    drives = drives_of(mechanism)
    found += [
        *unlike,
        *_of_motion(mechanism, drives),
        *(Finding("note", note) for note in mechanism.notes),
    ]
    found += of_axes(mechanism.tree, mechanism.description, mechanism.q_reference)
    assembled = gaps(mechanism.tree, mechanism.closures, mechanism.q_reference)
    return Soundness(stated, assembled, mechanism, drives, _sorted(found))


def _loaded(description: MechanismDescription, **wishes: Any) -> tuple[Mechanism, list[Finding]]:
    """The mechanism; where the file marks more or fewer joints independent than move, as if it marked none."""
    try:
        return load(description, **wishes), []
    except IndependentSetError as error:
        if wishes.get("independent") is not None or description.independent is None:
            raise
        unmarked = replace(description, independent=None)
        return load(unmarked, **wishes), [Finding("wrong", str(error))]


def _sorted(found: list[Finding]) -> tuple[Finding, ...]:
    """The gravest first; a sentence once."""
    order = ("wrong", "doubtful", "note")
    by_sentence = {one.sentence: one for one in sorted(found, key=lambda one: -order.index(one.weight))}
    return tuple(sorted(by_sentence.values(), key=lambda one: order.index(one.weight)))


def _of_bodies(description: MechanismDescription) -> Iterator[Finding]:
    for link in description.links:
        if link.inertia is not None and (sentence := of_no_body(f"link '{link.name}'", link.inertia)):
            yield Finding("wrong", sentence)
    moving = {joint.child for joint in description.joints if joint.kind != FIXED}
    light = [x.name for x in description.links if x.name in moving and not (x.inertia and x.inertia.mass > 0.0)]
    if light:
        yield Finding("note", f"without mass, though a joint moves them: {_some(light)}")


def _of_stated_pose(tree: Tree, description: MechanismDescription, stated: tuple[ClosureGap, ...]) -> Iterator[Finding]:
    if not description.reference:
        yield Finding("note", "no pose is stated, so the loops are closed from all joints at zero")
        return
    agape = [gap for gap in stated if _is_open(gap, description)]
    for gap in agape:
        yield Finding("doubtful", f"loop '{gap.name}' is open by {told_gap(gap)} at the pose that the file states")
    if agape:
        turned = gaps(tree, description.closures, stated_pose(tree, description, in_radians(description)))
        if not any(_is_open(gap, description) for gap in turned):
            yield Finding(
                "doubtful", "the stated pose is in degrees: read so, its angles close the loops; state radians"
            )
    for joint in description.joints:
        value = description.reference.get(joint.name, ())
        if len(value) == 1 and not joint.lower - _ROUNDING <= value[0] <= joint.upper + _ROUNDING:
            limits = f"{joint.lower:.4g} … {joint.upper:.4g}"
            yield Finding("doubtful", f"joint '{joint.name}' is stated at {value[0]:.4g}, outside its limits {limits}")


def _is_open(gap: ClosureGap, description: MechanismDescription) -> bool:
    return gap.length > _OPEN * description.size or gap.angle > _TURNED


def told_gap(gap: ClosureGap) -> str:
    """In mm, from a metre on in m, and in degrees; what is below a nanometre or a millionth of a degree is 0."""
    length = gap.length if gap.length > 1e-9 else 0.0
    angle = np.degrees(gap.angle) if np.degrees(gap.angle) > 1e-6 else 0.0
    return f"{length:.4g} m {angle:.4g}°" if length >= 1.0 else f"{1e3 * length:.4g} mm {angle:.4g}°"


def _of_motion(mechanism: Mechanism, drives: Drives) -> Iterator[Finding]:
    mobility, n, driven = mechanism.mobility, mechanism.n, drives.driven
    floating, motors = _of_the_base(mechanism), len(mechanism.actuated)
    if n == 0 and not mechanism.locked:
        rows = f"the loops take all {mobility.n_free} freedoms of its joints"
        yield Finding("wrong", f"nothing moves: {rows}, so it is a structure")
        return
    for drive in drives.each:
        if not drive.coordinates:
            yield Finding("doubtful", f"motor '{drive.motor}' moves nothing")
    if driven < n - floating:
        some = f"what nothing drives moves {_some(list(drives.loose))}"
        yield Finding("doubtful", f"the motors drive {driven} of {n} freedoms: {some}")
    elif driven < n:
        yield Finding("note", f"the motors drive {driven} of {n} freedoms, and the base floats")
    if motors > driven:
        yield Finding("note", f"{motors} motors for {driven} freedoms: some can work against each other")
    yield from of_standing(mechanism, drives, floating > 0)
    if mobility.rows > mobility.rank:
        extra = mobility.rows - mobility.rank
        yield Finding("note", f"redundant rows: {extra} of {mobility.rows}, so that it moves for exact lengths only")
    outside = _outside(mechanism)
    if outside:
        yield Finding(
            "doubtful", f"no pose within the limits was found: assembled it exceeds those of {_some(outside)}"
        )
    if _moves_no_mass(mechanism):
        yield Finding("doubtful", "some motion moves no mass: there are no equations of motion for it")


def _of_the_base(mechanism: Mechanism) -> int:
    """The freedoms of a base that floats: those of joints on the world which no loop has anything to do with."""
    rows = mechanism.constraints().value(mechanism.q_reference).jacobian
    on_world = (joint for joint in mechanism.tree.joints if joint.kind.nv == 6 and joint.parent == 0)
    return sum(joint.kind.nv for joint in on_world if not rows[:, joint.v].any())


def _outside(mechanism: Mechanism) -> list[str]:
    here, (lower, upper) = mechanism.q_reference, mechanism.position_limits
    outside = (here < lower - _ROUNDING) | (here > upper + _ROUNDING)
    return [joint.name for joint in mechanism.tree.joints if not joint.kind.unit and outside[joint.q].any()]


def _moves_no_mass(mechanism: Mechanism) -> bool:
    """Whether D = ρᵀD′ρ, its rows and columns scaled to a unit diagonal, is not positive definite at the reference."""
    rho: Array = mechanism.parametrization().at(mechanism.q_reference).rho
    moved = rho.T @ FreeSystem(mechanism.tree).mass_matrix(mechanism.q_reference) @ rho
    scale = np.sqrt(np.diag(moved))
    if not scale.size:
        return False
    if not (scale > 0.0).all():
        return True
    return bool(np.linalg.eigvalsh(moved / np.outer(scale, scale))[0] < _MASSLESS)


def _some(names: list[str]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
