"""Every mechanism through every format that is written, and back; and every MJCF file that is written, run in MuJoCo.

``python -m benchmarks.round_trips [--random 30] [--only FORMAT …] [--subject WORD] [--others FOLDER]`` prints both:
installed models, files of others where they are, and random mechanisms. `tests.support.trips` says what equal means; a
refusal names what the format has no words for. In MuJoCo a file is run for a second from its closed keyframe, motors
held, as it was stated and tight: how far its loops open, and how far its joints are from the reduced model's.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import ccpin
from ccpin.errors import CcpinError
from ccpin.simulation import run_in_mujoco
from tests.support.grown import grown
from tests.support.places import MODELS, SHARED
from tests.support.trips import WRITTEN, Trip, trip

OTHERS = (
    "four_bar.urdf",
    "mini_cheetah_leg.urdf",
    "5bar_linkage_iso3d",
    "cassie_like",
    "digit_like",
    "cassie_closed_chain.xml",
    "two_rod_ankle/ankle.xml",
    "neck.xml",
)


LOOPS = ("as_stated", "tight")


class Run(NamedTuple):
    """One mechanism's file in MuJoCo, its loops held as `loops` says; a sentence in place of a run that was refused."""

    subject: str
    loops: str
    run: Any


def subjects(others: Path = SHARED, count: int = 30) -> Iterator[tuple[str, ccpin.Mechanism]]:
    """Installed models, files of others where they are, and random mechanisms."""
    for path in sorted(MODELS.glob("*.urdf")):
        yield path.stem, ccpin.load(path)
    for name in OTHERS:
        if (others / name).exists():
            yield f"others/{name}", ccpin.load(others / name)
    yield from random_mechanisms(count)


def random_mechanisms(count: int) -> Iterator[tuple[str, ccpin.Mechanism]]:
    """As many random ones that load."""
    seed = found = 0
    while found < count:
        seed += 1
        try:
            mechanism = ccpin.load(grown(seed))
        except CcpinError:
            continue
        found += 1
        yield f"random {seed}", mechanism


def measured(wanted: Iterable[tuple[str, ccpin.Mechanism]], formats: Iterable[str] = WRITTEN) -> Iterator[Trip]:
    """Every trip."""
    names = tuple(formats)
    for subject, mechanism in wanted:
        for name in names:
            with tempfile.TemporaryDirectory() as folder:
                yield trip(subject, mechanism, name, Path(folder))


def runs(wanted: Iterable[tuple[str, ccpin.Mechanism]], duration: float = 1.0) -> Iterator[Run]:
    """Every file in MuJoCo, loops as stated and tight."""
    for subject, mechanism in wanted:
        for loops in LOOPS:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "robot.xml"
                try:
                    mechanism.save(file, loops=loops)
                    yield Run(subject, loops, run_in_mujoco(mechanism, file, duration=duration))
                except CcpinError as error:
                    yield Run(subject, loops, str(error))


def cell(one: Trip) -> str:
    """What the table says of a trip."""
    if one.error is None:
        return "refused"
    if one.silent:
        return f"OFF in {', '.join(one.silent)}"
    return "equal" if one.equal else f"OFF by {one.error:.1e}"


def table(trips: list[Trip]) -> str:
    """A row a mechanism, a column a format; below, why those that were refused were."""
    names = list(dict.fromkeys(each.format for each in trips))
    found: dict[str, dict[str, Trip]] = {}
    for each in trips:
        found.setdefault(each.subject, {})[each.format] = each
    rows = [["", *names], ["---"] * (len(names) + 1)]
    rows += [[subject, *(cell(of[name]) for name in names)] for subject, of in found.items()]
    counts = Counter((each.format, cell(each).split(" ")[0]) for each in trips)
    rows.append(["all", *(_counted(counts, name) for name in names)])
    lines = [f"| {' | '.join(row)} |" for row in rows]
    why = [f"- {each.subject}, {each.format}: {each.said}" for each in trips if each.error is None]
    return "\n".join([*lines, "", "Refused:", *(why or ["- none"])])


def _counted(counts: Mapping[tuple[str, str], int], name: str) -> str:
    return ", ".join(f"{counts[name, word]} {word}" for word in ("equal", "refused", "OFF") if counts[name, word])


def in_mujoco(found: Iterable[Run]) -> str:
    """A row a mechanism; those that MJCF cannot have are left out, since the table of formats has them."""
    rows: dict[str, list[str]] = {}
    for each in found:
        if not isinstance(each.run, str):
            run = each.run
            off = f"{math.degrees(run.turned):.1e}°" + (f", {run.slid:.1e} m" if run.slid else "")
            rows.setdefault(each.subject, []).append("unstable" if math.isinf(run.gap) else f"{run.gap:.1e} m, {off}")
            if each.loops == LOOPS[-1]:
                rows[each.subject].append(f"{run.seconds:.2g}")
    head = ["", *(f"{loops}: gap, joints off" for loops in LOOPS), "seconds"]
    lines = [head, ["---"] * len(head), *([name, *cells] for name, cells in rows.items())]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--random", type=int, default=30, help="how many random mechanisms")
    parser.add_argument("--only", nargs="+", choices=WRITTEN, default=WRITTEN, help="these formats alone")
    parser.add_argument("--others", type=Path, default=SHARED, help="a folder of files of others")
    parser.add_argument("--subject", help="only what has this in its name")
    options = parser.parse_args()
    everyone = subjects(options.others, options.random)
    wanted = [(name, mechanism) for name, mechanism in everyone if (options.subject or "") in name]
    print(table(list(measured(wanted, options.only))))
    if "mjcf" in options.only:
        print(f"\nIn MuJoCo:\n{in_mujoco(runs(wanted))}")


if __name__ == "__main__":
    main()
