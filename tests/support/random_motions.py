"""Random Fourier motions within a box and speeds, and the best of many: what a motion found is held beside."""

import numpy as np

HARMONICS, SAMPLES = 5, 80


def least_of_random(model, effects, limits, duration, count=1000):
    """The least condition number of W and the least trace of (WᵀW)⁻¹ of random motions, and how many left Ω.

    Args:
        model: The reduced model.
        effects: How W follows from the regressor.
        limits: The box's middle, of shape (n,), half its width and the largest speed.
        duration: Of a motion, s.
        count: How many.
    """
    middle, half, speed = limits
    n, draw = model.n, np.random.default_rng(5)
    w = 2.0 * np.pi / duration * np.arange(1, HARMONICS + 1)[:, None]
    sines, cosines = (turn(w * np.linspace(0.0, duration, SAMPLES)).T for turn in (np.sin, np.cos))
    condition = trace = np.inf
    left = 0
    for _ in range(count):
        a, b = draw.normal(size=(2, HARMONICS, n))
        q, v = sines @ a + cosines @ b, cosines @ (w * a) - sines @ (w * b)
        acceleration = -(sines @ (w**2 * a) + cosines @ (w**2 * b))
        size = min(half / np.abs(q).max(), speed / np.abs(v).max())
        failures: dict[int, str] = {}
        Y = model.regressor_many(middle + size * q, size * v, size * acceleration, failures=failures)
        if failures:
            left += 1
            continue
        sizes = np.linalg.svd(effects.reduced(Y), compute_uv=False)
        condition, trace = min(condition, sizes[0] / sizes[-1]), min(trace, float(np.sum(1.0 / sizes**2)))
    return condition, trace, left
