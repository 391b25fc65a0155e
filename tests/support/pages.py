"""What the tests of pictures share: the five-bar in motion, pages decoded, and Pinocchio's own URDF reader."""

from __future__ import annotations

import base64
import functools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import umsgpack

import ccpin
from tests.support.paper import GOAL, START


@functools.cache
def five_bar():
    """The Rice Planar Delta Robot."""
    return ccpin.load("rpdr")


@functools.cache
def five_bar_swing():
    """Times and configurations of two seconds from (−150°, −160°) to (−90°, −100°), a sample every 1/30 s."""
    model = ccpin.ReducedModel(five_bar())
    t = np.arange(61) / 30
    share = (1 - np.cos(np.pi * t / 2)) / 2
    poses = [model.sigma(q) for q in START + share[:, None] * (GOAL - START)]
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
    """The message that starts the animation."""
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
