"""Whether dry friction holds a load, told by a linear program."""

import numpy as np
from scipy.optimize import linprog


def share_of_levels(rho, level, load):
    """The smallest share s of the levels with ρᵀf = load, |f| ≤ s · level: held exactly if it is at most 1."""
    joints, n = rho.shape
    unit, one = np.eye(joints), level[:, None]
    return linprog(
        [0] * joints + [1],
        A_ub=np.block([[unit, -one], [-unit, -one]]),
        b_ub=np.zeros(2 * joints),
        A_eq=np.column_stack([rho.T, np.zeros(n)]),
        b_eq=load,
        bounds=[(None, None)] * (joints + 1),
    ).fun
