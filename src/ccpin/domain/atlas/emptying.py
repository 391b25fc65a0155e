"""The cells of an atlas that hold no closed configuration, as far as closed forms tell."""

from __future__ import annotations

import numpy as np

from ccpin.domain.atlas.cells import LEVELS, CellStatus, CellTree, Region, place
from ccpin.domain.atlas.platform import platform_empty
from ccpin.domain.atlas.run import Runner
from ccpin.proof.emptiness import empty_cells, groups_of, platform_of

_CHUNK = 20_000


def prove_empty(runner: Runner, tree: CellTree, region: Region, depth: int, thorough: bool = False) -> None:
    """Mark cells that are neither certified nor candidates as empty where that is proved, halving those never tried.

    By the triangle inequality; `thorough`: by Theorem E of `platform` too, where it applies.

    Raises:
        Stopped: An interrupt was asked for; what was proved by then is marked.
    """
    system = runner.problem.system
    groups, platform = groups_of(system), platform_of(system) if thorough else None
    if not groups and platform is None:
        return
    smallest = 1 << (LEVELS - depth)
    cells = tree.leaves(CellStatus.UNREACHED, CellStatus.UNDECIDED)
    while cells.size:
        empty = np.zeros(len(cells), dtype=np.bool_)
        for first in range(0, len(cells), _CHUNK):
            runner.check()
            part = slice(first, first + _CHUNK)
            centre, half = place(tree, region, cells[part])
            empty[part] = empty_cells(system, groups, centre, half)
            if platform is not None:
                rows = np.flatnonzero(~empty[part])
                empty[first + rows] = platform_empty(system, platform, centre[rows], half[rows])
        tree.status[cells[empty]] = CellStatus.EMPTY
        left = cells[~empty & (tree.status[cells] == CellStatus.UNREACHED)]
        left = left[np.max(tree.size[left], axis=1, where=~region.held, initial=0) > smallest]
        cells = tree.split(left, np.argmax(tree.size[left] * (region.width / region.width.max()), axis=1))
