"""Hours of pick and place: the supervisor streams every move to disk; memory, cost and cycles are looked at.

Writes a figure and the numbers to out/endurance and prints a summary. After an interruption, of whatever kind, it goes
on behind the last whole move.
"""

import json
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import ccpin
from ccpin import plotting
from ccpin.control import ComputedTorque, PointToPoint
from ccpin.files import write_atomically
from ccpin.simulation import Settling, supervise

OUT = Path("out/endurance")
TASKS = {
    "rpdr": (10_000.0, np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])),
    "delta": (1_000.0, np.array([0.1, -0.1, 0.3]), np.array([0.4, 0.3, -0.1])),
}
MOVE, WAIT = 0.4, 0.1  # seconds
OMEGA = 40.0  # of computed torque, rad/s
SAMPLE_PERIOD = 0.01  # s
ARRIVED = {"band": 1e-4, "speed": 1e-3, "hold": 0.02}


class Record(NamedTuple):
    """What is looked at, move by move: lists of equal length, but memory and cost of this process's moves alone."""

    end: list[float]
    closure: list[float]
    change: list[float]
    memory: list[float]
    cost: list[float]


def main(out: Path = OUT) -> None:
    """Run the cycles of every task, draw and print."""
    records = {name: endure(name, out / f"{name}.moves") for name in TASKS}
    plotting.save(figure(records), out / "endurance.png")
    numbers = {name: record._asdict() for name, record in records.items()}
    write_atomically(out / "endurance.json", "w", lambda file: json.dump(numbers, file))
    for name, record in records.items():
        late = slice(len(record.memory) // 2, None)
        line = f"{name}: {record.end[-1]:.0f} s in {len(record.end)} moves, ‖φ‖ ≤ {max(record.closure):.1e} m, "
        line += f"cycles repeat to {max(record.change[4:], default=np.nan):.1e} rad"
        if record.memory:
            line += f"; memory {np.ptp(record.memory[late]):.1f} MB apart in the second half, "
            first, last = rate(record)
            line += f"{1e3 * first:.2f} ms of CPU a simulated second at first, {1e3 * last:.2f} at last"
        print(line)


def endure(name: str, journal: Path) -> Record:
    """One mechanism's cycles."""
    duration, pick, place = TASKS[name]
    model = ccpin.ReducedModel(ccpin.load(name))
    gains = [OMEGA**2] * model.n, [2 * OMEGA] * model.n
    record = Record([], [], [], [], [])

    def law_to(goal: np.ndarray, q_free: np.ndarray) -> ComputedTorque:
        record.memory.append(resident())
        record.cost.append(time.process_time())
        return ComputedTorque(model, PointToPoint(model, model.alpha(q_free), goal, MOVE), *gains, q_free)

    motion = supervise(
        model,
        law_to,
        pick,
        [place, pick] * round(0.5 * duration / (MOVE + WAIT)),
        wait=WAIT,
        settling=Settling(pick, **ARRIVED),
        sample_period=SAMPLE_PERIOD,
        journal=journal,
        name=f"{name}: {duration} s",
    )
    there = list[np.ndarray]()
    for move in motion.moves:
        record.end.append(move.end)
        record.closure.append(float(move.trajectory.closure_error.max()))
        there = [*there[-2:], move.trajectory.q[: round(MOVE / SAMPLE_PERIOD)]]
        record.change.append(float(np.abs(there[-1] - there[0]).max()) if len(there) == 3 else np.nan)
    return record


def resident() -> float:
    """This process's resident memory, MB."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096 / 1e6


def rate(record: Record) -> tuple[float, float]:
    """CPU seconds a simulated second, in the first and in the last tenth of this process's moves."""
    ends, cost = np.array(record.end[len(record.end) - len(record.cost) :]), np.array(record.cost)
    part = max(1, len(cost) // 10)
    pieces = (slice(0, part + 1), slice(-part - 1, None))
    first, last = (float(np.ptp(cost[piece]) / np.ptp(ends[piece])) for piece in pieces)
    return first, last


def figure(records: dict[str, Record]) -> Figure:
    """Memory, cost and change from cycle to cycle against simulated time."""
    drawn = Figure(figsize=(9.0, 8.0), layout="constrained")
    memory, cost, change = drawn.subplots(3, 1)
    for name, record in records.items():
        end = np.array(record.end[len(record.end) - len(record.memory) :])
        memory.plot(end, record.memory, label=name)
        cost.plot(end, np.array(record.cost) - min(record.cost, default=0.0), label=name)
        change.semilogy(record.end, record.change, ".", markersize=2, label=name)
    most = max((max(record.memory, default=0.0) for record in records.values()), default=0.0)
    memory.set(ylabel="resident memory [MB]", ylim=(0, 1.2 * most or 1.0))
    cost.set(ylabel="CPU time [s]")
    change.set(ylabel="change of q from cycle to cycle [rad]", xlabel="simulated time [s]")
    memory.legend()
    return drawn


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
