"""The moving picture on top of the README: a Delta that packs boxes, and a five-bar on the map of its singular curves.

The robot is the installed ``delta`` under computed torque, simulated; the boxes are links on slides in the same URDF,
put where the gripper and the belts have them. Two cycles are filmed and the second is kept, on which the gripper's
whole path is drawn and whose last frame goes on in its first. Beside it the five-bar ``rpdr`` goes round within what
is proved of one assembly mode (green); in grey its loop cannot close. Needs the extra ``[video]``.
"""

from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

import ccpin
from ccpin import control, domain, plotting, visualization
from ccpin.description import Inertia, Joint, Link, Shape, Visual

OUT = Path("out/hero")
PICK, PLACE, LIFT = np.array([0.30, 0.0, -1.06]), np.array([-0.30, 0.0, -1.06]), 0.16  # the gripper's tip, m
TIP = [0.0, 0.0, -0.084]  # in the platform's frame, m
GO, WAIT = 0.5, 0.1  # s, of a way and of a stop
CYCLE, CYCLES = 2 * (GO + WAIT), 2
BOX, PITCH, TOP = np.array([0.10, 0.10, 0.075]), 0.2, -1.14  # of boxes and belts, m
FPS, SLOWER, SIZE = 20, 0.5, (480, 480)  # frames a second, how much slower than it is, pixels
QUALITY = 72  # of WebP, of 100
CENTRE, AXES = np.radians([-12.0, -40.0]), np.radians([46.0, 62.0])  # of the five-bar's round, by its motors' angles
BOXES = (("in", 0), ("in", 1), ("in", 2), ("in", 3), ("out", 1), ("out", 2))  # at t = 0; 3 is in the tunnel
CARDBOARD, RUBBER, STEEL = (0.79, 0.60, 0.38, 1.0), (0.20, 0.22, 0.25, 1.0), (0.55, 0.59, 0.65, 1.0)


def main(out: Path = OUT, cycles: int = CYCLES, fps: float = FPS) -> Path:
    """Simulate, film and write ``hero.webp``; return its path."""
    robot = ccpin.load("delta")
    model = ccpin.ReducedModel(robot)
    tip = ccpin.EndEffector(model, "platform", TIP)
    reference = path_of(tip, cycles)
    law = control.ComputedTorque(model, reference, K_p=[900.0] * 3, K_v=[60.0] * 3)
    start = reference.at(0.0).q
    motion = ccpin.simulate(model, law, start, duration=cycles * CYCLE, sample_period=SLOWER / fps)
    print(f"{motion.status}; loops open by at most {motion.closure_error.max():.0e} m")
    tips = np.array([tip.pose(q, near)[:3, 3] for q, near in zip(motion.q, motion.q_free, strict=True)])
    scene = with_boxes(robot)
    q_free = placed(scene, robot, motion, tips)
    film, trace, count = out / "hero.mp4", ("platform", TIP), round(CYCLE / SLOWER * fps)
    visualization.animate(scene, motion.t, q_free, film, title=" ", fps=fps, trace=trace, speed=SLOWER, size=SIZE)
    return side_by_side(last_frames(film, count), five_bar(count), out / "hero.webp", fps)


def path_of(tip: ccpin.EndEffector, cycles: int) -> control.Waypoints:
    """The gripper's way: wait, up, across and down; and the same way back."""
    step, targets = GO / 25, []
    times = np.arange(round(cycles * CYCLE / step) + 1) * step
    for t in times:
        way, since = divmod(t + 1e-9, WAIT + GO)
        share = max(since - WAIT, 0.0) / GO
        along = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        ends = (PICK, PLACE) if way % 2 == 0 else (PLACE, PICK)
        up = LIFT * (1.0 - (2.0 * along - 1.0) ** 4)
        targets.append(ends[0] + along * (ends[1] - ends[0]) + [0.0, 0.0, up])
    return control.through_points(tip, times, targets)


def with_boxes(robot: ccpin.Mechanism) -> ccpin.Mechanism:
    """The robot with two belts, and boxes on three slides each."""
    whole = robot.description
    base, *others = whole.links
    belts = tuple(visual for side in (PICK, PLACE) for visual in _belt(side[0]))
    links, joints = [replace(base, visuals=base.visuals + belts), *others], list(whole.joints)
    for belt, slot in BOXES:
        parent = base.name
        for axis, direction in zip("xyz", np.eye(3), strict=True):
            name = f"{belt}{slot}_{axis}"
            size = tuple(BOX) if axis == "z" else (1e-3,) * 3  # a slide between is not to be seen
            shown = (Visual(Shape("box", size), np.eye(4), CARDBOARD),)
            links.append(Link(name, Inertia(0.1, np.zeros(3), 1e-4 * np.eye(3)), shown))
            joints.append(Joint(name, "prismatic", parent, name, np.eye(4), direction, -3.0, 3.0))
            parent = name
    free = tuple(joint.name for joint in joints[len(whole.joints) :])
    made = replace(whole, links=tuple(links), joints=tuple(joints), independent=whole.independent + free)
    return ccpin.load(made)


def _belt(x: float) -> list[Visual]:
    """A belt along y under its boxes, away from the gripper's line, with a tunnel at its end."""
    along = -np.sign(x) * PITCH
    return [
        Visual(Shape("box", (0.16, 4.2 * PITCH, 0.04)), _at(x, 1.4 * along, TOP - 0.02), RUBBER),
        Visual(Shape("box", (0.20, 0.16, 0.16)), _at(x, 3.0 * along, TOP + 0.04), STEEL),
    ]


def _at(x: float, y: float, z: float) -> np.ndarray:
    placement = np.eye(4)
    placement[:3, 3] = x, y, z
    return placement


def placed(scene: ccpin.Mechanism, robot: ccpin.Mechanism, motion: ccpin.Trajectory, tips: np.ndarray) -> np.ndarray:
    """q′ of the scene at every sample: the robot's joints as simulated, boxes where gripper and belts have them."""
    tree, q_free = scene.tree, np.tile(scene.q_reference, (len(motion.t), 1))
    for joint in robot.tree.joints:
        q_free[:, tree.joint(joint.name).q] = motion.q_free[:, joint.q]
    for belt, slot in BOXES:
        where = np.array([box_at(belt, slot, t % CYCLE, tip) for t, tip in zip(motion.t, tips, strict=True)])
        for column, axis in enumerate("xyz"):
            q_free[:, tree.joint(f"{belt}{slot}_{axis}").q] = where[:, [column]]
    return q_free


def box_at(belt: str, slot: int, t: float, tip: np.ndarray) -> np.ndarray:
    """The middle of a box at a time of the cycle. Box 0 of the belt "in" is carried; a belt moves on meanwhile."""
    taken, left = WAIT + GO / 4, 2 * WAIT + 5 * GO / 4  # s, when the belts begin to move
    fed, gone = (PITCH * np.clip((t - begin) / (GO / 2), 0.0, 1.0) for begin in (taken, left))
    height = TOP + BOX[2] / 2
    if slot == 0 and t < 1.5 * WAIT + GO:
        return tip + [0.0, 0.0, height - PICK[2]]
    if belt == "in" and slot > 0:
        return np.array([PICK[0], fed - PITCH * slot, height])
    return np.array([PLACE[0], PITCH * slot + gone, height])


def last_frames(film: Path, count: int) -> list[Image.Image]:
    """The last frames of a film but one."""
    read = imageio_ffmpeg.read_frames(str(film))
    size = next(read)["size"]
    return [Image.frombytes("RGB", size, frame) for frame in read][-count - 1 : -1]


def five_bar(count: int) -> list[Image.Image]:
    """One round of the five-bar on the map of its assembly mode, drawn `count` times."""
    robot = ccpin.load("rpdr")
    model, atlas = ccpin.ReducedModel(robot), domain.certify(robot, CENTRE)
    figure = plotting.plot_atlas(robot, atlas, domain.singularities(robot), title="A five-bar and where it is singular")
    figure.set(dpi=100, size_inches=(SIZE[0] / 100, SIZE[1] / 100))
    (axes,) = figure.axes
    axes.get_legend().remove()
    axes.lines[-1].remove()  # where the atlas starts
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    angles = CENTRE + AXES * np.column_stack([np.cos(turn), np.sin(turn)])
    assert all(atlas.contains(q) for q in angles)
    axes.plot(*np.degrees(np.vstack([angles, angles[:1]])).T, color="black", linewidth=0.8, alpha=0.5)
    (dot,) = axes.plot([], [], "o", color="black", markersize=9)
    inset = axes.inset_axes((0.61, 0.22, 0.39, 0.55))
    inset.set(xlim=(-0.12, 0.66), ylim=(-0.55, 0.45), aspect="equal", xticks=[], yticks=[], facecolor="none")
    inset.spines[:].set_visible(False)
    tool = ccpin.EndEffector(model, "link3", [0.3048, 0.0, 0.0])
    elbows = [ccpin.EndEffector(model, link, [0.2794, 0.0, 0.0]) for link in ("link1", "link2")]
    (path,) = inset.plot([], [], color=plotting.COLOURS[0], linewidth=1.0, alpha=0.6)
    bars = inset.plot([], [], [], [], linewidth=3.5, solid_capstyle="round", marker="o", markersize=4)
    for bar, colour in zip(bars, plotting.COLOURS[1:3], strict=True):
        bar.set_color(colour)
    states = [model.at(q) for q in angles]
    reached = np.array([tool.pose(state)[[0, 2], 3] for state in states])
    path.set_data(*np.vstack([reached, reached[:1]]).T)
    pictures = []
    for state, end in zip(states, reached, strict=True):
        dot.set_data(*np.degrees(state.q)[:, None])
        for bar, base, elbow in zip(bars, (0.0, 0.3048), elbows, strict=True):
            bar.set_data(*np.array([[base, 0.0], elbow.pose(state)[[0, 2], 3], end]).T)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    return pictures


def side_by_side(left: list[Image.Image], right: list[Image.Image], path: Path, fps: float) -> Path:
    """Both as one endless WebP."""
    pictures = []
    for one, other in zip(left, right, strict=True):
        whole = Image.new("RGB", (one.width + other.width, one.height), "white")
        whole.paste(one, (0, 0))
        whole.paste(other, (one.width, 0))
        pictures.append(whole)
    options = {"duration": round(1000 / fps), "loop": 0, "quality": QUALITY, "method": 6}
    pictures[0].save(path, save_all=True, append_images=pictures[1:], **options)
    return path


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
