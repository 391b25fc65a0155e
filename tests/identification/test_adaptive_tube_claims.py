"""Claims about adaptive tubes that are forged: misshapen, with borrowed premises, about other laws and robots."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import PointToPoint, Reference
from ccpin.control.stability.tracking.reference_tube import cut_along
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.identification import AdaptiveTracking, certify_adaptive
from ccpin.identification.adaptive.adaptive_certificate import equations_of
from ccpin.identification.adaptive.adaptive_equations import AdaptiveEquations, _definite
from ccpin.proof.facts import Fact, NotProvedError, prove
from tests.support.refusals import refused

CELLS = 12
MOVE = np.array([0.02, -0.03])


def law_of(motors=None, move=MOVE, **changed):
    """The RPDR's, whose links are a tenth heavier or lighter, along a short move."""
    model = ccpin.ReducedModel(ccpin.load("rpdr") if motors is None else motors)
    start = model.alpha(model.mechanism.q_reference)
    reference = PointToPoint(model, start, start + move, 0.25)
    numbers = {"slope": 10.0, "K": [4.0, 3.0], "gain": 20.0, "period": 1e-3, "adapted": ["body"], "bounds": 0.1}
    return AdaptiveTracking(model, reference, **numbers | changed)


@pytest.fixture(scope="module")
def certificate():
    """What is proved of it from a start that is a little off."""
    found = certify_adaptive(law_of(), initial_error=1e-4, initial_sliding=1e-3, cells=CELLS)
    assert found.verdict == "proven", found.reason
    return found


@pytest.fixture(scope="module")
def known(certificate):
    return certificate.proved


@pytest.fixture(scope="module")
def own():
    """What claims about the law are about; nothing is proved for it."""
    return cut_along(law_of(), CELLS, equations_of).equations


@pytest.fixture(scope="module")
def tighter():
    """The fact about the same reference's cells with a larger box and so larger rooms."""
    return certify_adaptive(law_of(bounds=0.12), cells=CELLS).proved


MISSHAPEN = {
    "a time too few": ("times", lambda x: x[1:]),
    "times exchanged": ("times", lambda x: x[::-1]),
    "times that end early": ("times", lambda x: np.append(x[:-1], x[-1] - 0.5)),
    "times a little later": ("times", lambda x: np.concatenate([x[:1], x[1:-2] + 1e-6, x[-2:]])),
    "a cell too few": ("room", lambda x: x[1:]),
    "an error too few": ("room", lambda x: x[:, 1:]),
    "no room": ("room", lambda x: 0.0 * x),
    "single precision": ("room", lambda x: x.astype(np.float32)),
    "room that is no number": ("room", lambda x: x * np.nan),
    "a narrower room": ("room", lambda x: 0.8 * x),
    "less room for s": ("room", lambda x: x * [1.0, 1.0, 0.8, 0.8]),
    "less room for e": ("room", lambda x: x * [0.8, 0.8, 1.0, 1.0]),
    "a wider room": ("room", lambda x: x * [1.01, 1.0, 1.0, 1.0]),
    "room without end": ("room", lambda x: x + np.inf),
    "no rates": ("rates", lambda x: 0.0 * x),
    "lower rates": ("rates", lambda x: 0.8 * x),
    "one rate lower": ("rates", lambda x: x * np.where(np.arange(x.size).reshape(x.shape) == 3, 0.8, 1.0)),
    "rates of fewer cells": ("rates", lambda x: x[1:]),
    "rates of too many errors": ("rates", lambda x: np.hstack([x, x])),
    "rates that are no number": ("rates", lambda x: x * np.nan),
    "a start that is off": ("start", lambda x: x + 0.1),
    "a start that is less than right": ("start", lambda x: x - 0.1),
    "a start without speeds": ("start", lambda x: x[:2]),
}


@pytest.mark.parametrize("name", MISSHAPEN)
def test_no_fact_comes_of_other_numbers(known, name):
    field, alter = MISSHAPEN[name]
    refused(lambda: replace(known.claim, **{field: alter(getattr(known.claim, field).copy())}), *known.premises)


def test_what_it_was_made_of_is_a_fact(known, own):
    assert known.digest == own.digest
    copy = pickle.loads(pickle.dumps(known))
    assert type(copy) is not Fact
    again = copy.replay()
    for name, values in known.found.items():
        np.testing.assert_array_equal(again.found[name], values)


BORROWED = {
    "none": lambda path, boxes, glue, other: (),
    "no glue": lambda path, boxes, glue, other: (path, boxes),
    "no path": lambda path, boxes, glue, other: (boxes, boxes, *glue),
    "the path's boxes for the cells'": lambda path, boxes, glue, other: (path, path.premises[0], *glue),
    "others' boxes": lambda path, boxes, glue, other: (path, other[1], *glue),
    "others' glue": lambda path, boxes, glue, other: (path, boxes, *other[2:]),
}


@pytest.mark.parametrize("name", BORROWED)
def test_premises_are_those_of_the_tube(known, tighter, name):
    path, boxes, *glue = known.premises
    refused(lambda: known.claim, *BORROWED[name](path, boxes, tuple(glue), tighter.premises))


# Equations.

NAMES = ("closures", "frames", "gravity", "known", "basis", "lower", "upper", "gains", "reference", "theta")


def changed(equations, **change):
    return AdaptiveEquations(*(change.get(name, getattr(equations, name)) for name in NAMES))


def one(array, value, place=0):
    """A copy with another number at a place."""
    found = array.copy()
    found.flat[place] = value
    return found


FORGED = {
    "closures of a mechanism": lambda e: {"closures": e.closures.problem},
    "no bodies": lambda e: {"frames": ()},
    "one tip more": lambda e: {"frames": e.frames + e.frames[:1]},
    "a body without an axis": lambda e: {"frames": e.frames[:-1]},
    "constants of another size": lambda e: {"known": e.known[1:]},
    "a constant that is no number": lambda e: {"known": one(e.known, np.nan)},
    "combinations of other constants": lambda e: {"basis": e.basis[1:]},
    "a combination too few": lambda e: {"basis": e.basis[:, 1:]},
    "a combination that is no number": lambda e: {"basis": one(e.basis, np.inf)},
    "a combination alone": lambda e: {"basis": e.basis[:, 0]},
    "combinations in a row": lambda e: {"basis": e.basis.ravel()},
    "an empty box": lambda e: {"lower": e.upper + 1e-9},
    "one constant without room": lambda e: {"lower": one(e.lower, e.upper[0] + 1e-12)},
    "a box of another size": lambda e: {"upper": e.upper[1:]},
    "no adaptation": lambda e: {"gains": e.gains._replace(adaptation=one(e.gains.adaptation, 0.0))},
    "adaptation of others": lambda e: {"gains": e.gains._replace(adaptation=e.gains.adaptation[1:])},
    "no damping": lambda e: {"gains": e.gains._replace(damping=one(e.gains.damping, 0.0))},
    "damping of another size": lambda e: {"gains": e.gains._replace(damping=np.ones(3))},
    "an error that stays": lambda e: {"gains": e.gains._replace(slope=one(e.gains.slope, 0.0))},
    "no period": lambda e: {"gains": e.gains._replace(period=0.0)},
    "an endless period": lambda e: {"gains": e.gains._replace(period=np.inf)},
    "a damper that drives": lambda e: {"known": one(e.known, -1e-9, 40 + 4)},
    "a damper that may drive": lambda e: {"basis": one(e.basis, 1e-9, (40 + 7) * 4), "lower": -e.upper},
    "gravity in a plane": lambda e: {"gravity": e.gravity[:2]},
    "knots from later on": lambda e: {"reference": ReferencePieces(e.reference.c, e.reference.x + 0.1)},
    "a start of another size": lambda e: {"theta": e.theta[1:]},
}


@pytest.mark.parametrize("name", FORGED)
def test_equations_that_are_none(own, name):
    with pytest.raises(NotProvedError):
        changed(own, **FORGED[name](own))


def test_what_may_just_be(own):
    """A box of one point, a damper of none, one that is none at one of its ends."""
    changed(own, upper=own.lower)
    changed(own, basis=one(own.basis, 1.0, (40 + 7) * 4), lower=one(own.lower, 0.0))
    changed(own, known=one(own.known, -1.0, 40 + 4 + 4))  # a spring may push


def test_equations_cannot_be_written_to(own):
    """A pickle has the same digest, any change another."""
    basis, slope = own.basis.copy(), own.gains.slope.copy()
    made = changed(own, basis=basis, gains=own.gains._replace(slope=slope))
    before = made.digest
    basis += 1.0
    slope += 1.0
    assert changed(made).digest == before == own.digest == pickle.loads(pickle.dumps(own)).digest
    for array in (made.basis, made.known, made.lower, made.gains.slope, made.gains.adaptation, made.theta):
        with pytest.raises(ValueError, match="read-only"):
            array += 1.0
    assert made.sizes["X"] == 4
    for change in (
        {"theta": own.theta + 1e-12}, {"known": one(own.known, 1e-12)}, {"basis": one(own.basis, 1e-12, 7)},
        {"lower": own.lower - 1e-12}, {"upper": own.upper + 1e-12}, {"gravity": own.gravity + 1e-12},
        {"gains": own.gains._replace(period=1.0000001e-3)}, {"frames": own.frames[4:] + own.frames[:4]},
    ):  # fmt: skip
        assert changed(own, **change).digest != own.digest


def test_other_laws_and_robots_have_tubes_of_their_own(known):
    """Weaker gains, a larger box, longer periods, other bodies: nothing of the fact holds of them."""
    own = known.claim.equations
    gains, half = own.gains, 0.5 * (own.upper - own.lower)
    for change in (
        {"gains": gains._replace(damping=0.8 * gains.damping)},
        {"gains": gains._replace(slope=0.8 * gains.slope)},
        {"gains": gains._replace(period=2.0 * gains.period)},
        {"lower": own.lower - half}, {"upper": own.upper + half},
        {"basis": 1.5 * own.basis}, {"gravity": 2.0 * own.gravity},
    ):  # fmt: skip
        refused(lambda change=change: replace(known.claim, equations=changed(own, **change)), *known.premises)
    less = replace(known.claim, equations=changed(own, gains=gains._replace(adaptation=0.5 * gains.adaptation)))
    assert prove(less, *known.premises).found["first"] > 1.9 * known.found["first"]


def test_a_cell_is_as_long_as_a_period(known):
    """What holds in between two samples is of two cells at most; a cell as long as the period has other troubles."""
    own, shortest = known.claim.equations, np.diff(known.claim.times).min()
    for period, told in ((1.001 * shortest, "a cell that is shorter than the period"), (shortest, "not")):
        late = changed(own, gains=own.gains._replace(period=period))
        with pytest.raises(NotProvedError, match=told) as raised:
            prove(replace(known.claim, equations=late), *known.premises)
        assert ("shorter" in str(raised.value)) == (period > shortest)


def test_which_constants_only_add(own):
    """Masses, Ixx, Iyy and Izz, rotors, and whole bodies; first moments and products do not, nor what goes down."""
    assert own.adds.all()
    unit = np.eye(len(own.known))
    rows = [0, 1, 4, 5, 6, 9, 17, 40, 41, 44]
    ones = np.ones(len(rows))
    single = changed(own, basis=unit[:, rows], lower=ones, upper=ones, gains=own.gains._replace(adaptation=ones))
    np.testing.assert_array_equal(single.adds, [True, False, True, False, True, True, False, True, True, True])
    own_body = own.basis[:, 0]
    mixed = np.stack([-own_body, own_body - unit[40], own_body + unit[40], own_body + 20.0 * unit[1]], axis=1)
    four = changed(own, basis=mixed)
    np.testing.assert_array_equal(four.adds, [False, False, True, False])


@pytest.mark.parametrize(("more", "held"), [(1.03, True), (0.97, False)])
def test_inertias_that_are_just_definite(more, held):
    """m = 1, h = (c, 0, 0) and I of 1: the least eigenvalue is 1 − c, in units with a diagonal of ones."""
    c = 1.0 - more * 1e-9
    for unit in (1.0, 1e-3):
        body = np.array([1.0, c * unit, 0.0, 0.0, unit**2, 0.0, unit**2, 0.0, 0.0, unit**2])
        assert _definite(body) == held
    assert _definite(np.array([1.0, *np.zeros(3), 1.0, 0.0, 1.0, 0.0, 0.0, 1.0]))
    for place in (0, 4, 6, 9):
        for value in (0.0, -1.0):
            assert not _definite(one(np.array([1.0, *np.zeros(3), 1.0, 0.0, 1.0, 0.0, 0.0, 1.0]), value, place))


# Certificates.


def test_a_certificate_says_what_its_fact_does(certificate, known):
    bound = known.found["bound"]
    np.testing.assert_array_equal(certificate.errors, bound[:, :2])
    np.testing.assert_array_equal(certificate.sliding, bound[:, 2:])
    np.testing.assert_array_equal(certificate.error, bound[:, :2].max(axis=0))
    np.testing.assert_array_equal(certificate.ultimate, known.found["ultimate"])
    assert np.all(certificate.ultimate <= certificate.errors[-1])
    np.testing.assert_allclose(certificate.efforts, known.found["efforts"].max(axis=0))
    np.testing.assert_allclose(certificate.mean_square(np.inf) * [4.0, 3.0], known.found["power"][0])
    for wrong in (0.0, -1.0, np.nan, "long"):
        with pytest.raises(InvalidInputError, match="duration"):
            certificate.mean_square(wrong)
    started = certificate.mean_square(2.0) * [4.0, 3.0]
    np.testing.assert_allclose(started, known.found["power"][0] + 0.5 * known.found["first"][0])
    assert certificate.times[0] == 0.0
    assert certificate.times[-1] == np.inf
    assert len(certificate.times) == len(bound) + 1
    assert "every robot" in certificate.reason


def test_a_fact_about_another_law_says_nothing_of_this(certificate):
    other = replace(certificate, law=law_of(K=[5.0, 3.0]))
    assert other.verdict == "undecided"
    assert np.isinf(other.error).all()
    for numbers in (other.mean_square(np.inf), other.efforts, other.ultimate, other.sliding):
        assert np.isinf(numbers).all()
    assert other.sliding.shape == other.errors.shape == certificate.errors.shape
    assert "this law" in other.reason
    loaded = replace(certificate, proved=pickle.loads(pickle.dumps(certificate.proved)))
    assert loaded.verdict == "undecided"
    assert loaded.replay().verdict == "proven"


def test_gears_change_efforts_alone(certificate):
    """The same tube; what a motor is asked for is the joint's effort over its gear."""
    own = law_of().model.mechanism.description
    motors = tuple(replace(motor, gear=gear) for motor, gear in zip(own.motors, (50.0, -20.0), strict=True))
    geared = law_of(ccpin.load(replace(own, motors=motors)))
    found = certify_adaptive(geared, initial_error=1e-4, initial_sliding=1e-3, cells=CELLS)
    assert found.verdict == "proven", found.reason
    np.testing.assert_allclose(found.errors, certificate.errors, rtol=1e-9)
    np.testing.assert_allclose(found.efforts, certificate.efforts / [50.0, 20.0], rtol=1e-9)


class Formless(Reference):
    """One whose polynomials nobody knows."""

    def at(self, t):
        return None


def test_a_law_that_was_changed_is_another(certificate):
    """A certificate remembers no verdict: what somebody writes into its law, or has it follow, is looked at."""
    law = law_of()
    mine = replace(certificate, law=law)
    for name, other in (("K", 2.0 * law.K), ("period", 2.0 * law.period)):
        assert mine.verdict == "proven"
        own = getattr(law, name)
        setattr(law, name, other)
        assert mine.verdict == "undecided"
        assert np.isinf(mine.error).all()
        setattr(law, name, own)
    own, goal = law.reference, law.reference.at(9.0).q
    for other in (PointToPoint(law.model, own.at(0.0).q, goal + 0.1, 0.25), Formless()):
        law.reference = other
        assert mine.verdict == "undecided"
        assert np.isinf(mine.error).all()
    law.reference = own
    assert mine.verdict == "proven"
    assert replace(certificate, proved=None).replay().verdict == "undecided"


def test_what_is_asked_of_motors_is_what_they_have(certificate):
    """A motor that has a hair less than is asked for is named; the fact is about the law, whatever the motors have."""
    asked, description = certificate.efforts, certificate.law.model.mechanism.description
    for limits, verdict in ((asked * 1.001, "proven"), (asked * [1.001, 0.999], "undecided")):
        motors = tuple(
            replace(motor, lower=-9.0, upper=float(most))
            for motor, most in zip(description.motors, limits, strict=True)
        )
        found = replace(certificate, law=law_of(ccpin.load(replace(description, motors=motors))))
        assert found.verdict == verdict
        assert ("joint2" in found.reason) is (verdict == "undecided")
    joints = tuple(replace(joint, effort=np.inf) for joint in description.joints)
    strong = replace(certificate, law=law_of(ccpin.load(replace(description, joints=joints))))
    assert strong.verdict == "proven"
    assert replace(strong, proved=None).verdict == "undecided"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"period": 0.02}, "regular|shorter period"),
        ({"period": 0.024}, "shorter than the law's period: fewer cells="),
        ({"period": 2.0}, "a shorter period= is needed"),
        ({"bounds": 0.5}, "smaller box"),
    ],
)
def test_where_bounds_do_not_close_it_is_said_why(change, said):
    found = certify_adaptive(law_of(**change), cells=CELLS)
    assert found.verdict == "undecided"
    assert found.proved is None
    assert any(word in found.reason for word in said.split("|"))


def test_a_reference_that_leaves_the_branch_is_undecided():
    found = certify_adaptive(law_of(move=np.array([2.0, -2.0])), cells=CELLS)
    assert found.verdict == "undecided"
    assert "reference itself" in found.reason


def test_dry_friction_is_named():
    """A robot that rubs is told of with the smooth one."""
    rubbing = ccpin.load("rpdr", joints={"joint3": {"friction": 0.01}})
    assert "without the dry friction of joint3" in certify_adaptive(law_of(rubbing), cells=2).reason


def test_what_it_is_not_about():
    for change in ({"slope": np.array([[10.0, 1.0], [1.0, 10.0]])}, {"K": np.array([[3.0, 0.1], [0.1, 3.0]])}):
        with pytest.raises(UnsupportedMechanismError, match="not diagonal"):
            certify_adaptive(law_of(**change))
    for given in ({"initial_error": -1.0}, {"initial_sliding": [1.0, 2.0, 3.0]}, {"initial_error": np.inf}):
        with pytest.raises(InvalidInputError, match="initial_"):
            certify_adaptive(law_of(), **given)
