"""What certificates of tracking share: a law along its reference, a fact about a tube of errors, and what that says."""

from __future__ import annotations

import abc
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.reference_tube import ReferenceTube, reference_of
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces
from ccpin.domain.closures.system import Reading
from ccpin.errors import CcpinError
from ccpin.proof.facts import Fact
from ccpin.proof.verdict import Judged

_Own = TypeVar("_Own", bound="TubeCertificate")


@dataclass(frozen=True, eq=False, repr=False)
class TubeCertificate(Judged, abc.ABC):
    """What is proved of a law along its reference, over cells of time.

    The fact's `bound` (K, 2n) is of |q − q_d| and of a second number of each coordinate over each cell, and `ultimate`
    (n,) of |q − q_d| in the end. Whether the fact is about the law is looked at whenever a number or the verdict is
    asked for, some milliseconds: loops ask before they begin.

    Attributes:
        law: The law.
        told: What the search came to, in a sentence.
        proved: The fact, which all numbers are of; ``None`` where none is proved.
    """

    law: Any
    told: str
    proved: Fact | None
    _tube: ReferenceTube = field(repr=False)

    @property
    @abc.abstractmethod
    def _known(self) -> Fact | None:
        """The fact, if it is one about the law."""

    def _is_of_law(self, equations_of: Callable[[Any, Reading, ReferencePieces], Any]) -> bool:
        """Whether the fact is about what is claimed of the law as it is now: gains, model and reference."""
        try:
            own = equations_of(self.law, self._tube.path.reading, reference_of(self.law))
        except CcpinError:
            return False
        return self.proved is not None and bool(own.digest == self.proved.digest)

    def replay(self: _Own) -> _Own:
        """The same, its bound proved once more from its data alone; one that was pickled is undecided until then.

        Raises:
            NotProvedError: It does not hold.
        """
        return self if self.proved is None else replace(self, proved=self.proved.replay())

    def _found(self, name: str, *shape: int) -> Array:
        """A number of the fact; infinite where there is none."""
        return np.full(shape, np.inf) if self._known is None else np.asarray(self._known.found[name])

    def _bounds(self) -> tuple[Array, Array]:
        """Over each cell, of shape (K, n): of |q − q_d|, and of the second numbers."""
        n = self.law.model.n
        bound = self._found("bound", len(self._tube.cells.kicks), 2 * n)
        return bound[:, :n], bound[:, n:]

    @property
    def times(self) -> Array:
        """The cells' ends, s, of shape (K + 1,); the last is infinite."""
        return np.append(self._tube.cells.times[:-1], np.inf)

    @property
    def errors(self) -> Array:
        """A bound of |q − q_d| over each cell, of shape (K, n); infinite where nothing is proved."""
        return self._bounds()[0]

    @property
    def error(self) -> Array:
        """A bound of |q_i − q_d,i| for all t ≥ 0, of shape (n,); infinite where nothing is proved."""
        return np.asarray(self.errors.max(axis=0))

    @property
    def ultimate(self) -> Array:
        """A bound of |q − q_d| as t → ∞, of shape (n,)."""
        return self._found("ultimate", self.law.model.n)
