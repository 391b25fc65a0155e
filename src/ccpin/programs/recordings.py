"""`record`: programs of a reduced model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from ccpin.arrays import Array, choice, instance, records, whole
from ccpin.control.control_law import ControlLaw
from ccpin.dynamics.end_effector import EndEffector
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs.instructions import Code
from ccpin.programs.program import Port, Program
from ccpin.programs.program_sources import INPUTS, REFERENCE, ProgramSource, assembled
from ccpin.programs.quantities import QUANTITIES, TapedModel, along, jacobian_of, pose_of, taped_model
from ccpin.programs.recording.constants import Parameter, parameters_of
from ccpin.programs.recording.recorded_laws import recorded_law
from ccpin.programs.recording.recorded_mechanism import Numbering, numbering
from ccpin.programs.recording.recorded_tree import Table
from ccpin.programs.stepping import stepped
from ccpin.programs.tape import Tape

Given = Literal["closed", "near"]
SAMPLES, _SPREAD, _TRIES = 32, 0.15, 400  # states about the reference at which pivots are chosen
_BRIEF = 1e-3  # s, of a step
CONVERGED = 1e-6  # of σ's last correction δ, in the units of y: δ^{3/2} is left, times twice the root of σ's bend


def record(
    model: ReducedModel,
    what: str | Sequence[str],
    *,
    given: Given = "closed",
    steps: int = 2,
    derivatives: Sequence[str] = (),
    law: ControlLaw | None = None,
    points: Mapping[str, EndEffector] | None = None,
    near: State | None = None,
    parameters: Sequence[str] = (),
    moving: bool = False,
    across: Sequence[str] = (),
) -> Program:
    """A straight-line program of quantities of a reduced model.

    Args:
        model: The reduced model.
        what: Names of quantities, in the order of the outputs: `"closure"` (φ, with ½(|p|² − 1) of quaternions that
            depend), `"sigma"` (the numbers y that depend), `"rho"`, `"v_free"` (q̇′ = ρq̇), `"rho_dot"`, `"bias"`
            (ρ̇q̇), `"x_rate"`, `"mass"` (D), `"mass_inverse"`, `"coriolis"` (C), `"velocity_force"` (Cq̇ + damping q̇),
            `"gravity"` (g), `"forward_dynamics"` (q̈), `"inverse_dynamics"` (u), `"generalized_force"` (τ), `"energy"`,
            `"torque"` and `"lyapunov"` of the `law`, `"across"`, `"across_jacobian"` and `"across_inverse"` (of the
            joints named so: displacements, their derivative by q, its inverse), and the names of `points` (position,
            with `NAME_rotation` and `NAME_jacobian` beside it). Alone: `"step"`, one of Runge and Kutta's of order 4
            over h with u held, closed at its end (q_next, y_next, v_next).
        given: What is known of a configuration. `"closed"`: q and the numbers y that depend on it; `"near"`: q and the
            y of a configuration near by on the same branch, from which σ(q) is found by a fixed number of steps.
        steps: Newton steps of σ; one more with the last matrix follows.
        derivatives: Of every quantity also its derivative by these of `"q"`, `"v"`, `"u"`, `"a"` (outputs `NAME_by_q`,
            …), with the derivative's axis last; by q along tangent steps, with y moving along by ρ. Where q̇ is not the
            rate of q's numbers, `step_by_q` is the tangent step that a change of the numbers is.
        law: The law of `"torque"` and `"lyapunov"`, of the model's own constants: PDSimpleGravity, PDFullGravity,
            PDOnlineGravity, PDPlus or ComputedTorque. Efforts are not clipped to the motors' limits.
        points: End effectors by names of outputs.
        near: The State it is recorded about (pivots are chosen at states around it), default the reference.
        parameters: Constants that become an input p: `"gravity"` (m/s²), `"mass:LINK"` (its inertia goes with it),
            `"length:JOINT"` (from the joint before), `"length:CLOSURE/A"` or `/B` (of its frame on its body),
            `"origin:JOINT/x"` (y, z; on the parent link), `"origin:CLOSURE/A/x"`, `"turn:JOINT/x"` (of its frame about
            the link's axes), `"turn:CLOSURE/A/x"`, `"distance:CLOSURE"`, `"ratio:COUPLING/JOINT"`, `"damping:JOINT"`,
            `"armature:JOINT"`, `"stiffness:JOINT"`.
        moving: That the law's reference is an input: q_d, v_d and a_d (rates and second rates), in the numbers of q,
            circles counted in q's turn; of PDSimpleGravity also g_d, g at q_d. Laws whose own reference moves have it
            as an input anyhow, and time is none.
        across: Joints of one freedom each, of `"across"`.

    Raises:
        InvalidInputError: No such quantity, or one that lacks what it is of.
        UnsupportedMechanismError: A law that is not known, or C of coordinates that are no numbers.
        DifferentSubjectsError: A law of another model.
    """
    model = instance(model, "model", ReducedModel)
    asked = (what,) if isinstance(what, str) else tuple(what)
    ends = dict(points or {})
    _require_known(asked, ends, derivatives, given)
    told = recorded_law(law, model) if {"torque", "lyapunov"} & set(asked) else None
    reference = model.mechanism.q_reference
    state = model.at(model.alpha(reference), reference) if near is None else model.at(near)
    own = numbering(model, state.q_free)
    symbols = parameters_of(model, tuple(parameters))
    if instance(moving, "moving", bool, "True or False") and told is None:
        raise InvalidInputError("moving is about a law's reference: neither its torque nor its lyapunov is recorded")
    moves = moving or not (told is None or told.holds)
    others = records(across, "across", str)
    if not others and set(asked) & {"across", "across_jacobian", "across_inverse"}:
        raise InvalidInputError("'across' is of joints: name them by across=")
    scene = taped_model(model, own, state.q_free, law, ends, symbols, moves, others)
    if asked == ("step",):
        return _step(scene, state, symbols)
    outputs = _outputs(scene, asked, tuple(derivatives))
    name, shown = f"{model.mechanism.name}: {', '.join(asked)}", _output_ports(scene, outputs)
    newton = whole(steps, "steps") if given == "near" else 0
    return program_of(scene, state, name, outputs, shown, newton, symbols, law_notes(scene, asked))


def program_of(
    scene: TapedModel,
    about: State,
    name: str,
    outputs: Mapping[str, Table],
    shown: tuple[Port, ...],
    steps: int = 0,
    symbols: Sequence[Parameter] = (),
    notes: tuple[str, ...] = (),
) -> Program:
    """The program of tables of expressions on a scene's tape.

    Args:
        scene: The model on its tape.
        about: The State that it was recorded about.
        name: What the program is of.
        outputs: The tables, by the names of `shown`.
        shown: Their ports.
        steps: Newton steps of σ; 0 where a configuration is given closed.
        symbols: Constants that are inputs.
        notes: What whoever calls it has to know.
    """
    inner = scene.tape.code([entry for table in outputs.values() for entry in table.ravel()])
    ports = _input_ports(scene, _inputs_read(scene, inner), symbols)
    closure, sizes = scene.tape.code(scene.recorded.closure), [len(table) for table in scene.inputs.values()]
    samples = _samples(scene.model, scene.own, about, ports, symbols)
    return _put_together(scene, name, (ports, shown), (closure, inner), sizes, samples, steps, notes=notes)


def _put_together(
    scene: TapedModel,
    name: str,
    ports: tuple[tuple[Port, ...], tuple[Port, ...]],
    codes: tuple[Code, Code],
    sizes: Sequence[int],
    samples: Array,
    steps: int = 0,
    checked: int = 0,
    notes: tuple[str, ...] = (),
) -> Program:
    """The program of closures and of what is evaluated (`ProgramSource`), with ports of inputs and outputs."""
    rows = tuple(map(tuple, samples.tolist()))
    named = tuple((port.name, port.size) for port in ports[0])
    source = ProgramSource(*codes, scene.own.q.places, tuple(sizes), named, steps, rows, checked)
    done = assembled(source)
    tolerance = CONVERGED if done.corrections else 0.0
    return Program(name, *ports, done.code, done.pivots, done.corrections, tolerance, rows[0], rows[1:], notes, source)


def _step(scene: TapedModel, about: State, symbols: Sequence[Parameter]) -> Program:
    """One step of the motion (`stepping`)."""
    q, y, *rest = _input_ports(scene, {"v", "u"}, symbols)
    ports = (q, y, *rest, Port("h", (1,), "s", ("h",)))
    sizes = (*(len(table) for table in scene.inputs.values()), 1)
    tape = Tape(sum(sizes))
    parts = np.split(np.array(tape.inputs, dtype=object), np.cumsum(sizes)[:-1])
    x, v, u, _, p, h = parts
    places, dependent = list(scene.own.q.places), list(scene.own.dependent)
    step = stepped(scene, tape, {"q": x[places], "y": x[dependent], "v": v, "u": u, "p": p, "h": h})
    after = tuple(port._replace(name=f"{port.name}_next") for port in (q, y, rest[0]))
    samples = _samples(scene.model, scene.own, about, ports, symbols)
    closure = tape.inlined(scene.tape.code(scene.recorded.closure), tape.inputs[:-1])
    codes, checked = (tape.code(closure), tape.code([entry for part in step for entry in part])), len(step.correction)
    name = f"{scene.model.mechanism.name}: step"
    return _put_together(scene, name, (ports, after), codes, sizes, samples, checked=checked)


def configuration(state: State, near: State | None = None) -> dict[str, Array]:
    """The numbers q and y of a State as programs take them, by the names of their inputs.

    Args:
        state: A State.
        near: The State that a program was recorded about, default the reference: angles are counted in its turn.
    """
    model = instance(instance(state, "state", State).model, "state.model", ReducedModel)
    own = numbering(model, model.mechanism.q_reference if near is None else near.q_free)
    return dict(zip(("q", "y"), _halves(own, own.numbers(state.q_free)), strict=True))


def _halves(own: Numbering, x: Array) -> tuple[Array, Array]:
    return x[list(own.q.places)], x[list(own.dependent)]


def _require_known(
    asked: tuple[str, ...],
    ends: dict[str, EndEffector],
    derivatives: Sequence[str],
    given: str,
) -> None:
    """Every name is one that can be recorded.

    Raises:
        InvalidInputError: One is not.
    """
    choice(given, "given", ("closed", "near"))
    if "step" in asked and (len(asked) > 1 or derivatives or given != "closed"):
        raise InvalidInputError("'step' is recorded alone, from a closed configuration, without derivatives")
    if not asked:
        raise InvalidInputError("nothing to record: name a quantity")
    if {"law", "laws", "control", "effort", "efforts"} & set(asked) - set(ends):
        raise InvalidInputError("what: the efforts of a law are its 'torque': did you mean 'torque'?")
    for name in asked:
        choice(name, "what", (*QUANTITIES, "step", *ends))
    for name in derivatives:
        choice(name, "derivatives", ("q", "v", "u", "a"))
    if clash := set(ends) & {*QUANTITIES, *INPUTS, "step", "x", "q", "y", "status"}:
        raise InvalidInputError(f"points cannot have the names of quantities: {', '.join(sorted(clash))}")
    for name, end in ends.items():
        instance(end, f"points[{name!r}]", EndEffector)


def _outputs(scene: TapedModel, asked: tuple[str, ...], derivatives: tuple[str, ...]) -> dict[str, Table]:
    """Tables of expressions by the names of their outputs."""
    found = dict[str, Table]()
    for name in asked:
        if name in scene.points:
            pose = pose_of(scene, scene.points[name])
            found |= {name: pose[:3, 3], f"{name}_rotation": pose[:3, :3], f"{name}_jacobian": jacobian_of(scene, pose)}
            if "q" in derivatives:
                found |= {f"{name}_by_q": along(scene, pose[:3, 3], "q")}
                found |= {f"{name}_rotation_by_q": along(scene, pose[:3, :3], "q")}
            continue
        quantity = QUANTITIES[name]
        found[name] = quantity.record(scene)
        for by in derivatives:
            if by == "q" or by in quantity.needs:
                found[f"{name}_by_{by}"] = along(scene, found[name], by)
    if "q" in derivatives and not scene.own.q.scalar:
        moved = (scene.recorded.rates @ scene.recorded.motion.rho)[list(scene.own.q.places)]
        found["step_by_q"] = scene.tape.solve(moved.T @ moved, moved.T)
    return found


def _inputs_read(scene: TapedModel, code: Code) -> set[str]:
    """Which inputs beside q and y an output depends on."""
    return {name for name, nodes in scene.inputs.items() if code.read & {node.index for node in nodes}}


def _input_ports(scene: TapedModel, reads: set[str], symbols: Sequence[Parameter]) -> tuple[Port, ...]:
    """q and y, what else is read, and the parameters."""
    numbers = _names(scene)
    own, model = scene.own, scene.model
    ports = [_port("q", [numbers[k] for k in own.q.places]), _port("y", [numbers[k] for k in own.dependent])]
    motors = [(name, "") for name in model.mechanism.actuated]
    rates = [(name, "") for name in model.mechanism.independent]
    entries = {"v": _spread(rates, model.n), "u": _spread(motors, model.n_actuated), "a": _spread(rates, model.n)}
    entries |= dict.fromkeys(REFERENCE, entries["v"])
    units = {"v": "rad/s or m/s", "u": "N m or N", "a": "rad/s² or m/s²"}
    units |= {"q_d": ports[0].unit, "v_d": units["v"], "a_d": units["a"], "g_d": units["u"]}
    return (
        *ports,
        *(Port(key, (len(entries[key]),), units[key], tuple(entries[key])) for key in entries if key in reads),
        *_parameter_ports(symbols),
    )


def _parameter_ports(symbols: Sequence[Parameter]) -> list[Port]:
    """Port p, where there are parameters."""
    units = ", ".join(dict.fromkeys(each.unit for each in symbols))
    return [Port("p", (len(symbols),), units, tuple(each.name for each in symbols))] if symbols else []


def _port(name: str, entries: list[tuple[str, str]]) -> Port:
    units = {unit for _, unit in entries}
    return Port(
        name, (len(entries),), units.pop() if len(units) == 1 else "rad or m", tuple(word for word, _ in entries)
    )


def _spread(names: list[tuple[str, str]], size: int) -> list[str]:
    """Names of entries, numbered where there are more entries than names."""
    plain = [name for name, _ in names]
    return plain if len(plain) == size else [str(k) for k in range(size)]


def _names(scene: TapedModel) -> list[tuple[str, str]]:
    """A name and a unit of every number of x."""
    found = list[tuple[str, str]]()
    tree = scene.model.mechanism.tree
    for joint in scene.own.joints:
        name, kind = tree.joints[joint.number - 1].name, joint.kind
        plain = joint.x.stop - joint.x.start - (4 if kind.unit == 4 else 0)
        parts = kind.components or [""]
        for part, slides in zip(parts[:plain], kind.slides, strict=False):
            found.append((f"{name}:{part}" if part else name, "m" if slides else "rad"))
        found += [(f"{name}:{part}", "1") for part in ("qx", "qy", "qz", "qw")] if kind.unit == 4 else []
    found += [
        (f"{tree.joints[turn.ball.joint.number - 1].name}:r{'xyz'[turn.axis]}", "rad") for turn in scene.own.turns
    ]
    return found


def _output_ports(scene: TapedModel, outputs: dict[str, Table]) -> tuple[Port, ...]:
    found = list[Port]()
    for name, table in outputs.items():
        entries = _places(table.shape)
        if name == "torque":
            entries = _spread([(motor, "") for motor in scene.model.mechanism.actuated], len(entries))
        found.append(Port(name, table.shape, QUANTITIES[name].unit if name in QUANTITIES else "", tuple(entries)))
    return tuple(found)


def law_notes(scene: TapedModel, asked: tuple[str, ...]) -> tuple[str, ...]:
    """What a law's efforts are, and how its reference is counted."""
    mechanism = scene.model.mechanism
    names = _spread([(motor, "") for motor in mechanism.actuated], scene.model.n_actuated)
    pairs = zip(names, mechanism.motors.limits.tolist(), strict=True)
    limits = [f"{name} {low:g} to {high:g}" for name, (low, high) in pairs if low > -np.inf or high < np.inf]
    found = [
        "the torque is what the law asks for, not clipped to the motors' limits: "
        + (", ".join(limits) or "none is stated")
    ]
    if "q_d" in scene.inputs and scene.own.q.circles:
        found.append("q_d is counted in q's turn: less than half a turn from q")
    return tuple(found) if "torque" in asked else ()


def _places(shape: tuple[int, ...]) -> list[str]:
    return [",".join(map(str, place)) for place in np.ndindex(*shape)]


def _samples(
    model: ReducedModel, own: Numbering, about: State, ports: Sequence[Port], symbols: Sequence[Parameter]
) -> Array:
    """Inputs at closed states around one, itself first, of shape (N, inputs)."""
    held = {"p": np.array([each.value for each in symbols]), "h": np.array([_BRIEF])}
    rng, found = np.random.default_rng(0), [_sample(own, about, ports, np.random.default_rng(1), held)]
    for _ in range(_TRIES):
        if len(found) == SAMPLES:
            break
        q = model.coordinates.integrate(about.q, _SPREAD * rng.uniform(-1.0, 1.0, model.n))
        try:
            found.append(_sample(own, model.at(q, about), ports, rng, held))
        except CcpinError:
            continue
    return np.array(found)


def _sample(
    own: Numbering, state: State, ports: Sequence[Port], rng: np.random.Generator, held: dict[str, Array]
) -> Array:
    known = held | dict(zip(("q", "y"), _halves(own, own.numbers(state.q_free)), strict=True))
    if any(port.name == "q_d" for port in ports):
        known["q_d"] = known["q"] + _SPREAD * rng.uniform(-1.0, 1.0, len(known["q"]))
    return np.concatenate([known[p.name] if p.name in known else rng.uniform(-1.0, 1.0, p.size) for p in ports])
