"""Threads may share a model, a mechanism and a State: the answers are those of one thread, bit for bit."""

import sys
import threading

import numpy as np
import pytest

import ccpin
from ccpin.kinematics.points import LinkPoint
from tests.support.long_cases import later

THREADS, ROUNDS = 8, 3
PLACES = {"rpdr": (np.radians([-150.0, -160.0]), "link3"), "delta": (np.array([-0.2, 0.1, 0.0]), None)}


@pytest.fixture(autouse=True)
def hasty():
    """Switch threads a thousand times as often as usual."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


class Workload:
    """Deterministic questions to one model at several q, and to one State shared by all threads."""

    def __init__(self, name):
        place, link = PLACES[name]
        rng = np.random.default_rng(8)
        self.mechanism = ccpin.load(name)
        self.model = ccpin.ReducedModel(self.mechanism)
        n, n_free = self.model.n, self.mechanism.n_free
        self.q = place + 0.03 * rng.normal(size=(THREADS, n))
        self.v, self.a, self.u = rng.normal(size=(3, THREADS, n))
        self.v_free = rng.normal(size=(THREADS, n_free))
        self.q_free = [self.model.sigma(q) for q in self.q]
        link = link or self.mechanism.closures[0].link_b
        self.point = LinkPoint(self.mechanism.tree, link, (0.01, 0.02, 0.03))
        self.shared = self.model.at(place)

    def fresh(self):
        """A State nobody has asked anything yet, at the shared one's place."""
        self.shared = self.model.at(self.shared.q)

    def sigma(self, k):
        """σ, from the reference and from a State."""
        return self.model.sigma(self.q[k]), self.model.at(self.q[k], self.shared).q_free

    def geometry(self, k):
        """φ and its rates, of a mechanism's own constraints."""
        constraints = self.model.parametrization.constraints
        value = constraints.value(self.q_free[k])
        return (
            value.phi,
            value.jacobian,
            constraints.rate(value, self.v_free[k]),
            constraints.bias(value, self.v_free[k]),
        )

    def of_the_mechanism(self, k):
        """σ, ρ and S of the mechanism all models share."""
        closed = self.mechanism.parametrization().sigma(self.q[k])
        return closed.q_free, closed.rho, self.mechanism.actuation

    def link_point(self, k):
        """Where a link is and how it moves."""
        found = self.point
        return *found.motion(self.q_free[k], self.v_free[k]), found.pose(self.q_free[k]), found.jacobian(self.q_free[k])

    def free_system(self, k):
        """D′, C′, g′ and energies."""
        free, q, v = self.model.free_system, self.q_free[k], self.v_free[k]
        terms = free.mass_matrix(q), free.coriolis_matrix(q, v), free.gravity(q), free.inverse_dynamics(q, v, v)
        return *terms, *free.inverse_dynamics_derivatives(q, v, v), np.array(free.energy(q, v))

    def terms(self, k):
        """D, C, g."""
        return self.model.terms(self.q[k], self.v[k])

    def dynamics(self, k):
        """q̈, u and λ."""
        q, v, a, u = self.q[k], self.v[k], self.a[k], self.u[k]
        forward, inverse = self.model.forward_dynamics(q, v, u), self.model.inverse_dynamics(q, v, a)
        return forward, inverse, self.model.constraint_forces(q, v, u)

    def derivatives(self, k):
        """∂q̈ and ∂g."""
        q, v, u = self.q[k], self.v[k], self.u[k]
        return *self.model.forward_dynamics_derivatives(q, v, u), self.model.gravity_derivative(q)

    def one_state(self, k):
        """Everything of the State that all threads share."""
        state, v, a, u = self.shared, self.v[k], self.a[k], self.u[k]
        values = *state.terms(v), state.forward_dynamics(v, u), state.inverse_dynamics(v, a), state.gravity_derivative
        return (
            *values,
            state.constraint_forces(v, u),
            *state.forward_dynamics_derivatives(v, u),
            np.array(state.energy(v)),
        )


KINDS = (
    "sigma",
    "geometry",
    "of_the_mechanism",
    "link_point",
    "free_system",
    "terms",
    "dynamics",
    "derivatives",
    "one_state",
)


@pytest.fixture(scope="module", params=later(*PLACES))
def workload(request):
    return Workload(request.param)


@pytest.mark.parametrize("kind", KINDS)
def test_eight_threads_agree_with_one(workload, kind):
    """Eight threads ask different questions at once; every answer equals the one given to a single thread."""
    ask = getattr(workload, kind)
    expected = [ask(k) for k in range(THREADS)]
    workload.fresh()
    wrong, start = [], threading.Barrier(THREADS)

    def hammer(k):
        try:
            start.wait()
            for i in range(ROUNDS * THREADS):
                j = (i + k) % THREADS
                for found, wanted in zip(ask(j), expected[j], strict=True):
                    np.testing.assert_array_equal(found, wanted)
        except BaseException as error:
            wrong.append(f"thread {k}: {type(error).__name__}: {error}")

    threads = [threading.Thread(target=hammer, args=(k,)) for k in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong, f"{len(wrong)} of {THREADS} threads: {wrong[0]}"


def test_threads_that_meet_in_a_state_see_one_array(workload):
    """A lazy value computed by two threads at once is handed to both as the same, complete array."""
    for _ in range(20):
        workload.fresh()
        state, seen, start = workload.shared, [], threading.Barrier(THREADS)

        def look(state=state, seen=seen, start=start):
            start.wait()
            seen.append((id(state.D), state.D.copy(), id(state.g)))

        threads = [threading.Thread(target=look) for _ in range(THREADS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len({(first, third) for first, _, third in seen}) == 1
        assert all(np.array_equal(mass, state.D) for _, mass, _ in seen)
