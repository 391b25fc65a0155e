"""A mechanism as a Gymnasium environment: a `Simulator` that holds an action for a period.

    env = ccpin.gym.MechanismEnv("rpdr", lambda sample, action: -float(sample.v @ sample.v), horizon=500)

Motors saturate, stick and slip, limits, contacts, lags and disturbances are the simulator's; so are its errors.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array, one_each, positive
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.loading.loader import load
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.wireframe import outline, plane_of_motion
from ccpin.plotting import plot_configurations
from ccpin.simulation.events.samples import StateSample
from ccpin.simulation.integration.simulator import Simulator
from ccpin.visualization import view
from ccpin.visualization.live import Viewer

_MODES = ("human", "rgb_array")

Start = Callable[[np.random.Generator], tuple[ArrayLike, ArrayLike]]


class MechanismEnv(gymnasium.Env):  # type: ignore[misc]
    """Observations are (q, q̇), actions the motors' efforts u, held for `period`.

    An episode ends (terminated) where `done` says so or the motion cannot go on (``info["stop"]`` says why), and is
    truncated after `horizon` steps. ``info`` has the `StateSample` as well. ``reset(options={"q": …, "v": …})`` starts
    there.

    Args:
        model: The reduced model, a mechanism, or what `ccpin.load` takes.
        reward: (StateSample after the action, u) → the step's reward.
        done: StateSample → whether the episode is over; default never.
        start: A random generator → (q, q̇) of an episode's start; default the reference, at rest.
        period: How long an action is held, s.
        horizon: Steps of an episode.
        effort: Largest |u|, a number or (motors,), for motors that state no bounds; default those they state.
        render_mode: ``"human"``: the live viewer; ``"rgb_array"``: a drawing of its lines as an image; ``None``.
        options: As for `Simulator` (friction, limits, contacts, wrenches, method, rtol, …).

    Attributes:
        simulator: The simulator.

    Raises:
        InvalidInputError: A bad argument, or a motor without bounds where `effort` is not given.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(_MODES), "render_fps": 50}

    def __init__(
        self,
        model: ReducedModel | Mechanism | str | Path,
        reward: Callable[[StateSample, Array], float],
        *,
        done: Callable[[StateSample], bool] | None = None,
        start: Start | None = None,
        period: float = 0.01,
        horizon: int = 1000,
        effort: ArrayLike | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if render_mode not in (None, *_MODES):
            raise InvalidInputError(f"render_mode {render_mode!r} is not one of {', '.join(_MODES)}")
        self.model = model = model_of(load(model) if isinstance(model, str | Path) else model)
        self.simulator = Simulator(model, **options)
        self._reward, self._done, self._start = reward, done, start
        self._period, self._horizon = positive(period, "period"), int(positive(horizon, "horizon"))
        self.render_mode, self._steps = render_mode, 0
        self._viewer: Viewer | None = None
        size = model.nq + model.n
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
        self.action_space = gymnasium.spaces.Box(*effort_bounds(model, effort), dtype=np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        q: ArrayLike = self.model.alpha(self.model.mechanism.q_reference)
        v: ArrayLike = np.zeros(self.model.n)
        if self._start is not None:
            q, v = self._start(self.np_random)
        given = options or {}
        sample = self.simulator.reset(given.get("q", q), given.get("v", v))
        self._steps = 0
        self._show(sample)
        return _observed(sample), {"sample": deepcopy(sample), "stop": ""}

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Hold an action for a period."""
        u = np.asarray(action, dtype=np.float64)
        sample = self.simulator.step(u, self._period)
        stop = self.simulator.stop
        self._steps += 1
        self._show(sample)
        over = stop is not None or (self._done is not None and bool(self._done(sample)))
        info = {"sample": deepcopy(sample), "stop": "" if stop is None else stop.message}
        return _observed(sample), float(self._reward(sample, u)), over, self._steps >= self._horizon, info

    def render(self) -> NDArray[np.uint8] | None:
        """The mechanism's lines as an image (height, width, 3); with ``"human"`` the viewer follows by itself."""
        if self.render_mode != "rgb_array":
            return None
        return _image(self.model.mechanism, self.simulator.sample().q_free)

    def close(self) -> None:
        """Close the viewer."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def _show(self, sample: StateSample) -> None:
        if self.render_mode != "human":
            return
        if self._viewer is None:
            self._viewer = view(self.model.mechanism, sample.q_free)
        self._viewer.draw(sample.q_free)


def _observed(sample: StateSample) -> NDArray[np.float64]:
    return np.concatenate([sample.q, sample.v])


def effort_bounds(model: ReducedModel, effort: ArrayLike | None) -> tuple[Array, Array]:
    """Least and largest u."""
    motors = model.mechanism.motors
    if effort is not None:
        most = one_each(effort, "effort", model.n_actuated, positive=True)
        return -most, most
    endless = np.flatnonzero(~np.isfinite(motors.limits).all(axis=1))
    if len(endless):
        name = motors.each[int(endless[0])].joint
        raise InvalidInputError(f"the motor of '{name}' states no bounds: give effort= for the action space")
    return motors.limits[:, 0].copy(), motors.limits[:, 1].copy()


def _image(mechanism: Mechanism, q_free: Array) -> NDArray[np.uint8]:
    """A drawing of one configuration, framed alike for all."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = plot_configurations(mechanism, [q_free], [mechanism.name])
    shape = outline(mechanism, mechanism.q_reference)
    points = np.concatenate([shape.segments.reshape(-1, 3), shape.joints])
    plane = plane_of_motion(mechanism)
    points = points if plane is None else points @ plane.T
    middle, reach = points.mean(axis=0), 1.2 * float(np.ptp(points, axis=0).max())
    for axis, place in zip("xyz", middle, strict=False):
        figure.axes[0].set(**{f"{axis}lim": (place - reach, place + reach)})
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
