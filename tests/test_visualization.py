"""Pictures: what the pages hold against Pinocchio's own URDF reader, and what Chromium shows of them."""

from __future__ import annotations

import base64
import json
import re
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from hypothesis import given, settings
from hypothesis import strategies as st

import ccpin
from browser import screenshot
from ccpin import visualization
from ccpin.errors import InvalidInputError
from ccpin.visualization.camera import ASPECT, FIELD_OF_VIEW, FILL, frame_points, plane_normal
from ccpin.visualization.live import LiveRecorder
from ccpin.visualization.page import Recorder
from ccpin.visualization.shapes import corners, parts, read_mesh, tube

ROOT = Path(__file__).parents[1]
MODELS = ROOT / "models"
SHARED = ROOT.parent / "shared" / "models"


@pytest.fixture(scope="module")
def rpdr():
    return ccpin.load("rpdr")


@pytest.fixture(scope="module")
def swing(rpdr):
    """Two seconds of the five-bar from (−150°, −160°) to (−90°, −100°), a sample every 1/30 s."""
    model = ccpin.ReducedModel(rpdr)
    t = np.arange(61) / 30
    share = (1 - np.cos(np.pi * t / 2)) / 2
    poses = [model.sigma(q) for q in np.deg2rad([-150.0, -160.0]) + share[:, None] * np.deg2rad([60.0, 60.0])]
    return t, np.array(poses)


def messages(path):
    """The MeshCat messages of a page, decoded."""
    found = re.search(r"^const commands = (\[.*\]);$", Path(path).read_text(encoding="utf-8"), re.MULTILINE)
    return [umsgpack.unpackb(base64.b64decode(text)) for text in json.loads(found.group(1))]


def transforms(path):
    """4×4 transforms by MeshCat path."""
    found = [m for m in messages(path) if m["type"] == "set_transform"]
    return {m["path"]: np.array(m["matrix"]).reshape(4, 4).T for m in found}


def animation(path):
    (message,) = [m for m in messages(path) if m["type"] == "set_animation"]
    return message


def bare(mechanism):
    """The same mechanism without a single visual."""
    links = tuple(replace(link, visuals=()) for link in mechanism.description.links)
    return replace(mechanism, description=replace(mechanism.description, links=links))


def urdf_frames(file, mechanism, q_free):
    """World frames of all links by Pinocchio's own reader of the URDF file, joint by joint name."""
    model = pin.buildModelFromUrdf(str(file))
    q = pin.neutral(model)
    for name in model.names[1:]:
        theirs, ours = model.getJointId(name), mechanism.pin_model.getJointId(name)
        start, count = mechanism.pin_model.idx_qs[ours], model.nqs[theirs]
        q[model.idx_qs[theirs] : model.idx_qs[theirs] + count] = q_free[start : start + count]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return {f.name: data.oMf[i].homogeneous for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}


def test_importing_draws_in_neither_meshcat_nor_its_friends():
    """`import ccpin.visualization` stays light."""
    heavy = "meshcat", "trimesh", "tornado", "IPython"
    code = f"import sys, ccpin.visualization; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_page_is_self_contained(rpdr, swing, tmp_path):
    """Nothing in the page is loaded from elsewhere: no address but XML namespaces, no script, link or image source."""
    text = visualization.animate(rpdr, *swing, tmp_path / "a.html").read_text(encoding="utf-8")
    assert set(re.findall(r"https?://[\w./-]+", text)) <= {"http://www.w3.org/1999/xhtml"}
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"<link|\ssrc\s*=|\shref\s*=|url\(|@import", markup)


@pytest.mark.parametrize(("fps", "speed", "frames"), [(30, 1.0, 61), (30, 2.0, 31), (10, 0.5, 41), (7, 1.0, 15)])
def test_animation_has_the_frames_asked_for(rpdr, swing, tmp_path, fps, speed, frames):
    """⌈duration · fps / speed⌉ + 1 frames, played automatically and for ever."""
    message = animation(visualization.animate(rpdr, *swing, tmp_path / "a.html", fps=fps, speed=speed))
    assert message["options"] == {"play": True, "repetitions": np.inf}
    for clip in message["animations"]:
        assert clip["clip"]["fps"] == fps
        assert {len(track["keys"]) for track in clip["clip"]["tracks"]} == {frames}
        assert [key["time"] for key in clip["clip"]["tracks"][0]["keys"]] == list(range(frames))


def test_every_frame_is_the_forward_kinematics(rpdr, swing, tmp_path):
    """Each link's key frames equal the link frames of Pinocchio's own URDF reader."""
    t, q_free = swing
    clips = animation(visualization.animate(rpdr, t, q_free, tmp_path / "a.html"))["animations"]
    moving = {clip["path"].rpartition("/")[2]: clip["clip"]["tracks"] for clip in clips}
    assert set(moving) == {"link1", "link2", "link3", "link4"}
    for k, pose in enumerate(q_free):
        frames = urdf_frames(MODELS / "rpdr.urdf", rpdr, pose)
        for name, tracks in moving.items():
            position, quaternion = (np.array(track["keys"][k]["value"]) for track in tracks)
            assert position == pytest.approx(frames[name][:3, 3], abs=1e-12)
            assert pin.Quaternion(quaternion).matrix() == pytest.approx(frames[name][:3, :3], abs=1e-12)


@pytest.mark.parametrize("name", ["rpdr", "slider_crank", "bennett", "planar_3rrr"])
def test_snapshot_places_links_by_forward_kinematics(name, tmp_path):
    """Each link's transform in a snapshot equals Pinocchio's own URDF reader's frame."""
    mechanism = ccpin.load(name)
    placed = transforms(visualization.snapshot_html(mechanism, None, tmp_path / "s.html"))
    frames = urdf_frames(MODELS / f"{name}.urdf", mechanism, mechanism.q_reference)
    drawn = [link.name for link in mechanism.description.links if link.visuals]
    assert drawn
    for link in drawn:
        assert placed[f"/meshcat/{mechanism.name}/{link}"] == pytest.approx(frames[link], abs=1e-12)


TOOL = """<link name="tool"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>
<joint name="mount" type="fixed"><parent link="link3"/><child link="tool"/>
<origin xyz="0.1 0.02 0.03" rpy="0.3 0.2 0.1"/></joint></robot>"""


def test_fixed_links_and_turned_joints_are_placed_too(tmp_path):
    """A tool welded to a link, and a continuous joint about −y, still stand where Pinocchio's URDF reader puts them."""
    file = tmp_path / "tooled.urdf"
    text = (MODELS / "rpdr.urdf").read_text(encoding="utf-8").replace("</robot>", TOOL)
    file.write_text(text.replace('name="joint3" type="revolute"', 'name="joint3" type="continuous"'), encoding="utf-8")
    mechanism = ccpin.load(file)
    assert mechanism.nq == 5
    placed = transforms(visualization.snapshot_html(mechanism, None, tmp_path / "s.html"))
    frames = urdf_frames(file, mechanism, mechanism.q_reference)
    for link in ("link3", "tool"):
        assert placed[f"/meshcat/rpdr/{link}"] == pytest.approx(frames[link], abs=1e-12)


def test_cylinders_lie_along_z_of_their_visual(rpdr, tmp_path):
    """MeshCat's cylinders lie along y: their nodes turn y into the visual's z axis."""
    placed = transforms(visualization.snapshot_html(rpdr, None, tmp_path / "s.html"))
    link = next(link for link in rpdr.description.links if link.name == "link1")
    assert link.visuals[1].shape.kind == "cylinder"
    node = placed["/meshcat/rpdr/link1/visual1"]
    assert node[:3, 1] == pytest.approx(link.visuals[1].placement[:3, 2], abs=1e-12)
    assert node[:3, 3] == pytest.approx(link.visuals[1].placement[:3, 3], abs=1e-12)


def test_frames_between_samples_lie_on_the_geodesic(tmp_path):
    """Half way between two attitudes the base has turned half the angle, half way along."""
    mechanism = ccpin.load("rpdr", floating_base=True)
    end = mechanism.q_reference.copy()
    end[:7] = [0.0, 0.0, 0.4, 0.0, 0.0, np.sin(0.5), np.cos(0.5)]
    page = visualization.animate(mechanism, [0.0, 1.0], [mechanism.q_reference, end], tmp_path / "a.html", fps=2)
    tracks = next(c for c in animation(page)["animations"] if c["path"].endswith("/base"))["clip"]["tracks"]
    assert tracks[1]["keys"][1]["value"] == pytest.approx([0.0, 0.0, np.sin(0.25), np.cos(0.25)], abs=1e-12)
    assert tracks[0]["keys"][1]["value"][2] == pytest.approx(0.2, abs=1e-12)


def test_trace_follows_the_loop_point(rpdr, swing, tmp_path):
    """Every vertex of the traced tube lies within its radius of the end effector's path."""
    t, q_free = swing
    name = rpdr.closures[0].name
    page = visualization.animate(rpdr, t, q_free, tmp_path / "a.html", trace=name)
    (drawn,) = [m for m in messages(page) if m["type"] == "set_object" and m["path"].endswith("/trace")]
    raw = drawn["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data
    vertices = np.frombuffer(raw, dtype=np.float32).reshape(-1, 3)
    closure = rpdr.closures[0]
    frames = [urdf_frames(MODELS / "rpdr.urdf", rpdr, pose)[closure.link_a] for pose in q_free]
    path = np.array([(frame @ closure.placement_a)[:3, 3] for frame in frames])
    distances = np.linalg.norm(vertices[:, None] - path[None], axis=2).min(axis=1)
    radius = 0.006 * np.linalg.norm(np.ptp(path, axis=0))
    assert distances.max() == pytest.approx(radius, rel=1e-3)


def test_tube_is_as_thick_as_asked_for():
    """Around a circle, each vertex is `radius` from the circle and each ring lies across it."""
    angles = np.linspace(0, 1.5 * np.pi, 200)
    circle = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    vertices = tube(circle, 0.01).vertices
    across = np.hypot(np.hypot(vertices[:, 0], vertices[:, 1]) - 1, vertices[:, 2])
    assert across == pytest.approx(0.01, rel=1e-3)
    assert tube(np.zeros((5, 3)), 0.01) is None


def bad_inputs():
    t, q = np.array([0.0, 1.0]), np.zeros((2, 4))
    return {
        "t too short": ((t[:1], q), {}, r"give \(2,\)"),
        "one sample": ((t[:1], q[:1]), {}, "at least two samples"),
        "narrow q_free": ((t, q[:, :3]), {}, "nq = 4"),
        "flat q_free": ((t, q[0]), {}, "nq = 4"),
        "words": ((t, "poses"), {}, "not an array of numbers"),
        "t stands still": (([1.0, 1.0], q), {}, "increase strictly"),
        "t turns back": (([1.0, 0.0], q), {}, "increase strictly"),
        "t not finite": (([0.0, np.inf], q), {}, "not finite"),
        "q_free not finite": ((t, [[0, 0, 0, 0], [0, np.nan, 0, 0]]), {}, r"q_free\[1\] is not finite"),
        "no fps": ((t, q), {"fps": 0}, "fps must be a positive number"),
        "negative speed": ((t, q), {"speed": -1.0}, "speed must be a positive number"),
        "too many frames": ((t, q), {"speed": 1e-6}, "frames are too many"),
        "unknown trace": ((t, q), {"trace": "tail"}, "trace 'tail' names no link"),
    }


@pytest.mark.parametrize("case", bad_inputs())
def test_bad_input_is_refused_and_leaves_no_file(rpdr, tmp_path, case):
    """A sentence that says what is wrong, and nothing on the disk."""
    arguments, options, sentence = bad_inputs()[case]
    with pytest.raises(InvalidInputError, match=sentence):
        visualization.animate(rpdr, *arguments, tmp_path / "a.html", **options)
    assert list(tmp_path.iterdir()) == []


def test_configuration_off_its_sphere_is_refused(tmp_path):
    """A quaternion of length 2 is no attitude."""
    mechanism = ccpin.load("rpdr", floating_base=True)
    pose = mechanism.q_reference.copy()
    pose[3:7] *= 2
    with pytest.raises(InvalidInputError, match="unit length"):
        visualization.snapshot_html(mechanism, pose, tmp_path / "s.html")


@pytest.mark.parametrize(("place", "sentence"), [("absent/a.html", "does not exist"), (".", "is a folder")])
def test_unwritable_path_is_refused(rpdr, swing, tmp_path, place, sentence):
    """The path is checked before the work is done."""
    with pytest.raises(InvalidInputError, match=sentence):
        visualization.animate(rpdr, *swing, tmp_path / place)


def test_failed_write_keeps_the_old_file(rpdr, swing, tmp_path, monkeypatch):
    """If the disk is full the previous page is still there, whole, and no partial file beside it."""
    target = tmp_path / "a.html"
    target.write_text("before")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ccpin.visualization.page.os.replace", full)
    with pytest.raises(InvalidInputError, match="No space left"):
        visualization.animate(rpdr, *swing, target)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.html", "before")]


def test_title_is_text_not_markup(rpdr, tmp_path):
    """A title with markup, or with the template's own marks, is shown as written."""
    text = visualization.snapshot_html(rpdr, None, tmp_path / "s.html", title="<b>&@CLOCK@").read_text()
    assert text.count("&lt;b&gt;&amp;@CLOCK@") == 2
    assert "<b>&" not in text


SHAPES = {
    "box": (ccpin.Shape("box", (1.0, 2.0, 3.0)), [0.5, 1.0, 1.5]),
    "cylinder": (ccpin.Shape("cylinder", (0.5, 3.0)), [0.5, 0.5, 1.5]),
    "capsule": (ccpin.Shape("capsule", (0.5, 3.0)), [0.5, 0.5, 2.0]),
    "sphere": (ccpin.Shape("sphere", (0.7,)), [0.7, 0.7, 0.7]),
    "ellipsoid": (ccpin.Shape("ellipsoid", (0.1, 0.2, 0.3)), [0.1, 0.2, 0.3]),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_parts_of_a_shape_span_its_corners(kind):
    """The drawn parts, measured as three.js builds them, just fill the box that the camera frames."""
    shape, half = SHAPES[kind]
    lows, highs = [], []
    for part in parts(shape):
        data = part.geometry.lower({})
        size = {
            "BoxGeometry": lambda d: [d["width"] / 2, d["height"] / 2, d["depth"] / 2],
            "CylinderGeometry": lambda d: [d["radiusTop"], d["height"] / 2, d["radiusTop"]],
            "SphereGeometry": lambda d: [d["radius"]] * 3,
        }[data["type"]](data)
        frame = part.placement @ part.geometry.intrinsic_transform()
        extent = np.abs(frame[:3, :3]) @ size
        lows.append(frame[:3, 3] - extent)
        highs.append(frame[:3, 3] + extent)
    assert np.max(highs, axis=0) == pytest.approx(half)
    assert np.min(lows, axis=0) == pytest.approx(-np.array(half))
    assert corners(shape).max(axis=0) == pytest.approx(half)
    assert corners(shape).min(axis=0) == pytest.approx(-np.array(half))


@pytest.mark.parametrize("suffix", ["obj", "stl", "dae"])
def test_meshes_are_read(tmp_path, suffix):
    """A box written in each format comes back with its corners, scaled; its sharp edges keep their own normals."""
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / f"box.{suffix}"
    trimesh.creation.box((1.0, 2.0, 3.0)).export(path)
    shape = ccpin.Shape("mesh", (2.0, 1.0, 1.0), mesh=str(path))
    assert np.abs(corners(shape)) == pytest.approx(np.tile([1.0, 1.0, 1.5], (8, 1)))
    assert len(read_mesh(str(path)).vertices) == 24


def test_missing_or_broken_mesh_is_left_out_with_a_note(rpdr, tmp_path):
    """The rest of the mechanism is drawn, and the notes say what is not."""
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid nothing")
    meshes = tuple(ccpin.Visual(ccpin.Shape("mesh", (1.0, 1.0, 1.0), mesh=str(m))) for m in ("absent.obj", broken))
    links = tuple(
        replace(link, visuals=link.visuals + meshes * (link.name == "link1")) for link in rpdr.description.links
    )
    mechanism = replace(rpdr, description=replace(rpdr.description, links=links))
    scene = visualization.view(mechanism, open_browser=False)
    scene.close()
    assert len(scene.notes) == 2
    assert "link 'link1': mesh 'absent.obj' is not there" in scene.notes[0]
    assert "broken.stl" in scene.notes[1]


@pytest.mark.parametrize("name", ["rpdr", "stewart", "delta", "slider_crank"])
def test_skeleton_marks_every_joint_and_loop(name):
    """Without visuals, a ball sits at both ends of each closure, and something at each joint's origin."""
    mechanism = bare(ccpin.load(name))
    with visualization.view(mechanism, open_browser=False) as viewer:
        assert "skeleton" in viewer.notes[0]
        frames = viewer.scene.frames(mechanism.q_reference)
        bodies = viewer.scene.bodies
    marks = [
        f @ v.placement for f, b in zip(frames, bodies, strict=True) for v in b.visuals if v.shape.kind != "capsule"
    ]
    marked = np.array([mark[:3, 3] for mark in marks])
    data = mechanism.pin_model.createData()
    pin.forwardKinematics(mechanism.pin_model, data, mechanism.q_reference)
    expected = [data.oMi[j].translation for j in range(1, mechanism.pin_model.njoints)]
    for closure in mechanism.closures:
        for link, placement in ((closure.link_a, closure.placement_a), (closure.link_b, closure.placement_b)):
            carrier = mechanism.tree.attachments[link]
            expected.append((data.oMi[carrier.joint].homogeneous @ carrier.placement @ placement)[:3, 3])
    for point in expected:
        assert np.linalg.norm(marked - point, axis=1).min() < 1e-9


@pytest.mark.parametrize(
    ("name", "normal"),
    [
        ("rpdr", [0, 1, 0]),
        ("planar_3rrr", [0, 1, 0]),
        ("delta", None),
        ("stewart", None),
        ("bennett", None),
        ("sarrus", None),
    ],
)
def test_plane_of_motion(name, normal):
    """Planar mechanisms know their plane; Bennett's and Sarrus' linkages have none."""
    found = plane_normal(ccpin.load(name))
    if normal is None:
        assert found is None
    else:
        assert np.abs(found) == pytest.approx(normal, abs=1e-12)


coordinate = st.floats(-3, 3).map(lambda x: round(x, 3))
point = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=100, deadline=None)
@given(
    points=st.lists(point, min_size=2, max_size=12, unique=True),
    azimuth=st.floats(-3, 3),
    elevation=st.floats(-1.5, 1.5),
)
def test_camera_sees_all_points_as_large_as_it_can(points, azimuth, elevation):
    """Projected through a look-at camera, all points are inside the share of the frame, and one touches its edge."""
    points = np.array(points)
    direction = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    framing = frame_points(points, direction, np.eye(3))
    seen = points @ framing.origin[:3, :3].T + framing.origin[:3, 3] - framing.distance * direction
    right = np.cross(-direction, [0, 0, 1])
    right /= np.linalg.norm(right)
    depth = -seen @ direction
    assert np.all(depth > 0)
    edge = FILL * np.tan(np.deg2rad(FIELD_OF_VIEW) / 2)
    wide = np.abs(seen @ right / depth).max()
    high = np.abs(seen @ np.cross(direction, right) / depth).max()
    assert (wide, high) == pytest.approx((framing.half_width, framing.half_height), rel=1e-9, abs=1e-12)
    largest = max(wide / (ASPECT * edge), high / edge)
    assert largest <= 1 + 1e-9
    span = np.ptp(points, axis=0)
    if min(np.ptp(points @ right), np.ptp(points @ np.cross(direction, right))) > 0.1 * np.linalg.norm(span):
        assert largest == pytest.approx(1, rel=1e-9)


def test_recorder_forgets_what_is_overridden(rpdr, swing):
    """Moving a mechanism many times costs no memory."""
    meshcat = pytest.importorskip("meshcat")
    recorder = Recorder()
    scene = visualization.Scene(rpdr, meshcat.Visualizer(window=recorder))
    for pose in swing[1]:
        scene.place(pose)
        once = len(recorder.commands)
    scene.place(swing[1][0])
    assert len(recorder.commands) == once
    assert len({umsgpack.unpackb(c)["path"] for c in recorder.commands if b"set_transform" in c}) > 4


def test_live_viewer_serves_on_loopback_and_stops(rpdr, swing):
    """The page is served on 127.0.0.1 only, and after closing neither the port nor the thread is left."""
    before = threading.active_count()
    with visualization.view(rpdr, swing[1], swing[0], open_browser=False) as viewer:
        assert viewer.url.startswith("http://127.0.0.1:")
        assert b"viewer.connect" in urllib.request.urlopen(viewer.url, timeout=10).read()
        port = int(viewer.url.rstrip("/").rpartition(":")[2])
        listening = Path("/proc/net/tcp")
        if listening.exists():
            rows = [line.split() for line in listening.read_text().splitlines()[1:]]
            local = [row[1] for row in rows if row[3] == "0A" and int(row[1].partition(":")[2], 16) == port]
            assert local == [f"0100007F:{port:04X}"]
        assert not viewer.wait(0.0)
    assert viewer.wait(0.0)
    viewer.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(viewer.url, timeout=10)
    assert socket.socket().connect_ex(("127.0.0.1", port)) != 0
    assert threading.active_count() == before


def test_live_viewer_sends_the_scene_then_the_moves(rpdr, swing):
    """A browser that connects gets the whole scene, and afterwards each pose drawn."""
    tornado = pytest.importorskip("tornado.websocket")
    import asyncio

    with visualization.view(rpdr, open_browser=False) as viewer:
        recorder = viewer.scene.visualizer.window
        assert isinstance(recorder, LiveRecorder)

        async def watch():
            connection = await tornado.websocket_connect(viewer.url.replace("http", "ws") + "scene")
            first = [await connection.read_message() for _ in recorder.commands]
            known = recorder.commands
            await asyncio.get_running_loop().run_in_executor(None, viewer.draw, swing[1][7])
            moves = [umsgpack.unpackb(await connection.read_message()) for _ in range(6)]
            connection.close()
            return first, known, moves

        first, known, moves = asyncio.run(watch())
    assert tuple(first) == known
    frames = urdf_frames(MODELS / "rpdr.urdf", rpdr, swing[1][7])
    placed = {m["path"].rpartition("/")[2]: np.array(m["matrix"]).reshape(4, 4).T for m in moves[1:]}
    assert moves[0]["type"] == "set_animation"
    assert set(placed) == {"base", "link1", "link2", "link3", "link4"}
    assert all(placed[name] == pytest.approx(frames[name], abs=1e-12) for name in placed)


def test_view_says_what_is_missing(rpdr, swing):
    """Times without configurations and configurations without times are refused."""
    with pytest.raises(InvalidInputError, match="t is given without q_free"):
        visualization.view(rpdr, t=swing[0], open_browser=False)
    with pytest.raises(InvalidInputError, match="give its times t"):
        visualization.view(rpdr, swing[1], open_browser=False)


def robot_box(picture):
    """Top, bottom, left, right of all but the background, which varies by row only; its shares of height and width."""
    drawn = np.abs(picture - picture[:, :1]).max(axis=2) > 0.03
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    assert rows.size, "nothing but background"
    height, width = drawn.shape
    return rows[0], rows[-1], columns[0], columns[-1], np.ptp(rows) / height, np.ptp(columns) / width


def assert_fills_frame(picture):
    top, bottom, left, right, height, width = robot_box(picture)
    assert top > 0
    assert left > 0
    assert bottom < picture.shape[0] - 1
    assert right < picture.shape[1] - 1
    assert 0.45 < max(height, width) < 0.98, (height, width)


def look(page, **options):
    """A picture of the page's scene, without its title, playback bar and menu."""
    hidden = page.with_name("look.html")
    style = "<style>#title, #bar, .dg { display: none !important; }</style></body>"
    hidden.write_text(page.read_text(encoding="utf-8").replace("</body>", style), encoding="utf-8")
    return screenshot(hidden.as_uri(), **options)


@pytest.mark.parametrize("name", ["rpdr", "delta", "stewart", "four_bar"])
def test_chromium_shows_the_whole_mechanism(name, tmp_path):
    """The mechanism is inside the picture and takes a sensible share of it."""
    assert_fills_frame(look(visualization.snapshot_html(ccpin.load(name), None, tmp_path / "s.html")))


def test_chromium_shows_a_skeleton(tmp_path):
    """So is a mechanism whose file draws nothing."""
    assert_fills_frame(look(visualization.snapshot_html(bare(ccpin.load("stewart")), None, tmp_path / "s.html")))


def test_chromium_shows_other_peoples_four_bar(tmp_path):
    """So is a file from elsewhere."""
    if not SHARED.is_dir():
        pytest.skip("the folder with other people's models is absent")
    assert_fills_frame(
        look(visualization.snapshot_html(ccpin.load(SHARED / "four_bar.urdf"), None, tmp_path / "s.html"))
    )


def test_chromium_plays_the_animation_in_windows_of_any_shape(rpdr, swing, tmp_path):
    """The animation starts by itself, and a portrait window shows the whole robot too."""
    page = visualization.animate(rpdr, *swing, tmp_path / "a.html", trace=rpdr.closures[0].name)
    early, late = look(page, wait_ms=200), look(page, wait_ms=1400)
    assert_fills_frame(early)
    assert_fills_frame(late)
    assert (np.abs(early - late).max(axis=2) > 0.1).mean() > 0.01
    portrait = look(page, width=500, height=800)
    assert_fills_frame(portrait)
    orange = (portrait[..., 0] > 0.7) & (portrait[..., 1] < 0.65) & (portrait[..., 2] < 0.35)
    assert orange.mean() > 0.01


def test_chromium_shows_the_live_viewer(rpdr):
    """The live page draws what it is sent: the robot's orange links."""
    with visualization.view(rpdr, open_browser=False) as viewer:
        picture = screenshot(viewer.url)
    orange = (picture[..., 0] > 0.7) & (picture[..., 1] < 0.65) & (picture[..., 2] < 0.35)
    assert orange.mean() > 0.01
