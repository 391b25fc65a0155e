"""A Ctrl-C that Python drops is heard all the same."""

import signal
import time
import weakref

import pytest

from ccpin.work import insistent


class Thing:
    """What a weak reference can point to."""


def dropped():
    """Ctrl-C in a weak reference's callback, where Python ignores whatever is raised."""
    thing = Thing()
    watch = weakref.ref(thing, lambda _: signal.raise_signal(signal.SIGINT))
    del thing
    return watch


def waited(seconds):
    start = time.monotonic()
    while time.monotonic() < start + seconds:
        pass


def test_an_interrupt_that_a_callback_swallows_comes_again(capsys):
    with insistent(), pytest.raises(KeyboardInterrupt):
        waited(20.0 if dropped() else 0.0)
    assert capsys.readouterr().err == ""


def test_other_errors_that_nobody_can_catch_are_told_as_ever(monkeypatch):
    told = []
    monkeypatch.setattr("sys.unraisablehook", told.append)
    with insistent():
        thing = Thing()
        watch = weakref.ref(thing, lambda _: 1 / 0)
        del thing
        waited(0.1)
    assert watch() is None
    assert [each.exc_type for each in told] == [ZeroDivisionError]
