"""Random spatial linkages, each with how many configurations it has, and planar ones that are cut open elsewhere.

Loops in space are of one row, a point in a plane or two lines that stay square, between bodies of skew joints: a joint
that turns enters as A cos θ + B sin θ + C, one that slides as A s + C, so one loop after another is solved in closed
form, in chains and trees of one to three loops. Or they are four-bars in space (RSSR), rods of one length.
"""

import numpy as np

from ccpin import LoopClosure
from ccpin.description import Joint
from tests.oracles import linkage_counts as oracle
from tests.support.carriages import at, joint, linkage
from tests.support.random_linkages import Case, bounds, box, interval, lengths, limits, spring, told

_TURNS = np.array([0.0, 0.5 * np.pi, np.pi])


def frame(rng, reach=0.5):
    """A place anywhere within a cube, turned anyhow."""
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    placement = np.eye(4)
    placement[:3, :3] = turned * np.linalg.det(turned)
    placement[:3, 3] = rng.uniform(-reach, reach, 3)
    return placement


def moved(kind, placement, axis, value):
    """Where a joint's body is in its parent, (K, 4, 4), at values (K,)."""
    here = np.tile(np.eye(4), (len(value), 1, 1))
    if kind == "prismatic":
        here[:, :3, 3] = value[:, None] * axis
    else:
        x, y, z = axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        c, s = np.cos(value)[:, None, None], np.sin(value)[:, None, None]
        here[:, :3, :3] = np.eye(3) * c + (1.0 - c) * np.outer(axis, axis) + s * cross
    return placement @ here


def row_of(kind, first, second):
    """What a closure of one row keeps at zero, (K,), of its two frames (K, 4, 4)."""
    if kind == "perpendicular":
        return np.einsum("ki,ki->k", first[:, :3, 0], second[:, :3, 1])
    return np.einsum("ki,ki->k", first[:, :3, 0], second[:, :3, 3] - first[:, :3, 3])


def turned_roots(values):
    """Both zeros (2, K) of A cos θ + B sin θ + C from its values (3, K) at `_TURNS`, and the margin (K,)."""
    a, c = 0.5 * (values[0] - values[2]), 0.5 * (values[0] + values[2])
    b = values[1] - c
    size = np.hypot(a, b)
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = np.arccos(np.where(np.abs(c) <= size, -c / size, np.nan))
    middle = np.arctan2(b, a)
    return np.array([middle - apart, middle + apart]), np.abs(np.abs(c) - size) / np.maximum(1.0, size)


def slid_roots(values):
    """The zero (1, K) of A s + C from its values at 0, ½π and π, and how far A is from zero."""
    slope = (values[2] - values[0]) / np.pi
    with np.errstate(divide="ignore", invalid="ignore"):
        return (-values[0] / slope)[None], np.abs(slope)


def skew_loops(rng):
    """Drivers in a chain, and one to three followers, each held by one row to a body of before: a chain or a tree."""
    drivers, loops = int(rng.integers(1, 3)), int(rng.integers(1, 4))
    joints, parents, closures, ends, held = [], [], [], [], {}
    for k in range(drivers + loops):
        follows = k >= drivers
        kind = str(rng.choice(["revolute", "prismatic"], p=[0.75, 0.25]))
        parents.append(k - 1 if not follows else int(rng.integers(-1, k)))
        axis = rng.normal(size=3)
        held[k] = limits(rng, -1.0, 1.0, share=1.0) if follows and kind == "prismatic" else {}
        parent = "base" if parents[k] < 0 else f"j{parents[k]}_body"
        joints.append(
            Joint(f"j{k}", kind, parent, f"j{k}_body", frame(rng), axis=axis / np.linalg.norm(axis), **held[k])
        )
        if follows:
            others = [k - 1] if parents[k] != k - 1 else [j for j in range(-1, k) if j != parents[k]]
            other, row = int(rng.choice(others)), str(rng.choice(["in_plane", "perpendicular"]))
            row = "in_plane" if kind == "prismatic" else row
            ends.append((k, other, row, frame(rng), frame(rng)))
            second = "base" if other < 0 else f"j{other}_body"
            closures.append(LoopClosure(f"loop{k}", row, f"j{k}_body", second, ends[-1][3], ends[-1][4]))
    names = [f"j{k}" for k in range(drivers)]
    widths = [3.0 if joint.kind == "revolute" else 0.5 for joint in joints[:drivers]]
    region = box(*(interval(rng, -width, width, width) for width in widths))
    made = linkage("skew loops", joints, closures, (), names)

    def poses(values):
        found = {-1: np.tile(np.eye(4), (len(values[0]), 1, 1))}
        for k, value in enumerate(values):
            joint = joints[k]
            there = moved(joint.kind, np.asarray(joint.placement), np.asarray(joint.axis), value)
            found[k] = found[parents[k]] @ there
        return found

    def counts(q):
        """One loop after another: each way to close the loops of before is followed on."""
        total, margins = np.zeros(len(q), dtype=int), []
        waiting = [([*q.T], np.ones(len(q), dtype=bool))]
        for k, other, row, first, second in ends:
            onward = []
            for values, there in waiting:
                probes = []
                for turn in _TURNS:
                    found = poses([*values, np.full(len(q), turn)])
                    probes.append(row_of(row, found[k] @ first, found[other] @ second))
                turns = joints[k].kind == "revolute"
                roots, margin = (turned_roots if turns else slid_roots)(np.array(probes))
                margins.append(np.where(there, margin, np.inf))
                for root in roots:
                    kept, near = oracle.within(root[:, None], *bounds(held[k]))
                    margins.append(np.where(there & np.isfinite(root), near, np.inf))
                    onward.append(([*values, np.nan_to_num(root)], there & np.isfinite(root) & (kept > 0)))
            waiting = onward
        for _, there in waiting:
            total += there
        return told(total, *margins)

    return Case(made, region, counts)


def rssr(rng):
    """A four-bar in space: a coupler on two turns that meet, closed by a ball; each length of the way has two turns."""
    crank, rocker, coupler = lengths(rng, 3) * [1.0, 1.0, 2.0]
    first, second = frame(rng), frame(rng, 0.3)
    joints = [
        Joint("crank", "revolute", "base", "crank_body", first, axis=np.array([0.0, 0.0, 1.0])),
        Joint("swing", "revolute", "crank_body", "swing_body", at(crank), axis=np.array([0.0, 0.0, 1.0])),
        Joint("nod", "revolute", "swing_body", "nod_body", at(), axis=np.array([0.0, 1.0, 0.0]), **spring(rng)),
        Joint("rocker", "revolute", "base", "rocker_body", second, axis=np.array([0.0, 0.0, 1.0])),
    ]
    tip = LoopClosure("tip", "spherical", "nod_body", "rocker_body", at(coupler), at(rocker))
    region = box(interval(rng, -3.0, 3.0, 2.0))
    made = linkage("rssr", joints, [tip], (), ["crank"])

    def counts(q):
        z = np.array([0.0, 0.0, 1.0])
        carried = moved("revolute", first, z, q[:, 0])
        anchor = (carried @ np.array([crank, 0.0, 0.0, 1.0]))[:, :3]

        def apart(turn):
            there = moved("revolute", second, z, np.full(len(q), turn)) @ np.array([rocker, 0.0, 0.0, 1.0])
            return np.sum((there[:, :3] - anchor) ** 2, axis=1) - coupler**2

        roots, margin = turned_roots(np.array([apart(turn) for turn in _TURNS]))
        total, margins = np.zeros(len(q), dtype=int), [margin]
        for root in roots:
            there = np.isfinite(root)
            ends = (moved("revolute", second, z, np.nan_to_num(root)) @ np.array([rocker, 0.0, 0.0, 1.0]))[:, :3]
            along = np.einsum("kji,kj->ki", carried[:, :3, :3], ends - anchor)
            total += 2 * there
            margins.append(
                np.where(there, np.hypot(along[:, 0], along[:, 1]), np.inf)
            )  # along the swing's axis: locked
        return told(total, *margins)

    return Case(made, region, counts)


def rod_in_space(rng):
    """The same with the coupler as a distance, which sheets refuse by name."""
    crank, rocker = lengths(rng, 2)
    joints = [
        Joint("crank", "revolute", "base", "crank_body", frame(rng), axis=np.array([0.0, 0.0, 1.0])),
        Joint("rocker", "revolute", "base", "rocker_body", frame(rng, 0.3), axis=np.array([0.0, 0.0, 1.0])),
    ]
    tip = LoopClosure("rod", "distance", "crank_body", "rocker_body", at(crank), at(rocker), length=0.6)
    return Case(linkage("rod", joints, [tip], (), ["crank"]), box((-1.0, 1.0)), None)


def cut_in_a_body(rng):
    """A four-bar in a plane whose last pin is a joint, cut open in a body: a closure that holds it fast."""
    crank, coupler, rocker, base = lengths(rng, 4)
    joints = [
        joint("revolute", "crank", "base"),
        joint("revolute", "coupler", "crank_body", crank, **spring(rng)),
        joint("revolute", "rocker", "coupler_body", coupler),
        joint("revolute", "ground", "rocker_body", rocker, **spring(rng)),
    ]
    cut = LoopClosure("cut", "fixed", "ground_body", "base", at(), at(base))
    region = box(interval(rng, -4.0, 4.0, 3.0))
    made = linkage("cut in a body", joints, [cut], (), ["crank"])

    def counts(q):
        modes, margin = oracle.dyad(base - crank * np.exp(1j * q[:, 0]), coupler, rocker)
        return told(np.sum(np.isfinite(modes), axis=0), margin)

    return Case(made, region, counts)


def cut_at_a_slide(rng):
    """A slider-crank cut open at its slide: a closure that lets the block slide along its z axis."""
    crank, rod, across = lengths(rng, 3)
    joints = [
        joint("revolute", "crank", "base"),
        joint("revolute", "rod", "crank_body", crank, **spring(rng)),
        joint("revolute", "block", "rod_body", rod),
    ]
    rail = at(0.0, across)
    rail[:3, :3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]  # its z axis is the base's x axis
    upright = np.eye(4)
    upright[:3, :3] = rail[:3, :3]
    kind = str(rng.choice(["prismatic", "cylindrical"]))
    cut = LoopClosure("slide", kind, "base", "block_body", rail, upright)
    region = box(interval(rng, -4.0, 4.0, 3.0))
    made = linkage("cut at a slide", joints, [cut], (), ["crank"])

    def counts(q):
        along, margin = oracle.on_line(across - crank * np.sin(q[:, 0]), rod)
        return told(np.sum(np.isfinite(along), axis=1), margin)

    return Case(made, region, counts)


FAMILIES = (skew_loops, rssr, skew_loops, cut_in_a_body, skew_loops, cut_at_a_slide, rod_in_space)
