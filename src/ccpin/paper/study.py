"""The case study: the robot, its two moves and gains, the samples at which equations are compared, its motions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.control import CoulombCompensation, PDSimpleGravity, Sampling
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.mechanism.loading.loader import load
from ccpin.paper import printed
from ccpin.paper.certified_squares import Radii, radii_about
from ccpin.paper.move_certificate import Theorem3Facts, theorem3_facts
from ccpin.simulation import Settling, supervise
from ccpin.simulation.integration.single_run import simulate
from ccpin.simulation.results.trajectory import Trajectory
from ccpin.simulation.studies.supervision import SupervisedMotion

NAMES = ("joint1", "joint2", "joint3", "joint4")
"""The paper's order of q′, by the joints' names in the file."""
START = frozen(np.radians([-150.0, -160.0]))  # where the first move begins and the second ends
GOAL = frozen(np.radians([-90.0, -100.0]))
"""Both moves' ends: also the lower and the upper corner of the region 𝒟."""
K_P = (11.0, 11.0)  # N m/rad, of both moves
K_V = (0.65, 0.60)  # N m s/rad, of both moves
CENTRES = frozen(np.radians([[-108.0, -72.0], [-108.0, -48.0], [-108.0, -120.0], [-70.0, -110.0]]))
"""Of Table I, the sign of q2 read negative."""
RADII = (3.5, 0.13, 1.7, 0.31)
"""Table I's radii, degrees."""
BAND = 0.05 * float(np.radians(60.0))
"""5 % of the moves' 60°: the customary band of settling; the paper names none."""
FRICTION = {"joint1": (0.2, 0.02), "joint2": (0.2, 0.02), "joint3": (0.02, 0.002), "joint4": (0.02, 0.002)}
"""Coulomb and viscous friction of the bench: plausible for such a robot, as the paper gives none (N m, N m s)."""
ESTIMATE = 0.16
"""Coulomb friction of a motor's joint as the controller knows it (N m)."""
WIDTH = 0.02
"""Where compensation by the error fades out (rad)."""
# The bench's controller, of a kilohertz.
SAMPLING = Sampling(1e-3, encoder_counts=4096, velocity_cutoff=100.0, saturation=12.0, delay=1)
BENCH: dict[str, Any] = {"friction": FRICTION, "sampling": SAMPLING}
DURATION = 1.0  # s, of a move
WAIT = 2.5  # s, at each goal once settled
CYCLES = 2  # there and back
ARRIVED = {"band": BAND, "speed": 0.05}
"""When the supervisor takes a move for done; friction leaves an error that no wait removes."""
_COUNT = 24  # samples, of both assembly modes in turn
_AWAY = 0.2  # sine of the angle between links 3 and 4, at least: 0 is stretched or folded


class Sample(NamedTuple):
    """A closed state: q, q̇, q̈ and u of shape (2,), q′ in the paper's order by (39)–(40), and ccpin's state over q."""

    q: Array
    v: Array
    a: Array
    u: Array
    q_paper: Array
    state: State


class Study:
    """Everything the page's items are computed of, made when first asked for and then kept.

    Attributes:
        start, goal: Where the moves begin and end, of shape (2,), rad.
        bench_options: Friction and sampling of the bench, as `ccpin.simulate` takes them.
        mechanism, model: The RPDR.
        law: (28) to the goal with the paper's gains.
        towards_goal: It with the Coulomb friction that is estimated, compensated along the way to the goal.
        by_error: It with that friction compensated by the error.
    """

    start, goal, bench_options = START, GOAL, BENCH

    def __init__(self) -> None:
        self.mechanism = load("rpdr")
        self.model = ReducedModel(self.mechanism)
        self.law = PDSimpleGravity(self.model, GOAL, K_P, K_V)
        self.towards_goal = CoulombCompensation(self.law, ESTIMATE, START)
        self.by_error = _compensated(self.law)
        names = [joint.name for joint in self.mechanism.tree.joints]
        self._order = [names.index(name) for name in NAMES]

    def to_paper(self, ours: Array) -> Array:
        """An array's last axis from the mechanism's order of q′ (joint1, joint3, joint2, joint4) to the paper's."""
        return np.asarray(ours)[..., self._order]

    def to_free(self, papers: Array) -> Array:
        """A vector of the free system from the paper's order to the mechanism's."""
        free = np.empty(4)
        free[self._order] = papers
        return free

    def square(self, matrix: Array) -> Array:
        """A matrix of the free system in the paper's order, rows and columns."""
        return np.asarray(matrix)[np.ix_(self._order, self._order)]

    @cached_property
    def samples(self) -> tuple[Sample, ...]:
        """States of both assembly modes, drawn with a fixed seed, links 3 and 4 at least 0.2 from stretched."""
        random = np.random.default_rng(2000)
        found: list[Sample] = []
        while len(found) < _COUNT:
            q, mode = random.uniform(-np.pi, np.pi, 2), 1 if len(found) % 2 else -1
            if not 0.05 < printed.elbow_distance(q) < printed.A[2] + printed.A[3] - 0.02:
                continue
            q_paper = printed.sigma(q, mode)
            if abs(np.sin(printed.fold(q_paper))) < _AWAY:
                continue
            v, a, u = random.uniform(-1.0, 1.0, (3, 2)) * [[3.0], [20.0], [5.0]]
            beside = self.to_free(printed.sigma(q + 0.02, mode))  # so that σ(q) is found, not handed over
            found.append(Sample(q, v, a, u, q_paper, self.model.at(q, beside)))
        return tuple(found)

    def largest(self, difference: Callable[[Sample], float]) -> float:
        """The largest of a difference over the samples."""
        return max(difference(sample) for sample in self.samples)

    @cached_property
    def ideal(self) -> Trajectory:
        """Experiment 1 without friction, the law computed continuously."""
        return _whole(simulate(self.model, self.law, START, duration=DURATION))

    @cached_property
    def bench(self) -> Trajectory:
        """Experiment 1 with friction, encoders, filter and a sampled law; the feedforward as the paper had it.

        That is g(q_d) and the Coulomb friction estimated at q_d.
        """
        return _whole(simulate(self.model, self.towards_goal, START, duration=DURATION, **BENCH))

    @cached_property
    def cycles_ideal(self) -> SupervisedMotion:
        """Experiment 2 without friction."""
        return self._cycles(lambda law: law, {})

    @cached_property
    def cycles_bench(self) -> SupervisedMotion:
        """Experiment 2 on the bench, friction compensated by the error."""
        return self._cycles(_compensated, BENCH)

    def _cycles(self, made: Callable[[PDSimpleGravity], Any], options: dict[str, Any]) -> SupervisedMotion:
        motion = supervise(
            self.model,
            lambda goal, q_free: made(PDSimpleGravity(self.model, goal, K_P, K_V, q_free)),
            START,
            [GOAL, START] * CYCLES,
            wait=WAIT,
            settling=Settling(GOAL, **ARRIVED),
            **options,
        )
        _whole(motion.trajectory)
        return motion

    @cached_property
    def radii(self) -> tuple[Radii, ...]:
        """The radii about Table I's centres by every certificate there is, and the exact ones."""
        return tuple(radii_about(self.model, centre, paper) for centre, paper in zip(CENTRES, RADII, strict=True))

    @cached_property
    def theorem3(self) -> Theorem3Facts:
        """Theorem 3 about Experiment 1's goal, and its start."""
        return theorem3_facts(self.law, START)


def _compensated(law: PDSimpleGravity) -> CoulombCompensation:
    return CoulombCompensation(law, ESTIMATE, width=WIDTH)


def _whole(motion: Trajectory) -> Trajectory:
    """The motion, unless somebody pressed Ctrl-C, which a simulation ends at with what it has."""
    if motion.status == "interrupted":
        raise KeyboardInterrupt
    return motion


def settled(motion: Trajectory, goal: Array, band: float = BAND) -> float:
    """How long after its first sample the motion came within the band about the goal to stay, s; infinite if never."""
    outside = np.flatnonzero(np.abs(motion.q - goal).max(axis=1) > band)
    if not len(outside):
        return 0.0
    last = int(outside[-1])
    return float(motion.t[last + 1] - motion.t[0]) if last + 1 < len(motion.t) else float("inf")
