"""`ccpin view`: the mechanism or a trajectory in MeshCat."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete, positive
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.progress import busy
from ccpin.cli.serving import serve
from ccpin.errors import InvalidInputError
from ccpin.simulation.results.forces import closure_forces
from ccpin.simulation.results.trajectory import Trajectory

_EXAMPLES = """\
example: ccpin view delta --out delta.html
         ccpin simulate rpdr --goal-deg -100 -90 --duration 0.2 --out out
         ccpin view rpdr --trajectory out/motion.npz --trace end_effector --forces --out motion.html"""


def add_view(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "view", _EXAMPLES, _view)
    add_mechanism(parser)
    played = parser.add_argument("--trajectory", type=Path, metavar="NPZ", help="a motion.npz to play")
    written = "write a page (.html), a film (.mp4, .gif) or a picture (.png) instead of serving"
    for argument in (played, parser.add_argument("--out", type=Path, metavar="FILE", help=written)):
        complete(argument, shtab.FILE)
    parser.add_argument("--trace", metavar="NAME", help="draw the path of a link or a loop's point")
    parser.add_argument("--forces", action="store_true", help="draw the forces that the closures carry")
    parser.add_argument("--no-browser", action="store_true", help="serve without opening a browser")
    parser.add_argument("--speed", type=positive, default=1.0, help="playing speed (default 1)")


def _view(options: argparse.Namespace) -> None:
    from ccpin import visualization
    from ccpin.visualization.film import FILMS

    mechanism = load(options)
    motion = None if options.trajectory is None else Trajectory.load(options.trajectory)
    shown: dict[str, Any] = {}
    if motion is not None:
        with busy(options.json, "computing the forces"):
            forces = closure_forces(mechanism, motion) if options.forces else ()
        shown = {"speed": options.speed, "trace": options.trace, "forces": forces}
    elif options.trace is not None or options.forces:
        raise InvalidInputError("--trace and --forces go with --trajectory: a pose alone has neither path nor forces")
    if options.out is not None:
        film = options.out.suffix.lower() in FILMS
        with progress_bar(options.json) if film else busy(options.json, "drawing") as drawn:
            if motion is None:
                visualization.snapshot(mechanism, None, options.out)
            else:
                visualization.animate(mechanism, motion.t, motion.q_free, options.out, progress=drawn, **shown)
        print(json.dumps({"out": str(options.out)}) if options.json else f"wrote {options.out}")
        return
    q_free, t = (None, None) if motion is None else (motion.q_free, motion.t)
    with visualization.view(mechanism, q_free, t, open_browser=not options.no_browser, **shown) as viewer:
        serve(viewer, options.json)


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """What `animate` calls after each frame of a film: a bar on a terminal, nothing elsewhere."""
    if quiet:
        yield None
        return
    from tqdm import tqdm

    with tqdm(unit=" frames", disable=None, leave=False, delay=0.5) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show
