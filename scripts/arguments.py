"""What an experiment takes from the command line: the folder to write to, or a request for help."""

import argparse
from collections.abc import Callable
from pathlib import Path


def run(main: Callable[..., object], about: str | None) -> None:
    """Run an experiment's `main`, with the folder that the command line names if it names one."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="where to write (default: a folder of its own under out/)")
    folder = parser.parse_args().folder
    main(*() if folder is None else (folder,))
