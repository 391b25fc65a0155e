"""The closed loop recorded: its dynamics are the reduced model's, its closures φ."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import Measurement
from ccpin.control.control_law import NoTorque
from ccpin.description import CLOSURE_KINDS
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.other_coordinates.independent_sets import with_independent
from tests.support.paper import GOAL, K_P, K_V
from tests.support.strategies import Growth

flint = pytest.importorskip("flint")

from ccpin.programs.recording.recorded_tree import closure_rows, exact_joints  # noqa: E402
from ccpin.programs.tape import Tape  # noqa: E402
from ccpin.validated.arithmetic.programs import in_balls  # noqa: E402
from ccpin.validated.arithmetic.series import values  # noqa: E402
from ccpin.validated.model.closed_loop import recorded_loop  # noqa: E402
from tests.support.enclosures import balls, numbers  # noqa: E402
from tests.support.long_cases import later  # noqa: E402
from tests.support.recorded import MECHANISMS  # noqa: E402

pytestmark = pytest.mark.usefixtures("precise")


@pytest.mark.parametrize("stated", [{}, {"damping": 0.3, "stiffness": 1.7, "spring_reference": 0.2}])
@pytest.mark.parametrize("name", ["rpdr", "slider_crank", *later("planar_3rrr", "delta")])
def test_recorded_dynamics(name, stated):
    """The tape's (ρq̇, q̈) and energies are the reduced model's at random closed states, under every law it knows."""
    last = ccpin.load(name).tree.names[-1]
    model = ccpin.ReducedModel(ccpin.load(name, joints={last: stated}))
    n, rng = model.n, np.random.default_rng(1)
    q_d = model.alpha(model.mechanism.q_reference)
    gains = q_d, rng.uniform(5, 9, n), rng.uniform(0.5, 0.9, n)
    laws = None, ccpin.control.PDSimpleGravity(model, *gains), ccpin.control.PDFullGravity(model, *gains)
    for controller in laws:
        loop = recorded_loop(model, controller)
        q_free = model.sigma(q_d + 0.05 * rng.normal(size=n))
        q, v = model.alpha(q_free), rng.normal(size=n)
        u = np.zeros(model.n_actuated) if controller is None else controller.torque(0.0, Measurement(q, q_free), v)
        expected = np.concatenate([model.rho(q_free) @ v, model.forward_dynamics(q, v, u, q_free)])
        found = numbers(values(loop.equations.field, balls(q_free, v)))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * max(1.0, np.abs(expected).max()))
        energy = model.energy(q, v, q_free)
        np.testing.assert_allclose(numbers(values(loop.equations.energies, balls(q_free, v))), energy, rtol=1e-12)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("kind", CLOSURE_KINDS)
def test_recorded_closures(kind, planar):
    """φ on a tape is φ, on open configurations too, for every closure kind on a moving ancestor."""
    growth = Growth(np.random.default_rng(3), planar)
    trunk = growth.grow("base", ["revolute", "prismatic"])
    growth.close(kind, growth.grow(trunk, ["revolute"] * 3), growth.grow(trunk, ["prismatic", "revolute"]))
    description = growth.drawn().description
    tree = build_tree(description)
    constraints = Constraints(tree, description.closures, ())
    joints = exact_joints(tree)
    tape = Tape(len(joints))
    program = in_balls(tape, closure_rows(tape, constraints, joints, tape.inputs))
    q_free = np.random.default_rng(4).normal(size=len(joints))
    np.testing.assert_allclose(
        numbers(values(program, balls(q_free))), constraints.residual(q_free), rtol=0, atol=1e-13
    )


def test_whose_free_motion_it_is(rpdr_model):
    """The same in all coordinates of a mechanism; another's of other masses, lengths, dampers or gravity; no law's."""
    mechanism, q = rpdr_model.mechanism, rpdr_model.mechanism.q_reference
    sibling = ccpin.ReducedModel(with_independent(mechanism, ("joint2", "joint4"), q))
    told = recorded_loop(rpdr_model, None).equations.free
    assert told
    assert recorded_loop(sibling, None, q).equations.free == told
    assert recorded_loop(rpdr_model, NoTorque(rpdr_model)).equations.free == told
    described = mechanism.description
    link = next(one for one in described.links if one.inertia is not None and one.inertia.mass > 0.0)
    heavier = replace(link, inertia=replace(link.inertia, mass=2.0 * link.inertia.mass))
    others = [
        ccpin.ReducedModel(mechanism, (0.0, 0.0, -1.0)),
        ccpin.ReducedModel(
            ccpin.load(replace(described, links=tuple(heavier if one is link else one for one in described.links)))
        ),
        ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint3": {"damping": 0.5}})),
        ccpin.ReducedModel(ccpin.load("four_bar")),
    ]
    assert len({told, *(recorded_loop(model, None).equations.free for model in others)}) == 5
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    assert recorded_loop(rpdr_model, law).equations.free == ""
    assert recorded_loop(ccpin.ReducedModel(ccpin.load("bennett")), None).equations.free == ""
    turned = recorded_loop(ccpin.ReducedModel(MECHANISMS["single turn"]()), None)
    assert turned.own.turns
    assert turned.equations.free == ""
