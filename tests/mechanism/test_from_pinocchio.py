"""Pinocchio models without a file: every joint type against Pinocchio itself, constraints against the URDF+ twin."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics import scratch
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism import describe_pinocchio
from tests.support.reading import read_urdf
from tests.support.sdf_files import COUPLER, ROCKER, four_bar_urdf

URDF = four_bar_urdf()
OPEN = URDF[: URDF.index("<loop")] + "</robot>"
AXIS = np.array([0.0, 0.6, 0.8])


def composite():
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelRX())
    joint.addJoint(pin.JointModelPY(), pin.SE3(pin.utils.rotate("z", 0.4), np.array([0.1, 0.2, 0.3])))
    return joint


JOINTS = {
    "RX": pin.JointModelRX,
    "RevoluteUnaligned": lambda: pin.JointModelRevoluteUnaligned(AXIS),
    "PZ": pin.JointModelPZ,
    "PrismaticUnaligned": lambda: pin.JointModelPrismaticUnaligned(AXIS),
    "RUBY": pin.JointModelRUBY,
    "Spherical": pin.JointModelSpherical,
    "SphericalZYX": pin.JointModelSphericalZYX,
    "Translation": pin.JointModelTranslation,
    "Universal": lambda: pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
    "Planar": pin.JointModelPlanar,
    "FreeFlyer": pin.JointModelFreeFlyer,
    "Composite": composite,
}


def chain(*joints):
    """A model with a body on each joint, one after the other."""
    model, parent = pin.Model(), 0
    random = np.random.default_rng(3)
    for k, joint in enumerate(joints):
        placement = pin.SE3(pin.exp3(random.normal(size=3)), random.normal(size=3))
        parent = model.addJoint(parent, joint, placement, f"j{k}")
        model.appendBodyToJoint(
            parent, pin.Inertia(1.0 + k, random.normal(size=3), np.diag([0.2, 0.3, 0.4])), pin.SE3.Identity()
        )
    return model


class TestJoints:
    """The free system equals the given model's."""

    @pytest.mark.parametrize("name", JOINTS)
    def test_every_joint_moves_as_pinocchios(self, name):
        """Mass matrix and gravity at a random configuration, of a chain of the joint between two hinges."""
        model = chain(pin.JointModelRY(), JOINTS[name](), pin.JointModelRX())
        ours = build_tree(describe_pinocchio(model)).model
        assert (ours.nq, ours.nv) == (model.nq, model.nv)
        q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
        # A circle's frame is turned so that its axis is z, and nothing else: q′ means the same.
        M, theirs = (pin.crba(m, m.createData(), q) for m in (ours, model))
        assert np.allclose(np.triu(M), np.triu(theirs), atol=1e-12)
        g, other = (pin.computeGeneralizedGravity(m, m.createData(), q) for m in (ours, model))
        assert np.allclose(g, other, atol=1e-12)

    def test_a_screw_is_a_hinge_and_a_slide_that_are_coupled(self):
        """With the mass of the screw about its axis as the closed form says: M = axis terms of Pinocchio's own."""
        model = chain(pin.JointModelHelicalUnaligned(AXIS, 0.3))
        mechanism = ccpin.load(model, independent=["j0"])
        D = ccpin.ReducedModel(mechanism).at([0.4]).D
        assert np.allclose(D, pin.crba(model, model.createData(), np.array([0.4])))

    def test_a_mimic_joint_is_a_coupling(self):
        """The reduced mass matrix is that of Pinocchio's mimic model."""
        plain = chain(pin.JointModelRX(), pin.JointModelRY())
        model = pin.buildReducedModel(plain, [], pin.neutral(plain))
        mimic = pin.transformJointIntoMimic(model, 1, 2, 2.0, 0.1)
        mechanism = ccpin.load(mimic, independent=["j0"])
        state = ccpin.ReducedModel(mechanism).at([0.3])
        assert np.allclose(state.q_free, [0.3, 0.7])
        assert np.allclose(state.D, np.triu(pin.crba(mimic, mimic.createData(), np.array([0.3]))))

    def test_limits_and_forces_are_kept(self):
        """Position, effort and velocity limits, armature, damping, friction; what is unlimited is infinite."""
        model = pin.buildModelFromXML(OPEN)
        model.armature, model.damping = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
        model.upperPositionLimit = np.array([1.0, 1e17, 3.0])
        joints = {joint.name: joint for joint in describe_pinocchio(model).joints}
        at = {name: model.idx_vs[model.getJointId(name)] for name in "ABD"}
        for name, k in at.items():
            assert joints[name].armature == model.armature[k]
            assert joints[name].damping == model.damping[k]
            upper = model.upperPositionLimit[k]
            assert joints[name].upper == (np.inf if upper > 1e16 else upper)
            assert (joints[name].effort, joints[name].velocity) == (1.0, 1.0)

    def test_what_has_no_counterpart_is_refused(self):
        """By name; and so is what is no model."""
        with pytest.raises(
            UnsupportedMechanismError, match="joint 'j0': ccpin has no counterpart of JointModelEllipsoid"
        ):
            describe_pinocchio(chain(pin.JointModelEllipsoid(1.0, 1.0, 2.0)))
        with pytest.raises(InvalidInputError, match=r"a pinocchio\.Model is needed, not str"):
            describe_pinocchio("model")


def reduced(mechanism, q=0.15, v=0.7, u=0.3):
    state = ccpin.ReducedModel(mechanism).at([q])
    return np.concatenate([state.D.ravel(), state.C([v]) @ [v], state.g, state.forward_dynamics([v], [u])])


TWIN = reduced(ccpin.load(read_urdf(URDF.encode(), None), independent=["A"], actuated=["A"]))


class TestConstraints:
    """The four-bar from a Pinocchio model and its constraints, against its URDF+ file."""

    @pytest.fixture
    def model(self):
        return pin.buildModelFromXML(OPEN)

    def ends(self, model):
        """Joints and placements of the two ends of the loop."""
        return (
            model.getJointId("B"),
            pin.SE3(np.eye(3), np.array([COUPLER, 0, 0])),
            model.getJointId("D"),
            pin.SE3(np.eye(3), np.array([ROCKER, 0, 0])),
        )

    @pytest.mark.parametrize(
        "build",
        [
            lambda model, ends: pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends),
            lambda model, ends: pin.PointAnchorConstraintModel(model, *ends),
        ],
        ids=["rigid", "anchor"],
    )
    def test_a_point_constraint_closes_the_loop(self, model, build):
        """Equal reduced dynamics."""
        constraint = build(model, self.ends(model))
        mechanism = ccpin.load(model, constraints=[constraint], independent=["A"], actuated=["A"])
        assert [c.kind for c in mechanism.closures] == ["spherical"]
        assert np.allclose(reduced(mechanism), TWIN, rtol=1e-9, atol=1e-11)

    def test_a_6d_constraint_is_a_weld(self, model):
        """And an unknown one is refused."""
        weld = pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, *self.ends(model))
        assert [c.kind for c in describe_pinocchio(model, constraints=[weld]).closures] == ["fixed"]
        with pytest.raises(InvalidInputError, match="constraint 1 is a str"):
            describe_pinocchio(model, constraints=["weld"])

    def test_our_closures_close_it_too(self, model):
        """LoopClosure between the links named as the model's bodies."""
        (closure,) = read_urdf(URDF.encode(), None).closures
        mechanism = ccpin.load(model, closures=[closure], independent=["A"], actuated=["A"])
        assert np.allclose(reduced(mechanism), TWIN, rtol=1e-9, atol=1e-11)

    def test_the_model_is_left_alone(self, model):
        """Loading reads, and writes nothing."""
        before = model.copy()
        describe_pinocchio(model)
        assert model == before


def test_geometries_are_drawn_where_they_are():
    """Shapes on their joints' links, and an unknown one noted."""
    coal = pytest.importorskip("coal")
    model = pin.buildModelFromXML(OPEN)
    geometry = pin.GeometryModel()
    shapes = {
        "box": coal.Box(1, 2, 3),
        "sphere": coal.Sphere(0.5),
        "cylinder": coal.Cylinder(0.1, 0.4),
        "capsule": coal.Capsule(0.1, 0.4),
        "ellipsoid": coal.Ellipsoid(1, 2, 3),
        "cone": coal.Cone(0.1, 0.2),
    }
    joint = model.getJointId("A")
    for name, shape in shapes.items():
        thing = pin.GeometryObject(name, joint, pin.SE3(np.eye(3), np.array([0, 0, 1.0])), shape)
        thing.meshColor = np.array([1.0, 0, 0, 1])
        geometry.addGeometryObject(thing)
    description = describe_pinocchio(model, geometry=geometry)
    visuals = next(link for link in description.links if link.name == "crank").visuals
    assert [visual.shape.kind for visual in visuals] == list(shapes)[:5]
    assert visuals[0].shape.size == (1.0, 2.0, 3.0)
    assert visuals[2].shape.size == (0.1, 0.4)
    assert any("'cone'" in note for note in description.notes)


def test_a_model_too_large_for_memory_is_refused_by_name(monkeypatch):
    """A raw MemoryError says nothing of the file."""

    def exhausted(*_):
        raise MemoryError

    monkeypatch.setattr("ccpin.mechanism.loading.analysis.build_tree", exhausted)
    with pytest.raises(UnsupportedMechanismError, match=r"rpdr\.urdf: \d+ joints do not fit into memory"):
        ccpin.load("rpdr")


def test_what_would_not_fit_is_refused_before_it_is_taken(monkeypatch):
    """Pinocchio's derivatives of second order take nv³ numbers: 400 joints 2 GB, at once and without asking."""
    monkeypatch.setattr(scratch, "available_memory", lambda: 4.0 * 8.0 * 4**3)
    with pytest.raises(UnsupportedMechanismError, match=r"rpdr\.urdf: 4 velocities take .* GB"):
        ccpin.load("rpdr")
    monkeypatch.undo()
    assert scratch.available_memory() > 1e6
    assert ccpin.load("rpdr").n == 2
