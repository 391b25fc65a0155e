"""Bodies whose joints are geared to one another."""

import numpy as np

import ccpin
from ccpin import MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Joint, Link
from tests.support.strategies import Growth


def geared(terms, kinds, pose):
    """Bodies on the base, each on a joint of its own along or about y, held together by one coupling."""
    names = [f"j{k}" for k in range(len(kinds))]
    links = (Link("base"), *(Link(f"l{k}", Growth(np.random.default_rng(k)).inertia()) for k in range(len(kinds))))
    joints = tuple(
        Joint(name, kind, "base", f"l{k}", axis=np.array([0.0, 1.0, 0.0]))
        for k, (name, kind) in enumerate(zip(names, kinds, strict=True))
    )
    coupling = Coupling("gear", tuple(CouplingTerm(names[k], *term) for k, term in enumerate(terms)))
    reference = {name: (value,) for name, value in zip(names, pose, strict=True)}
    description = MechanismDescription("geared", "base", links, joints, couplings=(coupling,), reference=reference)
    return ccpin.load(description, independent=names[1:])
