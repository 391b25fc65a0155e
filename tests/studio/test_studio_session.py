"""The studio's sessions without a browser: what messages move, prove, simulate, keep and refuse."""

from __future__ import annotations

import base64
import json
import threading
import time
from functools import partial

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.covering.cells import CellStatus
from ccpin.domain import theorem2
from ccpin.errors import InvalidInputError
from ccpin.studio import map_pieces, recorded_run
from ccpin.studio.cache import Cache, fingerprint
from ccpin.studio.dials import Dials
from ccpin.studio.jobs import Cancelled, Jobs
from ccpin.studio.map_pieces import Charted, cells_of
from ccpin.studio.modes_here import Branches
from ccpin.studio.session import Session
from ccpin.studio.subject import Subject
from tests.support.places import SHARED


class Desk:
    """A session, what it said, and orders given to it."""

    def __init__(self, subject):
        self.said = []
        self.session = Session(subject, self.said.append)
        self.subject = subject

    def order(self, do, **what):
        """What the session answers at once."""
        self.session.hear(json.dumps({"do": do, "id": len(self.said), **what}))
        return self.said[-1]

    def result(self, kind, do, **what):
        """What a job answers in the end."""
        before = len(self.said)
        self.session.hear(json.dumps({"do": do, **what}))
        self.session.wait()
        told = [message for message in self.said[before:] if message["kind"] in (kind, "error")]
        assert told, self.said[before:]
        return told[-1]


@pytest.fixture(scope="module")
def subjects(tmp_path_factory):
    cache, made = Cache(tmp_path_factory.mktemp("cache")), {}

    def subject(name):
        return made.setdefault(name, Subject(ccpin.load(name), cache=cache))

    return subject


@pytest.mark.parametrize("name", ["rpdr", "delta", "stewart", "four_bar", "slider_crank", "planar_3rrr"])
def test_driving_is_sigma(subjects, name):
    """A drive ends at σ(q) on the session's branch, bodies, ‖φ‖, D and g are the model's there."""
    desk = Desk(subjects(name))
    model, q = desk.subject.model, np.array(desk.order("hello")["facts"]["q"])
    q = q + 0.01
    pose = desk.order("drive", q=q.tolist())
    state = model.at(desk.subject.dials.q(q))
    assert pose["kind"] == "pose"
    assert pose["stopped"] is None
    assert pose["facts"]["q"] == pytest.approx(q, abs=1e-12)
    assert pose["facts"]["phi"] < 1e-10
    assert np.array(pose["facts"]["D"]) == pytest.approx(state.D, rel=1e-7)
    assert np.array(pose["facts"]["g"]) == pytest.approx(state.g, rel=1e-7, abs=1e-12)
    assert pose["facts"]["rcond"] == pytest.approx(state.rcond, rel=1e-6)
    scene = desk.session._scene
    frames = [f for body, f in zip(scene.bodies, scene.frames(state.q_free), strict=True) if body.joint > 0]
    drawn = np.array(pose["bodies"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    assert drawn == pytest.approx(np.array(frames), abs=1e-8)


def test_it_stops_at_the_edge_and_says_why(subjects):
    """Beyond a singularity it stands where σ was last found, with σ's own words, and drives on from there."""
    desk = Desk(subjects("rpdr"))
    far = [-3.1, 1.4]
    with pytest.raises(ccpin.errors.UnreachableError) as refused:
        desk.subject.model.at(far)
    pose = desk.order("drive", q=far)
    assert pose["stopped"] == str(refused.value)
    assert pose["facts"]["q"] == pytest.approx(refused.value.q_reached, abs=1e-6)
    assert pose["facts"]["phi"] < 1e-10
    assert desk.order("drive", q=[-1.5, -1.5])["stopped"] is None


def test_dragging_is_inverse_kinematics(subjects):
    """The handle comes to the hand; out of reach it comes as near as it can and says so, in one mode all along."""
    desk = Desk(subjects("rpdr"))
    handle = desk.subject.handles["end_effector"]
    assert next(iter(desk.subject.handles)) == "end_effector"
    sign = desk.session.here.point.factor.sign
    target = handle.at(desk.session.here.q_free) + [0.03, 0.0, 0.04]
    pose = desk.order("drag", handle="end_effector", to=target.tolist())
    assert pose["stopped"] is None
    assert handle.at(desk.session.here.q_free) == pytest.approx(target, abs=1e-9)
    off_plane = target + [0.0, 0.2, 0.0]
    desk.order("drag", handle="end_effector", to=off_plane.tolist())
    assert handle.at(desk.session.here.q_free) == pytest.approx(target, abs=1e-9)
    pose = desk.order("drag", handle="end_effector", to=(5 * target).tolist())
    assert "reaches no further" in pose["stopped"]
    assert desk.session.here.point.factor.sign == sign


def test_a_platform_is_dragged_without_turning(subjects):
    """With six coordinates a drag moves the platform and leaves its axes."""
    desk = Desk(subjects("stewart"))
    handle = desk.subject.handles["platform"]
    before = handle._effector.point.pose(desk.session.here.q_free)
    target = before[:3, 3] + [0.01, 0.005, 0.02]
    assert desk.order("drag", handle="platform", to=target.tolist())["stopped"] is None
    after = handle._effector.point.pose(desk.session.here.q_free)
    assert after[:3, 3] == pytest.approx(target, abs=1e-9)
    assert after[:3, :3] == pytest.approx(before[:3, :3], abs=1e-9)


def test_modes_switch_there_and_back(subjects):
    """The other mode shares q and has the other sign of det ψ_q′; the way back leads to the same pose."""
    desk = Desk(subjects("rpdr"))
    first = desk.session.here
    found = desk.result("modes", "modes")
    assert sorted(found["mode"]["signs"]) == [-1, 1]
    other = 1 - found["mode"]["own"]
    pose = desk.order("mode", mode=other)
    assert pose["mode"]["own"] == other
    assert desk.session.here.q == pytest.approx(first.q)
    assert desk.session.here.point.factor.sign == -first.point.factor.sign
    desk.order("drive", q=[-1.4, -1.8])
    desk.order("mode", mode=1 - other)
    desk.order("drive", q=first.q.tolist())
    assert desk.session.here.q_free == pytest.approx(first.q_free, abs=1e-9)
    assert desk.order("mode", mode=7)["kind"] == "error"


def test_a_mode_found_by_nobody_is_one_of_its_own(subjects):
    """Where the search missed the mechanism's own pose it is added."""
    here = subjects("rpdr").reference
    branches = Branches(subjects("rpdr").likeness, [], here)
    assert branches.told() == {"signs": [int(here.point.factor.sign)], "own": 0}
    assert Branches.unknown().told()["signs"] == []


def test_the_chart_is_the_atlas_and_is_kept(tmp_path):
    """The cells are those of `certify`; a second session gets them from the cache, and of the other mode others."""
    subject = Subject(ccpin.load("four_bar"), cache=Cache(tmp_path))
    chart = Desk(subject).result("chart", "chart")
    atlas = domain.certify(subject.mechanism, subject.dials.values(subject.reference.q))
    cells = np.frombuffer(base64.b64decode(chart["cells"]["corners"]), dtype=np.float32).reshape(-1, 2, 1)
    status = np.frombuffer(base64.b64decode(chart["cells"]["status"]), dtype=np.uint8)
    widths = (cells[:, 1] - cells[:, 0])[:, 0]
    share = widths[status == CellStatus.CERTIFIED].sum() / float(np.ptp(chart["region"]))
    assert share == pytest.approx(atlas.certified_fraction, abs=1e-5)
    assert "from the cache" not in chart["words"]
    assert "from the cache" in Desk(subject).result("chart", "chart")["words"]
    desk = Desk(subject)
    desk.result("modes", "modes")
    desk.order("mode", mode=1)
    assert "from the cache" not in desk.result("chart", "chart")["words"]


def test_a_damaged_cache_is_no_cache(subjects, tmp_path):
    """Files that cannot be read are made anew; a folder that cannot be written keeps nothing and stops nothing."""
    subject = Subject(subjects("four_bar").mechanism, cache=Cache(tmp_path))
    Desk(subject).result("chart", "chart")
    (kept,) = tmp_path.glob("atlas-*.npz")
    kept.write_bytes(b"PK nonsense")
    assert "from the cache" not in Desk(subject).result("chart", "chart")["words"]
    (tmp_path / "file").write_text("")
    nowhere = Subject(subjects("four_bar").mechanism, cache=Cache(tmp_path / "file" / "folder"))
    assert Desk(nowhere).result("chart", "chart")["kind"] == "chart"


def test_the_fingerprint_is_of_the_closures(subjects):
    """The same file has the same fingerprint, another size another."""
    from ccpin.domain.closures.seeds import scalar_coordinates_at, seed_at_coordinates

    def key(name):
        mechanism = ccpin.load(name)
        seed = seed_at_coordinates(mechanism, scalar_coordinates_at(mechanism, mechanism.q_reference))
        return fingerprint(seed.reading, kind="atlas")

    assert key("rpdr") == key("rpdr") != key("four_bar")


def test_the_cache_makes_room(tmp_path, monkeypatch):
    """What was not asked for longest goes first."""
    monkeypatch.setattr("ccpin.studio.cache.ROOM", 3000)
    cache, noise = Cache(tmp_path), np.random.default_rng(0)
    for k in range(4):
        cache.save(f"atlas-{k}", {"a": noise.integers(0, 255, 900, dtype=np.uint8)})
        time.sleep(0.02)
    assert cache.load("atlas-3") is not None
    assert cache.load("atlas-0") is None


@pytest.mark.slow
def test_slices_follow_the_other_coordinates(subjects):
    """A sampled slice is finite where σ is, with 1/κ(ψ) of the State there; wrong axes are refused."""
    desk = Desk(subjects("stewart"))
    found = desk.result("slice", "slice", axes=[0, 1])
    samples = found["samples"]
    j, i = 20, 30
    q = desk.subject.dials.values(desk.session.here.q)
    q[:2] = samples["x"][i], samples["y"][j]
    assert samples["value"][j][i] == pytest.approx(desk.subject.model.at(q).rcond, rel=1e-6)
    for axes in ([0, 0], [0, 6], [0], "01", [True, 0]):
        assert desk.order("slice", axes=axes)["kind"] == "error"


@pytest.mark.slow
def test_what_is_proved_takes_the_place_of_samples(subjects, monkeypatch):
    """A slice sampled before there was an atlas is neither kept for an exported page nor told after the atlas."""
    monkeypatch.setattr(map_pieces, "certify", partial(domain.certify, max_depth=5))
    monkeypatch.setattr(map_pieces, "singularities", partial(domain.singularities, starts=10))
    flood, sampled = map_pieces.flood, []

    def late(*arguments):
        """The second one takes as long as anybody wants it, for ten seconds at most."""
        sampled.append(arguments[-1])
        until = time.monotonic() + 10.0
        while len(sampled) > 1 and sampled[-1].wanted and time.monotonic() < until:
            time.sleep(0.01)
        return flood(*arguments, grid=9)

    monkeypatch.setattr(map_pieces, "flood", late)
    desk = Desk(subjects("rpdr"))
    desk.result("slice", "slice", axes=[0, 1])
    desk.order("slice", axes=[0, 1])
    desk.result("chart", "chart")
    assert len(sampled) == 2
    assert desk.said[-1]["kind"] == "chart"
    kinds = [message["kind"] for message in desk.said]
    assert kinds.count("slice") == 1
    assert '"kind": "slice"' not in base64.b64decode(desk.order("export")["content"]).decode()


def test_the_square_is_theorem_2(subjects):
    """Its radius is Theorem 2's about where the mechanism is."""
    desk = Desk(subjects("rpdr"))
    desk.order("drive", q=[-1.8, -1.3])
    square = desk.result("square", "square")
    assert square["centre"] == pytest.approx([-1.8, -1.3])
    assert square["radius"] == pytest.approx(theorem2(desk.subject.mechanism, desk.session.here.q_free).radius)


@pytest.mark.slow
def test_the_sublevel_is_certified_and_its_edge_is_at_c(subjects):
    """c is `certify_set_point`'s, and 𝒱 is c along the edge drawn."""
    desk = Desk(subjects("rpdr"))
    gains = desk.order("gains", law="simple")
    what = {"axes": [0, 1], "K_p": gains["K_p"], "K_v": gains["K_v"], "duration": 1.0}
    model, goal = desk.subject.model, desk.session.goal
    atlas = domain.certify(desk.subject.mechanism, goal.q, (goal.q - 0.5, goal.q + 0.5))
    desk.session._maps.charted = Charted(cells_of(atlas), atlas, False)
    found = desk.result("sublevel", "sublevel", **what)
    certificate = ccpin.control.certify_set_point(model, goal.q, gains["K_p"], gains["K_v"], atlas)
    assert found["level"] == pytest.approx(certificate.level)
    assert found["verdict"] == certificate.verdict == "proven"
    (edge,) = found["lines"]
    law = ccpin.control.PDSimpleGravity(model, goal.q, gains["K_p"], gains["K_v"])
    levels = [law.lyapunov(np.array(q), np.zeros(2)) for q in edge[::10]]
    assert levels == pytest.approx([found["level"]] * len(levels), rel=5e-3)


@pytest.mark.parametrize("law", list(recorded_run.LAWS))
def test_experiments_are_simulate(subjects, law):
    """A run in pieces is the motion of one `simulate`; 𝒱 never rises; the motion is played in the scene."""
    desk = Desk(subjects("rpdr"))
    start, goal = np.array([-2.2, -2.2]), np.array([-1.4, -1.6])
    desk.order("drive", q=goal.tolist())
    desk.order("goal")
    gains = desk.order("gains", law=law)
    desk.order("drive", q=start.tolist())
    asked = {"law": law, "K_p": gains["K_p"], "K_v": gains["K_v"], "duration": 0.8}
    motion = desk.result("motion", "simulate", **asked)
    assert motion["status"] == "finished"
    model = desk.subject.model
    plan = recorded_run.RunPlan.of(asked, model.at(goal))
    whole = ccpin.simulate(model, recorded_run.law_of(model, plan, model.at(start)), start, duration=0.8)
    assert motion["t"][-1] == pytest.approx(0.8)
    assert [row[-1] for row in motion["q"]] == pytest.approx(whole.q[-1], abs=1e-7)
    assert np.abs(np.array([row[-1] for row in motion["q"]]) - goal).max() < 0.05
    assert motion["closure"] < 1e-10
    level = np.array(motion["lyapunov"])
    rises = np.diff(level).max()
    assert rises < 1e-9 or law == "computed"  # about a moving reference it begins at zero
    assert motion["commands"]


def test_scrubbing_moves_the_mechanism(subjects):
    """The session stands at the sample looked at, and drives on from there."""
    desk = Desk(subjects("rpdr"))
    assert desk.order("at", sample=3)["kind"] == "error"
    desk.order("drive", q=[-1.9, -1.5])
    gains = desk.order("gains", law="full")
    motion = desk.result("motion", "simulate", law="full", duration=0.3, K_p=gains["K_p"], K_v=gains["K_v"])
    k = len(motion["t"]) // 2
    pose = desk.order("at", sample=motion["sample"][k])
    assert pose["facts"]["q"] == pytest.approx([row[k] for row in motion["q"]])
    assert pose["bodies"] is None


def test_recording_keeps_what_was_driven(subjects, tmp_path):
    """The recorded motion goes through the poses driven, and its file loads as a trajectory."""
    desk = Desk(subjects("rpdr"))
    assert desk.order("record")["on"]
    for k in range(12):
        desk.order("drive", q=[-1.57 + 0.02 * k, -1.57])
        time.sleep(0.005)
    motion = desk.result("motion", "record")
    assert [row[-1] for row in motion["q"]] == pytest.approx([-1.57 + 0.22, -1.57])
    assert motion["closure"] < 1e-10
    saved = desk.order("save", format="npz")
    path = tmp_path / saved["name"]
    path.write_bytes(base64.b64decode(saved["content"]))
    loaded = ccpin.Trajectory.load(path)
    assert loaded.q[-1] == pytest.approx(desk.session.here.q)
    assert desk.order("save", format="exe")["kind"] == "error"
    desk.order("record")
    assert "fewer than three" in desk.result("motion", "record")["words"]


def test_the_exported_page_needs_nothing(subjects):
    """One page with its scene and what was told, and no outside reference."""
    desk = Desk(subjects("four_bar"))
    desk.result("chart", "chart")
    page = base64.b64decode(desk.order("export")["content"]).decode()
    assert "replay = [{" in page
    assert '"kind": "chart"' in page
    assert "<link" not in page.replace('<link rel="icon" href="data:,">', "")
    assert "src=" not in page.partition("<script>")[0]


NONSENSE = [
    "",
    "][",
    "[]",
    "7",
    "null",
    "{}",
    '{"do": 3}',
    '{"do": ["drive"]}',
    '{"do": "fly"}',
    '{"do": "drive"}',
    '{"do": "drive", "q": [1]}',
    '{"do": "drive", "q": [1, null]}',
    '{"do": "drive", "q": [1, NaN]}',
    '{"do": "drive", "q": [1, 1e999]}',
    '{"do": "drive", "q": "far"}',
    '{"do": "drive", "q": {"joint1": 1}}',
    '{"do": "drag", "handle": "nose", "to": [0, 0, 0]}',
    '{"do": "drag", "handle": "end_effector", "to": [0, 0]}',
    '{"do": "mode", "mode": -1}',
    '{"do": "mode", "mode": "x"}',
    '{"do": "simulate", "law": "magic", "K_p": [1, 1], "K_v": [1, 1], "duration": 1}',
    '{"do": "simulate", "law": "full", "K_p": [1], "K_v": [1, 1], "duration": 1}',
    '{"do": "simulate", "law": "full", "K_p": [1, 1], "K_v": [1, 1], "duration": 1e9}',
    '{"do": "simulate", "law": "full", "K_p": [1, 1], "K_v": [1, 1], "duration": -1}',
    '{"do": "goal", "q": [9]}',
    '{"do": "save"}',
    "[" * 100000,
    b"\xff\xfe",
]


@pytest.mark.parametrize("text", NONSENSE, ids=range(len(NONSENSE)))
def test_nonsense_is_answered_and_nothing_dies(subjects, text):
    """Every message that cannot be done is answered by an error in words, and moves nothing."""
    desk = Desk(subjects("rpdr"))
    before = desk.session.here
    desk.session.hear(text)
    desk.session.wait()
    assert desk.said[-1]["kind"] == "error"
    assert desk.said[-1]["words"]
    assert desk.session.here is before
    assert desk.order("hello")["kind"] == "pose"


def test_bad_gains_are_told_by_the_job(subjects):
    """What only the law finds wrong comes as the job's error."""
    desk = Desk(subjects("rpdr"))
    told = desk.result("motion", "simulate", law="full", K_p=[-1, 1], K_v=[1, 1], duration=1)
    assert told["kind"] == "error"
    assert "positive definite" in told["words"]


def test_sliders_go_on_while_an_atlas_is_made(subjects, tmp_path):
    """Drives are answered while a chart is under way, and closing the session ends its work."""
    subject = Subject(subjects("delta").mechanism, cache=Cache(tmp_path))
    desk = Desk(subject)
    desk.order("chart")
    for k in range(20):
        assert desk.order("drive", q=[0.002 * k] * 3)["kind"] == "pose"
    assert threading.active_count() > 1
    desk.session.close()
    deadline = time.monotonic() + 30
    while any(thread.name == "ccpin-chart" for thread in threading.enumerate()) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(thread.name == "ccpin-chart" for thread in threading.enumerate())
    assert not list(tmp_path.glob("*.npz"))


def test_a_newer_order_takes_the_older_ones_place():
    """Of two jobs of one name the older is cancelled and says nothing any more."""
    said, gate = [], threading.Event()

    def slow(job):
        gate.wait(10)
        job.check()
        return lambda: {"kind": "slow"}

    jobs = Jobs(said.append, threading.RLock())
    jobs.start("work", slow)
    old = jobs._running["work"][1]
    jobs.start("work", lambda job: lambda: {"kind": "new"})
    jobs.wait(10)
    gate.set()
    old.join(10)
    assert said == [{"kind": "new"}]
    assert issubclass(Cancelled, Exception)


def test_two_sessions_do_not_meet(subjects):
    """Each page has its own state."""
    one, two = Desk(subjects("rpdr")), Desk(subjects("rpdr"))
    one.order("drive", q=[-1.9, -1.3])
    assert two.order("hello")["facts"]["q"] == pytest.approx(two.subject.dials.values(two.subject.reference.q))


def test_dials_of_every_kind_of_coordinate():
    """Numbers and back: circles as angles, balls as turns from the reference."""
    if not SHARED.is_dir():
        pytest.skip(f"no {SHARED}: these files belong to others")
    generator = np.random.default_rng(5)
    for name in ("mini_cheetah_leg.urdf", "cassie_closed_chain.xml"):
        model = ccpin.ReducedModel(ccpin.load(SHARED / name))
        dials = Dials(model)
        assert len(dials.each) == model.n
        reference = dials.values(model.alpha(model.mechanism.q_reference))
        for _ in range(20):
            values = reference + generator.uniform(-0.4, 0.4, model.n)
            assert dials.values(dials.q(values)) == pytest.approx(values, abs=1e-9)
        assert all(dial.lower <= value <= dial.upper for dial, value in zip(dials.each, reference, strict=True))
        with pytest.raises(InvalidInputError, match="finite numbers"):
            dials.q([0.0])


def test_what_cannot_move_is_refused():
    """A mechanism of mobility 0 has nothing to drive."""
    locked = ccpin.load("four_bar", locked=["crank"])
    with pytest.raises(ccpin.errors.UnsupportedMechanismError, match="nothing to drive"):
        Subject(locked)
