"""The compiled core gives the reference's numbers and refuses what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import ccpin
from ccpin import LoopClosure, MechanismDescription, native
from ccpin.description import CLOSURE_KINDS, Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.description.closure_kinds import GAP, Fixed, LoopRows, Product, X, Y, Z
from ccpin.dynamics.wrenches import wrench_rows
from ccpin.simulation.results.forces import _Bearings, _LoadCase
from tests.support import agreement
from tests.support.agreement import (
    allowed,
    differences,
    random_states,
    random_wrenches,
    reference_model,
    refused,
    relative,
)
from tests.support.long_cases import later
from tests.support.places import MODELS, SHARED
from tests.support.strategies import mechanisms, rigid

pytestmark = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")
THEIRS = (
    "four_bar.urdf",
    "mini_cheetah_leg.urdf",
    "cassie_like",
    "digit_like",
    "cassie_closed_chain.xml",
    "5bar_linkage_iso3d",
)
FILES = [*sorted(MODELS.glob("*.urdf")), *(SHARED / name for name in THEIRS)]
LONG = ("hexa", "stewart")
QUICK = [pytest.param(path, marks=pytest.mark.slow) if path.stem in LONG else path for path in FILES]
seeds = st.integers(0, 2**32 - 1)


def assert_same(model, kernel, q, rng, near=None):
    """Every quantity of both cores within its allowance."""
    apart = [d for d in differences(model, kernel, q, rng, near) if not d.relative <= d.allowed]
    assert not apart, apart


def compare_states(path, count):
    """Both cores at random states of a model; at least half must be states the reference accepts."""
    mechanism = ccpin.load(path)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(7)
    for q in random_states(model, rng, count):
        if refused(model, q):
            assert kernel.sigma(q) is None
        else:
            assert_same(model, kernel, q, rng)


@pytest.mark.parametrize("states", later(4, 12))
@pytest.mark.parametrize("path", QUICK, ids=[path.stem for path in FILES])
def test_models(path, states):
    """Every model that comes with ccpin, and those of others, at random states from near the reference to far."""
    if not path.exists():
        pytest.skip(f"no {path}: these files belong to others")
    compare_states(path, states)


@pytest.mark.parametrize("name", ["g", "acceleration", "da_dq"])
def test_an_error_that_is_no_rounding_is_seen(name, monkeypatch):
    """An error of 4e-12 at every state is not taken for rounding errors."""
    mechanism, native_ones = ccpin.load("sarrus"), agreement._native

    def altered(*arguments):
        yield from ((n, np.asarray(value) * (1.0 + 4e-12 * (n == name))) for n, value in native_ones(*arguments))

    monkeypatch.setattr(agreement, "_native", altered)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(1)
    found = differences(model, kernel, np.array([0.2]), rng)
    assert [one.name for one in found if one.relative > one.allowed] == [name]


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_models_thoroughly(path):
    """The same at 1,000 states each."""
    if not path.exists():
        pytest.skip(f"no {path}: these files belong to others")
    compare_states(path, 1000)


def sprung(path):
    """A model whose joints all have dampers, the plain ones springs, and the motors gears."""
    plain = ccpin.load(path)
    joints = {}
    for k, joint in enumerate(plain.tree.joints):
        joints[joint.name] = {"damping": 0.1 + 0.05 * k}
        if not joint.kind.unit:
            joints[joint.name] |= {"stiffness": 0.5 + 0.2 * k, "spring_reference": 0.3 * k - 0.4}
    whole = [name for name in plain.actuated if ":" not in name]
    return ccpin.load(path, joints=joints, motors={name: {"gear": 2.0 - 1.5 * k} for k, name in enumerate(whole)})


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.urdf")), ids=lambda path: path.stem)
@pytest.mark.parametrize("states", later(3, 8))
def test_springs_dampers_and_gears(path, states):
    """Every quantity with springs in V, ρᵀBρ q̇ on the left and gears in S."""
    mechanism = sprung(path)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(11)
    assert kernel is not None
    for q in random_states(model, rng, states, size=0.1):
        if not refused(model, q):
            assert_same(model, kernel, q, rng)


@pytest.mark.parametrize("actuated", [("actuated1", "passive1"), ("passive1", "passive2")])
def test_motors_on_dependent_joints(rpdr, actuated):
    """S is not the identity: ρᵀSᵀu, λ and the derivatives by u."""
    names = [joint.name for joint in rpdr.description.joints if joint.name in rpdr.tree.names]
    chosen = [names[k] for k in ((0, 1) if actuated[0] == "actuated1" else (1, 3))]
    mechanism = ccpin.load("rpdr", actuated=chosen)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(3)
    for q in random_states(model, rng, 10):
        if not refused(model, q):
            assert_same(model, kernel, q, rng)


@pytest.mark.parametrize("name", ["stewart", "hexa"])
def test_components_as_coordinates(name):
    """Components of the platform's own joint as independent coordinates, where the file has one, else the legs'."""
    mechanism = ccpin.load(name)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(5)
    for q in random_states(model, rng, 8, size=0.05):
        if not refused(model, q):
            assert_same(model, kernel, q, rng)


ANY_ROWS = {
    "slot": ((Product(1.0, Fixed("A", Y), GAP),), (Product(1.0, Fixed("A", Z), GAP),)),
    "weighted": ((Product(-2.5, GAP, Fixed("B", Y + Z)),),),
    "two forms": ((Product(1.0, Fixed("A", Y), GAP), Product(0.3, Fixed("B", X), Fixed("A", Y))),),
    "squares": ((Product(0.7, GAP, GAP), Product(-0.7, Fixed("C", 0.4 * Y), Fixed("C", 0.4 * Y))),),
    "of C": ((Product(1.0, Fixed("C", X + Y), Fixed("A", Y)), Product(0.5, Fixed("B", Z + Y), Fixed("C", X))),),
    "of A": ((Product(2.0, Fixed("B", X), Fixed("B", Y)), Product(0.5, Fixed("A", X + Z), Fixed("B", X))),),
}


@pytest.mark.parametrize("name", ANY_ROWS)
def test_a_new_closure_kind(name, monkeypatch):
    """Rows of whatever products: a kind the core never heard of between two arms that move in space."""
    monkeypatch.setitem(CLOSURE_KINDS, "odd", lambda closure, normal: LoopRows(ANY_ROWS[name]))
    rng = np.random.default_rng(2)
    joints, parents = [], ["base", "l0", "l1", "base", "l3", "l4"]
    for k, parent in enumerate(parents):
        axis = rng.normal(size=3)
        placement = rigid(Rotation.random(random_state=k).as_matrix(), rng.uniform(-0.3, 0.3, 3))
        joints.append(Joint(f"j{k}", "revolute", parent, f"l{k}", placement, axis / np.linalg.norm(axis)))
    links = [Link("base"), *(Link(f"l{k}", Inertia(1.0, rng.normal(size=3) / 9, 0.02 * np.eye(3))) for k in range(6))]
    ends = [rigid(Rotation.random(random_state=k).as_matrix(), rng.uniform(-0.2, 0.2, 3)) for k in (8, 9)]
    loop = LoopClosure("odd", "odd", "l2", "l5", *ends)
    mechanism = ccpin.load(MechanismDescription("arms", "base", tuple(links), tuple(joints), (loop,)))
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(1)
    for q in random_states(model, rng, 4, size=0.1):
        if refused(model, q):
            assert kernel.sigma(q) is None
        else:
            assert_same(model, kernel, q, rng)


def coupled(drawn, seed):
    """A drawn mechanism with a polynomial coupling between two of its 1-dof joints that holds at its reference."""
    rng, description = np.random.default_rng(seed), drawn.description
    plain = [joint for joint in description.joints if joint.kind in ("revolute", "continuous", "prismatic")]
    if len(plain) < 2:
        return description
    terms = []
    for k in rng.permutation(len(plain))[:2]:
        reference = float(description.reference[plain[k].name][0])
        ratio = float(rng.choice([-2.0, -0.5, 1.0, 1.5]))
        powers = () if plain[k].kind == "continuous" else tuple(rng.normal(scale=0.3, size=2))
        terms.append(CouplingTerm(plain[k].name, (0.0, ratio, *powers), reference))
    return replace(description, couplings=(Coupling("gear", tuple(terms)),))


def loaded(description):
    """A mechanism, or nothing where the coupling leaves no motion or no closed pose."""
    try:
        mechanism = ccpin.load(description)
    except ccpin.errors.CcpinError:
        assume(False)
    assume(mechanism.n > 0)
    return mechanism


def compare_random(mechanism, seed):
    """A few states from the reference on, and the same refusals."""
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(seed)
    assert kernel is not None
    for q in random_states(model, rng, 3, size=0.2):
        if refused(model, q):
            assert kernel.sigma(q) is None
            continue
        assume(model.at(q).rcond > 1e-6)
        assert_same(model, kernel, q, rng)
        assert_same(model, kernel, q, rng, model.sigma(q))


@settings(max_examples=6)
@given(mechanisms(), seeds)
def test_random_mechanisms(drawn, seed):
    """Trees, loops and closures of every kind, joints of every kind."""
    compare_random(ccpin.load(drawn.description), seed)


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(mechanisms(), seeds)
def test_random_mechanisms_thoroughly(drawn, seed):
    """The same for two hundred of them."""
    compare_random(ccpin.load(drawn.description), seed)


@pytest.mark.slow
@settings(max_examples=12)
@given(mechanisms(), seeds)
def test_random_couplings(drawn, seed):
    """The same with a coupling, polynomial or on a circle."""
    compare_random(loaded(coupled(drawn, seed)), seed)


@pytest.mark.slow
@settings(max_examples=4)
@given(mechanisms(), seeds)
def test_random_coordinates(drawn, seed):
    """The same with single components of joints as independent coordinates, wherever a set of them can be."""
    mechanism = ccpin.load(drawn.description)
    names = [n for n in ccpin.kinematics.coordinates.component_names(mechanism.tree) if ":" in n]
    assume(names)
    rng = np.random.default_rng(seed)
    others = [name for name in ccpin.kinematics.coordinates.component_names(mechanism.tree) if name not in names]
    for _ in range(6):
        chosen = [str(n) for n in rng.permutation([*names, *others])[: mechanism.n]]
        try:
            mechanism = ccpin.load(drawn.description, independent=chosen)
        except ccpin.errors.CcpinError:
            continue
        compare_random(mechanism, seed)
        return
    assume(False)


def compare_bearings(model, kernel, rng, states):
    """What closures and joints carry, pushed links included, in both cores."""
    for q in states:
        if refused(model, q):
            continue
        state, v, u = model.at(q), rng.normal(size=model.n), rng.normal(size=model.n_actuated)
        pushed = random_wrenches(model, rng)
        numbers = kernel.bearing_forces(state.q_free, v, u, None, wrench_rows(model.mechanism.tree, pushed))
        bearings = _Bearings(model)
        for found, theirs in zip(numbers, (bearings.of_closures, bearings.of_joints), strict=False):
            loads = theirs(state, _LoadCase(v, u, pushed, None))
            limit = allowed("constraint_forces", 1.0 / state.rcond, float(np.linalg.cond(state.D)), 0.0)
            assert relative(found, loads.wrench) <= 10 * limit
        assert relative(numbers[2][1:, :3, 3], bearings.of_joints(state, _LoadCase(v, u, pushed, None)).point) <= 1e-12


@pytest.mark.parametrize("states", later(2, 6))
@pytest.mark.parametrize("path", QUICK, ids=[path.stem for path in FILES])
def test_bearings(path, states):
    """Newton and Euler over the clusters give what they give body by body, on every model."""
    if not path.exists():
        pytest.skip(f"no {path}: these files belong to others")
    mechanism = ccpin.load(path)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(13)
    compare_bearings(model, kernel, rng, random_states(model, rng, states))


@pytest.mark.slow
@settings(max_examples=10)
@given(mechanisms(), seeds)
def test_bearings_of_random_mechanisms(drawn, seed):
    """The same for trees, loops and closures of every kind."""
    mechanism = ccpin.load(drawn.description)
    model, kernel, rng = reference_model(mechanism), native.kernel(mechanism), np.random.default_rng(seed)
    assume(mechanism.n > 0 and not refused(model, model.alpha(mechanism.q_reference)))
    assume(model.at(model.alpha(mechanism.q_reference)).rcond > 1e-6)
    compare_bearings(model, kernel, rng, random_states(model, rng, 2, size=0.05))
