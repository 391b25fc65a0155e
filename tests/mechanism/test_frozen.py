"""Nothing of a mechanism can be written to, and the Pinocchio model it hands out is the caller's own."""

import pickle
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from operator import setitem

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.arrays import FrozenMapping
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.errors import CcpinError
from ccpin.kinematics.scratch import Scratch

IMMUTABLE = (str, int, float, bool, type(None), slice)
REFUSED = (AttributeError, TypeError, ValueError)


def refuses(write, *arguments):
    """Whether a way of writing raises."""
    try:
        write(*arguments)
    except REFUSED:
        return True
    return False


def names_of(thing):
    return [field.name for field in fields(thing)] if is_dataclass(thing) else list(getattr(thing, "_fields", ()))


def writable(thing, path, seen):
    """Where anything reachable can be written to, as paths.

    Pinocchio's model apart, of which users get a copy, and its pool of memory, which nobody reads before writing to it.
    """
    if id(thing) in seen or isinstance(thing, (*IMMUTABLE, pin.Model)):
        return []
    seen[id(thing)] = thing
    if isinstance(thing, Scratch):
        return [] if refuses(setattr, thing, "model", thing.model) else [f"{path}.model"]
    names = names_of(thing)
    found = [f"{path}.{name}" for name in names if not refuses(setattr, thing, name, getattr(thing, name))]
    found += [f"{path}.new"] * (not refuses(setattr, thing, "new", 1))
    inside = {f".{name}": getattr(thing, name) for name in names}
    if isinstance(thing, np.ndarray):
        found += [f"{path}[...]"] * (thing.size > 0 and not refuses(setitem, thing, ..., thing.copy()))
        found += [f"{path}.flags"] * (not refuses(thing.setflags, True))
    elif isinstance(thing, Mapping):
        found += [f"{path}[{key!r}]" for key in thing if not refuses(setitem, thing, key, thing[key])]
        inside |= {f"[{key!r}]": value for key, value in thing.items()}
    elif isinstance(thing, tuple):
        inside |= {f"[{k}]": value for k, value in enumerate(thing)}
    elif not names:
        found.append(f"{path}: {type(thing).__name__}")
    return found + [where for name, held in inside.items() for where in writable(held, path + name, seen)]


def built_in_python():
    """A geared four-bar described with lists and writable arrays only."""
    links = [Link("base"), *(Link(name, Inertia(1.0, [0.5, 0, 0], 0.1 * np.eye(3))) for name in "abc")]
    out = np.eye(4)
    out[0, 3] = 1.0
    joints = [
        Joint("ja", "revolute", "base", "a", np.eye(4), [0.0, 0, 1]),
        Joint("jb", "revolute", "a", "b", out, np.array([0.0, 0, 1])),
        Joint("jc", "revolute", "base", "c", out.tolist(), [0, 0, 1]),
        Joint("jd", "revolute", "base", "d", out, [0, 0, 1]),
    ]
    return MechanismDescription(
        "geared",
        "base",
        [*links, Link("d", Inertia(1.0, np.zeros(3), np.eye(3)))],
        joints,
        closures=[LoopClosure("pin", "spherical", "b", "c", out, out.tolist())],
        couplings=[Coupling("gear", [CouplingTerm("ja", [0.0, 1.0]), CouplingTerm("jd", np.array([0.0, -2.0]))])],
        independent=["ja"],
        reference={"ja": [0.7], "jb": np.array([-0.7])},
        gravity=np.array([0.0, -9.81, 0.0]),
        notes=["built by hand"],
    )


@pytest.fixture(scope="module", params=["rpdr", "stewart", "python"])
def mechanism(request):
    """Mechanisms from files and one described in Python."""
    return ccpin.load(built_in_python() if request.param == "python" else request.param)


def test_the_walk_sees_what_is_writable():
    """The walk of these tests finds lists, mappings and arrays that can be written to."""
    assert writable(({"a": 1}, np.ones(2)), "it", {}) == ["it[0]['a']", "it[1][...]", "it[1].flags"]
    assert writable(([1],), "it", {}) == ["it[0]: list"]


@pytest.mark.parametrize("protocol", [None, *range(2, pickle.HIGHEST_PROTOCOL + 1)])
def test_nothing_can_be_written(mechanism, protocol):
    """Every attribute, entry and array reachable refuses to be written to, also after a pickle."""
    seen = {}
    copy = mechanism if protocol is None else pickle.loads(pickle.dumps(mechanism, protocol))
    assert writable(copy, "mechanism", seen) == []
    assert sum(isinstance(thing, np.ndarray) for thing in seen.values()) > 10
    assert any(thing is copy.tree.attachments for thing in seen.values())


def test_frozen_mappings():
    """A frozen mapping is equal to a dictionary of the same items, hashable accordingly, and picklable."""
    mapping = FrozenMapping({"a": (1.0,), "b": (2.0,)})
    assert mapping == {"b": (2.0,), "a": (1.0,)}
    assert len({mapping, FrozenMapping(dict(mapping)), pickle.loads(pickle.dumps(mapping))}) == 1
    assert repr(mapping) == "FrozenMapping({'a': (1.0,), 'b': (2.0,)})"
    for write in (lambda: setattr(mapping, "_items", {}), lambda: delattr(mapping, "_items")):
        assert refuses(write)


def test_what_the_caller_keeps_is_the_callers():
    """Arrays, lists and dictionaries given are copied: writing to them later changes nothing."""
    placement, terms, reference = np.eye(4), [CouplingTerm("a", [0.0, 1.0])], {"a": [0.1]}
    joint, coupling = Joint("a", "revolute", "base", "tip", placement), Coupling("gear", terms)
    description = MechanismDescription("m", "base", [], [joint], couplings=[coupling], reference=reference)
    placement[0, 3], reference["a"] = 5.0, [7.0]
    terms.clear()
    assert joint.placement[0, 3] == 0.0
    assert len(coupling.terms) == 1
    assert description.reference == {"a": (0.1,)}


def test_identity(mechanism):
    """A mechanism is equal to itself only, and can be a key."""
    other = replace(mechanism)
    assert len({mechanism, other, mechanism}) == 2
    assert mechanism == mechanism
    assert mechanism != other


def test_pin_model_is_the_callers_own(mechanism):
    """Gravity, inertias and placements written to `pin_model` change no result, bit for bit."""

    def results(which):
        model = ccpin.ReducedModel(which)
        q = model.alpha(which.q_reference)
        v, u = np.full(model.n, 0.3), np.full(model.n_actuated, 0.2)
        return [model.sigma(q), *model.terms(q, v), model.forward_dynamics(q, v, u)]

    own, before = mechanism.pin_model, results(mechanism)
    assert own is mechanism.pin_model
    own.gravity = pin.Motion.Zero()
    own.armature = np.ones(own.nv)
    for joint in range(1, own.njoints):
        own.inertias[joint] = pin.Inertia.Random()
        own.jointPlacements[joint] = pin.SE3.Random()
    for which in (mechanism, pickle.loads(pickle.dumps(mechanism))):
        for a, b in zip(before, results(which), strict=True):
            np.testing.assert_array_equal(a, b)


def test_one_line(mechanism):
    """`repr` is one line with what identifies the mechanism; a notebook gets a table with its notes."""
    line = repr(mechanism)
    assert line.startswith(f"Mechanism(name: {mechanism.name}, n: {mechanism.n}, n′: {mechanism.n_free}, loops: ")
    for text in (line, mechanism._repr_html_()):
        assert all(name in text for name in (*mechanism.independent, *mechanism.actuated))
        assert all(closure.name in text for closure in mechanism.closures)
    assert all(note in mechanism._repr_html_() for note in mechanism.notes)
    for thing in (mechanism, mechanism.tree, mechanism.description, ccpin.ReducedModel(mechanism)):
        assert "\n" not in repr(thing)
        assert len(repr(thing)) < 500


def test_names_are_escaped_in_the_table(rpdr):
    """A name that looks like markup is shown, not obeyed."""
    named = replace(rpdr, description=replace(rpdr.description, name="<b>&"))
    assert "<td>&lt;b&gt;&amp;</td>" in named._repr_html_()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"placement": "nowhere"}, r"Joint\.placement must be a 4×4 matrix, a pinocchio\.SE3 or"),
        ({"placement": [[1, 0], [0]]}, r"Joint\.placement must be a 4×4 matrix, a pinocchio\.SE3 or"),
        ({"placement": np.eye(3)}, r"Joint\.placement must be a 4×4 matrix, .*not array"),
        ({"axis": [1.0, 0.0]}, r"joint 'joint1': the axis"),
    ],
)
def test_arrays_of_the_wrong_shape_are_named(rpdr, change, message):
    """An array that cannot be one, or not of its shape, is refused with what it must be."""
    joints = rpdr.description.joints
    with pytest.raises(CcpinError, match=message):
        ccpin.load(replace(rpdr.description, joints=(replace(joints[0], **change), *joints[1:])))
