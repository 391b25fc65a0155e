"""Laws of users' own that do what they should not: what they are given cannot be written to, what they return is read.

``CCPIN_LAWS=1000 pytest -m slow tests/simulation/plant/test_odd_laws.py`` takes as many of them.
"""

import os
import time
from contextlib import suppress

import numpy as np
import pytest

import ccpin
from ccpin import control
from ccpin.control import Reference, Sampling
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.simulation import Event, Push
from ccpin.simulation.plant.disturbances import Disturbance
from tests.support.backends import same_on_both

LAWS = int(os.environ.get("CCPIN_LAWS", "1000"))
START, GOAL = np.radians((-118.0, -62.0)), np.radians((-108.0, -72.0))
OPTIONS = {"duration": 0.03, "sample_period": 0.005, "max_step": 0.005}


def honest(t, q, v):
    """What all of them mean."""
    return 20.0 * (GOAL - q) - 2.0 * v


def written(array, how, number):
    """Try to write into an array, by whatever way there is."""
    if how == "items":
        array[:] = number
    elif how == "in place":
        array *= number
    elif how == "flag":
        array.flags.writeable = True
        array[0] = number
    elif how == "base":
        array.base[:] = number
    else:
        np.copyto(array, number)


WHAT = ("write", "write", "write all", "shape", "nothing", "NaN", "text", "raise", "late", "again")


class Odd:
    """A random law: what it does when it is asked for the `moment`-th time, and before and after `honest`."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.what = str(rng.choice(WHAT))
        self.how = str(rng.choice(["items", "in place", "flag", "base", "copyto"]))
        self.which, self.moment, self.asked = int(rng.integers(2)), int(rng.integers(30)), 0
        self.number, self.kept = float(rng.normal()), np.zeros(2)

    def __call__(self, t, q, v):
        self.asked += 1
        due, u = self.asked > self.moment, honest(t, q, v)
        if self.what == "again":  # one array for all that it returns
            self.kept[:] = u
            return self.kept
        if not due:
            return u
        if self.what == "write":
            written((q, v)[self.which], self.how, self.number)
        elif self.what == "write all":
            for array in (q, v):
                with suppress(ValueError, TypeError, AttributeError):
                    written(array, self.how, self.number)
        elif self.what == "raise":
            raise RuntimeError("of its own")
        elif self.what == "late" and self.asked == self.moment + 1:
            time.sleep(0.02)
        wrong = {"shape": np.zeros(3), "nothing": None, "NaN": u * np.nan, "text": "u"}
        return wrong.get(self.what, u)


def motion_of(model, odd, **options):
    """The motion, or ``None`` where the law failed before the first sample, which raises what it raised."""
    try:
        return ccpin.simulate(model, odd, START, **OPTIONS, **options)
    except (CcpinError, RuntimeError, ValueError, TypeError, AttributeError):
        return None


def check(model, seed, wanted):
    """The motion of the honest law, or one that says it failed, and is right as far as it goes."""
    odd = Odd(seed)
    sampled = bool(seed % 2)
    found = motion_of(model, odd, sampling=Sampling(period=0.002) if sampled else None)
    if found is None:
        assert odd.asked == odd.moment + 1 <= 8  # what it takes to the first sample
        return odd.what
    right = wanted[sampled]
    count = len(found.t) if found.status == "finished" else len(found.t) - 1
    np.testing.assert_allclose(found.q[:count], right.q[:count], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.u[:count], right.u[:count], rtol=0, atol=1e-6)
    if found.status != "finished":
        assert found.status == "failed"
        assert found.cause is not None
    assert found.status == "failed" or odd.what in ("write", "write all", "late", "again") or odd.asked <= odd.moment
    return odd.what


@pytest.fixture(scope="module")
def wanted(rpdr_model):
    run = {
        sampled: ccpin.simulate(rpdr_model, honest, START, sampling=sampling, **OPTIONS)
        for sampled, sampling in ((False, None), (True, Sampling(period=0.002)))
    }
    return run


@same_on_both
def test_odd_laws_are_right_or_refused(rpdr_model, wanted):
    """A few of them."""
    assert len({check(rpdr_model, seed, wanted) for seed in range(60)}) == 9


@pytest.mark.slow
def test_many_odd_laws(rpdr_model, wanted):
    """Many."""
    for seed in range(LAWS):
        check(rpdr_model, seed, wanted)


def test_whatever_else_is_called_can_only_read(rpdr_model):
    """References, wrenches, pushes, events, regions: each tries to write into what it is given, and each is told."""
    tried = []

    def spoil(*arrays):
        for array in arrays:
            for how in ("items", "in place", "copyto"):
                with pytest.raises(ValueError, match="read-only"):
                    written(array, how, 9.0)
            tried.append(1)

    def at_state(t, state, v):
        spoil(state.q, state.q_free, state.rho, state.D, state.g, v)

    def wrenches(t, state, v):
        at_state(t, state, v)
        return None

    def event(t, state, v):
        at_state(t, state, v)
        return 1.0

    def region(q):
        spoil(q)
        return True

    class Own(control.ControlLaw):
        def torque(self, t, state, v):
            spoil(state.q, v, state.q_free)
            return honest(t, state.q, v)

    plain = ccpin.simulate(rpdr_model, honest, START, **OPTIONS)
    for law in (Own(), honest):
        for options in (
            {"wrenches": wrenches},
            {"wrenches": Disturbance([Push(wrenches)])},
            {"events": [Event(event, "never")]},
            {"region": region},
        ):
            before = len(tried)
            found = ccpin.simulate(rpdr_model, law, START, **OPTIONS, **options)
            assert found.status == "finished", (found.message, options)
            assert len(tried) > before
            np.testing.assert_allclose(found.q, plain.q, rtol=0, atol=1e-9)


class Spoilt(Reference):
    """A reference that keeps the arrays it returned and writes into them when it is asked again."""

    def __init__(self, model):
        self.inner, self.given = control.PointToPoint(model, START, GOAL, 0.03), []

    def at(self, t):
        for state in self.given:
            for array in state:
                if array.flags.writeable:
                    array[:] = 7.0
        found = type(self.inner.at(t))(*(np.array(part) for part in self.inner.at(t)))
        self.given = [found]
        return found

    def next_switch(self, t):
        return self.inner.next_switch(t)


def test_a_reference_that_writes_into_what_it_gave(rpdr_model):
    """What a law made of it stays."""
    motions = []
    for reference in (Spoilt(rpdr_model), control.PointToPoint(rpdr_model, START, GOAL, 0.03)):
        law = control.PDPlus(rpdr_model, reference, 30.0, 3.0)
        motions.append(ccpin.simulate(rpdr_model, law, START, **OPTIONS))
    np.testing.assert_allclose(motions[0].q, motions[1].q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(motions[0].u, motions[1].u, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "function", [lambda t, q: q, lambda t, q, v, more: q, lambda: 0.0, lambda t, q, v, *, gain: q, 3.0]
)
def test_a_function_of_other_arguments(function):
    """Told when the law is made, by how a law is called."""
    with pytest.raises(InvalidInputError, match=r"a law is called as law\(t, q, v\)"):
        control.TorqueFunction(function)


@pytest.mark.parametrize("function", [honest, Odd(0), lambda *all_three: np.zeros(2), lambda t, q, v, gain=1.0: q, max])
def test_a_function_that_takes_three(function):
    """By name, as a method, as many as there are, with defaults, or compiled without a signature."""
    assert isinstance(control.TorqueFunction(function), control.ControlLaw)


def test_a_law_whose_torque_takes_others(rpdr_model):
    """A subclass likewise, by the method's arguments."""

    class Short(control.ControlLaw):
        def torque(self, t, state):
            return np.zeros(2)

    with pytest.raises(InvalidInputError, match=r"a law is called as torque\(t, state, v\)"):
        ccpin.simulate(rpdr_model, Short(), START, **OPTIONS)


@pytest.mark.parametrize("sampling", [None, Sampling(1e-3)])
@pytest.mark.parametrize(
    "read", [lambda q: q - GOAL, lambda q: GOAL - q, lambda q: 2.0 * q, lambda q: np.sin(q), lambda q: [q[0], q[1]]]
)
def test_a_state_taken_for_an_array(rpdr_model, sampling, read):
    """What it is given and where q is, with Python's own words and the error itself as the cause."""

    class Taken(control.ControlLaw):
        def torque(self, t, q, v):
            return read(q)

    with pytest.raises(
        InvalidInputError, match=r"Taken: torque\(t, state, v\) is given a State: state\.q is q"
    ) as told:
        ccpin.simulate(rpdr_model, Taken(), START, sampling=sampling, **OPTIONS)
    assert isinstance(told.value.__cause__, TypeError)
    assert str(told.value.__cause__) in str(told.value)


@pytest.mark.parametrize("words", ["unsupported operand type(s) for -: 'str' and 'float'", "State is no state of mine"])
def test_a_type_error_of_the_laws_own_is_its_own(rpdr_model, words):
    """Whatever is not about what the law was given comes out as it is."""

    class Broken(control.ControlLaw):
        def torque(self, t, state, v):
            raise TypeError(words)

    with pytest.raises(TypeError) as told:
        ccpin.simulate(rpdr_model, Broken(), START, **OPTIONS)
    assert str(told.value) == words
