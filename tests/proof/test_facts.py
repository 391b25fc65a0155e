"""Facts are made by `prove` alone: made, altered, borrowed and misshapen claims, and searches that go wrong."""

import ast
import copy
import pickle
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PPoly

import ccpin
from ccpin.covering.cells import CellStatus
from ccpin.covering.claims import Seams
from ccpin.covering.proposals.krawczyk import certify_points
from ccpin.domain import Atlas, certify, certify_path
from ccpin.domain.atlas import cover as build
from ccpin.domain.atlas import cover_claims
from ccpin.proof.covers import over_region
from ccpin.proof.demanded import Demanded
from ccpin.proof.equations import Closures, closures_of
from ccpin.proof.facts import _KINDS, Fact, NotProvedError, ProvableClaim, Unproved, known, provable, prove, prove_some
from ccpin.proof.paths import follows
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes
from tests.support.refusals import refused

SEED = np.radians([-90.0, -90.0])
REGION = (np.radians([-115.0, -115.0]), np.radians([-65.0, -65.0]))
SOURCE = Path(ccpin.__file__).parent


@pytest.fixture(scope="module")
def atlas(rpdr):
    """Some boxes of the RPDR, one function."""
    found = certify(rpdr, SEED, REGION, max_depth=3)
    assert found.verdict == "proven"
    assert len(found.boxes.kappa) > 3
    return found


@pytest.fixture(scope="module")
def crank():
    """Boxes round a four-bar's crank, whose angle closes on itself."""
    found = certify(ccpin.load("four_bar"), [1.5], ([1.5 - np.pi], [1.5 + np.pi]))
    return found


def solutions_of(atlas):
    """The claim about an atlas's boxes."""
    return atlas.solutions[0].claim


def parts_of(atlas):
    """The cover, its boxes and what glues them."""
    cover = atlas.proved.cover
    boxes = tuple(fact for fact in cover.premises if type(fact.claim) is SolutionsInBoxes)
    return cover, boxes, tuple(fact for fact in cover.premises if fact not in boxes)


# What a fact is.


def test_a_fact_has_no_constructor_no_kinds_and_no_assignment(atlas):
    """Nothing but `prove` makes one, and nothing changes it."""
    fact = atlas.solutions[0]
    for make in (Fact, lambda: Fact(fact.claim, (), {}, fact.digest), lambda: type(fact)()):
        with pytest.raises(TypeError):
            make()
    with pytest.raises(TypeError):
        type("Forged", (Fact,), {})
    for name in ("claim", "premises", "found", "digest", "proved"):
        with pytest.raises(AttributeError):
            setattr(fact, name, ())
        with pytest.raises(AttributeError):
            delattr(fact, name)
    assert copy.copy(fact) is fact
    assert copy.deepcopy(fact) is fact
    with pytest.raises(TypeError):
        fact.found["image"] = fact.found["image"]


def test_its_arrays_cannot_be_written_to(atlas):
    """Not even with the flag that says so, and the claim's arrays are none of the caller's."""
    mine = atlas.boxes.radius.copy()
    claim = SolutionsInBoxes(solutions_of(atlas).equations, *atlas.boxes._replace(radius=mine))
    fact = prove(claim)
    mine[:] = 1.0
    assert np.array_equal(fact.claim.radius, atlas.boxes.radius)
    object.__setattr__(claim, "radius", mine)  # cheating, and in vain
    assert np.array_equal(fact.claim.radius, atlas.boxes.radius)
    for array in (fact.claim.radius, fact.claim.centre, fact.found["image"], fact.claim.equations.system.couplings):
        with pytest.raises(ValueError, match=r"read-only|WRITEABLE"):
            array[...] = 0.0
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True


def test_pickled_it_is_a_claim_until_it_is_replayed(atlas):
    """With its premises, which stay shared; altered in the pickle it is nothing."""
    cover = atlas.proved.cover
    told = pickle.loads(pickle.dumps(cover))
    assert type(told) is Unproved
    refused(lambda: solutions_of(atlas), told)
    again = told.replay()
    assert type(again) is Fact
    assert np.array_equal(again.found["unglued"], cover.found["unglued"])
    assert again.digest == cover.digest
    assert over_region(again, None, False)
    shared = [fact for fact in again.premises if type(fact.claim) is SolutionsInBoxes]
    assert all(fact.premises[-1] is shared[0] for fact in again.premises if fact not in shared)
    first = told.premises[0]
    bad = replace(first.claim, radius=0.5 * first.claim.radius)
    with pytest.raises(NotProvedError):
        told._replace(premises=(Unproved(bad), *told.premises[1:])).replay()


STATING = {  # rooms with theorems of their own: the modules that state claims, and what these are about
    "control/stability/set_point/set_point_cells.py",
    "control/stability/set_point/set_point_equations.py",
    "control/stability/set_point/sublevel_claim.py",
    "control/stability/tracking/on_line.py",
    "control/stability/tracking/tracking_equations.py",
    "control/stability/tracking/tube_claim.py",
    "identification/adaptive/adaptive_equations.py",
    "identification/adaptive/adaptive_tube_claim.py",
    "identification/combinations/dependent_columns.py",
    "identification/combinations/identification_equations.py",
    "identification/combinations/rank_claims.py",
    "transmission/motor_limits_claim.py",
    "validated/loop_equations.py",
    "validated/flow/start_claim.py",
    "validated/flow/step_claim.py",
    "validated/flow/motion_claim.py",
    "validated/flow/crossing_claim.py",
    "validated/sets/slices_claim.py",
    "validated/sets/motion_tube_claim.py",
    "validated/sets/set_claim.py",
    "validated/sets/arrival_equations.py",
    "validated/sets/arrival_claim.py",
    "validated/programs/branch_claim.py",
    "validated/programs/program_equations.py",
    "validated/programs/rounding_claim.py",
    "validated/programs/steps_claim.py",
}


def test_only_the_kernel_makes_facts():
    """No module outside `ccpin.proof` names what mints them, registers claims or equations, or reaches into objects.

    Those that state theorems of their own register these, by name.
    """
    makers, registered = {"_minted", "provable", "known", "_KINDS", "_EQUATIONS"}, set()
    for path in SOURCE.rglob("*.py"):
        text, inside = path.read_text(encoding="utf-8"), path.is_relative_to(SOURCE / "proof")
        if "Fact" not in text and not ("ccpin.proof" in text and any(word in text for word in makers)):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ccpin.proof") and not inside:
                named = makers & {alias.name for alias in node.names}
                where = path.relative_to(SOURCE).as_posix()
                assert not named or (where in STATING and named <= {"provable", "known"}), path
                registered |= {where} if named else set()
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Fact":
                raise AssertionError(f"{path} calls Fact")
            if isinstance(node, ast.Attribute) and node.attr == "__new__" and not inside:
                assert not any(isinstance(one, ast.Name) and one.id == "Fact" for one in ast.walk(node)), path
    assert registered == STATING


def test_every_array_of_a_claim_has_its_form():
    """What has none would be believed in any shape, and with any numbers."""
    assert len(_KINDS) > 15
    for kind in _KINDS:
        assert [*kind.forms] == [field.name for field in fields(kind)[1:]]


# Claims about boxes.

MISSHAPEN = {
    "a preconditioner with fewer rows": {"preconditioner": lambda x: x[:, :-1]},
    "a preconditioner with fewer columns": {"preconditioner": lambda x: x[:, :, :-1]},
    "modes in other coordinates": {"modes": lambda x: np.concatenate([x, x], axis=1)},
    "a centre with a coordinate too few": {"centre": lambda x: x[:, :-1]},
    "a centre with a coordinate too many": {"centre": lambda x: np.concatenate([x, x[:, :1]], axis=1)},
    "a half width too many": {"half": lambda x: np.concatenate([x, x[:, :1]], axis=1)},
    "directions of no parameter": {"directions": lambda x: x[:, :, :0]},
    "one radius too few": {"radius": lambda x: x[:, :-1]},
    "one weight for all": {"weight": lambda x: x[:, 0]},
    "a box too few": {"kappa": lambda x: x[:-1]},
    "a kappa for each row": {"kappa": lambda x: np.tile(x[:, None], (1, 2))},
    "single precision": {"centre": lambda x: x.astype(np.float32)},
    "the other byte order": {"centre": lambda x: x.astype(">f8")},
    "whole numbers": {"half": lambda x: x.astype(np.int64)},
    "objects": {"radius": lambda x: x.astype(object)},
    "a mask": {"weight": lambda x: x > 0.0},
    "words": {"centre": lambda x: x.astype(str)},
    "complex numbers": {"modes": lambda x: x.astype(complex)},
    "nothing": {"radius": lambda x: None},
    "no number in the centre": {"centre": lambda x: np.full_like(x, np.nan)},
    "no number in the preconditioner": {"preconditioner": lambda x: x * np.nan},
    "an endless radius": {"radius": lambda x: x * np.inf},
    "an endless half width": {"half": lambda x: x + np.inf},
    "a radius of zero": {"radius": lambda x: 0.0 * x},
    "a negative radius": {"radius": lambda x: -x},
    "a negative half width": {"half": lambda x: -x},
    "a negative weight": {"weight": lambda x: -x},
    "a weight of zero": {"weight": lambda x: 0.0 * x},
    "kappa one": {"kappa": lambda x: np.ones_like(x)},
    "a negative kappa": {"kappa": lambda x: -x - 1.0},
    "kappa no number": {"kappa": lambda x: x * np.nan},
}
ALTERED = {
    "a narrower tube": {"radius": lambda x: 0.5 * x},
    "a wider tube": {"radius": lambda x: 200.0 * x},
    "a wider box": {"half": lambda x: 4.0 * x},
    "another centre": {"centre": lambda x: x + 0.01},
    "another preconditioner": {"preconditioner": lambda x: -x},
    "a preconditioner of zeros": {"preconditioner": lambda x: 0.0 * x},
    "modes of zeros": {"modes": lambda x: 0.0 * x},
    "other slopes": {"directions": lambda x: x + 0.5},
    "a smaller contraction": {"kappa": lambda x: 0.2 * x},
    "other weights": {"weight": lambda x: x * np.array([1.0, 1e9])},
}


@pytest.mark.parametrize("change", [*MISSHAPEN.values(), *ALTERED.values()], ids=[*MISSHAPEN, *ALTERED])
def test_no_fact_comes_of_other_numbers(atlas, change):
    """A claim that is misshapen, or whose numbers were altered in one box."""
    claim = solutions_of(atlas)
    for name, alter in change.items():
        refused(lambda name=name, alter=alter: replace(claim, **{name: alter(getattr(claim, name).copy())}))


def test_one_bad_row_is_left_out(atlas):
    """Of many rows those are kept that are proved, whatever is wrong with the others."""
    claim, radius = solutions_of(atlas), solutions_of(atlas).radius.copy()
    radius[1], radius[2] = np.nan, 0.5 * radius[2]
    fact, kept = prove_some(replace(claim, radius=radius))
    assert np.flatnonzero(~kept).tolist() == [1, 2]
    assert len(fact.claim.kappa) == len(fact.found["image"]) == len(kept) - 2


def test_claims_and_equations_of_other_kinds(atlas):
    """A subclass of a claim, or of equations, is none that the kernel knows."""

    class Generous(SolutionsInBoxes):
        def examined(self, *premises):
            return super().examined(*premises)._replace(proved=np.ones(len(self.kappa), dtype=bool))

    class Easy(Closures):
        digest = "0"

    claim = solutions_of(atlas)
    refused(lambda: Generous(claim.equations, *claim.boxes))
    refused(lambda: SolutionsInBoxes(Easy(claim.equations.system), *claim.boxes))
    refused(lambda: ProvableClaim(claim.equations))
    refused(lambda: claim.equations)
    refused(lambda: atlas.solutions[0])
    refused(lambda: claim, atlas.solutions[0])
    assert (provable.__name__, known.__name__) == ("provable", "known")


BROKEN = {
    "an axis that is not of unit length": ("axes", lambda x: 1.5 * x),
    "a placement that is no rotation": ("rotations", lambda x: 1.001 * x),
    "a joint twice in a chain": ("joints", lambda x: 0 * x),
}


@pytest.mark.parametrize("name", BROKEN)
def test_equations_that_are_none(atlas, name):
    """Bounds are about rotations about unit axes."""
    field, alter = BROKEN[name]
    system = solutions_of(atlas).equations.system
    chains = tuple(chain._replace(**{field: alter(getattr(chain, field))}) for chain in system.chains)
    with pytest.raises(NotProvedError):
        Closures(replace(system, chains=chains))


def test_circles_that_are_none():
    """A slide does not come round, nor does what a coupling counts; coordinates are q or y."""
    system = solutions_of(certify(ccpin.load("slider_crank"), [1.0], ([0.9], [1.1]), max_depth=1)).equations.system
    with pytest.raises(NotProvedError):
        Closures(replace(system, periodic=np.ones_like(system.periodic)))
    with pytest.raises(NotProvedError):
        Closures(replace(system, independent=system.dependent[:1]))


# Claims about gluing.


def test_gluing_needs_boxes_of_the_same_equations(atlas, crank):
    """Another robot's boxes, points, other facts and claims are no premises."""
    cover, boxes, glue = parts_of(atlas)
    claim = next(fact.claim for fact in glue if type(fact.claim) is GluedBoxes)
    points = next(fact for fact in glue if type(fact.claim) is Met).premises[0]
    others = parts_of(crank)[1]
    for premises in (others, (points,), (cover,), (claim,), (), (*boxes, points), (boxes[0].claim,), (glue[0],)):
        refused(lambda: claim, *premises)
    prove(claim, *boxes)


GLUED = {
    "a box that is not there": {"first": lambda x: x + 10_000},
    "a negative number": {"second": lambda x: x - 10_000},
    "a mask for numbers": {"first": lambda x: x > 0},
    "floats for numbers": {"first": lambda x: x.astype(float)},
    "small integers": {"first": lambda x: x.astype(np.int32)},
    "one pair too few": {"second": lambda x: x[:-1]},
    "a coordinate too few": {"at_first": lambda x: x[:, :-1]},
    "a point out of the box": {"at_first": lambda x: 3.0 * x + 1.0},
    "two points": {"at_second": lambda x: 0.9 * x},
    "no number": {"at_first": lambda x: x * np.nan},
    "itself": {"second": lambda x: x[::-1]},
}


@pytest.mark.parametrize("name", GLUED)
def test_no_boxes_are_glued_by_other_numbers(atlas, name):
    """Gluing is at a point that is in both."""
    boxes, glue = parts_of(atlas)[1:]
    claim = next(fact.claim for fact in glue if type(fact.claim) is GluedBoxes)
    refused(
        lambda: replace(claim, **{key: alter(getattr(claim, key).copy()) for key, alter in GLUED[name].items()}), *boxes
    )


def test_other_branches_are_not_glued(rpdr):
    """Boxes over the same q in two assembly modes, by a ball and by points."""
    sheets = ccpin.domain.certify_sheets(rpdr, REGION, max_depth=3)
    equations = closures_of(sheets.problem)
    fact = prove(SolutionsInBoxes(equations, *sheets.boxes))
    independent = sheets.problem.system.independent
    centre = fact.claim.centre[:, independent]
    pairs = [(i, j) for i in range(len(centre)) for j in range(i) if np.abs(centre[i] - centre[j]).max() < 1e-12]
    assert pairs
    first, second = np.array(pairs).T.astype(np.int64)
    at = np.zeros((len(first), 2))
    assert not prove_some(GluedBoxes(equations, first, second, at, at), fact)[1].any()
    points = prove(SolutionsInBoxes(equations, *certify_points(sheets.problem, fact.claim.centre[first]).boxes))
    row = np.arange(len(first))
    assert not prove_some(Met(equations, first, second, at, at, row), points, fact)[1].any()
    assert prove_some(Met(equations, first, first, at, at, row), points, fact)[1].all()


# Claims about regions.


def tree_of(claim, **changes):
    """A cover's claim with other numbers."""
    return replace(claim, **{name: alter(getattr(claim, name).copy()) for name, alter in changes.items()})


def put(place, value):
    """An array with another number in one place."""

    def alter(array):
        array[place] = value
        return array

    return alter


def test_trees_that_are_none(atlas):
    """Cells with two parents, cells that are not there, cells of other boxes, other regions."""
    cover, boxes, glue = parts_of(atlas)
    claim, inner = cover.claim, np.flatnonzero(cover.claim.child >= 0)
    leaf = np.flatnonzero(claim.box >= 0)
    for changes in (
        {"child": put(inner[-1], claim.child[inner[0]])},
        {"child": put(leaf[0], 0)},
        {"child": put(leaf[0], len(claim.child))},
        {"cut": put(inner[0], 2)},
        {"cut": put(inner[0], -1)},
        {"box": put(leaf[0], claim.box[leaf[-1]])},
        {"box": put(leaf[0], len(atlas.boxes.kappa))},
        {"box": lambda box: box[:-1]},
        {"box": lambda box: box >= 0},
        {"start": put(0, len(atlas.boxes.kappa))},
        {"start": put(0, (claim.start[0] + 1) % len(atlas.boxes.kappa))},
        {"lower": lambda lower: lower - 1e-9},
        {"upper": lambda upper: upper + 1e-9},
        {"upper": lambda upper: upper * np.nan},
        {"lower": lambda lower: lower[:-1]},
        {"lower": lambda lower: lower + 10.0},
        {"wrapped": lambda wrapped: ~wrapped},
    ):
        refused(lambda changes=changes: tree_of(claim, **changes), *boxes, *glue)
    refused(lambda: claim, *glue)
    refused(lambda: claim, *boxes, *glue, cover)


def test_what_is_left_out_is_not_proved(atlas):
    """A cell without its box, faces without their gluing, a seed in no box, facts that glue others' boxes."""
    cover, boxes, glue = parts_of(atlas)
    claim = cover.claim
    assert over_region(cover, None, False)
    for changed in (
        prove(tree_of(claim, box=put(np.flatnonzero(claim.box >= 0)[0], -1)), *boxes, *glue),
        prove(claim, *boxes, *(fact for fact in glue if type(fact.claim) is Met)),
        prove(tree_of(claim, start=put(0, -1)), *boxes, *glue),
    ):
        assert not over_region(changed, None, False)
    twin = boxes[0].replay()
    moved = next(fact for fact in glue if type(fact.claim) is GluedBoxes)
    started = glue[-1]
    elsewhere = prove(claim, *boxes, prove(moved.claim, twin), started)
    assert len(elsewhere.found["unglued"])
    assert not over_region(elsewhere, None, False)
    assert not over_region(cover, None, True)
    with pytest.raises(NotProvedError):
        over_region(boxes[0], None, False)


def test_a_circle_is_glued_where_it_closes(crank):
    """The seam of a full turn is a face too: left out, σ is no function on the circle."""
    cover, boxes, glue = parts_of(crank)
    claim = cover.claim
    assert claim.wrapped[0]
    ends = [
        k for fact in glue if type(fact.claim) is GluedBoxes for k in np.flatnonzero(fact.found["turn"].any(axis=1))
    ]
    across = next((fact for fact in glue if type(fact.claim) is GluedBoxes), None)
    if ends:
        kept = np.setdiff1d(np.arange(len(across.claim.first)), ends)
        torn = prove(claim, *boxes, prove(across.claim.take(kept), *boxes), *(f for f in glue if f is not across))
        assert len(torn.found["unglued"]) == len(cover.found["unglued"]) + len(ends)


def test_more_that_is_asked_is_asked_of_the_same_boxes(atlas):
    """Limits that boxes keep, and limits that they do not; a fact about other boxes does not count."""
    cover, boxes, _ = parts_of(atlas)
    equations, size = cover.claim.equations, len(cover.claim.equations.system.periodic)
    none = np.zeros(0, dtype=np.int64)
    wide = Demanded(equations, np.full(size, -9.0), np.full(size, 9.0), none, np.ones(2), np.zeros(1))
    fact = prove(wide, *boxes)
    assert over_region(cover, fact, True)
    assert not over_region(cover, prove(wide, boxes[0].replay()), True)
    refused(lambda: replace(wide, upper=np.full(size, -8.0)), *boxes)
    for driven in ([size], [0, 0], [0], [0, size], [0, 1, 2]):
        refused(lambda driven=driven: replace(wide, driven=np.array(driven)), *boxes)
    refused(lambda: replace(wide, dexterity=np.ones(1)), *boxes)


# Searches that go wrong.


def certified(rpdr):
    """The same region again."""
    return certify(rpdr, SEED, REGION, max_depth=3)


def test_a_search_with_other_tubes(rpdr, monkeypatch):
    """Radii halved on their way to the kernel: not one box is a fact, and nothing is proven."""
    honest = build.prove_cells

    def halved(*given):
        found = honest(*given)
        return found._replace(boxes=found.boxes._replace(radius=0.5 * found.boxes.radius))

    monkeypatch.setattr(build, "prove_cells", halved)
    found = certified(rpdr)
    assert found.verdict != "proven"
    assert (len(found.boxes.kappa), found.certified_fraction) == (0, 0.0)


def test_a_search_with_wider_cells(rpdr, monkeypatch):
    """Every other box is said to be four times as wide."""
    honest = build.prove_cells

    def wider(*given):
        found = honest(*given)
        found.boxes.half[::2] *= 4.0
        return found

    monkeypatch.setattr(build, "prove_cells", wider)
    with suppress(NotProvedError):  # boxes that are proved as wide as they were said to be are not their cells'
        assert certified(rpdr).verdict != "proven"


def test_a_search_that_glues_nothing(rpdr, monkeypatch):
    """Faces are not handed on: they are unglued."""
    from ccpin.domain.atlas import certifying

    monkeypatch.setattr(certifying, "seams_of", lambda problem, *_: Seams.none(problem.system.n))
    monkeypatch.setattr(
        build.AtlasBuilder, "_glued_to_origin", lambda self, origins, boxes: np.ones(len(boxes.kappa), bool)
    )
    found = certified(rpdr)
    assert found.verdict != "proven"
    assert not found.single_valued


def test_a_search_that_leaves_cells_out(rpdr, monkeypatch):
    """A cell that was not proved is called certified."""
    honest = cover_claims.proved_cover

    def dropped(problem, region, tree, *rest):
        leaves = tree.leaves(CellStatus.CERTIFIED)
        tree.box[leaves[0]] = -1
        return honest(problem, region, tree, *rest)

    from ccpin.domain.atlas import certifying

    monkeypatch.setattr(certifying, "proved_cover", dropped)
    found = certified(rpdr)
    assert found.verdict != "proven"


def test_a_search_from_another_seed(rpdr, monkeypatch):
    """The seed is another assembly mode's: no box carries it."""
    from ccpin.domain.atlas import certifying

    honest = cover_claims.proved_cover

    def elsewhere(problem, region, tree, seed, *rest):
        other = seed.copy()
        other[problem.system.dependent] *= -1.0
        return honest(problem, region, tree, other, *rest)

    monkeypatch.setattr(certifying, "proved_cover", elsewhere)
    found = certified(rpdr)
    assert found.verdict != "proven"
    assert not len(found.proved.cover.found["seed"])


# Documents.


def test_a_document_is_a_claim_until_it_is_replayed(atlas, tmp_path):
    """Its boxes are proved at load; where σ is one function it is believed, and said to be, unless it is replayed."""
    path = tmp_path / "atlas.npz"
    atlas.save(path)
    told, known = Atlas.load(path), Atlas.load(path, replay=True)
    assert told.proved is None
    assert (told.verdict, known.verdict) == ("proven", "proven")
    assert str(path) in told.reason
    assert str(path) not in known.reason
    assert known.proved.cover.digest == atlas.proved.cover.digest
    seed = atlas.seed.copy()
    seed[atlas.problem.system.dependent] *= -1.0
    replace(atlas, seed=seed).save(path)
    assert Atlas.load(path).verdict == "proven"
    assert Atlas.load(path, replay=True).verdict != "proven"


def test_a_path_is_followed_from_its_first_knot_to_its_last(rpdr):
    """Not as far as some knot before the last, and not another path's fact."""
    ways = [SEED + np.array([[0.0, 0.0], [0.1, 0.0], [0.1, side]]) for side in (0.1, -0.1)]
    one, other = (certify_path(rpdr, way) for way in ways)
    assert one.verdict == "proven"
    assert follows(one.proved, one.pieces)
    assert not follows(one.proved, other.pieces)
    assert replace(one, proved=other.proved).verdict == "undecided"
    assert replace(one, proved=None).verdict == "undecided"
    shorter = certify_path(rpdr, ways[0][:2])
    assert not follows(shorter.proved, one.pieces)
    longer = PPoly(one.pieces.c, one.pieces.x + np.array([0.0, 0.0, 1.0]))
    assert not follows(one.proved, longer)
    with pytest.raises(NotProvedError):
        follows(one.proved.premises[0], one.pieces)
