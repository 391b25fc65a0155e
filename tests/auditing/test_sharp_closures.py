"""The auditor's φ and what it derives of it, against rotations and differences in plain floating point."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccpin.proof.chains import Chain
from tests.support.chains import X, Z, chain

pytest.importorskip("flint")

from flint import arb, arb_mat

from ccpin.auditing.closures import BallClosures, cross, floats

SIZE = 6
NEAR = 2.0**-50


def some_chain(rng, joints, slides, direction, rows):
    count = len(joints)
    axes = rng.normal(size=(count, 3))
    return Chain(
        np.array(joints),
        Rotation.random(count, random_state=rng).as_matrix(),
        rng.normal(size=(count, 3)),
        axes / np.linalg.norm(axes, axis=1)[:, None],
        np.array(slides),
        rng.normal(size=3),
        direction,
        rng.normal(size=(rows, 3)),
    )


@pytest.fixture(scope="module")
def document():
    """Two points and a direction, turns and slides in all orders, and a row of couplings."""
    rng = np.random.default_rng(5)
    chains = (
        some_chain(rng, [0, 2, 1, 3, 4], [False, True, False, False, False], False, 3),
        some_chain(rng, [4, 3, 5], [True, False, False], False, 3),
        some_chain(rng, [1, 4, 2, 5], [False, True, True, False], True, 3),
    )
    return SimpleNamespace(
        chains=chains, couplings=rng.normal(size=(3, SIZE)), offset=rng.normal(size=3), moduli=np.zeros(3)
    )


def plain(document, theta):
    """φ by matrices of Rotation."""
    phi = document.couplings @ theta + document.offset
    for c in document.chains:
        R, x = np.eye(3), np.zeros(3)
        for k, j in enumerate(c.joints):
            x = x + R @ c.translations[k]
            R = R @ c.rotations[k]
            if c.prismatic[k]:
                x = x + R @ c.axes[k] * theta[j]
            else:
                R = R @ Rotation.from_rotvec(c.axes[k] * theta[j]).as_matrix()
        phi = phi + c.weights @ (R @ c.tip if c.direction else x + R @ c.tip)
    return phi


def balls(values):
    return [arb(float(x)) for x in values]


def slope(f, theta, direction, step=1e-4):
    """The derivative along a direction by differences of fourth order."""
    near, far = (f(theta + s * step * direction) - f(theta - s * step * direction) for s in (1, 2))
    return (8.0 * near - far) / (12.0 * step)


def test_values_are_those_of_rotations(document):
    own, rng = BallClosures(document), np.random.default_rng(1)
    for _ in range(5):
        theta = rng.uniform(-2.0, 2.0, SIZE)
        np.testing.assert_allclose(own.at(theta)[0], plain(document, theta), rtol=0, atol=1e-13)


def test_derivatives_are_those_of_what_they_derive(document):
    own, rng = BallClosures(document), np.random.default_rng(2)
    theta, one, other = rng.normal(size=(3, SIZE))

    def varied(at):
        return floats(own.variation(own.motions(balls(at)), balls(one)))

    jacobian = own.at(theta)[1]
    by_column = np.array([slope(lambda at: own.at(at)[0], theta, e) for e in np.eye(SIZE)]).T
    np.testing.assert_allclose(jacobian, by_column, rtol=0, atol=1e-9)
    np.testing.assert_allclose(varied(theta), slope(lambda at: own.at(at)[1], theta, one), rtol=0, atol=1e-9)
    second = floats(own.second_variation(own.motions(balls(theta)), balls(one), balls(other)))
    np.testing.assert_allclose(second, slope(varied, theta, other), rtol=0, atol=1e-9)


def test_cross_products():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 3))
    found = cross(arb_mat(3, 1, balls(a)), arb_mat(3, 1, balls(b)))
    np.testing.assert_allclose(floats(found)[:, 0], np.cross(a, b), atol=1e-15)


def test_rotations_and_axes_are_within_their_roundings(document):
    """2⁻⁵⁰, of every entry; a rotation that is I, exactly, is meant so."""
    for path, c in zip(BallClosures(document).paths, document.chains, strict=True):
        for k, turn in enumerate(path.turns):
            for matrix, numbers in ((turn.rotation, c.rotations[k]), (turn.axis, c.axes[k][:, None])):
                radii = [float(x.rad()) for x in matrix.entries()]
                np.testing.assert_allclose(radii, NEAR, rtol=1e-6)
                np.testing.assert_array_equal(floats(matrix), numbers)
            assert max(float(x.rad()) for x in turn.translation.entries()) == 0.0
    still = BallClosures(
        SimpleNamespace(
            chains=(chain([(0, X, Z, False)], np.eye(3)),),
            couplings=np.zeros((3, 1)),
            offset=np.zeros(3),
            moduli=np.zeros(3),
        )
    )
    assert max(float(x.rad()) for x in still.paths[0].turns[0].rotation.entries()) == 0.0


@pytest.mark.parametrize("modulus", [1.0, 2.0 * np.pi])
def test_rows_known_modulo_something_have_their_least_value(modulus):
    document = SimpleNamespace(
        chains=(), couplings=np.array([[3.0], [1.0]]), offset=np.array([0.25, 0.5]), moduli=np.array([modulus, 0.0])
    )
    own = BallClosures(document)
    for turns in (-2, 0, 5):
        theta = (0.125 + turns * modulus) / 3.0
        np.testing.assert_allclose(own.at(np.array([theta]))[0], [0.375, theta + 0.5], atol=1e-13)
