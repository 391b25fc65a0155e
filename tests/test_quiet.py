"""What dependencies have to say of themselves reaches no user: who loads, moves, draws and ends is silent."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest

from tests.support.long_cases import later

BEGUN = dedent("""
    import multiprocessing, sys, threading, time
    import ccpin
    from ccpin import plotting, visualization

    def moved(case):
        model = ccpin.ReducedModel(ccpin.load("rpdr"))
        law = ccpin.control.PDSimpleGravity(model, q_d=[-1.57, -1.75], K_p=[11, 11], K_v=[0.65, 0.60])
        return ccpin.simulate(model, law, q0=[-2.62, case["q2"]], duration=0.05)

    def end(case):
        return {"q": moved(case).q[-1].tolist()}
""")
ALWAYS_LATE = dedent("""
    class AtOnce(threading.Thread):  # a timer whose time has come: what is told of long waits is told
        def __init__(self, interval, function, args=(), kwargs=None):
            super().__init__(target=function, args=args, kwargs=kwargs)
            self.cancel = lambda: None

    threading.Timer = AtOnce
""")
DRAWN = dedent("""
    motion = moved({"q2": -2.79})
    plotting.save(plotting.plot_motion(motion, ccpin.load("rpdr")), "motion.png")
    visualization.animate(ccpin.load("rpdr"), motion.t, motion.q_free, "motion.html")
""")
AT_WORK = dedent("""
    if __name__ == "__main__":
        multiprocessing.set_start_method(sys.argv[1])
        assert ccpin.sweep(end, [{"q2": -2.79}, {"q2": -2.7}], workers=2).table()["error"] == ["", ""]
""")
HELD = dedent("""
    def held(model):
        begun.set()
        time.sleep(1000)

    begun = threading.Event()
    threading.Thread(target=held, args=(ccpin.ReducedModel(ccpin.load("rpdr")),), daemon=True).start()
    begun.wait()
""")


def told(folder, code, *arguments, flags=()):
    """What a fresh process writes to stderr, in an empty folder that is also where Matplotlib keeps its fonts."""
    script = folder / "script.py"
    script.write_text(code, encoding="utf-8")
    environment = {**os.environ, "MPLCONFIGDIR": str(folder / "matplotlib")}
    command = [sys.executable, *flags, str(script), *arguments]
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return run.stderr


@pytest.mark.slow
def test_the_first_picture_on_a_machine(tmp_path):
    """Simulating and drawing say nothing, deprecations in dependencies included, though fonts are looked for first."""
    flags = ("-W", "error", "-W", "ignore::ResourceWarning")
    assert told(tmp_path, BEGUN + ALWAYS_LATE + DRAWN, flags=flags) == ""
    assert {"motion.png", "motion.html", "matplotlib"} <= {path.name for path in tmp_path.iterdir()}


def test_the_font_list_would_be_told_of(tmp_path):
    """The same without ccpin's filter: Matplotlib speaks (else the test above proves nothing)."""
    assert "building the font cache" in told(
        tmp_path, "import threading" + ALWAYS_LATE + "import matplotlib.font_manager"
    )


@pytest.mark.slow
@pytest.mark.parametrize("start", later("spawn", "fork"))
def test_workers(tmp_path, start):
    """Processes that made models of their own end without a word, however they were started."""
    assert told(tmp_path, BEGUN + AT_WORK, start) == ""


def test_what_a_daemon_thread_holds(tmp_path):
    """A model in a thread that lives when the interpreter ends is no leak to tell a user of."""
    assert told(tmp_path, BEGUN + HELD) == ""
