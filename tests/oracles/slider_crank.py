"""Offset slider-crank: the slider's stroke by Pythagoras, assembly mode with the slider right of the crank pin."""

import numpy as np

from .geometry import wrap

CRANK, ROD, OFFSET = 0.040, 0.120, -0.020
INDEPENDENT = ("crank",)
N_FREE = 3
RANK = 2
BOX = np.array([[-np.pi, np.pi]])  # the crank's full turn


def sigma(crank):
    """All joint displacements for a crank angle: the rod relative to the crank, the slider along x."""
    rise = OFFSET - CRANK * np.sin(crank)
    slider = CRANK * np.cos(crank) + np.sqrt(ROD**2 - rise**2)
    return {"crank": crank, "rod": wrap(np.arcsin(rise / ROD) - crank), "slider": slider}


def configuration(p):
    """The parameter is the crank's angle."""
    return sigma(p[0])
