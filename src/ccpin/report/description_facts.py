"""What the mechanism is: sizes, mobility in words, loops, joints, and a picture of it closed and cut open."""

from __future__ import annotations

from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.kinematics.points import joint_poses, moved
from ccpin.mechanism.loading.reference_search import stated_pose
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.poses.closure_gaps import gaps
from ccpin.mechanism.wireframe import plane_of_motion
from ccpin.pages.parts import bullets, figure, paragraphs, table
from ccpin.plotting import COLOURS
from ccpin.plotting.motion import plot_configuration_panels
from ccpin.plotting.style import Figure
from ccpin.report.settings import value

_OPEN = 0.1  # of the mechanism's extent: how far the ends of its loops are drawn apart
_CLOSED = 1e-6  # m: ends nearer than that look closed
_TURN = 1.2  # rad or m: no joint moves farther for that


def identity(model: ReducedModel) -> str:
    """The section as HTML."""
    mechanism = model.mechanism
    parts = [paragraphs(*_words(mechanism))]
    if mechanism.closures:
        parts.append(
            figure(cut_open(mechanism), "Closed, and cut open: the free system, its loops' ends apart (dashed).")
        )
    rows = [
        (
            f"`{loop.closure.name}`",
            loop.closure.kind,
            f"`{loop.closure.link_a}` – `{loop.closure.link_b}`",
            str(loop.size),
            "" if loop.normal is None else "planar loop",
        )
        for loop in mechanism.constraints().loops
    ]
    rows += [(f"`{coupling.name}`", "coupling", "–", "1", "") for coupling in mechanism.couplings]
    parts.append(table(("loop", "kind", "between", "rows of φ", ""), rows))
    parts.append(table(("joint", "kind", "reference", ""), _joints(mechanism)))
    if mechanism.notes:
        parts.append(paragraphs("What readers and analysis had to assume:") + bullets(mechanism.notes))
    return "".join(parts)


def _words(mechanism: Mechanism) -> list[str]:
    mobility = mechanism.mobility
    mass = sum(mechanism.pin_model.inertias[j].mass for j in range(1, mechanism.pin_model.njoints))
    loops, motors = len(mechanism.closures), len(mechanism.actuated)
    factor = mechanism.parametrization().at(mechanism.q_reference).factor
    error = float(np.linalg.norm(mechanism.constraints().residual(mechanism.q_reference)))
    closed = f"{error:.0e}" if error else "0"
    ways = "one independent motion" if mechanism.n == 1 else f"{mechanism.n} independent motions"
    surplus = motors - mechanism.n
    drive = "as many motors as that" if surplus == 0 else f"{motors} motor{'' if motors == 1 else 's'}"
    words = [
        f"`{mechanism.name}` (`{mechanism.description.source or 'built in Python'}`) is a tree of "
        f"{len(mechanism.tree.joints)} moving joints, {mass:.4g} kg, closed by {loops} loop{'' if loops == 1 else 's'}"
        + (f" and {len(mechanism.couplings)} couplings" if mechanism.couplings else "")
        + ".",
        f"Cut open it has n′ = {mobility.n_free} velocities; the closures take {mobility.rank} of them (rank of "
        f"{mobility.rows} rows), which leaves {ways}: {_names(mechanism.independent)}. It has {drive}"
        + (f": {_names(mechanism.actuated)}." if motors else "."),
        f"At the reference it closes to {closed} and 1/κ(ψ_q′) = {factor.rcond:.3g} (0 would be singular).",
    ]
    if mechanism.locked:
        words.append(f"Held still: {_names(mechanism.locked)}.")
    return [*words, *(sentence[0].upper() + sentence[1:] for sentence in mobility.idle)]


def _names(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _joints(mechanism: Mechanism) -> list[tuple[str, str, str, str]]:
    """Every joint by its place in q′."""
    named = {"independent": mechanism.independent, "actuated": mechanism.actuated}
    sets = {word: {mechanism.tree.split(name)[0] for name in names} for word, names in named.items()}
    rows = []
    for joint in mechanism.tree.joints:
        reference = mechanism.q_reference[joint.q]
        if joint.kind.nv == 1 and joint.kind.nq == 1:
            shown = value(mechanism, joint.name, float(reference[0]))
        else:
            shown = "(" + ", ".join(f"{x:.4g}" for x in reference) + ")"
        roles = [word for word, joints in sets.items() if joint.name in joints]
        rows.append((f"`{joint.name}`", joint.kind.name, shown, ", ".join(roles)))
    return rows


def cut_open(mechanism: Mechanism) -> Figure:
    """The mechanism at its reference, and moved so that its loops open, their ends joined by dashed lines."""
    return _beside(mechanism, "cut open", _opened(mechanism))


def as_stated(mechanism: Mechanism) -> Figure | None:
    """The mechanism at its reference, and where its file states it, the ends of its loops joined by dashed lines.

    ``None`` where the loops are closed there already.
    """
    stated = stated_pose(mechanism.tree, mechanism.description)
    if max((gap.length for gap in gaps(mechanism.tree, mechanism.closures, stated)), default=0.0) < _CLOSED:
        return None
    return _beside(mechanism, "as stated", stated)


def _beside(mechanism: Mechanism, word: str, opened: Array) -> Figure:
    """The mechanism at its reference beside it at an open configuration."""
    drawn = plot_configuration_panels(
        mechanism,
        [("closed", [mechanism.q_reference]), (word, [opened])],
        [mechanism.title],
        f"{mechanism.title}: closed and {word}",
    )
    plane, axes = plane_of_motion(mechanism), drawn.axes[1]
    for loop in mechanism.constraints().loops:
        ends = _ends(mechanism, loop, opened)
        axes.plot(*(ends if plane is None else ends @ plane.T).T, "--D", color=COLOURS[3], linewidth=1.2, markersize=5)
    return drawn


def _ends(mechanism: Mechanism, loop: Any, q_free: Array) -> Array:
    """Both ends of a loop in the world, of shape (2, 3)."""
    poses = joint_poses(mechanism.tree.scratch, q_free)
    pairs = ((loop.joint_a, loop.frame_a), (loop.joint_b, loop.frame_b))
    return np.array([(poses[joint] @ frame[:, 3])[:3] for joint, frame in pairs])


def _opened(mechanism: Mechanism) -> Array:
    """A configuration near the reference at which the loops' ends are visibly apart."""
    constraints = mechanism.constraints()
    jacobian = constraints.value(mechanism.q_reference).jacobian
    gap = np.zeros(len(jacobian))
    for k, rows in enumerate(constraints.row_slices().values()):
        gap[rows.start + k % (rows.stop - rows.start)] = _OPEN * constraints.extent
    step = np.linalg.pinv(jacobian, rcond=1e-6) @ gap
    largest = float(np.abs(step).max(initial=0.0))
    return moved(mechanism.pin_model, mechanism.q_reference, step * min(1.0, _TURN / largest) if largest else step)
