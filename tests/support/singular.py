"""How near a configuration is to a singular one, by NumPy's reference alone."""

import numpy as np


def least_singular_value(mechanism, q_free):
    """The smallest singular value of φ_q′ on the kernel of α_q′: 0 where ψ_q′ is singular."""
    selection = mechanism.parametrization().coordinates.jacobian(q_free)
    kernel = np.linalg.svd(selection)[2][mechanism.n :].T
    slope = mechanism.constraints().value(q_free).jacobian @ kernel
    return float(np.linalg.svd(slope, compute_uv=False)[-1])
