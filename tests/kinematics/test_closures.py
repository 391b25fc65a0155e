"""What each closure kind means: which relative placements it allows, and how many rows it takes."""

import numpy as np
import pinocchio as pin
import pytest

from ccpin import LoopClosure
from ccpin.description import CLOSURE_KINDS
from ccpin.description.closure_kinds import PlaneNormal
from ccpin.description.model import rotation_to
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.tree import build_tree
from tests.support.backends import same_on_both
from tests.support.strategies import ROWS, Growth

pytestmark = same_on_both

every_kind = pytest.mark.parametrize("kind", CLOSURE_KINDS)


def allowed(kind, relative, length):
    """How far a relative placement of B in A is from what the kind allows, from the meaning of the words."""
    _, y, z = relative[:3, :3].T  # B's axes in A
    p = relative[:3, 3]
    rotation = float(np.abs(relative[:3, :3] - np.eye(3)).max())
    axis = float(np.linalg.norm(z - [0.0, 0.0, 1.0]))
    return {
        "spherical": lambda: np.linalg.norm(p),
        "revolute": lambda: max(np.linalg.norm(p), axis),
        "fixed": lambda: max(np.linalg.norm(p), rotation),
        "prismatic": lambda: max(np.linalg.norm(p[:2]), rotation),
        "cylindrical": lambda: max(np.linalg.norm(p[:2]), axis),
        "universal": lambda: max(np.linalg.norm(p), abs(y[0])),
        "planar": lambda: max(abs(p[2]), axis),
        "perpendicular": lambda: abs(y[0]),
        "in_plane": lambda: abs(p[0]),
        "distance": lambda: abs(np.linalg.norm(p) - length),
    }[kind]()


def free_body(kind, rng):
    """A floating body closed on the base: its configuration is the relative placement, frames put aside."""
    growth = Growth(rng)
    growth.close(kind, "base", growth.grow("base", ["floating"]))
    description = growth.drawn().description
    tree = build_tree(description)
    return growth, description.closures[0], Constraints(tree, description.closures, ())


def configuration(constraints, closure, relative):
    """The floating joint's configuration that puts frame B at `relative` in frame A."""
    link = closure.placement_a @ relative @ np.linalg.inv(closure.placement_b)
    joint = np.linalg.inv(constraints.model.jointPlacements[1].homogeneous) @ link
    return pin.SE3ToXYZQUAT(pin.SE3(joint))


@every_kind
def test_zero_exactly_where_the_kind_allows(kind):
    """φ = 0 for every allowed relative placement, and ‖φ‖ is of the size of the violation near and far from it."""
    rng = np.random.default_rng(11)
    growth, closure, constraints = free_body(kind, rng)
    length = closure.length
    for _ in range(100):
        free = growth.freedom(kind)
        if kind == "distance":
            free[:3, 3] *= length / np.linalg.norm(free[:3, 3])
        assert allowed(kind, free, length) < 1e-12
        q_free = configuration(constraints, closure, free)
        assert np.abs(constraints.residual(q_free)).max() < 1e-12
        assert constraints.aligned(q_free)
        for size in (1e-4, 1e-2, 1.0):
            relative = free @ pin.exp6(size * rng.normal(size=6)).homogeneous
            violation = allowed(kind, relative, length)
            q_free = configuration(constraints, closure, relative)
            residual = np.abs(constraints.residual(q_free)).max()
            assert residual <= 10.0 * violation
            assert residual > 0.05 * violation or not constraints.aligned(q_free)


@every_kind
def test_number_of_rows(kind):
    """A closure of a free body takes as many independent rows as its kind leaves motions out of six."""
    rng = np.random.default_rng(12)
    growth, closure, constraints = free_body(kind, rng)
    assert constraints.size == ROWS[kind]
    free = growth.freedom(kind)
    jacobian = constraints.value(configuration(constraints, closure, free)).jacobian
    assert np.linalg.matrix_rank(jacobian, tol=1e-6) == ROWS[kind]


@pytest.mark.parametrize("kind", ["revolute", "cylindrical", "planar", "prismatic", "fixed"])
def test_axes_turned_end_for_end_are_not_aligned(kind):
    """A half turn about x satisfies the direction rows and is told apart by `aligned`."""
    _, closure, constraints = free_body(kind, np.random.default_rng(13))
    q_free = configuration(constraints, closure, np.diag([1.0, -1.0, -1.0, 1.0]))
    assert np.abs(constraints.residual(q_free)).max() < 1e-12
    assert not constraints.aligned(q_free)


@every_kind
def test_rows_know_the_plane(kind):
    """With z along the plane's normal every kind still has the rows it has in space."""
    normal = np.array([0.0, 0.0, 1.0])
    closure = LoopClosure("l", kind, "a", "b", length=0.5 if kind == "distance" else None)
    rows = CLOSURE_KINDS[kind](closure, PlaneNormal(normal, normal)).rows
    assert len(rows) == ROWS[kind]


def test_rotation_to():
    """The smallest rotation from z to an axis, for the poles and next to them too."""
    rng = np.random.default_rng(14)
    near = [
        [1e-9, 0.0, -1.0],
        [1e-7, 1e-6, -1.0],
        [0.0, 1e-5, -1.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [1e-3, 1e-3, -1.0],
    ]
    for axis in (*rng.normal(size=(50, 3)), *np.array(near)):
        unit = axis / np.linalg.norm(axis)
        rotation = rotation_to(unit)
        np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], unit, rtol=0, atol=1e-14)
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), rtol=0, atol=1e-14)
        assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)
