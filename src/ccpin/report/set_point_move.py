"""One set-point motion of the mechanism: its figures, its numbers, and the animation of it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control import ControlLaw, PDSimpleGravity, local_gains
from ccpin.control.control_law import NoTorque
from ccpin.dynamics.drives import HELD
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.mechanism import Mechanism
from ccpin.pages.parts import embedded, figure, paragraphs, table
from ccpin.plotting import plot_lyapunov, plot_motion
from ccpin.report.settings import ReportSettings, scalar, value
from ccpin.simulation import lyapunov_along, set_point_metrics
from ccpin.simulation.integration.notes import AT_LIMITS
from ccpin.simulation.integration.single_run import simulate
from ccpin.simulation.results.metrics import band_in_words
from ccpin.simulation.results.trajectory import Trajectory
from ccpin.visualization import animate, snapshot

_STEP = 0.35  # rad, of a coordinate that turns
_PART = 0.06  # of the mechanism's extent, of one that slides
_TRIES = (1.0, 0.5, 0.25, 0.1)  # of these steps, until a goal is found
_KEPT = 0.3  # of rcond at the start: what it may fall to on the way
_WAY = 9  # configurations on the way that are looked at, both ends with them
_SAMPLES = 0.005  # s between samples
_DRIVEN = 1.0  # s, of a motion under a law
_RELEASED = 0.4  # s, of a fall


class Experiment(NamedTuple):
    """A motion and what led to it.

    Attributes:
        motion: The trajectory.
        law: What drove it; `NoTorque` where no set-point law is possible.
        goal: q_d; ``None`` without a law.
        words: What was done, and why not more.
    """

    motion: Trajectory
    law: ControlLaw
    goal: Array | None
    words: str


def run(model: ReducedModel, settings: ReportSettings) -> Experiment:
    """Drive the mechanism to a goal beside its reference, or let it fall where no law is possible.

    Raises:
        CcpinError: The start or goal asked for is malformed or cannot be reached, or the motion cannot begin.
    """
    start = model.alpha(model.mechanism.q_reference) if settings.start is None else settings.start
    start = np.array(checked_q(model.coordinates, start))
    wanted = None if settings.goal is None else np.array(checked_q(model.coordinates, settings.goal))
    goal = beside(model, start) if wanted is None else wanted
    try:
        if goal is None:
            raise CcpinError("no goal beside the start was found along which the mechanism stays well conditioned")
        gains = local_gains(model, goal, frequency=settings.frequency, near=model.sigma(start))
        law: ControlLaw = PDSimpleGravity(model, goal, *gains, model.sigma(start))
    except CcpinError as error:
        if wanted is not None:
            raise
        law, goal = NoTorque(model), None
        words = f"Released at rest, without efforts: a set-point law is not possible here ({error})."
    else:
        words = (
            f"From rest to a goal under PD with simple gravity compensation (28), gains for {settings.frequency:g} "
            "rad/s at the goal."
        )
    usual = _RELEASED if goal is None else _DRIVEN
    options: dict[str, Any] = {"rtol": 1e-7, "atol": 1e-9, "sample_period": _SAMPLES}
    options["duration"] = usual if settings.duration is None else settings.duration
    return Experiment(simulate(model, law, start, **options), law, goal, words)


def beside(model: ReducedModel, start: Array) -> Array | None:
    """A goal near a start, the way to it well conditioned and within the limits; ``None`` if none is found."""
    mechanism = model.mechanism
    if not model.n:
        return None
    size = _PART * mechanism.constraints().extent
    step = np.array([size if way.startswith("t") else _STEP for way in _ways(mechanism)])
    alternating = np.where(np.arange(model.n) % 2, -1.0, 1.0)
    near = model.at(start)
    low, high = mechanism.position_limits
    for scale in _TRIES:
        for signs in (np.ones(model.n), -np.ones(model.n), alternating, -alternating):
            reached = near
            try:
                for part in np.linspace(0.0, 1.0, _WAY)[1:]:
                    reached = model.at(model.coordinates.integrate(start, part * scale * signs * step), reached)
                    if reached.rcond < _KEPT * near.rcond or np.any((reached.q_free < low) | (reached.q_free > high)):
                        raise CcpinError("not here")
            except CcpinError:
                continue
            return reached.q
    return None


def _ways(mechanism: Mechanism) -> list[str]:
    """What each independent velocity does: slide (``t…``) or turn (``r…``)."""
    parts = [mechanism.tree.split(name) for name in mechanism.independent]
    return [way for joint, part in parts for way in ((part,) if part else mechanism.tree.joint(joint).kind.steps)]


def experiment(model: ReducedModel, found: Experiment) -> str:
    """The section as HTML."""
    mechanism, motion = model.mechanism, found.motion
    closed = f"‖φ‖ ≤ {motion.closure_error.max():.0e} at all {len(motion.t)} samples"
    ended = "ran to its end" if motion.status == "finished" else f"ended early: {motion.message}"
    held_back = [f"Mind: {note}." for note in motion.notes if HELD in note or note.startswith(AT_LIMITS)]
    parts = [paragraphs(*held_back, f"{found.words} The motion {ended}; {closed}.")]
    if found.goal is not None:
        metrics = set_point_metrics(motion, model, found.goal)
        band = band_in_words(mechanism, metrics.band)
        settled = f"Not within ±{band} at the end"
        if metrics.settling_time is not None:
            settled = f"Within ±{band} from {metrics.settling_time:.3f} s on"
        if scalar(mechanism):
            parts.append(
                table(
                    ("coordinate", "from", "to", "overshoot"),
                    _moved(mechanism, motion.q[0], found.goal, metrics.overshoot),
                )
            )
        peaks = ", ".join(
            f"`{name}` {peak:.3g}" for name, peak in zip(mechanism.actuated, metrics.peak_torque, strict=True)
        )
        parts.append(paragraphs(f"{settled}. Largest efforts (N m or N): {peaks}."))
    parts.append(figure(plot_motion(motion, mechanism, found.goal), "Positions, velocities and efforts against time."))
    if isinstance(found.law, PDSimpleGravity):
        history = lyapunov_along(found.law, motion)
        parts.append(figure(plot_lyapunov(motion.t, history), "The Lyapunov function and its rate along the motion."))
    return "".join(parts)


def _moved(mechanism: Mechanism, start: Array, goal: Array, overshoot: Array) -> list[tuple[str, ...]]:
    """Each coordinate's way: name, start, goal and overshoot."""
    ends = zip(mechanism.independent, start, goal, overshoot, strict=True)
    return [(f"`{name}`", *(value(mechanism, name, float(x)) for x in numbers)) for name, *numbers in ends]


def animation(mechanism: Mechanism, motion: Trajectory | None) -> str:
    """The scene as HTML: the motion playing, or the reference standing where there is none."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "scene.html"
        if motion is None or len(motion.t) < 2:
            snapshot(mechanism, None, page)
        else:
            animate(mechanism, motion.t, motion.q_free, page)
        words = (
            "Drag to turn, scroll to come nearer; ? shows the keys. MeshCat draws it; nothing is loaded from elsewhere."
        )
        return paragraphs(words) + embedded(page.read_text(encoding="utf-8"), f"{mechanism.title}, animated", 560)
