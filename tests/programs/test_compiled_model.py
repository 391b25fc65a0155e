"""`compiled(model)`: the core's answers and refusals, whoever gives them, on the core's branch."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs import compiled_model
from ccpin.programs.compiling import NoCompilerError, compiler
from tests.support.agreement import reference_model
from tests.support.long_cases import later

try:
    compiler()
except NoCompilerError as error:
    pytest.skip(str(error), allow_module_level=True)

RPDR, ANKLE = "rpdr", "docs/howto/ankle.urdf"
MANY = {"sigma": 1, "terms": 2, "forward_dynamics": 3, "inverse_dynamics": 3, "forward_dynamics_derivatives": 3}


def batch(model, rows, spread, seed=1):
    """Rows of q about the reference, q̇ and u or q̈."""
    rng = np.random.default_rng(seed)
    q = model.alpha(model.mechanism.q_reference)
    Q = np.array([model.coordinates.integrate(q, spread * rng.uniform(-1, 1, model.n)) for _ in range(rows)])
    return Q, rng.normal(size=(rows, model.n)), rng.normal(size=(rows, max(model.n, model.n_actuated)))


def ask(model, name, given, near=None, **options):
    """A batch's fields."""
    Q, V, last = given
    columns = model_of(model).n_actuated if name.startswith("forward") else model_of(model).n
    answer = getattr(model, f"{name}_many")(*(Q, V, last[:, :columns])[: MANY[name]], near, **options)
    return answer if isinstance(answer, tuple) else (answer,)


def model_of(model):
    """The reduced model of either."""
    return getattr(model, "model", model)


@pytest.fixture(scope="module", params=[RPDR, ANKLE])
def model(request):
    """A plane mechanism and one with balls."""
    return ccpin.ReducedModel(ccpin.load(request.param))


@pytest.fixture(scope="module")
def own(model):
    """In lanes."""
    return programs.compiled(model)


@pytest.mark.parametrize(
    ("model", "name"),
    [(RPDR, name) for name in MANY]
    + [pytest.param(ANKLE, name, marks=[pytest.mark.slow] * (name != "forward_dynamics")) for name in MANY],
    indirect=["model"],
)
def test_answers_are_the_cores(model, own, name, monkeypatch):
    """To rounding, and without the core: every row near by is the program's."""
    given = batch(model, 300, 0.02)
    wanted = ask(model, name, given)
    ask(own, name, given)  # recorded and compiled, which asks the core where the reference closes
    monkeypatch.setattr(model, "core", None)
    found = ask(own, name, given)
    for a, b in zip(found, wanted, strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * max(np.abs(b).max(), 1.0))


@pytest.mark.parametrize("name", list(MANY))
def test_far_rows_bad_rows_and_threads(name):
    """Rows anywhere: those without an answer are the model's own, with its words; threads change no bit."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    own = programs.compiled(model)
    given = batch(model, 60, 1.5)
    given[0][3, 0], given[1][5, 1], given[2][7, 0] = np.nan, np.inf, np.nan
    told, wanted_told = {}, {}
    found = ask(own, name, given, failures=told)
    wanted = ask(model, name, given, failures=wanted_told)
    assert told == wanted_told
    assert 3 in told
    for a, b in zip(found, wanted, strict=True):
        size = 1.0 + np.abs(b).reshape(len(b), -1).max(axis=1)
        gap = np.abs(a - b).reshape(len(b), -1).max(axis=1) / size
        assert np.nanmax(gap) < 1e-9  # rcond of far rows is as low as it comes
        assert np.nanmedian(gap) < 1e-13
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
    for a, b in zip(found, ask(own, name, given, failures={}, threads=2), strict=True):
        np.testing.assert_array_equal(a, b)
    with pytest.raises(CcpinError) as error:
        ask(own, name, given)
    with pytest.raises(type(error.value)) as wanted_error:
        ask(model, name, given)
    assert str(error.value) == str(wanted_error.value)


def test_a_configuration_for_each_row(model, own):
    """`near` of shape (N, nq): σ goes on from each row's own, beyond what the reference reaches."""
    path = batch(model, 1, 0.0)[0] + np.linspace(0.0, 0.3, 40)[:, None] * np.ones(model.n)
    near = np.array([model.sigma(q) for q in path])
    V = np.random.default_rng(0).normal(size=(40, model.n))
    steps = path + 0.01
    found = own.forward_dynamics_many(steps, V, V, near)
    wanted = [model.forward_dynamics(q, v, v, start) for q, v, start in zip(steps, V, near, strict=True)]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    held = [np.asarray(each) for each in (steps, V, V)]
    _, answered = own._by_program("forward_dynamics", held, near, 1, [(model.n,)])
    assert answered.all()


def test_the_other_branch_is_not_taken():
    """Beside the folds of the five-bar's σ: rows are σ's of `near`, or refused, as the core has them."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    own = programs.compiled(model)
    rng = np.random.default_rng(8)
    starts, q = [], model.alpha(model.mechanism.q_reference)
    for way in (np.array([np.cos(t), np.sin(t)]) for t in np.linspace(0, 6, 4)):
        far = q
        for step in (0.2, 0.02, 0.002):  # as near to where σ ends as it goes
            for _ in range(30):
                try:
                    model.at(far + step * way)
                except CcpinError:
                    break
                far = far + step * way
        starts.append(model.at(far))
    for state in starts:
        Q = state.q + 0.09 * rng.uniform(-1, 1, (20, 2))
        told, wanted_told = {}, {}
        found, wanted = own.sigma_many(Q, state, failures=told), model.sigma_many(Q, state, failures=wanted_told)
        assert told == wanted_told
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7)


@pytest.mark.parametrize("names", later(["sigma", "forward_dynamics"], MANY), ids=["two", "all"])
def test_circles_are_pairs(names):
    """A continuous joint is (cosine, sine) for both; a pair that is none is refused alike."""
    described = ccpin.load("rpdr").description
    joints = (replace(joint, kind="continuous", lower=-np.inf, upper=np.inf) for joint in described.joints)
    model = ccpin.ReducedModel(ccpin.load(replace(described, joints=tuple(joints))))
    own = programs.compiled(model)
    assert (model.nq, model.n) == (4, 2)
    given = batch(model, 50, 0.05)
    for name in names:
        for a, b in zip(ask(own, name, given), ask(model, name, given), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * max(np.abs(b).max(), 1.0))
    _, answered = own._by_program("sigma", [given[0]], model.mechanism.q_reference, 1, [(model.mechanism.nq,)])
    assert answered.all()
    bad = given[0].copy()
    bad[4] *= 1.1
    with pytest.raises(InvalidInputError, match="row 4"):
        own.sigma_many(bad)
    with pytest.raises(InvalidInputError, match="row 4"):
        model.sigma_many(bad)


def test_where_the_core_is_numpys():
    """The reference behind the lanes gives the same."""
    model = reference_model(ccpin.load("rpdr"))
    own = programs.compiled(model)
    given = batch(model, 20, 0.2)
    assert own.backend.name == "lanes"
    np.testing.assert_allclose(ask(own, "sigma", given)[0], ask(model, "sigma", given)[0], rtol=0, atol=1e-12)


def test_a_compiler_that_fails_later_leaves_the_core(monkeypatch):
    """What was to be compiled at the first call is then the core's for good, and `backend` says why."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    own = programs.compiled(model)

    def fail(*_):
        raise NoCompilerError("it is gone")

    monkeypatch.setattr(compiled_model, "CompiledProgram", fail)
    given = batch(model, 5, 0.02)
    np.testing.assert_array_equal(ask(own, "sigma", given)[0], ask(model, "sigma", given)[0])
    assert own.backend.name == model.backend.name
    assert "it is gone" in own.backend.reason


def test_wrong_arguments(own, model):
    """Shapes as the model refuses them, a configuration too few, and what is no model."""
    Q, V, _ = batch(model, 4, 0.01)
    with pytest.raises(InvalidInputError, match="different lengths"):
        own.terms_many(Q, V[:3])
    with pytest.raises(InvalidInputError, match="near has shape"):
        own.sigma_many(Q, np.zeros((3, 2)))
    with pytest.raises(InvalidInputError):
        programs.compiled("rpdr")
    assert own.sigma_many(np.empty((0, model.nq))).shape == (0, model.mechanism.nq)
    for threads in (0, -1, 0.5, 1.5, True, "2"):
        for each in (own, model):
            with pytest.raises(InvalidInputError, match="threads = "):
                each.sigma_many(Q, threads=threads)
    for wrong in (Q * (1 + 1e-9j), Q.astype(str), [object()] * 4):
        with pytest.raises(InvalidInputError, match="Q "):
            own.sigma_many(wrong)


def test_a_pickle_answers_alike(own, model):
    """It is compiled, or found, where it is read."""
    again = pickle.loads(pickle.dumps(own))
    Q, V, _ = batch(model, 4, 0.01)
    assert again.backend == own.backend
    for a, b in zip(again.terms_many(Q, V), own.terms_many(Q, V), strict=True):
        np.testing.assert_array_equal(a, b)
