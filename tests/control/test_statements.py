"""What a law states of itself: only what its own class does, so nothing is certified of a class that does otherwise."""

import numpy as np
import pytest

from ccpin import validated
from ccpin.control import (
    ComputedTorque,
    Hold,
    PDFullGravity,
    PDOnlineGravity,
    PDPlus,
    PDSimpleGravity,
    PointToPoint,
    TorqueFunction,
    certify_tracking,
)
from ccpin.control.control_law import Delayed, NoTorque, idle, kind_of, stated
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.errors import InvalidInputError, UnsupportedMechanismError

Q_D = np.array([-1.885, -1.257])
GAINS = [20.0, 20.0], [5.0, 5.0]


def backwards(kind):
    """The law, pushing the other way."""

    class Backwards(kind):
        def torque(self, t, state, v):
            return -super().torque(t, state, v)

    return Backwards


def otherwise(kind, name, value):
    """The law with something of it defined anew."""
    return type("Otherwise", (kind,), {name: value})


def named(kind):
    """A class of the same, with a name and an attribute of its own."""

    class Named(kind):
        """Does the same."""

        colour = "red"

        def __init__(self, *given):
            super().__init__(*given)
            self.more = 1

    return Named


def test_each_law_states_itself(rpdr_model):
    """The efforts of the statement's equation are the law's."""
    rng, reference = np.random.default_rng(0), PointToPoint(rpdr_model, Q_D, Q_D + 0.2, 1.0)
    laws = [
        *(kind(rpdr_model, Q_D, *GAINS) for kind in (PDSimpleGravity, PDFullGravity)),
        *(kind(rpdr_model, reference, *GAINS) for kind in (ComputedTorque, PDPlus, PDOnlineGravity)),
    ]
    kinds = [kind_of(law) for law in laws]
    assert kinds == ["pd", "pd_gravity", "computed_torque", "pd_plus", "pd_gravity"]
    for law in laws:
        told = stated(law)
        assert told.holds == (law in laws[:2])
        q, v, t = Q_D + rng.uniform(-0.1, 0.1, 2), rng.normal(size=2), 0.3
        state = rpdr_model.at(q)
        wanted = (Hold(rpdr_model, Q_D) if told.holds else reference).at(t)
        feedback = told.K_p @ (wanted.q - q) + told.K_v @ (wanted.v - v)
        D, C, g, damping = state.D, state.C(v), state.g, state.damping
        force = {
            "pd": feedback + told.constant,
            "pd_gravity": feedback + g,
            "computed_torque": D @ (wanted.a + feedback) + C @ v + damping @ v + g,
            "pd_plus": D @ wanted.a + (C + damping) @ wanted.v + g + feedback,
        }[told.kind]
        np.testing.assert_allclose(law.torque(t, state, v), force, rtol=1e-12, atol=1e-12)


def test_what_states_nothing(rpdr_model):
    law = PDSimpleGravity(rpdr_model, Q_D, *GAINS)
    assert idle(None)
    assert idle(NoTorque(rpdr_model))
    assert not idle(law)
    assert kind_of(TorqueFunction(lambda t, q, v: q)) is None
    assert stated(Delayed(law, 2.0)).start == 2.0
    assert kind_of(named(PDSimpleGravity)(rpdr_model, Q_D, *GAINS)) == "pd"
    for name in ("torque", "error", "_feedback", "own", "lyapunov", "next_switch"):
        assert kind_of(otherwise(PDSimpleGravity, name, lambda self, *_: None)(rpdr_model, Q_D, *GAINS)) is None, name
    law.torque = lambda t, state, v: v
    assert kind_of(law) is None


def test_a_reference_that_moves_otherwise_is_none_of_constants(rpdr_model):
    class Shaken(PointToPoint):
        def at(self, t):
            found = super().at(t)
            return found._replace(q=found.q + 0.1 * np.sin(90.0 * t))

    assert stated(PDPlus(rpdr_model, Shaken(rpdr_model, Q_D, Q_D + 0.1, 1.0), *GAINS)).reference is None
    assert stated(PDPlus(rpdr_model, PointToPoint(rpdr_model, Q_D, Q_D + 0.1, 1.0), *GAINS)).reference is not None


def test_no_theorem_of_a_law_that_does_otherwise(rpdr_model):
    """Theorem 3, enclosures and tracking bounds had been proven of classes that push the other way."""
    law = backwards(PDSimpleGravity)(rpdr_model, Q_D, *GAINS)
    with pytest.raises(InvalidInputError, match="PDSimpleGravity"):
        certify_law(law)
    reference = PointToPoint(rpdr_model, Q_D, Q_D + 0.05, 1.0)
    for kind in (ComputedTorque, PDPlus):
        with pytest.raises(UnsupportedMechanismError):
            certify_tracking(backwards(kind)(rpdr_model, reference, *GAINS), 1e-4)
    pytest.importorskip("flint")
    for kind in (PDSimpleGravity, PDFullGravity):
        with pytest.raises(UnsupportedMechanismError):
            validated.enclose(rpdr_model, backwards(kind)(rpdr_model, Q_D, *GAINS), Q_D + 0.01, np.zeros(2), 0.01)
    with pytest.raises(InvalidInputError):
        validated.certify_move(rpdr_model, law, Q_D + 0.01, arrival=0.1, duration=0.01)
