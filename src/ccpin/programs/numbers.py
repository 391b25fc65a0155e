"""Rows of q and q′ as the numbers that programs take, and back: circles are angles (`recorded_coordinates`)."""

from __future__ import annotations

import math

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.programs.recording.recorded_mechanism import Numbering

_OFF = 1e-6  # from unit length of (cosine, sine): the model refuses such a pair


class NumbersOfRows:
    """Numbers of a model whose q̇ are the rates of q's numbers.

    Args:
        model: The model.
        own: Its numbers.
    """

    def __init__(self, model: ReducedModel, own: Numbering) -> None:
        self._model, self._own = model, own
        self._q, self._y = list(own.q.places), list(own.dependent)

    def start(self, q_free: Array) -> tuple[Array, Array, Mask]:
        """The numbers q and y of configurations of shape (N, nq), and which of them are such."""
        own = self._own
        x, known = np.empty((len(q_free), len(own.near))), np.array(np.isfinite(q_free).all(axis=1))
        for joint in own.joints:
            held, place = q_free[:, joint.q], slice(joint.x.start, joint.x.stop)
            if joint.kind.unit == 2:
                known = known & _of_unit_length(held)
                x[:, joint.x.start : joint.x.stop - 1] = held[:, :-2]
                x[:, joint.x.stop - 1] = _angles(held[:, -2:], own.near[joint.x.stop - 1])
            else:
                x[:, place] = held
        if own.turns:
            x[:, own.joints[-1].x.stop :] = [own.numbers(row)[own.joints[-1].x.stop :] for row in q_free]
        return x[:, self._q], x[:, self._y], known

    def independent(self, q: Array, near: Array) -> tuple[Array, Mask]:
        """The numbers of q of shape (N, model.nq), angles within half a turn of those near, and which rows are such."""
        columns, known = list[Array](), np.ones(len(q), dtype=np.bool_)
        if self._model.nq == self._model.n and not self._own.q.circles:
            return q, known
        for part in self._model.coordinates.parts:
            held = q[:, part.q]
            if part.whole is not None:
                known = known & _of_unit_length(held)
                held = _angles(held, near[..., len(columns)])[:, None]
            elif part.wraps:
                held = _nearest(held, near[..., [len(columns)]])
            columns += list(held.T)
        return np.array(columns).T, known

    def q_free(self, q: Array, y: Array) -> Array:
        """Configurations of shape (N, nq)."""
        own = self._own
        x = np.empty((len(q), len(own.near)))
        x[:, self._q], x[:, self._y] = q, y
        found = np.empty((len(q), self._model.mechanism.nq))
        for joint in own.joints:
            held, window = x[:, joint.x], found[:, joint.q]
            if joint.kind.unit == 2:
                window[:, :-2] = held[:, :-1]
                window[:, -2], window[:, -1] = np.cos(held[:, -1]), np.sin(held[:, -1])
            else:
                window[...] = held
        return found


def _of_unit_length(pairs: Array) -> Mask:
    return np.asarray(np.abs(np.hypot(pairs[:, -2], pairs[:, -1]) - 1.0) <= _OFF)


def _angles(points: Array, near: Array | float) -> Array:
    """Angles of points (cosine, sine), within half a turn of others."""
    return _nearest(np.arctan2(points[:, -1], points[:, -2]), near)


def _nearest(angles: Array, near: Array | float) -> Array:
    return angles + math.tau * np.round((near - angles) / math.tau)
