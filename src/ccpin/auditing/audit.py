"""Every claim of a certificate, checked one by one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.auditing.findings import Audit, Outcomes
from ccpin.auditing.reading import ClaimedDocument, read
from ccpin.errors import CcpinError, InvalidInputError

_ALWAYS = ("box", "glue", "tube", "joint", "once", "cover")  # told of even where there are none


class AuditProgress(NamedTuple):
    """How many checks are done, and of how many."""

    done: int
    of: int


def verify(
    path: str | Path,
    *,
    sample: int | None = None,
    seed: int = 0,
    workers: int = 1,
    progress: Callable[[AuditProgress], None] | None = None,
) -> Audit:
    """Check a certificate that an atlas's, a sheet atlas's or a singular cover's `save` wrote, by code of its own.

    First the document must be what its format declares and agree with itself (`declared`, `structure`, `cells`): cells
    tile the region, each certified one has its own box, and what closes on itself is a full turn.

    Proved are, of atlases: Theorem N for the boxes; that the seed is a solution of its box; that neighbours carry the
    same σ where the document does not list them as unglued (of sheets: where it says so), and that every box is reached
    from the seed's by such neighbours; that cells called singular hold a singular configuration; and that those called
    empty hold none, where that can be told by the triangle inequality, by the lengths of legs that meet in one body, or
    by a search of all values of up to six dependent coordinates (a claim counts as looked at if so); and, by such a
    search, how many there are over the cells of sheets that are counted, none of them singular, and that two sheets do
    not meet in one over certified cells. Of a workspace's boxes
    it is proved that they keep the document's limits, that the motors determine the motion, and its dexterity.

    Of singular curves: that each tube holds one and no other singular configuration; that it is the next tube's curve
    too, and closed curves' last tube's the first's; that no curve is listed twice; and that no part of the region has
    singular configurations, in any assembly mode, but in these tubes and in the boxes listed as uncovered, by a search
    of its own.

    Where eight claims of a kind are not proved, or two searches ended without an answer, no more of that kind are
    looked at.

    Args:
        path: The .json or .npz file.
        sample: How many claims of each kind (boxes, shared faces, cells; tubes, parts of the region), chosen at random;
            default all.
        seed: Of that choice.
        workers: Processes to share the work among. A script that asks for more than one needs the guard
            ``if __name__ == "__main__":``.
        progress: Called after every few checks.

    Raises:
        InvalidInputError: The file is no certificate, contradicts itself, or its fingerprint is another closure's.
        CcpinError: python-flint is not installed.
    """
    try:
        import flint  # noqa: F401
    except ImportError as error:
        raise CcpinError("verifying needs python-flint: pip install 'ccpin[validated]'") from error
    if sample is not None and sample < 1:
        raise InvalidInputError(f"sample = {sample} must be at least 1")
    if progress is not None and not callable(progress):
        raise InvalidInputError(f"progress must be a function, not {type(progress).__name__}")
    from ccpin.auditing import looking
    from ccpin.auditing.wording import besides, claimed

    document = read(path)
    kinds = looking.claims_of(document)
    chosen = {kind: _chosen(len(every), sample, seed + k) for k, (kind, every) in enumerate(kinds.items())}
    tasks = [(kind, kinds[kind][k]) for kind, rows in chosen.items() for k in rows]
    found = Outcomes(kinds)
    done = 0
    for part in looking.results(document, tasks, workers, found):
        for result in part:
            found.add(*result)
        done += len(part)
        if progress is not None:
            progress(AuditProgress(done, len(tasks)))
    claims = [found.claim(kind) for kind, every in kinds.items() if kind in _ALWAYS or every]
    if document.ranges is not None:
        claims.append(looking.ranged(document))
    if isinstance(document, ClaimedDocument) and document.seed is not None:
        claims.insert(2, looking.reached(document, document.seed, [(c.first, c.second) for c in kinds["glue"]]))
    return Audit(
        theorem=document.header["theorem"],
        fingerprint=document.header["fingerprint"],
        claims=tuple(claims),
        not_checked=besides(document),
        claim=claimed(document),
    )


def _chosen(count: int, sample: int | None, seed: int) -> NDArray[np.int64]:
    if sample is None or sample >= count:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, sample, replace=False))
