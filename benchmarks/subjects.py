"""What is measured: mechanisms, both backends' models of one, and a state that these and the peers are asked at."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

import ccpin
from benchmarks.measured import NATIVE, NUMPY
from ccpin.errors import DescriptionNotFoundError, InvalidInputError
from ccpin.native import VARIABLE

AWAY = 1e-2
"""How far from where σ is asked the configuration is that it is given, in rad."""


@contextmanager
def backend(name: str) -> Iterator[None]:
    """`native` or `numpy` for all that is made within."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = name
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def backends() -> tuple[str, ...]:
    """Those there are: the NumPy reference always, the compiled core where it is built."""
    try:
        with backend(NATIVE):
            ccpin.backend()
    except InvalidInputError:
        return (NUMPY,)
    return NATIVE, NUMPY


def model_on(name: str, mechanism: ccpin.Mechanism) -> ccpin.ReducedModel:
    """The reduced model on one backend."""
    with backend(name):
        return ccpin.ReducedModel(mechanism)


def models_of(mechanism: ccpin.Mechanism) -> dict[str, ccpin.ReducedModel]:
    """The reduced model on each backend."""
    return {name: model_on(name, mechanism) for name in backends()}


def loaded(model: str) -> ccpin.Mechanism | None:
    """A mechanism by name or path, its spins free as the peers have them; ``None`` where there is no such file."""
    try:
        return ccpin.load(model, free=["all"])
    except DescriptionNotFoundError:
        return None


class Place(NamedTuple):
    """One state near the reference, and what the free system has there.

    Attributes:
        q: Independent coordinates, of shape (nq,). v, u: q̇ (n,) and efforts (motors,).
        near: A closed configuration whose q is `AWAY` from here.
        q_free, v_free, tau: q′, q̇′ and Sᵀu. a_free: q̈′ by the NumPy reference.
    """

    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    near: np.ndarray
    q_free: np.ndarray
    v_free: np.ndarray
    tau: np.ndarray
    a_free: np.ndarray


def place(model: ccpin.ReducedModel) -> Place:
    """A state at the reference with random, moderate velocities and efforts."""
    rng = np.random.default_rng(7)
    q = model.alpha(model.mechanism.q_reference)
    state = model.at(q)
    v, u = rng.normal(size=model.n), rng.normal(size=model.n_actuated)
    near = model.sigma(model.coordinates.integrate(q, np.full(model.n, AWAY / np.sqrt(model.n))), state.q_free)
    a_free = state.a_free(v, state.forward_dynamics(v, u))
    return Place(q, v, u, near, state.q_free, state.v_free(v), state.joint_efforts(u), a_free)


def batch(model: ccpin.ReducedModel, at: Place, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of q `AWAY` from a place, q̇ and u."""
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(rows, model.n))
    steps *= AWAY / np.linalg.norm(steps, axis=1)[:, None]
    q = np.array([model.coordinates.integrate(at.q, step) for step in steps])
    return q, rng.normal(size=(rows, model.n)), rng.normal(size=(rows, model.n_actuated))


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference, relative to the largest entry expected."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())
