"""Figures of a log's residuals (over time, distribution, autocorrelation, against velocity), and of friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.identification.estimates.explained_efforts import Explained
from ccpin.identification.estimates.stribeck_friction import StribeckFriction
from ccpin.plotting.style import COLOURS, Figure, drawing

_LAGS, _BINS, _SHOWN = 60, 41, 5.0  # samples; bins; standard deviations at which outliers are drawn
_FAR = 20.0  # standard deviations: what is farther off sets no axis
_SURE = 1.96  # standard deviations: 95 % of Gaussian noise
_FALLEN = 4.0  # Stribeck speeds, at which friction has fallen
_USUAL = 1.4826  # of the median of |x|: the standard deviation of Gaussian noise


def efforts_figure(before: Explained, after: Explained) -> Figure:
    """Efforts of each coordinate, measured and by constants, and beside them the residuals."""
    n = len(after.names)
    with drawing("", (9.0, 2.6 * n)) as drawn:
        panels = drawn.subplots(n, 2, squeeze=False, sharex=True)
        for k, name in enumerate(after.names):
            left, right = panels[k]
            left.plot(after.t, after.measured[:, k], color=COLOURS[0], linewidth=0.8, label="measured")
            left.plot(after.t, after.told[:, k], color=COLOURS[1], linewidth=1.2, label="model")
            left.set(ylabel=f"effort at {name}")
            right.plot(before.t, before.left[:, k], color=COLOURS[2], linewidth=0.6, label="stated")
            right.plot(after.t, after.left[:, k], color=COLOURS[1], linewidth=0.6, label="taken")
            right.set(ylabel=f"residual at {name}")
            near = np.abs(after.left[:, k]) <= _FAR * _size(after.left[:, k])
            if not near.all():
                _within(left, after.measured[near, k], after.told[:, k])
                _within(right, before.left[near, k], after.left[near, k])
        for axes in panels[0]:
            axes.legend(loc="upper right", fontsize=8)
        for axes in panels[-1]:
            axes.set(xlabel="t [s]")
    return drawn


def residuals_figure(told: Explained) -> Figure:
    """Residuals of each coordinate's effort: their histogram, their autocorrelation, and against the velocity."""
    n = len(told.names)
    with drawing("", (9.0, 2.4 * n)) as drawn:
        panels = drawn.subplots(n, 3, squeeze=False)
        for k, name in enumerate(told.names):
            spread, chain, against = panels[k]
            size = _size(told.left[:, k])
            left = np.clip(told.left[:, k], -_SHOWN * size, _SHOWN * size)
            edges = np.linspace(-_SHOWN, _SHOWN, _BINS + 1)
            spread.hist(left / size, edges, density=True, color=COLOURS[1], alpha=0.6)
            spread.plot(edges, np.exp(-(edges**2) / 2.0) / np.sqrt(2.0 * np.pi), color=COLOURS[0], linewidth=1.2)
            spread.set(ylabel=name)
            correlations, band = autocorrelations(left), _SURE / np.sqrt(len(left))
            chain.axhspan(-band, band, color=COLOURS[0], alpha=0.2, linewidth=0.0)
            chain.vlines(np.arange(1, len(correlations) + 1), 0.0, correlations, color=COLOURS[1], linewidth=1.0)
            chain.set(ylim=(min(-0.3, correlations.min(initial=0.0)), max(0.3, correlations.max(initial=0.0))))
            against.plot(told.v[:, k], left, ".", color=COLOURS[1], markersize=1.5, rasterized=True)
        for axes, label in zip(
            panels[-1], ("residual, standard deviations", "lag, samples", "velocity, rad/s or m/s"), strict=True
        ):
            axes.set(xlabel=label)
        for axes, title in zip(panels[0], ("distribution", "autocorrelation", "against velocity"), strict=True):
            axes.set_title(title, fontsize=10)
    return drawn


def friction_figure(found: Sequence[StribeckFriction]) -> Figure:
    """Dry friction of joints against speed, with a band of two standard deviations."""
    with drawing("", (9.0, 2.6 * (-(-len(found) // 2)))) as drawn:
        panels = drawn.subplots(-(-len(found) // 2), 2, squeeze=False).ravel()
        for axes, each in zip(panels, found, strict=False):
            speed = np.linspace(0.0, _FALLEN * each.values[2], 200)
            level, off = each.level(speed)
            axes.fill_between(speed, level - 2.0 * off, level + 2.0 * off, color=COLOURS[1], alpha=0.25, linewidth=0.0)
            axes.plot(speed, level, color=COLOURS[1], linewidth=1.4)
            axes.axvspan(*each.interval, color=COLOURS[0], alpha=0.15, linewidth=0.0)
            axes.set(ylim=(0.0, None), xlabel=f"speed of {each.joint}", ylabel="dry friction")
        for axes in panels[len(found) :]:
            axes.set_axis_off()
    return drawn


def _size(left: Array) -> float:
    """Of residuals, outliers or not: the standard deviation of Gaussian noise of their median size."""
    return max(_USUAL * float(np.median(np.abs(left))), float(np.finfo(float).tiny))


def _within(axes: Any, *values: Array) -> None:
    """Have these fill the axes' height."""
    low, high = (float(end([end(part) for part in values])) for end in (np.min, np.max))
    axes.set(ylim=(1.05 * low - 0.05 * high, 1.05 * high - 0.05 * low))


def autocorrelations(values: Array) -> Array:
    """Σ x_i x_{i+k} / Σ x_i² of lags k = 1, 2, … up to sixty or a quarter of the samples."""
    centred = values - values.mean()
    power = max(float(centred @ centred), float(np.finfo(float).tiny))
    return np.array([centred[:-k] @ centred[k:] / power for k in range(1, min(_LAGS, len(values) // 4) + 1)])
