"""How far apart the ends of a URDF's loops are, by Pinocchio's own parser and kinematics: ccpin has no part in it."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin


def frame_of(element):
    """The transform of an element's <origin>, as Pinocchio has it."""
    origin = element.find("origin")
    stated = {} if origin is None else origin.attrib
    xyz, rpy = ([float(x) for x in stated.get(word, "0 0 0").split()] for word in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))


def posed(path):
    """The model and its data where <group_state> puts the joints."""
    root = ElementTree.parse(path).getroot()
    model = pin.buildModelFromUrdf(str(path))
    data, q = model.createData(), pin.neutral(model)
    for joint in root.find("group_state").iter("joint"):
        one = model.joints[model.getJointId(joint.get("name"))]
        value = [float(x) for x in joint.get("value").split()]
        q[one.idx_q : one.idx_q + one.nq] = [np.cos(value[0]), np.sin(value[0])] if one.nq == 2 else value
    pin.framesForwardKinematics(model, data, q)
    return model, data


def pinocchio_gaps(path):
    """Between the two frames of each <loop>, m, by name."""
    model, data = posed(path)
    found = {}
    for loop in ElementTree.parse(path).getroot().iter("loop"):
        ends = [loop.find(word) for word in ("predecessor", "successor")]
        a, b = (data.oMf[model.getFrameId(end.get("link"), pin.BODY)] * frame_of(end) for end in ends)
        found[loop.get("name")] = float(np.linalg.norm(b.translation - a.translation))
    return found
