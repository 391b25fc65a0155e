"""Atlases of parts merged: what the whole's atlas says, and nothing that the parts do not prove."""

import json

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.cli import main
from ccpin.covering.cells import CellStatus
from ccpin.domain import Atlas, certified_radius, certify, merge, split_region
from ccpin.domain.atlas.merged import _between
from ccpin.errors import InvalidInputError
from tests.oracles import rpdr as oracle
from tests.support.long_cases import later

TORUS = np.full(2, -np.pi), np.full(2, np.pi)
SEED = np.radians((-108.0, -72.0))
BOX = np.array([[-2.4, -1.8], [-1.4, -0.8]])


def parts_of(mechanism, whole, count, depth):
    """Atlases over the parts of a whole atlas's region, each from a seed of its own on that branch."""
    rng, made = np.random.default_rng(0), []
    for lower, upper in split_region((whole.region.lower, whole.region.upper), count):
        q = rng.uniform(lower, upper, (500, len(lower)))
        q = q[np.argmax(certified_radius(whole, q))]
        made.append(certify(mechanism, q, (lower, upper), whole.sigma(q), max_depth=depth))
    return made


@pytest.fixture(scope="module")
def torus(rpdr):
    """The RPDR's branch, whole."""
    return certify(rpdr, SEED, TORUS, max_depth=7)


@pytest.fixture(scope="module")
def quarters(rpdr, torus):
    """And in four."""
    return parts_of(rpdr, torus, 4, 6)


@pytest.mark.parametrize("points", later(4000, 20_000))
def test_four_quarters_are_the_branch(torus, quarters, points):
    """The merged atlas closes on itself, and says of points, σ and shares what the whole one says."""
    merged = merge(quarters)
    assert np.all(merged.region.wrapped)
    assert merged.single_valued
    assert merged.complete
    assert np.all(merged.verify())
    q = np.random.default_rng(1).uniform(*TORUS, (points, 2))
    inside, whole = merged.contains(q), torus.contains(q)
    open_cells = [1.0 - a.certified_fraction - a.empty_fraction for a in (merged, torus)]
    assert np.mean(inside != whole) < max(open_cells)
    shared = q[inside & whole]
    assert np.abs(np.exp(1j * merged.sigma(shared)) - np.exp(1j * torus.sigma(shared))).max() < 1e-10
    reach = np.hypot(*oracle.elbow_offset(q.T)) / (oracle.A3 + oracle.A4)
    assert np.all(reach[inside] < 1.0)
    assert np.all(reach[merged.status(q) == CellStatus.EMPTY] > 1.0)
    for status in (CellStatus.CERTIFIED, CellStatus.EMPTY, CellStatus.SINGULAR):
        assert merged.fraction(status) == pytest.approx(torus.fraction(status), abs=3e-3)


def test_every_face_between_parts_is_glued_or_listed(quarters):
    """By corners: of each pair of boxes of different parts that touch there is a contact, across the seam too."""
    merged = merge(quarters)
    owner = np.repeat(np.arange(4), [len(part.boxes.kappa) for part in quarters])
    contacts = _between(merged.tree, merged.region, owner)
    found = {tuple(sorted(pair)) for pair in zip(*(merged.tree.box[c] for c in contacts[:2]), strict=True)}
    rng, expected = np.random.default_rng(2), set()
    for a in rng.choice(len(owner), 300, replace=False):
        gap = np.full(len(owner), np.inf)
        for turn in np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)]) * 2 * np.pi:
            low, high = (
                np.maximum(merged.lower[a] + turn, merged.lower),
                np.minimum(merged.upper[a] + turn, merged.upper),
            )
            touch = (np.sum(np.abs(high - low) < 1e-9, axis=1) == 1) & np.all(high - low > -1e-9, axis=1)
            gap[touch] = 0.0
        expected |= {tuple(sorted((int(a), int(b)))) for b in np.flatnonzero((gap == 0.0) & (owner != owner[a]))}
    assert expected
    assert expected <= found


def test_the_radius_is_that_about_the_first_seed(rpdr):
    """Two halves about one seed: the square that each alone has to end at the cut goes on beyond it."""
    whole = certify(rpdr, SEED, BOX, max_depth=6)
    left, right = split_region(BOX, 2)
    other = np.mean(left, axis=0)
    halves = [certify(rpdr, SEED, right, max_depth=6), certify(rpdr, other, left, whole.sigma(other), max_depth=6)]
    assert halves[0].radius <= SEED[0] - right[0][0] < whole.radius
    merged = merge(halves)
    assert halves[0].radius < 0.9 * merged.radius < merged.radius <= whole.radius * (1.0 + 1e-9)
    assert np.array_equal(merged.q0, SEED)
    assert merged.certified_fraction == pytest.approx(whole.certified_fraction, abs=5e-3)


@pytest.mark.slow
def test_it_is_saved_audited_and_merged_again(quarters, tmp_path):
    """Halves of halves; the auditor proves boxes, the faces between parts, and that all are reached from one seed."""
    auditing = pytest.importorskip("ccpin.auditing", reason="python-flint")
    pytest.importorskip("flint")
    merged = merge([merge(quarters[:2]), merge(quarters[2:])])
    direct = merge(quarters)
    assert merged.certified_fraction == direct.certified_fraction
    merged.save(tmp_path / "merged.npz")
    assert np.array_equal(Atlas.load(tmp_path / "merged.npz").boxes.centre, merged.boxes.centre)
    audit = auditing.verify(tmp_path / "merged.npz", sample=40)
    assert audit.holds, str(audit)


def test_a_spatial_mechanism_in_two(tmp_path):
    """Half a Delta each."""
    delta = ccpin.load("delta")
    region = np.full(3, -0.2), np.full(3, 0.2)
    whole = certify(delta, np.zeros(3), region, max_depth=2)
    merged = merge(parts_of(delta, whole, 2, 2))
    q = np.random.default_rng(3).uniform(*region, (500, 3))
    assert np.array_equal(merged.contains(q), whole.contains(q))
    assert merged.single_valued


def test_another_assembly_mode_is_refused(rpdr):
    """Two halves that each hold, of different modes: nothing joins them."""
    halves = split_region(BOX, 2)
    middles = [np.mean(half, axis=0) for half in halves]
    modes = ccpin.dynamics.assembly_modes(rpdr, middles[1]).modes
    other = next(mode.q_free for mode in modes if np.sin(knee(mode.q_free)) < 0)
    one = certify(rpdr, middles[0], halves[0], max_depth=4)
    assert np.sin(knee(one.sigma(middles[0]))) > 0
    second = certify(rpdr, middles[1], halves[1], other, max_depth=4)
    with pytest.raises(InvalidInputError, match="part 2 is not proved to be on the branch of part 1: none of the"):
        merge([one, second])
    with pytest.raises(InvalidInputError, match="part 2 is not proved"):
        merge([second, one])


def knee(q_free):
    """q1 + q3 − q2 − q4, whose sine's sign tells the modes."""
    first, first_elbow, second, second_elbow = q_free
    return first + first_elbow - second - second_elbow


def test_an_interrupted_part_leaves_the_whole_incomplete(rpdr):
    """What it proved counts."""
    left, right = split_region(BOX, 2)
    whole = certify(rpdr, SEED, BOX, max_depth=5)
    other = np.mean(left, axis=0)
    one = certify(rpdr, SEED, right, max_depth=5)
    stopped = certify(rpdr, other, left, whole.sigma(other), max_depth=5, seconds=1e-9)
    assert not stopped.complete
    merged = merge([one, stopped])
    assert not merged.complete
    expected = 0.5 * (one.certified_fraction + stopped.certified_fraction)
    assert merged.certified_fraction == pytest.approx(expected)
    assert merged.certified_fraction < 0.9 * whole.certified_fraction


def test_what_does_not_belong_together_is_refused(rpdr):
    """Overlaps, gaps, cuts that are no halvings, other mechanisms, other bounds, other slices, nothing at all."""
    (left, right), whole = split_region(BOX, 2), certify(rpdr, SEED, BOX, max_depth=4)

    def over(region, mechanism=rpdr, **others):
        q = np.mean(region, axis=0)
        return certify(mechanism, q, region, whole.sigma(q) if mechanism is rpdr else None, max_depth=2, **others)

    one, two = over(left), over(right)
    thirds = [over(([a, -1.8], [b, -0.8])) for a, b in ((-2.4, -2.0), (-2.0, -1.4))]
    low, high = (over((left[0], [left[1][0], -1.3]))), over(([right[0][0], -1.3], right[1]))
    cases = {
        "parts 1 and 2 overlap": [one, one, two],
        "parts 1 and 3 overlap": [one, two, over((left[0], [left[1][0], -1.3]))],
        "no part covers": [low, high],
        "is not got by halving": thirds,
        "other bounds=": [one, over(right, bounds="reach")],
        "other closures": [one, certify(ccpin.load("four_bar"), (0.7,), max_depth=2)],
        "holds other coordinates": [one, over((right[0], [right[1][0], right[0][1]]))],
        "nothing to merge": [],
        r"parts\[1\] must be an Atlas": [one, "two"],
    }
    for message, atlases in cases.items():
        with pytest.raises(InvalidInputError, match=message):
            merge(atlases)


def test_regions_are_split_in_halves():
    """They tile the region, and their number is a power of two."""
    parts = split_region(([0.0, 0.0], [4.0, 1.0]), 8)
    assert len(parts) == 8
    assert sum(np.prod(upper - lower) for lower, upper in parts) == pytest.approx(4.0)
    assert {tuple(upper - lower) for lower, upper in parts} == {(0.5, 1.0)}
    for region, count in ((TORUS, 3), (TORUS, 0), (([1.0], [0.0]), 2), ("none", 2)):
        with pytest.raises(InvalidInputError):
            split_region(region, count)


def test_the_command(tmp_path, capsys):
    """Parts saved by `ccpin domain`, merged, and what cannot be merged said in words."""
    names = [str(tmp_path / name) for name in ("left.npz", "right.npz", "both.json")]
    for name, (lower, upper) in zip(names, split_region(np.degrees(BOX), 2), strict=False):
        corners = ["--lower-deg", *map(repr, map(float, lower)), "--upper-deg", *map(repr, map(float, upper))]
        assert main(["domain", "rpdr", *corners, "--depth", "4", "--save", name]) in (0, 4)
    capsys.readouterr()
    assert main(["merge", *names[:2], "--out", names[2], "--json"]) == 4
    facts = json.loads(capsys.readouterr().out)
    assert facts["boxes"] == len(Atlas.load(names[2]).boxes.kappa)
    assert facts["single_valued"]
    assert main(["merge", names[0], names[0], "--out", names[2]]) == 1
    assert "overlap" in capsys.readouterr().err
    assert domain.Atlas.load(names[2]).certified_fraction == facts["certified_fraction"]
