"""The bounds of V∘σ where they are attained: cubic functions, for which Taylor's formula is exact."""

import numpy as np
import pytest

from ccpin.control.stability.set_point.potential import (
    _curvature_change,
    _Expansion,
    _inverse_bound,
    _remainder,
    _slope_bound,
    _symmetric,
)
from ccpin.control.stability.set_point.potential import _variation as variation_of
from ccpin.proof.newton import Boxes

N, M, P = 4, 2, 2


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def cubic(rng, margin=0.0):
    """(f, L) with nonnegative derivatives at the centre, second ones growing along Dh + ER by `drift`."""
    slope = rng.uniform(0.1, 1, (1, M + 1, N))
    curvature = rng.uniform(0.1, 1, (1, M + 1, N, N))
    curvature = curvature + np.swapaxes(curvature, 2, 3)
    third = rng.uniform(0.1, 1, (M + 1, N, N, N))
    third = sum(
        np.transpose(third, (0, *p)) for p in ((1, 2, 3), (1, 3, 2), (2, 1, 3), (2, 3, 1), (3, 1, 2), (3, 2, 1))
    )
    directions, modes = rng.uniform(0.1, 1, (1, N, P)), np.zeros((1, N, M))
    modes[:, 2:] = rng.uniform(0.1, 1, (1, M, M))
    half, radius = rng.uniform(0.1, 0.5, (1, P)), rng.uniform(0.1, 0.5, (1, M))
    moves = directions[0] @ half[0] + modes[0] @ radius[0]
    boxes = Boxes(
        np.zeros((1, N)), half, directions, np.zeros((1, M, M)), np.tile(np.eye(M), (1, 1, 1)), radius,
        rng.uniform(0.5, 1, (1, M)), np.array([0.5]),
    )  # fmt: skip
    drift = np.einsum("rijk,k->rij", third, moves)[None]
    return third, _Expansion(
        boxes, modes, moves[None], np.zeros(1), slope, curvature, drift, np.full((1, M + 1), margin)
    )


def value(third, box, theta, row=-1):
    """The cubic itself."""
    square = 0.5 * theta @ box.curvature[0, row] @ theta
    return box.slope[0, row] @ theta + square + np.einsum("ijk,i,j,k->", third[row], theta, theta, theta) / 6


def slope_at(third, box, theta):
    return box.slope[0] + box.curvature[0] @ theta + 0.5 * np.einsum("rijk,j,k->ri", third, theta, theta)


def test_the_remainder_is_attained_at_a_corner_of_a_cubic(rng):
    """L − L_c − L_θDδ − ½δᵀHδ at δ = h, ζ = R is its bound, sixth and halves included."""
    for _ in range(5):
        third, box = cubic(rng)
        move = box.boxes.directions[0] @ box.boxes.half[0]
        line, hessian = box.slope[0, -1] @ move, move @ box.curvature[0, -1] @ move
        left = value(third, box, box.moves[0]) - line - 0.5 * hessian
        np.testing.assert_allclose(_remainder(box)[0], left, rtol=1e-12)


def test_roundings_of_the_value_and_of_slopes_are_added(rng):
    _, box = cubic(rng)
    noisy = box._replace(margin=np.array([[0.5, 1.0, 2.0]]))
    far = 1 + box.moves.sum()
    np.testing.assert_allclose(_remainder(noisy) - _remainder(box), [2.0 * far**2], rtol=1e-12)
    added = _slope_bound(noisy, box.modes, 0.0) - _slope_bound(box, box.modes, 0.0)
    stated = noisy.margin[0][:, None] * far * np.abs(box.modes[0]).sum(axis=0)
    np.testing.assert_allclose(added[0], stated, rtol=1e-12)
    eta = rng.uniform(0.1, 1, (1, M, P))
    rho = box.boxes.directions[0] + box.modes[0] @ eta[0]
    added = _curvature_change(noisy, eta) - _curvature_change(box, eta)
    size = rho.sum(axis=0)
    np.testing.assert_allclose(added[0], noisy.margin[0][:, None, None] * np.outer(size, size), rtol=1e-12)


def test_slopes_are_bounded_by_those_at_a_corner_of_a_cubic(rng):
    third, box = cubic(rng)
    for columns in (box.modes, box.boxes.directions):
        at_corner = slope_at(third, box, box.moves[0]) @ columns[0]
        np.testing.assert_allclose(_slope_bound(box, columns, 0.0)[0], at_corner, rtol=1e-12)
    off = _slope_bound(box, box.modes, -1.0) - _slope_bound(box, box.modes, 0.0)
    np.testing.assert_allclose(off, 1.0, rtol=1e-12)


def test_curvatures_are_bounded_by_those_at_a_corner_of_a_cubic(rng):
    """ρᵀL_θθρ − DᵀL_θθ(θ_c)D with ρ = D + Eη."""
    _, box = cubic(rng)
    eta = rng.uniform(0.1, 1, (1, M, P))
    rho = box.boxes.directions[0] + box.modes[0] @ eta[0]
    corner = np.einsum("ia,rij,jb->rab", rho, box.curvature[0] + box.drift[0], rho)
    still = np.einsum("ia,rij,jb->rab", box.boxes.directions[0], box.curvature[0], box.boxes.directions[0])
    np.testing.assert_allclose(_curvature_change(box, eta)[0], corner - still, rtol=1e-12)


def test_inverses_are_bounded_by_the_contraction_and_no_more():
    """Z = diag(¼) with κ = ½: (1 − ¼)⁻¹ is reached from (1 − ½)⁻¹ in six steps, within (¼)⁶; never passed."""
    one = np.ones((1, 2))
    boxes = Boxes(one, one, one, one, one, one, np.array([[1.0, 2.0]]), np.array([0.5]))
    x = np.array([[[3.0], [1.0]]])
    bound = _inverse_bound(boxes, np.eye(2)[None] * 0.25, x)
    assert np.all(bound >= x / 0.75)
    np.testing.assert_allclose(bound, x / 0.75, rtol=1e-2)
    loose = _inverse_bound(boxes, np.full((1, 2, 2), 1e9), x)  # nothing to sharpen with: max(3/1, 1/2) w/(1 − κ)
    np.testing.assert_allclose(loose[0, :, 0], [6.0, 12.0], rtol=1e-12)


def test_the_hessians_variation_is_its_change_and_the_solutions_curvature(rng):
    """∂g/∂q = ρᵀL_θθρ + L_ζζ″ with |ζ″| ≤ |f_ζ⁻¹| |f_θθ(ρ, ρ)|, added up by hand."""
    _, box = cubic(rng)
    eta, pull = rng.uniform(0.1, 1, (1, M, P)), 0.1 * rng.uniform(0.1, 1, (1, M + 1, M))
    change = _curvature_change(box, eta)
    D = box.boxes.directions[0]
    bent = np.einsum("ia,rij,jb->rab", D, box.curvature[0, :M], D) + change[0, :M]
    second = _inverse_bound(box.boxes, pull[:, :M], bent[None])[0]
    stated = change[0, M] + np.einsum("m,mab->ab", pull[0, M], second)
    np.testing.assert_allclose(variation_of(box, pull, eta)[0], stated, rtol=1e-12)


def test_a_symmetric_part_is_the_mean_of_a_matrix_and_its_transpose():
    np.testing.assert_array_equal(_symmetric(np.array([[[1.0, 2.0], [6.0, 3.0]]])), [[[1.0, 4.0], [4.0, 3.0]]])
