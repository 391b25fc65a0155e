"""Thousands of one mechanism at once: Gymnasium's vector environment on a step program in lanes.

    envs = ccpin.gym.MechanismVectorEnv("rpdr", 4096, parameters={"gravity": (9.0, 10.0)})

The motion is Runge and Kutta's of order 4 with the motors' efforts held, closed after every step; joints' dampers and
springs are in it, dry friction, joint limits, contacts and motors' lags are not (`MechanismEnv` has those).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array, Mask, positive, whole
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.gym.environment import effort_bounds
from ccpin.mechanism.loading.loader import load
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.lanes import CompiledProgram, fastest
from ccpin.programs.numbers import NumbersOfRows
from ccpin.programs.recording.constants import parameters_of
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recordings import record

LONGEST = 2e-3  # s: of an integrator's step, by default
_TRIES = 8  # starts drawn for a row before it starts at the reference
_STEPS = 4  # Newton's, from the model's σ to that with a row's own lengths


class Moves(NamedTuple):
    """What a step of all environments did, row by row.

    Attributes:
        q, v: The independent coordinates as numbers (of circles the angle) and velocities after it, of shape (N, n).
        u: Efforts held, of shape (N, motors).
        goal: The q that is to be reached, of shape (N, n).
        parameters: The values drawn, of shape (N, parameters).
    """

    q: Array
    v: Array
    u: Array
    goal: Array
    parameters: Array


def reach(moves: Moves) -> Array:
    """The default reward: 1 at the goal and at rest, less with distance, speed and effort; of shape (N,)."""
    away, speed = (np.einsum("ij,ij->i", each, each) for each in (moves.q - moves.goal, moves.v))
    return np.asarray(np.exp(-4.0 * away) - 0.1 * away - 0.002 * speed)


class MechanismVectorEnv(VectorEnv):  # type: ignore[misc]
    """N environments in one: observations are (q, q̇, goal), actions the motors' efforts, held for a period.

    An environment ends (terminated) where its state is refused: near a singular configuration, a step that does not
    close, or numbers beyond all bounds; and where `done` says so. After `horizon` steps it is truncated. How it starts
    anew is one of Gymnasium's modes: in the same step, with `info["final_obs"]` and `info["final_info"]` where
    `info["_final_obs"]`; in the next one, whose action is not looked at and whose reward is 0; or with
    `reset(options={"reset_mask": …})` alone. `info` has `refused`, and the `parameters` of those that started.
    Arrays are NumPy's own and new in every step; they share their memory by DLPack (`torch.from_dlpack`).

    Args:
        model: The reduced model, a mechanism, or what `ccpin.load` takes.
        num_envs: N.
        reward: `Moves` → the step's rewards, (N,); default `reach`.
        done: `Moves` → which are over, (N,); default none.
        start: (random generator, k) → q, (k, model.nq), and q̇, (k, n), to start from; default within `spread` of the
            reference, at rest. Rows that σ does not reach start elsewhere.
        goal: (random generator, k) → numbers q, (k, n); default within `spread` of the reference's, where σ reaches.
        spread: rad or m.
        parameters: What `ccpin.programs.record` calls parameters, with the least and the largest value, drawn evenly
            for every episode.
        period: How long an action is held, s. longest: Of an integrator's step, s.
        horizon: Steps of an episode.
        autoreset_mode: `gymnasium.vector.AutoresetMode` or its value: `"SameStep"`, `"NextStep"`, `"Disabled"`.
        effort: Largest |u|, a number or (motors,), for motors that state no bounds; default those they state.
        threads: To step on.

    Attributes:
        model: The model.
        backend: `"lanes"`, or `"numpy"` where there is no compiler.

    Raises:
        InvalidInputError: A bad argument, or a motor without bounds where `effort` is not given.
        UnsupportedMechanismError: q̇ is not the rate of q's numbers (a whole ball is independent).
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        model: ReducedModel | Mechanism | str | Path,
        num_envs: int,
        *,
        reward: Callable[[Moves], ArrayLike] = reach,
        done: Callable[[Moves], ArrayLike] | None = None,
        start: Callable[[np.random.Generator, int], tuple[ArrayLike, ArrayLike]] | None = None,
        goal: Callable[[np.random.Generator, int], ArrayLike] | None = None,
        spread: float = 0.3,
        parameters: Mapping[str, tuple[float, float]] | None = None,
        period: float = 0.02,
        longest: float = LONGEST,
        horizon: int = 100,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        effort: ArrayLike | None = None,
        threads: int = 1,
    ) -> None:
        self.model = model = model_of(load(model) if isinstance(model, str | Path) else model)
        self.num_envs, self._horizon = whole(num_envs, "num_envs"), whole(horizon, "horizon")
        self._substeps = math.ceil(positive(period, "period") / positive(longest, "longest") - 1e-9)
        self._h, self._spread = np.array([period / self._substeps]), positive(spread, "spread")
        self._threads = whole(threads, "threads")
        self._own = numbering(model, model.mechanism.q_reference)
        if not self._own.q.scalar:
            raise UnsupportedMechanismError("q has a whole ball or carriage: name single turns as independent")
        self._numbers = NumbersOfRows(model, self._own)
        self._reward, self._done, self._start, self._goal = reward, done, start, goal
        self._range = _ranges(model, parameters or {})
        names = tuple(parameters or {})
        self._step = fastest(record(model, "step", parameters=names))
        self.backend = "lanes" if isinstance(self._step, CompiledProgram) else "numpy"
        self._close = fastest(record(model, "sigma", given="near", steps=_STEPS, parameters=names))
        ports = [port.name for port in self._close.program.inputs]
        self._takes = "p" in ports  # where σ depends on the parameters
        low, high = effort_bounds(model, effort)
        space = gymnasium.spaces.Box(-np.inf, np.inf, (3 * model.n,), np.float32)
        self.single_observation_space = space
        self.single_action_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))
        self.observation_space = batch_space(space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._bounds, rows, n = (low, high), self.num_envs, model.n
        self._q, self._v, self._aim = (np.zeros((rows, n), order="F") for _ in range(3))
        self._y = np.zeros((rows, len(self._own.dependent)), order="F")
        self._p, self._age = np.zeros((rows, len(names))), np.zeros(rows, dtype=np.int64)
        self._over: Mask | None = None  # which ended and are to start anew; none before the first reset
        self._mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}  # type: ignore[misc]  # each its own

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start all environments anew, or those of `options["reset_mask"]`, (N,)."""
        super().reset(seed=seed)
        chosen = self._chosen(options or {})
        self._begin(np.flatnonzero(chosen))
        self._over = np.zeros(self.num_envs, dtype=np.bool_) if self._over is None else self._over & ~chosen
        return self._observed(), {"parameters": self._p.copy(), "_parameters": chosen}

    def _chosen(self, options: dict[str, Any]) -> Mask:
        """Which are to start anew.

        Raises:
            InvalidInputError: Options other than a mask, or a mask that leaves out what never started.
        """
        if options.keys() - {"reset_mask"}:
            raise InvalidInputError(f"options of a reset are 'reset_mask' alone, not {', '.join(options)}")
        chosen: Mask = np.array(options.get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        if chosen.shape != (self.num_envs,) or chosen.dtype != np.bool_ or (self._over is None and not chosen.all()):
            raise InvalidInputError(f"reset_mask must be booleans of shape ({self.num_envs},), all true at first")
        return chosen

    def step(self, actions: ArrayLike) -> tuple[NDArray[np.float32], Array, Mask, Mask, dict[str, Any]]:
        """Hold an action for a period in each.

        Raises:
            InvalidInputError: Another shape, or environments that are to be reset first.
        """
        u = np.asarray(actions, dtype=np.float64)
        if u.shape != (self.num_envs, self.model.n_actuated):
            raise InvalidInputError(f"actions must be of shape {self.action_space.shape}, not {u.shape}")
        if self._over is None or (self._mode is AutoresetMode.DISABLED and self._over.any()):
            raise InvalidInputError("environments that did not start, or ended, are to be reset first")
        begun = self._over
        u = np.clip(u, *self._bounds)
        sound = self._move(u) | begun
        self._age += 1
        if begun.any():
            self._begin(np.flatnonzero(begun))
        moves = Moves(*(each.copy() for each in (self._q, self._v, u, self._aim, self._p)))
        rewards = np.where(begun, 0.0, _of_rows(self._reward(moves), "reward", moves))
        over = ~sound if self._done is None else ~sound | _of_rows(self._done(moves), "done", moves).astype(np.bool_)
        over = over & ~begun
        late = ~over & (self._age >= self._horizon)
        told: dict[str, Any] = {"refused": ~sound}
        ended = over | late
        if self._mode is not AutoresetMode.SAME_STEP:
            self._over = ended
        elif ended.any():
            last = {"refused": ~sound, "_refused": ended, "parameters": moves.parameters, "_parameters": ended}
            told |= {"final_obs": self._observed(), "_final_obs": ended, "final_info": last, "_final_info": ended}
            self._begin(np.flatnonzero(ended))
            begun = ended
        if begun.any():
            told |= {"parameters": self._p.copy(), "_parameters": begun}
        return self._observed(), rewards, over, late, told

    def _move(self, u: Array) -> Mask:
        """All states a period on; which of them are sound. The others stay at their last sound one."""
        sound: Mask = np.ones(self.num_envs, dtype=np.bool_)
        u = np.asfortranarray(u)
        given = (self._p,) if self._p.shape[1] else ()
        for _ in range(self._substeps):
            q, y, v, status = self._step(self._q, self._y, self._v, u, *given, self._h, threads=self._threads)
            with np.errstate(invalid="ignore", over="ignore"):
                good = (status == 0) & np.isfinite(q.sum(axis=1) + y.sum(axis=1) + v.sum(axis=1))
            sound &= good
            lost = np.flatnonzero(~sound)
            for held, new in ((self._q, q), (self._y, y), (self._v, v)):
                new[lost] = held[lost]
            self._q, self._y, self._v = q, y, v
        return sound

    def _begin(self, rows: NDArray[np.intp]) -> None:
        """New episodes of some rows."""
        rng, model = self.np_random, self.model
        low, high = self._range
        self._p[rows] = rng.uniform(low, high, (len(rows), len(low)))
        left = rows
        for _ in range(_TRIES):
            if not len(left):
                break
            q, v = self._drawn(rng, len(left))
            failures: dict[int, str] = {}
            x = model.sigma_many(q, failures=failures)
            left = left[~self._placed(left, x, v, np.array([k not in failures for k in range(len(left))]))]
        if len(left):
            x = np.tile(model.mechanism.q_reference, (len(left), 1))
            self._placed(left, x, np.zeros((len(left), model.n)), np.ones(len(left), dtype=np.bool_))
        self._aim[rows] = self._goals(rng, len(rows))
        self._age[rows] = 0

    def _drawn(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Starts of some rows, as the model has q."""
        model = self.model
        if self._start is not None:
            q, v = (np.asarray(each, dtype=np.float64) for each in self._start(rng, count))
            return q, v
        about = model.alpha(model.mechanism.q_reference)
        steps = self._spread * rng.uniform(-1.0, 1.0, (count, model.n))
        if model.nq == model.n:
            return about + steps, np.zeros((count, model.n))
        return np.array([model.coordinates.integrate(about, step) for step in steps]), np.zeros((count, model.n))

    def _placed(self, rows: NDArray[np.intp], q_free: Array, v: Array, known: Mask) -> Mask:
        """Put rows at configurations, closed with their own parameters; which of them are."""
        q_free = np.where(known[:, None], q_free, self.model.mechanism.q_reference)
        q, y, _ = self._numbers.start(q_free)
        given = (self._p[rows],) if self._takes else ()
        y, status = self._close(q, y, *given, threads=self._threads)
        known = np.asarray(known & (status == 0))
        kept = rows[known]
        self._q[kept], self._y[kept], self._v[kept] = q[known], y[known], v[known]
        return known

    def _goals(self, rng: np.random.Generator, count: int) -> Array:
        """Numbers q to reach."""
        if self._goal is not None:
            return np.asarray(self._goal(rng, count), dtype=np.float64)
        return self._own.near[list(self._own.q.places)] + self._spread * rng.uniform(-1, 1, (count, self.model.n))

    def _observed(self) -> NDArray[np.float32]:
        return np.hstack([self._q, self._v, self._aim]).astype(np.float32)


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode that a value names.

    Raises:
        InvalidInputError: There is none such.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(repr(each.value) for each in AutoresetMode)
        raise InvalidInputError(f"autoreset_mode {mode!r} is not one of {known}") from None


def _of_rows(value: ArrayLike, name: str, moves: Moves) -> Array:
    """A number for each row.

    Raises:
        InvalidInputError: Another shape.
    """
    found = np.asarray(value, dtype=np.float64)
    if found.shape != moves.q.shape[:1]:
        raise InvalidInputError(f"{name} must give a number for each row, ({len(moves.q)},), not {found.shape}")
    return found


def _ranges(model: ReducedModel, parameters: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """Least and largest values.

    Raises:
        InvalidInputError: No such parameter, or no range.
    """
    parameters_of(model, tuple(parameters))
    found = np.empty((2, len(parameters)))
    for k, (name, pair) in enumerate(parameters.items()):
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise InvalidInputError(f"parameters[{name!r}] must be the least and the largest value: {pair!r}") from None
        if not (math.isfinite(low) and low <= high < math.inf) or (name[:4] in ("mass", "leng") and low <= 0.0):
            raise InvalidInputError(f"parameters[{name!r}] is no range: {pair!r}")
        found[:, k] = low, high
    return found[0], found[1]
