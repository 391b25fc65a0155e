"""Pages: what they hold against Pinocchio's own URDF reader, and what is refused."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import visualization
from ccpin.errors import CcpinError, InvalidInputError
from tests.support.pages import animation, messages, transforms, urdf_frames
from tests.support.places import MODELS


def test_importing_draws_in_neither_meshcat_nor_its_friends():
    """`import ccpin.visualization` stays light."""
    heavy = "meshcat", "trimesh", "tornado", "IPython"
    code = f"import sys, ccpin.visualization; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_page_is_self_contained(rpdr, swing, tmp_path):
    """Nothing in the page is loaded from elsewhere: no address but XML namespaces, no script, link or image source."""
    text = visualization.animate(rpdr, *swing, tmp_path / "a.html").read_text(encoding="utf-8")
    text = text.replace(text[text.index("<!--\nThe viewer") : text.index("-->\n<script>")], "")  # licences, not markup
    assert set(re.findall(r"https?://[\w./-]+", text)) <= {"http://www.w3.org/1999/xhtml"}
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL).replace('<link rel="icon" href="data:,">', "")
    assert not re.search(r"<link|\ssrc\s*=|\shref\s*=|url\(|@import", markup)


def test_pages_carry_the_licences_of_what_they_hold(rpdr, swing, tmp_path):
    """MeshCat's text and that of each part of its viewer, in the page's only comment before it."""
    text = visualization.animate(rpdr, *swing, tmp_path / "a.html").read_text(encoding="utf-8")
    notices = text[text.index("<!--\nThe viewer") : text.index("-->\n<script>")]
    for words in ("Robin Deits", "three.js authors", "dat.gui", "Apache License", "msgpack-lite", "ieee754"):
        assert words in notices


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
    placed = transforms(visualization.snapshot(mechanism, None, tmp_path / "s.html"))
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
    placed = transforms(visualization.snapshot(mechanism, None, tmp_path / "s.html"))
    frames = urdf_frames(file, mechanism, mechanism.q_reference)
    for link in ("link3", "tool"):
        assert placed[f"/meshcat/rpdr/{link}"] == pytest.approx(frames[link], abs=1e-12)


def test_cylinders_lie_along_z_of_their_visual(rpdr, tmp_path):
    """MeshCat's cylinders lie along y: their nodes turn y into the visual's z axis."""
    placed = transforms(visualization.snapshot(rpdr, None, tmp_path / "s.html"))
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


def traced(page):
    """The rings (N, 8, 3) of the tube that a page draws, and the ring at each frame."""
    (drawn,) = [m for m in messages(page) if m["type"] == "set_object" and m["path"].endswith("/trace")]
    raw = drawn["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data
    (told,) = [m["value"] for m in messages(page) if m["path"] == "/ccpin/trace"]
    return np.frombuffer(raw, dtype=np.float32).reshape(-1, 8, 3), np.array(told["ends"]) // 48


def test_trace_follows_the_loop_point(rpdr, swing, tmp_path):
    """The tube is equally thick all along, and at each frame its middle is the end effector."""
    t, q_free = swing
    closure = rpdr.closures[0]
    rings, at = traced(visualization.animate(rpdr, t, q_free, tmp_path / "a.html", trace=closure.name))
    frames = [urdf_frames(MODELS / "rpdr.urdf", rpdr, pose)[closure.link_a] for pose in q_free]
    path = np.array([(frame @ closure.placement_a)[:3, 3] for frame in frames])
    middles = rings.mean(axis=1)
    thickness = np.linalg.norm(rings - middles[:, None], axis=2)
    assert thickness == pytest.approx(thickness[0, 0], rel=1e-3)
    assert 0 < thickness[0, 0] < 0.02 * np.linalg.norm(np.ptp(path, axis=0))
    assert len(rings) >= 4 * len(path)
    assert np.linalg.norm(middles[at] - path, axis=1).max() < 1e-2 * thickness[0, 0] + 1e-6


def test_trace_of_a_link_is_its_middle_or_the_point_named(tmp_path):
    """A link with mass is followed at its centre of mass: Stewart's platform at its middle, not at a leg's ball."""
    mechanism = ccpin.load("stewart")
    q = mechanism.q_reference
    link = next(link for link in mechanism.description.links if link.name == "platform")
    (frame,) = [urdf_frames(MODELS / "stewart.urdf", mechanism, q)["platform"]]
    model = ccpin.ReducedModel(mechanism)
    moved = model.sigma(model.alpha(q) + 0.02, q)
    for tracked, point in (("platform", link.inertia.com), (("platform", [0.1, 0.0, 0.2]), [0.1, 0.0, 0.2])):
        rings, at = traced(visualization.animate(mechanism, [0, 1], [q, moved], tmp_path / "a.html", trace=tracked))
        assert rings[at[0]].mean(axis=0) == pytest.approx((frame @ np.append(point, 1.0))[:3], abs=1e-4)


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
        "no fps": ((t, q), {"fps": 0}, "fps = 0 must be a positive number"),
        "negative speed": ((t, q), {"speed": -1.0}, "speed = -1.0 must be a positive number"),
        "too many frames": ((t, q), {"speed": 1e-6}, "frames are too many"),
        "unknown trace": ((t, q), {"trace": "tail"}, "trace 'tail' names no link"),
        "odd size": ((t, q), {"size": (801, 450)}, "801 × 450: both must be even"),
        "no forces": ((t, q), {"forces": [1.0]}, "what closure_forces or joint_forces return"),
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
        visualization.snapshot(mechanism, pose, tmp_path / "s.html")


@pytest.mark.parametrize(("place", "sentence"), [("file/a.html", "cannot write"), (".", "is a folder")])
def test_unwritable_path_is_refused(rpdr, swing, tmp_path, place, sentence):
    """The path is checked before the work is done."""
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InvalidInputError, match=sentence):
        visualization.animate(rpdr, *swing, tmp_path / place)


def test_failed_write_keeps_the_old_file(rpdr, swing, tmp_path, monkeypatch):
    """If the disk is full the previous page is still there, whole, and no partial file beside it."""
    target = tmp_path / "a.html"
    target.write_text("before")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ccpin.files.os.replace", full)
    with pytest.raises(InvalidInputError, match="No space left"):
        visualization.animate(rpdr, *swing, target)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.html", "before")]


def test_title_is_text_not_markup(rpdr, tmp_path):
    """A title with markup, or with the template's own marks, is shown as written."""
    text = visualization.snapshot(rpdr, None, tmp_path / "s.html", title="<b>&@CLOCK@").read_text()
    assert text.count("&lt;b&gt;&amp;@CLOCK@") == 2
    assert "<b>&" not in text


def test_film_needs_say_what_is_missing(rpdr, swing, tmp_path, monkeypatch):
    """Without the encoder, or the package that drives the browser, a sentence says what to install."""
    monkeypatch.setattr("ccpin.visualization.film.importlib.util.find_spec", lambda name: None)
    with pytest.raises(CcpinError, match=r"pip install 'ccpin\[video\]'"):
        visualization.animate(rpdr, *swing, tmp_path / "a.mp4")
    monkeypatch.setitem(sys.modules, "choreographer", None)
    for film in ("a.gif", "a.png"):
        write = visualization.snapshot if film == "a.png" else visualization.animate
        arguments = (None,) if film == "a.png" else swing
        with pytest.raises(CcpinError, match=r"headless Chromium.*pip install 'ccpin\[video\]'"):
            write(rpdr, *arguments, tmp_path / film)
    with pytest.raises(InvalidInputError, match="a GIF plays at most 50"):
        visualization.animate(rpdr, *swing, tmp_path / "a.gif", fps=60)
    assert list(tmp_path.iterdir()) == []


def test_titles_are_what_the_file_is_called(rpdr, tmp_path):
    """The file's name, or its folder's where the file is called as any might be."""
    for file, words in (("rpdr.urdf", "rpdr"), ("fingers/robot.urdf", "fingers"), ("leg.urdf", "leg")):
        target = tmp_path / file
        target.parent.mkdir(exist_ok=True)
        target.write_text((MODELS / "rpdr.urdf").read_text(encoding="utf-8"), encoding="utf-8")
        page = visualization.snapshot(ccpin.load(target), None, tmp_path / "s.html")
        assert f"<title>{words}</title>" in page.read_text(encoding="utf-8")
