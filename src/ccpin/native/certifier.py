"""Certificates in the compiled core: Theorem N, Newton and gluing box by box, with the margins that NumPy's have.

The core finds what the searches in Python find, by the same steps, and checks the same inequalities; that the margins
hold for its own order of operations is proved in ``native/closures.hpp``. Which boxes are proved is the same but where
rounding decides, and every box passes `ccpin.proof.newton.verify`.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from ccpin.native import backend
from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.phasors import Phasors

if TYPE_CHECKING:
    from ccpin.native._core import Certifier


def compiled_core() -> ModuleType | None:
    """The compiled core, or ``None`` where NumPy is to do its work.

    Raises:
        InvalidInputError: As for `ccpin.backend`.
    """
    if backend().name == "numpy":
        return None
    import ccpin.native._core as core

    return core


def certifier(system: ClosureSystem, phasors: Phasors | None) -> Certifier | None:
    """The compiled core for closures, in their planar form where one is given; ``None`` where NumPy is to do the work.

    It is made once, immutable, and any number of threads may ask it at once.

    Raises:
        InvalidInputError: As for `ccpin.backend`.
    """
    core = compiled_core()
    if core is None or not system.m:
        return None
    made = _MADE.setdefault(system, {})
    planar = phasors is not None
    if planar not in made:
        made[planar] = _made(core, system, phasors)
    return made[planar]


def _made(core: ModuleType, system: ClosureSystem, phasors: Phasors | None) -> Certifier | None:
    try:
        made: Certifier = core.Certifier(numbers_of(system, phasors))
    except ValueError:  # data that are not orthonormal to rounding: NumPy's margins are wider
        return None
    return made


def numbers_of(system: ClosureSystem, phasors: Phasors | None) -> dict[str, Any]:
    """What the core needs to know of closures: the fields of `ClosureSystem` and `Phasors`, in plain numbers."""
    return {
        "independent": system.independent.tolist(),
        "dependent": system.dependent.tolist(),
        "periodic": system.periodic.astype(int).tolist(),
        "couplings": system.couplings,
        "offset": system.offset,
        "moduli": system.moduli,
        "scale": float(system.scale),
        "gamma": float(system.rounding),
        "chains": [_chain(chain) for chain in system.chains],
        "planar": phasors is not None,
        "phasors": () if phasors is None else tuple(np.asarray(value) for value in vars(phasors).values()),
    }


def _chain(chain: Chain) -> tuple[Any, ...]:
    """The fields of a chain, its 3×3 rotations one below the other."""
    joints, slides = chain.joints.tolist(), chain.prismatic.astype(int).tolist()
    placements = chain.rotations.reshape(-1, 3), chain.translations
    return joints, *placements, chain.axes, slides, chain.tip, bool(chain.direction), chain.weights


_MADE: WeakKeyDictionary[ClosureSystem, dict[bool, Certifier | None]] = WeakKeyDictionary()
