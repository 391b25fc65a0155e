"""The 3-RPR of `tests.oracles.cusped_3rpr` as a mechanism."""

import numpy as np

import ccpin
from ccpin.description import Inertia, Joint, Link
from tests.oracles import cusped_3rpr as cusped


def cusped_mechanism(pose, unit=1.0):
    """The 3-RPR with a locked leg, closed at a pose; lengths in units of a part of a metre (1000: millimetres)."""

    def frame(x=0.0, y=0.0):
        placement = np.eye(4)
        placement[:2, 3] = unit * x, unit * y
        return placement

    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    body = Inertia(1.0, np.zeros(3), np.eye(3))
    links = tuple(Link(name, body) for name in ("base", "leg1", "platform", "outer2", "rod2", "outer3", "rod3"))
    joints = [Joint("leg", "revolute", "base", "leg1", frame(), z)]
    joints.append(Joint("turn", "revolute", "leg1", "platform", frame(cusped.LEG1), z))
    corners = {2: (cusped.SIDE12, 0.0), 3: cusped.SIDE13 * np.array([np.cos(cusped.CORNER), np.sin(cusped.CORNER)])}
    loops = []
    for k, base in ((2, cusped.BASE2), (3, cusped.BASE3)):
        joints.append(Joint(f"swing{k}", "revolute", "base", f"outer{k}", frame(*base), z))
        joints.append(Joint(f"rho{k}", "prismatic", f"outer{k}", f"rod{k}", frame(), x))
        loops.append(ccpin.LoopClosure(f"loop{k}", "revolute", "platform", f"rod{k}", frame(*corners[k]), frame()))
    reference = {
        name: (unit * value if name.startswith("rho") else value,) for name, value in cusped.displacements(pose).items()
    }
    return ccpin.load(
        ccpin.MechanismDescription(
            "3rpr", "base", links, tuple(joints), tuple(loops), independent=("rho2", "rho3"), reference=reference
        )
    )
