"""Covers of singular curves: true ones are proved, planted errors are found."""

from functools import cache

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.errors import InvalidInputError
from tests.oracles import five_bar as oracle
from tests.oracles import rpdr
from tests.support.altered import changed, claim
from tests.support.five_bars import load_five_bar
from tests.support.legs import load_slice
from tests.support.paper import CURVED as REGION

pytest.importorskip("flint")

from ccpin.auditing import closures, exclusion, reading, singular_curves, slanted, verify
from ccpin.auditing.reach import CornerBox
from tests.support.long_cases import later

FOLD = np.deg2rad([[100.0, 35.0], [140.0, 75.0]])  # of the RPDR: a piece of its fold, across both middles
SLICE = np.array([[0.168, 0.247], [0.192, 0.271]])  # of the 3-RPR, with a cusp
CROSSING = oracle.FiveBar(0.2, 0.3, 0.2, 0.3, 0.4)  # the fold crosses itself at q = 0
CASES = {"3-RPR": SLICE, "five-bar": np.array([[0.1, 0.1], [0.5, 0.5]])}


@cache
def cover_of(name):
    """A cover, found once, however often tests are told of its mechanism."""
    load = {"3-RPR": load_slice, "five-bar": lambda: load_five_bar(CROSSING)}
    return domain.certify_singularities(load[name](), CASES[name])


@pytest.fixture(scope="module", params=later("rpdr", *CASES))
def case(request, tmp_path_factory, rpdr_curves):
    """A cover and its file."""
    found = rpdr_curves if request.param == "rpdr" else cover_of(request.param)
    assert found.curves
    path = tmp_path_factory.mktemp("cover") / "cover.json"
    found.save(path)
    return found, path


@pytest.fixture(scope="module")
def region(tmp_path_factory, rpdr_curves):
    """The RPDR's cover of REGION, and its file."""
    path = tmp_path_factory.mktemp("cover") / "cover.json"
    rpdr_curves.save(path)
    return rpdr_curves, path


def test_true_covers_are_proved(case):
    """A sample of tubes, of gluings and of parts of the region."""
    found, path = case
    audit = verify(path, sample=4)
    assert audit.holds, str(audit)
    assert "Theorem R" in audit.theorem
    tubes = sum(len(curve.radius) for curve in found.curves)
    assert claim(audit, "one singular curve").of == tubes
    assert claim(audit, "goes on").of == sum(len(c.radius) - 1 + c.closed for c in found.curves)
    assert claim(audit, "parts").checked == 4
    assert "0 boxes" in audit.not_checked


def test_the_equations_are_those_of_singular_configurations(case):
    """G vanishes to rounding on the tubes' middles; G′ and its variation are its derivatives."""
    read = reading.read(case[1])
    own, tube, rng = closures.BallClosures(read), read.tubes[0], np.random.default_rng(0)
    system = singular_curves.Singular(own, read.dependent, tube.pairing)
    x, step = np.concatenate([tube.theta, tube.kernel]), 1e-6 * np.eye(len(tube.tangent))
    assert np.abs(system.at(x)[0]).max() < 1e-9
    x, way = x + 0.3 * rng.normal(size=len(x)), rng.normal(size=len(x))
    slope = np.stack([(system.at(x + d)[0] - system.at(x - d)[0]) / 2e-6 for d in step], axis=1)
    np.testing.assert_allclose(system.at(x)[1], slope, atol=1e-8)
    bent = (system.at(x + 1e-6 * way)[1] - system.at(x - 1e-6 * way)[1]) / 2e-6
    moved = system.motions([closures.arb(float(v)) for v in x])
    found = closures.floats(system.variation(moved, [closures.arb(float(v)) for v in way]))
    np.testing.assert_allclose(found, bent, atol=1e-7)


WRONG = ("moved", "shrunk", "longer", "wider", "column")
# cut again and again before they are let go
LONG = {("rpdr", "wider"), *((name, what) for name in CASES for what in WRONG)}


@pytest.mark.parametrize(
    ("case", "what"),
    [pytest.param(c, w, marks=[pytest.mark.slow] * ((c, w) in LONG)) for c in ("rpdr", *CASES) for w in WRONG],
    indirect=["case"],
)
def test_a_wrong_tube_is_found(case, tmp_path, what):
    """Beside its curve, too narrow to hold it, beyond its ends, too wide to hold it alone, and of no j."""
    _, path = case

    def damage(arrays):
        if what == "moved":
            arrays["tube_theta"][1] += 0.1
        elif what == "shrunk":
            arrays["tube_radius"][1] *= 1e-6
        elif what == "longer":
            arrays["tube_half"][1] *= 30.0
        elif what == "wider":
            arrays["tube_radius"][1] *= 100.0
        else:
            arrays["tube_along"][1] = (arrays["tube_along"][1] + 1) % len(arrays["tube_tangent"][1])

    read = reading.read(changed(path, tmp_path, damage))
    own = closures.BallClosures(read)
    assert not singular_curves.one_curve(own, read, 1)
    assert singular_curves.one_curve(own, read, 0)


def rows(arrays, order):
    """All tubes in another order, or only some."""
    for name in reading.CurveTube._fields:
        arrays[f"tube_{name}"] = arrays[f"tube_{name}"][order]


def test_gluing_in_another_order_is_found(region, tmp_path):
    """Two tubes that change places, and a ring with a tube left out, are no longer glued."""
    found, path = region
    first = np.cumsum([0] + [len(curve.radius) for curve in found.curves])[[c.closed for c in found.curves].index(True)]

    def swapped(arrays):
        order = np.arange(len(arrays["tube_half"]))
        order[[first + 20, first + 40]] = order[[first + 40, first + 20]]
        rows(arrays, order)

    def shorter(arrays):
        rows(arrays, np.delete(np.arange(len(arrays["tube_half"])), [first + 20, first + 21, first + 22]))
        arrays["curve_tubes"][[c.closed for c in found.curves].index(True)] -= 3

    for change, wrong in ((swapped, 19), (shorter, 19)):
        read = reading.read(changed(path, tmp_path, change))
        own = closures.BallClosures(read)
        assert not singular_curves.goes_on(own, read, first + wrong, first + wrong + 1)
        assert singular_curves.goes_on(own, read, first + 3, first + 4)
        assert not singular_curves.goes_on(own, read, first + 4, first + 3)


def test_an_open_curve_called_closed_is_found(region, tmp_path):
    """Its last tube is not glued to its first."""
    found, path = region
    k = [curve.closed for curve in found.curves].index(False)

    def closed(arrays):
        arrays["curve_closed"][k] = True

    read = reading.read(changed(path, tmp_path, closed))
    start = sum(len(curve.radius) for curve in found.curves[:k])
    assert not singular_curves.goes_on(
        closures.BallClosures(read), read, start + len(found.curves[k].radius) - 1, start
    )


def parts_on(read, theta):
    """The parts that hold configurations."""
    cover = exclusion.Exclusion(closures.BallClosures(read), read)
    theta = theta - np.where(read.periodic, 2.0 * np.pi * np.round(theta / (2.0 * np.pi)), 0.0)
    held = [any(np.all((t >= box.low) & (t <= box.high)) for t in theta) for box in cover.parts]
    return cover, np.flatnonzero(held)


def test_a_missing_curve_is_found(region, tmp_path, monkeypatch):
    """With either of the curves left out, a part of the region that it crosses is not proved."""
    monkeypatch.setattr(exclusion, "_BUDGET", 4000)
    found, path = region
    assert len(found.curves) == 2
    ends = np.cumsum([0] + [len(curve.radius) for curve in found.curves])
    for k in range(2):

        def without(arrays, k=k):
            rows(arrays, np.delete(np.arange(ends[-1]), np.arange(ends[k], ends[k + 1])))
            arrays["curve_tubes"], arrays["curve_closed"] = (
                np.delete(arrays[f"curve_{name}"], k) for name in ("tubes", "closed")
            )

        read = reading.read(changed(path, tmp_path, without))
        cover, crossed = parts_on(read, found.curves[k].tubes.theta)
        assert crossed.size
        assert not cover.proved(int(crossed[0]))


@pytest.mark.slow
def test_merged_covers_are_proved_and_a_missing_curve_is_found(tmp_path, monkeypatch):
    """Four quarters, the fold across both seams: proved whole; without the fold the parts that it crosses are not."""
    monkeypatch.setattr(exclusion, "_BUDGET", 4000)
    rpdr = ccpin.load("rpdr")
    quarters = [domain.certify_singularities(rpdr, part) for part in domain.split_region(FOLD, 4)]
    merged = domain.merge(quarters)
    merged.save(tmp_path / "merged.json")
    audit = verify(tmp_path / "merged.json", sample=2)
    assert audit.holds, str(audit)
    (curve,) = merged.curves
    assert claim(audit, "one singular curve").of == len(curve.radius)
    assert claim(audit, "goes on").of == len(curve.radius) - 1
    cover, crossed = parts_on(reading.read(tmp_path / "merged.json"), curve.tubes.theta)
    assert crossed.size > 1
    assert all(cover.proved(int(k)) for k in crossed[:2])
    domain.SingularCover(**{**vars(merged), "curves": ()}).save(tmp_path / "without.json")
    cover, crossed = parts_on(reading.read(tmp_path / "without.json"), curve.tubes.theta)
    assert not any(cover.proved(int(k)) for k in crossed[:2])
    region = quarters[0].region  # of one quarter the document claims all the same for the whole region
    domain.SingularCover(**{**vars(quarters[0]), "region": merged.region}).save(tmp_path / "quarter.json")
    cover, crossed = parts_on(reading.read(tmp_path / "quarter.json"), curve.tubes.theta)
    q = np.array([0.5 * (cover.parts[k].low + cover.parts[k].high)[[0, 2]] for k in crossed])
    beyond = crossed[np.any(q > region.upper + 0.1, axis=1)]
    assert beyond.size
    assert not cover.proved(int(beyond[-1]))


@pytest.mark.slow
def test_what_is_not_listed_is_found(region, tmp_path, monkeypatch):
    """A cover that was broken off is proved but for the boxes it lists; with one of these left out it is not."""
    found = domain.certify_singularities(ccpin.load("rpdr"), REGION, budget=3000)
    assert len(found.uncovered.lower)
    found.save(tmp_path / "early.json")
    audit = verify(tmp_path / "early.json", sample=3)
    assert audit.holds, str(audit)
    assert f"{len(found.uncovered.lower)} boxes" in audit.not_checked
    bare = domain.certify_singularities(ccpin.load("rpdr"), REGION, budget=200)
    assert not bare.curves
    bare.save(tmp_path / "bare.json")
    theta = region[0].curves[-1].tubes.theta[:1]
    monkeypatch.setattr(exclusion, "_BUDGET", 4000)
    cover, (part,) = parts_on(reading.read(tmp_path / "bare.json"), theta)
    assert cover.proved(int(part))

    def without(arrays):
        middle = 0.5 * (arrays["uncovered_lower"] + arrays["uncovered_upper"])
        gap = np.abs(np.remainder(theta - middle + np.pi, 2.0 * np.pi) - np.pi)
        kept = np.any(gap > 0.5 * (arrays["uncovered_upper"] - arrays["uncovered_lower"]), axis=1)
        assert not kept.all()
        for end in ("lower", "upper"):
            arrays[f"uncovered_{end}"] = arrays[f"uncovered_{end}"][kept]

    cover, (part,) = parts_on(reading.read(changed(tmp_path / "bare.json", tmp_path, without)), theta)
    assert not cover.proved(int(part))


def test_other_closures_are_found(region, tmp_path):
    """Links a fifth longer: the fingerprint tells; where that is brought up to date too no tube is proved."""
    _, path = region

    def longer(arrays):
        arrays["chain0_tip"] = arrays["chain0_tip"] * 1.2

    with pytest.raises(InvalidInputError, match="fingerprint"):
        verify(changed(path, tmp_path, longer, stamp=False))
    audit = verify(changed(path, tmp_path, longer), sample=3)
    assert len(claim(audit, "one singular curve").failed) == 3


@pytest.mark.parametrize("name", ["curve_tubes", "tube_radius", "tube_half", "range_lower"])
def test_documents_out_of_shape_are_refused(region, tmp_path, name):
    """Arrays that are not as long as others."""

    def shorter(arrays):
        arrays[name] = arrays[name][1:]

    with pytest.raises(InvalidInputError, match=f"{name.split('_')[0]}.*: the shape is"):
        verify(changed(region[1], tmp_path, shorter))


@pytest.mark.slow
def test_workers_say_the_same(region):
    """Two processes find what one does."""
    assert verify(region[1], sample=2, workers=2).claims == verify(region[1], sample=2).claims


def rpdr_singular(rng, count):
    """θ = (q1, q3, q2, q4) of singular closed configurations of the RPDR by closed forms: folds and both self-motions.

    Link 3 and link 4 are parallel: they reach twice their length from elbow to elbow, or both elbows coincide.
    """
    q1 = rng.uniform(-np.pi, np.pi, 40 * count)
    base = rpdr.C - rpdr.A1 * np.exp(1j * q1)
    cosine = ((2.0 * rpdr.A3) ** 2 - np.abs(base) ** 2 - rpdr.A2**2) / (2.0 * rpdr.A2 * np.abs(base))
    reach = np.flatnonzero(np.abs(cosine) < 1.0)[:count]
    q1, base = q1[reach], base[reach]
    q2 = np.angle(base) + rng.choice([-1.0, 1.0], len(reach)) * np.arccos(cosine[reach])
    towards = np.angle(base + rpdr.A2 * np.exp(1j * q2))
    fold = np.stack([q1, towards - q1, q2, towards + np.pi - q2], axis=1)
    side, turn = rng.choice([-1.0, 1.0], count), rng.uniform(-np.pi, np.pi, count)
    q1 = side * np.arccos(0.5 * rpdr.C / rpdr.A1)
    q2 = side * np.pi - q1
    theta = np.concatenate([fold, np.stack([q1, turn - q1, q2, turn - q2], axis=1)])
    return np.angle(np.exp(1j * theta))


def boxes_with(rng, theta, wide):
    """A box with unequal edges about each configuration, which is anywhere in it."""
    for t in theta:
        half = wide * np.exp(rng.uniform(-3.0, 0.0, len(t)))
        middle = t + 0.99 * rng.uniform(-half, half)
        yield t, CornerBox(middle - half, middle + half)


@pytest.mark.parametrize("wide", later(1e-4, 0.3, 0.1, 0.01))
def test_no_singular_configuration_is_lost(region, wide):
    """Those of closed forms stay in what Lemmas A, B and C leave of boxes that hold them, whatever l is."""
    read, rng = reading.read(region[1]), np.random.default_rng(7)
    own = closures.BallClosures(read)
    cover = exclusion.Exclusion(own, read)
    cover.tubes, cover._lengths = [], np.zeros(0)  # that nothing is settled in a tube
    cover._middles = np.zeros((0, 4))
    theta = rpdr_singular(rng, 30)
    smaller = 0
    for t, box in boxes_with(rng, theta, wide):
        phi, slope = own.at(t)
        assert np.abs(phi).max() < 1e-9
        assert abs(np.linalg.det(slope[:, read.dependent])) < 1e-9
        pairing = np.linalg.svd(slope[:, read.dependent])[2][-1] + rng.uniform(-0.4, 0.4, 2)
        system = singular_curves.Singular(own, read.dependent, pairing)
        for left in (cover._left_of(box), slanted.cut_down(box, system, None, cover.turning)):
            assert left is not None
            assert np.all((t >= left.low) & (t <= left.high))
            smaller += left.half.sum() < 0.8 * box.half.sum()
    assert smaller > 10  # that the lemmas do cut


def test_rows_known_modulo_something_lose_nothing(region, tmp_path):
    """The RPDR with 60 q3 = 0 modulo 2π for its first row: link 4 upright is singular, at any sixtieth of a turn."""

    def modulo(arrays):
        arrays["system_moduli"][0], arrays["system_couplings"][0, 1] = 2.0 * np.pi, 60.0
        arrays["system_periodic"][1] = False
        for name in ("chain0_weights", "chain1_weights"):
            arrays[name][0] = 0.0

    read, rng = reading.read(changed(region[1], tmp_path, modulo)), np.random.default_rng(10)
    own = closures.BallClosures(read)
    cover = exclusion.Exclusion(own, read)
    cover.tubes, cover._lengths, cover._middles = [], np.zeros(0), np.zeros((0, 4))
    q1, q3 = rng.uniform(-np.pi, np.pi, 200), np.pi / 30.0 * rng.integers(-29, 30, 200)
    up = rng.choice([-1.0, 1.0], 200)
    sine = (rpdr.A1 * np.sin(q1) + rpdr.A3 * np.sin(q1 + q3) - rpdr.A4 * up) / rpdr.A2
    theta = np.stack([q1, q3, np.arcsin(np.clip(sine, -1.0, 1.0)), np.zeros(200)], axis=1)
    theta[:, 3] = 0.5 * np.pi * up - theta[:, 2]
    for wide in (0.6, 0.1):
        for t, box in boxes_with(rng, theta[np.abs(sine) < 0.99], wide):
            phi, slope = own.at(t)
            assert np.abs(phi).max() < 1e-9
            assert abs(np.linalg.det(slope[:, read.dependent])) < 1e-9
            left = cover._left_of(box)
            assert left is not None
            assert np.all((t >= left.low) & (t <= left.high))


class Shifted(singular_curves.Singular):
    """G less its value at some x, which is a zero then."""

    def __init__(self, closures, dependent, pairing, x):
        super().__init__(closures, dependent, pairing)
        self.level = super().value(x, self.motions(x))

    def value(self, x, moved):
        return super().value(x, moved) - self.level


def test_slanted_boxes_keep_their_zeros(case):
    """Lemma C about zeros put at corners of slanted boxes, where each of its terms is as large as it may be."""
    read, rng, smaller = reading.read(case[1]), np.random.default_rng(11), 0
    own = closures.BallClosures(read)
    for _ in range(60):
        pairing, x = rng.normal(size=own.m), rng.normal(size=own.n_free + own.m)
        along, tangent = int(rng.integers(own.n_free)), rng.normal(size=len(x))
        half, radius = rng.uniform(0.02, 0.3), rng.uniform(0.01, 0.1, len(x))
        tangent[along], radius[along] = 1.0, 0.0
        corner = x + half * rng.choice([-1.0, 1.0]) * tangent + rng.choice([-1.0, 1.0], len(x)) * radius
        zero = [closures.arb(v) for v in corner.tolist()]
        system = Shifted(own, read.dependent, pairing, zero)
        wide = radius * (1.0 + 1e-9)
        box = slanted.SlantedBox(
            [closures.arb(v) for v in x.tolist()], along, tangent, half * (1.0 + 1e-9), -wide, wide
        )
        P = closures.exact(np.linalg.inv(np.delete(system.at(x)[1], along, axis=1)))
        for _ in range(3):
            left = slanted._narrowed(system, box, P, box.balls())
            assert left is not None
            s = zero[along] - left.centre[along]
            off = [float((z - c - s * float(t)).mid()) for z, c, t in zip(zero, left.centre, tangent, strict=True)]
            assert np.all((left.low - 1e-12 <= off) & (off <= left.high + 1e-12))
            smaller += np.any(left.high - left.low < 0.8 * (box.high - box.low))
            box = left
    assert smaller > 5


def test_boxes_off_curves_are_empty(region):
    """Lemma C does tell: boxes a little off the closed forms' curves hold none."""
    read, rng = reading.read(region[1]), np.random.default_rng(8)
    own, empty = closures.BallClosures(read), 0
    theta = rpdr_singular(rng, 30)
    for t in theta:
        slope = own.at(t)[1]
        system = singular_curves.Singular(own, read.dependent, np.linalg.svd(slope[:, read.dependent])[2][-1])
        way = np.linalg.svd(slope)[2][2:].T @ rng.normal(size=2)  # along {φ = 0}
        middle = t + 0.02 * way / np.linalg.norm(way)
        empty += (
            slanted.cut_down(CornerBox(middle - 2e-3, middle + 2e-3), system, None, [True] * 4 + [False] * 2) is None
        )
    assert empty > len(theta) // 2


@pytest.fixture(scope="module")
def torus(tmp_path_factory):
    """The file of a cover of the RPDR's whole torus."""
    path = tmp_path_factory.mktemp("torus") / "torus.json"
    domain.certify_singularities(ccpin.load("rpdr")).save(path)
    return path


HARD = (38, 112, 143, 217)  # crossed by a self-motion or the fold: boxes parallel to the axes are many about these
BESIDE = (39, 216)  # hard ones beside a self-motion, that no curve crosses


@pytest.mark.slow
@pytest.mark.parametrize("what", ["missing", "moved", "narrow", "short"])
def test_wrong_tubes_in_hard_parts_are_found(torus, tmp_path, what):
    """In each hard part four neighbouring tubes left out, off the curve, too short or too narrow: it is not proved.

    A self-motion is straight in x-space, so that a narrow tube about it is right: narrow ones are those of the fold.
    """
    read = reading.read(torus)
    theta = np.array([tube.theta for tube in read.tubes])
    for part in HARD[1:3] if what == "narrow" else HARD:
        box = exclusion.parts(closures.BallClosures(read), read)[part]
        turned = np.angle(np.exp(1j * theta))
        inside = np.flatnonzero(np.all((turned >= box.low + 0.03) & (turned <= box.high - 0.03), axis=1))
        assert inside.size > 4
        wrong = inside[inside.size // 2 - 1] + np.arange(4)

        def damage(arrays, wrong=wrong):
            if what == "missing":
                ends = np.cumsum(arrays["curve_tubes"])
                arrays["curve_tubes"][np.searchsorted(ends, wrong[0], side="right")] -= len(wrong)
                rows(arrays, np.delete(np.arange(len(theta)), wrong))
            elif what == "moved":
                arrays["tube_theta"][wrong, 0] += 0.1
            else:
                arrays["tube_radius" if what == "narrow" else "tube_half"][wrong] *= 1e-7

        damaged = reading.read(changed(torus, tmp_path, damage))
        assert not exclusion.Exclusion(closures.BallClosures(damaged), damaged).proved(part)


@pytest.mark.slow
def test_parts_with_singular_configurations_are_not_proved_without_tubes(torus, tmp_path):
    """The hard parts, and some others that hold configurations of the closed forms, with all curves hidden.

    Those beside them, which hold none, need no curves to be proved.
    """

    def hidden(arrays):
        rows(arrays, np.zeros(0, dtype=np.int64))
        arrays["curve_tubes"], arrays["curve_closed"] = (arrays[f"curve_{n}"][:0] for n in ("tubes", "closed"))

    rng = np.random.default_rng(9)
    cover, crossed = parts_on(reading.read(changed(torus, tmp_path, hidden)), rpdr_singular(rng, 400))
    assert set(HARD) <= set(crossed.tolist())
    assert not {*BESIDE} & {*crossed.tolist()}
    for part in {*HARD, *rng.choice(crossed, 6, replace=False).tolist()}:
        assert not cover.proved(part)
    assert all(cover.proved(part) for part in BESIDE)


@pytest.mark.slow
def test_the_whole_torus_of_the_rpdr(torus):
    """Every tube, every gluing and every part of the region."""
    audit = verify(torus, workers=2)
    assert audit.holds, str(audit)
    assert audit.whole
