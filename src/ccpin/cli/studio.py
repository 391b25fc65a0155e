"""`ccpin studio`: the mechanism in the browser, moved by hand."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ccpin.cli.command import add_command
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.serving import serve


def add_studio(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "studio", "example: ccpin studio rpdr --port 8080", _studio)
    add_mechanism(parser)
    parser.add_argument("--port", type=int, default=0, metavar="N", help="serve there (default: any free port)")
    parser.add_argument("--no-browser", action="store_true", help="serve without opening a browser")
    kept = "folder for certified atlases (default: $CCPIN_CACHE, else ccpin in the user's cache folder)"
    parser.add_argument("--cache", type=Path, metavar="DIR", help=kept)


def _studio(options: argparse.Namespace) -> None:
    from ccpin.studio import studio

    mechanism = load(options)
    with studio(mechanism, port=options.port, open_browser=not options.no_browser, cache=options.cache) as opened:
        serve(opened, options.json)
