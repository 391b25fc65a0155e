"""What measured closure forces and the base's wrench add: against Pinocchio's inverse dynamics of the tree."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.dynamics.parameters import BODY
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError

pytest.importorskip("flint")
from ccpin.identification import base_parameters
from ccpin.identification.combinations.exact_spaces import doubles
from ccpin.identification.combinations.identifiable import _closed_states
from ccpin.identification.combinations.rank_claims import stacked_forms
from ccpin.identification.combinations.recorded_twists import recorded_motions
from ccpin.validated.arithmetic.balls import flint
from tests.support.forces import FOUR_BAR, arm, read
from tests.support.long_cases import later

ANKLE = "docs/howto/ankle.urdf"
SPRUNG = arm('<motor joint="j1"/>', j1='stiffness="5"', j2='stiffness="40"', j3='stiffness="2.5"')


def measured(model, rng):
    """Columns of [u on q; λ; the wrench that holds the world] by each constant, at a random state."""
    tree, start, n = model.mechanism.tree, model.alpha(model.mechanism.q_reference), model.n
    step = 0.2 * rng.normal(size=n)
    for _ in range(9):
        try:
            state = model.at(model.coordinates.integrate(start, step))
            break
        except CcpinError:
            step *= 0.5
    v, a = rng.normal(size=(2, n))
    v_free, a_free = state.rho @ v, state.rho @ a + state.rho_dot(v) @ v
    empty = tree.model.copy()
    empty.gravity.linear = model.gravity_vector
    empty.armature = np.zeros(empty.nv)
    for k in range(empty.njoints):
        empty.inertias[k] = pin.Inertia.Zero()
    jacobian = model.parametrization.constraints.value(state.q_free).jacobian
    psi = np.vstack([jacobian, model.coordinates.jacobian(state.q_free)])
    columns = []

    def told(effort, wrench):
        both = np.linalg.solve(psi.T, effort)
        columns.append(np.concatenate([both[len(jacobian) :], both[: len(jacobian)], wrench]))

    for joint in tree.joints:
        for k in range(BODY):
            unit = np.eye(BODY)[k] + np.eye(BODY)[0] * (k > 0)  # Pinocchio takes levers, which only a mass has
            empty.inertias[joint.number] = pin.Inertia.FromDynamicParameters(unit)
            data = empty.createData()
            effort = pin.rnea(empty, data, state.q_free, v_free, a_free)
            pin.forwardKinematics(empty, data, state.q_free)
            roots = [j.number for j in tree.joints if j.parent == 0]
            told(effort, sum(data.oMi[number].act(data.f[number]).vector for number in roots))
            if k:
                columns[-1] = columns[-1] - columns[-1 - k]
        empty.inertias[joint.number] = pin.Inertia.Zero()
    for name, kind in zip(model.parameters.names, model.parameters.kinds, strict=True):
        if name.partition(":")[0] in ("armature", "damping", "friction", "stiffness", "offset"):
            rows, effort = tree.joint(name.partition(":")[2]).v, np.zeros(len(v_free))
            stretch = pin.difference(tree.model, pin.neutral(tree.model), state.q_free)
            acts = {"armature": a_free, "damping": v_free, "friction": np.sign(v_free), "stiffness": stretch}
            effort[rows] = acts[kind][rows] if kind in acts else -1.0
            told(effort, np.zeros(6))
    return np.array(columns).T


def of_sensors(model, forces, base):
    """Which rows of `measured` the sensors see."""
    slices, n = model.parametrization.constraints.row_slices(), model.n
    rows = [*range(n), *(n + k for name in forces for k in range(slices[name].start, slices[name].stop))]
    m = model.parametrization.constraints.size
    return rows + [n + m + k for k in range(6) if base]


@pytest.mark.parametrize(
    "described",
    [FOUR_BAR, *later(SPRUNG, "rpdr", ANKLE, "slider_crank")],
    ids=["bar", "arm", "rpdr", "ankle", "slider"],
)
def test_what_sensors_see(described):
    """Combinations by structure are in none of their rows, and forms have the rank of these."""
    model = ccpin.ReducedModel(ccpin.load(read(described) if described in (FOUR_BAR, SPRUNG) else described))
    rng, every = np.random.default_rng(1), tuple(model.parametrization.constraints.row_slices())
    whole = [measured(model, rng) for _ in range(24)]
    size = np.abs(whole).max(axis=(0, 1)) + 1e-9
    for forces, base in ((every[:1], False), ((), True), (every, True)):
        with flint().ctx.workprec(120):
            equations, own = recorded_motions(model, forces, base)
            forms = stacked_forms(equations, _closed_states(model, equations, own, 9, 120))
        seen = np.vstack([each[of_sensors(model, forces, base)] for each in whole])
        z = doubles(equations.identities)
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        assert np.abs(seen @ z.T).max() < 1e-10 * np.abs(seen).max()
        found = np.array([[float(x.mid()) for x in row] for row in forms])
        ranks = [np.linalg.matrix_rank(rows / size, tol=1e-11) for rows in (seen, found)]
        assert ranks[0] == ranks[1] <= len(size) - np.linalg.matrix_rank(z, tol=1e-9)


def test_what_they_add_is_told():
    """One combination: a mass on the pin belongs to either rod unless its force is measured."""
    told = base_parameters(ccpin.load("four_bar"), forces=["pin"], base=True)
    assert told.added["pin"] == (1, 1)
    least, most = told.added["base"]
    assert 0 < least == most
    assert told.lower == told.within == 21 + 1 + least < told.upper
    assert "pin adds 1" in told.reason
    assert f"base adds {least}" in told.reason
    assert pickle.loads(pickle.dumps(told)).replay().added == told.added
    for fact in told.facts:
        assert fact.replay().digest == fact.digest
    with pytest.raises(TypeError):
        told.added["pin"] = (0, 0)


def test_sensors_that_are_none_are_told():
    with pytest.raises(InvalidInputError, match="forces"):
        base_parameters(ccpin.load("four_bar"), forces=["rod"])
    with pytest.raises(UnsupportedMechanismError, match="repeat one another"):
        base_parameters(ccpin.load("bennett"), forces=["joint4"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "forces", "counts"),
    [
        (ANKLE, ["left_heel", "right_heel"], (75, 75)),
        ("stewart", [f"ball{k}" for k in range(2, 7)], (225, 225)),
        ("rpdr", ["end_effector"], (41, 43)),
    ],
)
def test_the_others(name, forces, counts):
    """What is proved of models that come with ccpin, with all forces and the base's wrench."""
    told = base_parameters(ccpin.load(name), forces=forces, base=True)
    assert (told.lower, told.upper) == counts
    assert all(told.added[each] == (1, 1) for each in forces)
