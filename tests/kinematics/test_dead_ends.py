"""Where the way of σ ends: what is refused with leaps is what is refused without, at one place, and truly there."""

import numpy as np
import pytest

import ccpin
from ccpin.errors import CcpinError, UnreachableError
from ccpin.kinematics import parametrization
from tests.oracles import rpdr as oracle
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.paper import to_free

SIZES = [1, pytest.param(20, marks=pytest.mark.slow)]
LAST_STEPS = 1e-4  # of the way: how far apart walk and leaps may stop before one singular configuration


def beside_an_end(model, rng):
    """A q before or beyond the end of a straight way out of the reference, at any distance down to 1e-9."""
    start = model.alpha(model.mechanism.q_reference)
    way = rng.normal(size=model.n)
    way /= np.linalg.norm(way)
    least, most = 0.0, 6.0
    for _ in range(4):
        places = np.linspace(least, most, 21)
        failures = {}
        model.sigma_many(start + places[:, None] * way, failures=failures)
        if not failures:
            break
        least, most = places[min(failures) - 1], places[min(failures)]
    off = way * rng.choice([-1.0, 1.0]) if rng.integers(2) else rng.normal(size=model.n)
    return start + least * way + 10.0 ** rng.uniform(-9.0, -1.0) * off


def told(model, q, near=None):
    """q′ = σ(q) of the reference, or its error."""
    try:
        return model.parametrization.sigma(q, near).q_free
    except CcpinError as error:
        return error


@pytest.fixture
def walks_only(monkeypatch):
    """Answers without leaps."""

    def answer(model, q, near=None):
        with monkeypatch.context() as patched:
            patched.setattr(parametrization, "DeadEnds", lambda *_: lambda *_: None)
            return told(model, q, near)

    return answer


@same_on_both
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", later("rpdr", "stewart", "delta"))
def test_leaps_refuse_what_the_walk_refuses(name, size, walks_only):
    """At random and beside ends: the same answers bit for bit, or the same kind of error at the same place."""
    model, rng, refused = ccpin.ReducedModel(ccpin.load(name)), np.random.default_rng(81), 0
    start = model.alpha(model.mechanism.q_reference)
    for k in range(8 * size):
        q = start + rng.uniform(-np.pi, np.pi, model.n) if k % 2 else beside_an_end(model, rng)
        found, known = told(model, q), walks_only(model, q)
        assert type(found) is type(known), (found, known)
        if isinstance(known, np.ndarray):
            np.testing.assert_array_equal(found, known)
            continue
        refused += 1
        if isinstance(known, UnreachableError):
            assert found.fraction == pytest.approx(known.fraction, abs=LAST_STEPS)
            on_the_line = start + found.fraction * (q - start)
            np.testing.assert_allclose(found.q_reached, on_the_line, rtol=0, atol=1e-9)
    assert refused >= size


def test_the_five_bar_is_refused_beyond_its_closed_form_boundary_alone(rpdr_model):
    """From the reference the line leads to q exactly where links 3 and 4 are long enough all along it."""
    rng, start, refused = np.random.default_rng(82), rpdr_model.alpha(rpdr_model.mechanism.q_reference), 0
    for q in start + rng.uniform(-np.pi, np.pi, (20, 2)):
        stretched = oracle.elongation(np.linspace(start, q, 2001).T).max()
        if abs(stretched - 1.0) < 1e-4:
            continue
        if stretched < 1.0:
            rpdr_model.sigma(q)
            continue
        with pytest.raises(
            UnreachableError, match=r"blocked[\s\S]*ccpin\.dynamics\.assembly_modes\(model, q\) looks"
        ) as caught:
            rpdr_model.sigma(q)
        refused += 1
        assert oracle.elongation(caught.value.q_reached) == pytest.approx(1.0, abs=1e-6)
    assert refused > 3


@pytest.mark.parametrize("distance", later(1e-3, *10.0 ** np.array([-9.0, -8.0, -7.0, -5.0])))
def test_what_passes_by_a_singular_point_is_not_said_to_end_there(rpdr_model, walks_only, distance):
    """A way that passes by the five-bar's coincident elbows is refused if the walk does not get past them, else not."""
    centre, angle = oracle.coincident_elbows(), np.random.default_rng(83).uniform(0.0, 2.0 * np.pi)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    begin, end = (centre + distance * across + side * along for side in (-0.1, 0.1))
    near = to_free(rpdr_model.mechanism, oracle.sigma(begin, 1))
    found, known = told(rpdr_model, end, near), walks_only(rpdr_model, end, near)
    assert type(found) is type(known)
    if distance >= 1e-5:
        np.testing.assert_array_equal(found, known)
