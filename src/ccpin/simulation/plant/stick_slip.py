"""Forward dynamics with dry friction: which joints rest, which slide and which way, without smoothing.

The law of `friction` is kept set-valued, in the event-driven form of F. Pfeiffer and Ch. Glocker (Multibody Dynamics
with Unilateral Contacts, Wiley 1996) that Modelica's friction elements use too. Between events every rubbing joint
is either sliding in a known direction (a smooth force) or at rest (a constraint q̈′_j = 0 with a multiplier f_j). A
joint halts where its rate passes through zero; which of the halted joints then stay at rest, which slide and which
way is decided by the principle of least constraint,

    q̈ = argmin ½(q̈ − a)ᵀD(q̈ − a) + Σ_j s_j |q̈′_j|,   q̈′_j = ρ_j q̈ + (ρ̇q̇)_j,

with a the acceleration without these joints' friction and s their breakaway levels: strictly convex in q̈, hence with
one answer, also where more joints rest than the mechanism has freedoms and their shares f_j are indeterminate
(D. Żardecki, Static friction indeterminacy problems and modeling of stick-slip phenomenon in discrete dynamic systems,
J. Theor. Appl. Mech. 45, 2007). Its dual is the bounded least-squares problem solved here.

Why not a smooth law: tanh(q̇/ε) creeps under any load, and bristle models hold only after an elastic deflection, give
energy back and are stiff. Here a mechanism whose joints rest does not move at all, and friction's power is never
positive.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack
from scipy.optimize import lsq_linear

from ccpin.arrays import Array, Mask, vector
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State, StateModel
from ccpin.dynamics.wrenches import Wrenches
from ccpin.errors import ConvergenceError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.events.watches import AcceptedStep, Instant, Watch
from ccpin.simulation.plant.friction import FrictionLike, JointFriction, joint_friction, moved_friction

REST = 1e-8  # rad/s or m/s: no faster is at rest
_REVERSED = 1e-14  # rad/s or m/s: rounding about zero has not turned back
_WITHIN = 1e-8  # of a level: a force beyond it by less holds the joint
_RELEASED = 1e-9  # of the largest acceleration without friction: one below is none
_NIL = 1e-6  # rad/rad, m/rad or the like: ρ's rows, and singular values of these, below are none
_PULL = 50.0  # 1/s, at which the rates of resting joints, where integration leaves some, decay
_MOST_EVENTS = 200  # within a microsecond: then they have no end
_INDEPENDENT = 1e-2  # of the largest pivot of ρ_r D⁻¹ρ_rᵀ: above it resting joints' forces are unique beyond doubt


class FrictionForce(NamedTuple):
    """Friction at one state.

    Attributes:
        joint: f, the effort on each rubbing joint, N m or N, of shape (k,), in the order of `JointFriction.names`.
            Where more joints rest than the mechanism has freedoms their shares are indeterminate: these are shares
            of least norm, or others within the levels where those are not.
        generalized: ρᵀf, of shape (n,), always unique.
    """

    joint: Array
    generalized: Array


def friction_force(
    model: ReducedModel | Mechanism,
    friction: FrictionLike | JointFriction | None,
    q: ArrayLike | State,
    v: ArrayLike,
    u: ArrayLike,
    near: Near = None,
    wrenches: Wrenches | None = None,
) -> FrictionForce:
    """Friction at a state under motor efforts u; at rest it balances as much of the load as its level allows.

    Args:
        model: The reduced model, or a mechanism.
        friction: As for `ccpin.simulation.plant.friction.joint_friction`.
        q: Independent coordinates, of shape (model.nq,), or a State.
        v: Their velocities, of shape (n,).
        u: Efforts of the actuated joints, of shape (motors,).
        near: Chooses the assembly mode of σ(q).
        wrenches: On links, as for `State.forward_dynamics`.

    Raises:
        InvalidInputError: A bad argument.
        UnreachableError, SingularConfigurationError: σ(q) does not exist.
    """
    state = model_of(model).at(q, near)
    contact = StickSlip(state.model, joint_friction(state.model.mechanism, friction))
    drive = ActingLoads(vector(u, "u", state.model.n_actuated), wrenches)
    joint = contact.forces(state, contact.begin(state, vector(v, "v", state.model.n), drive), drive)
    return FrictionForce(joint, contact.rows(state).T @ joint)


class ActingLoads(NamedTuple):
    """What acts on a mechanism from outside.

    Attributes:
        u: The motors' efforts, of shape (motors,). wrenches: on links, or none.
        loads: What stops and contacts do to the free system's joints, of shape (n′,), or nothing.
    """

    u: Array
    wrenches: Wrenches | None = None
    loads: Array | None = None

    def acceleration(self, state: State, v: Array) -> Array:
        """q̈ under all of it, without dry friction."""
        a = state.forward_dynamics(v, self.u, self.wrenches)
        if self.loads is None or not self.loads.any():
            return a
        return a + np.linalg.solve(state.D, state.rho.T @ self.loads)


class _Known(NamedTuple):
    """The dynamics under every force that is known: all but that of the joints at rest.

    `rows` are ρ's of the rubbing joints, of shape (k, n): zero where a joint at rest has one that vanishes, which holds
    nothing. `mobility` is D⁻¹ρᵀ, of shape (n, k), `factor` the L of D = L Lᵀ.
    """

    rows: Array
    rates: Array
    force: Array
    mobility: Array
    a: Array
    bias: Array
    factor: Array


class StickSlip:
    """One run's joints: their present mode, and the dynamics in it.

    The mode changes in `begin` only. A joint is at rest there if it was so before, has just halted, or has a rate of at
    most 1e-8 rad/s (or m/s); its rate is then set to zero, and whether it starts to slide is the load's to say. Where a
    row of ρ vanishes, as a rocker's does at the ends of its swing while the crank goes on, or rows depend on each other
    but for rounding, q̇ is left alone: no friction of theirs could change it.

    Args:
        model: The reduced model.
        friction: Which joints rub.
    """

    def __init__(self, model: StateModel, friction: JointFriction) -> None:
        self._model, self._friction = model, friction
        self._own = friction.coordinate >= 0
        self._units = np.eye(model.n)[friction.coordinate[self._own]]
        self._dry = friction.breakaway > 0
        self.eventful = bool(self._dry.any())
        self._signs = np.zeros(len(friction.names))
        self._rest = np.zeros(len(friction.names), dtype=bool)
        self._locked = False
        self._ranked: tuple[State, bytes, bool] | None = None
        self._held: tuple[State, Array] | None = None  # who was at rest under which u alone
        self._halted: Mask | None = None

    @property
    def rubs(self) -> bool:
        """Whether any joint has friction, dry or viscous."""
        return bool(len(self._signs))

    def moved(self, model: StateModel) -> StickSlip:
        """The same joints in the same mode, for a motion that goes on in other coordinates of its mechanism."""
        moved = StickSlip(model, moved_friction(self._friction, model.coordinates))
        moved._signs, moved._rest, moved._locked = self._signs, self._rest, self._locked
        moved._halted = self._halted
        return moved

    def rows(self, state: State) -> Array:
        """ρ's rows of the rubbing joints, of shape (k, n)."""
        rows = state.rho[self._friction.index]
        rows[self._own] = self._units
        return rows

    def begin(self, state: State, v: Array, drive: ActingLoads) -> Array:
        """Decide which joints rest and which way the others slide, from the state, the load and who just halted."""
        halted, self._halted, self._held = self._halted, None, None
        rows = self.rows(state)
        rates = rows @ v
        rest = self._rest | (self._dry & (np.abs(rates) <= REST))
        if halted is not None:
            rest |= halted
        self._rest, self._locked = rest, False
        self._signs = np.where(self._dry & ~rest, np.sign(rates), 0.0)
        if not rest.any():
            return v
        v = self._brought_to_rest(v, rows, state) if v.any() else v
        starts, _ = self._at_rest(self._known(state, v, drive))
        self._signs[rest] = starts
        self._rest = rest & (self._signs == 0)
        self._locked = bool(self._rest.any()) and self._fixed(state, rows, self._rest)
        return v

    def halt(self, joints: Mask) -> None:
        """These joints have just halted: `begin` lets them rest, or start anew."""
        self._halted = joints

    def memory(self) -> dict[str, Array]:
        """Which joints rest and which way the others slide, as arrays; `recall` brings it back."""
        return {"signs": self._signs, "rest": self._rest}

    def recall(self, memory: Mapping[str, Array]) -> None:
        """Go on in the mode that another run of the same joints remembered."""
        self._signs, self._rest = np.array(memory["signs"]), np.array(memory["rest"], dtype=bool)

    def numbers(self) -> dict[str, Any] | None:
        """The joints and their mode in plain numbers, as the compiled core takes them; ``None`` where none rubs."""
        if not self.rubs:
            return None
        friction = self._friction
        halted = np.zeros_like(self._rest) if self._halted is None else self._halted
        return {
            "component": friction.index.tolist(),
            "coordinate": friction.coordinate.tolist(),
            "coulomb": friction.coulomb.tolist(),
            "viscous": friction.viscous.tolist(),
            "breakaway": friction.breakaway.tolist(),
            "stribeck_speed": friction.stribeck_speed.tolist(),
            "signs": self._signs.tolist(),
            "rest": self._rest.astype(int).tolist(),
            "halted": halted.astype(int).tolist(),
            "locked": self._locked,
        }

    def adopt(self, mode: tuple[Array, Array, Array, bool] | None) -> None:
        """Go on in the mode that the compiled core has left its joints in; it has none where none rubs."""
        if mode is None:
            return
        self._signs, rest, halted, self._locked = mode
        self._rest, self._halted, self._held = rest > 0, (halted > 0 if halted.any() else None), None

    def acceleration(self, state: State, v: Array, drive: Callable[[], ActingLoads]) -> Array:
        """q̈ with sliding joints' friction as a force and resting joints kept at rest.

        A resting dependent joint's rate would collect the integrator's error; it is pulled back to zero at 50 1/s.
        """
        if not len(self._signs):
            return drive().acceleration(state, v)
        if self._locked:
            return np.zeros(self._model.n)
        known = self._known(state, v, drive())
        if not self._rest.any():
            return known.a
        rows = known.rows[self._rest]
        target = -known.bias - _PULL * known.rates[self._rest]
        mobility = known.mobility[:, self._rest]
        a = known.a + mobility @ _multipliers(known, rows, mobility, target)
        a[self._friction.coordinate[self._rest & self._own]] = 0.0
        return np.asarray(a)

    def broken(self, state: State, v: Array, drive: Callable[[], ActingLoads]) -> Mask | None:
        """``None`` while no sliding joint has turned back and no resting joint is overloaded by what acts."""
        halted: Mask = self._signs * (self.rows(state) @ v) < -_REVERSED
        if halted.any():
            return halted
        if not self._rest.any():
            return None
        acting = drive()
        alone = acting.wrenches is None and acting.loads is None and not v.any()
        if alone and self._held is not None and self._held[0] is state and np.array_equal(self._held[1], acting.u):
            return None
        if self._at_rest(self._known(state, v, acting))[0].any():
            return halted
        self._held = (state, acting.u.copy()) if alone else None
        return None

    def forces(self, state: State, v: Array, drive: ActingLoads) -> Array:
        """f of every rubbing joint in the present mode, of shape (k,)."""
        known = self._known(state, v, drive)
        force = known.force.copy()
        if self._rest.any():
            force[self._rest] += self._at_rest(known)[1]
        return force

    def free_forces(self, state: State, v: Array, drive: ActingLoads) -> Array:
        """f on the free system's joints in the present mode, of shape (n′,)."""
        force = np.zeros(len(state.rho))
        np.add.at(force, self._friction.index, self.forces(state, v, drive))
        return force

    def _known(self, state: State, v: Array, drive: ActingLoads) -> _Known:
        friction = self._friction
        rows = self.rows(state)
        rates = rows @ v
        force = -friction.viscous * rates - friction.level(rates) * self._signs
        rows[self._rest & (np.linalg.norm(rows, axis=1) <= _NIL)] = 0.0
        factor = _factor(state.D)
        mobility = lapack.dpotrs(factor, rows.T, lower=1)[0]
        a = drive.acceleration(state, v) + mobility @ force
        bias = np.zeros(len(rates))
        if v.any() and (self._rest & ~self._own).any():
            bias = np.where(self._own, 0.0, state.bias(v)[friction.index])
        return _Known(rows, rates, force, mobility, a, bias[self._rest], factor)

    def _fixed(self, state: State, rows: Array, rest: Mask) -> bool:
        """Whether nothing moves while these joints rest; the same question as before is not worked out again."""
        before, key = self._ranked, rest.tobytes()
        if before is None or before[0] is not state or before[1] != key:
            self._ranked = before = (state, key, bool(np.linalg.matrix_rank(rows[rest], _NIL) == self._model.n))
        return before[2]

    def _brought_to_rest(self, v: Array, rows: Array, state: State) -> Array:
        """q̇ with the resting joints' rates removed, exactly where they are independent coordinates."""
        if self._fixed(state, rows, self._rest):
            return np.zeros(self._model.n)
        resting = rows[self._rest]
        v = v - _least_norm(resting, resting @ v)
        v[self._friction.coordinate[self._rest & self._own]] = 0.0
        return np.asarray(v)

    def _at_rest(self, known: _Known) -> tuple[Array, Array]:
        """Which way each resting joint starts to slide (0: it stays), and its force."""
        rows, level, mobility = (
            known.rows[self._rest],
            self._friction.breakaway[self._rest],
            known.mobility[:, self._rest],
        )
        pushed = rows @ known.a + known.bias
        least = _RELEASED * max(np.abs(pushed).max(), np.abs(known.a).max())
        force = _multipliers(known, rows, mobility, -known.bias)
        held = rows.any(axis=1) | (np.abs(pushed) <= least)
        if held.all() and np.all(np.abs(force) <= level * (1 + _WITHIN)):
            return np.zeros(len(level)), force
        force = np.clip(force, -level, level) if len(level) == 1 else _least_constraint(known, rows, level)
        a = pushed + rows @ (mobility @ force)
        return np.where(np.abs(a) > least, np.sign(a), 0.0), force


class StickSlipWatch(Watch):
    """Halts the integration where a joint halts or breaks loose.

    Args:
        contact: The joints with friction.
        drive: What acts from outside at (t, State, v).

    Raises:
        ConvergenceError: Joints halt and break loose without end.
    """

    def __init__(self, contact: StickSlip, drive: Callable[[float, State, Array], ActingLoads]) -> None:
        self._contact, self._drive = contact, drive
        self._recent: list[float] = []

    def look(self, step: AcceptedStep) -> float | None:
        """The first such instant."""
        return step.first(lambda instant: self._broken(instant) is not None)

    def act(self, instant: Instant) -> None:
        """Tell the joints who has halted; the motion goes on."""
        self._recent = [*self._recent[1 - _MOST_EVENTS :], instant.t]
        if len(self._recent) == _MOST_EVENTS and instant.t - self._recent[0] < 1e-6:
            raise ConvergenceError(f"friction: joints halt and break loose without end at t = {instant.t:.6g} s")
        halted = self._broken(instant)
        if halted is not None:
            self._contact.halt(halted)

    def _broken(self, instant: Instant) -> Mask | None:
        return self._contact.broken(instant.state, instant.v, lambda: self._drive(*instant))


def _multipliers(known: _Known, rows: Array, mobility: Array, target: Array) -> Array:
    """f of least norm with ρ_r(a + D⁻¹ρ_rᵀf) = target; by Cholesky where only one f does it, beyond doubt."""
    missing = target - rows @ known.a
    compliance = rows @ mobility
    if len(missing) == 1 and compliance[0, 0] > 0:
        return np.asarray(missing / compliance[0])
    if len(missing) <= len(known.a):
        factor, found, info = lapack.dposv(compliance, missing, lower=1)
        pivots = factor.diagonal()
        if info == 0 and pivots.min() > _INDEPENDENT * pivots.max():
            return np.asarray(found)
    return np.asarray(np.linalg.lstsq(compliance, missing, rcond=1e-12)[0])


def _least_norm(rows: Array, rates: Array) -> Array:
    """q̇ of least norm with these rates, where rows that vanish, or depend on others, move nothing."""
    left, sizes, right = np.linalg.svd(rows, full_matrices=False)
    kept = sizes > _NIL
    return np.asarray(right[kept].T @ (left[:, kept].T @ rates / sizes[kept]))


def _least_constraint(known: _Known, rows: Array, level: Array) -> Array:
    """argmin over |f| ≤ s of ½‖Lᵀ(a + d) + L⁻¹ρ_rᵀf‖², ρ_r d = ρ̇_r q̇, D = L Lᵀ: the dual of the principle above.

    Raises:
        ConvergenceError: The bounded least-squares solver gave up.
    """
    d = known.a if not known.bias.any() else known.a + _least_norm(rows, known.bias)
    matrix = lapack.dtrtrs(known.factor, rows.T, lower=1)[0] * level
    right = -known.factor.T @ d
    scale = float(np.linalg.norm(right))
    found = lsq_linear(matrix / scale, right / scale, bounds=(-1.0, 1.0), method="bvls", tol=1e-13, max_iter=100)
    if found.status == 0:
        raise ConvergenceError("friction: the least-constraint problem of the joints at rest was not solved")
    return np.asarray(found.x * level)


def _factor(mass: Array) -> Array:
    """L of D = L Lᵀ."""
    factor, info = lapack.dpotrf(mass, lower=1)
    if info != 0:
        raise UnsupportedMechanismError("the reduced mass matrix D is not positive definite; give the links inertias")
    return np.asarray(factor)
