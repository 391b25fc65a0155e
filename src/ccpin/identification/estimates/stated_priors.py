"""What is known of constants before any log: each is what the model states, give or take a standard deviation.

A deviation is a number in the constant's own unit, or a share, ``"5 %"``: of the stated value of a joint's constant,
and of a body's by what no number of that body can be larger than, since its pseudo-inertia is positive,

    m for its mass,    √(m s) for first moments,    s = ½ tr I for moments and products of inertia,

for a CAD's error of a product of inertia is a share of the body's inertia, not of a product that may be zero.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, instance, positive
from ccpin.description.names import choices
from ccpin.dynamics.changed_constants import bodies
from ccpin.dynamics.parameters import KINDS, DynamicParameters
from ccpin.errors import InvalidInputError

_SHARE = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*%\s*")


class Prior(NamedTuple):
    """Of which constants something is known: where they stand, and its standard deviation in their units, (K,) each."""

    columns: Indices
    deviations: Array


def stated_prior(parameters: DynamicParameters, columns: Indices, prior: object) -> Prior:
    """What is known of the constants that are looked for; what is said of a name outweighs what is said of its kind.

    Raises:
        InvalidInputError: No mapping, a name or kind that is not looked for, a deviation that is not positive, or a
            share of nothing.
    """
    told = {} if prior is None else dict(instance(prior, "prior", Mapping, "a mapping of names to deviations"))
    looked_for = dict.fromkeys(columns.tolist())
    found: dict[int, float] = {}
    for name in sorted(told, key=lambda each: each in parameters.names):
        if name in parameters.names:
            places = [parameters.names.index(name)]
        elif name in ("inertia", *KINDS):
            places = parameters.of(name).tolist()
        else:
            raise InvalidInputError(f"prior: '{name}' is no constant; {choices(name, (*KINDS, *parameters.names))}")
        places = [k for k in places if k in looked_for]
        if not places:
            raise InvalidInputError(f"prior: '{name}' is not among the constants that are looked for")
        for k in places:
            size = _size(parameters, k)
            if isinstance(told[name], str) and not size:
                raise InvalidInputError(
                    f"prior: '{parameters.names[k]}' is stated as nothing, of which {told[name]!r} is no deviation; "
                    f"state it in {parameters.units[k]}"
                )
            found[k] = deviation(told[name], size, "prior", parameters.names[k])
    order = sorted(found)
    return Prior(np.array(order, dtype=np.intp), np.array([found[k] for k in order]))


def deviation(told: object, size: float, whose: str, name: str) -> float:
    """A standard deviation as it is said of a name: a number, or a share of a size.

    Raises:
        InvalidInputError: It is neither, or not positive.
    """
    share = _SHARE.fullmatch(told) if isinstance(told, str) else None
    if isinstance(told, str) and share is None:
        raise InvalidInputError(f"{whose}: {told!r} of '{name}' is neither a number nor a share such as '5 %'")
    return positive(told if share is None else float(share[1]) / 100.0 * size, f"{whose}: the deviation of '{name}'")


def _size(parameters: DynamicParameters, place: int) -> float:
    """What a share is a share of."""
    for body in bodies(parameters):
        if body.start <= place < body.stop:
            m, s = abs(parameters.values[body.start]), abs(parameters.values[body][[4, 6, 9]].sum()) / 2.0
            return float((m, np.sqrt(m * s), s)[(place > body.start) + (place > body.start + 3)])
    return float(abs(parameters.values[place]))
