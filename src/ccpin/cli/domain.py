"""`ccpin domain`: where the model holds."""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shtab

from ccpin.arrays import Array
from ccpin.cli.certificates import curve_facts, curves_in_words, sheet_facts, sheets_in_words
from ccpin.cli.command import INTERRUPTED, add_command, complete, count, index, judged
from ccpin.cli.options import add_mechanism, add_vector, load, region, vector
from ccpin.cli.progress import busy, progress_bar
from ccpin.cli.reaching import explained
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism

_EXAMPLES = """\
example: ccpin domain rpdr --centre-deg -108 -72
         ccpin domain rpdr --lower-deg -110 -75 --upper-deg -105 -70 --plot figures
         ccpin domain rpdr --sheets --depth 5
         ccpin domain rpdr --curves --lower-deg 100 35 --upper-deg 140 75 --save curves.json"""
_BAR = "{l_bar}{bar}| {n:.1f} % certified, {postfix}"
SHARES = ("certified", "empty", "singular", "undecided", "unreached")


def add_domain(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "domain", _EXAMPLES, _domain)
    add_mechanism(parser)
    add_vector(
        parser,
        "centre",
        "independent coordinates to certify about (default: the middle of the region, else the reference's)",
    )
    add_vector(parser, "lower", "lower corner of a region to map")
    add_vector(parser, "upper", "upper corner of a region to map")
    mapped = parser.add_mutually_exclusive_group()
    mapped.add_argument("--atlas", action="store_true", help="map the whole q-space (or --lower … --upper …), n ≤ 3")
    every = "count and certify every assembly mode over the q-space (or --lower … --upper …), n ≤ 3, no ball joints"
    mapped.add_argument("--sheets", action="store_true", help=every)
    all_curves = (
        "all singular curves over the q-space (or --lower … --upper …), n = 2, with a proof that none is missed"
    )
    mapped.add_argument("--curves", action="store_true", help=all_curves)
    parser.add_argument("--depth", type=index, metavar="N", help="how often an edge of the region may be halved")
    kept = "keep finished chunks there; a rerun resumes"
    complete(parser.add_argument("--checkpoint", type=Path, metavar="DIR", help=kept), shtab.DIRECTORY)
    parser.add_argument(
        "--workers", type=count, metavar="N", help="share the work among N threads, or processes (default: this one)"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run on a Dask cluster, e.g. tcp://127.0.0.1:8786")
    complete(
        parser.add_argument(
            "--save",
            type=Path,
            metavar="FILE",
            help="write the atlas, sheets or curves, a certificate for `ccpin verify` (.json, else npz)",
        ),
        shtab.FILE,
    )
    drawn = "write figures there (n = 2)"
    complete(parser.add_argument("--plot", type=Path, metavar="DIR", help=drawn), shtab.DIRECTORY)


def _domain(options: argparse.Namespace) -> int:
    from ccpin import domain

    mechanism = load(options)
    corners = region(options, mechanism)
    if options.sheets:
        return _sheets(options, mechanism, corners)
    if options.curves:
        return _curves(options, mechanism, corners)
    model, asked = ReducedModel(mechanism), vector(options, "centre", mechanism)
    if asked is None and corners is not None and model.nq == model.n:
        asked = np.mean(corners, axis=0)
    with explained(options, model, options.centre_deg is not None or options.lower_deg is not None):
        q_free = mechanism.q_reference if asked is None else model.sigma(asked)
    centre = domain.scalar_coordinates_at(mechanism, q_free)
    with busy(options.json, "proving squares about the centre"):
        theorem = domain.theorem2(mechanism, q_free)
        one_box = domain.kantorovich_radius(mechanism, q_free, bounds="auto")
    result: dict[str, Any] = {
        "centre": centre.tolist(),
        "q_free": q_free.tolist(),
        "theorem2_radius": theorem.radius,
        "theorem2_form": theorem.description,
        "kantorovich_radius": one_box,
    }
    atlas, mapped = None, options.atlas or corners is not None or options.plot
    if mapped or mechanism.n <= 2 or options.save:
        depth = options.depth if mapped else 0
        with _executor(options.scheduler) as executor, progress_bar(options.json, 100.0, _BAR, _progress) as progress:
            atlas = domain.certify(
                mechanism,
                centre,
                corners,
                q_free,
                max_depth=depth,
                workers=options.workers,
                executor=executor,
                checkpoint=options.checkpoint,
                progress=progress,
            )
        result["atlas"] = _atlas_facts(atlas)
    if atlas is not None and options.save is not None:
        atlas.save(options.save)
    if atlas is not None and options.plot is not None:
        with busy(options.json, "tracing singular curves and drawing"):
            _plot_domain(mechanism, atlas, options.plot)
    print(json.dumps(result, indent=2) if options.json else _domain_in_words(mechanism, result))
    if atlas is None or (atlas.complete and not mapped):  # radii were asked for: nothing is said of a region
        return 0
    return judged(atlas.verdict, atlas.complete)


def _sheets(options: argparse.Namespace, mechanism: Mechanism, region: tuple[Array, Array] | None) -> int:
    """Every assembly mode over a region."""
    from ccpin import domain, plotting

    if vector(options, "centre", mechanism) is not None:
        raise InvalidInputError("sheets are of every assembly mode: --sheets takes a region, no --centre")
    with _executor(options.scheduler) as executor, progress_bar(options.json, 100.0, _BAR, _progress) as progress:
        atlas = domain.certify_sheets(
            mechanism,
            region,
            max_depth=options.depth,
            workers=options.workers,
            executor=executor,
            checkpoint=options.checkpoint,
            progress=progress,
        )
    if options.save is not None:
        atlas.save(options.save)
    if options.plot is not None:
        plotting.save(plotting.plot_sheets(mechanism, atlas), options.plot / "sheets.png")
    facts = sheet_facts(atlas)
    print(json.dumps(facts, indent=2) if options.json else f"{mechanism.name}: {sheets_in_words(facts)}")
    return 0 if atlas.complete else INTERRUPTED


def _curves(options: argparse.Namespace, mechanism: Mechanism, region: tuple[Array, Array] | None) -> int:
    """All singular curves over a region."""
    from ccpin import domain, plotting

    if vector(options, "centre", mechanism) is not None:
        raise InvalidInputError("singular curves are of every assembly mode: --curves takes a region, no --centre")
    if options.depth is not None:
        raise InvalidInputError("--curves takes no --depth: boxes are halved until they are settled")
    with _executor(options.scheduler) as executor, busy(options.json, "covering the region and following curves"):
        cover = domain.certify_singularities(
            mechanism, region, workers=options.workers, executor=executor, checkpoint=options.checkpoint
        )
    if options.save is not None:
        cover.save(options.save)
    if options.plot is not None:
        drawn = plotting.plot_singularities(mechanism, [curve.points for curve in cover.curves])
        plotting.save(drawn, options.plot / "singularities.png")
    facts = curve_facts(cover)
    print(json.dumps(facts, indent=2) if options.json else f"{mechanism.name}: {curves_in_words(facts)}")
    return judged(cover.verdict, cover.complete)


def _atlas_facts(atlas: Any) -> dict[str, Any]:
    facts = (*(f"{share}_fraction" for share in SHARES), "single_valued", "complete", "verdict", "reason")
    return {"radius": atlas.radius, "boxes": len(atlas.lower)} | {name: getattr(atlas, name) for name in facts}


@contextlib.contextmanager
def _executor(scheduler: str | None) -> Iterator[Any]:
    """A Dask cluster's executor, or ``None``."""
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        message = f"--scheduler needs dask.distributed ({error}): pip install 'ccpin[cluster]'"
        raise InvalidInputError(message) from None
    try:
        client = Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"no Dask scheduler answers at {scheduler}: {error}") from None
    with client:
        yield client.get_executor()


def _progress(progress: Any) -> tuple[float, str]:
    return 100.0 * progress.certified, f"{progress.boxes} boxes, {progress.waiting} waiting"


def _plot_domain(mechanism: Mechanism, atlas: Any, out: Path) -> None:
    from ccpin import domain, plotting

    curves = domain.singularities(mechanism)
    plotting.save(plotting.plot_singularities(mechanism, curves), out / "singularities.png")
    plotting.save(plotting.plot_atlas(mechanism, atlas, curves), out / "atlas.png")
    plotting.save(plotting.plot_radius_map(mechanism, atlas, curves), out / "radius.png")


def _domain_in_words(mechanism: Mechanism, result: dict[str, Any]) -> str:
    def size(name: str, value: float) -> str:
        angular = not any(mechanism.tree.joint(mechanism.tree.split(j)[0]).kind.sliding for j in mechanism.independent)
        return f"{name:<28}{np.degrees(value):.4f}°" if angular else f"{name:<28}{value:.6g} (rad or m)"

    lines = [
        f"{mechanism.name}: squares about q = {np.round(result['centre'], 6).tolist()} on which σ is proved",
        size("Theorem 2", result["theorem2_radius"]) + f"  ({result['theorem2_form']})",
        size("Kantorovich, one box", result["kantorovich_radius"]),
    ]
    if "atlas" in result:
        atlas = result["atlas"]
        shares = ", ".join(f"{100 * atlas[f'{share}_fraction']:.3f} % {share}" for share in SHARES)
        lines += [size("atlas", atlas["radius"]), f"atlas: {atlas['boxes']} boxes; {shares} of the region"]
        lines += [f"{atlas['verdict']}: {atlas['reason']}"]
        lines += [] if atlas["single_valued"] else ["warning: not single-valued; some shared faces are unglued"]
        lines += [] if atlas["complete"] else ["interrupted: what is listed is certified, the rest was not reached"]
    return "\n".join(lines)
