"""What σ refuses because the way to q ends: seen by the core, said as the reference says it, and true."""

from unittest.mock import patch

import numpy as np
import pytest

import ccpin
from ccpin import native
from ccpin.errors import CcpinError, SingularConfigurationError, UnreachableError
from ccpin.kinematics import parametrization
from tests.oracles import rpdr as oracle
from tests.support.agreement import reference_model
from tests.support.long_cases import later

pytestmark = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")

SIZES = [1, pytest.param(20, marks=pytest.mark.slow)]
LAST_STEPS = 5e-6  # of the way: how far apart the two may stop before one singular configuration


def both(name):
    """The model over the core, and the reference of the same mechanism."""
    model = ccpin.ReducedModel(ccpin.load(name))
    return model, reference_model(model.mechanism)


def beside_an_end(model, rng):
    """A q before or beyond the end of a straight way out of the reference, at any distance down to 1e-9."""
    start = model.alpha(model.mechanism.q_reference)
    way = rng.normal(size=model.n)
    least, most = 0.0, 6.0 / np.linalg.norm(way)
    for _ in range(9):
        places = np.linspace(least, most, 21)
        lost = np.flatnonzero(~model.core.sigma_many(start + places[:, None] * way, None)[1])
        if not lost.size:
            break
        least, most = places[lost[0] - 1], places[lost[0]]
    off = way * rng.choice([-1.0, 1.0]) if rng.integers(2) else rng.normal(size=model.n)
    return start + least * way + 10.0 ** rng.uniform(-9.0, -1.0) * off


def error_of(call):
    """The error that a call raises, or ``None``."""
    try:
        call()
    except CcpinError as error:
        return error
    return None


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", later("rpdr", "delta", "stewart", "hexa"))
def test_what_the_core_refuses_the_reference_refuses_likewise(name, size):
    """At random and beside ends: one kind of error, at one place on the line; and the same answers else.

    The reference walks all the way here, without a leap of its own.
    """
    (model, reference), rng, ends = both(name), np.random.default_rng(81), 0
    start = model.alpha(model.mechanism.q_reference)
    for k in range(6 * size):
        q = start + rng.uniform(-np.pi, np.pi, model.n) if k % 3 == 0 else beside_an_end(model, rng)
        error = error_of(lambda q=q: model.sigma(q))
        with patch.object(parametrization, "DeadEnds", lambda *_: lambda *_: None):
            known = error_of(lambda q=q: reference.sigma(q))
        assert type(error) is type(known), (error, known)
        found = model.core.blocked(None, q)
        if found is None:
            continue
        ends += 1
        assert isinstance(error, UnreachableError | SingularConfigurationError)
        assert np.abs(model.parametrization.constraints.residual(found[1])).max() < 1e-11
        np.testing.assert_allclose(model.alpha(found[1]), start + found[0] * (q - start), rtol=0, atol=1e-12)
        if isinstance(error, UnreachableError):
            assert error.fraction == found[0] == pytest.approx(known.fraction, abs=LAST_STEPS)
            assert str(error).split("(")[0][:40] == str(known).split("(")[0][:40]
    assert ends >= size


def test_the_five_bar_is_refused_beyond_its_closed_form_boundary_alone():
    """From the reference the line leads to q exactly where links 3 and 4 are long enough all along it."""
    model, _ = both("rpdr")
    rng, start, refused = np.random.default_rng(82), model.alpha(model.mechanism.q_reference), 0
    for q in start + rng.uniform(-np.pi, np.pi, (150, 2)):
        stretched = oracle.elongation(np.linspace(start, q, 2001).T).max()
        if abs(stretched - 1.0) < 1e-4:
            continue
        found = model.core.blocked(None, q)
        assert (found is not None) == (stretched > 1.0)
        if found is None:
            model.sigma(q)
            continue
        refused += 1
        assert oracle.elongation(start + found[0] * (q - start)) == pytest.approx(1.0, abs=1e-6)
        with pytest.raises(UnreachableError, match="blocked"):
            model.sigma(q)
    assert refused > 50


def test_what_passes_by_a_singular_point_is_not_said_to_end_there():
    """Ways that pass by the five-bar's coincident elbows are refused there by the reference too, or not at all."""
    model, reference = both("rpdr")
    centre = oracle.coincident_elbows()
    names = [model.mechanism.tree.joint(name).q for name in oracle.FREE]
    rng, passed = np.random.default_rng(83), 0
    for distance in 10.0 ** np.linspace(-9.0, -2.0, 29):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        begin, end = (centre + distance * across + side * along for side in (-0.1, 0.1))
        near = np.empty(model.mechanism.nq)
        for place, value in zip(names, oracle.sigma(begin, 1), strict=True):
            near[place] = value
        if model.core.blocked(near, end) is not None:
            with pytest.raises(UnreachableError):
                reference.sigma(end, near)
        else:
            passed += model.core.sigma(end, near) is not None
    assert passed > 10


def test_a_refusal_is_remembered_as_it_was():
    """Asked again, and after others, the same numbers; and of another way its own."""
    model, _ = both("delta")
    kernel, fresh = model.core, native.kernel(ccpin.load("delta"))
    far, farther = np.full(3, 4.0), np.array([4.0, 3.0, -2.0])
    known = [fresh.blocked(None, q) for q in (far, farther)]
    for k in (0, 0, 1, 0, 1, 1):
        kernel.sigma(far)
        found = kernel.blocked(None, (far, farther)[k])
        assert (found is None) == (known[k] is None)
        if found is not None:
            assert (found[0], found[2]) == (known[k][0], known[k][2])
            assert np.array_equal(found[1], known[k][1])
