"""The RPDR balanced upside down: a linear-quadratic regulator from the exact linear model of the reduced dynamics.

The end effector stands above the base, where gravity pulls both arms away from the set point. Prints the eigenvalues
of the linear model with and without the regulator, and how a simulated motion from a displaced start ends.
"""

import numpy as np
from scipy.linalg import solve_continuous_are

import ccpin
from ccpin.dynamics import linearize

Q_GOAL = np.radians([90.0, 90.0])
UPWARD = np.radians([90.0, -30.0, 90.0, 30.0])  # joint1, joint3, joint2, joint4: the assembly mode
Q_START = np.radians([100.0, 75.0])
STATE_WEIGHT = np.diag([100.0, 100.0, 1.0, 1.0])  # per rad² and (rad/s)²
EFFORT_WEIGHT = np.diag([1.0, 1.0])  # per (N m)²
DURATION = 3.0  # s


def main() -> None:
    """Linearise about the upright equilibrium, solve the Riccati equation, and simulate the closed loop."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    effort = model.gravity(Q_GOAL, UPWARD)
    linear = linearize(model, Q_GOAL, effort, near=UPWARD)
    riccati = solve_continuous_are(linear.A, linear.B, STATE_WEIGHT, EFFORT_WEIGHT)
    gain = np.linalg.solve(EFFORT_WEIGHT, linear.B.T @ riccati)
    closed = linear.closed_loop(-gain[:, :2], -gain[:, 2:])

    def law(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return effort - gain @ np.concatenate([q - Q_GOAL, v])

    trajectory = ccpin.simulate(model, law, Q_START, duration=DURATION, near=UPWARD)
    error = np.degrees(np.abs(trajectory.q - Q_GOAL).max(axis=1))
    print(f"RPDR upright, held by {effort.round(4)} N m")
    print(f"  eigenvalues without control {_show(np.linalg.eigvals(linear.A))} 1/s")
    print(f"  eigenvalues under the LQR   {_show(np.linalg.eigvals(closed))} 1/s")
    print(f"  simulated {DURATION} s: off by {error[0]:.1f}° at the start, {error[-1]:.1e}° at the end")


def _show(eigenvalues: np.ndarray) -> str:
    return ", ".join(f"{value:.3f}" for value in sorted(eigenvalues, key=lambda value: (value.real, value.imag)))


if __name__ == "__main__":
    main()
