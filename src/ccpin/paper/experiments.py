"""Section IV-B: the point-to-point move (Figs. 8 and 9) and the repetitive one (Fig. 10), ideal and on the bench."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics import linearize
from ccpin.paper.item import Drawing, Item, place
from ccpin.paper.motions import cycles_figure, panels_figure, path_figure
from ccpin.paper.study import BAND, CYCLES, ESTIMATE, FRICTION, GOAL, K_P, K_V, START, Study, settled

STATED = 0.3
"""What both experiments are said to take, s: approximately, and a move in under it."""
_BANDS = ("bench", "bench_narrow", "ideal", "ideal_narrow")  # of `MoveTimes`, as they are listed


class MoveTimes(NamedTuple):
    """How long one move of Experiment 2 takes, s.

    Attributes:
        goal: Where to, radians.
        begin: When it begins.
        ideal, bench: Into ±5 % of the move to stay, without friction and on the bench.
        ideal_narrow, bench_narrow: Into ±2° to stay.
    """

    goal: Array
    begin: float
    ideal: float
    bench: float
    ideal_narrow: float
    bench_narrow: float


def items(study: Study) -> Iterator[Item]:
    """Both experiments."""
    yield figure8(study)
    yield figure9(study)
    yield figure10(study)


def figure8(study: Study) -> Item:
    """Fig. 8: start, goal and the end effector's path."""
    motion = study.ideal
    ends = np.degrees([motion.q[0], motion.q[-1]])
    return Item(
        "Fig. 8",
        "Experiment 1: start and goal",
        "From q = (−150°, −160°) at rest to q_d = (−90°, −100°).",
        "`model.sigma` at both ends; the path of the end effector and the configurations in between are those of the "
        "simulated motion.",
        "the last simulated q and the printed goal, under (28)",
        float(np.abs(ends - np.degrees([START, GOAL])).max()),
        "°",
        5e-3,
        "the motion is still coming to rest: after 1 s its slowest pole, −11.2/s, has left e^{−11.2} of 60°, 0.0008°",
        drawings=(Drawing("fig8", "Start, goal and the end effector's path; faint: every 40 ms.", path_figure(study)),),
    )


def figure9(study: Study) -> Item:
    """Fig. 9: q, q̇ and u of the point-to-point move, ideal and on the bench."""
    ideal, bench = settled(study.ideal, GOAL), settled(study.bench, GOAL)
    figure = panels_figure(study.ideal, study.bench, GOAL)
    left = np.degrees(np.abs(study.bench.q[-1] - GOAL).max())
    peaks = " and ".join(f"{np.abs(motion.u).max():.1f} N m" for motion in (study.ideal, study.bench))
    return Item(
        "Fig. 9",
        "Experiment 1: q, q̇ and u against time",
        "Under (28) with K_p = diag(11, 11) and K_v = diag(0.65, 0.60) the goal is reached within approximately 0.3 "
        "s. The feedforward was g(q_d) and the Coulomb friction estimated at q_d.",
        f"`ccpin.simulate`: the ideal robot (dashed), and the bench (solid) with friction {_friction()}, 4096 counts a "
        f"turn, a 100 Hz filter, 1 kHz and one sample of delay, {ESTIMATE} N m of friction compensated. The paper "
        "gives no figures for friction and electronics; these are plausible ones.",
        "the time into ±5 % of the move (±3°), bench and ideal, and the stated 0.3 s",
        max(abs(ideal - STATED), abs(bench - STATED)),
        "s",
        0.05,
        "half a unit of the one digit stated, and it says approximately",
        facts=(
            ("ideal, into ±5 %", f"{ideal:.3f} s"),
            ("bench, into ±5 %", f"{bench:.3f} s"),
            ("bench, into ±2°", f"{settled(study.bench, GOAL, np.radians(2.0)):.3f} s"),
            ("left by friction on the bench", f"{left:.2f}°"),
            ("largest u, ideal and bench", peaks),
        ),
        drawings=(Drawing("fig9", "(a), (b) q; (c), (d) q̇; (e), (f) u. Dashed: ideal; solid: bench.", figure),),
    )


def _friction() -> str:
    coulomb, viscous = FRICTION["joint1"]
    return f"of {coulomb} N m and {viscous} N m s on the motors' joints and a tenth of it on the others"


def move_times(study: Study) -> tuple[MoveTimes, ...]:
    """Every move of Experiment 2, ideal and on the bench."""
    found = []
    for ideal, bench in zip(study.cycles_ideal.moves, study.cycles_bench.moves, strict=True):
        times = [settled(one.trajectory, one.goal, band) for band in (BAND, np.radians(2.0)) for one in (ideal, bench)]
        found.append(MoveTimes(ideal.goal, bench.start, *times))
    return tuple(found)


def poles(study: Study, goal: Array) -> Array:
    """Eigenvalues of the closed loop under (28) linearised about a set point, 1/s, the slowest first."""
    model = study.model
    loop = linearize(model, goal, model.gravity(goal)).closed_loop(-np.diag(K_P), -np.diag(K_V))
    values = np.linalg.eigvals(loop)
    return np.asarray(values[np.argsort(-values.real)])


def figure10(study: Study) -> Item:
    """Fig. 10: back and forth with a wait at each end."""
    times = move_times(study)
    slowest = max(one.bench for one in times)
    goals = {"q_f": GOAL, "q_i": START}
    slow = {name: poles(study, goal)[0] for name, goal in goals.items()}
    narrow = max(one.ideal_narrow for one in times)
    head = ("move", "to", "begins", "bench ±5 %", "bench ±2°", "ideal ±5 %", "ideal ±2°")
    rows = [
        (str(k), place(np.degrees(one.goal)), f"{one.begin:.2f} s", *(f"{getattr(one, name):.3f} s" for name in _BANDS))
        for k, one in enumerate(times, start=1)
    ]
    return Item(
        "Fig. 10",
        "Experiment 2: repetitive motion",
        "q_d alternates between q_f and q_i, with 2.5 s of waiting after steady state; each move is completed in under "
        "0.3 s.",
        "`ccpin.simulation.supervise` on the bench of Fig. 9, friction compensated by the error. "
        + why_slower(slow, narrow, slowest),
        "by how much the slowest move on the bench into ±5 % (±3°) exceeds 0.3 s",
        max(0.0, slowest - STATED),
        "s",
        0.0,
        "the paper's own statement, in the customary band of 5 %, as it names none",
        facts=tuple((f"slowest pole at {name}", f"{_complex(pole)} 1/s") for name, pole in slow.items()),
        drawings=_cycles(study),
        rows=(head, *rows),
    )


def why_slower(slow: dict[str, complex], narrow: float, slowest: float) -> str:
    """Why the ideal robot takes longer than the stated time in a narrow band, in words."""
    ratio = {name: -pole.real / abs(pole) for name, pole in slow.items()}
    return (
        f"Without friction the way back takes {narrow:.3f} s into ±2°: linearised about q_i the loop has poles "
        f"{_complex(slow['q_i'])} 1/s, a damping ratio of {ratio['q_i']:.2f} (at q_f {ratio['q_f']:.2f}), so its "
        "second swing leaves that band once more. It is too small for ±5 %, and the bench's friction takes it away: "
        f"the slowest move there takes {slowest:.3f} s."
    )


def _cycles(study: Study) -> tuple[Drawing, ...]:
    bench = study.cycles_bench
    goals = [(move.start, move.end, move.goal) for move in bench.moves]
    figure = cycles_figure(study.cycles_ideal.trajectory, bench.trajectory, goals)
    caption = f"{CYCLES} cycles on the bench (solid) and ideal (dashed); below, the way back enlarged, ±5 % shaded."
    return (Drawing("fig10", caption, figure),)


def _complex(value: complex) -> str:
    return f"{value.real:.1f} ± {abs(value.imag):.1f}i".replace("-", "−")
