"""Geometry of pictures: shapes, meshes, tubes, the skeleton and the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay

import ccpin
from ccpin import visualization
from ccpin.description import Shape, Visual
from ccpin.visualization.camera import ASPECT, FIELD_OF_VIEW, FILL, frame_points, plane_normal, view_directions
from ccpin.visualization.drawn_bodies import drawn_bodies
from ccpin.visualization.scene import Scene
from ccpin.visualization.scene_page import CommandRecorder
from ccpin.visualization.shapes import RINGS, SIDES, Triangles, corners, hull, parts, read_mesh, tube
from ccpin.visualization.stick_figure import held_points
from tests.support.pages import bare
from tests.support.rods import FOUR_BAR, rocker_angle, rod_four_bar


def test_tube_is_as_thick_as_asked_for():
    """Around a circle, each vertex is `radius` from the circle and each ring lies across it."""
    angles = np.linspace(0, 1.5 * np.pi, 200)
    circle = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    vertices = tube(circle, 0.01).mesh.vertices
    across = np.hypot(np.hypot(vertices[:, 0], vertices[:, 1]) - 1, vertices[:, 2])
    assert across == pytest.approx(0.01, rel=1e-3)
    assert tube(np.zeros((5, 3)), 0.01) is None


SHAPES = {
    "box": (Shape("box", (1.0, 2.0, 3.0)), [0.5, 1.0, 1.5]),
    "cylinder": (Shape("cylinder", (0.5, 3.0)), [0.5, 0.5, 1.5]),
    "capsule": (Shape("capsule", (0.5, 3.0)), [0.5, 0.5, 2.0]),
    "sphere": (Shape("sphere", (0.7,)), [0.7, 0.7, 0.7]),
    "ellipsoid": (Shape("ellipsoid", (0.1, 0.2, 0.3)), [0.1, 0.2, 0.3]),
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
    shape = Shape("mesh", (2.0, 1.0, 1.0), mesh=str(path))
    assert np.abs(corners(shape)) == pytest.approx(np.tile([1.0, 1.0, 1.5], (8, 1)))
    assert len(read_mesh(str(path)).vertices) == 24


def test_missing_or_broken_mesh_is_left_out_with_a_note(rpdr, tmp_path):
    """The rest of the mechanism is drawn, and the notes say what is not."""
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid nothing")
    meshes = tuple(Visual(Shape("mesh", (1.0, 1.0, 1.0), mesh=str(m))) for m in ("absent.obj", broken))
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
    """Without visuals, a pin or ball sits at both ends of each closure, and each joint is at one or in a solid."""
    mechanism = bare(ccpin.load(name))
    with visualization.view(mechanism, open_browser=False) as viewer:
        assert "solid links" in viewer.notes[0]
        frames = viewer.scene.frames(mechanism.q_reference)
        bodies = viewer.scene.bodies
    pieces = [(f @ v.placement, v.shape) for f, b in zip(frames, bodies, strict=True) for v in b.visuals]
    marks = [placement for placement, shape in pieces if isinstance(shape, Shape)]
    marked = np.array([mark[:3, 3] for mark in marks])
    data = mechanism.pin_model.createData()
    pin.forwardKinematics(mechanism.pin_model, data, mechanism.q_reference)
    solids = [(placement, shape) for placement, shape in pieces if isinstance(shape, Triangles)]
    hulls = [Delaunay(shape.vertices @ f[:3, :3].T + f[:3, 3]) for f, shape in solids]
    for joint in range(1, mechanism.pin_model.njoints):
        origin = data.oMi[joint].translation
        near = np.linalg.norm(marked - origin, axis=1).min() < 1e-9
        assert near or any(solid.find_simplex(origin) >= 0 for solid in hulls), mechanism.pin_model.names[joint]
    for closure in mechanism.closures:
        for link, placement in ((closure.link_a, closure.placement_a), (closure.link_b, closure.placement_b)):
            carrier = mechanism.tree.attachments[link]
            end = (data.oMi[carrier.joint].homogeneous @ carrier.placement @ placement)[:3, 3]
            assert np.linalg.norm(marked - end, axis=1).min() < 1e-9


def test_limbs_reach_from_joint_to_joint():
    """Each end of a solid link lies inside the solid: nothing floats, nothing stops short of its joint."""
    mechanism = bare(ccpin.load("four_bar"))
    with visualization.view(mechanism, open_browser=False) as viewer:
        bodies = viewer.scene.bodies
    points = held_points(mechanism)
    for body in bodies:
        solids = [visual.shape for visual in body.visuals if isinstance(visual.shape, Triangles)]
        assert solids
        for end in np.concatenate([points[body.joint].every, np.zeros((int(body.joint > 0), 3))]):
            assert any(Delaunay(solid.vertices).find_simplex(end) >= 0 for solid in solids), body.name


def test_only_what_the_file_leaves_out_is_made(rpdr):
    """One link without visuals among others gets a solid link; a link whose mesh is missing does; the rest none."""
    lost = (Visual(Shape("mesh", (1.0, 1.0, 1.0), mesh="absent.obj")),)
    for visuals in ((), lost):
        links = tuple(
            replace(link, visuals=visuals if link.name == "link3" else link.visuals) for link in rpdr.description.links
        )
        mechanism = replace(rpdr, description=replace(rpdr.description, links=links))
        bodies, notes = drawn_bodies(mechanism)
        made = [body.name for body in bodies if any(isinstance(v.shape, Triangles) for v in body.visuals)]
        assert made == ["link3 (solid)"]
        assert len(notes) == (visuals is lost)
    assert not any(isinstance(v.shape, Triangles) for body in drawn_bodies(rpdr)[0] for v in body.visuals)


@settings(max_examples=30, deadline=None)
@given(points=st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=2, max_size=6), radius=st.floats(0.05, 0.5))
def test_hull_of_balls(points, radius):
    """It holds every ball but for the facets' sagitta, keeps within the farthest, and its faces look outwards."""
    points = np.array(points)
    radii = radius * np.linspace(1.0, 0.6, len(points))
    solid = hull(points, radii)
    inside = ConvexHull(solid.vertices).equations
    sagitta = 1 - np.cos(np.pi / RINGS) * np.cos(np.pi / SIDES)
    depth = (points @ inside[:, :3].T + inside[:, 3]).max(axis=1)
    assert np.all(depth <= -radii * (1 - 2 * sagitta))
    nearest = (np.linalg.norm(solid.vertices[:, None] - points, axis=2) - radii).min(axis=1)
    assert nearest.max() <= 1e-9
    assert np.all(nearest >= -2 * sagitta * radius)
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(ConvexHull(solid.vertices).volume, rel=1e-9)


@pytest.mark.parametrize("name", ["rpdr", "planar_3rrr", "delta", "bennett"])
def test_views_look_from_where_they_say(name):
    """Top from above; front square on to a plane of motion, else from −y; side across both; iso between them."""
    mechanism = ccpin.load(name)
    views = view_directions(mechanism, np.eye(3))
    assert views["top"] == pytest.approx([0, 0, 1])
    normal = plane_normal(mechanism)
    assert np.abs(views["front"] @ (np.array([0, -1, 0]) if normal is None else normal)) == pytest.approx(1)
    assert views["side"] == pytest.approx(np.cross(views["top"], views["front"]))
    assert all(0 < views["iso"] @ views[side] < 1 for side in ("front", "side", "top"))
    assert all(np.linalg.norm(direction) == pytest.approx(1) for direction in views.values())


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
    nearest_allowed = 0.05 * (np.ptp(depth) + 1e-3)  # the camera keeps this far from the nearest point
    if depth.min() > nearest_allowed * (1 + 1e-9):
        assert largest == pytest.approx(1, rel=1e-9)


def test_a_distance_closure_is_a_rod_between_its_ends():
    """It was drawn nowhere: a four-bar's crank and rocker moved as if by magic. Ends are those of the closed form."""
    meshcat = pytest.importorskip("meshcat")
    mechanism = ccpin.load(rod_four_bar())
    scene = Scene(mechanism, meshcat.Visualizer(window=CommandRecorder()))
    crank, ground, rocker, rod = FOUR_BAR
    (number,) = [k for k, body in enumerate(scene.bodies) if body.name == "rod (rod)"]
    assert {visual.shape.kind for visual in scene.bodies[number].visuals} == {"cylinder", "sphere"}
    model = ccpin.ReducedModel(mechanism)
    for q in (-1.0, -1.2, -0.7):
        seen = scene.frames(model.sigma([q]))[number]
        turned = rocker_angle(q)
        near = [crank * np.cos(q), 0.0, -crank * np.sin(q)]
        far = [ground + rocker * np.cos(turned), 0.0, -rocker * np.sin(turned)]
        found = np.array([seen[:3, 3], seen[:3, 3] + rod * seen[:3, 2]])
        assert found == pytest.approx(np.array([near, far]), abs=1e-9)
    assert np.linalg.det(seen[:3, :3]) == pytest.approx(1.0)
