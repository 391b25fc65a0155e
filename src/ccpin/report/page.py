"""The report as a whole: each part computed, said to be impossible with the reason where it is, and written."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from ccpin.arrays import listener
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import CcpinError
from ccpin.files import writable_target, write_text
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import bullets, paragraphs, preformatted
from ccpin.pages.provenance import versions
from ccpin.report import description_facts, mode_pictures, set_point_move, validity
from ccpin.report.settings import ReportSettings

T = TypeVar("T")
PARTS = ("what it is", "experiment", "animation", "assembly modes", "domain")
"""What is computed, in this order."""


class Report(NamedTuple):
    """What was written.

    Attributes:
        path: The page.
        seconds: By part.
        failed: Why a part is missing, by part; empty where all are there.
    """

    path: Path
    seconds: dict[str, float]
    failed: dict[str, str]


def write(
    mechanism: Mechanism | HasMechanism,
    path: str | Path,
    settings: ReportSettings | None = None,
    *,
    command: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Write one self-contained page about a mechanism.

    Args:
        mechanism: The mechanism, or its model.
        path: The page, .html.
        settings: What it may cost and which motion it shows.
        command: The command line that repeats it, where there is one.
        progress: Called with the name of each of `PARTS` before it is computed.

    Raises:
        InvalidInputError: The page cannot be written; a start or goal is malformed.
    """
    mechanism, settings = mechanism_of(mechanism), ReportSettings() if settings is None else settings
    target = writable_target(path)
    work = _PartRunner(listener(progress))
    model = ReducedModel(mechanism)
    about = work.part("what it is", lambda: description_facts.identity(model))
    asked = settings.start is not None or settings.goal is not None
    moved = work.part("experiment", lambda: set_point_move.run(model, settings), required=asked)
    shown = work.failure("experiment") if moved is None else set_point_move.experiment(model, moved)
    scene = work.part("animation", lambda: set_point_move.animation(mechanism, None if moved is None else moved.motion))
    found = work.part("assembly modes", lambda: mode_pictures.modes(model, settings))
    where = work.part("domain", lambda: validity.domain(model, settings))
    sections = [
        Section("what", "What it is", about or work.failure("what it is")),
        Section("animation", "In motion", scene or work.failure("animation")),
        Section("domain", "Where the model holds", where or work.failure("domain")),
        Section("modes", "Assembly modes", found or work.failure("assembly modes")),
        Section("experiment", "An experiment", shown),
        Section("repeat", "To repeat this page", _repeat(mechanism, settings, command, work.seconds)),
    ]
    page = render(mechanism.title, "A closed-chain mechanism, as ccpin loads it.", sections)
    write_text(target, page)
    return Report(target, work.seconds, work.failed)


class _PartRunner:
    """Runs the parts, keeps their times and the reasons of those that failed."""

    def __init__(self, progress: Callable[[str], object]) -> None:
        self.seconds: dict[str, float] = {}
        self.failed: dict[str, str] = {}
        self._progress = progress

    def part(self, name: str, compute: Callable[[], T], required: bool = False) -> T | None:
        """What a part computes, or ``None`` where it cannot be had."""
        self._progress(name)
        began = time.perf_counter()
        try:
            return compute()
        except CcpinError as error:
            if required:
                raise
            self.failed[name] = str(error)
            return None
        finally:
            self.seconds[name] = time.perf_counter() - began

    def failure(self, name: str) -> str:
        """Why a part is missing, as HTML."""
        return paragraphs(f"This part cannot be had here: {self.failed.get(name, 'it was not computed')}.")


def _repeat(mechanism: Mechanism, settings: ReportSettings, command: str | None, seconds: dict[str, float]) -> str:
    lines = preformatted(command) if command is not None else ""
    facts = [f"{name}: `{told}`" for name, told in versions()]
    facts += [
        f"`{name}`: `{np.asarray(told).tolist()}`" for name, told in settings._asdict().items() if told is not None
    ]
    facts += [f"source: `{mechanism.description.source or 'built in Python'}`"]
    facts += [f"{name}: {spent:.1f} s" for name, spent in seconds.items()]
    return lines + bullets(facts)
