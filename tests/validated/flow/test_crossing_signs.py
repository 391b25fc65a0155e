"""Where a free motion crosses a singularity: the sign of the determinant is proved at both ends that are told."""

import pytest

pytest.importorskip("flint")

from ccpin.validated.arithmetic.balls import ball, flint
from ccpin.validated.flow import crossing as module
from ccpin.validated.flow import regularity
from ccpin.validated.flow.step import ProvenStep, start_of


def line(begin, length, error):
    """A step of x = t − 1, of which an error is known."""
    polynomial = [[ball(begin - 1.0), ball(1.0)]]
    end = start_of([ball(begin + length - 1.0)])
    return ProvenStep(length, polynomial, 0.0, [ball(error)], [], 0.0, end)


@pytest.fixture
def on_a_line(monkeypatch):
    """det = −x, told as it is on the box."""
    monkeypatch.setattr(module, "signed_determinant", lambda loop, box: -box[0])
    boxes = []
    monkeypatch.setattr(module, "witness_of", lambda kind, loop, box: boxes.append(box[0]))
    return boxes


def test_a_sign_that_was_not_proved_where_a_step_begins(on_a_line):
    """Three steps; after the first two the sign is not known: the crossing at t = 1 is within what is told."""
    steps = [line(0.5, 0.375, 0.25), line(0.875, 0.25, 0.25), line(1.125, 0.375, 0.25)]
    found = module._located(None, steps, 0.5, 1)
    assert found.after == 0.5
    assert 1.25 <= found.before <= 1.5
    assert on_a_line[0].contains(flint().arb(0))
    assert on_a_line[0].contains(flint().arb(-0.5))


def test_a_sign_that_is_proved_again_in_the_last_step(on_a_line):
    """Halving finds a time of the first sign in the last step: what came before does not matter any more."""
    steps = [line(0.5, 0.25, 0.5), line(0.75, 0.4375, 2.0**-20)]
    found = module._located(None, steps, 0.5, 1)
    assert 0.75 < found.after < 1.0 < found.before
    assert found.before - found.after < 0.1
    assert on_a_line[0].contains(flint().arb(0))


def test_all_that_programs_count_within_half_a_turn_is_asked_for(monkeypatch):
    """The field in other coordinates asks for the same as the field of an enclosure."""
    asked = []

    def marched(field, *_):
        asked.append(field.missing([]))
        return iter(())

    class Loop:
        left_out, turns, field = None, (), None

    monkeypatch.setattr(module, "march", marched)
    monkeypatch.setattr(module, "signed_determinant", lambda loop, box: ball(1))
    monkeypatch.setattr(module, "_other_coordinates", lambda *_: (Loop(), []))
    monkeypatch.setattr(regularity, "too_far_turned", lambda loop, box: "turned")
    assert module.find_crossing(None, Loop(), [], 0.0, 1.0, None) is None
    assert asked == ["turned"]
