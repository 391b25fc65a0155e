"""Bounds that hold only where every entry does: one entry that fails is enough, whichever it is."""

from types import SimpleNamespace

import numpy as np
import pytest
from flint import arb

from ccpin.auditing.boxes import contracts
from ccpin.control.stability.tracking.storage import inverted
from ccpin.proof import narrowing, newton
from ccpin.proof.balls import Affine, inverse, product
from ccpin.proof.newton import holds, noise_of, reached
from ccpin.proof.rounding import widened

ONES, I2 = np.ones((1, 2)), np.eye(2)[None]


class Said:
    """Bounds that say what they are told."""

    def __init__(self, y, shrunk):
        self.y, self._shrunk = np.array([y]), np.array([shrunk])

    def mean(self, _):
        return SimpleNamespace(of=lambda reach: 0.0 * reach)

    def contraction(self, *_):
        return SimpleNamespace(of=lambda _: self._shrunk)


@pytest.mark.parametrize(
    ("y", "shrunk", "weight", "proved"),
    [
        ((0.1, 0.1), (0.1, 0.1), (1.0, 1.0), True),
        ((0.1, 2.0), (0.1, 0.1), (1.0, 1.0), False),
        ((0.1, 0.1), (0.1, 0.9), (1.0, 1.0), False),
        ((0.1, 0.1), (0.1, 0.0), (1.0, 0.0), False),
    ],
)
def test_a_box_is_proved_by_all_its_coordinates(y, shrunk, weight, proved):
    boxes = SimpleNamespace(radius=ONES, weight=np.array([weight]), kappa=np.array([0.5]))
    assert bool(holds(Said(y, shrunk), boxes).proved[0]) is proved


def test_parameters_are_measured_from_the_largest_coordinate():
    system = SimpleNamespace(n=1, independent=np.array([0]))
    boxes = SimpleNamespace(half=np.ones((1, 3)), centre=np.array([[1.0, -5.0, 2.0]]))
    np.testing.assert_array_equal(reached(system, boxes), widened(np.full((1, 3), 5.0), boxes.half))


def test_a_solution_is_in_a_tube_by_all_its_coordinates(monkeypatch):
    monkeypatch.setattr(newton, "predict", lambda *_: np.zeros((1, 2)))
    system = SimpleNamespace(dependent=np.array([0, 1]), periodic=np.zeros(2, dtype=bool), m=2)
    boxes = SimpleNamespace(modes=I2, directions=np.zeros((1, 2, 1)), radius=1e-3 * ONES)
    for beyond, enclosed in ((0.0, True), (5e-3, False)):
        theta = np.array([[0.0, beyond]])
        found = newton.encloses(SimpleNamespace(system=system), boxes, np.zeros((1, 1)), theta, np.zeros((1, 2)))
        assert bool(found[0]) is enclosed


def test_rounding_counts_by_rows():
    system = SimpleNamespace(dependent=np.array([0, 1]))
    boxes = SimpleNamespace(
        preconditioner=np.diag([1.0, 100.0])[None],
        centre=np.zeros((1, 2)),
        directions=np.zeros((1, 2, 1)),
        half=np.zeros((1, 1)),
        modes=I2,
        radius=ONES,
    )
    assert noise_of(SimpleNamespace(system=system, rounding=lambda _: np.ones(1)), boxes).tolist() == [[1.0, 100.0]]


def test_parameters_of_boxes_add_up_and_those_of_balls_do_not():
    """Two parameters that vary by themselves swing by 3 + 4, in sums, products and solutions with what has none."""
    boxed = Affine(np.zeros((1, 1, 1)), np.array([3.0, 4.0]).reshape(2, 1, 1, 1), np.zeros((1, 1, 1)), 2)
    plain = Affine(np.ones((1, 1, 1)), np.zeros((0, 1, 1, 1)), np.zeros((1, 1, 1)), 0)
    for found in (boxed + plain, plain + boxed, product("bij,bjk->bik", boxed, plain), inverse(plain).solve(boxed)):
        assert found.swing.ravel() == pytest.approx([7.0])
        assert found.boxed == 2


def test_a_remainder_of_one_entry_is_kept_in_products():
    a = Affine(np.ones(2), np.zeros((0, 2)), np.array([0.0, 0.5]), 0)
    b = Affine(np.ones(2), np.zeros((0, 2)), np.zeros(2), 0)
    assert product("i,i->i", a, b).rad[1] >= 0.5


def test_matrices_are_regular_by_all_their_rows():
    rad = np.array([[[0.0, 0.0], [0.0, 2.0]]])
    assert not inverse(Affine(I2, np.zeros((0, 1, 2, 2)), rad, 0)).regular[0]


def test_a_solution_is_alone_by_all_its_coordinates(monkeypatch):
    system = SimpleNamespace(dependent=np.array([0, 1]))
    boxes = SimpleNamespace(
        modes=I2,
        centre=np.zeros((1, 2)),
        directions=np.zeros((1, 2, 1)),
        half=np.zeros((1, 1)),
        radius=0.1 * ONES,
        weight=ONES,
    )
    held = SimpleNamespace(centre=np.zeros((1, 2)), half=0.5 * ONES, slopes=np.zeros((1, 2, 1)))
    for shrunk, alone in (((0.01, 0.5), True), ((0.01, 5.0), False)):
        monkeypatch.setattr(narrowing, "bounds_of", lambda *_, said=shrunk: Said((0.0, 0.0), said))
        assert bool(narrowing.alone_in(SimpleNamespace(system=system), boxes, held)[0]) is alone


def test_what_is_not_definite_has_no_inverse():
    for entries in ([[1.0, 0.0], [0.0, 0.0]], [[1.0, np.nan], [np.nan, 1.0]]):
        assert np.isinf(inverted(np.array([entries]))).all()


def test_powers_converge_by_all_rows():
    """(I − M)⁻¹1 = (1, −1) is no weight, though Mw < w."""
    zero = arb(0)
    assert contracts([[arb(0.5), zero], [zero, arb(0.5)]])
    assert not contracts([[zero, zero], [zero, arb(2)]])
