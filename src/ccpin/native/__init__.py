"""The compiled core: the same numbers as the NumPy reference, a hundred times sooner.

`kernel(mechanism)` gives a `Kernel` (described in ``_core.pyi``) where the core is built, wanted and able, else
``None``. A kernel answers or declines (``None``); the reference then answers or explains, so results, refusals and
their words are the reference's either way. CCPIN_BACKEND=numpy or native in the environment chooses.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.native.specification import specification

if TYPE_CHECKING:
    from ccpin.native._core import Kernel
else:
    Kernel = object  # the class where the core is built; a name for annotations where it is not

VARIABLE = "CCPIN_BACKEND"


class Backend(NamedTuple):
    """What computes.

    Attributes:
        name: ``"native"`` or ``"numpy"``.
        reason: Why, in one line.
    """

    name: Literal["native", "numpy"]
    reason: str


def backend() -> Backend:
    """Which of the two cores is in use.

    Raises:
        InvalidInputError: CCPIN_BACKEND is neither ``numpy`` nor ``native``, or asks for a core that is not built.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted not in ("", "numpy", "native"):
        raise InvalidInputError(f"{VARIABLE} is '{wanted}'; it must be numpy or native")
    if wanted == "numpy":
        return Backend("numpy", f"{VARIABLE}=numpy")
    try:
        import ccpin.native._core as core
    except ImportError as error:
        reason = f"the compiled core is not built or does not load ({error}); a C++ compiler at install time makes it"
        if wanted == "native":
            raise InvalidInputError(f"{VARIABLE}=native, but {reason}") from error
        return Backend("numpy", reason)
    return Backend("native", f"compiled core {core.__file__}")


def kernel(mechanism: Mechanism | HasMechanism, gravity: Array | None = None) -> Kernel | None:
    """The compiled core for one mechanism, or ``None`` where NumPy is to do its work.

    It is made once, immutable, and any number of threads may ask it at once.

    Args:
        mechanism: From `ccpin.load`.
        gravity: In world axes, m/s², of shape (3,); default the mechanism's.

    Raises:
        InvalidInputError: As for `backend`.
    """
    found = core_of(mechanism_of(mechanism), gravity)
    return None if isinstance(found, Declining) else found


def core_of(mechanism: Mechanism, gravity: Array | None = None) -> Kernel | Declining:
    """What `kernel` gives, or why it gives none. Of one mechanism those of the last few gravities are kept."""
    used = backend()
    if used.name == "numpy":
        return Declining(used.reason)
    made = _MADE.setdefault(mechanism, OrderedDict())
    pull = np.array(mechanism.description.gravity if gravity is None else gravity, dtype=np.float64)
    found = made.pop(pull.tobytes(), None) or _made(mechanism, pull)
    made[pull.tobytes()] = found
    if len(made) > _KEPT:
        made.popitem(last=False)
    return found


def _made(mechanism: Mechanism, gravity: Array) -> Kernel | Declining:
    import ccpin.native._core as core

    try:
        return core.Kernel(specification(mechanism, gravity))
    except (UnsupportedMechanismError, ValueError) as error:
        return Declining(f"the compiled core has no such mechanism: {error}")


class Declining:
    """A kernel that answers nothing, for where there is none.

    Args:
        reason: Why there is none.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name.startswith("__"):
            raise AttributeError(name)
        return _declined


def _declined(*_: object, **__: object) -> None:
    return None


_KEPT = 4  # kernels a mechanism, each of a pull of gravity of its own: those used last
_MADE: WeakKeyDictionary[Mechanism, OrderedDict[bytes, Kernel | Declining]] = WeakKeyDictionary()
