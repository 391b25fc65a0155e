"""Claims about the rank of the regressor: forms against the regressor of floating point, and claims that are false."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.proof.facts import NotProvedError, prove
from tests.support.forces import FOUR_BAR, arm, read

pytest.importorskip("flint")
from ccpin.identification.combinations.identifiable import base_parameters
from ccpin.identification.combinations.rank_claims import IndependentColumns
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.identification.combinations.vanishing import identities
from ccpin.validated.arithmetic.balls import ball, flint
from tests.support.long_cases import later

BITS = 120


def floats(rows):
    return np.array([[float(x.mid()) for x in row] for row in rows])


SPRUNG = arm('<motor joint="j1"/>', j1='stiffness="5"', j2='stiffness="40"', j3='stiffness="2.5"')


def on_a_circle():
    """The five-bar with a joint whose angle is known up to whole turns, and can have no spring."""
    described = ccpin.load("rpdr").description
    joints = (replace(j, kind="continuous") if j.name == "joint3" else j for j in described.joints)
    return replace(described, joints=tuple(joints))


def test_friction_at_rest_is_of_either_sign(known):
    """Where no joint moves every friction between −c and c may be."""
    equations = known.facts[0].claim.equations
    forms = equations.forms([*_state(known)[: equations.loop.n_x], ball(0), ball(0)])
    entries = [x for row in forms[-2:] for x in row if x != 0 or not x.is_exact()]
    assert entries
    assert all(x.contains(0) and not x.is_exact() for x in entries)


@pytest.mark.parametrize(
    "described", ["rpdr", SPRUNG, FOUR_BAR, *later(None, "delta")], ids=["rpdr", "arm", "four_bar", "circle", "delta"]
)
def test_forms_are_read_off_the_regressor(described):
    """D_ij and g_i from Y at rest, B_ij and f_i from Y of dampers and friction at a velocity."""
    given = on_a_circle() if described is None else described
    mechanism = ccpin.load(read(given) if given in (SPRUNG, FOUR_BAR) else given)
    model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(1)
    state = model.at(model.coordinates.integrate(model.alpha(mechanism.q_reference), 0.1 * rng.normal(size=model.n)))
    v, rest, told, n = rng.normal(size=model.n), np.zeros(model.n), model.parameters, model.n
    with flint().ctx.workprec(BITS):
        equations, own = recorded_motions(model)
        box = [ball(value) for value in [*own.numbers(state.q_free).tolist(), *v.tolist()]]
        found = floats(equations.forms(box))
    assert equations.sizes["P"] == len(told)
    still = state.regressor(rest, rest)
    masses = np.stack([state.regressor(rest, e) - still for e in np.eye(n)], axis=1)
    dampers = np.stack([state.regressor(rest, rest, e) - still for e in np.eye(n)], axis=1)
    friction, upper = np.zeros_like(still), np.triu_indices(n)
    rubbing = told.of("friction")
    friction[:, rubbing] = state.regressor(v, rest)[:, rubbing]
    wanted = np.vstack([masses[upper], still, dampers[upper], friction])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.fixture(scope="module")
def known():
    """What is proved of the five-bar."""
    return base_parameters(ccpin.load("rpdr"), precision=200)


def test_what_is_proved_is_proved_again(known):
    """Both facts, from their data alone."""
    for fact in known.facts:
        assert fact.replay().digest == fact.digest


def changed(known, **arrays):
    """The claim of the minor with other arrays."""
    fact = known.facts[0]
    return replace(fact.claim, **{name: np.array(array) for name, array in arrays.items()}), fact.premises


def test_dependent_columns_are_refused(known):
    """A constant that moves with others, one twice, one without effect, a form twice."""
    claim, names = known.facts[0].claim, known.parameters.names
    columns, chosen = claim.columns.tolist(), claim.chosen.tolist()
    place = columns.index(names.index("mz:link1"))
    for other in ("mass:link1", "armature:joint1", "Iyy:link1"):
        wrong = [*columns]
        wrong[place] = names.index(other)
        false, premises = changed(known, columns=wrong)
        with pytest.raises(NotProvedError, match="minor"):
            prove(false, *premises)
    twice = [columns[1], *columns[1:]]
    for false, premises in (changed(known, columns=twice), changed(known, chosen=[chosen[1], *chosen[1:]])):
        with pytest.raises(NotProvedError, match="minor"):
            prove(false, *premises)


def test_a_minor_that_is_exactly_zero_is_refused(known):
    """A form of masses knows no damper."""
    false, premises = changed(known, chosen=[0], columns=[known.parameters.names.index("damping:joint1")])
    with pytest.raises(NotProvedError, match="minor"):
        prove(false, *premises)


def test_misshapen_claims_are_refused(known):
    """Constants and forms that are none, rows without a column, other closures, no premises."""
    claim, premises = known.facts[0].claim, known.facts[0].premises
    columns, chosen = claim.columns.tolist(), claim.chosen.tolist()
    count = len(known.parameters)
    per_state = len(claim.equations.forms(_state(known)))
    for wrong, message in (
        ({"columns": [count, *columns[1:]]}, "constant that is none"),
        ({"chosen": [per_state * len(premises), *chosen[1:]]}, "form that is none"),
        ({"columns": columns[1:]}, "rows along an axis"),
    ):
        with pytest.raises(NotProvedError, match=message):
            prove(changed(known, **wrong)[0], *premises)
    with pytest.raises(NotProvedError, match="form that is none"):
        prove(claim)
    with pytest.raises(NotProvedError, match="other equations"):
        prove(claim, *premises[:-1], known.facts[1])
    with pytest.raises(NotProvedError, match="rests on nothing"):
        prove(known.facts[1].claim, known.facts[1])


def _state(known):
    from ccpin.validated.flow.start_claim import state_of

    return state_of(known.facts[0].premises[0]).balls()


def test_combinations_that_structure_does_not_show_are_refused(known):
    """One that is none, and one twice; those that are chosen stand in echelon form, from the last on."""
    claim, found = known.facts[1].claim, known.facts[1].found["combinations"][0]
    assert found.shape == (len(claim.chosen), len(known.parameters))
    count = len(identities(claim.equations.bodies, claim.equations.ends, claim.equations.gravity))
    last = [int(np.flatnonzero(row)[-1]) for row in found]
    np.testing.assert_array_equal(found[:, last], np.eye(len(found)))
    with pytest.raises(NotProvedError, match="does not show"):
        prove(replace(claim, chosen=np.append(claim.chosen, count)))
    with pytest.raises(NotProvedError, match="depend on each other"):
        prove(replace(claim, chosen=np.append(claim.chosen, claim.chosen[:1])))


def test_nothing_is_claimed_of_nothing(known):
    """No columns: rank 0 at least."""
    equations, none = known.facts[0].claim.equations, np.zeros(0, dtype=np.int64)
    assert prove(IndependentColumns(equations, none, none, np.array([BITS])))


def test_equations_of_other_bodies_are_refused(known):
    """Bodies, closures and programs that do not fit each other."""
    equations = known.facts[0].claim.equations
    ahead = (equations.bodies[0]._replace(parent=1), *equations.bodies[1:])
    for wrong, message in (
        ({"bodies": equations.bodies[:-1]}, "motions of other bodies|closure of no body"),
        ({"bodies": ahead}, "before the one that carries it"),
        ({"bodies": list(equations.bodies)}, "could be changed"),
        ({"bodies": (None, *equations.bodies[1:])}, "bodies that are none"),
        ({"ends": (None,)}, "closures that are none"),
        ({"ends": (equations.ends[0]._replace(b=5),)}, "closure of no body"),
        ({"loop": None}, "no closures"),
        ({"motions": equations.loop.energies}, "other bodies"),
    ):
        with pytest.raises(NotProvedError, match=message):
            replace(equations, **wrong)
