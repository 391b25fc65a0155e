"""The pictures of the installed models: each link in one piece, nothing flickers, nothing runs through the base."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import ccpin
from ccpin.visualization.drawn_bodies import drawn_bodies
from tests.support.places import MODELS

NAMES = sorted(path.stem for path in MODELS.glob("*.urdf"))


def moved(frame, points):
    return points @ frame[:3, :3].T + frame[:3, 3]


def outside(shape, points):
    """How far points (N, 3) of the shape's frame are outside it, at least; negative inside."""
    size = np.array(shape.size)
    if shape.kind == "box":
        return (np.abs(points) - size / 2).max(axis=1)
    if shape.kind == "cylinder":
        return np.maximum(np.hypot(points[:, 0], points[:, 1]) - size[0], np.abs(points[:, 2]) - size[1] / 2)
    assert shape.kind == "sphere", shape.kind
    return np.linalg.norm(points, axis=1) - size[0]


def edges(shape):
    """Edge lengths (3,) of the box around a shape."""
    if shape.kind == "box":
        return np.array(shape.size)
    radius = shape.size[0]
    return 2 * np.array([radius, radius, radius if shape.kind == "sphere" else shape.size[1] / 2])


def filling(shape):
    """Points (N, 3) throughout a shape."""
    unit = np.linspace(-1, 1, 41)
    lattice = np.array(list(itertools.product(unit[::4], unit[::4], unit))) * edges(shape) / 2
    return lattice[outside(shape, lattice) <= 1e-12]


def touch(one, other, slack=1e-4):
    """Whether two visuals of a link overlap."""
    for a, b in ((one, other), (other, one)):
        points = moved(np.linalg.inv(b.placement) @ a.placement, filling(a.shape))
        if outside(b.shape, points).min() < slack:
            return True
    return False


@pytest.mark.parametrize("name", NAMES)
def test_each_link_is_drawn_in_one_piece(name):
    """No rod stops short of its ball, no motor floats beside its plate."""
    for link in ccpin.load(name).description.links:
        reached, left = [], list(link.visuals)
        while left:
            joined = [v for v in left if not reached or any(touch(v, other) for other in reached)]
            assert joined, f"{link.name}: {len(left)} of {len(link.visuals)} visuals hang in the air"
            reached += joined[:1] if not reached else joined
            left = [v for v in left if not any(v is other for other in reached)]


def flat_faces(visual, frame):
    """(centre, outward normal, points on it) of each flat face, in the world."""
    shape, at = visual.shape, frame @ visual.placement
    if shape.kind == "sphere":
        return
    for axis in range(3) if shape.kind == "box" else (2,):
        half = (
            np.array(shape.size if shape.kind == "box" else (2 * shape.size[0], 2 * shape.size[0], shape.size[1])) / 2
        )
        for side in (-1.0, 1.0):
            points = np.array(list(itertools.product(np.linspace(-0.97, 0.97, 31), repeat=2)))
            points = np.insert(points, axis, side, axis=1) * half
            points = points[outside(shape, points) < 1e-12]
            yield moved(at, side * half * np.eye(3)[axis]), side * at[:3, axis], moved(at, points)


@pytest.mark.parametrize("name", NAMES)
def test_no_two_faces_flicker(name):
    """No two flat faces that look the same way lie in one plane, closer than 0.2 mm, and overlap."""
    mechanism = ccpin.load(name)
    bodies = drawn_bodies(mechanism)[0]
    poses = {body.name: pose for body, pose in zip(bodies, frames_at_reference(mechanism, bodies), strict=True)}
    faces = [
        (f"{body.name}.{number}", visual, poses[body.name], *face)
        for body in bodies
        for number, visual in enumerate(body.visuals)
        for face in flat_faces(visual, poses[body.name])
    ]
    for first, second in itertools.permutations(faces, 2):
        name, _, _, here, normal, points = first
        other, visual, pose, there, towards, _ = second
        if name != other and normal @ towards > 0.999 and abs((there - here) @ normal) < 2e-4:
            apart = outside(visual.shape, moved(np.linalg.inv(pose @ visual.placement), points)).min()
            assert apart > 3e-4, f"{name} and {other} share a face"


def frames_at_reference(mechanism, bodies):
    """World frames of bodies in the reference configuration, by Pinocchio."""
    import pinocchio as pin

    data = mechanism.pin_model.createData()
    pin.forwardKinematics(mechanism.pin_model, data, mechanism.q_reference)
    return [data.oMi[body.joint].homogeneous @ body.placement for body in bodies]


def test_delta_arms_swing_free_of_the_base():
    """From 45° above horizontal to 80° below, no point of an arm beyond its hub is inside the base."""
    links = {link.name: link for link in ccpin.load("delta").description.links}
    shaft = next(v for v in links["arm1"].visuals if v.shape.kind == "cylinder" and v.shape.size[1] > 0.4)
    joint = next(j for j in ccpin.load("delta").description.joints if j.child == "arm1")
    for angle in np.radians(np.arange(-45, 81, 5)):
        c, s = np.cos(angle), np.sin(angle)
        turned = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
        points = moved(joint.placement @ turned @ shaft.placement, filling(shaft.shape))
        for visual in links["base"].visuals:
            assert outside(visual.shape, moved(np.linalg.inv(visual.placement), points)).min() > 0, np.degrees(angle)
