"""How far dependent slides can go, as the loops they are in leave them.

**Lemma.** Let a closure's point rows read Σ_c W_c x_c + d = 0, let one chain c begin with slides s_i along a_i (some of
them dependent ones), and let no other dependent slide enter these rows. With U the columns W_c a_i of the dependent
ones and |1 − UᵀU| having row sums of at most ε < 1, each of them is, in every closed configuration, at most
(|d| + Σ of the lengths, as W sees them, of all segments of all chains but these slides)/√(1 − ε).

*Proof.* Us is minus the sum of d and of what W sees of those segments, and |Us|² ≥ (1 − ε)|s|². ∎
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.closures import exact
from ccpin.auditing.document import Array, Integers
from ccpin.auditing.lengths import root_of, size_of
from ccpin.auditing.reach import Group, Reach, above

_TURN = np.pi + 1e-9
_WIDER = 1e-12  # than the region: cells' corners are rounded


def bounds_of(reach: Reach, sliding: Integers) -> Array:
    """How far each coordinate may be from zero, over the region; a dependent turn π, a slide of no such chain ∞."""
    document, slides = reach.document, set(sliding.tolist())
    bounds = np.full(reach.closures.n_free, _TURN)
    bounds[sliding] = np.inf
    bounds[document.independent] = np.maximum(np.abs(document.lower), np.abs(document.upper)) * (1.0 + _WIDER) + _WIDER
    for group in reach.groups:
        inside = {int(j) for k in group.chains for j in document.chains[k].joints} & slides
        for number in group.chains if inside else ():
            chain = document.chains[number]
            leading = int(np.argmin(np.append(chain.prismatic, False)))
            own = [k for k in range(leading) if int(chain.joints[k]) in slides]
            if {int(chain.joints[k]) for k in own} == inside:
                found = _bound(reach, group, number, own, bounds)
                bounds[sorted(inside)] = np.minimum(bounds[sorted(inside)], found)
    return bounds


def _bound(reach: Reach, group: Group, number: int, own: list[int], bounds: Array) -> float:
    """The lemma for the slides `own` with which a chain of a group begins."""
    path, rotation, columns = reach.closures.paths[number], exact(np.eye(3)), []
    for k in range(max(own) + 1):
        rotation = rotation * path.turns[k].rotation
        columns.append(path.weights * (rotation * path.turns[k].axis))
    U = arb_mat([[columns[k][i, 0] for k in own] for i in group.rows])
    square = U.transpose() * U
    apart = [sum((abs(square[i, j] - int(i == j)) for j in range(len(own))), arb(0)) for i in range(len(own))]
    least = 1 - max(apart, key=lambda x: float(x.upper()))
    if not least > 0:
        return np.inf
    total = size_of(arb_mat([[reach.closures.offset[row, 0]] for row in group.rows]))
    for other in group.chains:
        segments = reach.segments[other]
        total += segments[-1].before[0]
        for k, turn in enumerate(reach.closures.paths[other].turns):
            total += segments[k].before[0]
            if turn.prismatic and not (other == number and k in own):
                total += arb(float(bounds[turn.joint])) * segments[k].along[0]
    return above(total / root_of(least))
