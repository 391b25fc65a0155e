"""Joints held still: idle spins by default, any joint or component on request."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link, read_description
from ccpin.description.model import inverse
from ccpin.errors import IndependentSetError, InvalidInputError
from tests.oracles import descriptor, rssr
from tests.support.ball_joint import ball_joint
from tests.support.places import SHARED
from tests.support.walkthrough import file

HAS_SHARED = pytest.mark.skipif(not SHARED.exists(), reason="models by others are not here")
SPINNING = {
    "rssr": (file("rssr"), {"ball": "ball:rz"}),
    "ankle": (file("ankle"), {"left_ball": "left_ball:rz"}),
    "gas_spring_leg": (file("gas_spring_leg"), {"stud": "stud:rz"}),
    "digit_like": (
        SHARED / "digit_like",
        {name: name for name in ("tarsus_toe_a_1/2_rev2", "foot_part_toe_b_1/2_2_rev2", "foot_part_toe_b_1/2_rev2")},
    ),
}
every_spin = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=HAS_SHARED) if name == "digit_like" else name for name in SPINNING]
)


@cache
def locked_model(name):
    return ccpin.ReducedModel(ccpin.load(SPINNING[name][0]))


@cache
def free_model(name):
    """The same with its spins free and measured, after the coordinates that the locked one has."""
    path, locks = SPINNING[name]
    independent = (*locked_model(name).mechanism.independent, *locks.values())
    return ccpin.ReducedModel(ccpin.load(path, independent=independent))


def states(name, count=6):
    """Locked and free states at one q of the rest, the free one's spins anywhere, with velocities of the rest."""
    locked, free, rng = locked_model(name), free_model(name), np.random.default_rng(4)
    n = locked.n
    spins = [part.v for part in free.coordinates.parts[len(locked.coordinates.parts) :]]
    assert [window.start for window in spins] == list(range(n, free.n))
    for _ in range(count):
        q = locked.coordinates.integrate(locked.alpha(locked.mechanism.q_reference), 0.1 * rng.normal(size=n))
        turned = free.coordinates.integrate(
            free.alpha(free.mechanism.q_reference), np.concatenate([np.zeros(n), 0.1 * rng.normal(size=free.n - n)])
        )
        turned[: locked.nq] = q
        yield locked.at(q), free.at(turned), rng.normal(size=n)


@every_spin
def test_it_is_the_spin_that_is_locked(name):
    """n is one less a spin, `locked` names it, notes say so, and it is no motor."""
    locked, free = locked_model(name).mechanism, free_model(name).mechanism
    names = set(SPINNING[name][1].values())
    assert set(locked.locked) == names
    assert free.locked == ()
    assert (locked.n, locked.mobility.idle) == (free.n - len(names), ())
    assert len(free.mobility.idle) == len(names)
    assert not names & {*locked.independent, *locked.actuated}
    for spin in names:
        assert any(f"locked as '{spin}'" in note for note in locked.notes)


@every_spin
def test_the_rest_moves_as_with_a_free_spin_from_rest(name):
    """Routh: with no spin momentum the free mechanism's D, C q̇ and g, the spin eliminated, are the locked one's."""
    n = locked_model(name).n
    for locked, free, v in states(name):
        own, coupled = free.D[:n, :n], free.D[:n, n:]
        spin = -np.linalg.solve(free.D[n:, n:], coupled.T @ v)  # p = 0
        scale = np.abs(own).max()
        eliminated = own - coupled @ np.linalg.solve(free.D[n:, n:], coupled.T)
        np.testing.assert_allclose(locked.D, eliminated, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(free.g[n:], 0.0, rtol=0, atol=1e-9 * max(1.0, np.abs(free.g).max()))
        np.testing.assert_allclose(locked.g, free.g[:n], rtol=0, atol=1e-9 * max(1.0, np.abs(free.g).max()))
        u = np.ones(locked_model(name).n_actuated)
        whole = np.concatenate([v, spin])
        mine = locked.forward_dynamics(v, u)
        theirs = free.forward_dynamics(whole, _same_efforts(name, u))
        np.testing.assert_allclose(mine, theirs[:n], rtol=0, atol=1e-8 * max(1.0, np.abs(theirs).max()))


def _same_efforts(name, u):
    locked, free = locked_model(name).mechanism, free_model(name).mechanism
    efforts = dict(zip(locked.actuated, u, strict=True))
    return np.array([efforts.get(motor, 0.0) for motor in free.actuated])


@pytest.mark.parametrize("backend", ["native", "numpy"])
@pytest.mark.parametrize("theta", [-2.5, -0.9, 0.0, 0.6, 1.7])
def test_the_rssr_linkage_is_its_closed_form(theta, backend, monkeypatch):
    """σ, D, C and g of the locked linkage are those of one equation in the crank's angle, on both backends."""
    monkeypatch.setenv("CCPIN_BACKEND", backend)
    mechanism = ccpin.load(file("rssr"))
    model = ccpin.ReducedModel(mechanism)
    here = mechanism.q_reference[mechanism.tree.joint("rocker_joint").q][0]
    branch = min((1.0, -1.0), key=lambda sign: abs(rssr.rocker_angle(0.0, sign) - here))
    state, v = model.at([theta]), np.array([1.3])
    assert state.q_free[mechanism.tree.joint("rocker_joint").q][0] == pytest.approx(
        rssr.rocker_angle(theta, branch), abs=1e-11
    )
    assert state.D[0, 0] == pytest.approx(rssr.inertia(theta, branch), abs=1e-10)
    assert state.C(v)[0, 0] == pytest.approx(0.5 * rssr.slope(rssr.inertia, theta, branch) * v[0], abs=1e-9)
    assert state.g[0] == pytest.approx(rssr.slope(rssr.potential, theta, branch), abs=1e-9)


@every_spin
def test_pinocchio_gives_the_same_motion(name):
    """With `pin_model`, all inertia in it, and the declared closures, Pinocchio's solver moves the rest likewise.

    Where the lock is a row that Pinocchio does not have the spin is free there; velocities are without spin momentum.
    """
    locked = locked_model(name)
    mechanism = locked.mechanism
    if not mechanism.locks:
        pytest.skip("its joints are fixed, so that Pinocchio's model has the spin locked with all inertia")
    spins = [component for joint in SPINNING[name][1] for component in range(*_window(mechanism, joint))]
    model, data = mechanism.pin_model, mechanism.pin_model.createData()
    for state, _, v in states(name, 3):
        v_free = _without_momentum(mechanism, state.q_free, state.v_free(v))
        where = mechanism.description, model, state.q_free, v_free
        u = np.ones(locked.n_actuated)
        expected = descriptor.direct(*where, state.joint_efforts(u) + descriptor.passive(*where)).a_free
        mine = state.a_free(v, state.forward_dynamics(v, u))
        others = np.setdiff1d(np.arange(mechanism.n_free), spins)
        np.testing.assert_allclose(mine[others], expected[others], rtol=0, atol=1e-8 * np.abs(expected).max())
    assert data is not None


def _window(mechanism, joint):
    window = mechanism.tree.joint(joint).v
    return window.start, window.stop


def _without_momentum(mechanism, q_free, v_free):
    """q̇′ with as much spin added as makes the momentum about it vanish: what it is along is φ_q′'s idle direction."""
    model = mechanism.pin_model
    constraints = ccpin.ReducedModel(mechanism).parametrization.constraints
    jacobian = constraints.value(q_free).jacobian
    declared = jacobian[: len(jacobian) - len(mechanism.locks)]
    kernel = np.linalg.svd(declared)[2][np.linalg.matrix_rank(declared, tol=1e-9) :].T
    others = [j.v for j in mechanism.tree.joints if j.name in mechanism.independent]
    rows = np.vstack([np.eye(mechanism.n_free)[window] for window in others]) @ kernel
    idle = kernel @ np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows, tol=1e-9) :].T
    mass = pin.crba(model, model.createData(), q_free)
    return v_free - idle @ np.linalg.solve(idle.T @ mass @ idle, idle.T @ mass @ v_free)


def test_a_locked_joint_the_file_does_not_mark_takes_the_place_of_one_it_does():
    """With a passive joint locked the five-bar has one motion, and one of its two marked motors measures it."""
    mechanism = ccpin.load("rpdr", locked=["joint3"])
    assert mechanism.n == 1
    assert mechanism.independent[0] in ("joint1", "joint2")
    assert mechanism.actuated == ("joint1", "joint2")
    assert any(note.startswith("with joint3 locked the file marks more") for note in mechanism.notes)
    still = ccpin.load("four_bar", locked=["rocker"])
    assert (still.n, still.independent) == (0, ())


def _described(joints, links, closures=(), couplings=(), **more):
    return ccpin.MechanismDescription("m", "base", links, joints, closures, couplings, **more)


def test_a_whole_joint_is_fixed_where_the_loops_close():
    """The five-bar with one motor locked is the four-bar it then is: n = 1, D and C of the other motor's motion."""
    whole = ccpin.ReducedModel(ccpin.load("rpdr"))
    mechanism = ccpin.load("rpdr", locked=["joint1"])
    model = ccpin.ReducedModel(mechanism)
    assert (mechanism.n, mechanism.n_free, mechanism.locked) == (1, 3, ("joint1",))
    assert (mechanism.independent, mechanism.actuated) == (("joint2",), ("joint2",))
    assert "motors of joint1 are left out: the joints are locked" in mechanism.notes
    at = list(whole.mechanism.independent).index("joint2")
    q = whole.alpha(whole.mechanism.q_reference)
    for step in (-0.2, 0.0, 0.3):
        moved = q + step * np.eye(2)[at]
        mine, theirs = model.at([moved[at]]), whole.at(moved)
        v = 0.7 * np.eye(2)[at]
        assert mine.D[0, 0] == pytest.approx(theirs.D[at, at], abs=1e-12)
        assert mine.C([0.7])[0, 0] == pytest.approx(theirs.C(v)[at, at], abs=1e-11)
        assert mine.g[0] == pytest.approx(theirs.g[at], abs=1e-11)


def test_a_stated_joint_is_locked_where_it_is_stated():
    """reference= says where, to the last bit, and the others close the loop."""
    mechanism = ccpin.load("rpdr", locked=["joint1"], reference={"joint1": -1.9})
    joint = next(joint for joint in mechanism.description.joints if joint.name == "joint1")
    assert joint.kind == "fixed"
    free = next(joint for joint in ccpin.load("rpdr").description.joints if joint.name == "joint1")
    turn = pin.exp3(-1.9 * free.axis)
    np.testing.assert_allclose(joint.placement[:3, :3], free.placement[:3, :3] @ turn, rtol=0, atol=1e-15)


@pytest.mark.parametrize("component", ["rx", "ry", "rz"])
def test_a_component_of_a_ball_is_locked_by_one_row(component):
    """What is left is a universal joint: the rotation's entry across the locked axis stays zero, n is one less."""
    description = ball_joint().mechanism.description
    mechanism = ccpin.load(description, locked=[f"shoulder:{component}"])
    model = ccpin.ReducedModel(mechanism)
    assert (mechanism.n, mechanism.locked) == (2, (f"shoulder:{component}",))
    q = model.alpha(mechanism.q_reference)
    moved = model.sigma(model.coordinates.integrate(q, np.array([0.4, -0.3])))
    joint = mechanism.tree.joint("shoulder")
    change = joint.kind.rotation(mechanism.q_reference[joint.q]).T @ joint.kind.rotation(moved[joint.q])
    k = "xyz".index(component[1])
    others = [i for i in range(3) if i != k]
    assert min(abs(change[others[0], others[1]]), abs(change[others[1], others[0]])) < 1e-12
    v = np.array([0.5, -1.1])
    rate = model.rho(moved) @ v
    mass = pin.crba(mechanism.pin_model, mechanism.pin_model.createData(), moved)
    assert v @ model.at(model.alpha(moved), moved).D @ v == pytest.approx(rate @ mass @ rate, rel=1e-11)


@pytest.mark.parametrize(("component", "entry"), [("tx", 0), ("ty", 1)])
def test_a_slide_of_a_planar_joint_keeps_its_value(component, entry):
    """A planar joint with one slide locked moves along the other and turns."""
    body, rail = Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.1 * np.eye(3)), np.eye(4)
    rail[:3, 3] = 0.3, -0.2, 0.0
    z = np.array([0.0, 0.0, 1.0])
    links = (Link("base"), Link("puck", body), Link("arm", body))
    joints = (Joint("slide", "planar", "base", "puck", axis=z), Joint("turn", "revolute", "base", "arm", rail, z))
    tie = ccpin.LoopClosure("tie", "spherical", "puck", "arm", rail, rail)
    mechanism = ccpin.load(_described(joints, links, (tie,)), locked=[f"slide:{component}"])
    model = ccpin.ReducedModel(mechanism)
    assert mechanism.n == 1
    window = mechanism.tree.joint("slide").q
    for step in (-0.05, 0.02, 0.1):
        q_free = model.sigma(model.coordinates.integrate(model.alpha(mechanism.q_reference), np.array([step])))
        assert q_free[window][entry] == pytest.approx(mechanism.q_reference[window][entry], abs=1e-13)


def _chain(kinds, couplings):
    body, z = Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.1 * np.eye(3)), np.array([0.0, 0.0, 1.0])
    links = (Link("base"), *(Link(f"l{k}", body) for k in range(len(kinds))))
    joints = (
        Joint(f"j{k}", kind, (["base"] + [f"l{i}" for i in range(9)])[k], f"l{k}", axis=z)
        for k, kind in enumerate(kinds)
    )
    return _described(tuple(joints), links, couplings=couplings)


def test_a_coupling_keeps_what_a_locked_joint_gives_it():
    """j0 + 2 j1 − j2 = 0.3 with j1 locked at 0.4 is j0 − j2 = −0.5."""
    terms = (CouplingTerm("j0", (0.0, 1.0)), CouplingTerm("j1", (0.0, 2.0)), CouplingTerm("j2", (-0.3, -1.0)))
    description = _chain(["revolute"] * 3, (Coupling("sum", terms),))
    mechanism = ccpin.load(description, locked=["j1"], reference={"j1": 0.4})
    model = ccpin.ReducedModel(mechanism)
    assert (mechanism.n, mechanism.independent) == (1, ("j0",))
    assert model.sigma([0.7])[mechanism.tree.joint("j2").q] == pytest.approx([1.2], abs=1e-12)


def test_a_joint_that_a_coupling_leaves_no_motion_is_locked_too():
    """j1 follows j0: with j0 locked both stand, and j2 alone moves."""
    follow = Coupling("follow", (CouplingTerm("j1", (0.0, 1.0)), CouplingTerm("j0", (0.0, -2.0))))
    twin = Coupling("twin", (CouplingTerm("j2", (0.0, 1.0)), CouplingTerm("j3", (0.0, -1.0))))
    mechanism = ccpin.load(_chain(["revolute"] * 4, (follow, twin)), locked=["j0"])
    assert mechanism.tree.names == ("j2", "j3")
    assert "'j1' is locked too: coupling 'follow' leaves it no motion" in mechanism.notes


def _rod(inertia=None, **stated):
    """A rod on a ball on a crank, closed by a ball on a slider, in a description."""
    body = inertia or Inertia(1.0, np.array([0.25, 0.0, 0.0]), np.diag([0.001, 0.1, 0.1]))
    tip, rail = np.eye(4), np.eye(4)
    tip[0, 3], rail[:3, 3] = 0.5, (0.4, 0.3, 0.0)
    post = np.eye(4)
    post[0, 3] = 0.1
    joints = (
        Joint("turn", "revolute", "base", "crank", inverse(post), np.array([0.0, 0.0, 1.0])),
        Joint("ball", "spherical", "crank", "rod", post, **stated),
        Joint("slider", "prismatic", "base", "cart", rail, np.array([0.0, 0.6, 0.8])),
    )
    links = (
        Link("base"),
        Link("crank", body),
        Link("rod", body),
        Link("cart", Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))),
    )
    return _described(joints, links, (ccpin.LoopClosure("tip", "spherical", "rod", "cart", tip),))


def test_what_turns_a_spin_leaves_it_free():
    """A spring, a motor or a user's coordinate on the joint: the spin is not idle, or wanted."""
    assert ccpin.load(_rod()).locked == ("ball:rx",)
    assert ccpin.load(_rod(stiffness=2.0)).locked == ()
    assert ccpin.load(_rod(), actuated=["turn", "ball"]).locked == ()
    assert ccpin.load(_rod(), independent=["turn", "ball:rx"]).locked == ()
    assert ccpin.load(_rod(), free=["ball"]).n == ccpin.load(_rod(), free=["ball:rx"]).n == 2


def test_what_locking_changes_is_told():
    """Symmetric mass: exact and said so; bent rods and damped balls keep their inertia; a swing stays free."""
    exact, damped = ccpin.load(_rod()), ccpin.load(_rod(damping=0.1))
    assert any("0.001 kg m², is left out" in note and "exactly" in note for note in exact.notes)
    assert any("Damping, friction or a rotor of 'ball' acts on it" in note for note in damped.notes)
    bent = Inertia(1.0, np.array([0.25, 0.02, 0.0]), np.diag([0.001, 0.1, 0.1]))
    loaded = ccpin.load(_rod(bent))
    assert any("not symmetric about that axis" in note for note in loaded.notes)
    np.testing.assert_array_equal(
        [inertia.inertia for inertia in loaded.tree.model.inertias], [i.inertia for i in loaded.pin_model.inertias]
    )
    swing = ccpin.load(_rod(Inertia(1.0, np.array([0.25, 0.5, 0.0]), np.diag([0.001, 0.1, 0.1]))))
    assert (swing.locked, len(swing.mobility.idle)) == ((), 1)


def test_a_door_stays_free():
    """A body on two hinges about one line, the second written as a loop, is no idle rod."""
    panel, z = Inertia(8.0, np.array([0.4, 0.0, 1.0]), np.diag([2.5, 3.0, 0.5])), np.array([0.0, 0.0, 1.0])
    top = np.eye(4)
    top[2, 3] = 2.0
    links = (Link("base"), Link("door", panel), Link("arm", panel), Link("end", panel))
    joints = (
        Joint("hinge", "revolute", "base", "door", axis=z),
        *(Joint(name, "revolute", a, b, axis=z) for name, a, b in (("j0", "base", "arm"), ("j1", "arm", "end"))),
    )
    loop = ccpin.LoopClosure("hinge2", "spherical", "door", "base", top, top)
    twin = Coupling("twin", (CouplingTerm("j0", (0.0, 1.0)), CouplingTerm("j1", (0.0, -1.0))))
    mechanism = ccpin.load(_described(joints, links, (loop,), (twin,)))
    assert (mechanism.n, mechanism.locked) == (2, ())


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"locked": ["jonit1"]}, InvalidInputError, "did you mean 'joint1'"),
        ({"locked": ["joint1:rx"]}, InvalidInputError, "name the joint alone"),
        ({"locked": "joint1"}, InvalidInputError, "locked must be a sequence"),
        ({"locked": ["joint1"], "independent": ["joint1"]}, IndependentSetError, "both independent and locked"),
        ({"locked": ["joint1"], "actuated": ["joint1", "joint2"]}, IndependentSetError, "both actuated and locked"),
        ({"free": ["nothing"]}, InvalidInputError, "is no movable joint"),
        ({"free": ["joint1"]}, InvalidInputError, "no spin that moves nothing else"),
    ],
)
def test_what_cannot_be_locked_is_refused_by_name(arguments, error, said):
    """Unknown names and contradictions."""
    with pytest.raises(error, match=said):
        ccpin.load("rpdr", **arguments)


@pytest.mark.parametrize("suffix", [".urdf", ".sdf", ".xml", ".yaml"])
@pytest.mark.parametrize("name", ["rssr", "gas_spring_leg"])
def test_a_saved_file_keeps_the_spin_and_is_locked_again(name, suffix, tmp_path):
    """The file has the ball and all inertia; read back it is the same mechanism with the same spin locked."""
    mechanism = ccpin.load(file(name))
    path = tmp_path / f"robot{suffix}"
    mechanism.save(path)
    written = {joint.name: joint.kind for joint in read_description(path).joints}
    assert "spherical" in written.values()
    again = ccpin.load(path, independent=mechanism.independent)
    assert len(again.locked) == len(mechanism.locked)
    one, other = (ccpin.ReducedModel(m).at(ccpin.ReducedModel(m).alpha(m.q_reference)) for m in (mechanism, again))
    np.testing.assert_allclose(one.D, other.D, rtol=0, atol=1e-8)
    np.testing.assert_allclose(one.g, other.g, rtol=0, atol=1e-8)


def test_a_joint_locked_on_request_is_fixed_in_the_file(tmp_path):
    """Whole joints are written fixed; a locked component is a loop that URDF+ has a word for."""
    ccpin.load("rpdr", locked=["joint1"]).save(tmp_path / "fourbar.urdf")
    assert ccpin.load(tmp_path / "fourbar.urdf").n == 1
    held = ccpin.load(replace(ball_joint().mechanism.description, name="held"), locked=["shoulder:rz"])
    held.save(tmp_path / "held.urdf")
    assert ccpin.load(tmp_path / "held.urdf", independent=held.independent).n == 2
