"""The live viewer, and what Chromium shows of pages and viewer."""

from __future__ import annotations

import socket
import threading
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import umsgpack

import ccpin
from ccpin import visualization
from ccpin.errors import InvalidInputError
from ccpin.visualization.live import LiveRecorder
from ccpin.visualization.page import Recorder
from tests.support.browser import screenshot
from tests.support.pages import bare, five_bar, five_bar_swing, urdf_frames
from tests.support.places import MODELS, SHARED


@pytest.fixture(scope="module")
def rpdr():
    return five_bar()


@pytest.fixture(scope="module")
def swing():
    return five_bar_swing()


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
    assert_fills_frame(look(visualization.snapshot(ccpin.load(name), None, tmp_path / "s.html")))


def test_chromium_shows_a_skeleton(tmp_path):
    """So is a mechanism whose file draws nothing."""
    assert_fills_frame(look(visualization.snapshot(bare(ccpin.load("stewart")), None, tmp_path / "s.html")))


def test_chromium_shows_other_peoples_four_bar(tmp_path):
    """So is a file from elsewhere."""
    if not SHARED.is_dir():
        pytest.skip("the folder with other people's models is absent")
    assert_fills_frame(look(visualization.snapshot(ccpin.load(SHARED / "four_bar.urdf"), None, tmp_path / "s.html")))


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
