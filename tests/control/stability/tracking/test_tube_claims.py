"""Claims about tubes that are forged: misshapen, altered, with borrowed premises, about other laws and mechanisms."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import ComputedTorque, PDPlus, PointToPoint, Waypoints, certify_tracking
from ccpin.control.stability.tracking.error_equations import Feedback
from ccpin.control.stability.tracking.on_line import SigmaKept
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces, TrackingEquations
from ccpin.control.stability.tracking.tracking_error import _check
from ccpin.control.stability.tracking.tube_claim import TubeKept
from ccpin.covering.claims import proved_points
from ccpin.proof.equations import Closures
from ccpin.proof.facts import Fact, NotProvedError, prove, prove_some
from ccpin.proof.solutions import Met, SolutionsInBoxes
from tests.support.paper import START
from tests.support.tracked import LAWS, law_for, model_of

CELLS = 48


@pytest.fixture(scope="module")
def facts():
    """Facts about the tubes of both laws."""
    return {kind: certify_tracking(law_for(kind), 1e-4, cells=CELLS).proved for kind in LAWS}


@pytest.fixture(scope="module")
def known(facts):
    """Computed torque's."""
    return facts[ComputedTorque]


@pytest.fixture(scope="module")
def tighter():
    """The fact about the same reference's cells, with a larger ε and so larger rooms."""
    return certify_tracking(law_for(ComputedTorque), 1e-3, cells=CELLS).proved


def refused(make, *premises, about=NotProvedError):
    with pytest.raises(about):
        prove(make(), *premises)


def altered(name, alter):
    return lambda claim: replace(claim, **{name: alter(getattr(claim, name).copy())})


MISSHAPEN = {
    "a time too few": ("times", lambda x: x[1:]),
    "times from a second on": ("times", lambda x: x + 1.0),
    "times exchanged": ("times", lambda x: x[::-1]),
    "times that end early": ("times", lambda x: np.append(x[:-1], x[-1] - 0.5)),
    "times that go on": ("times", lambda x: np.append(x[:-1], x[-1] + 0.5)),
    "the last but one later": ("times", lambda x: np.concatenate([x[:-2], [x[-2] + 0.1], x[-1:]])),
    "times a little later": ("times", lambda x: np.concatenate([x[:1], x[1:-2] + 1e-6, x[-2:]])),
    "a cell too few": ("room", lambda x: x[1:]),
    "an error too few": ("room", lambda x: x[:, 1:]),
    "no room": ("room", lambda x: 0.0 * x),
    "rooms exchanged": ("room", lambda x: -x),
    "single precision": ("room", lambda x: x.astype(np.float32)),
    "room that is no number": ("room", lambda x: x * np.nan),
    "a narrower room": ("room", lambda x: 0.3 * x),
    "a wider room": ("room", lambda x: 1.01 * x),
    "room without end": ("room", lambda x: x + np.inf),
    "no decay": ("decay", lambda x: 0.0 * x),
    "a faster decay": ("decay", lambda x: 3.0 * x),
    "decay of what grows": ("decay", lambda x: -x),
    "no scale": ("scale", lambda x: 0.0 * x),
    "a scale too many": ("scale", lambda x: np.append(x, 1.0)),
    "no sigma_error": ("sigma_error", lambda x: 0.0 * x),
    "a larger sigma_error": ("sigma_error", lambda x: 4.0 * x),
    "a force": ("disturbance", lambda x: x + 1.0),
    "a force less than none": ("disturbance", lambda x: x - 1.0),
    "a start that is off": ("start", lambda x: x + 0.01),
    "another storage function": ("storage", lambda x: -x),
    "no storage function": ("storage", lambda x: 0.0 * x),
    "a storage function of half the error": ("storage", lambda x: x[:2, :2]),
    "none at all": ("storage", lambda x: x[:0, :0]),
    "one that is not symmetric": ("storage", lambda x: x + np.triu(1e-9 * x, 1)),
    "words": ("storage", lambda x: x.astype(str)),
}


@pytest.mark.parametrize("name", MISSHAPEN)
def test_no_fact_comes_of_other_numbers(known, name):
    refused(lambda: altered(*MISSHAPEN[name])(known.claim), *known.premises)


def test_what_it_was_made_of_is_a_fact(facts):
    for fact in facts.values():
        again = fact.replay()
        for name, values in fact.found.items():
            np.testing.assert_array_equal(again.found[name], values)
        copy = pickle.loads(pickle.dumps(fact))
        assert type(copy) is not Fact
        np.testing.assert_array_equal(copy.replay().found["bound"], fact.found["bound"])


def test_laws_of_one_storage_function_have_no_other(facts):
    """P of computed torque says nothing of PD+, which has none."""
    plus, torque = facts[PDPlus].claim, facts[ComputedTorque].claim
    refused(lambda: replace(plus, storage=torque.storage), *facts[PDPlus].premises)
    refused(lambda: replace(plus, equations=torque.equations), *facts[PDPlus].premises)
    refused(lambda: replace(torque, equations=plus.equations), *facts[ComputedTorque].premises)


BORROWED = {
    "none": lambda path, boxes, glue, other: (),
    "no glue": lambda path, boxes, glue, other: (path, boxes),
    "no path": lambda path, boxes, glue, other: (boxes, boxes, *glue),
    "the path's boxes for the cells'": lambda path, boxes, glue, other: (path, path.premises[0], *glue),
    "the path where glue is due": lambda path, boxes, glue, other: (path, boxes, path),
    "boxes where glue is due": lambda path, boxes, glue, other: (path, boxes, boxes),
    "others' boxes": lambda path, boxes, glue, other: (path, other[1], *glue),
    "others' glue": lambda path, boxes, glue, other: (path, boxes, *other[2:]),
    "others' boxes and glue": lambda path, boxes, glue, other: (path, *other[1:]),
    "some of others'": lambda path, boxes, glue, other: (path, boxes, *glue, *other[2:]),
    "in another order": lambda path, boxes, glue, other: (boxes, path, *glue),
    "glue of the path to itself": lambda path, boxes, glue, other: (path, boxes, *path.premises[2:]),
}


@pytest.mark.parametrize("name", BORROWED)
def test_premises_are_those_of_the_tube(known, tighter, name):
    """Boxes of larger rooms hold smaller ones, but glue is about the boxes that it is about."""
    path, boxes, *glue = known.premises
    premises = BORROWED[name](path, boxes, tuple(glue), tighter.premises)
    refused(lambda: known.claim, *premises)


def test_larger_boxes_hold_smaller_rooms(known, tighter):
    """With premises all of the other tube: it is no lie, and the bound is no smaller."""
    fact = prove(known.claim, *tighter.premises)
    assert np.all(fact.found["bound"] >= 0.999 * known.found["bound"])


@pytest.mark.parametrize("left", [0, 1, 20, 47, 48])
def test_every_cell_is_glued(known, left):
    """Without the pair of one cell there is no fact."""
    path, boxes, *glue = known.premises
    number = len(path.premises[0].claim.kappa) + left
    fewer = [prove(fact.claim.take(fact.claim.second != number), *fact.premises) for fact in glue]
    assert sum(len(fact.claim.first) for fact in fewer) == CELLS
    refused(lambda: known.claim, path, boxes, *fewer)


def test_glue_at_other_times_says_nothing():
    """A path that goes and comes back: cells of the way back, glued to boxes of the way there at the same place."""
    model = model_of("rpdr")
    motion = Waypoints(model, [0.0, 0.2, 0.4], np.array([START, START + 0.1, START]))
    known = certify_tracking(ComputedTorque(model, motion, [400.0] * 2, [40.0] * 2), 1e-5, cells=CELLS).proved
    (path, boxes, *glue), closures = known.premises, known.claim.equations.closures
    along, ends, independent = path.premises[0].claim, path.claim.times, closures.system.independent
    middles = 0.5 * (known.claim.times[1:] + known.claim.times[:-1])
    later = np.flatnonzero((middles > 0.25) & (middles < 0.39))
    number = np.searchsorted(ends, 0.4 - middles[later], side="right") - 1
    s = 2.0 * (0.4 - middles[later] - ends[number]) / (ends[number + 1] - ends[number]) - 1.0
    place = along.centre[number][:, independent] + s[:, None] * along.directions[number][:, independent, 0]
    there = np.hstack([s[:, None], boxes.claim.centre[later][:, independent] - place])
    second = len(ends) - 1 + later
    mirrored = (number, second, there, np.zeros_like(there))
    points = proved_points(closures.problem, boxes.claim.centre[later])[0]
    met, same = prove_some(Met(closures, *mirrored, np.arange(len(later))), points, *glue[0].premises)
    assert same.any()
    rest = [prove(fact.claim.take(~np.isin(fact.claim.second, second[same])), *fact.premises) for fact in glue]
    prove(known.claim, path, boxes, *glue)
    refused(lambda: known.claim, path, boxes, met, *rest)


# Equations.


def changed(equations, **change):
    names = ("closures", "free", "feedback", "reference", "theta")
    return TrackingEquations(*(change.get(name, getattr(equations, name)) for name in names))


def with_tip(free, **change):
    return free._replace(tips=(free.tips[0]._replace(**change), *free.tips[1:]))


FORGED = {
    "closures of a mechanism": lambda e: {"closures": e.closures.problem},
    "gains of another size": lambda e: {"feedback": e.feedback._replace(K_p=np.eye(3))},
    "gains that are no number": lambda e: {"feedback": e.feedback._replace(K_v=np.nan * e.feedback.K_v)},
    "gains that are not symmetric": lambda e: {"feedback": e.feedback._replace(K_p=np.array([[1.0, 0.1], [0.0, 1.0]]))},
    "another kind of law": lambda e: {"feedback": Feedback("pd", e.feedback.K_p, e.feedback.K_v)},
    "a kind that there is not": lambda e: {"feedback": Feedback("odd", e.feedback.K_p, e.feedback.K_v)},
    "knots from later on": lambda e: {"reference": ReferencePieces(e.reference.c, e.reference.x + 0.1)},
    "a knot too few": lambda e: {"reference": ReferencePieces(e.reference.c, e.reference.x[1:])},
    "no pieces": lambda e: {"reference": ReferencePieces(e.reference.c[:, :0], e.reference.x[:1])},
    "knots that fall back": lambda e: {
        "reference": ReferencePieces(e.reference.c, e.reference.x * np.array([1.0, -1.0, 1.0]))
    },
    "knots without end": lambda e: {"reference": ReferencePieces(e.reference.c, np.append(e.reference.x[:-1], np.inf))},
    "a reference that goes on": lambda e: {"reference": ReferencePieces(e.reference.c[:, :1], e.reference.x[:2])},
    "of another size": lambda e: {"reference": ReferencePieces(e.reference.c[:, :, :1], e.reference.x)},
    "polynomials without coefficients": lambda e: {"reference": ReferencePieces(e.reference.c[:0], e.reference.x)},
    "coefficients that are no number": lambda e: {"reference": ReferencePieces(np.nan * e.reference.c, e.reference.x)},
    "one gain without end": lambda e: {"feedback": e.feedback._replace(K_p=np.diag([np.inf, 1.0]))},
    "polynomials with an axis more": lambda e: {"reference": ReferencePieces(e.reference.c[..., None], e.reference.x)},
    "a knot too many": lambda e: {
        "reference": ReferencePieces(e.reference.c, np.append(e.reference.x, e.reference.x[-1] + 1.0))
    },
    "one coefficient that is no number": lambda e: {
        "reference": ReferencePieces(
            np.where(np.arange(e.reference.c.size).reshape(e.reference.c.shape) == 0, np.nan, e.reference.c),
            e.reference.x,
        )
    },
    "a piece of no length": lambda e: {
        "reference": ReferencePieces(e.reference.c[:, [0, 0, 1]], np.insert(e.reference.x, 1, e.reference.x[1]))
    },
    "a start of which one entry is no number": lambda e: {"theta": np.append(e.theta[:-1], np.nan)},
    "a start of another size": lambda e: {"theta": e.theta[1:]},
    "a start that is no number": lambda e: {"theta": np.nan * e.theta},
    "a spring too few": lambda e: {"free": e.free._replace(stiffness=e.free.stiffness[1:])},
    "an endless rotor": lambda e: {"free": e.free._replace(armature=e.free.armature + np.inf)},
    "a body of no number": lambda e: {"free": with_tip(e.free, weight=np.nan)},
    "a body that is surer than sure": lambda e: {"free": with_tip(e.free, doubt=-1e-9)},
    "gravity of another size": lambda e: {"free": with_tip(e.free, fall=np.zeros(2))},
    "an axis that is none": lambda e: {
        "free": with_tip(e.free, chain=e.free.tips[0].chain._replace(axes=1.1 * e.free.tips[0].chain.axes))
    },
    "a body on two rows": lambda e: {
        "free": with_tip(e.free, chain=e.free.tips[0].chain._replace(weights=np.zeros((2, 3))))
    },
}


@pytest.mark.parametrize("name", FORGED)
def test_equations_that_are_none(known, name):
    with pytest.raises(NotProvedError):
        changed(known.claim.equations, **FORGED[name](known.claim.equations))


def test_equations_cannot_be_written_to(known):
    """Nor does what they were made of reach them; a pickle has the same digest, any change another."""
    own = known.claim.equations
    c, K_p, theta = own.reference.c.copy(), own.feedback.K_p.copy(), own.theta.copy()
    made = changed(
        own, reference=ReferencePieces(c, own.reference.x), feedback=own.feedback._replace(K_p=K_p), theta=theta
    )
    before = made.digest
    for array in (c, K_p, theta):
        array += 1.0
    assert changed(made).digest == before == own.digest == pickle.loads(pickle.dumps(own)).digest
    for array in (made.reference.c, made.feedback.K_p, made.theta, made.free.damping, made.free.tips[0].fall):
        with pytest.raises(ValueError, match="read-only"):
            array += 1.0
    assert made.sizes["X"] == 4
    for change in (
        {"theta": own.theta + 1e-12},
        {"free": own.free._replace(damping=own.free.damping + 1e-12)},
        {"free": with_tip(own.free, weight=own.free.tips[0].weight + 1e-12)},
        {"feedback": own.feedback._replace(K_v=own.feedback.K_v + 1e-9)},
        {"closures": Closures(own.closures.system, not own.closures.planar)},
    ):
        other = changed(own, **change)
        assert (other.digest == own.digest) is ("closures" in change)  # which bounds are asked for is no equation


def test_other_laws_have_tubes_of_their_own(known):
    """Weaker gains, heavier bodies, another motion: nothing of the fact holds of them."""
    own = known.claim.equations
    c = own.reference.c.copy()
    c[-2] += 1e-3
    heavy = own.free._replace(tips=tuple(tip._replace(weight=40.0 * tip.weight) for tip in own.free.tips))
    for change in (
        {"feedback": own.feedback._replace(K_p=0.2 * own.feedback.K_p)},
        {"free": own.free._replace(damping=own.free.damping + 100.0)},
        {"free": heavy},
        {"reference": ReferencePieces(np.concatenate([c[:, :-1], own.reference.c[:, -1:]], axis=1), own.reference.x)},
    ):
        try:
            fact = prove(replace(known.claim, equations=changed(own, **change)), *known.premises)
        except NotProvedError:
            continue
        assert not np.array_equal(fact.found["bound"], known.found["bound"])


@pytest.mark.parametrize(("away", "held"), [(0.0, True), (0.4, False), (np.pi, False)])
def test_the_law_starts_on_the_branch(known, away, held):
    """Its configuration is in the path's first box: an elbow turned by 0.4 rad, or to the other side, is not."""
    own = known.claim.equations
    theta = own.theta.copy()
    theta[own.closures.system.dependent[0]] += away
    claim = replace(known.claim, equations=changed(own, theta=theta))
    if held:
        prove(claim, *known.premises)
    else:
        refused(lambda: claim, *known.premises)


@pytest.mark.parametrize(("away", "held"), [(1e-12, True), (0.3, False)])
def test_the_law_starts_where_the_reference_does(known, away, held):
    own = known.claim.equations
    theta = own.theta.copy()
    theta[own.closures.system.independent[0]] += away
    claim = replace(known.claim, equations=changed(own, theta=theta))
    if held:
        prove(claim, *known.premises)
    else:
        refused(lambda: claim, *known.premises)


# Cells in their boxes.


def with_boxes(known, change):
    """The claim with premises about altered boxes, as far as these are proved; or why they are none."""
    path, boxes, *glue = known.premises
    altered = change(boxes.claim.boxes)
    other, kept = prove_some(SolutionsInBoxes(known.claim.equations.closures, *altered))
    assert kept.all()
    return prove(known.claim, path, other, *(prove(fact.claim, *fact.premises[:-1], other) for fact in glue))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("share", "held"), [(1.0, True), (1.0 - 1e-9, False)])
def test_cells_are_in_their_boxes(known, axis, share, held):
    """As wide as errors and what the chord strays, and the chord whole: a billionth less is too little."""
    h = share - 1.0

    def narrower(boxes):
        half = boxes.half.copy()
        half[3, axis] *= 1.0 + h
        return boxes._replace(half=half)

    if held:
        with_boxes(known, narrower)
    else:
        with pytest.raises(NotProvedError, match="in its box"):
            with_boxes(known, narrower)


def test_boxes_lie_about_the_chords(known):
    """To the last bit: the cells' forms are about the boxes' own places."""
    independent = known.claim.equations.closures.system.independent

    def beside(boxes):
        centre = boxes.centre.copy()
        centre[2, independent[0]] = np.nextafter(centre[2, independent[0]], 9.0)
        return boxes._replace(centre=centre)

    def askew(boxes):
        directions = boxes.directions.copy()
        directions[2, independent[0], 0] = np.nextafter(directions[2, independent[0], 0], 9.0)
        return boxes._replace(directions=directions)

    for change in (beside, askew):
        with pytest.raises(NotProvedError, match=r"about other places|along others"):
            with_boxes(known, change)


# σ on line.


def test_sigma_on_line_is_of_a_tube(known):
    """Of one fact, of the same equations, at a period of its own; the fact's ε is what is kept."""
    own = known.claim.equations
    fact = prove(SigmaKept(own, np.array([1e-3])), known)
    assert fact.found["steps"].dtype == np.int64
    refused(lambda: SigmaKept(own, np.array([1e-3])))
    refused(lambda: SigmaKept(own, np.array([1e-3])), known, known)
    refused(lambda: SigmaKept(own, np.array([1e-3])), known.premises[1])
    refused(lambda: SigmaKept(own, np.array([1e-3])), fact)
    for period in ([0.0], [-1e-3], [np.nan], [np.inf], [1e-3, 1e-3]):
        refused(lambda period=period: SigmaKept(own, np.array(period)), known)
    refused(lambda: SigmaKept(changed(own, theta=own.theta + 1e-12), np.array([1e-3])), known)
    assert fact.found["start"][0] > known.claim.sigma_error[0]


def test_a_certificate_says_what_its_fact_does(known):
    """With another ε, force or law it is undecided, with a fact of another kind too; no number is its own."""
    law = law_for(ComputedTorque)
    proof = certify_tracking(law, 1e-4, cells=CELLS)
    assert proof.verdict == "proven"
    other = law_for(PDPlus)
    weaker = ComputedTorque(ccpin.ReducedModel(ccpin.load("rpdr")), law.reference, [399.0] * 2, [40.0] * 2)
    for change in (
        {"sigma_error": 1e-3}, {"disturbance": np.array([1e-3, 0.0])}, {"law": other}, {"law": weaker},
        {"proved": None}, {"proved": known.premises[0]}, {"proved": known.claim},
        {"proved": pickle.loads(pickle.dumps(known))},
    ):  # fmt: skip
        made = replace(proof, **change)
        assert made.verdict == "undecided"
        assert np.isinf(made.error).all()
        assert np.isinf([made.gain, made.start]).all()
        assert made.decay == 0.0
        assert (made.errors.shape, made.speeds.shape) == (proof.errors.shape, proof.speeds.shape)
        assert (made.ultimate.shape, made.unit.shape) == (proof.ultimate.shape, proof.unit.shape)
    law.K_p, own = 0.5 * law.K_p, law.K_p
    assert proof.verdict == "undecided"
    law.K_p = own
    own, law.reference = law.reference, PointToPoint(law.model, law.near.q, law.near.q + 0.3, 0.1)
    assert proof.verdict == "undecided"
    law.reference = own
    plain = law.model.mechanism.description
    motors = tuple(replace(motor, gear=gear) for motor, gear in zip(plain.motors, (50.0, -20.0), strict=True))
    geared = ccpin.ReducedModel(ccpin.load(replace(plain, motors=motors)))
    behind = ComputedTorque(geared, law.reference, law.K_p, law.K_v)
    _check(behind)
    assert replace(proof, law=behind).verdict == "proven"  # what is claimed is of forces on q
    sent = pickle.loads(pickle.dumps(proof))
    assert (proof.verdict, sent.verdict, sent.replay().verdict) == ("proven", "undecided", "proven")
    assert sent.replay().start == pytest.approx(proof.start, rel=1e-12)
    assert replace(proof, proved=None).replay().verdict == "undecided"
    assert isinstance(proof.proved.claim, TubeKept)
    np.testing.assert_array_equal(proof.errors, proof.proved.found["bound"][:, :2])
    np.testing.assert_array_equal(proof.error, proof.errors.max(axis=0))
    assert np.all(proof.errors.min(axis=0) < proof.error)
    np.testing.assert_array_equal(proof.speeds, proof.proved.found["bound"][:, 2:])
    np.testing.assert_array_equal(proof.times, [*proof.proved.claim.times[:-1], np.inf])
    assert (proof.gain, proof.start) == (proof.proved.found["gain"][0], proof.proved.found["level"][0])
    assert proof.decay == proof.proved.claim.decay[0]
