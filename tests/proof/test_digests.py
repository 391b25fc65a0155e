"""Digests tell what an object is about, and no public function combines objects of two mechanisms."""

from __future__ import annotations

import copy
import inspect
import pickle
from dataclasses import replace
from functools import cached_property
from importlib import import_module

import numpy as np
import pytest

import ccpin
from ccpin import control, domain, plotting, simulation, validated
from ccpin.control import PDFullGravity, PDSimpleGravity, PointToPoint, TorqueFunction
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.covering import runner, sources
from ccpin.covering.proposals import tasks
from ccpin.description import scaled
from ccpin.errors import CcpinError, DifferentSubjectsError
from ccpin.identification import AdaptiveTracking
from ccpin.proof.digests import Digests, UndigestedError, digest, require_same
from ccpin.simulation.plant.stick_slip import friction_force
from ccpin.simulation.results import saving
from ccpin.simulation.results.forces import closure_forces_at
from ccpin.transmission import Transmission

GOAL, GAINS = [-1.57, -1.75], ([11.0, 11.0], [0.65, 0.60])
REGION = (np.array([-1.65, -1.85]), np.array([-1.5, -1.65]))


@pytest.fixture(scope="module")
def others(rpdr):
    """The same names and sizes: a rod 1 mm longer, other masses, another gravity; as models."""
    longer = scaled(rpdr.description, lengths={"link3": 1.0 + 1e-3 / 0.3048})
    heavier = scaled(rpdr.description, masses={"link3": 1.1})
    return {
        "lengths": ccpin.ReducedModel(ccpin.load(longer)),
        "masses": ccpin.ReducedModel(ccpin.load(heavier)),
        "gravity": ccpin.ReducedModel(rpdr, gravity=(0.0, -4.9, 0.0)),
    }


class Things:
    """What functions combine, of one model."""

    def __init__(self, model):
        self.model, self.mechanism = model, model.mechanism
        self.law = PDSimpleGravity(model, GOAL, *GAINS)
        self.full = PDFullGravity(model, GOAL, *GAINS)
        self.motion = ccpin.simulate(model, self.law, np.array(GOAL) - 0.05, duration=0.02)
        simulator = ccpin.Simulator(model, self.law)
        simulator.reset(GOAL)
        simulator.advance(0.01)
        self.simulator, self.memory = simulator, simulator.memory
        self.memory = self.memory() if callable(self.memory) else self.memory

    @cached_property
    def atlas(self):
        return domain.certify(self.mechanism, GOAL, REGION)

    @cached_property
    def cover(self):
        return domain.certify_singularities(self.mechanism, REGION)

    @cached_property
    def sheets(self):
        return domain.certify_sheets(self.mechanism, REGION)

    @cached_property
    def certificate(self):
        return control.certify_set_point(self.model, GOAL, *GAINS, max_depth=10, budget=60)


@pytest.fixture(scope="module")
def ours(rpdr):
    return Things(ccpin.ReducedModel(rpdr))


@pytest.fixture(scope="module")
def theirs(others):
    return {name: Things(model) for name, model in others.items()}


def tracking(model):
    """A law that follows a reference."""
    return control.ComputedTorque(model, PointToPoint(model, GOAL, [-1.5, -1.7], 0.5), [9.0, 9.0], [6.0, 6.0])


def adaptive(model):
    """One that learns masses on the way."""
    reference = PointToPoint(model, GOAL, [-1.5, -1.7], 0.5)
    return AdaptiveTracking(model, reference, 9.0, [0.5, 0.5], gain=1.0, period=1e-3, adapted="body")


def passive(things):
    """From its motors to its passive joints."""
    return Transmission(things.model, ["joint3", "joint4"])


EVERY = ("lengths", "masses", "gravity")
CLOSURES = ("lengths",)
MECHANISMS = ("lengths", "masses")  # a State is of a mechanism, whatever gravity
# function: (what must differ for it to be refused, how it is called with objects of two mechanisms)
CROSSED = {
    "Trajectory.then": (EVERY, lambda a, b: a.motion.then(b.motion)),
    "Trajectory.states": (CLOSURES, lambda a, b: list(a.motion.states(b.model))),
    "Trajectory.energy": (EVERY, lambda a, b: a.motion.energy(b.model)),
    "Simulator.recall": (EVERY, lambda a, b: a.simulator.recall(b.memory)),
    "closure_forces": (EVERY, lambda a, b: simulation.closure_forces(a.model, b.motion)),
    "closure_forces_at": (
        MECHANISMS,
        lambda a, b: closure_forces_at(a.model, b.model.at(GOAL), [0.0, 0.0], [0.0, 0.0]),
    ),
    "joint_forces": (EVERY, lambda a, b: simulation.joint_forces(a.model, b.motion)),
    "demands": (EVERY, lambda a, b: simulation.demands(a.model, b.motion)),
    "exceeded": (CLOSURES, lambda a, b: simulation.exceeded(a.model, b.motion)),
    "friction_force": (
        MECHANISMS,
        lambda a, b: friction_force(a.model, 0.1, b.model.at(GOAL), [0, 0], [0, 0]),
    ),
    "set_point_metrics": (CLOSURES, lambda a, b: simulation.set_point_metrics(a.motion, b.mechanism, GOAL)),
    "lyapunov_along": (EVERY, lambda a, b: simulation.lyapunov_along(a.law, b.motion)),
    "plot_motion": (CLOSURES, lambda a, b: plotting.plot_motion(a.motion, b.mechanism)),
    "plot_atlas": (CLOSURES, lambda a, b: plotting.plot_atlas(a.mechanism, b.atlas)),
    "plot_radius_map": (CLOSURES, lambda a, b: plotting.plot_radius_map(a.mechanism, b.atlas, 4)),
    "plot_sheets": (CLOSURES, lambda a, b: plotting.plot_sheets(a.mechanism, b.sheets)),
    "certify_set_point": (CLOSURES, lambda a, b: control.certify_set_point(a.model, GOAL, *GAINS, b.atlas)),
    "certify_law": (CLOSURES, lambda a, b: certify_law(a.law, b.atlas)),
    "suggest_gains": (CLOSURES, lambda a, b: control.suggest_gains(a.model, GOAL, b.atlas)),
    "certify_move": (EVERY, lambda a, b: validated.certify_move(a.model, b.law, GOAL, arrival=0.1)),
    "certify_move, arrival": (
        EVERY,
        lambda a, b: validated.certify_move(a.model, a.law, GOAL, arrival=b.certificate),
    ),
    "enclose": (EVERY, lambda a, b: validated.enclose(a.model, b.full, GOAL, None, 0.01)),
    "enclose, law (28)": (CLOSURES, lambda a, b: validated.enclose(a.model, b.law, GOAL, None, 0.01)),
    "enclose_set": (EVERY, lambda a, b: validated.enclose_set(a.model, b.full, GOAL, None, 0.01, spread=1e-6)),
    "certify_sheets": (CLOSURES, lambda a, b: domain.certify_sheets(a.mechanism, REGION, begun=b.sheets)),
    "SingularCover.crossed": (CLOSURES, lambda a, b: a.cover.crossed(b.atlas)),
    "merge": (
        CLOSURES,
        lambda a, b: domain.merge(
            [
                domain.certify(one.mechanism, np.mean(part, axis=0), part)
                for one, part in zip((a, b), domain.split_region(REGION, 2), strict=True)
            ]
        ),
    ),
    "ReducedModel.at": (MECHANISMS, lambda a, b: a.model.at(b.model.at(GOAL))),
    "linearize": (MECHANISMS, lambda a, b: ccpin.dynamics.linearize(a.model, b.model.at(GOAL), [0.0, 0.0])),
    "PDSimpleGravity": (MECHANISMS, lambda a, b: PDSimpleGravity(a.model, b.model.at(GOAL), *GAINS)),
    "PDSimpleGravity.lyapunov": (MECHANISMS, lambda a, b: a.law.lyapunov(b.model.at(GOAL), np.zeros(2))),
    "PDFullGravity.lyapunov": (MECHANISMS, lambda a, b: a.full.lyapunov(b.model.at(GOAL), np.zeros(2))),
    "PDFullGravity": (MECHANISMS, lambda a, b: PDFullGravity(a.model, b.model.at(GOAL), *GAINS)),
    "OnlineLaw": (
        EVERY,
        lambda a, b: control.OnlineLaw(tracking(a.model), control.OnlineSigma(b.model, b.model.at(GOAL).q_free)),
    ),
    "AdaptiveTracking.lyapunov": (
        MECHANISMS,
        lambda a, b: adaptive(a.model).lyapunov(0.0, b.model.at(GOAL), np.zeros(2), np.ones(4), np.ones(4)),
    ),
    "AdaptiveTracking.estimates": (CLOSURES, lambda a, b: adaptive(a.model).estimates(b.motion)),
    "AdaptiveTracking.program": (MECHANISMS, lambda a, b: adaptive(a.model).program(near=b.model.at(GOAL))),
    "Transmission.at": (MECHANISMS, lambda a, b: passive(a).at(passive(b).reference.q_joint, b.model.at(GOAL))),
    "Transmission.at_motor": (MECHANISMS, lambda a, b: passive(a).at_motor(GOAL, passive(b).at_motor(GOAL))),
    "Simulator.reset": (MECHANISMS, lambda a, b: a.simulator.reset(b.model.at(GOAL))),
}
ALLOWED = {
    "ReducedModel.reading": "a law of a nominal model reads q and q̇ of the plant's State",
    "ReducedModel.reading_rate": "as reading",
    "load": "a Pinocchio model and its own geometry",
    "simulate": "a law of a nominal model on a plant is what people simulate",
    "Simulator": "as simulate",
    "supervise": "as simulate",
    "sweep": "as simulate",
    "State": "made by a model only",
    "State.of": "the model's own",
    "ComputedTorque": "a reference says q_d(t) in numbers; its model is the law's",
    "PDPlus": "as ComputedTorque",
    "PDOnlineGravity": "as ComputedTorque",
    "TrackingLaw": "as ComputedTorque",
    "AdaptiveTracking": "as ComputedTorque",
    "AdaptiveTracking.step": "as ControlLaw.torque",
    "AdaptiveTracking.torque": "as ControlLaw.torque",
    "ControlLaw.torque": "a State of the plant: a nominal law reads q and v of it",
    "OnlineLaw.torque": "as ControlLaw.torque; it reads q alone",
    "PDSimpleGravity.torque": "as ControlLaw.torque",
    "PDFullGravity.torque": "as ControlLaw.torque",
    "Trajectory.of": "is the comparison",
    "Log.of": "asks Trajectory.of",
    "TrackingLaw.torque": "as ControlLaw.torque",
    "TrackingLaw.torque_with": "as ControlLaw.torque",
    "TrackingLaw.brake": "as ControlLaw.torque",
    "cusps": "curves are where a search begins; each cusp is proved of the mechanism",
    "plot_singularities": "curves are arrays of numbers, drawn as they are",
    "Atlas.is_about": "asks just that",
    "ProgramCertificate.is_about": "asks just that",
    "SheetAtlas.is_about": "asks just that",
    "SingularCover.is_about": "asks just that",
    "Mechanism": "made by load only",
    "AdaptiveCertificate": "made by certify_adaptive only, with the tube of its law's reference",
    "TrackingCertificate": "made by certify_tracking only, with the tube of its law's reference",
    "describe_pinocchio": "two of Pinocchio's own",
    "write": "one mechanism and a path",
    "Subject.facts": "the studio's own",
    "Theorem3Facts": "a record of the paper's results",
}
KINDS = (
    "Mechanism",
    "ReducedModel",
    "Model",
    "Law",
    "Gravity",
    "Atlas",
    "Trajectory",
    "Certificate",
    "State",
    "Reference",
)
KINDS += ("SingularC", "Enclosure", "Simulator", "OnlineSigma")


def two_objects():
    """Public functions and methods that take, or are methods of one and take, two objects that are about something."""
    rooms = (
        "dynamics",
        "domain",
        "identification",
        "control",
        "simulation",
        "validated",
        "visualization",
        "plotting",
        "mechanism",
        "transmission",
    )
    for room in rooms:
        module = import_module(f"ccpin.{room}")
        for name in module.__all__:
            thing = getattr(module, name)
            methods = [m for m in vars(thing) if not m.startswith("_")] if inspect.isclass(thing) else []
            for full, one in ((name, thing), *((f"{name}.{m}", getattr(thing, m)) for m in methods)):
                if not callable(one) or (inspect.isclass(one) and issubclass(one, Exception)):
                    continue
                try:
                    parameters = inspect.signature(one).parameters.values()
                except (TypeError, ValueError):
                    continue
                words = [str(p.annotation).replace("Near", "") for p in parameters if p.name not in ("self", "cls")]
                about = sum(any(kind in word for kind in KINDS) for word in words)
                own = "." in full and any(kind in name for kind in KINDS)
                if about + own >= 2:
                    yield full


def test_every_function_of_two_objects_is_listed():
    """One that comes to be must say what it compares, or why it need not."""
    missing = sorted({*two_objects()} - {*CROSSED} - {*ALLOWED})
    assert missing == []


@pytest.mark.parametrize("name", CROSSED)
def test_objects_of_two_mechanisms_are_refused(name, ours, theirs):
    """Another rod's atlas claimed 0.3545 J where less than 0.3459 J is true."""
    differing, call = CROSSED[name]
    for what in differing:
        for one, other in ((ours, theirs[what]), (theirs[what], ours)):
            with pytest.raises(CcpinError):
                call(one, other)


@pytest.mark.parametrize("name", ["certify_law", "suggest_gains", "exceeded", "set_point_metrics", "enclose, law (28)"])
def test_what_a_claim_does_not_use_may_differ(name, ours, theirs):
    """An atlas of the same φ and other masses is good, and law (28) may have a nominal model's g(q_d)."""
    if "enclose" in name:
        pytest.importorskip("flint")
    CROSSED[name][1](ours, theirs["masses"])


def test_a_nominal_law_is_simulated_and_its_motion_says_so(ours, theirs):
    """The plant's digests, and the law's."""
    motion = ccpin.simulate(theirs["masses"].model, ours.law, GOAL, duration=0.01)
    assert motion.origin.dynamics == theirs["masses"].model.digests.dynamics
    assert motion.origin.law == ours.law.digests.law != ""
    with pytest.raises(DifferentSubjectsError, match="masses, springs"):
        simulation.lyapunov_along(ours.law, motion)


def test_a_memory_of_another_plant_is_refused(ours):
    """Friction, limits, sampling: what moves besides the mechanism."""
    made = [ccpin.Simulator(ours.model, ours.law, friction=([level] * 2, [0.0] * 2)) for level in (0.2, 0.2, 0.9)]
    made[0].reset(GOAL)
    memory = made[0].memory() if callable(made[0].memory) else made[0].memory
    made[1].recall(memory)
    with pytest.raises(DifferentSubjectsError, match="plant"):
        made[2].recall(memory)


def test_motions_of_two_laws_say_none(ours):
    """One after the other they are of one mechanism, and of no one law."""
    softer = PDSimpleGravity(ours.model, GOAL, [9.0, 9.0], GAINS[1])
    after = ccpin.simulate(ours.model, softer, ours.motion.q[-1], ours.motion.v[-1], duration=0.01)
    assert ours.motion.then(after).origin.law == ""
    assert ours.motion.then(ours.motion).origin == ours.motion.origin


def test_files_carry_digests(ours, tmp_path):
    """A saved motion is of its mechanism; one without digests is refused, naming why."""
    path = tmp_path / "motion.npz"
    ours.motion.save(path)
    assert ccpin.Trajectory.load(path).origin == ours.motion.origin
    header, arrays = saving.packed(ours.motion._asdict())
    header.pop("origin")
    without = saving.TRAJECTORY._replace(
        header={name: kind for name, kind in saving.TRAJECTORY.header.items() if name != "origin"}
    )
    without.write(path, header, arrays)
    with pytest.raises(CcpinError, match="origin"):
        ccpin.Trajectory.load(path)


@pytest.mark.parametrize("name", ["rpdr", "delta", "stewart", "bennett", "slider_crank"])
def test_a_mechanism_read_twice_is_the_same(name):
    """So are copies and pickles."""
    one = ccpin.load(name)
    for other in (ccpin.load(name), copy.deepcopy(one), pickle.loads(pickle.dumps(one)), replace(one)):
        assert other.digests == one.digests


def test_what_changes_which_digest(rpdr, ours, others):
    """Each only its own."""
    base = ours.model.digests
    changed = {
        name: [
            part for part in ("closures", "dynamics", "plant") if getattr(model.digests, part) != getattr(base, part)
        ]
        for name, model in others.items()
    }
    assert changed["gravity"] == changed["masses"] == ["dynamics"]
    assert "closures" in changed["lengths"]
    swapped = ccpin.load("rpdr", independent=["joint2", "joint1"])
    assert swapped.digests.closures != rpdr.digests.closures
    rubbing = ccpin.load("rpdr", joints={"joint3": {"friction": 0.1}})
    assert rubbing.digests.plant != rpdr.digests.plant
    assert rubbing.digests[1:3] == rpdr.digests[1:3]


def test_digests_of_laws(ours):
    """Kind, constants, references; a function has none."""
    model = ours.model
    same = PDSimpleGravity(ccpin.ReducedModel(ccpin.load("rpdr")), GOAL, *GAINS)
    assert same.digests.law == ours.law.digests.law
    stiffer = PDSimpleGravity(model, GOAL, [11.0, 11.1], GAINS[1])
    laws = [ours.law, ours.full, stiffer]
    laws += [
        control.ComputedTorque(model, PointToPoint(model, GOAL, [-1.5, -1.7], time), [9.0, 9.0], [6.0, 6.0])
        for time in (0.5, 0.6)
    ]
    assert len({law.digests.law for law in laws}) == len(laws)
    assert TorqueFunction(lambda t, q, v: q).digests.law == ""


def test_digests_tell_values_apart():
    """Shapes, kinds and names of fields enter; minus zero does not."""
    values = [1, 1.0, True, "1", np.ones(2), np.ones((2, 1)), [1.0, 1.0], (1.0, 1.0), {"a": 1.0}, {"b": 1.0}, None]
    values += [np.ones(2, dtype=np.float32), [[1.0], 1.0], [1.0, [1.0]]]
    assert len({digest(value) for value in values}) == len(values)
    assert digest(np.array([-0.0])) == digest(np.array([0.0]))
    for value in (len, lambda: 0, np.array([object()]), object()):
        with pytest.raises(UndigestedError):
            digest(value)


def test_what_says_nothing_is_refused():
    """An empty digest is no agreement."""
    with pytest.raises(DifferentSubjectsError, match="does not say"):
        require_same("a task", Digests("one", "x"), Digests("other"), "closures")
    require_same("a task", Digests("one", "x"), Digests("other", "x", "y"), "closures")


def test_a_mended_proof_does_not_use_what_its_predecessor_kept(rpdr, tmp_path, monkeypatch):
    """Chunks kept by code that calls nothing proved are not found by the code that does."""
    honest = domain.certify(rpdr, GOAL, REGION)
    with monkeypatch.context() as wrong:
        wrong.setattr(runner, "code_digest", lambda: b"another code")
        wrong.setattr(tasks, "meets", lambda problem, boxes: np.zeros(len(boxes.kappa), dtype=np.bool_))
        assert domain.certify(rpdr, GOAL, REGION, max_depth=3, checkpoint=tmp_path).certified_fraction == 0.0
    assert list(tmp_path.glob("*.chunk"))
    mended = domain.certify(rpdr, GOAL, REGION, checkpoint=tmp_path)
    assert mended.certified_fraction == honest.certified_fraction > 0.9


def test_the_backend_counts(monkeypatch):
    """What NumPy computed is not taken for the core's."""
    own = sources.code_digest()
    monkeypatch.setenv("CCPIN_BACKEND", "numpy")
    plain = sources.code_digest()
    monkeypatch.delenv("CCPIN_BACKEND")
    assert (plain != own) == (ccpin.backend().name == "native")
