"""Steps a second of thousands of swinging mechanisms, beside MuJoCo's: `python -m benchmarks.many_steps [MODEL …]`.

All swing from rest for `STEPS` steps of 1 ms, from the same closed configurations, wall clock. What a step is:

- lanes: Runge and Kutta's of order 4 over q′ and q̇ and a Newton step of σ (`record(model, "step")`);
- core: the same of `forward_dynamics_many`, which finds σ by Newton's method four times;
- MuJoCo (`mujoco.rollout`), MJX and mujoco_warp: `mj_step` of ccpin's own MJCF, Euler or RK4, loops as constraints as
  stiff as the step allows, and 20 iterations of Newton's solver at most; mujoco_warp is of single precision.

`open` is how far apart the loops' ends are at the end at most (m), as MuJoCo has it of everybody's configuration;
`off` how far q is from what the lanes' steps of a tenth lead to: of the first `JUDGED`, both. Who is not installed is
told. Newton (`pip install newton`) steps articulated loops by mujoco_warp, and has no line of its own.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

import ccpin
from benchmarks.peers import NotForThisError
from benchmarks.peers.mjcf import ITERATIONS, mujoco_model
from ccpin import programs
from ccpin.errors import CcpinError

MODELS = ("rpdr", "delta", "stewart")
ROWS, STEPS, STEP, JUDGED = 4096, 100, 1e-3, 64
SPREAD = 0.05  # rad or m about the reference

Run = Callable[[int], np.ndarray]  # q′ of every row after so many steps, of shape (rows, nq)


class Swinging(NamedTuple):
    """Mechanisms at rest.

    Attributes:
        model: The reduced model, its spins free as the peers have them.
        q, q_free: Independent coordinates and configurations, of shape (rows, n) and (rows, nq).
    """

    model: ccpin.ReducedModel
    q: np.ndarray
    q_free: np.ndarray


def swinging(name: str, rows: int) -> Swinging:
    """Closed configurations about the reference."""
    model = ccpin.ReducedModel(ccpin.load(name, free=["all"]))
    start, rng, failures = model.alpha(model.mechanism.q_reference), np.random.default_rng(0), dict[int, str]()
    q = start + SPREAD * rng.uniform(-1.0, 1.0, (rows, model.n))
    q_free = model.sigma_many(q, failures=failures)
    lost = list(failures)
    q[lost], q_free[lost] = start, model.mechanism.q_reference
    return Swinging(model, q, q_free)


def lanes(held: Swinging, threads: int, h: float = STEP) -> Run:
    """The step program."""
    tree, program = held.model.mechanism.tree, programs.record(held.model, "step")
    q_places, y_places = ([tree.joint(name).q.start for name in port.entries] for port in program.inputs[:2])
    q0, y0 = held.q_free[:, q_places], held.q_free[:, y_places]
    step = programs.compiled(program)
    u, length = np.zeros(held.model.n_actuated), np.array([h])

    def run(steps: int) -> np.ndarray:
        q, y, v = np.asfortranarray(q0), np.asfortranarray(y0), np.zeros_like(q0, order="F")
        for _ in range(steps):
            q, y, v, status = step(q, y, v, u, length, threads=threads)
            if status.any():
                raise CcpinError(f"{np.count_nonzero(status)} states are refused")
        q_free = np.empty_like(held.q_free)
        q_free[:, q_places], q_free[:, y_places] = q, y
        return q_free

    return run


def core(held: Swinging, threads: int) -> Run:
    """Runge and Kutta's steps of the batches of the compiled core."""
    model, u = held.model, np.zeros((len(held.q), held.model.n_actuated))

    def run(steps: int) -> np.ndarray:
        q, v = held.q, np.zeros_like(held.q)
        for _ in range(steps):
            rates, shares = list[tuple[np.ndarray, np.ndarray]](), (0.0, 0.5 * STEP, 0.5 * STEP, STEP)
            for share in shares:
                last = rates[-1] if rates else (v, v)
                at = q + share * last[0], v + share * last[1]
                rates.append((at[1], model.forward_dynamics_many(*at, u, threads=threads)))
            q, v = (
                start + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                for start, (a, b, c, d) in zip((q, v), zip(*rates, strict=True), strict=True)
            )
        return model.sigma_many(q)

    return run


class Placed(NamedTuple):
    """MuJoCo's model with where its numbers stand in q′."""

    model: Any
    places: np.ndarray


def placed(held: Swinging, integrator: str) -> Placed:
    """The peers' model.

    Raises:
        NotForThisError: MuJoCo is not installed or cannot have it.
    """
    model, tree = mujoco_model(held.model.mechanism, timestep=STEP, integrator=integrator), held.model.mechanism.tree
    if model.nq != held.model.mechanism.nq or model.nq != model.nv:
        raise NotForThisError("its joints are more than hinges and slides")
    return Placed(model, np.array([tree.joint(model.joint(k).name).q.start for k in range(model.njnt)]))


def rollout(held: Swinging, integrator: str, threads: int) -> Run:
    """`mujoco.rollout`."""
    import mujoco
    from mujoco.rollout import Rollout

    model, places = placed(held, integrator)
    data = [mujoco.MjData(model) for _ in range(threads)]
    states = np.zeros((len(held.q), mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    states[:, 1 : 1 + model.nq] = held.q_free[:, places]  # the state begins with time
    pool = Rollout(nthread=threads if threads > 1 else 0)

    def run(steps: int) -> np.ndarray:
        found, _ = pool.rollout(model, data, states, nstep=steps)
        return back(found[:, -1, 1 : 1 + model.nq], places)

    return run


def mjx(held: Swinging, integrator: str) -> Run:
    """MJX on JAX's device, in double."""
    try:
        import jax
        import mujoco
        from mujoco import mjx
    except ImportError:
        raise NotForThisError("MJX is not installed (pip install mujoco-mjx)") from None
    jax.config.update("jax_enable_x64", True)
    model, places = placed(held, integrator)
    on_device, first = mjx.put_model(model), mjx.put_data(model, mujoco.MjData(model))
    starts = jax.numpy.array(held.q_free[:, places])
    made = dict[int, Any]()

    def run(steps: int) -> np.ndarray:
        if steps not in made:

            def one(qpos: Any) -> Any:
                data = first.replace(qpos=qpos)
                return jax.lax.fori_loop(0, steps, lambda _, each: mjx.step(on_device, each), data).qpos

            made[steps] = jax.jit(jax.vmap(one))
        return back(np.asarray(made[steps](starts)), places)

    return run


def warp(held: Swinging, integrator: str) -> Run:
    """mujoco_warp on Warp's device."""
    try:
        import mujoco
        import warp

        warp.config.quiet = True
        import mujoco_warp
    except ImportError:
        raise NotForThisError("mujoco_warp is not installed (pip install mujoco-warp)") from None
    model, places = placed(held, integrator)
    plain = mujoco.MjData(model)
    mujoco.mj_forward(model, plain)
    on_device = mujoco_warp.put_model(model)
    starts = held.q_free[:, places].astype(np.float32)

    def run(steps: int) -> np.ndarray:
        data = mujoco_warp.put_data(model, plain, nworld=len(starts))
        data.qpos.assign(starts)
        data.qvel.zero_()
        for _ in range(steps):
            mujoco_warp.step(on_device, data)
        return back(data.qpos.numpy().astype(np.float64), places)

    return run


def back(qpos: np.ndarray, places: np.ndarray) -> np.ndarray:
    """MuJoCo's numbers in the order of q′."""
    q_free = np.empty_like(qpos)
    q_free[:, places] = qpos
    return q_free


def opened(held: Swinging, q_free: np.ndarray) -> float:
    """The largest distance of loops' ends, by MuJoCo; NaN without it."""
    try:
        model, places = placed(held, "Euler")
    except NotForThisError:
        return float("nan")
    import mujoco

    data, most = mujoco.MjData(model), 0.0
    for row in q_free[:JUDGED, places]:
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        most = max(most, float(np.abs(data.efc_pos).max(initial=0.0)))
    return most


ENGINES: dict[str, Callable[[Swinging], Run]] = {
    "lanes, RK4": lambda held: lanes(held, 1),
    "lanes, RK4, two threads": lambda held: lanes(held, 2),
    "core, RK4": lambda held: core(held, 1),
    "core, RK4, two threads": lambda held: core(held, 2),
    "MuJoCo, Euler": lambda held: rollout(held, "Euler", 1),
    "MuJoCo, Euler, two threads": lambda held: rollout(held, "Euler", 2),
    "MuJoCo, RK4": lambda held: rollout(held, "RK4", 1),
    "MJX, Euler": lambda held: mjx(held, "Euler"),
    "mujoco_warp, Euler": lambda held: warp(held, "Euler"),
}


def lines(name: str, rows: int, steps: int) -> Iterator[str]:
    """One model's lines."""
    held = swinging(name, rows)
    few = held._replace(q=held.q[:JUDGED], q_free=held.q_free[:JUDGED])
    exact = np.array([held.model.alpha(row) for row in lanes(few, 1, STEP / 10.0)(10 * steps)])
    for who, engine in ENGINES.items():
        try:
            run = engine(held)
            run(1 if "MJX" not in who else steps)  # what is compiled is
            began = time.perf_counter()
            q_free = run(steps)
            rate = rows * steps / (time.perf_counter() - began)
        except (NotForThisError, CcpinError, NotImplementedError) as error:
            yield f"{name:10s}{who:28s}skipped: {error}"
            continue
        off = np.abs(np.array([held.model.alpha(row) for row in q_free[:JUDGED]]) - exact).max()
        yield f"{name:10s}{who:28s}{rate:14,.0f}{opened(held, q_free):12.0e}{off:12.0e}"


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.many_steps", description=__doc__)
    parser.add_argument("models", nargs="*", default=list(MODELS))
    parser.add_argument("--rows", type=int, default=ROWS)
    parser.add_argument("--steps", type=int, default=STEPS)
    asked = parser.parse_args(arguments)
    print(f"{asked.rows} at once, {asked.steps} steps of {STEP:g} s; MuJoCo: at most {ITERATIONS} iterations a step")
    print(f"{'':38s}{'steps/s':>14s}{'open, m':>12s}{'off, rad':>12s}")
    for name in asked.models:
        for line in lines(name, asked.rows, asked.steps):
            print(line, flush=True)


if __name__ == "__main__":
    main()
