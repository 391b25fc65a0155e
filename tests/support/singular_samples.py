"""Singular configurations from closed forms, and which of them covers of all curves have not."""

import numpy as np

from tests.oracles import five_bar as oracle
from tests.oracles import planar_3rpr as three_legs
from tests.oracles import rpdr as paper
from tests.support.five_bars import in_tree_order
from tests.support.legs import LEG1

RPDR = oracle.FiveBar(paper.A1, paper.A2, paper.A3, paper.A4, paper.C)
SLICE = np.array([[0.168, 0.247], [0.192, 0.271]])  # of the 3-RPR, with a cusp
CROSSING = oracle.FiveBar(0.2, 0.3, 0.2, 0.3, 0.4)  # a₃ + a₄ = c + a₂ − a₁: the fold crosses itself at q = 0


def within(q, region):
    """Which points lie in a region."""
    return np.all((q >= region[0]) & (q <= region[1]), axis=1)


def missed(cover, q_free):
    """How many configurations are on no curve and in no box."""
    off = cover.curve_of(q_free) < 0
    return int(np.count_nonzero(~cover.is_uncovered(q_free[off])))


def of_five_bar(mechanism, bar, count, seed, region=None):
    """Singular configurations from the closed form, in the mechanism's order, over a region of q."""
    found = oracle.singular_configurations(bar, count, np.random.default_rng(seed))
    assert oracle.closing_error(bar, found).max() < 1e-12
    return in_tree_order(mechanism, found if region is None else found[within(found[:, :2], region)])


def of_slice(count, seed, region):
    """Singular configurations of the 3-RPR's slice over a region, in the tree's order, from its closed form."""
    alpha, phi = three_legs.singular_poses(LEG1, count, np.random.default_rng(seed)).T
    second, third = three_legs.legs(LEG1, alpha, phi)
    found = [alpha, phi - alpha, np.angle(second), np.abs(second), np.angle(third), np.abs(third)]
    return np.column_stack(found)[within(np.abs(np.column_stack([second, third])), region)]
