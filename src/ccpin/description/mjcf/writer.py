"""Writing a description as MJCF: bodies with joints, sites and motors, closures as equalities between sites."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.elements.graph import zero_poses
from ccpin.description.elements.omissions import left_out, not_written
from ccpin.description.elements.xml import XmlElement, cannot, saved, written
from ccpin.description.mjcf.schema import FORCES, KINDS, WORLD
from ccpin.description.mjcf.tightening import tightened
from ccpin.description.model import (
    IDENTITY,
    Coupling,
    CouplingTerm,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Motor,
    Visual,
    frame,
)

_TYPES = {kind: word for word, kind in KINDS.items()} | {"continuous": "hinge"}
_CLOSURES = ("spherical", "revolute", "fixed")
_EFFORTS = "limits of effort of 0, and of joints of several velocities"  # 0 is none there, nor is it of a motor here
_MESHES = (".stl", ".obj", ".msh")
_LARGEST_POWER = 4  # of x in an equality's polycoef


def write_mjcf(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    """Write a description as an MJCF file that MuJoCo and ccpin read.

    A massless link between two joints goes into the body after it, as MuJoCo asks; reading it makes it anew. A
    revolute closure, which MJCF has not, becomes two connects on its axis. A coupling is an equality of two joints, or
    of <fixed> tendons where it sums more, a distance one of a <spatial> tendon. What the file told MuJoCo's solver
    (`SolverWords`) is told again; `tightened` makes it hold loops as tightly as it can.

    Poses are keyframes, the reference pose the one called "reference". Bodies'
    visuals are geoms that touch nothing; meshes that are not there, or of another kind than STL, OBJ and MSH, are not
    drawn. Which joints are independent, velocity limits and notes have no place in MJCF.

    Returns:
        What is stated and not written, in sentences.

    Raises:
        DescriptionError: What MJCF cannot say, by name: a closure or joint of another kind, a moving body without
            mass, a coupling in which more than one joint is curved.
        InvalidInputError: The file cannot be written.
    """
    writer = _MjcfWriter(description, Path(path).parent)
    saved(writer.document(), path)
    words = ("which joints are independent", "limits of velocity", "limits of position on one side", _EFFORTS)
    motors = ("bounds of motors on one side", "the loops closed around motors", "breakaway levels and Stribeck speeds")
    meshes = "meshes that are not there or neither STL, OBJ nor MSH"
    told = (*left_out(description, "MJCF", *words, *motors), *not_written("MJCF", meshes, writer.undrawn))
    return (*told, *_softly_held(description))


def _softly_held(description: MechanismDescription) -> tuple[str, ...]:
    """A sentence on the loops that MuJoCo holds by its own numbers, or by the file's."""
    names = [closure.name for closure in description.closures] + [each.name for each in description.couplings]
    stated = [name for name in names if name in description.solver.equalities]
    if not names or description.solver == tightened(description).solver:
        return ()
    whose = "as the file read states (solref, solimp)" if stated else "by its own solref and solimp"
    return (f"MuJoCo holds loops softly, {whose}: they open by what a run shows; loops='tight' holds them closed",)


class _MjcfWriter:
    """One document."""

    def __init__(self, description: MechanismDescription, folder: Path) -> None:
        self.description, self.folder = description, folder
        self.links = {link.name: link for link in description.links}
        self.below: dict[str, list[Joint]] = {}
        for joint in description.joints:
            self.below.setdefault(joint.parent, []).append(joint)
        self.ended = {link for closure in description.closures for link, _ in closure.ends}
        self.motors = {motor.joint: motor for motor in description.motors}
        self.root = etree.Element("mujoco", model=description.name)
        self.meshes: dict[tuple[str, tuple[float, ...]], str] = {}
        self.bodies: dict[str, XmlElement] = {}
        self.order: list[Joint] = []
        self.undrawn: list[str] = []

    def document(self) -> XmlElement:
        """The whole file."""
        etree.SubElement(self.root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
        solver = self.description.solver
        option = etree.SubElement(self.root, "option", gravity=written(self.description.gravity), **solver.options)
        if solver.flags:
            etree.SubElement(option, "flag", **solver.flags)
        assets = etree.SubElement(self.root, "asset")
        world = etree.SubElement(self.root, "worldbody")
        self.tree(world)
        for (file, scale), name in self.meshes.items():
            etree.SubElement(assets, "mesh", name=name, file=file, scale=written(scale), inertia="shell")
        self.equalities()
        self.actuators()
        self.keyframes()
        for empty in [element for element in self.root if not len(element) and not element.attrib]:
            self.root.remove(empty)
        return self.root

    def tree(self, world: XmlElement) -> None:
        """Every body, parents first, without recursion."""
        root = self.description.root
        top = world if root == WORLD else etree.SubElement(world, "body", name=root)
        self.dress(top, self.links[root])
        waiting = [(top, joint) for joint in reversed(self.below.get(root, []))]
        while waiting:
            parent, joint = waiting.pop()
            chain = self.chain(joint)
            free = joint.kind == "floating"
            if free and (joint.parent != root or len(chain) > 1):
                raise cannot(self.description, f"joint '{joint.name}'", "MJCF frees bodies from the world only")
            body = self.body(world if free else parent, chain)
            waiting += [(body, below) for below in reversed(self.below.get(chain[-1].child, []))]

    def chain(self, joint: Joint) -> list[Joint]:
        """The joints that lead to the next body with mass: a joint, and those after the massless links behind it."""
        chain = [joint]
        while self.passed(self.links[chain[-1].child]) and chain[-1].kind != "fixed":
            following = self.below[chain[-1].child][0]
            if following.kind == "fixed":
                break
            chain.append(following)
        return chain

    def passed(self, link: Link) -> bool:
        """Whether nothing but one joint hangs on a link."""
        bare = link.inertia is None or not link.inertia.mass
        return bare and not link.visuals and link.name not in self.ended and len(self.below.get(link.name, [])) == 1

    def body(self, parent: XmlElement, chain: list[Joint]) -> XmlElement:
        """A body with its joints, each placed as it stands at zero displacement."""
        places = [chain[0].placement]
        for joint in chain[1:]:
            places.append(places[-1] @ joint.placement)
        element = etree.SubElement(parent, "body", name=chain[-1].child, **_pose(places[-1]))
        link = self.links[chain[-1].child]
        for joint, place in zip(chain, places, strict=True):
            if joint.kind != "fixed":
                self.joint(element, joint, np.linalg.inv(places[-1]) @ place)
        self.dress(element, link)
        if self.massless(link) and chain[-1].kind != "fixed":
            raise cannot(self.description, f"link '{link.name}'", "MJCF wants a mass in every moving body")
        return element

    def massless(self, link: Link) -> bool:
        """Whether no mass moves with a link."""
        waiting, bare = [link], True
        while waiting and bare:
            here = waiting.pop()
            bare = here.inertia is None or not here.inertia.mass
            waiting += [self.links[joint.child] for joint in self.below.get(here.name, []) if joint.kind == "fixed"]
        return bare

    def joint(self, body: XmlElement, joint: Joint, place: Array) -> None:
        """One joint; a ball joint that is turned in its body has no counterpart."""
        if joint.kind not in _TYPES:
            raise cannot(self.description, f"joint '{joint.name}'", f"MJCF has no {joint.kind} joint")
        kind = _TYPES[joint.kind]
        if kind == "ball" and not np.allclose(place[:3, :3], np.eye(3), atol=1e-12):
            raise cannot(self.description, f"joint '{joint.name}'", "its massless link is turned against the next body")
        soft = self.description.solver.joints.get(joint.name, {})
        element = etree.SubElement(body, "joint", name=joint.name, type=kind, **soft)
        self.order.append(joint)
        if kind in ("hinge", "slide"):
            element.set("axis", written(place[:3, :3] @ joint.axis))
            if joint.kind != "continuous" and np.isfinite([joint.lower, joint.upper]).all():
                element.set("range", written([joint.lower, joint.upper]))
        if kind in ("hinge", "ball") and np.any(place[:3, 3]):
            element.set("pos", written(place[:3, 3]))
        for attribute, field in FORCES.items():
            if getattr(joint, field):
                element.set(attribute, written(getattr(joint, field)))
        if joint.stiffness and kind != "ball":
            element.set("springref", written(joint.spring_reference))
        if np.isfinite(joint.effort) and joint.effort and kind in ("hinge", "slide"):
            element.set("actuatorfrcrange", written([-joint.effort, joint.effort]))

    def dress(self, body: XmlElement, link: Link) -> None:
        """A body's inertia, geoms and the sites its closures use."""
        self.bodies[link.name] = body
        inertia = link.inertia
        if inertia is not None and inertia.mass and body.tag == "body":
            moments, axes = np.linalg.eigh(inertia.rotational)
            if moments[0] + moments[1] < moments[2] * (1 - 1e-9):
                message = f"no body has such moments of inertia ({written(moments)}), and MuJoCo refuses them"
                raise cannot(self.description, f"link '{link.name}'", message)
            axes[:, 0] *= np.sign(np.linalg.det(axes))
            moments = np.clip(moments, 0.0, moments[:2].clip(0.0).sum())
            said = {"pos": "0 0 0", **_pose(frame(inertia.com, axes)), "mass": written(inertia.mass)}
            etree.SubElement(body, "inertial", said | {"diaginertia": written(moments)})
        for visual in link.visuals:
            self.geom(body, visual)

    def geom(self, body: XmlElement, visual: Visual) -> None:
        """A shape that is seen and touches nothing."""
        shape, size = visual.shape, visual.shape.size
        said = {"type": shape.kind, **_pose(visual.placement), "rgba": written(visual.rgba)}
        said |= {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0"}
        if shape.kind == "mesh":
            file = shape.mesh or ""
            if Path(file).suffix.lower() not in _MESHES or not (self.folder / file).is_file():
                self.undrawn.append(file)
                return
            said["mesh"] = self.meshes.setdefault((file, size), f"mesh_{len(self.meshes) + 1}")
        else:
            half = {"box": (0.5, 0.5, 0.5), "cylinder": (1.0, 0.5), "capsule": (1.0, 0.5)}.get(shape.kind, (1.0,) * 3)
            said["size"] = written([value * factor for value, factor in zip(size, half, strict=False)])
        etree.SubElement(body, "geom", said)

    def equalities(self) -> None:
        """Closures between sites, couplings between joints."""
        section = etree.SubElement(self.root, "equality")
        for closure in self.description.closures:
            if closure.kind == "distance":
                self.rod(section, closure)
                continue
            if closure.kind not in _CLOSURES:
                message = f"MJCF has no {closure.kind} closure, only {', '.join(_CLOSURES)}, distance"
                raise cannot(self.description, f"closure '{closure.name}'", message)
            if closure.kind == "fixed":
                self.between(section, "weld", closure.name, closure, IDENTITY)
                continue
            self.between(section, "connect", closure.name, closure, IDENTITY)
            if closure.kind == "revolute":
                along = frame([0.0, 0.0, self.description.size])
                self.between(section, "connect", f"{closure.name}_axis", closure, along)
        for coupling in self.description.couplings:
            self.coupling(section, coupling)

    def between(self, section: XmlElement, kind: str, name: str, closure: LoopClosure, along: Array) -> None:
        """One equality between a site on each of the two bodies."""
        first, second = self.sites(name, closure, along)
        etree.SubElement(section, kind, name=name, site1=first, site2=second, **self.softness(closure.name))

    def softness(self, name: str) -> Mapping[str, str]:
        """What the file said of how soft a closure or coupling is."""
        return self.description.solver.equalities.get(name, {})

    def rod(self, section: XmlElement, closure: LoopClosure) -> None:
        """A tendon straight from site to site, as much longer than where the bodies are drawn as its length asks."""
        poses = zero_poses(self.description.root, self.description.joints)
        a, b = (poses[link] @ place for link, place in closure.ends)
        longer = float(closure.length or 0.0) - float(np.linalg.norm((b - a)[:3, 3]))
        tendons = self.root.find("tendon")
        tendons = etree.SubElement(self.root, "tendon") if tendons is None else tendons
        tendon = etree.SubElement(tendons, "spatial", name=f"{closure.name}_rod")
        for site in self.sites(closure.name, closure, IDENTITY):
            etree.SubElement(tendon, "site", site=site)
        said = {"name": closure.name, "tendon1": f"{closure.name}_rod", "polycoef": written([longer, 0, 0, 0, 0])}
        etree.SubElement(section, "tendon", said, **self.softness(closure.name))

    def sites(self, name: str, closure: LoopClosure, along: Array) -> list[str]:
        """A site on each of the two bodies; returns their names."""
        sites = []
        for side, (link, placement) in zip("ab", closure.ends, strict=True):
            sites.append(f"{name}_{side}")
            place = np.asarray(placement) @ along
            # sites stand after a body's joints and geoms, before the bodies on it
            etree.SubElement(self.bodies[link], "site", name=sites[-1], **({"pos": "0 0 0"} | _pose(place)))
        return sites

    def coupling(self, section: XmlElement, coupling: Coupling) -> None:
        """y = p(x), or y constant, by joint displacements from zero, where the bodies are drawn."""
        hints = self.description.dependent_hint
        terms = sorted(coupling.terms, key=lambda term: (term.joint not in hints, len(_trimmed(term))))
        where = f"coupling '{coupling.name}'"
        straight = [term for term in terms if len(_trimmed(term)) == 2]
        curved = [term for term in terms if len(_trimmed(term)) > 2]
        if not straight or len(curved) > 1:
            message = "MJCF wants a sum of joints, or that as a polynomial of one more joint"
            raise cannot(self.description, where, message)
        if len(terms) == 2:
            curved = [term for term in terms if term is not straight[0]]
        own = [term for term in straight if term not in curved]
        slope = _trimmed(own[0])[1] if len(own) == 1 else 1.0
        fixed = sum(term.coefficients[0] for term in terms if term not in (*own, *curved) if term.coefficients)
        rest = -sum(map(_polynomial, curved), Polynomial([fixed + sum(_polynomial(term)(0.0) for term in own)])) / slope
        if rest.degree() > _LARGEST_POWER:
            raise cannot(self.description, where, f"MJCF's polynomials end at the power {_LARGEST_POWER}")
        coefficients = [*rest.coef.tolist(), 0.0, 0.0, 0.0, 0.0][: _LARGEST_POWER + 1]
        said = {"name": coupling.name, "polycoef": written(coefficients)}
        if len(own) == 1:
            kind, names = "joint", [own[0].joint, *(term.joint for term in curved)]
        else:
            kind = "tendon"
            names = [self.tendon(f"{coupling.name}_sum", {term.joint: _trimmed(term)[1] for term in own})]
            names += [self.tendon(f"{coupling.name}_by", {term.joint: 1.0}) for term in curved]
        said |= {f"{kind}{place}": name for place, name in enumerate(names, start=1)}
        etree.SubElement(section, kind, said, **self.softness(coupling.name))

    def tendon(self, name: str, coefficients: Mapping[str, float]) -> str:
        """A <fixed> tendon, whose length is a sum of joint displacements; returns its name."""
        section = self.root.find("tendon")
        section = etree.SubElement(self.root, "tendon") if section is None else section
        element = etree.SubElement(section, "fixed", name=name)
        for joint, coefficient in coefficients.items():
            etree.SubElement(element, "joint", joint=joint, coef=written(coefficient))
        return name

    def actuators(self) -> None:
        """A motor a driven joint; a loop that the file closed around one is not written."""
        section = etree.SubElement(self.root, "actuator")
        for name in self.description.actuated or ():
            motor = self.motors.get(name, Motor(name, name))
            element = etree.SubElement(section, "motor", name=motor.name, joint=name, gear=written(motor.gear))
            bounds = [motor.lower, motor.upper]
            if np.isfinite(bounds).all():
                element.set("ctrlrange", written(bounds))

    def keyframes(self) -> None:
        """The reference pose and the others."""
        section = etree.SubElement(self.root, "keyframe")
        for name, pose in self.description.named_poses.items():
            if pose:
                etree.SubElement(section, "key", name=name, qpos=written(self.qpos(pose)))

    def qpos(self, pose: Mapping[str, tuple[float, ...]]) -> list[float]:
        """A pose as MuJoCo's coordinates; joints it leaves out are at zero."""
        zero = {"ball": (1.0, 0.0, 0.0, 0.0), "free": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)}
        qpos: list[float] = []
        for joint in self.order:
            kind, stated = _TYPES[joint.kind], pose.get(joint.name)
            if kind == "free":
                qpos += _free(joint, stated or (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            elif stated is None:
                qpos += zero.get(kind, (0.0,))
            else:
                qpos += [stated[3], *stated[:3]] if kind == "ball" else stated
        return qpos


def _free(joint: Joint, stated: Iterable[float]) -> list[float]:
    """MuJoCo's position and quaternion (w first) in the world, of a displacement from the joint's placement."""
    x, y, z, *turn = stated
    pose = joint.placement @ frame((x, y, z), Rotation.from_quat(turn).as_matrix())
    a, b, c, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    return [*pose[:3, 3].tolist(), w, a, b, c]


def _trimmed(term: CouplingTerm) -> tuple[float, ...]:
    """A term's coefficients without zeros at the end."""
    return tuple(np.trim_zeros(term.coefficients, "b"))


def _polynomial(term: CouplingTerm) -> Polynomial:
    """A term as a polynomial of the displacement itself."""
    return Polynomial(term.coefficients)(Polynomial([-term.reference, 1.0]))


def _pose(placement: Array) -> dict[str, str]:
    """pos and quat (w first), each where it is not trivial."""
    said = {}
    if np.any(placement[:3, 3]):
        said["pos"] = written(placement[:3, 3])
    if not np.array_equal(placement[:3, :3], np.eye(3)):
        x, y, z, w = Rotation.from_matrix(placement[:3, :3]).as_quat()
        said["quat"] = written([w, x, y, z])
    return said
