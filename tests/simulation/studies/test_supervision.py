"""One continuous supervisor: clocks, waits that end early, journals that survive a kill, budgets and failures."""

import gc
import os
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin.control import ComputedTorque, PDSimpleGravity, PointToPoint, Sampling
from ccpin.control.online import OnlineLaw, OnlineSigma
from ccpin.description import scaled
from ccpin.errors import InvalidInputError, UnreachableError
from ccpin.simulation import Budget, Event, Settling, supervise
from tests.support.alarms import alarm
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.paper import FRICTION, GOAL, K_P, K_V, START
from tests.support.passive import case
from tests.support.places import ROOT

BENCH = Sampling(1e-3, encoder_counts=4096, velocity_cutoff=100.0, saturation=12.0, delay=1)
pytestmark = same_on_both  # cycles on NumPy: `test_supervised_cycles`
ARRIVED = Settling(GOAL, band=1e-3, speed=1e-2, hold=0.02)


def tracking(model, move=0.3):
    """Computed torque from where it is to each goal, on a clock that begins with the move."""

    def law_to(goal, q_free):
        reference = PointToPoint(model, model.alpha(q_free), goal, move)
        return ComputedTorque(model, reference, 900.0, 60.0, q_free)

    return law_to


def papers(model):
    return lambda goal, q_free: PDSimpleGravity(model, goal, K_P, K_V, q_free)


def test_a_tracking_law_stays_at_its_goal_while_waiting(rpdr_model):
    """Its clock runs on through the wait: the goal is kept, not left for a second go."""
    motion = supervise(rpdr_model, tracking(rpdr_model), START, [GOAL, START], wait=0.5, settling=ARRIVED)
    assert motion.stop.status == "finished"
    for move in motion.moves:
        waiting = move.trajectory.t > move.settled
        assert np.abs(move.trajectory.q[waiting] - move.goal).max() < 1.1e-3
        assert move.end - move.settled == pytest.approx(0.5, abs=1e-12)
    assert np.all(np.diff(motion.trajectory.t) > 0)
    assert motion.moves[1].trajectory.t[0] == motion.moves[0].end


def test_a_law_with_a_memory_goes_through_the_wait(rpdr_model):
    """A law whose samples must come in order is asked in order, moves and waits together."""

    def law_to(goal, q_free):
        law = tracking(rpdr_model)(goal, q_free)
        return OnlineLaw(law, OnlineSigma(rpdr_model, q_free))

    motion = supervise(
        rpdr_model,
        law_to,
        START,
        [GOAL, START],
        wait=0.2,
        settling=ARRIVED,
        sampling=Sampling(1e-3),
        sample_period=0.01,
    )
    assert motion.stop.status == "finished"


@pytest.mark.parametrize("bench", later({}, {"friction": FRICTION, "sampling": BENCH}))
def test_when_it_settles_does_not_depend_on_samples(rpdr_model, bench):
    """The band is entered at a time of the motion, not of its output."""
    settled = [
        supervise(
            rpdr_model,
            papers(rpdr_model),
            START,
            [GOAL],
            wait=0.05,
            settling=ARRIVED._replace(band=0.04, speed=0.05),
            sample_period=period,
            **bench,
        )
        .moves[0]
        .settled
        for period in (1e-3, 0.013)
    ]
    assert settled[0] == pytest.approx(settled[1], abs=1e-11)


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ({"region": lambda q: True}, "finished"),
        ({"events": [Event(lambda t, state, v: t - 0.8, "bell", terminal=True)]}, "event"),
        ({"budget": Budget(evaluations=900)}, "exhausted"),
    ],
)
def test_how_a_wait_ends_is_respected(rpdr_model, options, status):
    """An end within a wait ends the whole; what was computed is there."""
    motion = supervise(rpdr_model, tracking(rpdr_model), START, [GOAL, START], wait=0.6, settling=ARRIVED, **options)
    assert motion.stop.status == motion.trajectory.status == status
    assert len(motion.moves) == (2 if status == "finished" else 1)
    if status == "event":
        assert motion.trajectory.t[-1] == pytest.approx(0.8, abs=1e-12)
        assert [event.name for event in motion.trajectory.events] == ["bell"]


def test_leaving_a_region_while_waiting_ends_it(rpdr_model):
    """A wait that is pushed out of the region given does not go on as if it were finished."""

    def push(t, state, v):
        return {"link1": [0.0, 0.0, 0.0, 0.0, -40.0 * (t > 0.6), 0.0]}

    motion = supervise(
        rpdr_model,
        tracking(rpdr_model),
        START,
        [GOAL, START],
        wait=1.0,
        settling=ARRIVED,
        wrenches=push,
        region=lambda q: bool(np.abs(q - GOAL)[0] < 0.02 or q[0] < GOAL[0]),
    )
    assert motion.stop.status == "outside"
    assert len(motion.moves) == 1
    assert motion.moves[0].settled is not None


def test_an_unreachable_goal_keeps_what_came_before(rpdr_model):
    """The third goal cannot be reached: two moves and the reason come back."""
    motion = supervise(
        rpdr_model,
        papers(rpdr_model),
        START,
        [GOAL, START, [1.5, -1.5]],
        wait=0.1,
        settling=ARRIVED._replace(band=0.05),
    )
    assert motion.stop.status == "failed"
    assert isinstance(motion.stop.cause, UnreachableError)
    assert len(motion.moves) == 2
    assert motion.trajectory.cause is motion.stop.cause
    with pytest.raises(UnreachableError):
        supervise(rpdr_model, papers(rpdr_model), START, [[1.5, -1.5]], wait=0.1)


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt(), "interrupted"), (OSError("sensor"), "failed")])
def test_ctrl_c_stops_all_of_it(rpdr_model, error, status):
    """Within a wait too; the cause is there to be raised."""

    class Ends(ccpin.control.ControlLaw):
        def __init__(self, law):
            self.law = law

        def torque(self, t, state, v):
            if t > 0.5:
                raise error
            return self.law.torque(t, state, v)

    motion = supervise(
        rpdr_model,
        lambda goal, q_free: Ends(tracking(rpdr_model)(goal, q_free)),
        START,
        [GOAL, START],
        wait=1.0,
        settling=ARRIVED,
        sample_period=0.01,
    )
    assert (motion.stop.status, motion.stop.cause) == (status, error)
    assert 0.45 < motion.trajectory.t[-1] <= 0.5


def test_a_signal_reaches_a_run_in_the_core(rpdr_model):
    """Ctrl-C and a handler's own exception end a run of the core with what it has, and are its cause."""
    law = PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    for handler, kind, status in (
        (signal.default_int_handler, KeyboardInterrupt, "interrupted"),
        (_alarm, TimeoutError, "failed"),
    ):
        with alarm(0.3, handler):
            motion = ccpin.simulate(rpdr_model, law, START, duration=1e5, sample_period=0.1)
        assert motion.status == status
        assert isinstance(motion.cause, kind)
        assert motion.t[-1] > 0


def _alarm(number, frame):
    raise TimeoutError("too late")


# Journals.


def cycles(model, journal, count, **options):
    return supervise(
        model,
        tracking(model),
        START,
        [GOAL, START] * count,
        wait=0.05,
        settling=ARRIVED,
        sample_period=0.01,
        journal=journal,
        name="tracking",
        **options,
    )


@pytest.mark.parametrize("bench", [{}, {"friction": FRICTION, "sampling": BENCH}])
def test_a_journal_is_gone_on_with_to_the_last_bit(rpdr_model, tmp_path, bench):
    """A cycle, then one more, are two cycles in one go; so they are behind a record that was cut off."""
    options = {"sampling": Sampling(1e-3, velocity_cutoff=100.0, delay=1)} if bench else {}
    whole = cycles(rpdr_model, None, 2, **options).trajectory
    path = tmp_path / "cycles.moves"
    cycles(rpdr_model, path, 1, **options)
    with path.open("ab") as file:
        file.write(b'{"npz": "half a record')
    resumed = cycles(rpdr_model, path, 2, **options)
    assert len(resumed.moves) == 4
    for name in ("t", "q", "v", "a", "u", "q_free"):
        assert np.array_equal(getattr(resumed.trajectory, name), getattr(whole, name)), name
    again = cycles(rpdr_model, path, 2, **options)
    assert again.stop.status == "finished"
    assert np.array_equal(again.trajectory.q, whole.q)


def swings(journal, law, budget=None):
    """Let go three times for a while, through changes of coordinates; nobody waits for anything to settle."""
    model = case("five-bar")[0]
    start = model.alpha(model.mechanism.q_reference)
    return supervise(
        model,
        lambda goal, q_free: law,
        start,
        [start] * 3,
        wait=0.5,
        settling=Settling(start, band=100.0, speed=1e3, hold=0.01),
        wrenches={"left2": [0.0, 0.0, 0.0, 1.5, 0.0, 0.0]},
        sample_period=0.01,
        rtol=1e-8,
        journal=journal,
        name="swings",
        budget=budget,
    )


@pytest.mark.parametrize("law", [None, lambda t, q, v: np.array([0.0, 0.1 * np.sin(t)])], ids=["none", "function"])
def test_a_journal_is_gone_on_with_after_a_change_of_coordinates(tmp_path, law):
    """Interrupted while in other coordinates than the model's, it goes on to the same bits, changes and all."""
    whole, path = swings(None, law), tmp_path / "swings.moves"
    assert whole.stop.status == "finished"
    spent = np.array([move.trajectory.evaluations for move in whole.moves])
    part = swings(path, law, Budget(evaluations=round(spent @ [1.0, 1.0, 0.9])))
    assert part.stop.status == "exhausted"
    assert len(part.moves) == 3
    assert part.moves[0].trajectory.changes >= 1
    assert part.moves[2].trajectory.events[-1].name.startswith("measured by ")
    resumed = swings(path, law).trajectory
    for name in ("t", "q", "v", "a", "u", "q_free"):
        assert np.array_equal(getattr(resumed, name), getattr(whole.trajectory, name)), name
    assert [event.t for event in resumed.events] == [event.t for event in whole.trajectory.events]


def test_kill_9_costs_a_move_at_most(rpdr_model, tmp_path):
    """A process killed in the middle leaves whole moves; another goes on and ends where an undisturbed one does."""
    path = tmp_path / "cycles.moves"
    code = (
        "import ccpin\nfrom tests.simulation.studies.test_supervision import cycles\n"
        f"cycles(ccpin.ReducedModel(ccpin.load('rpdr')), {str(path)!r}, 1000)"
    )
    paths = [str(ROOT / "src"), str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    process = subprocess.Popen([sys.executable, "-c", code], env=environment)
    patience = time.monotonic() + 60.0
    while (not path.exists() or path.stat().st_size < 100_000) and time.monotonic() < patience:
        time.sleep(0.01)
    process.kill()
    process.wait()
    size = path.stat().st_size
    done = len(cycles(rpdr_model, path, 1).moves)
    assert 3 < done < 2000
    assert path.stat().st_size <= size
    count = done // 2 + 1
    resumed, whole = cycles(rpdr_model, path, count).trajectory, cycles(rpdr_model, None, count).trajectory
    assert np.array_equal(resumed.q, whole.q)


def test_journals_are_checked(rpdr_model, tmp_path):
    """Another task's journal, and a file that is none, are refused and left alone."""
    path = tmp_path / "cycles.moves"
    cycles(rpdr_model, path, 1)
    before = path.read_bytes()
    with pytest.raises(InvalidInputError, match="another task: rtol"):
        cycles(rpdr_model, path, 1, rtol=1e-8)
    assert path.read_bytes() == before
    path.write_text("my notes")
    with pytest.raises(InvalidInputError, match="no journal"):
        cycles(rpdr_model, path, 1)
    assert path.read_text() == "my notes"


def test_journals_are_of_one_law_and_one_mechanism(rpdr, rpdr_model, tmp_path):
    """Another name for the laws and other masses are another task's; a function needs a name."""
    path = tmp_path / "cycles.moves"
    cycles(rpdr_model, path, 1)
    before = path.read_bytes()
    heavy = ccpin.ReducedModel(ccpin.load(scaled(rpdr.settled(), masses=2.0)))
    options = {"wait": 0.05, "settling": ARRIVED, "sample_period": 0.01, "journal": path}
    for model, name, named in (
        (rpdr_model, "other gains", "task"),
        (heavy, "tracking", "dynamics"),
    ):
        with pytest.raises(InvalidInputError, match=f"another task: .*{named}"):
            supervise(model, tracking(model), START, [GOAL, START], name=name, **options)
    with pytest.raises(InvalidInputError, match="give name="):
        supervise(rpdr_model, tracking(rpdr_model), START, [GOAL, START], **options)
    assert path.read_bytes() == before
    same = ccpin.ReducedModel(ccpin.load("rpdr"))
    assert len(cycles(same, path, 1).moves) == 2


def test_an_interrupted_journal_has_the_rest_in_memory(rpdr_model, tmp_path):
    """A budget ends a move: its part is among the moves, not in the file, and is made again later."""
    path = tmp_path / "cycles.moves"
    part = cycles(rpdr_model, path, 3, budget=Budget(evaluations=1500))
    assert part.stop.status == "exhausted"
    assert part.moves[-1].trajectory.status == "exhausted"
    stored = len(part.moves) - 1
    assert [move.start for move in part.moves[:stored]] == [part.moves[k].start for k in range(stored)]
    assert len(cycles(rpdr_model, path, 3).moves) == 6


class Ledger:
    """What each move costs in bytes: joined by NumPy, read and written by this process, and held when it begins."""

    def __init__(self, monkeypatch):
        self.joined, self.rows, concatenate = 0, [], np.concatenate

        def counting(*arguments, **options):
            whole = concatenate(*arguments, **options)
            self.joined += whole.nbytes
            return whole

        monkeypatch.setattr(np, "concatenate", counting)

    def note(self):
        """Called as each move begins."""
        gc.collect()
        counters = Path("/proc/self/io")
        lines = counters.read_text(encoding="ascii").splitlines()[:2] if counters.exists() else []
        self.rows.append((self.joined, *(int(line.split()[1]) for line in lines), tracemalloc.get_traced_memory()[0]))

    def per_move(self):
        return np.diff(np.array(self.rows), axis=0)


def test_a_full_disk_loses_no_move(rpdr_model, tmp_path, monkeypatch):
    """The move that could not be written is there with the cause; those before are in the file, to go on behind."""
    path, sync, calls = tmp_path / "cycles.moves", os.fsync, []

    def full(file):
        calls.append(file)
        if len(calls) == 3:  # the header, a move, and this
            raise OSError(28, "No space left on device")
        sync(file)

    monkeypatch.setattr(os, "fsync", full)
    part = cycles(rpdr_model, path, 2)
    monkeypatch.undo()
    assert (part.stop.status, type(part.stop.cause)) == ("failed", InvalidInputError)
    assert "No space left" in part.stop.message
    assert len(part.moves) == 2
    assert part.moves[1].settled is not None
    assert np.array_equal(cycles(rpdr_model, path, 2).trajectory.q, cycles(rpdr_model, None, 2).trajectory.q)


@pytest.mark.parametrize("stored", [True, False])
@pytest.mark.slow
def test_cost_is_linear_and_memory_flat(rpdr_model, tmp_path, monkeypatch, stored):
    """The last moves copy, read and write what the first ones did; with a journal nothing of a move is kept.

    Counted in bytes, since seconds show what is quadratic only after thousands of moves.
    """
    ledger, law_to, count = Ledger(monkeypatch), tracking(rpdr_model), 6

    def noting(goal, q_free):
        ledger.note()
        return law_to(goal, q_free)

    tracemalloc.start()
    try:
        motion = supervise(
            rpdr_model,
            noting,
            START,
            [GOAL, START] * count,
            wait=0.05,
            settling=ARRIVED,
            sample_period=1e-3,
            journal=tmp_path / "cycles.moves" if stored else None,
            name="stored",
        )
    finally:
        tracemalloc.stop()
    part, spent = count // 2, ledger.per_move()
    first, last = spent[2 : 2 + part].mean(axis=0), spent[-part:].mean(axis=0)
    size = sum(np.asarray(column).nbytes for column in motion.moves[0].trajectory[:9])
    assert np.all(last[:-1] <= first[:-1] + 0.1 * size)
    assert last[-1] < (0.1 if stored else 2.0) * size


def test_cycles_repeat(rpdr_model):
    """At equal settings each cycle is the one before, to 1e-9."""
    moves = cycles(rpdr_model, None, 5).moves
    for k in (6, 7, 8, 9):
        ours, before = moves[k].trajectory, moves[k - 2].trajectory
        assert np.abs(ours.q[:30] - before.q[:30]).max() < 1e-9
