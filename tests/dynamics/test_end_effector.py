"""The end effector: pose, twist and its rate, forces, accelerations and inverse kinematics."""

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import EndEffector
from ccpin.errors import InvalidInputError, UnreachableTargetError
from tests.oracles import delta, rpdr
from tests.oracles.finite_differences import assert_close, derivative

TIP = (rpdr.A3, 0.0, 0.0)
TOOLS = {
    "rpdr": ("link3", TIP),
    "slider_crank": ("rod", (0.3, -0.1, 0.2)),
    "planar_3rrr": ("platform", (0.05, 0.02, 0.0)),
    "delta": ("platform", (0.0, 0.0, -0.1)),
    "stewart": ("platform", (0.1, -0.2, 0.3)),
    "hexa": ("platform", (0.1, 0.0, 0.0)),
}
every_tool = pytest.mark.parametrize("name", sorted(TOOLS))


def tool(name):
    model = ccpin.ReducedModel(ccpin.load(name))
    link, point = TOOLS[name]
    return model, EndEffector(model, link, point)


def states(model, count=3, spread=0.05):
    """(q, q̇, q̈, σ(q)) about the reference; the Hexa's lies 0.1 rad from a singularity."""
    spread = 0.2 * spread if model.mechanism.name == "hexa" else spread
    rng = np.random.default_rng(5)
    middle = model.alpha(model.mechanism.q_reference)
    for _ in range(count):
        q = middle + spread * rng.normal(size=model.n)
        yield q, rng.normal(size=model.n), rng.normal(size=model.n), model.sigma(q)


def tip(q):
    """The RPDR's end effector in the world's (x, z)."""
    q1, _, q3, _ = rpdr.sigma(q, 1.0)
    return rpdr.A1 * np.array([np.cos(q1), np.sin(q1)]) + rpdr.A3 * np.array([np.cos(q1 + q3), np.sin(q1 + q3)])


def test_position_of_the_rpdr_and_the_delta():
    """Against the closed forms of both robots."""
    model, end_effector = tool("rpdr")
    for q, *_ in states(model, 5, 0.3):
        np.testing.assert_allclose(end_effector.pose(q)[[0, 2], 3], tip(q), atol=1e-12)
    model, end_effector = tool("delta")
    for q, *_ in states(model, 5, 0.2):
        expected = delta.forward(q) - [0.0, 0.0, 0.1]
        np.testing.assert_allclose(end_effector.pose(q)[:3, 3], expected, atol=1e-12)
        np.testing.assert_allclose(end_effector.pose(q)[:3, :3], np.eye(3), atol=1e-12)


@every_tool
def test_the_twist_is_the_rate_of_the_pose(name):
    """J ρ q̇ against finite differences of the pose along σ, (linear, angular) in world axes, to 1e-6."""
    model, end_effector = tool(name)
    for q, v, _, q_free in states(model):
        start = end_effector.pose(q, q_free)[:3, :3]

        def moved(s, q=q, v=v, q_free=q_free, start=start):
            pose = end_effector.pose(q + s * v, q_free)
            return np.concatenate([pose[:3, 3], pin.log3(pose[:3, :3] @ start.T)])

        assert_close(end_effector.velocity(q, v, q_free), derivative(moved), 1e-9)


@every_tool
def test_the_jacobians_rate(name):
    """d/dt (J ρ) and the acceleration against finite differences along the motion, to 1e-6."""
    model, end_effector = tool(name)
    for q, v, a, q_free in states(model):
        rate = derivative(lambda s, q=q, v=v, q_free=q_free: end_effector.jacobian(q + s * v, q_free))
        assert_close(end_effector.jacobian_rate(q, v, q_free), rate, 1e-8)

        def twist(s, q=q, v=v, a=a, q_free=q_free):
            return end_effector.velocity(q + s * v + 0.5 * s * s * a, v + s * a, q_free)

        assert_close(end_effector.acceleration(q, v, a, q_free), derivative(twist), 1e-8)


@every_tool
def test_power(name):
    """q̇ᵀτ = twistᵀ wrench, the twist by Pinocchio's own frame velocity."""
    model, end_effector = tool(name)
    pin_model, data = model.mechanism.pin_model, model.mechanism.pin_model.createData()
    rng = np.random.default_rng(2)
    for q, v, _, q_free in states(model):
        wrench = rng.normal(size=6)
        pin.forwardKinematics(pin_model, data, q_free, model.rho(q_free) @ v)
        pin.updateFramePlacements(pin_model, data)
        frame = pin_model.getFrameId(end_effector.link)
        velocity = pin.getFrameVelocity(pin_model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        arm = data.oMf[frame].rotation @ np.array(TOOLS[name][1])
        power = wrench[:3] @ (velocity.linear + np.cross(velocity.angular, arm)) + wrench[3:] @ velocity.angular
        assert v @ end_effector.generalized_force(q, wrench, q_free) == pytest.approx(power, abs=1e-11)


def test_a_weight_at_the_tip_is_held_by_its_generalized_force():
    """Holding a mass at the tip: minus the force of its weight is ∂(m g z)/∂q."""
    model, end_effector = tool("rpdr")
    for q, *_ in states(model):
        slope = [derivative(lambda s, q=q, e=e: 2.5 * 9.81 * tip(q + s * e)[1]) for e in np.eye(2)]
        hold = -end_effector.generalized_force(q, [0.0, 0.0, -2.5 * 9.81, 0.0, 0.0, 0.0])
        np.testing.assert_allclose(hold, slope, atol=1e-9)


@pytest.mark.parametrize("actuated", [None, ["joint3", "joint4"]])
def test_the_ellipsoid_holds_what_the_motors_can_do(actuated):
    """Motor efforts on the unit sphere change the tip's acceleration by a point of the ellipsoid's surface."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=actuated))
    end_effector = EndEffector(model, "link3", TIP)
    q, limits = np.radians([-100.0, -95.0]), np.array([2.0, 0.5])
    ellipsoid = end_effector.dynamic_manipulability(q, limits)
    rest = np.zeros(2)
    base = end_effector.acceleration(q, rest, model.forward_dynamics(q, rest, rest))[:3]
    for angle in np.linspace(0.0, 2 * np.pi, 7):
        u = limits * [np.cos(angle), np.sin(angle)]
        gained = end_effector.acceleration(q, rest, model.forward_dynamics(q, rest, u))[:3] - base
        inside = ellipsoid.axes.T @ gained / ellipsoid.lengths
        assert np.linalg.norm(inside) == pytest.approx(1.0, rel=1e-9)
        np.testing.assert_allclose(ellipsoid.axes @ (ellipsoid.axes.T @ gained), gained, atol=1e-9)
    assert ellipsoid.volume == pytest.approx(np.prod(ellipsoid.lengths))


@every_tool
@pytest.mark.parametrize("kind", ["position", "pose"])
def test_inverse_kinematics_round_trip(name, kind):
    """From forward kinematics back: the target is met to 1e-10, and by the same σ."""
    model, end_effector = tool(name)
    for q, _, _, q_free in states(model, spread=0.1):
        pose = end_effector.pose(q, q_free)
        solution = end_effector.solve(pose[:3, 3] if kind == "position" else pose)
        found = end_effector.pose(solution.q, solution.q_free)
        np.testing.assert_allclose(found[:3, 3], pose[:3, 3], atol=1e-10)
        np.testing.assert_allclose(model.sigma(solution.q), solution.q_free, atol=1e-10)
        if kind == "pose":
            np.testing.assert_allclose(found, pose, atol=1e-10)
            np.testing.assert_allclose(solution.q, q, atol=1e-8)


def test_the_branch_is_kept():
    """The same tool point from both assembly modes of the RPDR: each solution is in the mode it began in."""
    _, end_effector = tool("rpdr")
    target = (0.1524, 0.0, -0.15)
    found = []
    for mode, start in ((1.0, (-115.0, 150.0)), (-1.0, (-115.0, -65.0))):
        q_free = rpdr.sigma(np.radians(start), mode)
        near = q_free[[0, 2, 1, 3]]  # Pinocchio's order: depth first
        solution = end_effector.solve(target, near)
        q1, q3, q2, q4 = solution.q_free
        assert np.sin(q1 + q3 - q2 - q4) * mode > 0
        np.testing.assert_allclose(end_effector.pose(solution.q, solution.q_free)[:3, 3], target, atol=1e-10)
        found.append(solution.q)
    assert np.abs(found[0] - found[1]).max() > 0.1


def test_targets_out_of_reach_say_how_far():
    """Beyond the arms' length, out of the plane, and a rotation a Delta's platform cannot have."""
    _, planar = tool("rpdr")
    with pytest.raises(UnreachableTargetError) as far:
        planar.solve((0.0, 0.0, -2.0))
    reach = rpdr.A1 + rpdr.A3
    assert 2.0 - reach - 1e-9 <= far.value.distance <= 2.0 - 0.5 * reach
    with pytest.raises(UnreachableTargetError, match="2 directions") as beside:
        planar.solve((0.15, 0.1, -0.45))
    assert beside.value.distance == pytest.approx(0.1, abs=1e-6)
    model, spatial = tool("delta")
    pose = spatial.pose(model.alpha(model.mechanism.q_reference))
    pose[:3, :3] = pin.exp3(np.array([0.0, 0.0, 0.2]))
    with pytest.raises(UnreachableTargetError, match="turning") as turned:
        spatial.solve(pose)
    assert turned.value.angle == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize(("side", "beyond"), [(-1.0, 0.2), (1.0, -0.2)])
def test_a_target_far_out_of_reach_is_told_with_where_the_way_ended(side, beyond):
    """A Delta's top and bottom are where forearms and arms lie in one line (Pythagoras); near= is no help there."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    platform = EndEffector(model, "platform")
    end = -np.sqrt((delta.FOREARM + side * delta.ARM) ** 2 - (delta.BASE_RADIUS - delta.PLATFORM_RADIUS) ** 2)
    inside = [0.0, 0.0, end - np.sign(beyond) * 1e-3]
    assert delta.forward(platform.solve(inside).q) == pytest.approx(inside, abs=1e-9)
    with pytest.raises(UnreachableTargetError, match="farther than the mechanism reaches") as far:
        platform.solve([0.0, 0.0, end + beyond])
    stopped = str(far.value).partition("stopped at [")[2].partition("]")[0]
    assert [float(number) for number in stopped.split()] == pytest.approx([0.0, 0.0, end], abs=1e-4)
    assert far.value.distance == pytest.approx(abs(beyond), abs=1e-4)
    assert "near=" not in str(far.value)
    with pytest.raises(UnreachableTargetError, match="near= closer to it") as close:
        platform.solve([0.0, 0.0, end + 0.1 * beyond])
    assert "farther than" not in str(close.value)


@pytest.mark.slow
def test_what_stops_an_approach_is_told():
    """Sideways a Delta's loops come to a singular configuration; straight up its arms and rods do not."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    platform = EndEffector(model, "platform")
    for target, words, singular in (((1.5, 0.0, -1.0), "next to", True), ((0.0, 0.0, -0.3), "not singular", False)):
        with pytest.raises(UnreachableTargetError, match=f"loops are {words}") as stopped:
            platform.solve(target)
        rods = delta.forward(stopped.value.q) - delta.sphere_centres(stopped.value.q)
        assert (abs(np.linalg.det(rods / delta.FOREARM)) < 1e-2) == singular  # they lie in one plane


def test_a_loops_name_is_answered_with_its_links():
    """Both ends, as they would have to be written; they are where the closed form's tip is."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    with pytest.raises(InvalidInputError, match="'end_effector' is a loop's name") as told:
        EndEffector(model, "end_effector")
    q = np.radians([-100.0, -80.0])
    for link, length in (("link3", rpdr.A3), ("link4", rpdr.A4)):
        assert f"EndEffector(…, '{link}', [{length}, 0.0, 0.0])" in str(told.value)
        np.testing.assert_allclose(EndEffector(model, link, [length, 0, 0]).pose(q)[[0, 2], 3], tip(q), atol=1e-12)


def test_bad_arguments_are_refused():
    """Links, points, targets, efforts and parts are checked, naming what would be right."""
    model, end_effector = tool("rpdr")
    for link, point, words in (
        ("hand", (0.0, 0.0, 0.0), "link1, "),
        ("base", (0.0, 0.0, 0.0), "moving link"),
        ("link3", (0.0, 0.0), "three finite"),
        ("link3", (0.0, 0.0, np.nan), "three finite"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            EndEffector(model, link, point)
    for target in ([0.0, 0.0], np.zeros((4, 4)), [np.nan, 0.0, 0.0], np.diag([1.0, 1.0, -1.0, 1.0])):
        with pytest.raises(InvalidInputError, match="target"):
            end_effector.solve(target)
    q = np.radians([-90.0, -90.0])
    with pytest.raises(InvalidInputError, match="positive"):
        end_effector.dynamic_manipulability(q, [1.0, 0.0])
    with pytest.raises(InvalidInputError, match="linear, angular"):
        end_effector.dynamic_manipulability(q, part="both")
    with pytest.raises(InvalidInputError, match="wrench"):
        end_effector.generalized_force(q, [1.0, 2.0, 3.0])
