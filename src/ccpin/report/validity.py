"""Where the model holds: certified radii, an atlas and singular curves where they can be had, slices where not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import TypeVar

import numpy as np

from ccpin.arrays import Array
from ccpin.domain import Atlas, certify, kantorovich_radius, scalar_coordinates_at, singularities, theorem2
from ccpin.domain.singular.sampled import SingularCurve
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.pages.parts import figure, paragraphs, table
from ccpin.plotting import plot_atlas, plot_singularities
from ccpin.plotting.style import Figure, drawing
from ccpin.report.settings import ReportSettings, scalar, sliding

T = TypeVar("T")
_SLICES = 3  # drawn, at most: one a pair of coordinates
_WIDEST = np.radians(60.0)  # of a slice, to either side
_SHARES = ("certified", "empty", "singular", "undecided", "unreached")


def domain(model: ReducedModel, settings: ReportSettings) -> str:
    """The section as HTML."""
    mechanism = model.mechanism
    if mechanism.n == 0:
        return paragraphs("Nothing is left to move: there is no domain to speak of.")
    parts = [table(("proved about the reference", "radius", ""), list(_radii(mechanism)))]
    curves, atlas = None, None
    if mechanism.n == 2:
        curves = _asked(lambda: singularities(mechanism), parts, "Singular curves")
    if mechanism.n <= 2:
        depth = settings.depth
        q0 = _asked(lambda: scalar_coordinates_at(mechanism, mechanism.q_reference), parts, "An atlas")
        if q0 is not None:
            atlas = _asked(lambda: certify(mechanism, q0, max_depth=depth), parts, "An atlas")
    if curves is not None:
        parts.append(_singular(mechanism, curves))
    if atlas is not None:
        parts.append(_atlas(mechanism, atlas, curves or (), settings))
    if mechanism.n > 2:
        parts.append(_slices(model, settings))
    return "".join(parts)


def _asked(compute: Callable[[], T], parts: list[str], what: str) -> T | None:
    """The result, or ``None`` and a sentence that says why there is none."""
    try:
        return compute()
    except CcpinError as error:
        parts.append(paragraphs(f"{what} cannot be had here: {error}."))
        return None


def _radii(mechanism: Mechanism) -> Iterator[tuple[str, str, str]]:
    q = mechanism.q_reference
    lengths = [sliding(mechanism, name) for name in mechanism.independent]

    def shown(radius: float) -> str:
        return f"{radius:.4g} (rad or m)" if any(lengths) else f"{np.degrees(radius):.4f}°"

    certificates: tuple[tuple[str, Callable[[], float]], ...] = (
        ("Theorem 2", lambda: theorem2(mechanism, q).radius),
        ("one box in joint space", lambda: kantorovich_radius(mechanism, q, bounds="auto")),
    )
    for name, radius in certificates:
        try:
            yield name, shown(radius()), "σ exists, is unique on the branch and nonsingular on that square"
        except CcpinError as error:
            yield name, "–", str(error)


def _singular(mechanism: Mechanism, curves: tuple[SingularCurve, ...]) -> str:
    if not curves:
        return paragraphs("No singular curve was met from 120 starts; the search is sampled.")
    if any(sliding(mechanism, name) for name in mechanism.independent):
        return paragraphs(f"{len(curves)} singular curves were met; they are drawn for two angles only.")
    return figure(plot_singularities(mechanism, curves), "Singular curves met from 120 starts; the search is sampled.")


def _atlas(mechanism: Mechanism, atlas: Atlas, curves: tuple[SingularCurve, ...], settings: ReportSettings) -> str:
    shares = ", ".join(f"{100 * getattr(atlas, f'{share}_fraction'):.2f} % {share}" for share in _SHARES)
    words = (
        f"The reference's branch in {len(atlas.lower)} boxes, edges halved up to {settings.depth} times: {shares} of "
        "the region of the coordinates. Certified is proved; empty is proved to hold no closed configuration, singular "
        "a singular one; undecided is neither proved nor refuted, and shrinks with more halving "
        "(`ccpin domain … --atlas --depth`)."
    )
    if not atlas.complete:
        words += " The map was interrupted; what it lacks is unreached."
    more = () if atlas.single_valued else ("Not single-valued: some shared faces of boxes are not glued.",)
    angles = not any(sliding(mechanism, name) for name in mechanism.independent)
    picture = mechanism.n == 2 and angles
    return paragraphs(words, *more) + (
        figure(plot_atlas(mechanism, atlas, curves), "The atlas; + is the reference.") if picture else ""
    )


def _slices(model: ReducedModel, settings: ReportSettings) -> str:
    mechanism = model.mechanism
    if not scalar(mechanism):
        words = (
            "Slices are drawn for coordinates stored as one number each; here some are not (continuous joints, balls)."
        )
        return paragraphs(words)
    pairs = list(combinations(range(mechanism.n), 2))[:_SLICES]
    words = (
        f"With {mechanism.n} independent coordinates there is no plane to draw an atlas in. Instead, slices through "
        "the reference: 1/κ(ψ_q′) over two coordinates, the others held, followed along lines from the middle. It is "
        f"sampled at {settings.grid} × {settings.grid} points, not proved; white is where σ was not reached."
    )
    return paragraphs(words) + figure(_slice_figure(model, pairs, settings.grid), "Slices through the reference (+).")


def _slice_figure(model: ReducedModel, pairs: list[tuple[int, int]], grid: int) -> Figure:
    mechanism = model.mechanism
    size = (3.5 * len(pairs) + 0.6, 3.5)
    with drawing(f"{mechanism.title}: 1/κ(ψ_q′) about the reference", size, **{"axes.grid": False}) as figure_:
        every = figure_.subplots(1, len(pairs), squeeze=False)[0]
        surveys = [survey(model, pair, grid) for pair in pairs]
        top = max(float(np.nanmax(values)) for _, _, values in surveys)
        for axes, pair, (x, y, values) in zip(every, pairs, surveys, strict=True):
            scale = [1.0 if sliding(mechanism, mechanism.independent[k]) else float(np.degrees(1.0)) for k in pair]
            image = axes.pcolormesh(
                scale[0] * x,
                scale[1] * y,
                values.T,
                cmap="viridis",
                vmin=0.0,
                vmax=top,
                shading="nearest",
                rasterized=True,
            )
            axes.plot(scale[0] * x[grid // 2], scale[1] * y[grid // 2], "+", color="white", markersize=10)
            words = [
                f"$q_{k + 1}$ ({mechanism.independent[k]}) [{'m' if s == 1.0 else '°'}]"
                for k, s in zip(pair, scale, strict=True)
            ]
            axes.set(xlabel=words[0], ylabel=words[1])
        figure_.colorbar(image, ax=list(every), label="1/κ(ψ_q′)", shrink=0.9)
    return figure_


def survey(model: ReducedModel, pair: tuple[int, int], grid: int) -> tuple[Array, Array, Array]:
    """1/κ(ψ_q′) over two coordinates about the reference.

    Args:
        model: With scalar coordinates.
        pair: Which two.
        grid: Points along a side; odd, so that the reference is one of them.

    Returns:
        Both coordinates (grid,) and 1/κ (grid, grid), NaN where σ was not reached: along a line from the middle, σ is
        followed until it fails.
    """
    grid += 1 - grid % 2
    q0 = model.alpha(model.mechanism.q_reference)
    axes = [_range(model.mechanism, k, float(q0[k]), grid) for k in pair]
    values = np.full((grid, grid), np.nan)
    middle = grid // 2

    def follow(start: State, fixed: int, order: range, along: int) -> Iterator[tuple[int, State]]:
        near = start
        for k in order:
            q = near.q.copy()
            q[pair[along]], q[pair[1 - along]] = axes[along][k], axes[1 - along][fixed]
            try:
                near = model.at(q, near)
            except CcpinError:
                return
            yield k, near

    centre = model.at(q0)
    row = {middle: centre}
    for order in (range(middle + 1, grid), range(middle - 1, -1, -1)):
        row.update(follow(centre, middle, order, 0))
    for i, state in row.items():
        values[i, middle] = state.rcond
        for order in (range(middle + 1, grid), range(middle - 1, -1, -1)):
            for j, reached in follow(state, i, order, 1):
                values[i, j] = reached.rcond
    return axes[0], axes[1], values


def _range(mechanism: Mechanism, k: int, middle: float, grid: int) -> Array:
    """A coordinate's values about the reference: ±60° or a quarter of the mechanism's size, within its limits."""
    name = mechanism.independent[k]
    half = 0.25 * mechanism.constraints().extent if sliding(mechanism, name) else float(_WIDEST)
    joint = mechanism.tree.joint(mechanism.tree.split(name)[0])
    if joint.kind.nv == 1 and joint.kind.nq == 1:
        low, high = (float(side[joint.q][0]) for side in mechanism.position_limits)
        half = min([half, *(abs(limit - middle) for limit in (low, high) if np.isfinite(limit) and limit != middle)])
    return np.asarray(middle + np.linspace(-half, half, grid))
