"""What exact derivatives of the forward dynamics cost against central finite differences, mechanism by mechanism.

Both are timed in the same run, alternately, and compared as ratios of their shortest times, so that the figures carry
over between machines. The differences are given every advantage: each of their σ starts at the configuration itself.
Set OPENBLAS_NUM_THREADS=1: on matrices this small threads cost more than they save.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

import ccpin

MECHANISMS = ("four_bar", "rpdr", "planar_3rrr", "delta", "stewart", "hexa", "bennett", "sarrus")
STEP = 1e-6
REPEATS = 15


def central_differences(
    model: ccpin.ReducedModel, q: np.ndarray, v: np.ndarray, u: np.ndarray, guess: np.ndarray
) -> np.ndarray:
    """[∂q̈/∂q ∂q̈/∂q̇ ∂q̈/∂u] by central differences: 2 (2n + motors) forward dynamics."""
    coordinates, columns = model.coordinates, []

    def difference(function: Callable[[float], np.ndarray]) -> None:
        columns.append((function(STEP) - function(-STEP)) / (2.0 * STEP))

    for unit in np.eye(model.n):
        difference(lambda s, e=unit: model.forward_dynamics(coordinates.integrate(q, s * e), v, u, guess))
    for unit in np.eye(model.n):
        difference(lambda s, e=unit: model.forward_dynamics(q, v + s * e, u, guess))
    for unit in np.eye(model.n_actuated):
        difference(lambda s, e=unit: model.forward_dynamics(q, v, u + s * e, guess))
    return np.array(columns).T


def shortest(functions: list[Callable[[], object]], repeats: int) -> list[float]:
    """The shortest time of each function in seconds, called in turn."""
    times = np.empty((repeats, len(functions)))
    for row in times:
        for k, function in enumerate(functions):
            start = time.perf_counter()
            function()
            row[k] = time.perf_counter() - start
    return [float(best) for best in times.min(axis=0)]


def main(names: tuple[str, ...] = MECHANISMS, repeats: int = REPEATS) -> None:
    """Print a table of times and ratios, and how far the differences are from the exact derivatives."""
    head = f"{'mechanism':24}{'n':>3}{'free':>6}{'dynamics':>10}{'exact':>10}{'differences':>13}"
    print(f"{head}{'differences/exact':>19}{'exact/dynamics':>16}{'their error':>13}")
    for name in names:
        for floating in (False, True):
            model = ccpin.ReducedModel(ccpin.load(name, floating_base=floating))
            guess = model.mechanism.q_reference
            q, rng = model.alpha(guess), np.random.default_rng(0)
            state = (q, rng.normal(size=model.n), rng.normal(size=model.n_actuated), guess)
            exact = np.hstack(model.forward_dynamics_derivatives(*state))
            error = float(np.abs(central_differences(model, *state) - exact).max() / np.abs(exact).max())
            dynamics, derivatives, differences = shortest(
                [
                    lambda m=model, s=state: m.forward_dynamics(*s),
                    lambda m=model, s=state: m.forward_dynamics_derivatives(*s),
                    lambda m=model, s=state: central_differences(m, *s),
                ],
                repeats,
            )
            times = f"{1e6 * dynamics:8.0f}µs{1e6 * derivatives:8.0f}µs{1e6 * differences:11.0f}µs"
            label = f"{name}, floating" if floating else name
            print(
                f"{label:24}{model.n:3}{model.mechanism.n_free:6}{times}"
                f"{differences / derivatives:19.1f}{derivatives / dynamics:16.1f}{error:13.0e}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mechanisms", nargs="*", default=MECHANISMS, help="names or files")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    arguments = parser.parse_args()
    main(tuple(arguments.mechanisms), arguments.repeats)
