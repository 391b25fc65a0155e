"""What a person asks of a q that σ does not reach: whether anything closes there, and what to try next."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ccpin.cli.options import mechanism_words
from ccpin.dynamics.assembly import assembly_modes
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnreachableError

BUDGET = 0.3
"""Seconds in which closed configurations over q are sought; they are sampled, so that none found proves nothing."""


@contextmanager
def explained(options: argparse.Namespace, model: ReducedModel, in_degrees: bool) -> Iterator[None]:
    """Let an `UnreachableError` say whether loops close over its q, in the options' unit, and what to call next.

    Raises:
        UnreachableError: The one raised within, in the command line's words.
    """
    try:
        yield
    except UnreachableError as error:
        kept = {"q": error.q, "q_reached": error.q_reached, "fraction": error.fraction, "rcond": error.rcond}
        raise UnreachableError(_told(options, model, error, in_degrees), **kept) from error


def _told(options: argparse.Namespace, model: ReducedModel, error: UnreachableError, in_degrees: bool) -> str:
    unit, option = ("degrees", "--q-deg") if in_degrees else ("rad or m", "--q")
    asked, reached = (np.degrees(q) if in_degrees else q for q in (error.q, error.q_reached))
    numbers = " ".join(f"{value:.9g}" for value in asked)
    command = f"`{shlex.join(['ccpin', 'modes', *mechanism_words(options)])} {option} {numbers}`"
    found = assembly_modes(model, error.q, budget=BUDGET)
    count, starts = len(found.modes), f"{found.starts} start{'s' if found.starts != 1 else ''}"
    if count:
        closes = (
            f"The loops close over q in at least {count} way{'s' if count != 1 else ''}, found from {starts}: it is "
            "not out of reach. Go round by poses in between, or begin in another assembly mode (--reference "
            f"JOINT=VALUE …); {command} lists them"
        )
    elif found.singular:
        closes = f"Only singular configurations were found over q, from {starts}; {command} looks longer"
    else:
        closes = (
            f"No closed configuration was found over q, from {starts}: it is probably out of reach; "
            f"{command} looks longer"
        )
    return (
        f"q = {numbers} ({unit}) cannot be reached along a straight line: {100 * error.fraction:.2f} % of the way, at "
        f"{' '.join(f'{value:.6g}' for value in reached)}, a singularity or the end of the workspace is in the way "
        f"(reciprocal condition number of ψ_q′ {error.rcond:.1e}). {closes}"
    )
