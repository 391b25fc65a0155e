"""Cells over which everything is known: σ is flat, and U = ½ qᵀHq exactly, with ‖∂g/∂q‖ and what is proved by rules."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

import ccpin
from ccpin.control.stability.set_point import certified_cells
from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.control.stability.set_point.well import Well
from ccpin.proof.newton import Boxes

STRETCH = np.array([1.0, 3.0, 2.0])  # of σ along each coordinate


def boxes_about(centre, half):
    """Boxes of Theorem K with one dependent coordinate, which rises by `STRETCH` along each independent one."""
    centre, half = np.atleast_2d(centre).astype(float), np.atleast_2d(half).astype(float)
    count, n = centre.shape
    theta = np.column_stack([centre, centre @ STRETCH[:n]])
    directions = np.tile(np.vstack([np.eye(n), STRETCH[:n]]), (count, 1, 1))
    one = np.ones((count, 1))
    return Boxes(theta, half, directions, one[:, None], one[:, None], one, one, np.full(count, 0.5))


class Flat:
    """What a store of flat cells is told, and what it asked.

    Args:
        hessian: H.
        beta: ‖∂g/∂q‖ of boxes of a centre and half-widths.
        proved: Which boxes are proved.
        same: Whether the boxes of two centres carry the same σ.
        remainder: Of boxes of half-widths.
        effort: As for beta.
    """

    def __init__(self, monkeypatch, hessian, beta=None, proved=None, same=None, remainder=None, effort=None):
        self.hessian = np.array(hessian, float)
        self.beta = beta or (lambda centre, half: 1.0)
        self.proved = proved or (lambda centre, half: True)
        self.same = same or (lambda first, second: True)
        self.effort = effort or (lambda centre, half: np.inf)
        self.remainder = remainder or (lambda half: 0.0)
        self.asked, self.glued = [], []
        for name in ("wells", "prove", "predict", "glued", "check"):
            monkeypatch.setattr(certified_cells, name, getattr(self, f"_{name}"))
        for name in ("gravity_bounds", "closures_of"):
            monkeypatch.setattr(certified_cells, name, lambda *_: None)

    def store(self, lattice=None):
        n = len(self.hessian)
        system = SimpleNamespace(independent=np.arange(n))
        return CellStore(SimpleNamespace(problem=SimpleNamespace(system=system)), None, None, lattice)

    def laid(self, half):
        """A store of a lattice around 0 with its first cell."""
        half = np.array(half, float)
        store = self.store((-half, 2.0 * half))
        store.add_first(boxes_about(np.zeros(len(half)), half), -half, half)
        return store

    def potential(self, q):
        return 0.5 * np.einsum("...i,ij,...j->...", q, self.hessian, q)

    def _wells(self, law, centres, half, slopes, bounds):
        found = []
        for c, h in zip(centres, half, strict=True):
            value, slope, lost = float(self.potential(c)), self.hessian @ c, self.remainder(h)
            found.append(Well(c, value, slope, self.hessian, lost, self.beta(c, h), self.effort(c, h)))
        return found

    def _prove(self, problem, cells):
        self.asked.append(cells)
        proved = np.array([self.proved(c, h) for c, h in zip(cells.centre, cells.half, strict=True)])
        return SimpleNamespace(boxes=boxes_about(cells.centre, cells.half), proved=proved)

    def _predict(self, problem, boxes, delta):
        return boxes.centre + (boxes.directions @ delta[:, :, None])[:, :, 0] + 0.125

    def _glued(self, problem, first, delta, second, other):
        self.glued.append((first, delta, second, other))
        n = len(self.hessian)
        return np.array([self.same(a[:n], b[:n]) for a, b in zip(first.centre, second.centre, strict=True)])

    def _check(self, equations, boxes):
        return SimpleNamespace(proved=np.zeros(len(boxes.kappa), dtype=bool))


def heavy_based():
    """The RPDR on a base that has mass."""
    described = ccpin.load("rpdr").description
    mass = next(link.inertia for link in described.links if link.inertia is not None and link.name != described.root)
    links = [replace(link, inertia=mass) if link.name == described.root else link for link in described.links]
    return ccpin.load(replace(described, links=tuple(links)))
