"""One row of closures with a fold, and one with a cusp, that are known in closed form."""

from dataclasses import fields

import numpy as np

from ccpin.proof.chains import ClosureSystem
from ccpin.proof.equations import Closures
from tests.support.chains import X, Y, Z, chain, closures

NONE = np.zeros(3)


def equations_of(chains, size, independent, couplings):
    """φ of chains, and couplings in the same rows."""
    made = closures(chains, size, independent)
    given = {field.name: getattr(made, field.name) for field in fields(ClosureSystem)}
    couplings = np.array(couplings, dtype=float)
    chains, periodic = tuple(made.chains), made.periodic & ~np.any(couplings, axis=0)
    return Closures(ClosureSystem(**given | {"chains": chains, "couplings": couplings, "periodic": periodic}))


CIRCLE = equations_of([chain([(1, NONE, Z, False)], X[None], X)], 2, [0], [[-1.0, 0.0]])
"""φ = cos y − q: over q = 1 a fold at y = 0."""
SWALLOW = equations_of([chain([(2, NONE, Z, False), (0, NONE, X, True)], -Y[None], X)], 3, [0, 1], [[0.0, -1.0, 1.0]])
"""φ = y − (1 + q₀) sin y − q₁: at zero φ, φ_y and φ_yy vanish, φ_yyy = 1, and q₀ and q₁ unfold the cusp."""
