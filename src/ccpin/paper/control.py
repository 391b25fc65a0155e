"""Section III: the PD laws (28) and (30), the Lyapunov function, and Theorem 3 on the paper's own move."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ccpin.arrays import Array
from ccpin.control import PDFullGravity
from ccpin.paper import printed
from ccpin.paper.item import ROUNDING, Drawing, Item, apart, place
from ccpin.paper.study import GOAL, K_P, K_V, START, Sample, Study
from ccpin.plotting import plot_lyapunov, plot_sublevel
from ccpin.simulation import lyapunov_along


def items(study: Study) -> Iterator[Item]:
    """The laws and what is proved of them."""
    yield from _laws(study)
    yield _lyapunov(study)
    yield _decrease(study)
    yield _theorem_three(study)


def _reduced_gravity(q_paper: Array) -> Array:
    """g = ρᵀg′ (25), of the printed (33) and (38)."""
    return np.asarray(printed.rho(q_paper).T @ printed.gravity(q_paper))


def _laws(study: Study) -> Iterator[Item]:
    full = PDFullGravity(study.model, GOAL, K_P, K_V)
    fixed = _reduced_gravity(printed.sigma(GOAL))

    def simple(one: Sample) -> float:
        push = np.multiply(K_P, GOAL - one.q) - np.multiply(K_V, one.v) + fixed
        return apart(study.law.torque(0.0, one.state, one.v), push)

    def compensated(one: Sample) -> float:
        push = np.multiply(K_P, GOAL - one.q) - np.multiply(K_V, one.v) + _reduced_gravity(one.q_paper)
        return apart(full.torque(0.0, one.state, one.v), push)

    yield Item(
        "Eq. (28)",
        "PD with simple gravity compensation",
        "u = K_p q̃ − K_v q̇ + g(q_d), with g(q_d) computed once, off line: the law needs no σ on line.",
        "`ccpin.control.PDSimpleGravity(model, q_d, K_p, K_v)`.",
        "u at the samples, g(q_d) from the printed (33), (38)–(40)",
        study.largest(simple),
        "N m",
        1e-10,
        ROUNDING,
        facts=(("g(q_d)", ", ".join(f"{value:.4f}" for value in fixed) + " N m"),),
    )
    yield Item(
        "Eq. (30)",
        "PD with full gravity compensation",
        "u = K_p q̃ − K_v q̇ + g(q): g at the present q, through σ.",
        "`ccpin.control.PDFullGravity(model, q_d, K_p, K_v)`.",
        "u at the samples, g(q) from the printed (33), (38)–(40)",
        study.largest(compensated),
        "N m",
        1e-10,
        ROUNDING,
    )


def _lyapunov(study: Study) -> Item:
    goal = printed.sigma(GOAL)
    fixed = _reduced_gravity(goal)

    def difference(one: Sample) -> float:
        error, rho = GOAL - one.q, printed.rho(one.q_paper)
        v_free = rho @ one.v
        value = 0.5 * v_free @ printed.mass_matrix(one.q_paper) @ v_free + 0.5 * error @ np.multiply(K_P, error)
        value += printed.potential(one.q_paper) - printed.potential(goal) + error @ fixed
        return abs(study.law.lyapunov(one.q, one.v, one.state.q_free) - float(value))

    return Item(
        "𝒱",
        "The Lyapunov function",
        "𝒱 = ½ q̇ᵀDq̇ + V(q) − V(q_d) + q̃ᵀg(q_d) + ½ q̃ᵀK_p q̃, with ∂V/∂q = g.",
        "`law.lyapunov(q, v)`.",
        "𝒱 at the samples and put together from the printed (36), (38)–(40)",
        study.largest(difference),
        "J",
        1e-10,
        ROUNDING,
    )


def _decrease(study: Study) -> Item:
    motion = study.ideal
    history = lyapunov_along(study.law, motion)
    figure = plot_lyapunov(motion.t, history, None, "The Lyapunov function along Experiment 1")
    return Item(
        "d𝒱/dt",
        "d𝒱/dt = −q̇ᵀK_v q̇ along solutions",
        "The Lyapunov function falls as the velocity gains dissipate.",
        "`ccpin.simulation.lyapunov_along(law, motion)` along Fig. 9's ideal motion, d𝒱/dt from the power of the "
        "efforts.",
        "d𝒱/dt and −q̇ᵀK_v q̇, relative to the largest",
        apart(history.V_dot, history.dissipation) / float(np.abs(history.dissipation).max()),
        "",
        1e-9,
        ROUNDING,
        facts=(("largest rise of 𝒱 between samples", f"{max(0.0, float(np.diff(history.V).max())):.1e} J"),),
        drawings=(Drawing("lyapunov", "𝒱 and its rate along Experiment 1; the two rates lie on one another.", figure),),
    )


def _theorem_three(study: Study) -> Item:
    """Theorem 3 on the paper's own goal and start."""
    found = study.theorem3
    certificate, move = found.certificate, found.move
    closed = "python-flint is not installed: pip install 'ccpin[validated]'"
    if move is not None:
        closed = (
            f"{move.verdict}: at {move.time:.3f} s the enclosure of the exact motion "
            f"lies in B₂, 𝒱 < {move.lyapunov:.3f} J"
        )
    return Item(
        "Theorem 3",
        "Local asymptotic stability of the set point",
        "If ‖∂g/∂q‖ ≤ β on B_2 = {𝒱 ≤ c}, the largest such set within Ω, and every k_pi > β, the set point is "
        "asymptotically stable for starts in B_2. Experiment 1 starts at (−150°, −160°).",
        "`ccpin.control.certify_set_point` proves c and β over certified cells. The paper's own start is outside of "
        f"B_2: 𝒱 there is {found.start / certificate.level:.1f} times c. What closes the gap is "
        f"`ccpin.validated.certify_move`, an enclosure of the exact "
        "motion that leads from the start into B_2.",
        "by how much β exceeds k_p on B₂ (nothing where the gain condition is proved)",
        max(0.0, certificate.beta - certificate.gain) if certificate.verdict == "proven" else float("inf"),
        "N m/rad",
        0.0,
        "a proof has no tolerance",
        facts=(
            ("verdict about the goal", certificate.verdict),
            ("c, the gain condition included", f"{certificate.level:.4f} J"),
            ("c by the domain alone, at least", f"{certificate.level_domain:.4f} J"),
            ("β on B₂", f"{certificate.beta:.6f} N m/rad < k_p = {certificate.gain:g}"),
            ("sup ‖∂g/∂q‖ over 𝒟, sampled", f"{found.slope:.3f} N m/rad"),
            ("𝒱 at the paper's start", f"{found.start:.3f} J: outside of B₂"),
            ("furthest start towards it in B₂", place(np.degrees(found.near), 2)),
            ("the paper's start by validated integration", closed),
        ),
        drawings=(
            Drawing(
                "theorem3",
                "The potential well about q_d, the certified cells and B₂; the paper's start lies outside.",
                plot_sublevel(certificate, [START, found.near], title="What Theorem 3 covers"),
            ),
        ),
    )
