"""Closed states of a model near its reference."""

from ccpin.errors import CcpinError


def closed_near(model, rng, spread):
    """One after the other, those that σ reaches."""
    middle = model.alpha(model.mechanism.q_reference)
    while True:
        try:
            state = model.at(model.coordinates.integrate(middle, spread * rng.uniform(-1.0, 1.0, model.n)))
        except CcpinError:
            continue
        yield state
