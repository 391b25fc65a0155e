"""The live viewer, and what Chromium shows of pages and viewer."""

from __future__ import annotations

import importlib
import itertools
import socket
import threading
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
import umsgpack
from matplotlib.image import imread

import ccpin
from ccpin import visualization
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.visualization.browser import BrowserPage
from ccpin.visualization.live import LiveRecorder
from ccpin.visualization.scene import Scene
from ccpin.visualization.scene_page import CommandRecorder
from tests.support.browser import chromium, click, opened, pixels, press, settle
from tests.support.pages import bare, five_bar, urdf_frames
from tests.support.paper import GOAL, START
from tests.support.places import MODELS, SHARED


def test_recorder_forgets_what_is_overridden(rpdr, swing):
    """Moving a mechanism many times costs no memory."""
    meshcat = pytest.importorskip("meshcat")
    recorder = CommandRecorder()
    scene = Scene(rpdr, meshcat.Visualizer(window=recorder))
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
        port = urlsplit(viewer.url).port
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
            moves = [umsgpack.unpackb(await connection.read_message()) for _ in range(9)]
            connection.close()
            return first, known, moves

        first, known, moves = asyncio.run(watch())
    assert tuple(first) == known
    frames = urdf_frames(MODELS / "rpdr.urdf", rpdr, swing[1][7])
    placed = {m["path"].rpartition("/")[2]: np.array(m["matrix"]).reshape(4, 4).T for m in moves if "matrix" in m}
    assert moves[0]["type"] == "set_animation"
    assert set(placed) == {"base", "link1", "link2", "link3", "link4"}
    assert all(placed[name] == pytest.approx(frames[name], abs=1e-12) for name in placed)


def test_view_says_what_is_missing(rpdr, swing):
    """Times without configurations and configurations without times are refused."""
    with pytest.raises(InvalidInputError, match="t is given without q_free"):
        visualization.view(rpdr, t=swing[0], open_browser=False)
    with pytest.raises(InvalidInputError, match="give its times t"):
        visualization.view(rpdr, swing[1], open_browser=False)


def undressed(page):
    """What the page shows of the mechanism alone: no ground, no panels, no words."""
    page.evaluate(
        "document.body.classList.add('film'); for (const id of ['title', 'stamp']) document.getElementById(id).hidden ="
        " true; shown.ground = false; viewer.set_dirty()"
    )
    settle(page)
    return pixels(page)


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


def changed(before, after):
    """The share of pixels that differ clearly."""
    return (np.abs(before - after).max(axis=2) > 0.1).mean()


def other_peoples_leg():
    if not SHARED.is_dir():
        pytest.skip("the folder with other people's models is absent")
    return ccpin.load(SHARED / "cassie_like" / "robot.yaml")


@pytest.mark.parametrize(
    "mechanism",
    [
        pytest.param(lambda: ccpin.load("rpdr"), id="rpdr"),
        pytest.param(lambda: bare(ccpin.load("stewart")), id="bare stewart", marks=pytest.mark.slow),
        pytest.param(lambda: ccpin.load("delta"), id="delta", marks=pytest.mark.slow),
        pytest.param(other_peoples_leg, id="leg without meshes", marks=pytest.mark.slow),
    ],
)
def test_every_view_shows_the_whole_mechanism(mechanism, tmp_path):
    """From all four sides it is inside the picture and takes a sensible share; the four pictures differ."""
    with opened(visualization.snapshot(mechanism(), None, tmp_path / "s.html").as_uri(), 240, 160) as page:
        seen = []
        for name in ("iso", "front", "side", "top"):
            page.evaluate(f"look({name!r}, false)")
            seen.append(undressed(page))
            assert_fills_frame(seen[-1])
        for one, other in itertools.combinations(seen, 2):
            assert changed(one, other) > 0.005


KINDS = "(root => { const all = []; root.traverse(o => o.isMesh && all.push(o.material.type)); return all; })"


@pytest.mark.slow
def test_the_stage(rpdr, tmp_path):
    """Ground at the lowest point, shadows on it, materials that reflect; the tools switch what they name."""
    with opened(visualization.snapshot(rpdr, None, tmp_path / "s.html").as_uri()) as page:
        lowest = "new THREE.Box3().setFromObject(viewer.scene_tree.find(['meshcat']).object).min.y"
        height = "ground.group.getWorldPosition(new THREE.Vector3()).y"
        below, radius = page.evaluate(f"{lowest} - {height}"), page.evaluate("told('floor').radius")
        assert 0 < below < 0.1 * radius
        assert page.evaluate("viewer.scene.environment !== null && viewer.renderer.shadowMap.enabled")
        light = "viewer.scene_tree.find(['Lights', 'Key', '<object>']).object.castShadow"
        assert page.evaluate(light)
        kinds = page.evaluate(f"{KINDS}(viewer.scene_tree.find(['meshcat']).object)")
        assert kinds == ["MeshStandardMaterial"] * sum(len(link.visuals) for link in rpdr.description.links)
        with_shadow = pixels(page)
        page.evaluate(f"{light} = false; viewer.set_dirty()")
        settle(page)
        assert (np.abs(with_shadow - pixels(page)).max(axis=2) > 0.03).mean() > 0.003
        with_ground = pixels(page)
        click(page, "[data-toggle=ground]")
        settle(page)
        assert (np.abs(with_ground - pixels(page)).max(axis=2) > 0.02).mean() > 0.05
        for kinds, names in (("motors", {"joint1", "joint2"}), ("all", {*rpdr.tree.model.names[1:], "end_effector"})):
            press(page, "l")
            settle(page)
            written = page.evaluate("[...document.querySelectorAll('#labels span')].map(s => s.textContent)")
            assert set(written) == names, kinds


@pytest.fixture(scope="module")
def run():
    """A short motion under a law, whose closures carry forces."""
    model = ccpin.ReducedModel(five_bar())
    law = ccpin.control.PDSimpleGravity(model, GOAL, [11, 11], [0.65, 0.60])
    motion = ccpin.simulate(model, law, START, duration=0.4)
    return motion, ccpin.simulation.closure_forces(model, motion)


MOVED = """before => new Promise(done => {
  const look = () => player.time === before ? requestAnimationFrame(look) : done(true);
  look();
})"""


def test_time_is_the_users(rpdr, run, tmp_path):
    """It plays by itself; keys stop it, step by single frames, change speed, reset; bodies, path, forces follow."""
    motion, forces = run
    name = rpdr.closures[0].name
    page = visualization.animate(rpdr, motion.t, motion.q_free, tmp_path / "a.html", trace=name, forces=forces, fps=10)
    frames = 5
    with opened(page.as_uri(), 300, 200) as page:
        assert page.evaluate("player.playing && player.loop")
        assert page.evaluate(f"({MOVED})(player.time)")
        press(page, " ")
        press(page, "Home")
        settle(page)
        assert page.evaluate("[player.playing, player.time]") == [False, 0]
        assert page.evaluate("time.textContent") == "0.00 s"
        drawn = []
        for frame in range(frames):
            assert page.evaluate("frameNow()") == pytest.approx(frame, abs=1e-9)
            assert_bodies_are_at(page, rpdr, motion, frame / 10)
            page.evaluate("viewer.render()")
            drawn.append(page.evaluate("made.trace.geometry.drawRange.count"))
            press(page, "ArrowRight")
            settle(page)
        assert drawn[0] == 0
        assert all(np.diff(drawn) > 0)
        assert drawn[-1] == page.evaluate("made.trace.geometry.index.count")
        assert page.evaluate("time.textContent") == "0.40 s"
        assert_arrow_is_the_force(page, forces[0])
        children = page.evaluate("viewer.scene_tree.find(['meshcat', 'rpdr']).object.children.map(c => c.name)")
        assert {"ghosts", "arrows", "trace", "link1"} <= set(children)
        assert page.evaluate("made.ghosts.group.children.map(c => c.name)") == ["start", "goal"]
        press(page, "-")
        assert page.evaluate("[player.speed, speed.value]") == [0.5, "0.5"]
        for _ in range(9):
            press(page, "-")
        assert page.evaluate("player.speed") == 0.1
        for _ in range(9):
            press(page, "+")
        assert page.evaluate("player.speed") == 2
        press(page, "2")
        press(page, "r")
        settle(page)
        assert page.evaluate("[player.speed, player.playing, view.name]") == [1, True, "iso"]
        page.command("Emulation.setDeviceMetricsOverride", {"width": 250, "height": 400, **ONE_TO_ONE})
        press(page, "f")
        settle(page, 500)
        portrait = undressed(page)
        assert_fills_frame(portrait)
        assert portrait.shape[:2] == (400, 250)


ONE_TO_ONE = {"deviceScaleFactor": 1, "mobile": False}


def assert_bodies_are_at(page, mechanism, motion, moment):
    """The page's own interpolation agrees with forward kinematics at the nearest sample, as closely as that is near."""
    nearest = int(np.argmin(np.abs(motion.t - moment)))
    frames = urdf_frames(MODELS / "rpdr.urdf", mechanism, motion.q_free[nearest])
    for link in ("link1", "link3"):
        node = f"viewer.scene_tree.find(['meshcat', 'rpdr', '{link}']).object"
        place = page.evaluate(f"{node}.updateMatrix(), {node}.matrix.elements.slice(12, 15)")
        moved = 3.0 * abs(motion.t[nearest] - moment)
        assert np.linalg.norm(np.array(place) - frames[link][:3, 3]) < 1e-6 + moved


def assert_arrow_is_the_force(page, force):
    """At the end the arrow stands at the closure's point and points along its force."""
    arrow = "made.arrows.group.children[0]"
    page.evaluate("viewer.render()")
    towards = page.evaluate(f"new THREE.Vector3(0, 1, 0).applyQuaternion({arrow}.quaternion).toArray()")
    assert towards == pytest.approx(force.force[-1] / np.linalg.norm(force.force[-1]), abs=1e-6)
    assert page.evaluate(f"{arrow}.position.toArray()") == pytest.approx(force.point[-1], abs=1e-6)
    written = page.evaluate("[...document.querySelectorAll('#labels .force')].map(s => s.textContent)")
    assert written == [f"{force.name} {np.linalg.norm(force.force[-1]):#.3g} N"]


@pytest.mark.slow
def test_the_live_viewer_frames_anew(rpdr, swing):
    """The live page draws what it is sent; a pose outside the frame is framed, unless the user has turned the scene."""
    with visualization.view(rpdr, open_browser=False) as viewer, opened(viewer.url) as page:
        position = "viewer.camera.position.toArray()"
        settle(page, 300)
        picture = pixels(page)
        orange = (picture[..., 0] > 0.7) & (picture[..., 1] < 0.65) & (picture[..., 2] < 0.35)
        assert orange.mean() > 0.01
        before = page.evaluate("told('views').iso.position")
        viewer.draw(swing[1][0])
        settle(page, 700)
        assert page.evaluate("told('views').iso.position") != before
        assert page.evaluate(position) == pytest.approx(page.evaluate("told('views').iso.position"), rel=1e-6)
        assert_fills_frame(undressed(page))
        for kind, at in (("mousePressed", 400), ("mouseMoved", 460), ("mouseReleased", 460)):
            page.command(
                "Input.dispatchMouseEvent", {"type": kind, "x": at, "y": 300, "button": "left", "clickCount": 1}
            )
        settle(page, 100)
        turned, views = page.evaluate(position), page.evaluate("told('views').iso.position")
        assert turned != pytest.approx(views, rel=1e-3)
        viewer.draw(viewer.scene.mechanism.q_reference + [np.pi, 0, 0, 0])
        settle(page, 500)
        assert page.evaluate("told('views').iso.position") != views
        assert page.evaluate(position) == pytest.approx(turned, rel=1e-6)


@pytest.mark.slow
def test_a_pose_drawn_ends_the_motion(rpdr, run):
    """After `Viewer.draw` neither path nor ghosts nor forces of the trajectory are left, and time stands."""
    motion, forces = run
    shown = {"trace": rpdr.closures[0].name, "forces": forces, "fps": 10}
    view = visualization.view(rpdr, motion.q_free, motion.t, open_browser=False, **shown)
    with view as viewer, opened(viewer.url) as page:
        settle(page, 300)
        there = "[made.trace.parent.visible, made.ghosts.group.children.length, made.arrows.group.children.length]"
        assert page.evaluate(there) == [True, 2, 1]
        viewer.draw(rpdr.q_reference)
        settle(page, 300)
        page.evaluate("viewer.render()")
        assert page.evaluate(there) == [False, 0, 0]
        assert page.evaluate("[player.duration, bar.style.display]") == [0, "none"]


@pytest.mark.parametrize("ending", [".mp4", pytest.param(".gif", marks=pytest.mark.slow)])
def test_films_have_the_frames_of_the_page(ending, rpdr, run, tmp_path):
    """A film decodes to the size and number of frames asked for, each unlike the one before; it lasts as long."""
    pytest.importorskip("choreographer")
    chromium()
    motion, told = run[0], []
    film = tmp_path / f"a{ending}"
    options = {"fps": 10, "size": (320, 240), "progress": lambda done, of: told.append((done, of))}
    visualization.animate(rpdr, motion.t, motion.q_free, film, **options)
    frames, seconds = decoded(film)
    assert frames.shape == (5, 240, 320, 3)
    assert told == [(k, 5) for k in range(1, 6)]
    assert seconds == pytest.approx(0.5, abs=0.02)
    assert all(changed(a / 255, b / 255) > 0.005 for a, b in itertools.pairwise(frames[:3]))
    assert [path.name for path in tmp_path.iterdir()] == [film.name]


def decoded(film):
    """All frames (T, height, width, 3) of a film, and how long it lasts."""
    if film.suffix == ".gif":
        image = importlib.import_module("PIL.Image").open(film)
        parts = [(image.seek(k), np.array(image.convert("RGB")), image.info["duration"]) for k in range(image.n_frames)]
        return np.array([part[1] for part in parts]), sum(part[2] for part in parts) / 1000
    reader = pytest.importorskip("imageio_ffmpeg").read_frames(str(film))
    meta = next(reader)
    width, height = meta["size"]
    assert meta["codec"] == "h264"
    frames = np.array([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader])
    return frames.astype(float), len(frames) / meta["fps"]


def test_a_picture(rpdr, tmp_path):
    """A .png is what the page shows; afterwards the browser and its thread are gone."""
    pytest.importorskip("choreographer")
    chromium()
    picture = imread(visualization.snapshot(rpdr, None, tmp_path / "p.png", size=(400, 300)))
    assert picture.shape[:2] == (300, 400)
    assert ((picture[..., 0] > 0.7) & (picture[..., 1] < 0.65) & (picture[..., 2] < 0.35)).mean() > 0.01
    assert not any(thread.name == "ccpin-browser" for thread in threading.enumerate())


def test_no_browser_is_told(rpdr, tmp_path, monkeypatch):
    """Where no Chromium is installed a sentence says so, and nothing is left."""
    browsers = pytest.importorskip("choreographer.browsers.chromium")
    monkeypatch.setattr(browsers.Chromium, "find_browser", classmethod(lambda *_, **__: None))
    with pytest.raises(CcpinError, match=r"headless Chromium .* none is installed"):
        visualization.snapshot(rpdr, None, tmp_path / "p.png")
    assert list(tmp_path.iterdir()) == []
    assert not any(thread.name == "ccpin-browser" for thread in threading.enumerate())


@pytest.mark.slow
def test_what_the_page_throws_is_told(rpdr, tmp_path):
    """An exception in the page is a CcpinError with its words; the browser goes on."""
    with opened(visualization.snapshot(rpdr, None, tmp_path / "s.html").as_uri()) as page:
        with pytest.raises(CcpinError, match="ReferenceError: nowhere is not defined"):
            page.evaluate("nowhere.at.all")
        assert page.evaluate("1 + 1") == 2


def test_a_browser_without_webgl_is_told(rpdr, tmp_path):
    """In place of an empty picture and tools that do nothing."""
    page = visualization.snapshot(rpdr, None, tmp_path / "s.html")
    off = "<script>HTMLCanvasElement.prototype.getContext = () => null</script>"
    page.write_text(page.read_text(encoding="utf-8").replace("<head>", f"<head>{off}", 1), encoding="utf-8")
    pytest.importorskip("choreographer")
    chromium()
    with BrowserPage(page.as_uri()) as shown:
        words = shown.evaluate("document.getElementById('pane').innerText")
        assert words.startswith("This browser does not draw in 3D")
        assert not shown.evaluate("document.getElementById('tools').checkVisibility()")
        assert any("WebGL" in problem for problem in shown.problems)
