"""Atlases against closed forms: what they certify, what they must not, and that nothing about the run changes them."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest

import ccpin
from ccpin import domain, work
from ccpin.covering.cells import CellStatus
from ccpin.domain import Atlas, certify
from ccpin.domain.atlas import certifying
from ccpin.errors import InvalidInputError, UnreachableError, UnsupportedMechanismError
from ccpin.proof.equations import closures_of
from ccpin.proof.newton import solve_in_boxes
from ccpin.proof.solutions import check
from tests.oracles import cusped_3rpr as cusped
from tests.oracles import delta as delta_oracle
from tests.oracles import planar_3rrr as planar_oracle
from tests.oracles import rpdr as oracle
from tests.oracles.geometry import wrap
from tests.support.cusped import cusped_mechanism
from tests.support.long_cases import later
from tests.support.paper import GOAL, START

CENTRES = ((-108.0, -72.0), (-108.0, -48.0), (-108.0, -120.0), (-70.0, -110.0))
CONTROL_REGION = START, GOAL
SEED = np.radians((-108.0, -72.0))


def elongation(q):
    """√(λ² + μ²)/(a₃ + a₄) for rows of q."""
    return np.hypot(*oracle.elbow_offset(q.T)) / (oracle.A3 + oracle.A4)


def exact_radius(centre):
    """Half width of the largest square without singularity: stretched loop or coincident elbows, on its edge."""
    along = np.linspace(-1.0, 1.0, 10001)
    edges = [
        np.column_stack(pair) for one in (1.0, -1.0) for pair in ((along, 0 * along + one), (0 * along + one, along))
    ]
    unit = np.concatenate(edges)

    def clear(r):
        return elongation(centre + r * unit).max() < 1.0

    low, high = 0.0, 0.0
    while clear(high) and high < np.pi:
        low, high = high, high + 1e-2
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if clear(middle) else (low, middle)
    isolated = oracle.coincident_elbows()
    gaps = [np.abs(wrap(centre - sign * isolated)).max() for sign in (1.0, -1.0)]
    return min(low, *gaps)


def same(first, second):
    """Whether two atlases are equal bit for bit."""
    pairs = [*zip(first.boxes, second.boxes, strict=True)]
    pairs += [*zip(first.tree.cells, second.tree.cells, strict=True)]
    return all(np.array_equal(a, b) for a, b in pairs) and first.radius == second.radius


def newton_closed_form(q, y, steps):
    """Newton on (31) at fixed q for rows of q = (q1, q2) and y = (q3, q4)."""
    for _ in range(steps):
        q_free = np.array([q[:, 0], q[:, 1], y[:, 0], y[:, 1]])
        phi = oracle.phi(q_free)
        s13, c13 = np.sin(q_free[0] + q_free[2]), np.cos(q_free[0] + q_free[2])
        s24, c24 = np.sin(q_free[1] + q_free[3]), np.cos(q_free[1] + q_free[3])
        det = oracle.A3 * oracle.A4 * (s13 * c24 - c13 * s24)
        step3 = (-oracle.A4 * c24 * phi[0] - oracle.A4 * s24 * phi[1]) / det
        step4 = (-oracle.A3 * c13 * phi[0] - oracle.A3 * s13 * phi[1]) / det
        y = y - np.column_stack([step3, step4])
    return y


@pytest.fixture(scope="module")
def torus(rpdr):
    """The whole ±180° torus, and how long it took."""
    start = time.process_time()
    atlas = certify(rpdr, SEED)
    return atlas, time.process_time() - start


@pytest.mark.parametrize("centre", later(*CENTRES))
def test_largest_square(rpdr, centre):
    """The certified square is 99.9 % of the exact one or more, never all of it, within two seconds."""
    start = time.process_time()
    atlas = certify(rpdr, np.radians(centre), max_depth=0)
    took = time.process_time() - start
    exact = exact_radius(np.radians(centre))
    assert 0.999 * exact <= atlas.radius < exact
    assert atlas.single_valued
    assert np.all(atlas.verify())
    assert took < 2.0
    corners = np.radians(centre) + 0.999999 * atlas.radius * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    assert np.all(atlas.contains(corners))


def test_control_region(rpdr):
    """All of 𝒟 is certified in under a second of processor time."""
    start = time.process_time()
    atlas = certify(rpdr, np.radians((-120.0, -130.0)), CONTROL_REGION)
    took = time.process_time() - start
    assert atlas.certified_fraction == 1.0
    assert atlas.single_valued
    assert atlas.radius == pytest.approx(np.radians(30.0))
    assert atlas.area == pytest.approx(np.radians(60.0) ** 2)
    assert took < 1.0


def test_torus(torus):
    """Over the whole torus 99.9 % of the branch is certified within ten seconds of work; the shares add up."""
    atlas, took = torus
    grid = (np.arange(3000) + 0.5) / 3000 * 2 * np.pi - np.pi
    branch = np.mean([np.mean(elongation(np.column_stack([np.full_like(grid, q1), grid])) < 1.0) for q1 in grid])
    assert 0.999 * branch < atlas.certified_fraction < branch + 1e-6
    assert atlas.single_valued
    assert atlas.complete
    shares = ("certified", "empty", "singular", "undecided", "unreached")
    assert sum(getattr(atlas, f"{share}_fraction") for share in shares) == pytest.approx(1.0, abs=1e-12)
    assert atlas.empty_fraction > 0.99 * (1.0 - branch)
    assert took < 10.0


def test_nothing_outside_of_the_branch_is_certified(torus):
    """No corner of a box and no certified random point lies beyond the stretched loop or at the coincident elbows."""
    atlas, _ = torus
    corners = [atlas.lower, atlas.upper, np.column_stack([atlas.lower[:, 0], atlas.upper[:, 1]])]
    corners.append(np.column_stack([atlas.upper[:, 0], atlas.lower[:, 1]]))
    assert elongation(np.concatenate(corners)).max() < 1.0
    points = np.random.default_rng(0).uniform(-np.pi, np.pi, (200_000, 2))
    certified, status = atlas.contains(points), atlas.status(points)
    assert elongation(points[certified]).max() < 1.0
    assert elongation(points[status == CellStatus.EMPTY]).min() > 1.0
    assert not np.any(atlas.contains(np.array([oracle.coincident_elbows(), -oracle.coincident_elbows()])))
    assert np.array_equal(certified, status == CellStatus.CERTIFIED)


@pytest.mark.parametrize("count", [20_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_newton_from_the_box_finds_the_branch(torus, count):
    """From the box's linear predictor Newton on the closed form ends on the right branch every time, and σ is there."""
    atlas, _ = torus
    rng = np.random.default_rng(1)
    number = rng.integers(len(atlas.boxes.kappa), size=count)
    boxes = atlas.boxes.take(number)
    delta = boxes.half * rng.uniform(-1.0, 1.0, (count, 2))
    start = boxes.centre + (boxes.directions @ delta[..., None])[..., 0]
    q, y = start[:, [0, 2]], start[:, [1, 3]]
    y = newton_closed_form(q, y, 8)
    phi = oracle.phi(np.array([q[:, 0], q[:, 1], y[:, 0], y[:, 1]]))
    assert np.abs(phi).max() < 1e-12
    assert np.all(np.sin(q[:, 0] + y[:, 0] - q[:, 1] - y[:, 1]) > 0.0)
    inside = (np.linalg.inv(boxes.modes) @ (y - start[:, [1, 3]])[..., None])[..., 0]
    assert np.all(np.abs(inside) <= boxes.radius)
    found = atlas.sigma(q)
    assert np.abs(wrap(found[:, [1, 3]] - y)).max() < 1e-6
    assert np.abs(oracle.phi(np.array([q[:, 0], q[:, 1], found[:, 1], found[:, 3]]))).max() < 1e-14
    assert np.array_equal(found[:, [0, 2]], q)


def test_sigma_is_that_of_the_parametrization(rpdr, torus):
    """Where a straight line leads there, the atlas and `Parametrization.sigma` agree."""
    atlas, _ = torus
    parametrization = rpdr.parametrization()
    start = parametrization.sigma(SEED).q_free
    for q in SEED + np.radians(12.0) * np.random.default_rng(3).uniform(-1, 1, (20, 2)):
        assert np.abs(atlas.sigma(q) - parametrization.sigma(q, near=start).q_free).max() < 1e-9


def test_contains_and_sigma_check_their_input(torus):
    """A turn more changes nothing, points outside are refused in words."""
    atlas, _ = torus
    assert atlas.contains(SEED)
    assert atlas.contains(SEED + 2 * np.pi * np.array([1, -2]))
    assert np.abs(wrap(atlas.sigma(SEED + 2 * np.pi) - atlas.sigma(SEED))).max() < 1e-12
    assert not atlas.contains(np.radians((180.0, 0.0)))
    with pytest.raises(InvalidInputError, match="not in the certified set"):
        atlas.sigma(np.radians((180.0, 0.0)))
    with pytest.raises(InvalidInputError, match="joint1, joint2"):
        atlas.contains(np.zeros(3))


def test_the_other_mode_has_the_same_domain(rpdr):
    """With the end effector up the largest square is the same: the domain depends on the elbows only."""
    q1, q2, q3, q4 = oracle.sigma(SEED, -1.0)
    atlas = certify(rpdr, SEED, near=np.array([q1, q3, q2, q4]), max_depth=0)
    exact = exact_radius(SEED)
    assert 0.999 * exact <= atlas.radius < exact
    found = atlas.sigma(SEED + 0.9 * exact * np.random.default_rng(0).uniform(-1, 1, (50, 2)))
    assert np.all(np.sin(oracle.fold(found[:, [0, 2, 1, 3]].T)) < 0.0)


def test_altered_boxes_are_caught(torus):
    """`verify` passes the atlas and finds every box that was tampered with."""
    atlas, _ = torus
    assert np.all(atlas.verify())
    rng = np.random.default_rng(7)
    chosen = rng.choice(len(atlas.boxes.kappa), 50, replace=False)
    half = atlas.boxes.half.copy()
    half[chosen] *= 4.0
    caught = ~check(closures_of(atlas.problem), atlas.boxes._replace(half=half)).proved
    assert not np.any(np.delete(caught, chosen))
    assert np.mean(caught[chosen]) > 0.9


def test_full_turns_close_on_themselves():
    """A crank's full turn is certified whole, across the seam, and σ agrees with the closed form everywhere."""
    from tests.oracles import four_bar, slider_crank

    for name, closed_form in (("four_bar", four_bar), ("slider_crank", slider_crank)):
        mechanism = ccpin.load(name)
        atlas = certify(mechanism, mechanism.q_reference[:1])
        assert atlas.certified_fraction == 1.0
        assert atlas.single_valued
        assert atlas.radius == pytest.approx(np.pi)
        names = list(mechanism.pin_model.names)[1:]
        for crank in np.linspace(-np.pi, np.pi, 37):
            expected = np.array([closed_form.sigma(crank)[joint] for joint in names])
            assert np.abs(wrap(atlas.sigma(np.array([crank])) - expected)).max() < 1e-12


def test_delta_against_the_spheres():
    """The Delta's workspace cube is certified whole, and σ is the lower intersection of the three spheres."""
    mechanism = ccpin.load("delta")
    atlas = certify(mechanism, np.zeros(3), (np.full(3, -0.3), np.full(3, 0.3)), max_depth=4)
    assert atlas.certified_fraction == 1.0
    assert atlas.single_valued
    names = list(mechanism.pin_model.names)[1:]
    arms = np.random.default_rng(0).uniform(-0.3, 0.3, (40, 3))
    for row, found in zip(arms, atlas.sigma(arms), strict=True):
        expected = delta_oracle.sigma(row)
        assert np.abs(found - [expected[name] for name in names]).max() < 1e-9


def test_planar_3rrr_against_inverse_kinematics():
    """At certified points the platform's pose leads back to the motors; motors of poses nearby are certified."""
    mechanism = ccpin.load("planar_3rrr")
    names = list(mechanism.pin_model.names)[1:]
    q0 = np.array([planar_oracle.inverse(0.0, 0.0, 0.0)[name] for name in mechanism.independent])
    atlas = certify(mechanism, q0, (q0 - 0.25, q0 + 0.25), max_depth=4)
    rng = np.random.default_rng(1)
    points = q0 + 0.25 * rng.uniform(-1, 1, (400, 3))
    points = points[atlas.contains(points)]
    assert len(points) > 200
    for q, q_free in zip(points, atlas.sigma(points), strict=True):
        pose = [q_free[names.index(f"platform_{name}")] for name in ("x", "z", "theta")]
        back = planar_oracle.inverse(*pose)
        assert np.abs(wrap(np.array([back[name] for name in mechanism.independent]) - q)).max() < 1e-9
    for pose in rng.uniform(-1, 1, (30, 3)) * [0.004, 0.004, 0.03]:
        expected = planar_oracle.inverse(*pose)
        q = q0 + wrap(np.array([expected[name] for name in mechanism.independent]) - q0)
        found = atlas.sigma(q)
        assert np.abs(wrap(found - [expected[name] for name in names])).max() < 1e-9


def test_two_sheets_about_a_cusp_are_noticed():
    """Round a cusp of the 3-RPR, either way, σ comes back on two sheets with the same sign of det, and this is said."""
    cusp = cusped.cusp()
    along = cusped.null_direction(cusp) / np.linalg.norm(cusped.null_direction(cusp))
    outer = [np.sign(np.linalg.det(cusped.jacobian(cusp + s * 0.3 * along))) for s in (-1.0, 1.0)]
    assert outer[0] == outer[1]
    poses = [cusp + s * 0.05 * np.array([-along[1], along[0]]) for s in (-1.0, 1.0)]
    pose = next(pose for pose in poses if np.sign(np.linalg.det(cusped.jacobian(pose))) == outer[0])
    seed, middle = cusped.lengths(pose), cusped.lengths(cusp)
    mechanism = cusped_mechanism(pose)
    region = np.minimum(middle - 0.03, seed - 0.01), np.maximum(middle + 0.03, seed + 0.01)
    atlas = certify(mechanism, seed, region, max_depth=7)
    assert atlas.certified_fraction > 0.98
    assert np.all(atlas.verify())
    assert not atlas.single_valued
    names, independent = list(mechanism.pin_model.names)[1:], atlas.problem.system.independent
    leg, turn = names.index("leg"), names.index("turn")
    for pair in atlas.unglued:
        boxes = atlas.boxes.take(pair)
        common = 0.5 * (atlas.lower[pair].max(axis=0) + atlas.upper[pair].min(axis=0))
        found = solve_in_boxes(atlas.problem, boxes, common - boxes.centre[:, independent]).theta
        assert np.abs(wrap(found[0] - found[1])).max() > 0.1
        for row in found:
            reached = np.array([row[leg], row[leg] + row[turn]])
            assert np.abs(cusped.lengths(reached) - common).max() < 1e-9
            assert np.sign(np.linalg.det(cusped.jacobian(reached))) == outer[0]
    check_one_function(atlas)


def check_one_function(atlas):
    """What an atlas with torn faces contains it answers with one continuous σ, its radius ends before they do."""
    torn = [0.5 * (atlas.lower[pair].max(axis=0) + atlas.upper[pair].min(axis=0)) for pair in atlas.unglued]
    across = np.concatenate([[face + side * 1e-9 * np.ones(2) for face in torn] for side in (-1.0, 1.0)])
    assert not np.any(atlas.contains(across).reshape(2, -1).all(axis=0))
    rng = np.random.default_rng(8)
    points = rng.uniform(atlas.region.lower, atlas.region.upper, (4000, 2))
    beside = points + rng.uniform(-1e-4, 1e-4, points.shape)
    both = atlas.contains(points) & atlas.contains(beside)
    assert both.mean() > 0.5
    apart = np.abs(wrap(atlas.sigma(points[both]) - atlas.sigma(beside[both]))).max(axis=1)
    assert np.quantile(apart, 0.99) < 0.01
    assert apart.max() < 0.2
    assert atlas.radius < min(np.abs(face - atlas.q0).max() for face in torn)
    assert domain.certified_radius(atlas, atlas.q0)[0] <= min(np.abs(face - atlas.q0).max() for face in torn)
    with pytest.raises(InvalidInputError, match="with one σ"):
        atlas.sigma(np.mean([atlas.lower[~atlas.one_function][0], atlas.upper[~atlas.one_function][0]], axis=0))


def test_empty_is_proved_beyond_reach(rpdr):
    """In a region where the elbows are too far apart nearly all is proved empty, from a seed at its edge."""
    region, seed = np.radians([(60.0, -40.0), (179.0, 60.0)]), np.radians((80.0, 20.0))
    q1, q2, q3, q4 = oracle.sigma(seed, 1.0)
    atlas = certify(rpdr, seed, region, near=np.array([q1, q3, q2, q4]), max_depth=8)
    points = np.random.default_rng(2).uniform(*region, (50_000, 2))
    beyond = elongation(points) > 1.0
    assert 0.05 < beyond.mean() < 0.95
    assert atlas.empty_fraction > 0.97 * beyond.mean()
    assert not np.any((atlas.status(points) == CellStatus.EMPTY) & ~beyond)
    assert not np.any(atlas.contains(points) & beyond)


def test_save_and_load(torus, tmp_path):
    """What is loaded is what was saved; damaged files and other files are refused, and no partial file is left."""
    atlas, _ = torus
    path = tmp_path / "rpdr.npz"
    atlas.save(path)
    assert [file.name for file in tmp_path.iterdir()] == ["rpdr.npz"]
    back = Atlas.load(path)
    assert same(atlas, back)
    assert back.names == ("joint1", "joint2")
    assert np.all(back.verify())
    points = np.random.default_rng(0).uniform(-np.pi, np.pi, (1000, 2))
    inside = atlas.contains(points)
    assert np.array_equal(back.contains(points), inside)
    assert np.array_equal(back.sigma(points[inside]), atlas.sigma(points[inside]))
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InvalidInputError, match="cannot be read"):
        Atlas.load(path)
    np.savez(path, header=np.frombuffer(b'{"format": "x"}', dtype=np.uint8))
    with pytest.raises(InvalidInputError, match="format"):
        Atlas.load(path)
    atlas.save(tmp_path / "new" / "folder" / "a.npz")
    assert same(atlas, Atlas.load(tmp_path / "new" / "folder" / "a.npz"))
    assert (tmp_path / "new" / "folder" / "a.npz").stat().st_mode & 0o777 == 0o644
    with pytest.raises(InvalidInputError, match="it is a folder"):
        atlas.save(tmp_path)


def test_a_spatial_atlas_survives_its_file(tmp_path):
    """Chains of a spatial mechanism are stored too."""
    mechanism = ccpin.load("delta")
    atlas = certify(mechanism, np.zeros(3), (np.full(3, -0.04), np.full(3, 0.04)), max_depth=2)
    atlas.save(tmp_path / "delta.npz")
    back = Atlas.load(tmp_path / "delta.npz")
    assert same(atlas, back)
    assert np.all(back.verify())


class Flaky(ThreadPoolExecutor):
    """An executor that loses every third task to a broken worker."""

    def __init__(self):
        super().__init__(2)
        self.tasks = self.lost = 0

    def submit(self, function, /, *arguments):
        self.tasks += 1
        if self.tasks % 3:
            return super().submit(function, *arguments)
        self.lost += 1
        future = Future()
        future.set_exception(BrokenProcessPool("killed"))
        return future


@pytest.mark.parametrize("depth", later(5, 7))
def test_executor_does_not_change_the_atlas(rpdr, depth):
    """Serial, worker processes and an executor that loses tasks give the same boxes bit for bit."""
    arguments = {"q0": SEED, "max_depth": depth}
    serial = certify(rpdr, **arguments)
    with ProcessPoolExecutor(2) as pool:
        assert same(serial, certify(rpdr, **arguments, executor=pool))
    with Flaky() as flaky:
        assert same(serial, certify(rpdr, **arguments, executor=flaky))
        assert flaky.lost > 10


def test_a_pool_whose_workers_are_killed(rpdr):
    """Killing a worker process costs nothing but time."""
    serial = certify(rpdr, SEED, max_depth=6)
    with ProcessPoolExecutor(2) as pool:
        waves = []

        def kill(progress):
            waves.append(progress)
            if len(waves) == 10:
                for process in list(pool._processes.values()):
                    os.kill(process.pid, signal.SIGKILL)

        assert same(serial, certify(rpdr, SEED, max_depth=6, executor=pool, progress=kill))
    assert len(waves) > 10


@pytest.mark.parametrize("pool", later(ProcessPoolExecutor, ThreadPoolExecutor))
def test_nobody_else_works_unless_asked(monkeypatch, pool):
    """Long work is done in this thread; two workers are two threads, or processes in NumPy, and give the same atlas."""
    mechanism, region = ccpin.load("delta"), (np.full(3, -0.25), np.full(3, 0.35))
    made, tasks, children = [], [], []

    class Watched(pool):
        def __init__(self, workers, **others):
            made.append(workers)
            super().__init__(workers, **others)

        def submit(self, function, /, *arguments):
            tasks.append(function)
            return super().submit(function, *arguments)

    if pool is ProcessPoolExecutor:
        monkeypatch.setattr(certifying, "compiled", lambda _: False)
    elif ccpin.backend().name == "numpy":
        pytest.skip("NumPy does not let go of the interpreter's lock")
    monkeypatch.setattr(work, pool.__name__, Watched)
    arguments = {"q0": np.zeros(3), "region": region, "max_depth": 4}
    serial = certify(mechanism, **arguments, progress=lambda _: children.extend(multiprocessing.active_children()))
    assert not made
    assert not children
    assert same(serial, certify(mechanism, **arguments, workers=1))
    assert not made
    assert same(serial, certify(mechanism, **arguments, workers=2))
    assert {*made} == {2}
    assert len(tasks) > 10


def test_how_the_work_is_spread_is_checked(rpdr):
    """An executor and workers together, and fewer workers than one, are refused in words."""
    with ThreadPoolExecutor(1) as pool, pytest.raises(InvalidInputError, match="not both"):
        certify(rpdr, SEED, executor=pool, workers=2)
    for workers in (0, -1, 1.5, True):
        with pytest.raises(InvalidInputError, match=r"workers = .* must be a whole number, 1 or more"):
            certify(rpdr, SEED, workers=workers)


@pytest.mark.slow
def test_dask_workers_do_not_change_the_atlas(rpdr):
    """Dask with worker processes of its own gives the same boxes bit for bit."""
    distributed = pytest.importorskip("distributed")
    serial = certify(rpdr, SEED, max_depth=6)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert same(serial, certify(rpdr, SEED, max_depth=6, executor=client.get_executor()))


PROGRAM = """
import os, signal, sys, numpy as np, ccpin
from ccpin.domain import certify
from tests.support.long_cases import later
waves = []
def stop(progress):
    waves.append(progress)
    if len(waves) == 25 and "{how}" == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if len(waves) == 25 and "{how}" == "interrupt":
        os.kill(os.getpid(), signal.SIGINT)
atlas = certify(ccpin.load("rpdr"), np.radians((-108.0, -72.0)), max_depth=7, checkpoint=sys.argv[1], progress=stop)
atlas.save(sys.argv[2])
"""


def test_killed_run_is_resumed(rpdr, tmp_path):
    """After kill -9 the finished chunks are found again, and the second run ends with the same atlas."""
    checkpoint, saved = tmp_path / "chunks", tmp_path / "atlas.npz"
    program = [sys.executable, "-c", PROGRAM.format(how="kill"), str(checkpoint), str(saved)]
    assert subprocess.run(program, check=False).returncode == -signal.SIGKILL
    kept = {file.name: file.stat().st_mtime_ns for file in checkpoint.glob("*.chunk")}
    assert len(kept) > 25
    assert not saved.exists()
    damaged = sorted(kept)[0]
    (checkpoint / damaged).write_bytes(b"half a file")
    again = certify(rpdr, SEED, max_depth=7, checkpoint=checkpoint)
    assert same(again, certify(rpdr, SEED, max_depth=7))
    now = {file.name: file.stat().st_mtime_ns for file in checkpoint.glob("*.chunk")}
    assert len(now) > len(kept)
    assert all(now[name] == kept[name] for name in kept if name != damaged)
    assert now[damaged] != kept[damaged]


@pytest.mark.slow
def test_interrupted_run_keeps_what_is_done(rpdr, tmp_path):
    """Ctrl-C ends the work, not the program: the partial atlas is certified, says so, and can be saved."""
    saved = tmp_path / "atlas.npz"
    program = [sys.executable, "-c", PROGRAM.format(how="interrupt"), str(tmp_path / "chunks"), str(saved)]
    assert subprocess.run(program, check=False).returncode == 0
    atlas = Atlas.load(saved)
    assert not atlas.complete
    assert 10 < len(atlas.boxes.kappa) < len(certify(rpdr, SEED, max_depth=7).boxes.kappa)
    assert np.all(atlas.verify())
    points = np.random.default_rng(0).uniform(-np.pi, np.pi, (20_000, 2))
    assert elongation(points[atlas.contains(points)]).max() < 1.0


def test_a_model_stands_for_its_mechanism(rpdr, rpdr_model):
    """What needs geometry only takes a mechanism or its model; anything else is refused in words."""
    q_free = rpdr_model.sigma(SEED)
    assert same(certify(rpdr, SEED, max_depth=0), certify(rpdr_model, SEED, max_depth=0))
    assert domain.kantorovich_radius(rpdr, q_free) == domain.kantorovich_radius(rpdr_model, q_free)
    assert domain.theorem2(rpdr, q_free).radius == domain.theorem2(rpdr_model, q_free).radius
    path = [SEED, SEED + 0.01]
    assert domain.certify_path(rpdr_model, path).verdict == "proven"
    assert np.array_equal(
        domain.singularity_distance(rpdr, path).measure, domain.singularity_distance(rpdr_model, path).measure
    )
    for function, arguments in ((certify, (SEED,)), (domain.theorem2, (q_free,)), (domain.singularities, ())):
        with pytest.raises(InvalidInputError, match="ReducedModel is needed, not str"):
            function("rpdr", *arguments)


def test_bad_input(rpdr):
    """Wrong shapes, regions, seeds and mechanisms are refused in words."""
    cases = {
        "q must be 2": {"q0": (0.0,)},
        r"\(lower, upper\), each of shape": {"q0": SEED, "region": (0.0, 1.0)},
        "each of shape": {"q0": SEED, "region": np.zeros((3, 2))},
        "outside": {"q0": SEED, "region": ((0.0, 0.0), (1.0, 1.0))},
        "below its upper corner": {"q0": SEED, "region": ((1.0, -3.0), (-3.0, 3.0))},
        "full turn": {"q0": SEED, "region": ((-7.0, -3.0), (7.0, 3.0))},
        "max_depth": {"q0": SEED, "max_depth": 99},
    }
    for message, arguments in cases.items():
        with pytest.raises(InvalidInputError, match=message):
            certify(rpdr, **arguments)
    with pytest.raises(UnreachableError):
        certify(rpdr, np.radians((180.0, 0.0)))
    with pytest.raises(UnsupportedMechanismError, match="6 independent"):
        certify(ccpin.load("stewart"), np.zeros(6))


def test_an_atlas_prints_as_one_line(rpdr):
    """`repr` tells how much is certified, not the boxes."""
    line = repr(certify(rpdr, SEED, max_depth=4))
    assert line.startswith("Atlas(joint1, joint2: ")
    assert line.endswith(" % of the region)")
