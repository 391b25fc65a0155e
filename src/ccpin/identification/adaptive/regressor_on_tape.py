"""Y_r on a tape: Y_r π = D q̈_r + C(q̇) q̇_r + damping q̇_r + g, by the equations of `dynamics.linear_forces`.

There rates are of twists in world axes. Here they are of their numbers in the body's axes, which turn along: with G the
body's twist for unit q̇, a rate in world axes is Ġ q̇_r + V × V_r, of which ½ is taken away again.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import cross
from ccpin.dynamics.parameters import joint_kinds
from ccpin.identification.combinations.recorded_twists import body_motions
from ccpin.programs.quantities import TapedModel
from ccpin.programs.recording.recorded_tree import Table, rational

_PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # of Ixx, Ixy, Iyy, Ixz, Iyz, Izz


def recorded_regressor(scene: TapedModel, v_r: Table, a_r: Table) -> Table:
    """Y_r without dry friction, of shape (n, p), of the scene's x and q̇ and of expressions q̇_r and q̈_r."""
    tape, model, own = scene.tape, scene.model, scene.own
    motion, v = scene.recorded.motion, scene.inputs["v"]
    n, tree = model.n, model.mechanism.tree
    seen = body_motions(tape, model, own, scene.inputs["x"], motion.rho)

    def rate(table: Table) -> Table:
        found = tape.derivative(table.ravel().tolist(), dict(enumerate(motion.x_rate.tolist())), held=False)
        return np.array(found, dtype=object).reshape(table.shape)

    columns = list[Table]()
    for G, G_rate, gravity in zip(seen.twists, rate(seen.twists), seen.gravity, strict=True):
        V, V_r = v @ G, v_r @ G
        A = a_r @ G + v_r @ G_rate + _crossed(V, V_r) * rational(0.5)
        A[:3] = A[:3] - gravity
        wrench = _momentum(A) + (_force_crossed(V, _momentum(V_r)) + _force_crossed(V_r, _momentum(V))) * rational(0.5)
        columns.append(G @ wrench)
    a_free = motion.rho @ a_r + rate(motion.rho) @ v_r
    v_r_free = motion.rho @ v_r
    for held, joint, stretch in zip(own.joints, tree.joints, seen.stretches, strict=True):
        rho, none = motion.rho[held.v], np.zeros(held.kind.nv, dtype=object)
        each = {"armature": a_free[held.v], "damping": v_r_free[held.v], "stiffness": stretch, "offset": none - 1}
        columns.append(rho.T @ np.stack([each.get(kind, none) for kind in joint_kinds(joint)], axis=1))
    return np.concatenate(columns, axis=1).reshape(n, -1)


def _momentum(V: Table) -> Table:
    """K(V) with M V = K(V) π_b, of shape (6, 10)."""
    linear, angular = V[:3], V[3:]
    K = np.zeros((6, 10), dtype=object)
    K[:3, 0] = linear
    for k, axis in enumerate(np.eye(3, dtype=object)):
        K[:3, 1 + k], K[3:, 1 + k] = cross(angular, axis), cross(axis, linear)
    for k, (i, j) in enumerate(_PAIRS):
        K[3 + i, 4 + k], K[3 + j, 4 + k] = angular[j], angular[i]
    return K


def _crossed(V: Table, W: Table) -> Table:
    """V × W of twists."""
    return np.concatenate([cross(V[3:], W[:3]) + cross(V[:3], W[3:]), cross(V[3:], W[3:])])


def _force_crossed(V: Table, wrenches: Table) -> Table:
    """V ×* F of the columns of F."""
    F = wrenches.T
    linear, angular = np.broadcast_to(V[:3], (len(F), 3)), np.broadcast_to(V[3:], (len(F), 3))
    return np.concatenate([cross(angular, F[:, :3]), cross(angular, F[:, 3:]) + cross(linear, F[:, :3])], axis=1).T
