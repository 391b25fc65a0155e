"""Closed-chain descriptions written by others: they load, with known mobility, and move as Pinocchio says."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description import read_description
from ccpin.mechanism.motion.mobility import null_space
from ccpin.mechanism.poses.loop_closing import close
from tests.oracles import descriptor
from tests.support.places import SHARED

FOLDER = SHARED
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no {FOLDER}: these files belong to others")


class Counts(NamedTuple):
    """What was computed of a model apart from ccpin; no motors where the file states none."""

    n_free: int
    nq: int
    rank: int
    mobility: int
    motors: int | None
    idle: int


TABLE = {
    "four_bar.urdf": Counts(3, 3, 2, 1, None, 0),
    "mini_cheetah_leg.urdf": Counts(6, 12, 3, 3, None, 0),
    "5bar_linkage_iso3d": Counts(5, 5, 3, 2, 2, 0),
    "cassie_like": Counts(19, 19, 12, 7, 5, 2),
    "digit_like": Counts(27, 27, 18, 9, 6, 3),
    "cassie_closed_chain.xml": Counts(32, 35, 10, 22, None, 2),
}
SAMPLES = 100
every_model = pytest.mark.parametrize("name", TABLE)


@cache
def mechanism(name):
    return ccpin.load(FOLDER / name, free=["all"])


@cache
def reduced_model(name):
    return ccpin.ReducedModel(mechanism(name))


@cache
def closed_configurations(name, count):
    """Random steps of up to 0.25 along allowed velocities, each closed again; nonsingular ones are kept."""
    loaded, generator = mechanism(name), np.random.default_rng(42)
    constraints, parametrization = loaded.constraints(), loaded.parametrization()
    here, found = loaded.q_reference, []
    for _ in range(20 * count):
        basis = null_space(constraints, here, loaded.mobility.rank)
        direction = basis @ generator.standard_normal(basis.shape[1])
        step = generator.uniform(0.05, 0.25) * direction / np.linalg.norm(direction)
        attempt = close(constraints, pin.integrate(loaded.pin_model, here, step))
        if not attempt.closed or not constraints.aligned(attempt.q_free):
            continue
        if parametrization.rcond(attempt.q_free) < 1e-5:
            here = loaded.q_reference
            continue
        here = attempt.q_free
        found.append(here)
        if len(found) == count:
            return found
    raise AssertionError(f"{name}: only {len(found)} configurations")


@every_model
def test_the_counts_are_those_of_the_table(name):
    """n′, nq, rank, mobility, motors and idle rods equal what was computed independently."""
    loaded, analysis = mechanism(name), mechanism(name).mobility
    motors = None if loaded.description.actuated is None else len(loaded.actuated)
    found = Counts(loaded.n_free, loaded.nq, analysis.rank, analysis.mobility, motors, len(analysis.idle))
    assert found == TABLE[name]


@every_model
def test_the_rank_is_that_of_pinocchios_jacobian(name):
    """Rank of the descriptor form's unreduced rows at a random closed configuration, by another implementation."""
    loaded = mechanism(name)
    model = loaded.pin_model
    q_free = closed_configurations(name, SAMPLES)[7]
    rows = descriptor.rows(loaded.description, model, q_free, np.zeros(model.nv))
    singular = np.linalg.svd(np.array([row.gradient for row in rows]), compute_uv=False)
    assert int(np.sum(singular > 1e-8 * singular[0])) == TABLE[name].rank
    assert max(abs(row.value) for row in rows) < 1e-9


def disagreement(name, oracle):
    """Largest difference of q̈′, relative to the largest |q̈′|, at random closed states under random efforts."""
    loaded, model = mechanism(name), reduced_model(name)
    generator, worst = np.random.default_rng(7), 0.0
    for q_free in closed_configurations(name, SAMPLES):
        state = model.at(model.alpha(q_free), q_free)
        v, u = generator.standard_normal(model.n), generator.standard_normal(model.n_actuated)
        a_free, tau = state.a_free(v, state.forward_dynamics(v, u)), state.joint_efforts(u)
        where = loaded.description, loaded.pin_model, state.q_free, state.v_free(v)
        expected = oracle(*where, tau + descriptor.passive(*where)).a_free
        worst = max(worst, float(np.abs(a_free - expected).max() / max(1.0, np.abs(expected).max())))
    return worst


@every_model
def test_the_reduced_dynamics_are_those_of_the_descriptor_form(name):
    """q̈′ = ρ q̈ + ρ̇ q̇ against a direct solution of (19) with rows written anew, to 1e-8."""
    assert disagreement(name, descriptor.direct) < 1e-8


@pytest.mark.parametrize("name", ["5bar_linkage_iso3d", "cassie_like", "digit_like", "cassie_closed_chain.xml"])
def test_the_reduced_dynamics_are_pinocchios_constrained_dynamics(name):
    """The same against pin.constraintDynamics with CONTACT_3D and CONTACT_6D models, to 1e-8."""
    assert disagreement(name, descriptor.pinocchio) < 1e-8


@pytest.mark.parametrize("name", ["5bar_linkage_iso3d", "cassie_like", "digit_like"])
def test_closures_in_python_and_in_yaml_are_one_mechanism(name):
    """The bare URDF with closures= and actuated= gives the D, C and g that the YAML gives."""
    loaded, model = mechanism(name), reduced_model(name)
    again = ccpin.load(
        FOLDER / name / "robot.urdf",
        closures=loaded.closures,
        free=["all"],
        independent=loaded.independent,
        actuated=loaded.actuated,
    )
    assert (again.n, again.mobility.idle) == (loaded.n, loaded.mobility.idle)
    other = ccpin.ReducedModel(again)
    v = np.random.default_rng(2).standard_normal(model.n)
    for q_free in closed_configurations(name, SAMPLES)[:5]:
        q = model.alpha(q_free)
        for mine, theirs in zip(other.terms(q, v, q_free), model.terms(q, v, q_free), strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * max(1.0, np.abs(theirs).max()))


@pytest.mark.parametrize("name", ["5bar_linkage_iso3d", "cassie_like", "digit_like"])
def test_the_motors_are_independent_coordinates(name):
    """Every motor the YAML names is among the coordinates q, and the folder and the YAML load alike."""
    loaded = mechanism(name)
    assert set(loaded.actuated) <= set(loaded.independent)
    again = ccpin.load(FOLDER / name / "robot.yaml", free=["all"])
    assert again.independent == loaded.independent
    np.testing.assert_array_equal(again.q_reference, loaded.q_reference)


@pytest.mark.parametrize("name", ["5bar_linkage_iso3d", "cassie_like", "digit_like"])
def test_the_tree_is_pinocchios(name):
    """D′ and g′ of the free system equal those of Pinocchio's own URDF parser, joint by joint."""
    ours, theirs = mechanism(name).pin_model, pin.buildModelFromUrdf(str(FOLDER / name / "robot.urdf"))
    order = [theirs.idx_vs[theirs.getJointId(joint)] for joint in list(ours.names)[1:]]
    q = np.random.default_rng(5).standard_normal(ours.nv)
    permuted = np.empty(ours.nv)
    permuted[order] = q
    mass = pin.crba(theirs, theirs.createData(), permuted)[np.ix_(order, order)]
    np.testing.assert_allclose(pin.crba(ours, ours.createData(), q), mass, atol=1e-12)
    gravity = pin.computeGeneralizedGravity(theirs, theirs.createData(), permuted)[order]
    np.testing.assert_allclose(pin.computeGeneralizedGravity(ours, ours.createData(), q), gravity, atol=1e-12)


def test_missing_meshes_cost_a_note_only():
    """The meshes these files name are absent: each link says so, and nothing else is lost."""
    description = read_description(FOLDER / "cassie_like")
    assert sum("is not there; it is left out of pictures" in note for note in description.notes) == sum(
        1 for link in description.links for visual in link.visuals if visual.shape.kind == "mesh"
    )
