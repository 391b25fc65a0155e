"""The planar 3-RPR of docs/howto in closed form, with NumPy alone: its assembly modes as roots of a sextic, its cusps.

The platform's pins are B₁ = (x, y), B₂ = B₁ + d₁e^{iφ}, B₃ = B₁ + b₃e^{iφ}. The differences of |B_k − A_k|² = ρ_k² are
linear in (x, y); put into the first they leave a trigonometric polynomial g(φ) of degree three: six roots at most.
"""

import numpy as np

A2, A3, D1 = 0.1591, 0.1j, 0.1704
_C = (0.1704**2 + 0.2084**2 - 0.1654**2) / (2 * 0.1704 * 0.2084)
B3 = 0.2084 * (_C + 1j * np.sqrt(1 - _C**2))


SHAPE = A2, A3, D1, B3


def _eliminated(lengths, phi, shape=SHAPE):
    """(X, Y, Δ) with B₁ − A₁ = (X + iY)/Δ for leg lengths (..., 3) and angles that broadcast with (...)."""
    a2, a3, d1, b3 = shape
    turn = np.exp(1j * phi)
    u2, u3 = d1 * turn - a2, b3 * turn - a3
    k2 = lengths[..., 1] ** 2 - lengths[..., 0] ** 2 - np.abs(u2) ** 2
    k3 = lengths[..., 2] ** 2 - lengths[..., 0] ** 2 - np.abs(u3) ** 2
    delta = 2.0 * (u2.real * u3.imag - u2.imag * u3.real)
    return k2 * u3.imag - k3 * u2.imag, u2.real * k3 - u3.real * k2, delta


def coefficients(lengths, shape=SHAPE):
    """The Fourier coefficients c_{−3} … c_3 of g(φ) = X² + Y² − ρ₁²Δ², for lengths (K, 3), of shape (K, 7).

    The shape is A₂ − A₁, A₃ − A₁ (of shape (K, 1), or one for all), B₂ − B₁ and B₃ − B₁ in the platform's frame.
    """
    phi = 2.0 * np.pi * np.arange(8) / 8
    x, y, delta = _eliminated(lengths[:, None], phi, shape)
    g = x**2 + y**2 - lengths[:, None, 0] ** 2 * delta**2
    found = np.fft.fft(g, axis=1) / 8
    return np.concatenate([found[:, -3:], found[:, :4]], axis=1)


def modes(lengths, near=1e-5, shape=SHAPE):
    """How many assembly modes lengths (K, 3) have, (K,), and whether rounding could decide that, (K,)."""
    c = coefficients(lengths, shape)
    companion = np.zeros((len(c), 6, 6), dtype=complex)
    companion[:, np.arange(1, 6), np.arange(5)] = 1.0
    companion[:, :, 5] = -c[:, :6] / c[:, 6:]
    roots = np.linalg.eigvals(companion)
    off = np.abs(np.abs(roots) - 1.0)
    gap = np.abs(roots[:, :, None] - roots[:, None]) + 9.0 * np.eye(6)
    return np.sum(off < near, axis=1), gap.min(axis=(1, 2)) < 10.0 * np.sqrt(near)


def platform(lengths, phi):
    """B₁ as a complex number, for one platform angle."""
    x, y, delta = _eliminated(np.asarray(lengths), phi)
    return (x + 1j * y) / delta


def closing_error(lengths, b1, phi):
    """The largest error of the three leg lengths at a pose."""
    turn = np.exp(1j * phi)
    found = np.abs([b1, b1 + D1 * turn - A2, b1 + B3 * turn - A3])
    return np.abs(found - lengths).max()


def cusps(rho1, grid=120):
    """The leg lengths (ρ₂, ρ₃) of all cusps of the slice ρ₁, of shape (K, 2).

    A configuration with B₁ = ρ₁e^{iα} and platform angle φ has a triple root of g where g_φ = g_φφ = 0 at its own
    lengths. Newton's method from a grid of (α, φ) finds those; its derivatives are differences.
    """

    def residual(at):
        alpha, phi = at[..., 0], at[..., 1]
        b1 = rho1 * np.exp(1j * alpha)
        lengths = np.stack(
            [
                np.full(alpha.shape, rho1),
                np.abs(b1 + D1 * np.exp(1j * phi) - A2),
                np.abs(b1 + B3 * np.exp(1j * phi) - A3),
            ],
            axis=-1,
        )
        c, order = coefficients(lengths), np.arange(-3, 4)
        wave = c * np.exp(1j * order * phi[:, None])
        return np.stack([(1j * order * wave).sum(1).real, (-(order**2) * wave).sum(1).real], axis=1) * 1e4, lengths

    angles = 2.0 * np.pi * np.arange(grid) / grid
    at = np.stack(np.meshgrid(angles, angles), axis=-1).reshape(-1, 2)
    for _ in range(60):
        value, step = residual(at)[0], 1e-6
        slope = np.stack(
            [(residual(at + step * e)[0] - residual(at - step * e)[0]) / (2 * step) for e in np.eye(2)], axis=2
        )
        with np.errstate(all="ignore"):
            move = -np.linalg.solve(slope + 1e-300 * np.eye(2), value[..., None])[..., 0]
        at = at + move * np.minimum(1.0, 0.2 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-300))
    value, lengths = residual(at)
    delta = _eliminated(lengths, at[:, 1])[2]
    good = (np.abs(value).max(axis=1) < 1e-11) & (np.abs(delta) > 1e-5)
    found = []
    for one in lengths[good][:, 1:]:
        if all(np.abs(one - other).max() > 1e-5 for other in found):
            found.append(one)
    return np.array(found)


def singular_poses(rho1, count, rng, grid=400):
    """(α, φ) of singular configurations with B₁ = ρ₁e^{iα}: all platform angles of random α, of shape (K, 2).

    ∂(ρ₂, ρ₃)/∂(α, φ) has determinant zero there; its sign changes over a grid of φ are halved down to rounding.
    """
    alpha, phi = rng.uniform(-np.pi, np.pi, (count, 1)), np.linspace(-np.pi, np.pi, grid)[None]
    sign = np.sign(_determinant(rho1, alpha, phi))
    row, column = np.nonzero(sign[:, 1:] != sign[:, :-1])
    alpha, low, high = alpha[row, 0], phi[0, column], phi[0, column + 1]
    below = sign[row, column]
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = np.sign(_determinant(rho1, alpha, middle)) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.column_stack([alpha, 0.5 * (low + high)])


def legs(rho1, alpha, phi):
    """The second and the third leg as complex numbers, from base to platform."""
    b1, turn = rho1 * np.exp(1j * alpha), np.exp(1j * phi)
    return b1 + D1 * turn - A2, b1 + B3 * turn - A3


def _determinant(rho1, alpha, phi):
    """det ∂(½ρ₂², ½ρ₃²)/∂(α, φ)."""
    second, third = legs(rho1, alpha, phi)
    swing, turn = 1j * rho1 * np.exp(1j * alpha), 1j * np.exp(1j * phi)
    first = (second.conjugate() * swing).real * (third.conjugate() * B3 * turn).real
    return first - (second.conjugate() * D1 * turn).real * (third.conjugate() * swing).real
