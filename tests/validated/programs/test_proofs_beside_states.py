"""The benchmark of proofs about programs: nothing is beyond what is proved, and it would be noticed if it were."""

from fractions import Fraction

import pytest

from benchmarks.program_proofs import REGIONS, certified
from ccpin.validated.programs.program_certificate import ProgramCertificate
from tests.support import quadruple
from tests.support.beside_states import Region

pytest.importorskip("flint")
if missing := quadruple.absent():
    pytest.skip(missing, allow_module_level=True)
SHARP = {"rpdr": 1e-5, "ankle": 1e-6, "delta": 1e-11}  # seen errors as a share of what is proved, at least


@pytest.mark.slow
def test_a_thousand_states_are_not_beyond_what_is_proved(monkeypatch):
    """A five-bar's, in double and in float; with errors told a thousand times smaller they are."""
    found = certified("rpdr", ["near"], 16)
    region = judged(found, 1_000, 3)
    told = ProgramCertificate.error
    monkeypatch.setattr(
        ProgramCertificate, "error", lambda *asked: {name: 1e-3 * most for name, most in told(*asked).items()}
    )
    assert region.seen(100, 0).beyond > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("given", ["closed", "near"])
def test_no_state_is_beyond_what_is_proved(name, given):
    judged(certified(name, [given]), 1_000_000 if name == "rpdr" else 20_000, 50)


def judged(found, states, exact):
    """So many states in both formats, so many of them exactly; what is proved is neither below nor far above."""
    ((_, model, certificate),) = found
    for format in ("double", "float"):
        region = Region(model, certificate, format)
        seen = region.seen(states, exact)
        assert (seen.beyond, seen.wrong) == (0, 0)
        assert seen.refused == 0 or not certificate.always_trusted(format)
        assert (seen.largest <= seen.proved).all()
        assert (seen.largest >= SHARP[model.mechanism.name] * seen.proved).all()
        assert seen.doubt < 1e-12
        if certificate.program.corrections:
            outside = region.outside(states)
            assert outside.beyond == outside.refused > 0
            assert outside.others[2] == 0
    return region


@pytest.mark.parametrize("value", ["1/3", "-2/7", "5", "1267650600228229401496703205377/3", "1/1180591620717411303424"])
def test_literals_are_the_nearest_of_113_bits(value):
    exact = Fraction(value)
    digits, exponent = quadruple.literal(exact)[1:-2].split("p")
    told = Fraction(int(digits, 16)) * Fraction(2) ** int(exponent)
    assert abs(told - exact) <= abs(exact) / 2**113
    assert 2**112 <= abs(int(digits, 16)) <= 2**113
