"""The lemma on prolonged systems at equality: η + κr = r, and each rounding that goes into η and κ."""

import numpy as np
import pytest

from ccpin.proof import prolongations as module
from ccpin.proof.prolongations import proved_within

U = 2.0**-53


def within(value, slope, weight, rounding, change):
    """The radius for one point, `change` being |F′(x) − F′(x₀)|, the same at all radii."""
    count = len(value)
    rounding, change = np.full((1, count, count), rounding), np.asarray(change, float) * np.ones((1, count, count))
    value, slope = np.array([value], float), np.array([slope], float)
    return proved_within(value, slope, np.array([weight]), rounding, lambda rows, radius: change)[0]


@pytest.mark.parametrize(("radius", "last"), [(2.0, 1 / 2), (8.0, 7 / 8), (64.0, 63 / 64)])
def test_radii_are_proved_up_to_where_the_image_touches_the_end(radius, last):
    """η + κ · kη < kη up to κ = 1 − 1/k, whatever Ã's size."""
    for size in (1.0, -4.0):
        assert within([0.5], [[size]], 0.0, 0.0, abs(size) * (last - 1e-9)) == pytest.approx(radius * 0.5 / abs(size))
        beyond = within([0.5], [[size]], 0.0, 0.0, abs(size) * (last - 1e-11))
        assert not beyond <= radius * 0.5 / abs(size) * (1 + 1e-9)
    assert np.isnan(within([0.5], [[1.0]], 0.0, 0.0, 1.0))


def test_two_errors_of_two_equations_add_up():
    """κ sums over the unknowns: ¼ + ¼ is let in at r = 4η and over, not at 2η."""
    assert within([1.0, 1.0], np.eye(2), 0.0, 0.0, 0.25 - 1e-9) == pytest.approx(2.0)
    assert within([1.0, 1.0], np.eye(2), 0.0, 0.0, 0.25 + 1e-9) == pytest.approx(8.0)


def test_roundings_of_f_and_of_its_slope_count():
    """η holds weight (γ + 4u) and 8ku|F|, κ holds γ: 3 · 0.1 and 0.1, 0.3999 being what is left of ½."""
    assert within([0.0], [[1.0]], 3.0, 0.1, 0.3999) == pytest.approx(0.6, rel=1e-9)
    assert within([0.0], [[1.0]], 3.0, 0.1, 0.4001) == pytest.approx(2.4, rel=1e-9)
    assert within([0.0], [[1.0]], 2.0**50, 0.0, 0.1) == pytest.approx(2.0**51 * 4 * U, rel=1e-9)
    assert within(np.ones(16), np.eye(16), 0.0, 0.0, 0.0) / 2 - 1 == pytest.approx(128 * U, rel=0.02, abs=0.0)


def test_the_rounding_of_a_times_the_slope_counts_with_its_condition():
    """8ku |Ã||F′| is 3.6e-8 for [1 1e7; 0 1]."""
    steep, lost = [[1.0, 1e7], [0.0, 1.0]], 16 * U * 2e7
    for share, radius in ((1.05, 2.0), (0.95, 8.0)):
        change = [[0.5 - share * lost, 0.0], [0.0, 0.0]]
        assert within([1.0, 0.0], steep, 0.0, 0.0, change) == pytest.approx(radius, rel=1e-9)


def test_an_inverse_that_is_none_counts(monkeypatch):
    """A = 0.9 for a slope of 1 leaves |1 − 0.9| of κ = 0.1 + 0.9 Δ."""
    monkeypatch.setattr(module, "inverses", lambda slope: np.full((1, 1, 1), 0.9))
    assert within([0.5], [[1.0]], 0.0, 0.0, 0.4444) == pytest.approx(0.9)
    assert within([0.5], [[1.0]], 0.0, 0.0, 0.4445) == pytest.approx(3.6)


def test_rounding_of_one_entry_of_a_slope_counts():
    """As the largest of all entries it is what F may be off by."""
    rounding = np.array([[[0.0, 0.0], [0.0, 1e-3]]])
    none = np.zeros((1, 2))
    found = proved_within(none, np.eye(2)[None], np.ones(1), rounding, lambda rows, _: np.zeros((len(rows), 2, 2)))
    assert found[0] > 1e-3
