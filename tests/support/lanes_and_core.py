"""Programs in lanes beside the compiled core, exact numbers and the slopes of other libraries."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

import ccpin
from ccpin import programs
from ccpin.errors import CcpinError, UnsupportedMechanismError
from ccpin.programs.evaluation import values_of
from ccpin.programs.lanes import CompiledProgram
from ccpin.programs.numbers import NumbersOfRows
from ccpin.programs.program import Program, windows
from ccpin.programs.recording.recorded_mechanism import numbering
from tests.support.places import MODELS, ROOT

NAMED = (*sorted(path.stem for path in MODELS.glob("*.urdf")), str(ROOT / "docs/howto/ankle.urdf"))
WHAT = ("sigma", "rho", "mass", "coriolis", "gravity", "forward_dynamics", "inverse_dynamics")
STATES, DRAWN, SLOPED = 100_000, 50, 100  # states a model, random mechanisms, states whose derivatives are compared
SPREAD, REACHED, TRIED = 0.3, 0.9, 200  # rad or m about the reference, halved until σ reaches so much of what is tried
AWAY, STEPS = 1e-6, 2  # of each number of y from σ's: two Newton steps leave rounding alone
SHARE = 1e-3  # of D's largest entry: forces below it are nothing beside it
SINGULAR, TINY = 1e-3, 1e-30  # reciprocal condition number; a complex step


Libraries = dict[str, Callable[[Program, dict[str, np.ndarray]], list[np.ndarray]]]


class States(NamedTuple):
    """Closed states and what the core says of them.

    Attributes:
        inputs: q, y (exactly σ's), v, u, a as programs take them, of shape (N, …).
        core: Outputs by name.
        kappa, kappa_mass: Condition numbers of ψ_q′ and D.
        spread: How far from the reference they are at most, in each coordinate.
    """

    inputs: dict[str, np.ndarray]
    core: dict[str, np.ndarray]
    kappa: np.ndarray
    kappa_mass: np.ndarray
    spread: float


class Difference(NamedTuple):
    """Of one quantity between programs and core.

    Attributes:
        name: The quantity.
        largest, over: The largest relative difference, and over the condition number, where rcond ≥ 1e-3.
        apart: The largest relative difference elsewhere.
        exact: How far the program and the core are from exact numbers where they differ most over the condition number.
    """

    name: str
    largest: float
    over: float
    apart: float
    exact: tuple[float, float] | None


def reached(model: ccpin.ReducedModel, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Rows of q about the reference that the core's σ reaches, σ of them, and how far they go."""
    start, spread = model.alpha(model.mechanism.q_reference), SPREAD
    found = list[tuple[np.ndarray, np.ndarray]]()
    while sum(len(q) for q, _ in found) < count:
        rows = count if found else TRIED
        steps = spread * rng.uniform(-1.0, 1.0, (rows, model.n))
        q = np.array([model.coordinates.integrate(start, step) for step in steps])
        answer = model.core.sigma_many(q, None, 1)
        if answer is None:
            raise CcpinError("there is no compiled core to compare with")
        if not found and answer[1].mean() < REACHED:
            spread *= 0.5
            continue
        found.append((q[answer[1]], answer[0][answer[1]]))
    q, q_free = (np.concatenate(each)[:count] for each in zip(*found, strict=True))
    return q, q_free, spread


def states(model: ccpin.ReducedModel, count: int) -> States:
    """Random states with what the core says."""
    rng = np.random.default_rng(0)
    Q, q_free, spread = reached(model, rng, count)
    V, U, A = (rng.normal(size=(count, size)) for size in (model.n, model.n_actuated, model.n))
    terms = model.terms_many(Q, V)
    q, y, _ = NumbersOfRows(model, numbering(model, model.mechanism.q_reference)).start(q_free)
    core = {"sigma": y, "rho": terms.rho, "mass": terms.D, "coriolis": terms.C, "gravity": terms.g}
    core["forward_dynamics"] = model.forward_dynamics_many(Q, V, U)
    core["inverse_dynamics"] = model.inverse_dynamics_many(Q, V, A)
    slopes = model.forward_dynamics_derivatives_many(Q[:SLOPED], V[:SLOPED], U[:SLOPED])
    core |= {f"forward_dynamics_by_{key}": table for key, table in zip("qvu", slopes, strict=True)}
    kappa = np.array([1.0 / model.core.rcond(row) for row in q_free])
    return States({"q": q, "y": y, "v": V, "u": U, "a": A}, core, kappa, np.linalg.cond(terms.D), spread)


def recorded(model: ccpin.ReducedModel, given: Any) -> Program:
    """All quantities that a model has: C is there where q̇ is the rate of q's numbers."""
    try:
        return programs.record(model, WHAT, given=given, steps=STEPS)
    except UnsupportedMechanismError:
        return programs.record(model, [name for name in WHAT if name != "coriolis"], given=given, steps=STEPS)


def compared(model: ccpin.ReducedModel, held: States) -> tuple[list[Difference], int]:
    """The program in lanes beside the core; how many states it refuses."""
    near, rng = recorded(model, "near"), np.random.default_rng(1)
    given = held.inputs | {"y": held.inputs["y"] + AWAY * rng.uniform(-1.0, 1.0, held.inputs["y"].shape)}
    *outputs, status = CompiledProgram(near)(*(given[port.name] for port in near.inputs))
    told, sound = list[Difference](), held.kappa * SINGULAR <= 1.0
    exact = exactly(near, recorded(model, "closed"))
    least = SHARE * np.abs(held.core["mass"]).max(axis=(1, 2))
    floors = {"sigma": 1.0, "coriolis": least, "gravity": least, "inverse_dynamics": least}
    for port, found in zip(near.outputs, outputs, strict=True):
        if not port.size:
            continue
        wanted = held.core[port.name]
        size = sizes(wanted, floors.get(port.name, 0.0))
        off = largest(found - wanted) / size
        condition = held.kappa * (held.kappa_mass if port.name == "forward_dynamics" else 1.0)
        trusted = sound & (status == 0)
        over = np.where(trusted, off / condition, 0.0)
        worst = int(np.argmax(over))
        both = None
        if exact is not None:
            true = exact({name: table[worst] for name, table in held.inputs.items()})[port.name]
            both = tuple(float(largest(each[[worst]] - true)[0] / size[worst]) for each in (found, wanted))
        apart = off[~sound & (status == 0)].max(initial=0.0)
        told.append(Difference(port.name, off[trusted].max(initial=0.0), over[worst], apart, both))
    return told, int(np.count_nonzero(status))


def largest(table: np.ndarray) -> np.ndarray:
    """The largest absolute entry of every row."""
    return np.asarray(np.abs(table.reshape(len(table), -1)).max(axis=1))


def sizes(wanted: np.ndarray, floor: np.ndarray | float = 0.0) -> np.ndarray:
    """The largest entry of every row, no less than the median row's and a floor; 1 where all is 0."""
    own = largest(wanted)
    size = np.maximum(np.maximum(own, np.median(own)), floor)
    return np.where(size > 0.0, size, 1.0)


def exactly(near: Program, closed: Program) -> Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]] | None:
    """The same arithmetic in 200 bits at a state; ``None`` without python-flint."""
    try:
        import flint

        from tests.support.programs import BITS, exact_sigma, exact_values
    except ImportError:
        return None

    def evaluated(row: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        with flint.ctx.workprec(BITS):
            sigma = exact_sigma(near.source, row["q"], row["y"])
            others = [x for port in closed.inputs if port.name not in "qy" for x in row[port.name]]
            values = exact_values(closed.code, [*row["q"], *sigma, *others])
            table = np.array([float(value.mid()) for value in values])
        named = zip(closed.outputs, windows(closed.outputs), strict=True)
        return {port.name: table[window].reshape(port.shape) for port, window in named}

    return evaluated


def drawn(count: int) -> Iterator[ccpin.ReducedModel]:
    """Random mechanisms of the tests, those that load and move, always the same."""
    from hypothesis import HealthCheck, Phase, given, settings

    from tests.support.strategies import mechanisms

    found = list[Any]()
    rules = {"database": None, "deadline": None, "derandomize": True, "phases": [Phase.generate]}

    @settings(max_examples=4 * count, suppress_health_check=list(HealthCheck), **rules)
    @given(mechanisms())
    def collect(each: Any) -> None:
        found.append(each.description)

    collect()
    made = 0
    for description in found[::-1]:  # Hypothesis draws the simplest first
        try:
            independent = ccpin.load(description, free=["all"]).independent
            model = ccpin.ReducedModel(ccpin.load(description, actuated=independent, free=["all"]))
            if not model.n:
                continue
        except CcpinError:
            continue
        yield model
        made += 1
        if made == count:
            return


def slopes(model: ccpin.ReducedModel, held: States, libraries: Libraries | None = None) -> dict[str, float]:
    """The derivatives of q̈ by q, q̇ and u from all sides: the largest difference from the lanes', over κ(ψ_q′) κ(D)."""
    names = [f"forward_dynamics_by_{key}" for key in "qvu"]
    rows = {name: held.inputs[name][:SLOPED] for name in "qyvu"}
    program = programs.record(model, "forward_dynamics", given="near", steps=STEPS, derivatives="qvu")
    plain = programs.record(model, "forward_dynamics", given="near", steps=STEPS)
    *tables, _ = CompiledProgram(program)(*rows.values())
    by_name = dict(zip((port.name for port in program.outputs), tables, strict=True))
    found = {"core": [held.core[name] for name in names], "complex steps": complex_steps(plain, rows)}
    for library, differentiate in (LIBRARIES if libraries is None else libraries).items():
        try:
            found[library] = differentiate(program, rows)
        except CcpinError:
            continue  # it is not installed
    condition = (held.kappa * held.kappa_mass)[:SLOPED]
    sound, told = held.kappa[:SLOPED] * SINGULAR <= 1.0, dict[str, float]()
    for who, each in found.items():
        pairs = [(np.asarray(a), by_name[name]) for a, name in zip(each, names, strict=True)]
        off = [largest(a - b) / sizes(b) / condition for a, b in pairs]
        told[who] = float(np.max([part[sound].max(initial=0.0) for part in off]))
    return told


def complex_steps(program: Program, rows: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Im f(x + i h)/h by q, v and u, y moving along in Newton's steps."""
    count, found = len(rows["q"]), list[np.ndarray]()
    arithmetic = SimpleNamespace(sin=np.sin, cos=np.cos, sqrt=np.sqrt, arctan2=_complex_angle)
    for name in "qvu":
        columns = list[np.ndarray]()
        for k in range(rows[name].shape[1]):
            moved = {key: table.astype(complex) for key, table in rows.items()}
            moved[name][:, k] += 1j * TINY
            values = values_of(program.code, [c for port in program.inputs for c in moved[port.name].T], arithmetic)
            outputs = [np.broadcast_to(values[number], (count,)).imag for number in program.code.outputs]
            columns.append(np.stack(outputs, axis=1) / TINY)
        found.append(np.stack(columns, axis=2))
    return found


def _complex_angle(a: Any, b: Any) -> Any:
    """atan2 with its first derivative along the imaginary parts."""
    return np.arctan2(a.real, b.real) + 1j * (b.real * a.imag - a.real * b.imag) / (a.real**2 + b.real**2)


def casadi(program: Program, rows: dict[str, np.ndarray]) -> list[np.ndarray]:
    """CasADi's Jacobian of the function, called state by state."""
    function = programs.as_function(program, "casadi", "forward_dynamics").jacobian()
    size = program.outputs[0].size
    told = [function(*state, np.zeros(size)) for state in zip(*rows.values(), strict=True)]
    return [np.array([np.array(each[k]) for each in told]) for k in (0, 2, 3)]


def jax(program: Program, rows: dict[str, np.ndarray]) -> list[np.ndarray]:
    """JAX's, forward, in double."""
    function = programs.as_function(program, "jax", "forward_dynamics")
    import jax

    jax.config.update("jax_enable_x64", True)
    by = jax.jacfwd(lambda *inputs: function(*inputs)["forward_dynamics"], argnums=(0, 2, 3))
    return [np.asarray(table) for table in jax.jit(jax.vmap(by))(*rows.values())]


def torch(program: Program, rows: dict[str, np.ndarray]) -> list[np.ndarray]:
    """PyTorch's, in reverse: entry by entry of q̈ over the whole batch."""
    function = programs.as_function(program, "torch", "forward_dynamics")
    import torch

    inputs = [torch.tensor(table, requires_grad=True) for table in rows.values()]
    answer = function(*inputs)["forward_dynamics"]
    entries = [
        torch.autograd.grad(answer[:, k].sum(), [inputs[j] for j in (0, 2, 3)], retain_graph=True)
        for k in range(answer.shape[1])
    ]
    return [np.stack([entry[j].numpy() for entry in entries], axis=1) for j in range(3)]


LIBRARIES: Libraries = {"casadi": casadi, "jax": jax, "torch": torch}
