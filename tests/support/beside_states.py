"""States of a certified region in exported C, beside the same arithmetic in __float128 and, of some, in balls."""

from __future__ import annotations

from typing import NamedTuple

import flint
import numpy as np

import ccpin
from ccpin.dynamics.batches import Failures
from ccpin.programs.certified_region import OUTSIDE
from ccpin.programs.numbers import NumbersOfRows
from ccpin.programs.program_sources import assembled
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.sine_cosine import PRECISIONS, Format
from ccpin.validated.programs.program_certificate import ProgramCertificate
from tests.support.programs import BITS, ball_of, exact_sigma, exact_values
from tests.support.quadruple import Quadruple

CHUNK = 20_000  # states at a time
ROOM = 1e-10  # the core's σ(q) is off by less: so far y stays inside of `start`
FAR, BEYOND = 30.0, 3.0  # outside: y up to so many starts from σ(q); q up to so many half widths from the middle


class Seen(NamedTuple):
    """A million states of one program in one format.

    Attributes:
        states: How many.
        largest, proved: Of every output, what it was off by at most, and what is proved.
        beyond: Outputs that were off by more.
        refused: States with a status that is not 0.
        wrong: States of status 0 with σ(q) not on the branch.
        doubt: What __float128 and balls of 200 bits differ by at most, as a share of what is proved.
    """

    states: int
    largest: np.ndarray
    proved: np.ndarray
    beyond: int
    refused: int
    wrong: int
    doubt: float


class Outside(NamedTuple):
    """States that nothing is proved of.

    Attributes:
        beyond: Those with an input outside the certified box.
        refused: Of these, those with status 3.
        others: Status not 0; status 0 and σ(q) on the branch; status 0 and not, of the others.
    """

    beyond: int
    refused: int
    others: tuple[int, int, int]


class Region:
    """States of a certified region, in a format, beside the exact.

    Args:
        model: A reduced model whose q is a list of numbers.
        certificate: What is proved of a program of it.
        format: The format.
    """

    def __init__(self, model: ccpin.ReducedModel, certificate: ProgramCertificate, format: Format) -> None:
        assert model.nq == model.n
        self._model, self._certificate, self._program = model, certificate, certificate.program
        self._numbers = NumbersOfRows(model, numbering(model, model.mechanism.q_reference))
        self._format, self._type = format, PRECISIONS[format].type
        guarded = certificate.guarded()
        assert guarded.region is not None
        self._region, self._quadruple = guarded.region, Quadruple(guarded, format)

    def seen(self, count: int, exact: int, seed: int = 0) -> Seen:
        """So many random states, of which so many also in balls."""
        rng, found = np.random.default_rng(seed), list[tuple[np.ndarray, int, int, int, float]]()
        proved = np.concatenate([each.ravel() for each in self._certificate.error(self._format).values()])
        for first in range(0, count, CHUNK):
            x, sigma = self.inside(rng, min(CHUNK, count - first))
            beside = self._quadruple.beside(x, sigma)
            beyond = np.count_nonzero(~(beside.off <= proved))
            wrong = np.count_nonzero(self._strays(beside.outputs, sigma) & (beside.status == 0))
            here = min(max(exact - first, 0), len(x))
            rows = zip(x[:here], sigma[:here], beside.exact[:here], strict=True)
            doubt = max((self._doubt(*row, proved) for row in rows), default=0.0)
            found.append((beside.off.max(axis=0), beyond, np.count_nonzero(beside.status), wrong, doubt))
        off, beyond, refused, wrong, doubts = zip(*found, strict=True)
        return Seen(count, np.max(off, axis=0), proved, sum(beyond), sum(refused), sum(wrong), max(doubts))

    def inside(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Inputs of the format in the region, at corners, on faces and inside a third each; and σ(q)."""
        certificate, n, m = self._certificate, self._model.n, self._program.inputs[1].size
        way = rng.uniform(-1.0, 1.0, (count, n + m + len(certificate.bounds)))
        ends = rng.random(way.shape) < rng.choice([0.0, 0.5, 1.0], (count, 1))
        way = np.where(ends, np.sign(way), way)
        middle, half = 0.5 * (certificate.lower + certificate.upper), 0.5 * (certificate.upper - certificate.lower)
        q = self._within(middle + half * way[:, :n], certificate.lower, certificate.upper)
        sigma, there = self._sigma(q)
        assert there.all()
        room = certificate.start - ROOM
        y = self._within(sigma + room * way[:, n : n + m], sigma - room, sigma + room)
        rest = self._within(certificate.bounds * way[:, n + m :], -certificate.bounds, certificate.bounds)
        return np.hstack([q, y, rest]), sigma

    def outside(self, count: int, seed: int = 1) -> Outside:
        """So many random states, half of them with q in the box and y far, half with q beyond it and y near."""
        certificate, rng, total = self._certificate, np.random.default_rng(seed), np.zeros(5, dtype=np.int64)
        n, m = self._model.n, self._program.inputs[1].size
        middle, half = 0.5 * (certificate.lower + certificate.upper), 0.5 * (certificate.upper - certificate.lower)
        for first in range(0, count, CHUNK):
            rows = min(CHUNK, count - first)
            way = rng.uniform(-1.0, 1.0, (rows, n + m + len(certificate.bounds)))
            far = np.arange(rows) % 2 == 0
            # in one number at least: y beyond its start, q beyond its box
            place = np.where(far, n + rng.integers(m, size=rows), rng.integers(n, size=rows))
            reach = np.ones_like(way)
            reach[far, n : n + m], reach[~far, :n] = FAR, BEYOND
            across = rng.uniform(1.0, np.where(far, FAR, BEYOND)) * rng.choice([-1.0, 1.0], rows)
            way *= reach
            way[np.arange(rows), place] = across
            q = middle + half * way[:, :n]
            sigma, there = self._sigma(q)
            y = sigma + certificate.start * way[:, n : n + m]
            x = np.hstack([q, np.where(there[:, None], y, 0.0), certificate.bounds * way[:, n + m :]]).astype(
                self._type
            )
            out, status = self._quadruple.run(x)
            held = np.all((x >= np.array(self._region.lower)) & (x <= np.array(self._region.upper)), axis=1)
            trusted, wrong = status == 0, self._strays(out, sigma)
            total += [
                np.count_nonzero(each)
                for each in (
                    ~held, ~held & (status == OUTSIDE), held & ~trusted, held & trusted & ~wrong, held & trusted & wrong
                )
            ]  # fmt: skip
        beyond, refused, *others = map(int, total)
        return Outside(beyond, refused, (others[0], others[1], others[2]))

    def _strays(self, out: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Which outputs have σ farther from the branch than the certificate's start; none where σ is none of them."""
        if not self._program.corrections:
            return np.zeros(len(out), dtype=np.bool_)
        return np.any(~(np.abs(out[:, : sigma.shape[1]] - sigma) <= self._certificate.start), axis=1)

    def _sigma(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The core's σ at q as y, and where there is one."""
        failures = Failures()
        found = self._model.sigma_many(np.asarray(q, dtype=np.float64), failures=failures)
        return self._numbers.start(found)[1:]

    def _within(self, values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Numbers of the format between bounds."""
        least, most = (np.asarray(each).astype(self._type) for each in (lower, upper))
        least = np.where(least < lower, np.nextafter(least, self._type(np.inf)), least)
        most = np.where(most > upper, np.nextafter(most, self._type(-np.inf)), most)
        return np.clip(values.astype(self._type), least, most)

    def _doubt(self, x: np.ndarray, sigma: np.ndarray, found: np.ndarray, proved: np.ndarray) -> float:
        """What __float128 is off by, as a share of what is proved of the format, by balls of 200 bits."""
        source, n, m = self._program.source, self._model.n, len(sigma)
        with flint.ctx.workprec(BITS):
            at: list[object] = x.astype(float).tolist()
            if source.steps:
                at[n : n + m] = exact_sigma(source, x[:n], sigma)
            true = exact_values(assembled(source._replace(steps=0)).code, at)
            apart = [abs(t - sum(map(ball_of, row))) for t, row in zip(true, found.tolist(), strict=True)]
            return max(float(each.upper()) / most for each, most in zip(apart, proved, strict=True) if most)
