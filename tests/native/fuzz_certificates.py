"""Certificates for the fuzzer: bounds, Theorem N, Newton, gluing and contacts with sound and with spoilt arguments."""

from __future__ import annotations

import contextlib
import copy
from typing import Any

import numpy as np

from ccpin.covering.cells import CellTree
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.domain.closures.system import reading_of
from ccpin.errors import CcpinError
from ccpin.native._core import Certifier, contacts
from ccpin.native.certifier import numbers_of
from ccpin.proof.equations import problem_of
from ccpin.proof.newton import Boxes
from ccpin.proof.phasors import phasors_of
from tests.native.spoiling import spoil, spoilt_array


def ask_for_certificates(mechanism: Any, rng: np.random.Generator) -> int:
    """Everything certificates ask of the core, about one mechanism's closures; returns how many calls that made."""
    calls = _ask_for_contacts(rng)
    try:
        system = reading_of(mechanism, mechanism.q_reference).system
    except CcpinError:  # a closure that certificates do not know
        return calls
    if not system.m:
        return calls
    for phasors in {id(p): p for p in (None, phasors_of(system))}.values():
        numbers = numbers_of(system, phasors)
        calls += _ask(Certifier(numbers), system, rng)
        for _ in range(10):
            spoilt = copy.deepcopy(numbers)
            spoil(spoilt, rng)
            with contextlib.suppress(ValueError):
                calls += _ask(Certifier(spoilt), system, rng)
    certify_boxes(problem_of(system), *_boxes(system, rng))
    return calls


def _boxes(system: Any, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres, half widths of all sizes and directions of three boxes."""
    centre = rng.uniform(-1, 1, (3, system.n + system.m))
    return centre, np.tile(np.geomspace(1e-9, 2.0, 3)[:, None], (1, system.n)), np.eye(system.n)


def _ask(core: Any, system: Any, rng: np.random.Generator) -> int:
    """Every method with sound arguments, then with one of them spoilt."""
    centre, half, across = _boxes(system, rng)
    boxes, _ = core.certify_boxes(centre, half, across)
    made = Boxes(*boxes)
    positive = made._replace(radius=half[:, :1] + 0 * made.radius, weight=np.ones_like(made.weight))
    positive = positive._replace(kappa=np.full(3, 0.5))
    asked = {
        "values": (centre,), "bounds": (tuple(positive),), "newton": (centre, 5, 1e-10), "certify_points": (centre,),
        "certify_boxes": (centre, half, across), "glued": (tuple(positive), 0.5 * half, tuple(positive), 0.5 * half),
    }  # fmt: skip
    for name, arguments in asked.items():
        getattr(core, name)(*arguments)
        spoilt = [list(x) if isinstance(x, tuple) else x for x in arguments]
        place = int(rng.integers(len(spoilt)))
        if isinstance(spoilt[place], list):
            inner = int(rng.integers(len(spoilt[place])))
            spoilt[place][inner] = spoilt_array(spoilt[place][inner], rng)
        elif isinstance(spoilt[place], np.ndarray):
            spoilt[place] = spoilt_array(spoilt[place], rng)
        with contextlib.suppress(ValueError, TypeError):  # a wrong shape; None or a text where an array must be
            getattr(core, name)(*(tuple(x) if isinstance(x, list) else x for x in spoilt))
    return 2 * len(asked)


def _ask_for_contacts(rng: np.random.Generator) -> int:
    """The contacts of a random tree's leaves, then with its cells spoilt."""
    n = int(rng.integers(1, 4))
    tree = CellTree.whole(n)
    for _ in range(int(rng.integers(1, 12))):
        leaves = np.flatnonzero(tree.child < 0)
        tree.split(rng.choice(leaves, 1), rng.integers(n, size=1))
    cells, wrapped = np.flatnonzero(tree.child < 0), (rng.random(n) < 0.5).tolist()
    sound = [tree.lower, tree.size, tree.cut, tree.child, cells]
    contacts(*sound, wrapped)
    for _ in range(5):
        spoilt = [np.array(x) for x in sound]
        one = spoilt[int(rng.integers(5))]
        one.flat[int(rng.integers(one.size))] = rng.choice([-1, -5, 0, 1, 10**6, 2**40, -(2**62)])
        if rng.random() < 0.3:
            place = int(rng.integers(5))
            spoilt[place] = spoilt[place][:-1]
        with contextlib.suppress(ValueError):
            contacts(*spoilt, wrapped)
    return 6
