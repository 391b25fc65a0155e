"""Singular configurations against the RPDR's closed form and, elsewhere, against their definition."""

import numpy as np
import pytest

import ccpin
from ccpin.domain import serial_singularities, singularities, singularity_distance
from ccpin.errors import InvalidInputError, UnreachableError, UnsupportedMechanismError
from tests.oracles import rpdr as oracle
from tests.support.long_cases import later
from tests.support.singular import least_singular_value


@pytest.fixture(scope="module")
def curves(rpdr):
    return singularities(rpdr, starts=30)


@pytest.mark.parametrize("every", later(5, 1))
def test_folds_are_the_stretched_loop(curves, every):
    """The one fold is the closed curve √(λ² + μ²) = a₃ + a₄, to rounding, over the whole torus."""
    folds = [curve for curve in curves if curve.kind == "fold"]
    assert [curve.closed for curve in folds] == [True]
    reach = np.array([np.hypot(*oracle.elbow_offset(q)) for q in folds[0].q])
    assert np.abs(reach - (oracle.A3 + oracle.A4)).max() < 1e-10
    angles = np.linspace(-np.pi, np.pi, 200, endpoint=False)
    inside = np.hypot(*oracle.elbow_offset(np.meshgrid(angles, angles, indexing="ij"))) - oracle.A3 - oracle.A4
    crossing = np.argwhere(np.sign(inside) != np.sign(np.roll(inside, 1, axis=1)))
    wrapped = np.remainder(folds[0].q + np.pi, 2 * np.pi) - np.pi
    for i, j in crossing[::every]:
        gap = np.remainder(wrapped - [angles[i], angles[j]] + np.pi, 2 * np.pi) - np.pi
        assert np.abs(gap).max(axis=1).min() < 2 * np.pi / 200 + 0.02


def test_self_motions_are_the_two_isolated_points(curves):
    """Exactly two, ±(56.944°, 123.056°), where the elbows coincide and links 3 and 4 turn together."""
    points = sorted((curve.q[0] for curve in curves if curve.kind == "self-motion"), key=lambda q: q[0])
    expected = np.arccos(oracle.C / 2 / oracle.A1)
    assert np.allclose(points, [[-expected, expected - np.pi], [expected, np.pi - expected]], atol=1e-8)
    for curve in curves:
        if curve.kind == "self-motion":
            assert curve.closed
            assert np.ptp(curve.q_free, axis=0).max() > 6.0


@pytest.mark.parametrize("name", ["four_bar", "delta", "bennett"])
def test_what_cannot_be_followed_is_refused(name):
    """n ≠ 2 or redundant rows are refused with the reason."""
    with pytest.raises(UnsupportedMechanismError):
        singularities(ccpin.load(name))


def test_distance_vanishes_towards_a_singularity(rpdr_model):
    """Along a line to the isolated point the measure falls to zero linearly; away from it, it stays up."""
    point = np.array([-1.0, 1.0]) * np.arccos(oracle.C / 2 / oracle.A1) + [0.0, -np.pi]
    path = point + np.linspace(0.4, 0.004, 30)[:, None] * [-1.0, 0.6]
    found = singularity_distance(rpdr_model, path)
    assert np.all(np.diff(found.measure) < 0)
    assert found.measure[-1] < 0.02 * found.measure[0]
    shape = found.q_free @ [1.0, 1.0, -1.0, -1.0]
    assert np.allclose(
        found.measure[-5:] / np.abs(np.sin(shape[-5:])), (found.measure / np.abs(np.sin(shape)))[-1], rtol=0.2
    )


def test_distance_refuses_bad_paths(rpdr_model):
    """Wrong shapes and paths out of the workspace raise."""
    with pytest.raises(InvalidInputError):
        singularity_distance(rpdr_model, np.zeros((3, 5)))
    with pytest.raises(UnreachableError):
        singularity_distance(rpdr_model, [[-1.6, -1.6], [1.5, -1.5]])


@pytest.mark.slow
def test_serial_curves_are_the_stretched_and_folded_arms(rpdr):
    """The tip loses a direction exactly where sin q3 = 0 or sin q4 = 0: an arm stretched or folded, each a curve."""
    curves = serial_singularities(rpdr, "link3", (oracle.A3, 0.0, 0.0))
    names = list(rpdr.pin_model.names)[1:]
    q3, q4 = names.index("joint3"), names.index("joint4")
    found = set()
    for curve in curves:
        assert curve.kind == "serial"
        bends = np.abs(np.sin(curve.q_free[:, [q3, q4]])).max(axis=0)
        arm = int(np.argmin(bends))
        assert bends[arm] < 1e-9
        found.add((arm, np.sign(np.cos(curve.q_free[0, (q3, q4)[arm]]))))
    assert {arm for arm, _ in found} == {0, 1}


def test_serial_singularities_of_unknown_links_are_refused(rpdr):
    """A link that does not exist, and a spatial mechanism, are refused."""
    with pytest.raises(InvalidInputError, match="nosuch"):
        serial_singularities(rpdr, "nosuch")
    with pytest.raises(UnsupportedMechanismError, match="planar"):
        serial_singularities(ccpin.load("delta"), "platform")


def test_verdicts_of_curves(rpdr, curves):
    """all of the fold is proved, self-motions are undecided; at the fold's points the proof is as near."""
    verdicts = {curve.kind: curve.verdict for curve in curves}
    assert verdicts == {"fold": "proven", "self-motion": "undecided"}
    fold = next(curve for curve in curves if curve.kind == "fold")
    off = np.array([abs(oracle.elongation(q) - 1.0) for q in fold.q])
    assert np.all(off <= 10.0 * fold.error)
    assert fold.error.max() < 1e-9
    assert all(least_singular_value(rpdr, q_free) < 1e-9 for q_free in fold.q_free[::50])
