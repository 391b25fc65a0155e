"""Parameters of programs: the numbers of models that are made with other constants."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ccpin
from ccpin import programs
from ccpin.description import Inertia, Joint, Link
from ccpin.description.model import frame_from_rpy
from ccpin.errors import InvalidInputError
from ccpin.programs.recording.constants import geometry_of
from ccpin.programs.recording.recorded_mechanism import numbering
from tests.support.linkage_models import transmission_of
from tests.support.rods import rod_four_bar

QUANTITIES = ("mass", "gravity", "forward_dynamics", "energy")


def recorded(model, parameters, what=QUANTITIES):
    """The program of a model with parameters."""
    return programs.record(model, what, parameters=parameters)


def altered(description, *, links=None, joints=None):
    """A description with some links and joints replaced by name."""
    links, joints = links or {}, joints or {}
    return replace(
        description,
        links=tuple(links.get(link.name, link) for link in description.links),
        joints=tuple(joints.get(joint.name, joint) for joint in description.joints),
    )


def heavier(link, mass):
    """A link of another mass and the same shape."""
    inertia = link.inertia
    factor = mass / inertia.mass
    return replace(link, inertia=replace(inertia, mass=mass, rotational=inertia.rotational * factor))


def agree(program, p, changed, what=QUANTITIES):
    """The program at p and the changed model's own, at closed states of the changed one."""
    other = ccpin.ReducedModel(changed) if not isinstance(changed, ccpin.ReducedModel) else changed
    own = numbering(other, other.mechanism.q_reference)
    rng = np.random.default_rng(5)
    plain = programs.record(other, what)
    for _ in range(4):
        state = other.at(other.alpha(other.mechanism.q_reference) + 0.05 * rng.uniform(-1, 1, other.n))
        x, v, u = own.numbers(state.q_free), rng.normal(size=other.n), rng.normal(size=other.n_actuated)
        at = {"q": x[list(own.q.places)], "y": x[list(own.dependent)], "v": v}
        found, wanted = program(**at, u=u, p=p), plain(**at, u=u)
        terms = state.terms(v)
        np.testing.assert_allclose(found["mass"], terms.D, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found["gravity"], terms.g, rtol=1e-9, atol=1e-11)
        q_dd = state.forward_dynamics(v, u)
        np.testing.assert_allclose(found["forward_dynamics"], q_dd, rtol=1e-9, atol=1e-9 * np.abs(q_dd).max())
        np.testing.assert_allclose(found["energy"], wanted["energy"], rtol=1e-9, atol=1e-11)
        assert found.status == 0


def closed(model, names, p, changed):
    """The closures of a model with parameters hold at closed states of the changed one, and not at its own."""
    program, other = recorded(model, names, "closure"), ccpin.ReducedModel(changed)
    own = numbering(other, other.mechanism.q_reference)
    for step in (-0.05, 0.0, 0.08):
        x = own.numbers(other.sigma(other.alpha(other.mechanism.q_reference) + step))
        at = {"q": x[list(own.q.places)], "y": x[list(own.dependent)]}
        np.testing.assert_allclose(program(**at, p=p)["closure"], 0.0, rtol=0, atol=1e-12)
        assert np.abs(program(**at, p=np.array(program.example)[-len(names) :])["closure"]).max() > 1e-3


@pytest.fixture(scope="module")
def mechanism():
    """The five-bar."""
    return ccpin.load("rpdr")


def massive(mechanism):
    """Names of links that have a mass."""
    return [link.name for link in mechanism.description.links if link.inertia is not None and link.inertia.mass]


def test_masses_damping_rotors_springs_and_gravity(mechanism):
    """Two masses, and a joint's damping, rotor inertia and spring."""
    description = mechanism.description
    links = {link.name: link for link in description.links}
    names, joint = massive(mechanism)[:2], next(j for j in description.joints if j.kind == "revolute")
    parameters = [*(f"mass:{name}" for name in names), "gravity"]
    parameters += [f"{kind}:{joint.name}" for kind in ("damping", "armature", "stiffness")]
    program = recorded(ccpin.ReducedModel(mechanism), parameters)
    assert program.inputs[-1].name == "p"
    assert program.inputs[-1].entries == tuple(parameters)
    masses = [1.7 * links[name].inertia.mass for name in names]
    changed = altered(
        description,
        links={name: heavier(links[name], mass) for name, mass in zip(names, masses, strict=True)},
        joints={joint.name: replace(joint, damping=0.4, armature=0.03, stiffness=2.0)},
    )
    other = ccpin.ReducedModel(ccpin.load(changed), gravity=(0.0, 0.0, -1.62))
    agree(program, [*masses, 1.62, 0.4, 0.03, 2.0], other)


def test_the_models_own_numbers_change_nothing(mechanism):
    """At its example a program with parameters gives what one without gives."""
    model = ccpin.ReducedModel(mechanism)
    length = next(j.name for j in mechanism.tree.joints if np.linalg.norm(j.placement[:3, 3]) > 0)
    program = recorded(model, ["gravity", f"length:{length}", f"mass:{massive(mechanism)[0]}"])
    ends = np.cumsum([port.size for port in program.inputs])[:-1]
    at = dict(zip((port.name for port in program.inputs), np.split(np.array(program.example), ends), strict=True))
    found = program(**at)
    del at["p"]
    wanted = programs.record(model, QUANTITIES)(**at)
    for name in QUANTITIES:
        np.testing.assert_allclose(found[name], wanted[name], rtol=1e-11, atol=1e-12)


def test_lengths(mechanism):
    """A link longer between its joints, and a closure's frame farther out."""
    joint = next(j for j in mechanism.tree.joints if j.parent and np.linalg.norm(j.placement[:3, 3]) > 0)
    loop = mechanism.parametrization().constraints.loops[0]
    names = [f"length:{joint.name}", f"length:{loop.closure.name}/A"]
    program = recorded(ccpin.ReducedModel(mechanism), names)
    own = [np.linalg.norm(joint.placement[:3, 3]), np.linalg.norm(loop.frame_a[:3, 3])]
    p = 1.05 * np.array(own)

    def longer(frame):
        frame = np.array(frame)
        frame[:3, 3] *= 1.05
        return frame

    description = mechanism.description
    stated = next(j for j in description.joints if j.name == joint.name)
    closures = tuple(
        replace(each, placement_a=longer(each.placement_a)) if each.name == loop.closure.name else each
        for each in description.closures
    )
    changed = altered(description, joints={joint.name: replace(stated, placement=longer(stated.placement))})
    agree(program, p, ccpin.load(replace(changed, closures=closures)))


def test_origins_along_the_axes_of_links():
    """A joint's origin and a closure's, the latter on a plate that is fixed to its body, turned and off."""
    description = rod_four_bar()
    (rod,) = description.closures
    mount = frame_from_rpy((0.02, 0.01, -0.03), (0.3, -0.7, 1.1))
    held = Joint("mount", "fixed", "crank", "plate", mount)
    on_plate = replace(rod, link_a="plate", placement_a=np.linalg.inv(mount) @ rod.placement_a)
    whole = replace(
        description, links=(*description.links, Link("plate")), joints=(*description.joints, held), closures=(on_plate,)
    )
    names = ["origin:rocker/x", "origin:rod/A/x", "origin:rod/A/y", "origin:rod/A/z", "distance:rod"]
    program = recorded(ccpin.ReducedModel(ccpin.load(whole)), names)
    rocker = next(joint for joint in whole.joints if joint.name == "rocker")
    p = np.array([rocker.placement[0, 3], *on_plate.placement_a[:3, 3], rod.length])
    np.testing.assert_array_equal(p, np.array(program.example)[-5:])
    p = p + [0.01, 0.004, -0.005, 0.006, -0.007]
    moved = replace(on_plate, placement_a=_at(on_plate.placement_a, p[1:4]), length=p[4])
    place = replace(rocker, placement=_at(rocker.placement, [p[0], *rocker.placement[1:3, 3]]))
    changed = ccpin.load(replace(altered(whole, joints={"rocker": place}), closures=(moved,)))
    agree(program, p, changed)
    closed(ccpin.ReducedModel(ccpin.load(whole)), names, p, changed)


def _at(frame, position):
    frame = np.array(frame)
    frame[:3, 3] = position
    return frame


def test_turns_of_frames():
    """Of joints whose axes leave the plane and of a ball's carrier, in x, y, z's order, against frames turned here."""
    description = ccpin.load("stewart").description
    names = ["turn:leg2_pitch/x", "turn:leg2_pitch/y", "turn:leg2_pitch/z", "turn:leg4_extension/x"]
    p = np.array([0.01, -0.02, 0.03, 0.015])
    joints = {}
    for name, angles in (("leg2_pitch", p[:3]), ("leg4_extension", (p[3], 0.0, 0.0))):
        stated = next(joint for joint in description.joints if joint.name == name)
        placement = np.array(stated.placement)
        placement[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix() @ placement[:3, :3]
        joints[name] = replace(stated, placement=placement)
    model, changed = ccpin.ReducedModel(ccpin.load(description)), ccpin.load(altered(description, joints=joints))
    np.testing.assert_array_equal(np.array(recorded(model, names, ("closure",)).example)[-4:], 0.0)
    closed(model, names, p, changed)


def test_ratios_of_couplings():
    """Two of a differential's, one of them with a reference from which its displacement counts."""
    description = transmission_of("neck").joint_model.mechanism.description
    first, second = description.couplings

    def with_ratios(a, b):
        terms = (replace(second.terms[1], coefficients=(0.0, b), reference=0.2), *second.terms[2:])
        one = replace(first, terms=(*first.terms[:2], replace(first.terms[2], coefficients=(0.0, a))))
        return replace(description, couplings=(one, replace(second, terms=(second.terms[0], *terms))))

    joints = first.terms[2].joint, second.terms[1].joint
    names = [f"ratio:{first.name}/{joints[0]}", f"ratio:{second.name}/{joints[1]}"]
    program = recorded(ccpin.ReducedModel(ccpin.load(with_ratios(0.8, -1.0))), names)
    np.testing.assert_array_equal(np.array(program.example)[-2:], [0.8, -1.0])
    agree(program, [0.7, -1.2], ccpin.load(with_ratios(0.7, -1.2)))
    closed(
        ccpin.ReducedModel(ccpin.load(with_ratios(0.8, -1.0))), names, [0.7, -1.2], ccpin.load(with_ratios(0.7, -1.2))
    )
    constant = replace(first, terms=(*first.terms, replace(first.terms[0], joint="left_motor", coefficients=(0.0,))))
    bare = ccpin.ReducedModel(ccpin.load(replace(description, couplings=(constant, second))))
    assert len(geometry_of(bare)) == len(geometry_of(ccpin.ReducedModel(ccpin.load(description))))
    model = ccpin.ReducedModel(transmission_of("neck").joint_model.mechanism)
    every = {each.name: each.value for each in geometry_of(model)}
    assert [name for name in every if name.startswith("ratio")] == [
        f"ratio:{each.name}/{term.joint}" for each in (first, second) for term in each.terms
    ]


def test_a_body_of_several_links(mechanism):
    """A tool fixed to a link whose joint moves: it alone becomes heavier, and the body's centre of mass moves."""
    description = mechanism.description
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -1.0, 0.0], [0.8, 0.0, -0.6], [0.6, 0.0, 0.8]]
    turned[:3, 3] = 0.1, 0.02, -0.05
    tool = Link("tool", Inertia(0.4, np.array([0.03, -0.01, 0.02]), np.diag([2e-4, 3e-4, 4e-4])))
    held = Joint("mount", "fixed", massive(mechanism)[-1], "tool", turned)
    whole = replace(description, links=(*description.links, tool), joints=(*description.joints, held))
    program = recorded(ccpin.ReducedModel(ccpin.load(whole)), ["mass:tool"])
    agree(program, [1.1], ccpin.load(altered(whole, links={"tool": heavier(tool, 1.1)})))


def test_names_that_are_none(mechanism):
    """Unknown kinds and names, a name twice, and a length that is zero."""
    model = ccpin.ReducedModel(mechanism)
    told = dict.fromkeys(("size:link", "gravity:x", "mass", ""), "no parameter")
    for name, word in (told | {"mass:nowhere": "there is no", "length:joint1": "says nothing"}).items():
        with pytest.raises(InvalidInputError, match=word):
            recorded(model, [name])
    with pytest.raises(InvalidInputError, match="twice"):
        recorded(model, ["gravity", "gravity"])
