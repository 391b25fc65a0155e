"""Trees of every joint kind on a tape beside Pinocchio, and closures' slopes and second rates beside `Constraints`."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import programs
from ccpin.description import CLOSURE_KINDS, Coupling, CouplingTerm
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from ccpin.programs.evaluation import values_of
from ccpin.programs.recording.constants import Constants
from ccpin.programs.recording.recorded_bodies import joint_forces, joint_masses, joint_weights
from ccpin.programs.recording.recorded_closures import ClosureRows
from ccpin.programs.recording.recorded_coordinates import numbers_of
from ccpin.programs.recording.recorded_forces import _bodies
from ccpin.programs.recording.recorded_tree import closure_rows, exact, exact_joints, own_ends, rates
from ccpin.programs.tape import Tape
from tests.support.strategies import Growth

GRAVITY = np.array([0.3, -0.7, -9.7])
CHAINS = {
    "turns": (["revolute", "revolute", "continuous"], ["revolute", "revolute"]),
    "slides": (["prismatic", "revolute", "prismatic"], ["revolute", "prismatic", "revolute"]),
    "balls": (["spherical", "revolute", "spherical"], ["prismatic", "spherical"]),
    "carriages": (["planar", "revolute", "planar"], ["floating", "prismatic"]),
}


class Recorded:
    """A tree of two limbs on a trunk, its numbers on a tape, and an open configuration of it."""

    def __init__(self, chains, kind=None, planar=False, seed=3):
        growth = Growth(np.random.default_rng(seed), planar)
        trunk = growth.grow("base", ["revolute", "prismatic"])
        ends = [growth.grow(trunk, chain) for chain in chains]
        if kind is not None:
            growth.close(kind, *ends)
        description = growth.drawn().description
        self.tree = build_tree(description)
        gears = [CouplingTerm("j0", (0.1, 2.0, 0.7)), CouplingTerm("j1", (0.0, -1.0, 0.4, 0.3), 0.2)]
        coupled = (Coupling("gears", tuple(gears)),) if kind is not None else ()
        self.constraints = Constraints(self.tree, description.closures, coupled)
        mechanism = SimpleNamespace(tree=self.tree, description=description)
        self.constants = Constants(SimpleNamespace(mechanism=mechanism, gravity_vector=GRAVITY))
        self.joints = exact_joints(self.tree)
        rng, model = np.random.default_rng(5), self.tree.model
        self.q_free = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        self.x = numbers_of(self.joints, self.q_free)
        self.v, self.a = rng.normal(size=(2, model.nv))
        self.tape = Tape(len(self.x) + 2 * model.nv)
        ends = [len(self.x), len(self.x) + model.nv]
        self.nodes = np.split(np.array(self.tape.inputs, dtype=object), ends)

    def values(self, table):
        table = np.asarray(table, dtype=object)
        code = self.tape.code(table.ravel().tolist())
        found = values_of(code, [*self.x, *self.v, *self.a], np)
        return np.array([found[k] for k in code.outputs]).reshape(table.shape)


@pytest.mark.parametrize("name", CHAINS)
def test_inertia_forces_and_weights_are_pinocchio_s(name):
    made = Recorded(CHAINS[name])
    (x, v, a), still = made.nodes, np.zeros(3, dtype=object)
    bodies, n = _bodies(made.tape, made.constants, made.joints, x), made.tree.model.nv
    model = made.tree.model.copy()
    model.gravity = pin.Motion(GRAVITY, np.zeros(3))
    model.armature = np.zeros(n)
    data = model.createData()
    mass = np.array(pin.crba(model, data, made.q_free))
    mass = np.triu(mass) + np.triu(mass, 1).T
    force, weight = (
        pin.rnea(model, data, made.q_free, made.v, made.a),
        made.values(joint_weights(bodies, exact(GRAVITY), n)),
    )
    wanted = pin.computeGeneralizedGravity(model, data, made.q_free)
    np.testing.assert_allclose(weight, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(made.values(joint_masses(bodies, n)), mass, rtol=0, atol=1e-12 * np.abs(mass).max())
    found = made.values(joint_forces(bodies, v, a, -exact(GRAVITY)))
    np.testing.assert_allclose(found, force, rtol=0, atol=1e-12 * np.abs(force).max())
    found = made.values(joint_forces(bodies, v, a, still))
    np.testing.assert_allclose(found, force - wanted, rtol=0, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("kind", [*CLOSURE_KINDS, "planar"])
def test_closures_change_as_they_do(kind):
    """φ, φ_q′ and φ̇_q′q̇′ of every closure kind and of couplings, at open configurations, on a moving ancestor."""
    planar = kind == "planar"
    chains = (["revolute", "prismatic"], ["revolute", "revolute"]) if planar else CHAINS["balls"]
    made = Recorded(chains, "revolute" if planar else kind, planar)
    (x, v, _), constraints = made.nodes, made.constraints
    rows = closure_rows(made.tape, constraints, made.joints, x)
    moving = ClosureRows(
        made.tape, constraints, made.constants, made.joints, x, rows, list(range(len(rows)))[::-1],
        rates(made.tape, made.joints, x),
    )  # fmt: skip
    at = constraints.value(made.q_free)
    along = dict(enumerate((moving.table @ v).tolist()))
    for found, wanted in (
        (rows, at.phi),
        (moving.slopes()[::-1], at.jacobian),
        (moving.changes(v, along)[::-1], constraints.bias(at, made.v)),
    ):
        np.testing.assert_allclose(made.values(found), wanted, rtol=0, atol=1e-12 * max(1.0, np.abs(wanted).max()))


def test_carriages_close_loops():
    """The slides of planar and floating joints are counted in axes that turn with them."""
    for chains in (CHAINS["carriages"], CHAINS["slides"]):
        made = Recorded(chains, "spherical")
        x, v, _ = made.nodes
        rows = closure_rows(made.tape, made.constraints, made.joints, x)
        table = rates(made.tape, made.joints, x)
        moving = ClosureRows(made.tape, made.constraints, made.constants, made.joints, x, rows, range(len(rows)), table)
        at = made.constraints.value(made.q_free)
        along = dict(enumerate((table @ v).tolist()))
        np.testing.assert_allclose(made.values(moving.slopes()), at.jacobian, rtol=0, atol=1e-12)
        bias = made.constraints.bias(at, made.v)
        np.testing.assert_allclose(made.values(moving.changes(v, along)), bias, rtol=0, atol=1e-11)


def test_ends_may_be_others():
    """A point held 0.3 m beside its own: three rows of one point change by a vector of that length."""
    made = Recorded(CHAINS["turns"], "spherical")
    beside = np.array([0.0, 0.3, 0.0])

    def ends(loop):
        first, second = own_ends(loop)
        first[:3, 3] = first[:3, 3] + first[:3, :3] @ exact(beside)
        return first, second

    x = made.nodes[0]
    own, other = (closure_rows(made.tape, made.constraints, made.joints, x, None, each)[:3] for each in (None, ends))
    change = made.values(other) - made.values(own)
    np.testing.assert_allclose(np.linalg.norm(change), 0.3, rtol=1e-12)


def test_rotors_and_dampers_are_in_what_velocities_cost():
    """Of all joints, the passive ones too, whose rates and second rates come of ρ."""
    names = [joint.name for joint in ccpin.load("rpdr").tree.joints]
    mechanism = ccpin.load("rpdr", joints={name: {"damping": 0.3, "armature": 0.2} for name in names})
    model = ccpin.ReducedModel(mechanism)
    state, v = model.at(model.alpha(mechanism.q_reference)), np.array([0.7, -1.1])
    found = programs.record(model, "velocity_force")(**programs.configuration(state), v=v)["velocity_force"]
    np.testing.assert_allclose(found, state.C(v) @ v + state.damping @ v, rtol=0.0, atol=1e-12)
