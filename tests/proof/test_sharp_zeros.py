"""Facts about singular points and cusps of rows whose own are known in closed form, and what makes none."""

from dataclasses import replace

import numpy as np
import pytest

from ccpin.proof.facts import NotProvedError, prove, prove_some
from ccpin.proof.zeros import Cusps, SingularPoints
from tests.support.chains import X, Z, chain
from tests.support.unfolded import CIRCLE, NONE, SWALLOW, equations_of


def fold(x=(0.0, 0.0, 1.0), origin=(1.0,), directions=((1.0,),), pairing=(1.0,)):
    return SingularPoints(CIRCLE, *(np.array([value], dtype=float) for value in (x, origin, directions, pairing)))


def cusp(x=(0.0, 0.0, 0.0, 1.0, 0.0), origin=(0.0, 0.0), directions=((1.0, 0.0), (0.0, 1.0)), pairing=(1.0,)):
    return Cusps(SWALLOW, *(np.array([value], dtype=float) for value in (x, origin, directions, pairing)))


@pytest.mark.parametrize("off", [1e-3, 1e-6, 1e-9])
def test_singular_points_are_as_near_as_is_said(off):
    """A guess that is off by ε in s, y or w: twice that is found, which is the radius of the lemma's first try."""
    for k in range(3):
        x = np.array([0.0, 0.0, 1.0])
        x[k] += off
        found = float(prove(fold(x)).found["error"][0])
        assert off <= found == pytest.approx(2.0 * off, rel=0.01, abs=2e-11)


@pytest.mark.parametrize("off", [1e-3, 1e-6, 1e-9])
def test_cusps_are_as_near_as_is_said(off):
    """The same for s, y, v and w."""
    for k in range(5):
        x = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
        x[k] += off
        found = float(prove(cusp(x)).found["error"][0])
        assert off <= found == pytest.approx(2.0 * off, rel=0.02, abs=2e-11)


def test_lines_and_planes_may_lie_otherwise():
    """The zero is where the line meets it: at s = (1 − q₀)/d; over a plane at s = −D⁻¹q₀; with any l at v = 1/l."""
    assert prove(fold((2.0, 0.0, 2.0), (0.0,), ((0.5,),), (0.5,))).found["error"][0] < 1e-11
    assert prove(fold((-2.0, 0.0, -1.0), (0.0,), ((-0.5,),), (-1.0,))).found["error"][0] < 1e-11
    plane = np.array([[0.0, 2.0], [-1.0, 0.5]])
    s = -np.linalg.solve(plane, [0.5, -0.25])
    assert prove(cusp((*s, 0.0, 2.0, 0.0), (0.5, -0.25), plane, (0.5,))).found["error"][0] < 1e-9


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_l_has_entries_of_one_at_most(side):
    """Unit vectors as rounded are let in, no more: what rounds lv is counted for these."""
    for over, good in ((0.0, True), (0.95e-9, True), (1.05e-9, False), (1.0, False)):
        one = side * (1.0 + over)
        assert prove_some(fold((0.0, 0.0, 1.0 / one), pairing=(one,)))[1].tolist() == [good]
        assert prove_some(cusp((0.0, 0.0, 0.0, 1.0 / one, 0.0), pairing=(one,)))[1].tolist() == [good]


def test_l_has_so_small_entries_all():
    """φ = (cos y − q, z − q): l = (1, 2) pairs with the kernel (1, 0) as (1, 1) does."""
    two = equations_of([chain([(1, NONE, Z, False)], np.array([X, NONE]), X)], 3, [0], [[-1, 0, 0], [-1, 0, 1]])
    for other, good in ((1.0, True), (2.0, False), (-2.0, False)):
        numbers = [0.0, 0.0, 1.0, 1.0, 0.0], [1.0], [[1.0]], [1.0, other]
        claim = SingularPoints(two, *(np.array([value]) for value in numbers))
        assert prove_some(claim)[1].tolist() == [good]


ALTERED = {
    "a solution that is regular": {"x": [0.0, 0.5, 1.0]},
    "another s": {"x": [0.5, 0.0, 1.0]},
    "the kernel's other sign": {"x": [0.0, 0.0, -1.0]},
    "a kernel of zeros": {"x": [0.0, 0.0, 0.0]},
    "no number": {"x": [np.nan, 0.0, 1.0]},
    "an endless kernel": {"x": [0.0, 0.0, np.inf]},
    "another line": {"origin": [1.5]},
    "a line that goes nowhere": {"directions": [[0.0]]},
    "an l of zeros": {"pairing": [0.0]},
    "another l": {"pairing": [-1.0]},
}


@pytest.mark.parametrize("name", ALTERED)
def test_what_is_altered_is_not_proved(name):
    """Each of these alone; a good row beside it is kept."""
    ((field, value),) = ALTERED[name].items()
    good, both = fold(), {}
    for one in ("x", "origin", "directions", "pairing"):
        other = [value] if one == field else getattr(good, one)
        both[one] = np.concatenate([getattr(good, one), np.array(other, dtype=float)])
    fact, kept = prove_some(replace(good, **both))
    assert kept.tolist() == [True, False]
    assert len(fact.claim.x) == len(fact.found["error"]) == 1


MISSHAPEN = {
    "a kernel too few": {"x": lambda x: x[:, :-1]},
    "an unknown too many": {"x": lambda x: np.concatenate([x, x[:, :1]], axis=1)},
    "a plane for a line": {"directions": lambda x: np.concatenate([x, x], axis=2)},
    "no direction": {"directions": lambda x: x[:, :, :0]},
    "an origin too many": {"origin": lambda x: np.concatenate([x, x], axis=1)},
    "one l too few": {"pairing": lambda x: x[:0]},
    "an l too many": {"pairing": lambda x: np.concatenate([x, x], axis=1)},
    "single precision": {"x": lambda x: x.astype(np.float32)},
}


@pytest.mark.parametrize("name", MISSHAPEN)
@pytest.mark.parametrize("claim", [fold, cusp])
def test_what_is_misshapen_is_refused(name, claim):
    """Whole, not row by row."""
    ((field, alter),) = MISSHAPEN[name].items()
    made = claim()
    with pytest.raises(NotProvedError):
        prove_some(replace(made, **{field: alter(getattr(made, field))}))


def test_a_fold_is_no_cusp_and_premises_are_none():
    """φ = cos y − q has one coordinate; a plane needs directions of two, a line one; zeros rest on nothing else."""
    fact = prove(fold())
    with pytest.raises(NotProvedError):
        prove(fold(), fact)
    with pytest.raises(NotProvedError):
        prove(Cusps(CIRCLE, *(getattr(fold(), name) for name in ("x", "origin", "directions", "pairing"))))
    plane = cusp()
    for x in ((0.0, 0.3, 0.0, 1.0, 0.0), (0.5, -0.08, 0.93, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0, 0.5)):
        assert not prove_some(replace(plane, x=np.array([x])))[1].any()
