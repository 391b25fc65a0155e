"""Transmissions with closed forms: an ankle, a knee, a neck, with rotors on their motors."""

from functools import cache

import ccpin
from ccpin.description.drafts import drafted
from ccpin.transmission import Transmission
from tests.oracles.linkages import Ankle, Knee, Neck
from tests.support.places import ROOT

ROTORS = {"ankle": 0.02, "knee": 0.1, "neck": 0.004}
FORMS = {"ankle": Ankle(), "knee": Knee(), "neck": Neck()}
MOTORS = {"ankle": ("left_motor", "right_motor"), "knee": ("motor",), "neck": ("left_motor", "right_motor")}
FILES = {"ankle": "ankle.urdf", "neck": "neck.xml"}


def loaded(name, **options):
    """The mechanism, with rotors unless told otherwise."""
    rotors = {motor: {"armature": ROTORS[name]} for motor in MOTORS[name]}
    source = ROOT / "docs" / "howto" / FILES[name] if name in FILES else drafted(name)
    return ccpin.load(source, **({"joints": rotors} | options))


@cache
def transmission_of(name):
    return Transmission(loaded(name))


def places(name, rng, count):
    """q_j over the range in which the closed form is compared."""
    return rng.uniform(*FORMS[name].RANGE.T, (count, len(FORMS[name].RANGE)))
