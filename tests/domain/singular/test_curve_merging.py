"""Covers of parts merged: of every singular configuration the whole's claim holds, and one curve is listed once."""

import json

import numpy as np
import pytest

from ccpin import domain
from ccpin.arrays import apply
from ccpin.cli import main
from ccpin.covering.region import Region
from ccpin.domain import merge, split_region
from ccpin.domain.singular import joining
from ccpin.domain.singular.following import TubeChain
from ccpin.domain.singular.joining import _around, _Piece, held, one_of_each, without_held
from ccpin.domain.singular.merged import filled
from ccpin.errors import InvalidInputError
from ccpin.proof.curves.curve_equations import first_order
from ccpin.proof.curves.tubes import Points, places_in, zeros_in
from tests.oracles import rpdr as paper
from tests.support.five_bars import in_tree_order, load_five_bar, random_five_bar
from tests.support.legs import load_slice
from tests.support.long_cases import later
from tests.support.singular_samples import CROSSING, RPDR, SLICE, missed, of_five_bar, of_slice, within

TORUS = np.full(2, -np.pi), np.full(2, np.pi)
FOLD = np.deg2rad([[100.0, 35.0], [140.0, 75.0]])  # of the RPDR: a piece of its fold, across both middles
ISOLATED = np.array([[0.98, 2.13], [1.0, 2.16]])  # with the isolated point


def parts_of(mechanism, regions, **effort):
    """Covers of regions."""
    return [domain.certify_singularities(mechanism, region, **effort) for region in regions]


def told(cover):
    """What curves there are."""
    return [(curve.kind, curve.closed) for curve in cover.curves]


@pytest.fixture(scope="module")
def quarters(rpdr):
    """The fold's region in four."""
    return parts_of(rpdr, split_region(FOLD, 4))


@pytest.fixture(scope="module")
def merged(quarters):
    """And whole again."""
    return merge(quarters)


@pytest.mark.slow
def test_a_curve_across_seams_is_one(rpdr, quarters, merged):
    """Its pieces, in the quarters that the closed form has it in, are one chain, and all of these are on it."""
    q_free = of_five_bar(rpdr, RPDR, 40_000, 1, FOLD)
    crossed = [np.any(within(q_free[:, [0, 2]], (part.region.lower, part.region.upper))) for part in quarters]
    assert sum(crossed) == 3
    assert [bool(part.curves) for part in quarters] == crossed
    assert told(merged) == told(domain.certify_singularities(rpdr, FOLD)) == [("fold", False)]
    assert (merged.verdict, merged.complete) == ("proven", True)
    assert merged.verify()
    assert merged.tried == sum(part.tried for part in quarters)
    assert np.allclose([merged.region.lower, merged.region.upper], FOLD, atol=1e-15)
    assert len(q_free) > 1000
    assert np.all(merged.curve_of(q_free) == 0)


@pytest.mark.parametrize("samples", later(10_000, 40_000))
def test_each_part_was_needed(rpdr, quarters, merged, samples):
    """The merged curve holds more than any part's, and what a part held it holds."""
    q_free = of_five_bar(rpdr, RPDR, samples, 2, FOLD)
    on = np.array([part.curve_of(q_free) >= 0 for part in quarters])
    assert on.any(axis=0).all()
    assert not on.all(axis=1).any()
    for part in quarters:
        for curve in part.curves:
            for share in (-0.95, -0.3, 0.8):
                at = zeros_in(part.problem, curve.tubes, share * curve.tubes.half)
                assert np.all(merged.curve_of(at.x[:, :4]) == 0)


@pytest.mark.parametrize("order", later([2, 3, 1, 0], [0, 1, 2, 3]))
@pytest.mark.parametrize("suffix", later("json", "npz"))
def test_what_is_merged_is_saved_and_merged_again(quarters, merged, tmp_path, suffix, order):
    """Bit for bit; halves of halves, in any order, are one curve too."""
    merged.save(tmp_path / f"whole.{suffix}")
    loaded = domain.SingularCover.load(tmp_path / f"whole.{suffix}")
    assert loaded.verify()
    assert loaded.reason.startswith(merged.reason)
    for one, other in zip(merged.curves, loaded.curves, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one.tubes, other.tubes, strict=True))
    halves = [merge([quarters[k] for k in pair]) for pair in (order[:2], order[2:])]
    whole = merge(halves)
    assert told(whole) == [("fold", False)]
    assert whole.verify()


@pytest.mark.slow
def test_overlapping_parts_list_a_curve_once(rpdr):
    """Three regions that overlap in pairs, the same twice, and a curve that closes in a place that two of them hold."""
    regions = [(FOLD[0], [2.15, FOLD[1][1]]), ([2.05, FOLD[0][1]], FOLD[1]), ([2.0, FOLD[0][1]], [2.3, FOLD[1][1]])]
    overlapping = merge([*parts_of(rpdr, regions), domain.certify_singularities(rpdr, regions[0])])
    assert told(overlapping) == [("fold", False)]
    assert overlapping.verify()
    assert missed(overlapping, of_five_bar(rpdr, RPDR, 20_000, 3, FOLD)) == 0
    x = paper.coincident_elbows()[0]
    halves = parts_of(rpdr, [(ISOLATED[0], [x, ISOLATED[1][1]]), ([x, ISOLATED[0][1]], ISOLATED[1])])
    assert [told(half) for half in halves] == 2 * [[("self-motion", True)]]
    seam = merge(halves)
    assert told(seam) == [("self-motion", True)]
    assert missed(seam, of_five_bar(rpdr, RPDR, 20_000, 4, ISOLATED)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4])
def test_curves_with_cusps_are_joined(count):
    """The 3-RPR over a cusp: a curve that goes on in six dimensions."""
    parts = parts_of(load_slice(), split_region(SLICE, count))
    assert sum(len(part.curves) for part in parts) > count - 1
    whole = merge(parts)
    assert told(whole) == [("fold", False)]
    assert whole.verify()
    q_free = of_slice(10_000, 4, SLICE)
    assert len(q_free) > 300
    assert missed(whole, q_free) == 0


@pytest.mark.slow
def test_listed_boxes_of_all_parts_are_listed():
    """Where a fold crosses itself on the seam both parts list boxes; so does the whole, and nothing is missed."""
    mechanism, region = load_five_bar(CROSSING), np.array([[-0.2, -0.2], [0.2, 0.2]])
    parts = parts_of(mechanism, split_region(region, 2), resolution=0.02)
    whole = merge(parts)
    assert whole.verdict == "undecided"
    assert len(whole.uncovered.lower)
    assert np.abs(whole.uncovered.upper - whole.uncovered.lower).max() < 0.05
    assert whole.is_uncovered(in_tree_order(mechanism, [[0.0, 0.0, 0.0, np.pi]]))[0]
    assert len(whole.curves) == 4
    assert missed(whole, of_five_bar(mechanism, CROSSING, 40_000, 5, region)) == 0


@pytest.mark.slow
def test_an_interrupted_part_leaves_the_whole_undecided(rpdr):
    """With the reason; `continued` decides the rest."""
    left, right = split_region(FOLD, 2)
    early, other = domain.certify_singularities(rpdr, left, budget=50), domain.certify_singularities(rpdr, right)
    whole = merge([other, early])
    assert (whole.limit, whole.verdict) == ("budget", "undecided")
    assert "budget=" in whole.reason
    q_free = of_five_bar(rpdr, RPDR, 20_000, 6, FOLD)
    assert missed(whole, q_free) == 0
    assert np.any(whole.curve_of(q_free) < 0)
    ended = domain.certify_singularities(rpdr, left, seconds=1e-9)
    stopped = merge([early, ended, other])
    assert (stopped.limit, stopped.complete) == ("interrupted", False)
    done = whole.continued()
    assert (done.verdict, told(done)) == ("proven", [("fold", False)])
    assert np.all(done.curve_of(q_free) == 0)


def test_what_does_not_belong_together_is_refused(rpdr, quarters):
    """A region missing, another mechanism, other limits of slides, an atlas among covers, nothing at all."""
    turned, q = load_slice(independent=["swing1", "turn"]), np.zeros(2)
    leg = domain.certify_singularities(turned, (q, q + 0.1), budget=10)
    narrower = leg.ranges._replace(limits=np.tile([-9.0, 9.0], (len(leg.ranges.limits), 1)))
    sliding = domain.SingularCover(**{**vars(leg), "ranges": narrower})
    atlas = domain.certify(rpdr, np.radians((-108.0, -72.0)), max_depth=0)
    missing = r"from \[1\.745\d*, 0\.959\d*\] to \[2\.094\d*, 1\.308\d*\]"  # 100° to 120°, 55° to 75°
    other = domain.certify_singularities(load_five_bar(RPDR), FOLD, budget=10)
    cases = {
        f"no part covers the region {missing}": [quarters[k] for k in (0, 1, 3)],
        "part 2 is about other closures": [quarters[0], other],
        "part 2 was searched within other limits": [leg, sliding],
        r"parts\[1\] must be a SingularCover": [quarters[0], atlas],
        r"parts\[1\] must be an Atlas": [atlas, quarters[0]],
        "nothing to merge": [],
    }
    for message, parts in cases.items():
        with pytest.raises(InvalidInputError, match=message):
            merge(parts)
    with pytest.raises(InvalidInputError, match="not int"):
        merge(3)
    assert merge([leg, leg]).limit == "budget"


def regions_of(corners, wrapped=(False, False)):
    """Regions with corners."""
    return [Region(np.array(low, float), np.array(high, float), np.array(wrapped)) for low, high in corners]


def test_regions_fill_a_box_or_what_is_missing_is_told(merged):
    """Random cuts of a box fill it, in any order; with one left out the corners told lie in that one."""
    rng, problem, checked = np.random.default_rng(7), merged.problem, 0
    for _ in range(30):
        corners = [(np.array([-1.0, -2.0]), np.array([1.5, 0.5]))]
        for _ in range(8):
            low, high = corners.pop(int(rng.integers(len(corners))))
            axis, share = int(rng.integers(2)), rng.uniform(0.1, 0.9)
            middle = low[axis] + share * (high[axis] - low[axis])
            below, above = high.copy(), low.copy()
            below[axis] = above[axis] = middle
            corners += [(low, below), (above, high)]
        rng.shuffle(corners)
        whole = filled(problem, regions_of(corners))
        assert np.array_equal([whole.lower, whole.upper], [[-1.0, -2.0], [1.5, 0.5]])
        lower, upper = corners[0]
        rest = regions_of(corners[1:])
        bounds = np.min([part.lower for part in rest], axis=0), np.max([part.upper for part in rest], axis=0)
        if not np.array_equal(bounds, [[-1.0, -2.0], [1.5, 0.5]]):
            continue
        checked += 1
        with pytest.raises(InvalidInputError, match="no part covers") as error:
            filled(problem, rest)
        told_at = json.loads("[" + str(error.value).split("from ")[1].replace(" to ", ",") + "]")
        assert np.allclose(told_at, [lower, upper])
    assert checked > 10


def test_turns_of_regions_are_full_turns(merged):
    """Halves of a turn close on themselves, also when they overlap beyond both ends; a gap of a thousandth is told."""
    pi, problem = np.pi, merged.problem
    halves = [([-pi, 0.0], [0.0, 1.0]), ([0.0, 0.0], [pi, 1.0])]
    assert filled(problem, regions_of(halves)).wrapped.tolist() == [True, False]
    wide = [([-pi - 0.2, 0.0], [0.1, 1.0]), ([0.0, 0.0], [pi, 1.0])]
    assert filled(problem, regions_of(wide)).width[0] == pytest.approx(2.0 * pi)
    apart = [([-pi, 0.0], [0.0, 1.0]), ([2.0 * pi, 0.0], [3.0 * pi, 1.0])]
    assert filled(problem, regions_of(apart)).wrapped.tolist() == [True, False]
    short = [([-pi, 0.0], [0.0, 1.0]), ([0.0, 0.0], [pi - 1e-3, 1.0])]
    assert filled(problem, regions_of(short)).wrapped.tolist() == [False, False]
    beyond = [([-pi, 0.0], [0.0, 1.0]), ([1e-3, 0.0], [pi, 1.0])]
    with pytest.raises(InvalidInputError, match=r"from \[0\.0, 0\.0\] to \[0\.000?9?"):
        filled(problem, regions_of(beyond))


@pytest.fixture
def ring(rpdr_curves):
    """The isolated point's closed curve, and the piece of the fold."""
    chains = {curve.kind: TubeChain(curve.tubes, curve.closed) for curve in rpdr_curves.curves}
    return rpdr_curves.problem, chains["self-motion"], chains["fold"]


def pieces(ring, ends, turned):
    """Stretches of a ring's tubes as open chains, some the other way."""
    size, found = len(ring.tubes.half), []
    for (start, stop), way in zip(ends, turned, strict=True):
        tubes = ring.tubes.take(np.arange(start, stop) % size)
        found.append(TubeChain(tubes.take(np.arange(len(tubes.half))[::-1]).turned() if way else tubes, False))
    return found


@pytest.mark.slow
def test_pieces_of_a_ring_are_a_ring(ring):
    """Three stretches that overlap, some of them the other way, with the fold beside: one ring, one open curve."""
    problem, whole, fold = ring
    size = len(whole.tubes.half)
    ends = [(0, 100), (97, 180), (176, size + 4)]
    for turned in ((False, False, False), (False, True, False), (True, False, True)):
        found = one_of_each(problem, [*pieces(whole, ends, turned), fold])
        assert sorted(chain.closed for chain in found) == [False, True]
        assert held(problem, whole.tubes, next(chain.tubes for chain in found if chain.closed)).all()


def test_what_is_not_proved_stays_apart(ring, monkeypatch):
    """A ring that lacks three tubes is not closed, nor are pieces joined whose ends nothing is shown to hold."""
    problem, whole, fold = ring
    size = len(whole.tubes.half)
    ends = [(0, 100), (97, 180), (176, size - 3)]
    found = one_of_each(problem, [*pieces(whole, ends, (False, True, False)), fold])
    assert [chain.closed for chain in found] == [False, False]
    assert sorted(len(chain.tubes.half) for chain in found) == sorted([len(fold.tubes.half), size - 3])
    apart = pieces(whole, [(0, 100), (103, size - 3)], (False, False))
    assert len(one_of_each(problem, apart)) == 2
    monkeypatch.setattr(joining, "held", lambda problem, tubes, others: np.zeros(len(tubes.half), dtype=bool))
    given = pieces(whole, [(0, 100), (95, 180)], (False, False))
    kept = one_of_each(problem, given)
    assert [chain.tubes for chain in kept] == [chain.tubes for chain in given]


def test_a_curve_that_another_holds_is_left_out(ring):
    """An arc of a ring, and of a longer arc; a ring found twice once; never what reaches farther, or another curve."""
    problem, whole, fold = ring
    arc, longer, beyond = pieces(whole, [(10, 60), (5, 80), (70, 100)], (True, False, False))
    assert [len(chain.tubes.half) for chain in without_held(problem, [arc, longer])] == [75]
    assert len(without_held(problem, [longer, beyond])) == 2
    turned = pieces(whole, [(7, 7 + len(whole.tubes.half))], (True,))[0]._replace(closed=True)
    found = without_held(problem, [whole, fold, arc, turned])
    assert sorted(chain.closed for chain in found) == [False, True]


@pytest.fixture(scope="module")
def cusped():
    """The curve of the 3-RPR through a cusp."""
    found = domain.certify_singularities(load_slice(), SLICE)
    return found.problem, found.curves[0].tubes


def on_the_curve(problem, tubes, s):
    """x at parameters of tubes, by many steps of Newton's method with the tubes' gain."""
    x, size = zeros_in(problem, tubes, s).x, problem.system.n_free
    for _ in range(60):
        step = apply(tubes.gain, first_order(problem, x[:, :size], x[:, size:], tubes.pairing)[0])
        x = x - step
        if np.abs(step).max() < 1e-15:
            break
    return x


@pytest.mark.parametrize("share", [1.0, 0.3, 1e-3])
@pytest.mark.parametrize("name", later("rpdr", "3-RPR"))
def test_boxes_about_pieces_hold_the_curve(ring, name, share, request):
    """Lemma J's boxes against the curve at random parameters of each piece; those about short ones hold little else."""
    problem, tubes = (ring[0], ring[2].tubes) if name == "rpdr" else request.getfixturevalue("cusped")
    rng, half = np.random.default_rng(9), share * tubes.half
    s = rng.uniform(-1.0, 1.0, len(half)) * (tubes.half - half)
    box = _around(problem, tubes, _Piece(s, half), zeros_in(problem, tubes, s))
    moves = (-1.0, 1.0, *rng.uniform(-1.0, 1.0, 20))
    off = np.array([np.abs(on_the_curve(problem, tubes, s + move * half) - box.x) for move in moves])
    assert np.all(off <= box.error + 1e-12)
    assert share > 0.1 or np.all(box.error <= 1.2 * off.max(axis=0) + 0.01 * half[:, None])


@pytest.mark.slow
def test_arcs_said_to_be_held_are_held(rpdr, ring):
    """Lemma J, of one ring in tubes followed from another start: all is held, but where three tubes are left out.

    There what is said to be held has points of its arcs at random parameters in the tubes that are left.
    """
    problem, whole, fold = ring
    (again,) = (c.tubes for c in domain.certify_singularities(rpdr, ISOLATED).curves if c.closed)
    assert np.abs(again.theta[:1] - whole.tubes.theta).max(axis=1).min() > 1e-4
    assert held(problem, whole.tubes, again).all()
    assert held(problem, again, whole.tubes).all()
    assert not held(problem, fold.tubes, whole.tubes).any()
    left, rng = again.take(np.delete(np.arange(len(again.half)), [100, 101, 102])), np.random.default_rng(8)
    said, inside = held(problem, whole.tubes, left), np.ones(len(whole.tubes.half), dtype=bool)
    for _ in range(20):
        at = zeros_in(problem, whole.tubes, rng.uniform(-1.0, 1.0, len(said)) * whole.tubes.half)
        for k in range(len(said)):
            point = Points(*(np.repeat(array[k : k + 1], len(left.half), axis=0) for array in at))
            inside[k] &= bool(places_in(problem, point, left).inside.any())
    assert 2 <= np.sum(~inside) <= 6
    assert np.array_equal(said, inside)


@pytest.mark.slow
def test_the_command(tmp_path, capsys):
    """Parts saved by `ccpin domain --curves`, merged and verified; what cannot be merged said in words."""
    pytest.importorskip("flint")
    names = [str(tmp_path / name) for name in ("left.npz", "right.json", "both.json")]
    for name, (lower, upper) in zip(names, split_region(np.degrees(FOLD), 2), strict=False):
        corners = ["--lower-deg", *map(repr, map(float, lower)), "--upper-deg", *map(repr, map(float, upper))]
        chunks = ["--checkpoint", str(tmp_path / "chunks")]
        assert main(["domain", "rpdr", "--curves", *corners, *chunks, "--save", name]) == 0
    assert list((tmp_path / "chunks").glob("*.chunk"))
    capsys.readouterr()
    assert main(["merge", *names[:2], "-o", names[2], "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["verdict"], facts["uncovered"], facts["complete"]) == ("proven", 0, True)
    assert [(curve["kind"], curve["closed"]) for curve in facts["curves"]] == [("fold", False)]
    assert main(["verify", names[2], "--model", "rpdr", "--sample", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["model"]
    assert main(["merge", *names[:2], "--out", names[2]]) == 0
    assert "curve 0: fold, open" in capsys.readouterr().out
    assert main(["merge", names[0], names[0], "--out", names[2]]) == 0
    atlas = str(tmp_path / "atlas.npz")
    assert main(["domain", "rpdr", "--centre-deg", "-108", "-72", "--depth", "1", "--atlas", "--save", atlas]) == 4
    assert main(["merge", names[0], atlas, "--out", names[2]]) == 1
    assert "must be a SingularCover, not Atlas" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4, 16])
def test_the_whole_torus_of_the_rpdr_in_parts(rpdr, count, tmp_path):
    """Its fold closed, two self-motions closed, as undivided; none of 100,000 is missed; tubes are proved anew."""
    whole = merge(parts_of(rpdr, split_region(TORUS, count)))
    assert whole.verdict == "proven"
    assert np.all(whole.region.wrapped)
    assert told(whole) == told(domain.certify_singularities(rpdr)) == [("fold", True)] + 2 * [("self-motion", True)]
    assert whole.verify()
    assert missed(whole, of_five_bar(rpdr, RPDR, 100_000, 7)) == 0
    auditing = pytest.importorskip("ccpin.auditing", reason="python-flint")
    pytest.importorskip("flint")
    whole.save(tmp_path / "whole.npz")
    audit = auditing.verify(tmp_path / "whole.npz", sample=20)
    assert [len(claim.failed) for claim in audit.claims[:2]] == [0, 0]
    assert len(audit.claims[2].failed) <= 1, str(audit)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_random_five_bars_in_parts(seed):
    """Over the torus in four: as many closed curves as undivided, and none of 20,000 configurations is missed."""
    bar = random_five_bar(np.random.default_rng(seed))
    mechanism = load_five_bar(bar)
    whole, undivided = merge(parts_of(mechanism, split_region(TORUS, 4))), domain.certify_singularities(mechanism)
    assert told(whole) == told(undivided)
    assert all(curve.closed for curve in whole.curves)
    assert whole.verify()
    assert missed(whole, of_five_bar(mechanism, bar, 20_000, 200 + seed)) == 0
