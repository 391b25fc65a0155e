"""The one way derivatives are checked: sixth-order central differences along curves of configurations."""

import numpy as np
import pinocchio as pin

WEIGHTS = ((1, 3.0 / 4.0), (2, -3.0 / 20.0), (3, 1.0 / 60.0))
STEP = 1e-3


def derivative(function, step=STEP):
    """d/ds function(s) at s = 0 for an array-valued function, to O(step⁶)."""
    return sum(w * (np.asarray(function(k * step)) - np.asarray(function(-k * step))) for k, w in WEIGHTS) / step


def along(model, q_free, v_free, function, step=STEP):
    """d/dt function(q′) for the motion q′ ⊕ t q̇′, the velocity components of which are constant."""
    return derivative(lambda s: function(pin.integrate(model, q_free, s * v_free)), step)


def jacobian(model, q_free, function, step=STEP):
    """∂function/∂q′ in the tangent space, of shape (·, n′)."""
    columns = [along(model, q_free, direction, function, step) for direction in np.eye(model.nv)]
    return np.array(columns).T


def difference(model, start, end):
    """The tangent vector from one configuration to another, with plane angles by the arc tangent.

    Pinocchio's logarithm of a plane rotation is exactly 0 for angles below 1.5e-8 where rounding makes the circle's
    norm exceed one, too coarse for small difference steps.
    """
    tangent = pin.difference(model, start, end)
    for joint in list(model.joints)[1:]:
        if (joint.nq, joint.nv) in ((2, 1), (4, 3)) and joint.shortname() != "JointModelSpherical":
            i, j = joint.idx_q + joint.nq - 2, joint.idx_v
            turn, target = complex(*start[i : i + 2]), complex(*end[i : i + 2])
            angle = np.angle(target / turn)
            if joint.nv == 3:
                shift = complex(*(end - start)[joint.idx_q : joint.idx_q + 2]) / turn
                body = shift * (1j * angle / np.expm1(1j * angle) if abs(angle) > 1e-9 else 1.0)
                tangent[j : j + 2] = body.real, body.imag
            tangent[j + joint.nv - 1] = angle
    return tangent


def velocity(model, curve, step=STEP):
    """q̇′ at s = 0 of a curve s → q′(s)."""
    start = curve(0.0)
    return derivative(lambda s: difference(model, start, curve(s)), step)


def assert_close(found, expected, tolerance, *, scale=0.0):
    """Every entry agrees to `tolerance` relative to the largest expected entry, or to `scale` where that is larger.

    What may vanish, as a sum of terms that cancel, has no size of its own: `scale` is then the size of the terms,
    in the values' unit.
    """
    size = max(float(np.abs(expected).max(initial=0.0)), scale)
    assert size > 0.0 or not np.size(expected), "zero has no size of its own: give the scale"
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * size)
