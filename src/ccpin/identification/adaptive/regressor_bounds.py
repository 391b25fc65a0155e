"""Rigorous bounds of Slotine and Li's Y_r and of its rate over sets of closed states, a column a constant.

A body's frame has an origin x_0 and axes x_1, x_2, x_3, four tips of one chain; with its pseudo-inertia J (4, 4), which
is linear in its ten constants, and X_α = ∂x_α/∂q̇ = x_α,i ρ_i (n columns), its share of the reduced model is, exactly,

    D = Σ_αβ J_αβ X_αᵀX_β,    Y_r π = Σ_αβ J_αβ X_αᵀ(ẍ_β − γ δ_β0),    ẍ = x_ij V_i W_j + x_j A_j,
    V = ρ v,  W = ρ w,  A = ρ a + ρ̇ w,        (v, w, a) = (q̇, v_r, a_r),

C(q̇) v_r that of (24). A joint's rotor, damper, spring and constant effort bring ρ_p A_p, ρ_p W_p, ρ_p θ_p and −ρ_p.
Along a motion q̇ = v with v̇, ẇ and ȧ

    ẍ˙ = x_lij V_l V_i W_j + x_ij (V̇_i W_j + V_i Ẇ_j) + x_ij V_i A_j + x_j Ȧ_j,    Ẋ = x_ij V_i ρ_j + x_j ρ̇_j,
    V̇ = ρ̇ v + ρ v̇,  Ẇ = ρ̇ w + ρ ẇ,  Ȧ = ρ̇ a + ρ ȧ + Ṡ,    S = ρ̇ w,
    φ_y S_y + φ″(V, W) = 0  ⇒  φ_y Ṡ_y + φ″(V, S) + φ‴(V, V, W) + φ″(V̇, W) + φ″(V, Ẇ) = 0.

Everything is evaluated in affine forms (`ccpin.proof.balls`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.masses import Masses
from ccpin.control.stability.tracking.motion_bounds import Motion, Reduced, gathered, tips_of
from ccpin.proof.balls import Affine, affine, product, stacked
from ccpin.proof.chains import Chain, ChainStack, ClosureSystem, stack_chains

TIPS = 4
"""Of a body: its frame's origin, and its axes."""
TEN = 10
"""Constants of a body."""
OF_A_JOINT = 4
"""Constants of a joint: rotor, damper, spring, constant effort."""


def pseudo_inertia() -> Array:
    """J as Σ_k of it times the k-th of (m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz), of shape (4, 4, 10); J_00 = m."""
    share = np.zeros((TIPS, TIPS, TEN))
    share[0, 0, 0] = 1.0
    for axis, (own, others) in enumerate(((4, (6, 9)), (6, (4, 9)), (9, (4, 6)))):
        share[0, 1 + axis, 1 + axis] = share[1 + axis, 0, 1 + axis] = 1.0
        share[1 + axis, 1 + axis, [own, *others]] = -0.5, 0.5, 0.5
    for k, i, j in ((5, 1, 2), (7, 1, 3), (8, 2, 3)):
        share[i, j, k] = share[j, i, k] = -1.0
    return share


class BodyFrames(NamedTuple):
    """Bodies on chains of one length: which they are, (b,), and the chains of their tips, four each."""

    bodies: Array
    stack: ChainStack


def frames_of(system: ClosureSystem, chains: Sequence[Chain]) -> tuple[BodyFrames, ...]:
    """Bodies whose tips are given one after the other, by their chains' lengths."""
    groups: dict[int, list[int]] = {}
    for body, chain in enumerate(chains[::TIPS]):
        groups.setdefault(len(chain.joints), []).append(body)
    return tuple(
        BodyFrames(
            np.array(bodies),
            stack_chains(tuple(chains[TIPS * b + k] for b in bodies for k in range(TIPS)), system.n_free, 1),
        )
        for bodies in groups.values()
    )


class Shares(NamedTuple):
    """What q columns are made of: of bodies J, with its rounding, (B, 4, 4, q), of joints (4, n′, q)."""

    bodies: Affine
    joints: Array

    @classmethod
    def of(cls, constants: Array, n_free: int) -> Shares:
        """Those of columns of constants (p, q): ten a body, then rotors, dampers, springs and efforts of all joints."""
        split = len(constants) - OF_A_JOINT * n_free
        bodies = product("ijk,bkq->bijq", pseudo_inertia(), constants[:split].reshape(-1, TEN, constants.shape[1]))
        return cls(bodies, constants[split:].reshape(OF_A_JOINT, n_free, -1))


class RegressorBounds:
    """Columns of Y_r over B sets of closed states with one q̇ each.

    Args:
        system: The closures.
        masses: Their chains side by side (its bodies are not asked for).
        frames: The bodies.
        gravity: γ, of shape (3,).
        theta: The configurations, of shape (B, n′).
        v: q̇, of shape (B, n).
    """

    def __init__(
        self,
        system: ClosureSystem,
        masses: Masses,
        frames: Sequence[BodyFrames],
        gravity: Array,
        theta: Affine,
        v: Affine,
    ) -> None:
        self.frames, self.gravity, self.v = frames, gravity, v
        self.at = Reduced(system, masses, theta)
        self.turns = self._along(v)
        self.rho_dot = self.at.rho_dot(self.turns)
        self.tips = [tips_of(each.stack, theta) for each in frames]
        self.moves = [
            product("bcix,bnci->bcnx", tips.first, gathered(tips.stack, self.at.rho.transposed())) for tips in self.tips
        ]
        self.by_turns = [
            product("bcijx,bcj->bcix", tips.second, gathered(tips.stack, self.turns)) for tips in self.tips
        ]

    def inertia(self, shares: Shares) -> Affine:
        """D of each column of constants, of shape (B, q, n, n)."""
        count, n = self.v.mid.shape
        rho = self.at.rho
        total = product("bpnm,pq->bqnm", product("bpn,bpm->bpnm", rho, rho), shares.joints[0])
        for each, moves in zip(self.frames, self.moves, strict=True):
            own = moves.reshape(count, len(each.bodies), TIPS, n, 3)
            pairs = product("bcinx,bcjmx->bcijnm", own, own)
            total = total + product("bcijnm,cijq->bqnm", pairs, shares.bodies[each.bodies])
        return total

    def columns(self, motion: Motion, shares: Shares, *, still: bool = True) -> Affine:
        """Y_r times each column of constants, of shape (B, q, n).

        Args:
            motion: v, w and a; v the set's own.
            shares: The columns.
            still: Whether what acts at rest, too, counts: gravity, springs, constant efforts.
        """
        pulled, moved, sped = self._pulled(motion, still=still)
        rest = self._at_rest() if still else []
        total = self._on_joints(self.at.rho, [sped, moved, *rest], shares)
        for each, moves, pull in zip(self.frames, self.moves, pulled, strict=True):
            total = total + self._on_bodies(each, moves, pull, shares)
        return total

    def rates(self, motion: Motion, rate: Motion, shares: Shares) -> Affine:
        """The rate of `columns` along a motion whose v, w and a have these rates, of shape (B, q, n)."""
        (v, w, a), (v_rate, w_rate, a_rate) = motion, rate
        pulled, moved, sped = self._pulled(motion, still=True)
        turns_rate = self._bent(v) + self._along(v_rate)
        moved_rate = self._bent(w) + self._along(w_rate)
        sped_rate = self._bent(a) + self._along(a_rate) + self._second(moved, turns_rate, moved_rate, self._bent(w))
        total = self._on_joints(self.rho_dot, [sped, moved, *self._at_rest()], shares)
        total = total + self._on_joints(self.at.rho, [sped_rate, moved_rate, self.turns], shares)
        turning = self.rho_dot.transposed()
        for each, tips, moves, by_v, pull in zip(
            self.frames, self.tips, self.moves, self.by_turns, pulled, strict=True
        ):
            V, W, A, V_rate, W_rate, A_rate = (
                gathered(tips.stack, x) for x in (self.turns, moved, sped, turns_rate, moved_rate, sped_rate)
            )
            rho = gathered(tips.stack, self.at.rho.transposed())
            moves_rate = product("bcix,bnci->bcnx", by_v, rho)
            moves_rate = moves_rate + product("bcix,bnci->bcnx", tips.first, gathered(tips.stack, turning))
            by_w = product("bcijx,bcj->bcix", tips.second, W)
            jerk = product("bclx,bcl->bcx", tips.third_along(V, W), V) + product("bcix,bci->bcx", by_w, V_rate)
            jerk = jerk + product("bcix,bci->bcx", by_v, W_rate + A) + product("bcix,bci->bcx", tips.first, A_rate)
            total = total + self._on_bodies(each, moves_rate, pull, shares)
            total = total + self._on_bodies(each, moves, jerk, shares)
        return total

    def _along(self, x: Affine) -> Affine:
        """ρ x."""
        return product("bpn,bn->bp", self.at.rho, x)

    def _bent(self, x: Affine) -> Affine:
        """ρ̇ x."""
        return product("bpn,bn->bp", self.rho_dot, x)

    def _pulled(self, motion: Motion, *, still: bool) -> tuple[list[Affine], Affine, Affine]:
        """ẍ − γ of each group's tips, (B, C, 3), W and A."""
        moved, sped = self._along(motion.w), self._along(motion.a) + self._bent(motion.w)
        found = list[Affine]()
        for tips, by_v in zip(self.tips, self.by_turns, strict=True):
            W, A = (gathered(tips.stack, x) for x in (moved, sped))
            pull = product("bcix,bci->bcx", by_v, W) + product("bcix,bci->bcx", tips.first, A)
            fall = np.zeros((pull.mid.shape[1], 3))
            fall[::TIPS] = self.gravity * still
            found.append(pull - fall)
        return found, moved, sped

    def _second(self, moved: Affine, turns_rate: Affine, moved_rate: Affine, bent: Affine) -> Affine:
        """The rate of S = ρ̇ w, of shape (B, n′): bent is S itself."""
        at = self.at
        right = product("bmp,bp->bm", product("bmpq,bq->bmp", at.bend, moved), turns_rate)
        right = right + product("bmp,bp->bm", product("bmpq,bq->bmp", at.bend, self.turns), moved_rate + bent)
        for tips in at.loops:
            V, W = gathered(tips.stack, self.turns), gathered(tips.stack, moved)
            third = product("bclx,bcl->bcx", tips.third_along(V, W), V)
            right = right + product("cmx,bcx->bm", tips.stack.weights, third)
        return at.whole(-at.grip.solve(right[:, :, None]), np.zeros((1, 1)))[:, :, 0]

    def _at_rest(self) -> list[Affine]:
        """What springs are turned by, and constant efforts."""
        theta = self.at.theta
        return [theta, affine(-np.ones(theta.mid.shape))]

    def _on_joints(self, rho: Affine, along: Sequence[Affine], shares: Shares) -> Affine:
        """Σ_p ρ_p x_p of the joints' constants, of shape (B, q, n)."""
        brought = stacked(along, 1)
        efforts = product("bkp,kpq->bpq", brought, shares.joints[: len(along)])
        return product("bpn,bpq->bqn", rho, efforts)

    def _on_bodies(self, each: BodyFrames, moves: Affine, pull: Affine, shares: Shares) -> Affine:
        """Σ_αβ J_αβ X_αᵀ y_β of bodies, of shape (B, q, n)."""
        count, bodies, n = len(moves.mid), len(each.bodies), moves.mid.shape[2]
        X, y = moves.reshape(count, bodies, TIPS, n, 3), pull.reshape(count, bodies, TIPS, 3)
        pairs = product("bcinx,bcjx->bcijn", X, y)
        return product("bcijn,cijq->bqn", pairs, shares.bodies[each.bodies])
