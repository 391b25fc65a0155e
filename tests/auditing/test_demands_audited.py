"""What a workspace's boxes are said to keep: what is true is proved, what was planted is found."""

import numpy as np
import pytest

import ccpin
from ccpin.domain import certify_workspace
from ccpin.domain.workspaces.workspace import task_problem
from ccpin.proof.requirements import conditioning, reach
from tests.support.altered import changed

pytest.importorskip("flint")

from ccpin.auditing import closures, reading, verify
from ccpin.auditing import workspace as demands

LIMITS = {"motor1": (-6.0, 6.0), "elbow2": (-6.0, 6.0)}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A planar 3-RRR's, with limits and dexterity, and its file."""
    end_effector = ccpin.EndEffector(ccpin.load("planar_3rrr"), "platform")
    x = task_problem(end_effector, None, True, 0.0, None, "auto").x
    width = np.array([0.02, 0.02, 0.1])
    atlas = certify_workspace(
        end_effector, (x - width, x + width), limits=LIMITS, dexterity=0.1, length=0.3, max_depth=3, bounds="reach"
    )
    path = tmp_path_factory.mktemp("demands") / "workspace.json"
    atlas.save(path)
    return atlas, path


def failing(path):
    """The boxes of a document that are not proved to meet its demands."""
    read = reading.read(path)
    own = closures.BallClosures(read)
    return [k for k in range(len(read.centre)) if not demands.met(own, read, k, 3)]


@pytest.mark.slow
def test_true_demands_are_proved(workspace):
    atlas, path = workspace
    audit = verify(path, sample=2)
    assert audit.holds, str(audit)
    claim = next(c for c in audit.claims if "dexterous" in c.what)
    assert (claim.of, claim.checked) == (len(atlas.boxes.kappa), 2)
    assert "were asked for" in audit.not_checked
    assert failing(path) == []


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_a_tightened_limit_is_found(workspace, tmp_path, side):
    """A motor's limit, a thousandth of a radian within the furthest reach: what passes it fails, the others do not."""
    atlas, path = workspace
    ends = dict(zip(("lower", "upper"), reach(atlas.problem, atlas.boxes), strict=True))[side]
    joint = int(atlas.problem.requirements.driven[0])
    sign = 1.0 if side == "upper" else -1.0
    furthest = float(np.max(sign * ends[:, joint]))

    def tighten(arrays):
        arrays[f"demand_{side}"][joint] = sign * (furthest - 1e-3)

    beyond = np.flatnonzero(sign * ends[:, joint] > furthest - 1e-3)
    assert 0 < len(beyond) < len(ends)
    assert failing(changed(path, tmp_path, tighten)) == beyond.tolist()


def test_a_raised_dexterity_is_found(workspace, tmp_path):
    """One that a box's own upper bound excludes, where motors have a grip; what lower bounds say is proved."""
    atlas, path = workspace
    low, high = conditioning(atlas.problem, atlas.problem.requirements, atlas.boxes)
    raised = float(1.001 * high.min())

    def put(value):
        def put_it(arrays):
            arrays["demand_dexterity"] = np.array(value)

        return put_it

    assert int(np.argmin(high)) in failing(changed(path, tmp_path, put(raised)))
    assert failing(changed(path, tmp_path, put(float(0.999 * low.min())))) == []


def test_other_units_are_found(workspace, tmp_path):
    """A turn that counts as a tenth of a millimetre makes the Jacobian ill-conditioned everywhere."""

    def plant(arrays):
        arrays["demand_units"][-1] = 1e-4

    assert len(failing(changed(workspace[1], tmp_path, plant))) == len(workspace[0].boxes.kappa)


def test_motors_that_lose_hold_are_found(workspace, tmp_path):
    """Motors said to be on one of the platform's slides twice, once beside it: nothing determines the others."""
    atlas, path = workspace
    free = np.setdiff1d(np.arange(atlas.problem.system.n_free), atlas.problem.requirements.driven)
    beside = atlas.problem.system.independent[0]

    def plant(arrays):
        arrays["demand_driven"] = np.array([free[0], beside, free[1]], dtype=np.int64)
        arrays["demand_dexterity"] = np.array(0.0)

    assert len(failing(changed(path, tmp_path, plant))) == len(atlas.boxes.kappa)


def test_the_derivative_is_enclosed(workspace):
    """∂y/∂x of 2 against a solve at random places of the tubes, to what that is rounded by."""
    rng = np.random.default_rng(3)
    read = reading.read(workspace[1])
    own = closures.BallClosures(read)
    for k in range(4):
        box = demands.box_of(read, k)
        slopes = demands._Slopes(own, read, box, (-box.half, box.half))
        X, T = demands._derivative(slopes)
        for _ in range(5):
            delta, zeta = rng.uniform(-1.0, 1.0, (2, len(read.dependent)))
            theta = read.centre[k] + read.directions[k] @ (delta[: len(box.half)] * read.half[k])
            theta[read.dependent] += read.modes[k] @ (zeta * read.radius[k])
            slope = own.at(theta)[1]
            exact = -np.linalg.solve(slope[:, read.dependent], slope[:, read.independent])
            assert np.all(np.abs(exact - X) <= T + 1e-12)
