"""What the compiled core declines, its batches, threads and Ctrl-C, and which backend is said to be in use."""

import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ccpin
from ccpin import native
from ccpin.errors import InvalidInputError, UnderactuatedError
from ccpin.kinematics.clusters import find_clusters
from ccpin.simulation.integration.core_numbers import TABLEAUX
from tests.support.agreement import reference_model, relative

native_only = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")


@pytest.fixture(scope="module")
def delta():
    """The Delta robot's model and kernel, and 300 random states of it."""
    model = reference_model(ccpin.load("delta"))
    rng = np.random.default_rng(0)
    Q = model.alpha(model.mechanism.q_reference) + 0.2 * rng.uniform(-1, 1, size=(300, model.n))
    V, U = rng.normal(size=(2, 300, model.n))
    return model, native.kernel(model.mechanism), Q, V, U


@native_only
@pytest.mark.parametrize(
    "q",
    [[0.1, 0.2], [0.1, np.nan, 0.0], [np.inf, 0.0, 0.0], [[0.0, 0.0, 0.0]], "q", None, [9.0, 9.0, 9.0]],
    ids=["short", "nan", "infinite", "matrix", "text", "none", "unreachable"],
)
def test_declines_what_the_reference_refuses(delta, q):
    """No answer for a q of the wrong size or kind, or out of reach: the reference then says why."""
    model, kernel, *_ = delta
    with pytest.raises(ccpin.errors.CcpinError):
        model.sigma(q)
    assert q is None or kernel.sigma(q) is None


@native_only
def test_declines_bad_configurations_and_efforts(delta):
    """Configurations of the wrong size, not finite or far from closed, and v, u of the wrong size."""
    model, kernel, Q, V, U = delta
    good = model.sigma(Q[0])
    for near in (good[:-1], np.full_like(good, np.nan), good + 5.0):
        assert kernel.sigma(Q[0], near) is None
    assert kernel.forward_dynamics(good, V[0, :2], U[0]) is None
    assert kernel.forward_dynamics(good, V[0], np.append(U[0], 1.0)) is None
    assert kernel.forward_dynamics(good, V[0] * np.nan, U[0]) is None
    assert kernel.terms(None, V[0]) is None


@native_only
def test_an_open_configuration_is_closed_first(delta):
    """A configuration open by a little still leads to σ(q) on its branch, as in the reference."""
    model, kernel, Q, *_ = delta
    near = model.sigma(Q[0]) + 0.01 * np.random.default_rng(1).normal(size=model.mechanism.nq)
    np.testing.assert_allclose(kernel.sigma(Q[1], near), model.sigma(Q[1], near), rtol=0, atol=1e-12)


@native_only
@pytest.mark.parametrize("threads", [1, 3])
def test_batches_are_rows(delta, threads):
    """Every row of a batch is what it is alone, to rounding, whatever the order and the number of threads."""
    _, kernel, Q, V, U = delta
    order = np.random.default_rng(2).permutation(len(Q))
    for ask, single in (
        (lambda i: kernel.sigma_many(Q[i], None, threads), lambda k: kernel.sigma(Q[k])),
        (lambda i: kernel.forward_dynamics_many(Q[i], V[i], U[i], None, threads),
         lambda k: kernel.forward_dynamics(None, V[k], U[k], Q[k])),
        (lambda i: kernel.generalized_force_many(Q[i], V[i], U[i], None, threads),
         lambda k: kernel.generalized_force(None, V[k], U[k], Q[k])),
    ):  # fmt: skip
        rows, answered = ask(np.arange(len(Q)))
        again, _ = ask(order)
        assert answered.all()
        assert np.array_equal(rows[order], again)
        for k in range(0, len(Q), 30):
            assert relative(rows[k], single(k)) < 1e-11
    terms, _ = kernel.terms_many(Q, V, None, threads)
    slopes, _ = kernel.forward_dynamics_derivatives_many(Q, V, U, None, threads)
    for k in range(0, len(Q), 60):
        for many, one in ((terms, kernel.terms(None, V[k], Q[k])),
                          (slopes, kernel.forward_dynamics_derivatives(None, V[k], U[k], Q[k]))):  # fmt: skip
            assert all(relative(a[k], b) < 1e-10 for a, b in zip(many, one, strict=True))


@native_only
def test_efforts_of_least_norm():
    """u of motors that are not the independent joints, one by one and in a batch; none where they cannot suffice."""
    joints = ccpin.load("rpdr").tree.names
    rng = np.random.default_rng(4)
    for actuated in (joints, joints[1:], joints[2:], joints[3:]):
        mechanism = ccpin.load("rpdr", actuated=list(actuated))
        model, kernel = reference_model(mechanism), native.kernel(mechanism)
        Q = model.alpha(mechanism.q_reference) + 0.2 * rng.uniform(-1, 1, size=(6, 2))
        V, A = rng.normal(size=(2, 6, 2))
        many, answered = kernel.inverse_dynamics_many(Q, V, A, None)
        assert answered.all() == (len(actuated) > 1)
        for k in range(len(Q)):
            u = kernel.inverse_dynamics(None, V[k], A[k], Q[k])
            if len(actuated) == 1:
                assert u is None
                assert np.isnan(many[k]).all()
                with pytest.raises(UnderactuatedError):
                    model.at(Q[k]).inverse_dynamics(V[k], A[k])
            else:
                assert relative(u, model.at(Q[k]).inverse_dynamics(V[k], A[k])) < 1e-11
                assert relative(many[k], u) < 1e-11


@native_only
def test_rows_without_an_answer_are_nan(delta):
    """Out of reach or not finite: NaN and False in the mask, the other rows untouched."""
    model, kernel, Q, V, U = delta
    bad = Q.copy()
    bad[3], bad[5, 1] = 9.0, np.nan
    rows, answered = kernel.forward_dynamics_many(bad, V, U, None, 2)
    assert np.flatnonzero(~answered).tolist() == [3, 5]
    assert np.isnan(rows[[3, 5]]).all()
    good, _ = kernel.forward_dynamics_many(Q, V, U, None, 1)
    assert np.array_equal(rows[answered], good[answered])
    assert kernel.forward_dynamics_many(Q, V[:5], U, None) is None
    assert kernel.forward_dynamics_many(Q[:0], V[:0], U[:0], None)[0].shape == (0, model.n)


@native_only
def test_one_kernel_for_many_threads(delta):
    """Eight threads ask one kernel at once and get what one thread gets, bit for bit."""
    _, kernel, Q, V, U = delta

    def ask(k):
        return kernel.forward_dynamics(None, V[k], U[k], Q[k]), kernel.terms(None, V[k], Q[k])[5]

    alone = [ask(k) for k in range(len(Q))]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(ask, range(len(Q))))
    for one, other in zip(alone, together, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@native_only
def test_results_do_not_depend_on_what_was_asked_before(delta):
    """A state gives the same bits after a singular, an unreachable and a far one."""
    model, kernel, Q, V, U = delta
    before = kernel.forward_dynamics(None, V[0], U[0], Q[0])
    kernel.sigma([9.0, 9.0, 9.0])
    kernel.constraints(np.zeros(model.mechanism.nq))
    kernel.terms(None, 1e6 * V[1], Q[7])
    assert np.array_equal(before, kernel.forward_dynamics(None, V[0], U[0], Q[0]))


@native_only
@pytest.mark.parametrize("name", ["rpdr", "delta", "stewart", "hexa"])
def test_a_configuration_asked_about_again_is_as_if_new(name):
    """What the core keeps of the last q′ gives the bits of a kernel that never saw it, whatever came between."""
    model = reference_model(ccpin.load(name))
    rng = np.random.default_rng(4)
    start = model.alpha(model.mechanism.q_reference)
    kernel = native.kernel(model.mechanism)
    Q = [model.coordinates.integrate(start, 0.02 * rng.normal(size=model.n)) for _ in range(3)]
    closed = [kernel.closed_point(None, q)[0] for q in Q]
    v, u = rng.normal(size=model.n), rng.normal(size=model.n_actuated)
    fresh = [native.kernel(model.mechanism).forward_dynamics(x, v, u) for x in closed]
    rates = [native.kernel(model.mechanism).terms(x, v)[3] for x in closed]
    between = [
        lambda: kernel.sigma(Q[1]),  # ends at another point, without ρ
        lambda: kernel.constraints(rng.normal(size=model.mechanism.nq)),
        lambda: kernel.constraint_rate(closed[2], rng.normal(size=model.mechanism.n_free)),
        lambda: kernel.sigma(np.full(model.nq, 9.0)),
        lambda: kernel.rcond(closed[1]),
        lambda: kernel.closed_point(None, Q[0]),
        lambda: kernel.sigma_many(np.array(Q), None),
        lambda: kernel.forward_dynamics_derivatives(closed[0], v, u),
        lambda: None,
    ]
    for step in between * 2:
        for k in (0, 0, 1):
            assert np.array_equal(kernel.forward_dynamics(closed[k], v, u), fresh[k])
            step()
            assert np.array_equal(kernel.forward_dynamics(closed[k], v, u), fresh[k])
            assert np.array_equal(kernel.terms(closed[k], v)[3], rates[k])


@native_only
def test_ctrl_c_ends_a_batch(delta):
    """A batch of minutes stops within a second of SIGINT."""
    _, kernel, Q, V, U = delta
    many = [np.tile(array, (20000, 1)) for array in (Q, V, U)]
    timer = threading.Timer(0.1, lambda: signal.raise_signal(signal.SIGINT))
    began = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        kernel.forward_dynamics_many(*many, None, 2)
    assert time.monotonic() - began < 10.0


@native_only
def test_a_kernel_is_pickled_by_its_numbers(delta):
    """A copy made elsewhere gives the same bits."""
    _, kernel, Q, V, U = delta
    copy = pickle.loads(pickle.dumps(kernel))
    args = (None, V[0], U[0], Q[0])
    assert np.array_equal(copy.forward_dynamics(*args), kernel.forward_dynamics(*args))


def test_clusters_of_a_tree():
    """Ties join what lies between them; a lone joint is a cluster; parents come first."""
    parents = [0, 0, 1, 2, 1, 4, 0, 6]
    assert [tuple(c) for c in find_clusters(parents, [[3, 5]])] == [(0, [1]), (1, [2, 3, 4, 5]), (0, [6]), (6, [7])]
    assert [tuple(c) for c in find_clusters(parents, [[3, 7]])] == [(0, [1, 2, 3, 6, 7]), (1, [4]), (4, [5])]
    assert [tuple(c) for c in find_clusters(parents, [])] == [(p, [j]) for j, p in enumerate(parents) if j]


def test_backend_is_chosen_by_the_environment(monkeypatch):
    """CCPIN_BACKEND=numpy switches the core off; another word is refused."""
    monkeypatch.setenv(native.VARIABLE, "numpy")
    assert ccpin.backend() == ("numpy", "CCPIN_BACKEND=numpy")
    assert native.kernel(ccpin.load("rpdr")) is None
    monkeypatch.setenv(native.VARIABLE, "fortran")
    with pytest.raises(InvalidInputError, match="must be numpy or native"):
        ccpin.backend()


def test_without_the_core_numpy_does_the_work():
    """Where the core does not load the backend is NumPy, with the reason in one line; asked for, it is an error."""
    code = (
        "import sys; sys.modules['ccpin.native._core'] = None\n"
        "import os, ccpin; from ccpin import native; os.environ.pop('CCPIN_BACKEND', None)\n"
        "found = native.backend(); assert found.name == 'numpy' and 'not built' in found.reason, found\n"
        "assert native.kernel(ccpin.load('rpdr')) is None\n"
        "os.environ['CCPIN_BACKEND'] = 'native'\n"
        "try: native.backend()\n"
        "except ccpin.errors.InvalidInputError as error: assert 'CCPIN_BACKEND=native' in str(error)\n"
        "else: raise SystemExit(1)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@native_only
def test_steps_are_told_in_coordinates_of_the_same_mechanism(delta):
    """A motion of one mechanism has no reading in another's coordinates."""
    core = ccpin.ReducedModel(ccpin.load("rpdr")).core
    with pytest.raises(ValueError, match="two mechanisms"):
        core.held_motion(delta[1], TABLEAUX["RK45"], 1e-9, 1e-11, np.inf, 1e-7)
