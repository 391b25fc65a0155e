"""Rigorous bounds of the reduced model over sets of configurations that need not be closed: D, C, and ∂τ/∂y.

The reduced model (22) as a law computes it at any q′ = (q, y), closed or not, y the dependent coordinates:

    τ(q, y; v, w, a) = ρᵀ f′(q′; V, W, A),        V = ρv, W = ρw, A = ρa + S,
    ρ = [I; −φ_y⁻¹φ_q] (14),        S = [0; −φ_y⁻¹φ_q′q′(V, W)]        (ρ̇(v) w of (35)),

f′ the free system's force with the Christoffel symbols' C′, so that τ = D a + C(v) w + damping w + g. Its derivatives
by y_l follow by the chain rule, all of them through ρ_l = −[0; φ_y⁻¹φ_q′q′(e_l, ρ)] and S_l, without derivatives of
an inverse.

The free system is tips x_c of chains with weights w_c (`masses`): with x_ij = ∂²x/∂θ_i∂θ_j and so on,

    f′_i = Σ_c w_c x_i·(ẍ − γ) + armature A_i + damping W_i + stiffness (θ_i − θ₀_i),        ẍ = x_jk V_j W_k + x_j A_j,

exactly, whatever the joints: x_i·x_jk are the Christoffel symbols. For joints i ≤ j of a chain with axes a and
x_j = b_j: x_ij = a_i × b_j (`ccpin.proof.chains`). Everything is evaluated in affine forms (`ccpin.proof.balls`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, skew
from ccpin.control.stability.tracking.masses import Masses
from ccpin.proof.balls import Affine, FormInverse, affine, cross, inverse, product, sine_versine, stacked, summed
from ccpin.proof.chains import ChainStack, ClosureSystem
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF


class Tips(NamedTuple):
    """Derivatives of the tips over B sets of θ.

    Attributes:
        stack: The chains.
        turning: a_i, zero of slides, of shape (B, C, k, 3).
        first: x_i, of shape (B, C, k, 3).
        second: x_ij, of shape (B, C, k, k, 3).
    """

    stack: ChainStack
    turning: Affine
    first: Affine
    second: Affine

    def third_along(self, v: Affine, w: Affine) -> Affine:
        """x_lij v_i w_j for v and w (B, C, k), of shape (B, C, k, 3).

        The derivative by θ_l of Σ_j (Σ_{i≤j} v_i a_i) × w_j x_j + (Σ_{i<j} w_i a_i) × v_j x_j, in which
        ∂a_i/∂θ_l = a_l × a_i for l < i and ∂x_j/∂θ_l = x_lj.
        """
        k = self.stack.joints.shape[1]
        deeper, before = np.triu(np.ones((k, k)), 1), np.triu(np.ones((k, k)), 0)
        swung = product("li,bclix->bclix", deeper, cross(self.turning[:, :, :, None], self.turning[:, :, None]))
        total = None
        for upper, lower, sums in ((v, w, before), (w, v, deeper)):
            rate = product("ij,bcix->bcjx", sums, product("bci,bcix->bcix", upper, self.turning))
            rate_l = product("ij,bclix->bcljx", sums, product("bci,bclix->bclix", upper, swung))
            arm, arm_l = product("bcj,bcjx->bcjx", lower, self.first), product("bcj,bcljx->bcljx", lower, self.second)
            part = summed(cross(rate_l, arm[:, :, None]) + cross(rate[:, :, None], arm_l), 3)
            total = part if total is None else total + part
        assert total is not None
        return total


def tips_of(stack: ChainStack, theta: Affine) -> Tips:
    """Sweep all chains over sets of θ; arms are added up from the tip, so that what an origin shares cancels."""
    angles = gathered(stack, theta)
    sine, versine = sine_versine(angles * stack.turning)
    slides, crosses = angles * stack.sliding, skew(stack.axes)
    count, chains, k = angles.mid.shape
    turn = affine(np.broadcast_to(np.eye(3), (count, chains, 3, 3)))
    axes, hops = list[Affine](), list[Affine]()
    for j in range(k):
        hops.append(product("bcxy,cy->bcx", turn, stack.translations[:, j]))
        turn = product("bcxy,cyz->bcxz", turn, stack.rotations[:, j])
        axes.append(product("bcxy,cy->bcx", turn, stack.axes[:, j]))
        turned = product("bcxy,cyz->bcxz", turn, crosses[:, j])
        twice = product("bcxy,cyz->bcxz", turned, crosses[:, j])
        turn = (
            turn + product("bc,bcxy->bcxy", sine[:, :, j], turned) + product("bc,bcxy->bcxy", versine[:, :, j], twice)
        )
    arm = product("bcxy,cy->bcx", turn, stack.tips)
    first = list[Affine]()
    for j in reversed(range(k)):
        arm = arm + product("c,bcx->bcx", stack.points, product("bc,bcx->bcx", slides[:, :, j], axes[j]))
        ahead = product("c,bcx->bcx", stack.turning[:, j], cross(axes[j], arm))
        first.insert(0, ahead + product("c,bcx->bcx", stack.sliding[:, j] * stack.points, axes[j]))
        arm = arm + product("c,bcx->bcx", stack.points, hops[j])
    arms, turning = stacked(first, 2), product("ck,bckx->bckx", stack.turning, stacked(axes, 2))
    upper, lower = np.sort(np.indices((k, k)), axis=0)
    return Tips(stack, turning, arms, cross(turning[:, :, upper], arms[:, :, lower]))


def gathered(stack: ChainStack, values: Affine) -> Affine:
    """Values (B, …, n′) by chain and joint, of shape (B, …, C, k), zero where padded."""
    pad = (*(values.mid.ndim - 1) * ((0, 0),), (0, 1))
    lin = np.pad(values.lin, ((0, 0), *pad))
    return Affine(np.pad(values.mid, pad), lin, np.pad(values.rad, pad), values.boxed)[..., stack.joints]


class Motion(NamedTuple):
    """What a law is asked for at B sets of states, as affine forms.

    Attributes:
        v: The velocity that C is taken at, of shape (B, n).
        w: What C and the dampers multiply, of shape (B, n): v itself for computed torque, q̇_d for PD+.
        a: What D multiplies, of shape (B, n).
    """

    v: Affine
    w: Affine
    a: Affine


class Reduced:
    """The reduced model over B sets of configurations θ, closed or not.

    Where φ_y is not proved regular on a set, all that follows is NaN there.

    Args:
        system: The closures.
        masses: The masses.
        theta: The sets, of shape (B, n′).

    Attributes:
        grip: φ_y, to solve systems with.
        rho: ρ, of shape (B, n′, n).
    """

    def __init__(self, system: ClosureSystem, masses: Masses, theta: Affine) -> None:
        self.system, self.masses, self.theta = system, masses, theta
        self.loops = [tips_of(stack, theta) for stack in masses.loops]
        self.bodies = [tips_of(bodies.stack, theta) for bodies in masses.bodies]
        slope = affine(np.tile(self.system.couplings, (len(theta.mid), 1, 1)))
        self.bend = affine(np.zeros((len(theta.mid), self.system.m, self.system.n_free, self.system.n_free)))
        for tips in self.loops:
            weights = tips.stack.weights
            slope = slope + placed(tips.stack, product("cmx,bcix->bcmi", weights, tips.first), 1)
            self.bend = self.bend + placed(tips.stack, product("cmx,bcijx->bcmij", weights, tips.second), 2)
        self.grip: FormInverse = inverse(slope[:, :, self.system.dependent])
        self.rho = self.whole(-self.grip.solve(slope[:, :, self.system.independent]), np.eye(self.system.n))

    @cached_property
    def free_inertia(self) -> Affine:
        """D′, of shape (B, n′, n′)."""
        return self.pairs([tips.first for tips in self.bodies]) + np.diag(self.masses.free.armature)

    @cached_property
    def inertia(self) -> Affine:
        """D = ρᵀD′ρ (23), of shape (B, n, n)."""
        return product("bpn,bpk->bnk", self.rho, product("bpq,bqk->bpk", self.free_inertia, self.rho))

    @cached_property
    def damping(self) -> Affine:
        """ρᵀ diag(b) ρ, of shape (B, n, n)."""
        return product("bpn,bpk->bnk", self.rho, product("p,bpk->bpk", self.masses.free.damping, self.rho))

    def coriolis(self, v: Affine) -> Affine:
        """C = ρᵀC′ρ + ρᵀD′ρ̇ (24) at velocities v (B, n), of shape (B, n, n)."""
        rates = product("bpn,bn->bp", self.rho, v)
        turned = [product("bcijx,bcj->bcix", tips.second, gathered(tips.stack, rates)) for tips in self.bodies]
        free = product("bpq,bqn->bpn", self.pairs(turned), self.rho)
        free = free + product("bpq,bqn->bpn", self.free_inertia, self.rho_dot(rates))
        return product("bpn,bpk->bnk", self.rho, free)

    def rho_dot(self, rates: Affine) -> Affine:
        """ρ̇ (35) along q̇′ = `rates` (B, n′), of shape (B, n′, n)."""
        bent = product("bmpj,bjn->bmpn", self.bend, self.rho)
        return self.whole(-self.grip.solve(product("bmpn,bp->bmn", bent, rates)), np.zeros((1, self.system.n)))

    def force_slope(self, motion: Motion) -> Affine:
        """∂τ/∂y of τ(q, y; v, w, a), of shape (B, n, m)."""
        dependent = self.system.dependent
        turns, moved, sped = (product("bpn,bn->bp", self.rho, x) for x in motion)
        rho_y = self._rho_slope()
        turns_y, moved_y, sped_y = (product("bpln,bn->bpl", rho_y, x) for x in motion)
        bent = product("bmpq,bq->bmp", self.bend, moved)
        along = product("bmpq,bp->bmq", self.bend, turns)
        second = self.whole(-self.grip.solve(product("bmp,bp->bm", bent, turns)[:, :, None]), np.zeros((1, 1)))
        sped = sped + second[:, :, 0]
        right = product("bmpq,bp->bmq", self.bend, second[:, :, 0])[:, :, dependent] + self._third(turns, moved)
        right = right + product("bmp,bpl->bml", bent, turns_y) + product("bmq,bql->bml", along, moved_y)
        sped_y = sped_y + self.whole(-self.grip.solve(right), np.zeros((1, len(dependent))))
        free = _FreeForce(self, turns, moved, sped)
        inner = free.by_theta[:, :, dependent] + product("bpq,bql->bpl", free.by_turns, turns_y)
        inner = inner + product("bpq,bql->bpl", free.by_moved, moved_y)
        inner = inner + product("bpq,bql->bpl", self.free_inertia, sped_y)
        return product("bpln,bp->bnl", rho_y, free.value) + product("bpn,bpl->bnl", self.rho, inner)

    def _rho_slope(self) -> Affine:
        """∂ρ/∂y_l, of shape (B, n′, m, n)."""
        system = self.system
        bent = product("bmlq,bqn->bmln", self.bend[:, :, system.dependent], self.rho)
        solved = self.grip.solve(bent.reshape(len(bent.mid), system.m, system.m * system.n))
        whole = self.whole(-solved, np.zeros((1, system.m * system.n)))
        return whole.reshape(len(bent.mid), system.n_free, system.m, system.n)

    def _third(self, turns: Affine, moved: Affine) -> Affine:
        """∂/∂y_l of φ_q′q′(V, W) at constant V and W, of shape (B, m, m)."""
        total = affine(np.zeros((len(self.theta.mid), self.system.m, self.system.n_free)))
        for tips in self.loops:
            along = tips.third_along(gathered(tips.stack, turns), gathered(tips.stack, moved))
            total = total + placed(tips.stack, product("cmx,bclx->bcml", tips.stack.weights, along), 1)
        return total[:, :, self.system.dependent]

    def pairs(self, others: Sequence[Affine]) -> Affine:
        """Σ_c w_c x_i·y_cj in θ, for y (B, C, k, 3) of each group of bodies, of shape (B, n′, n′)."""
        total = affine(np.zeros((len(self.theta.mid), self.system.n_free, self.system.n_free)))
        for bodies, tips, other in zip(self.masses.bodies, self.bodies, others, strict=True):
            weighed = product("c,bcix->bcix", bodies.weights, tips.first)
            total = total + placed(bodies.stack, product("bcix,bcjx->bcij", weighed, other), 2)
        return total

    def whole(self, dependent: Affine, independent: Array) -> Affine:
        """Rows of the dependent and of the independent coordinates in their places, of shape (B, n′, ·)."""
        shape = (len(dependent.mid), self.system.n_free, dependent.mid.shape[2])
        mid, rad, lin = np.zeros(shape), np.zeros(shape), np.zeros((len(dependent.lin), *shape))
        mid[:, self.system.dependent], rad[:, self.system.dependent] = dependent.mid, dependent.rad
        lin[:, :, self.system.dependent] = dependent.lin
        mid[:, self.system.independent] = independent
        return Affine(mid, lin, rad, dependent.boxed)


class _FreeForce:
    """f′(θ; V, W, A) and its derivatives by θ, V and W, of shapes (B, n′) and (B, n′, n′)."""

    def __init__(self, at: Reduced, turns: Affine, moved: Affine, sped: Affine) -> None:
        free, count, n_free = at.masses.free, len(turns.mid), at.system.n_free
        value, turned = affine(np.zeros((count, n_free))), affine(np.zeros((count, n_free, n_free)))
        by_w, by_v, rising = list[Affine](), list[Affine](), list[Affine]()
        for bodies, tips in zip(at.masses.bodies, at.bodies, strict=True):
            v, w, a = (gathered(bodies.stack, rates) for rates in (turns, moved, sped))
            by_w.append(product("bcijx,bcj->bcix", tips.second, w))
            by_v.append(product("bcijx,bcj->bcix", tips.second, v))
            speeding = product("bcix,bci->bcx", by_w[-1], v) + product("bcix,bci->bcx", tips.first, a) - bodies.fall
            pull = product("c,bcx->bcx", bodies.weights, speeding)
            value = value + placed(bodies.stack, product("bcix,bcx->bci", tips.first, pull), 1)
            turned = turned + placed(bodies.stack, product("bcilx,bcx->bcil", tips.second, pull), 2)
            rising.append(tips.third_along(v, w) + product("bcljx,bcj->bclx", tips.second, a))
        value = value + product("p,bp->bp", free.armature, sped) + product("p,bp->bp", free.damping, moved)
        self.value = value + product("p,bp->bp", free.stiffness, at.theta - free.rest)
        self.by_theta = turned + at.pairs(rising) + np.diag(free.stiffness)
        self.by_turns = at.pairs(by_w)
        self.by_moved = at.pairs(by_v) + np.diag(free.damping)


def placed(stack: ChainStack, local: Affine, rank: int) -> Affine:
    """The sum over chains of arrays (B, C, …, k [, k]) over their joints, as one over θ, of shape (B, …, n′ [, n′])."""
    size, count = stack.placement.shape[1] + 1, local.mid.shape[1]
    shape = (len(local.mid), *local.mid.shape[2 : local.mid.ndim - rank], *rank * (size,))
    mid, rad, sizes, lin = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros((len(local.lin), *shape))
    swing = np.abs(local.mid) + np.abs(local.lin).sum(axis=0)
    for c in range(count):
        joints = stack.joints[c]
        place = (..., joints) if rank == 1 else (..., joints[:, None], joints)
        mid[place] += local.mid[:, c]
        lin[place] += local.lin[:, :, c]
        rad[place] += local.rad[:, c]
        sizes[place] += swing[:, c]
    rad = (rad + 4.0 * (count + 1) * UNIT_ROUNDOFF * sizes) * SLACK
    total = Affine(mid, lin, rad, local.boxed)
    return total[..., :-1] if rank == 1 else total[..., :-1, :-1]
