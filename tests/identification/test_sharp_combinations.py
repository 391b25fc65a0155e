"""What claims about identification are about, at its edges: sensors, and joints that can have no spring."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.proof.facts import NotProvedError

pytest.importorskip("flint")
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.validated.arithmetic.balls import ball, flint


def test_sensors_are_counted_in_whole_numbers():
    """Of virtual motions there are 0 at least; the world is held, or it is not."""
    with flint().ctx.workprec(53):
        equations, _ = recorded_motions(ccpin.ReducedModel(ccpin.load("four_bar")))
    for wrong in ({"virtual": False}, {"virtual": -1}, {"held": 0}):
        with pytest.raises(NotProvedError, match="sensors that are none"):
            replace(equations, **wrong)
    assert replace(equations).digest == equations.digest


@pytest.mark.slow
def test_a_floating_base_has_no_spring():
    """Its constants are 13, and D, g and the dampers are the regressor's there, too."""
    afloat = ccpin.ReducedModel(ccpin.load("four_bar", floating_base=True))
    q = afloat.alpha(afloat.mechanism.q_reference)
    state, told, n = afloat.at(q), afloat.parameters, afloat.n
    rest = np.zeros(n)
    with flint().ctx.workprec(120):
        equations, own = recorded_motions(afloat)
        found = equations.forms([ball(x) for x in [*own.numbers(state.q_free).tolist(), *rest.tolist()]])
        rows = np.array([[float(x.mid()) for x in row] for row in found])
    assert [len(body.kinds) for body in equations.bodies] == [3, 5, 5, 5]
    assert equations.sizes["P"] == len(told)
    still = state.regressor(rest, rest)
    masses = np.stack([state.regressor(rest, e) - still for e in np.eye(n)], axis=1)
    dampers = np.stack([state.regressor(rest, rest, e) - still for e in np.eye(n)], axis=1)
    wanted = np.vstack([masses[np.triu_indices(n)], still, dampers[np.triu_indices(n)]])
    np.testing.assert_allclose(rows[: len(wanted)], wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
