"""The descriptor form (17)–(19), and the reduced model of Theorem 1 (22)–(27) with its skew symmetry."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ccpin.arrays import Array
from ccpin.paper import printed
from ccpin.paper.item import ROUNDING, Item, apart
from ccpin.paper.modeling import COMPLEX, SLOPE, slope
from ccpin.paper.study import Sample, Study


def items(study: Study) -> Iterator[Item]:
    """The equations of motion in either form, at the samples of both assembly modes."""
    yield from _descriptor(study)
    yield from _reduced(study)


def _descriptor(study: Study) -> Iterator[Item]:
    model = study.model

    def residual(one: Sample) -> float:
        push, _ = _forces(study, one)
        a_free = study.to_paper(one.state.a_free(one.v, one.state.forward_dynamics(one.v, one.u)))
        force = printed.psi_jacobian(one.q_paper)[:2].T @ one.state.constraint_forces(one.v, one.u)
        return apart(printed.mass_matrix(one.q_paper) @ a_free, push + force)

    yield Item(
        "Eq. (17)",
        "D′q̈′ + C′q̇′ + g′ = B u + φ_q′ᵀ λ",
        "The full model, with the forces λ that hold the loops closed.",
        "`state.forward_dynamics` gives q̈ without λ, `state.constraint_forces` gives λ.",
        "both sides, all matrices as printed in (36)–(38), q̈ and λ from ccpin",
        study.largest(residual),
        "N m",
        1e-9,
        ROUNDING,
    )
    yield Item(
        "Eq. (18)",
        "φ_q′ q̇′ = 0",
        "The closures in velocities.",
        "`state.v_free(v)`; nothing is projected or stabilised.",
        "the printed φ_q′ times ccpin's q̇′, and zero",
        study.largest(
            lambda one: apart(
                printed.psi_jacobian(one.q_paper)[:2] @ study.to_paper(one.state.v_free(one.v)), np.zeros(2)
            )
        ),
        "m/s",
        1e-12,
        ROUNDING,
    )

    def solved(one: Sample) -> tuple[float, float]:
        q_acceleration, multipliers = _solve_descriptor(study, one)
        ours = study.to_paper(one.state.a_free(one.v, one.state.forward_dynamics(one.v, one.u)))
        return apart(ours, q_acceleration), apart(one.state.constraint_forces(one.v, one.u), multipliers)

    both = np.array([solved(one) for one in study.samples])
    yield Item(
        "Eq. (19)",
        "[D′ −φ_q′ᵀ; φ_q′ 0][q̈′; λ] = …, solved at once",
        "The descriptor form, n′ + (n′ − n) equations, as an independent way to q̈′ and λ.",
        "Not used: ccpin solves n equations. The printed system is solved here by a general solver.",
        "q̈′ of ccpin and of the descriptor form",
        float(both[:, 0].max()),
        "rad/s²",
        1e-8,
        ROUNDING,
        facts=(
            ("largest difference of λ", f"{both[:, 1].max():.1e} N"),
            ("n of ccpin, n′ + n′ − n here", f"{model.n}, 6"),
        ),
    )


def _forces(study: Study, one: Sample) -> tuple[Array, Array]:
    """B u − C′q̇′ − g′ and φ̇_q′ q̇′ in the paper's order, all printed but the velocities."""
    v_free = study.to_paper(one.state.v_free(one.v))
    push = np.array([*one.u, 0.0, 0.0]) - printed.coriolis_matrix(one.q_paper, v_free) @ v_free
    return push - printed.gravity(one.q_paper), _turning(one.q_paper, v_free)


def _turning(q: Array, v: Array) -> Array:
    """φ̇_q′ q̇′: −Σ ± a ω² (cos, sin), as all bars turn about one axis."""
    angles = np.array([q[0], q[1], q[0] + q[2], q[1] + q[3]])
    rates = np.array([v[0], v[1], v[0] + v[2], v[1] + v[3]])
    pull = -np.array([1.0, -1.0, 1.0, -1.0]) * printed.A * rates**2
    return np.array([pull @ np.cos(angles), pull @ np.sin(angles)])


def _solve_descriptor(study: Study, one: Sample) -> tuple[Array, Array]:
    """(q̈′, λ) of (19) with the printed matrices."""
    push, bias = _forces(study, one)
    jacobian = printed.psi_jacobian(one.q_paper)[:2]
    matrix = np.block([[printed.mass_matrix(one.q_paper), -jacobian.T], [jacobian, np.zeros((2, 2))]])
    solution = np.linalg.solve(matrix, np.concatenate([push, -bias]))
    return solution[:4], solution[4:]


def _reduced(study: Study) -> Iterator[Item]:
    def dynamics(one: Sample) -> float:
        wanted = one.state.forward_dynamics(one.v, one.u)
        return apart(wanted, _solve_descriptor(study, one)[0][:2])

    yield Item(
        "Eq. (22), Theorem 1",
        "D q̈ + C q̇ + g = u with q̇′ = ρ q̇ and q′ = σ(q)",
        "The reduced model: n equations in the independent coordinates. It holds only for q in Ω, and it is implicit, "
        "through σ.",
        "`model.forward_dynamics(q, v, u)`.",
        "q̈ of the reduced model and of the printed descriptor form (19)",
        study.largest(dynamics),
        "rad/s²",
        1e-8,
        ROUNDING,
    )
    terms: tuple[tuple[str, str, str, str, Callable[[Sample], Array]], ...] = (
        ("(23)", "D = ρᵀD′ρ", "state.D", "kg m²", lambda one: one.state.D),
        ("(24)", "C = ρᵀC′ρ + ρᵀD′ρ̇", "state.C(v)", "kg m²/s", lambda one: one.state.C(one.v)),
        ("(25)", "g = ρᵀg′", "state.g", "N m", lambda one: one.state.g),
    )
    for k, (number, title, call, unit, ours) in enumerate(terms):
        yield Item(
            f"Eq. {number}",
            title,
            "The terms of the reduced model are those of the free system, seen through ρ.",
            f"`{call}`, in the compiled core where it is there.",
            "ccpin's and the printed (33), (36)–(38) put together by hand",
            max(apart(ours(one), _printed_terms(one)[k]) for one in study.samples),
            unit,
            1e-9,
            ROUNDING,
        )
    motion = study.ideal
    yield Item(
        "Eq. (27)",
        "The reduced model goes with q̇′ = ρ(q′)q̇ and q′ = σ(q)",
        "Without them (22) does not determine the motion.",
        "Every state of a simulation is solved back onto the loops: nothing drifts, because nothing is integrated in "
        "q′.",
        "‖φ(q′)‖ at all samples of Fig. 9's motion, by the printed (31), and zero",
        float(np.abs(printed.phi(study.to_paper(motion.q_free).T)).max()),
        "m",
        1e-10,
        "what ccpin promises of every sample of every trajectory",
        facts=(("samples", str(len(motion.t))),),
    )
    yield Item(
        "Lemma III.1",
        "Ḋ − 2C is skew symmetric",
        "It carries over from D′˙ − 2C′, and with it the passivity on which the PD laws rest.",
        "`state.D`, `state.C(v)` with Christoffel's C′.",
        "Ḋ − 2C plus its transpose, Ḋ by differences, and zero",
        study.largest(lambda one: _symmetric_part(study, one)),
        "kg m²/s",
        1e-6,
        SLOPE,
    )


def _printed_terms(one: Sample) -> tuple[Array, Array, Array]:
    """(D, C, g) of (23)–(25), of printed matrices alone; ρ̇ from the bars' own rates."""
    rho, q = printed.rho(one.q_paper), one.q_paper
    mass = printed.mass_matrix(q)
    v_free = rho @ one.v
    turning = np.imag(printed.psi_jacobian(q + 1j * COMPLEX * v_free)) / COMPLEX  # ψ̇_q′, exact to rounding
    rho_dot = -np.linalg.solve(printed.psi_jacobian(q), turning @ rho)
    coriolis = printed.coriolis_matrix(q, v_free)
    return rho.T @ mass @ rho, rho.T @ coriolis @ rho + rho.T @ mass @ rho_dot, rho.T @ printed.gravity(q)


def _symmetric_part(study: Study, one: Sample) -> float:
    def inertia(q_paper: Array) -> Array:
        return study.model.at(q_paper[:2], study.to_free(q_paper)).D

    skew = slope(study, one, inertia) - 2.0 * one.state.C(one.v)
    return apart(skew, -skew.T)
