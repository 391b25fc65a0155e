"""`ccpin view`: the mechanism or a trajectory in MeshCat."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ccpin.cli.options import add_mechanism, load
from ccpin.simulation.trajectory import load_npz


def add_view(commands: Any) -> None:
    """The command and its options."""
    parser = commands.add_parser("view", help="show the mechanism, or play a trajectory, in MeshCat")
    add_mechanism(parser)
    parser.add_argument("--trajectory", type=Path, metavar="NPZ", help="a motion.npz to play")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a self-contained page instead of serving one")
    parser.add_argument("--no-browser", action="store_true", help="serve without opening a browser")
    parser.add_argument("--speed", type=float, default=1.0, help="playing speed (default 1)")
    parser.set_defaults(run=_view)


def _view(options: argparse.Namespace) -> None:
    from ccpin import visualization

    mechanism = load(options)
    motion = None if options.trajectory is None else load_npz(options.trajectory)
    if options.html is not None:
        if motion is None:
            visualization.snapshot_html(mechanism, None, options.html)
        else:
            visualization.animate(mechanism, motion.t, motion.q_free, options.html, speed=options.speed)
        print(json.dumps({"html": str(options.html)}) if options.json else f"wrote {options.html}")
        return
    q_free, t = (None, None) if motion is None else (motion.q_free, motion.t)
    with visualization.view(mechanism, q_free, t, speed=options.speed, open_browser=not options.no_browser) as viewer:
        print(
            json.dumps({"url": viewer.url}) if options.json else f"serving {viewer.url}  (Ctrl-C ends it)", flush=True
        )
        viewer.wait()
