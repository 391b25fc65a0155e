"""What a simulation returns: immutable samples with a status, writable as CSV and npz."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple
from zipfile import BadZipFile

import numpy as np

from ccpin.arrays import Array, instance
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.files import write_atomically
from ccpin.mechanism.mechanism import Mechanism, mechanism_of

Status = Literal["finished", "settled", "singular", "outside", "failed", "interrupted"]


class Trajectory(NamedTuple):
    """Samples of a motion.

    Attributes:
        t: Times in seconds, of shape (T,).
        q: Independent coordinates, of shape (T, model.nq). v: velocities, of shape (T, n).
        u: Efforts of the actuated joints, of shape (T, motors).
        q_free: Closed configurations σ(q), of shape (T, nq).
        closure_error: ‖φ(q′)‖ at each sample, metres (and radians), of shape (T,).
        status: finished (the duration), settled, singular, outside (of the region), failed or interrupted.
        message: The status in a sentence.
        evaluations: Number of evaluations of the equations of motion.
        v_free: q̇′ at each sample, of shape (T, n′); q̇ = α_q′ q̇′ alone does not tell it where α's coordinates are
            singular.
        changes: How often the run changed its independent coordinates for others (`ccpin.simulation.following`); q and
            v are those of its model all along.
    """

    t: Array
    q: Array
    v: Array
    u: Array
    q_free: Array
    closure_error: Array
    status: Status
    message: str
    evaluations: int
    v_free: Array
    changes: int

    def __repr__(self) -> str:
        return f"Trajectory({self.status} at {self.t[-1]:.6g} s, {len(self.t)} samples, n = {self.v.shape[1]})"

    def then(self, other: Trajectory) -> Trajectory:
        """This trajectory followed by another, whose first sample repeats this one's last and is dropped.

        The other's times are shifted to begin where this one ends.
        """
        later = instance(other, "other", Trajectory)._replace(t=other.t + (self.t[-1] - other.t[0]))
        joined: dict[str, Any] = {
            name: getattr(self, name) + getattr(other, name) for name in ("evaluations", "changes")
        }
        for name in ("t", "q", "v", "u", "q_free", "closure_error", "v_free"):
            joined[name] = np.concatenate([getattr(self, name), getattr(later, name)[1:]])
        return other._replace(**joined)

    def states(self, model: ReducedModel | Mechanism) -> Iterator[tuple[State, Array, Array]]:
        """(the State at q, v, u) of every sample, for reading the reduced model along the motion.

        Raises:
            InvalidInputError: The trajectory is of another mechanism: its configurations or efforts have another size.
        """
        model = model_of(model)
        sizes, wanted = (self.q_free.shape[1:], self.u.shape[1:]), ((model.mechanism.nq,), (model.n_actuated,))
        if sizes != wanted:
            raise InvalidInputError(
                f"the trajectory has configurations of {sizes[0]} entries and {sizes[1]} efforts; this model has "
                f"{wanted[0]} and {wanted[1]}"
            )
        for q, v, u, q_free in zip(self.q, self.v, self.u, self.q_free, strict=True):
            yield model.at(q, q_free), v, u

    def save_npz(self, path: str | Path) -> None:
        """Write all arrays (and status, message) to an .npz file, atomically."""
        arrays = {name: getattr(self, name) for name in self._fields}
        write_atomically(path, "wb", lambda file: np.savez_compressed(file, **arrays))

    def save_csv(self, path: str | Path, mechanism: Mechanism | ReducedModel) -> None:
        """Write t, q, v, u, q′ and the closure error as CSV with a header line, atomically."""
        header = ",".join(csv_header(self, mechanism_of(mechanism)))
        table = np.column_stack([self.t, self.q, self.v, self.u, self.q_free, self.closure_error])
        write_atomically(
            path,
            "w",
            lambda file: np.savetxt(file, table, delimiter=",", header=header, comments="", fmt="%.17g"),
        )


def csv_header(trajectory: Trajectory, mechanism: Mechanism) -> list[str]:
    """Column names, each with its unit: ``q_joint1``, ``v_joint1``, ``u_joint1``, ``qfree_0``."""

    def columns(symbol: str, names: Sequence[str], count: int) -> list[str]:
        return [f"{symbol}_{name}" for name in (names if len(names) == count else range(count))]

    return [
        "t",
        *columns("q", mechanism.independent, trajectory.q.shape[1]),
        *columns("v", mechanism.independent, trajectory.v.shape[1]),
        *columns("u", mechanism.actuated, trajectory.u.shape[1]),
        *columns("qfree", (), trajectory.q_free.shape[1]),
        "closure_error",
    ]


def load_npz(path: str | Path) -> Trajectory:
    """Read a trajectory written by `Trajectory.save_npz`.

    Raises:
        InvalidInputError: The file is not one.
    """
    try:
        with np.load(path) as stored:
            fields = {name: stored[name] for name in Trajectory._fields}
    except (OSError, KeyError, ValueError, TypeError, EOFError, BadZipFile) as error:
        raise InvalidInputError(f"{path} is not a trajectory: {error}") from None
    scalars = {"status": str(fields["status"]), "message": str(fields["message"])}
    counts = {name: int(fields[name]) for name in ("evaluations", "changes")}
    return Trajectory(**{**fields, **scalars, **counts})
