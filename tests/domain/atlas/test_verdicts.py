"""The three verdicts of atlases and paths, each witness checked by closed forms or by NumPy's reference."""

import numpy as np
import pytest

import ccpin
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.covering.cells import CellStatus
from ccpin.domain import certify, certify_path, scalar_coordinates_at
from ccpin.domain.closures.system import reading_of
from ccpin.domain.paths.refutation import line_problem
from ccpin.domain.singular.folds import singular_points
from tests.oracles import rpdr as oracle
from tests.support.closures import closed_problem
from tests.support.long_cases import later
from tests.support.singular import least_singular_value

SEED = np.array([-1.885, -1.257])


@pytest.fixture(scope="module")
def torus(rpdr):
    return certify(rpdr, SEED, max_depth=9)


def test_shares_sum_to_one(torus):
    """Certified, empty, singular, undecided and unreached cells are all of the region."""
    shares = ("certified", "empty", "singular", "undecided", "unreached")
    assert sum(getattr(torus, f"{share}_fraction") for share in shares) == pytest.approx(1.0, abs=1e-12)
    assert torus.singular_fraction > 0.5 * (torus.singular_fraction + torus.undecided_fraction)


def test_singular_cells_hold_the_fold(torus):
    """On every cell marked singular the closed form's elongation passes 1, or it holds coincident elbows."""
    tree, region = torus.tree, torus.region
    leaves = tree.leaves()
    cells = leaves[tree.status[leaves] == CellStatus.SINGULAR]
    assert len(cells) > 100
    steps = np.stack(np.meshgrid(*2 * [np.linspace(0.0, 1.0, 9)], indexing="ij"), axis=-1).reshape(-1, 2)
    elbows = oracle.coincident_elbows()
    for cell in cells:
        q = region.position(tree.lower[cell] + steps * tree.size[cell])
        stretched = np.array([oracle.elongation(point) for point in q]) - 1.0
        near = min(np.abs(q - side * elbows).max(axis=1).min() for side in (1.0, -1.0))
        assert stretched.min() <= 0.0 <= stretched.max() or near < 0.05


def test_refuted_by_an_empty_cell(torus):
    """The torus holds q that no configuration has: the closed form cannot reach the witness either."""
    assert (torus.verdict, torus.witness.kind) == ("refuted", "empty")
    assert oracle.elongation(torus.witness.q) > 1.0
    assert "no configuration" in torus.reason


def test_refuted_by_a_singular_configuration():
    """Near a fold of the 3-RRR the witness closes, and is singular by NumPy's reference."""
    mechanism = ccpin.load("planar_3rrr")
    seed = np.array([-0.675, 1.419, -2.769])
    atlas = certify(mechanism, seed, (seed - 0.5, seed + 0.5), max_depth=4)
    assert (atlas.verdict, atlas.witness.kind) == ("refuted", "singular")
    assert np.all(np.abs(atlas.witness.q - seed) <= 0.5)
    assert np.abs(mechanism.constraints().residual(atlas.witness.q_free)).max() < 1e-9
    assert least_singular_value(mechanism, atlas.witness.q_free) < 1e-6


def test_proven_and_undecided_atlases(rpdr):
    """A region inside of the domain is proven; one halved once only is undecided, and told what to raise."""
    proven = certify(rpdr, SEED, (SEED - 0.1, SEED + 0.1))
    assert (proven.verdict, proven.witness) == ("proven", None)
    delta = ccpin.load("delta")
    undecided = certify(delta, np.zeros(3), (np.full(3, -0.4), np.full(3, 0.7)), max_depth=1)
    assert (undecided.verdict, undecided.witness) == ("undecided", None)
    assert "max_depth" in undecided.reason


def test_a_verdict_survives_saving(torus, tmp_path):
    """What was saved gives the same verdict and witness, and says that they rest on the file."""
    torus.save(tmp_path / "atlas.npz")
    again = ccpin.domain.Atlas.load(tmp_path / "atlas.npz")
    assert again.verdict == torus.verdict
    assert again.reason.startswith(torus.reason)
    assert "as " in again.reason.removeprefix(torus.reason)


def test_results_print_as_their_verdicts(rpdr):
    """And no arrays: a proof has thousands of numbers."""
    model, end = ccpin.ReducedModel(rpdr), SEED + 0.02
    law = ccpin.control.PDSimpleGravity(model, end, 11.0, 1.0)
    for result in (
        certify_path(rpdr, [SEED, end]),
        ccpin.domain.theorem2(rpdr, rpdr.q_reference),
        certify_law(law, max_depth=6, budget=20),
        ccpin.validated.enclose(model, law, SEED, None, 2e-3),
        ccpin.validated.enclose_set(model, law, SEED, None, 1e-3, spread=1e-5, parts=1),
    ):
        assert repr(result) == f"{type(result).__name__}({result.verdict}: {result.reason})"
        assert "array" not in repr(result)
        assert len(repr(result)) < 400


@pytest.mark.parametrize("ends", later(15, 40))
@pytest.mark.parametrize("tube", later(1e-4, 0.0))
def test_paths_into_the_boundary_are_refuted_at_it(rpdr, tube, ends):
    """Of ends in all directions, each refuted path's witness lies on the closed form's fold and in the tube."""
    rng, counts = np.random.default_rng(8), {"proven": 0, "refuted": 0, "undecided": 0}
    for _ in range(ends):
        end = SEED + rng.uniform(-2.5, 2.5, 2)
        path = certify_path(rpdr, [SEED, end], tube)
        counts[path.verdict] += 1
        if path.verdict != "refuted":
            assert path.witness is None
            continue
        way = end - SEED
        along = (path.witness.q - SEED) @ way / (way @ way)
        assert np.abs(path.witness.q - SEED - along * way).max() <= tube + 1e-9
        if path.witness.kind == "singular":
            assert abs(oracle.elongation(path.witness.q) - 1.0) < 1e-6
            assert least_singular_value(rpdr, path.witness.q_free) < 1e-6
        else:
            assert oracle.elongation(path.witness.q) > 1.0
    assert counts["proven"]
    assert counts["refuted"] > counts["undecided"]


def test_theorem_s_has_no_false_proofs():
    """Started anywhere on the 3-RRR, what is called proved is a singular configuration to its error, on its line."""
    problem, theta = closed_problem("planar_3rrr", "reach")
    rng, system = np.random.default_rng(5), problem.system
    start = theta + rng.uniform(-0.6, 0.6, (200, system.n_free))
    directions = rng.standard_normal((200, system.n))
    found = singular_points(problem, start, directions)
    assert found.proved.sum() > 20
    mechanism = ccpin.load("planar_3rrr")
    reading = reading_of(mechanism, mechanism.q_reference)
    for k in np.flatnonzero(found.proved):
        q_free = reading.configuration(found.theta[k])
        assert np.abs(mechanism.constraints().residual(q_free)).max() < 1e-9 + 10 * found.error[k]
        assert least_singular_value(mechanism, q_free) < 1e-9 + 100 * found.error[k]
        gap = found.theta[k, system.independent] - start[k, system.independent] - found.along[k] * directions[k]
        assert np.abs(gap).max() < 1e-12 * (1 + abs(found.along[k]))


def test_regular_configurations_are_never_proved_singular(rpdr):
    """Far from any fold nothing is found within reach."""
    mechanism = ccpin.load("delta")
    seed = scalar_coordinates_at(mechanism, mechanism.q_reference)
    atlas = certify(mechanism, seed, (seed - 0.1, seed + 0.1), max_depth=2)
    assert atlas.verdict == "proven"


def test_the_line_keeps_the_other_coordinates():
    """A line's closures are φ and n − 1 linear rows that vanish on it and nowhere else."""
    problem, theta = closed_problem("planar_3rrr", "reach")
    direction, system = np.array([1.0, -2.0, 0.5]), problem.system
    line = line_problem(problem, theta, direction, int(system.dependent[0]))
    on, off = theta.copy(), theta.copy()
    on[system.independent] += 0.3 * direction
    off[system.independent] += [0.0, 0.1, 0.0]
    rows = line.system.couplings[-2:] @ np.array([on, off]).T + line.system.offset[-2:, None]
    assert np.abs(rows[:, 0]).max() < 1e-15
    assert np.linalg.norm(rows[:, 1]) > 0.02


def test_what_a_line_s_rows_hold_is_no_angle(rpdr):
    """φ with Nᵀ(q − q_r) = 0 is not the same a turn on in q: such a turn is no gluing."""
    reading = reading_of(rpdr, rpdr.q_reference)
    system = reading.problem.system
    theta = reading.theta(rpdr.q_reference)
    for direction, turning in (((1.0, 0.5), (False, False)), ((1.0, 0.0), (True, False))):
        line = line_problem(reading.problem, theta, np.array(direction), int(system.dependent[0])).system
        np.testing.assert_array_equal(line.periodic[system.independent], turning)
        np.testing.assert_array_equal(line.periodic[system.dependent], system.periodic[system.dependent])
