"""Matplotlib figures from results; every function returns the figure and writes nothing.

Matplotlib is imported when a figure is drawn, not before.
"""

from ccpin.plotting.atlases import plot_atlas, plot_radius_map, plot_singularities
from ccpin.plotting.motion import plot_configurations, plot_motion
from ccpin.plotting.sheets import plot_sheets
from ccpin.plotting.stability import plot_lyapunov, plot_sublevel
from ccpin.plotting.style import COLOURS, STYLE, save

__all__ = [
    "COLOURS",
    "STYLE",
    "plot_atlas",
    "plot_configurations",
    "plot_lyapunov",
    "plot_motion",
    "plot_radius_map",
    "plot_sheets",
    "plot_singularities",
    "plot_sublevel",
    "save",
]
__dir__ = __all__.copy
