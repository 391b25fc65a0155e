"""The free system (2), its constraints and their parametrisation (3)–(14), (35)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ccpin.arrays import Array
from ccpin.paper import printed
from ccpin.paper.item import ROUNDING, Item, apart
from ccpin.paper.study import Sample, Study

_STEP = 1e-3  # rad, by which the fastest coordinate moves between two of the five points
COMPLEX = 1e-20
"""A complex step: short enough that nothing but rounding is lost."""
SLOPE = "an identity; the derivative beside it is a difference quotient of fourth order, good to about 1e-8 here"


def items(study: Study) -> Iterator[Item]:
    """What holds before any force acts, at the samples of both assembly modes."""
    yield from _free_system(study)
    yield from _parametrisation(study)


def _free_system(study: Study) -> Iterator[Item]:
    free = study.model.free_system

    def motion(one: Sample) -> float:
        q_free = one.state.q_free
        v_free, a_free = one.state.v_free(one.v), one.state.a_free(one.v, one.a)
        whole = study.to_paper(free.inverse_dynamics(q_free, v_free, a_free))
        papers = printed.mass_matrix(one.q_paper) @ study.to_paper(a_free)
        papers += printed.coriolis_matrix(one.q_paper, study.to_paper(v_free)) @ study.to_paper(v_free)
        return apart(whole, papers + printed.gravity(one.q_paper))

    yield Item(
        "Eq. (2)",
        "The free system Σ′, cut open",
        "D′(q′)q̈′ + C′(q′, q̇′)q̇′ + g′(q′) = 0 for the n′ generalized coordinates of the tree that is left when the "
        "loops are cut.",
        "Pinocchio's recursive Newton–Euler algorithm on the cut-open URDF, through `model.free_system`: the whole "
        "left side at once, without its three matrices.",
        "the left side at random q′, q̇′, q̈′ and the sum of the printed (36)–(38)",
        study.largest(motion),
        "N m",
        1e-11,
        ROUNDING,
    )
    constraints = study.mechanism.constraints()
    ranks = {int(np.linalg.matrix_rank(constraints.value(one.state.q_free).jacobian)) for one in study.samples}
    yield Item(
        "Eq. (3)",
        "Loop closures φ(q′) = 0",
        "n′ − n independent scleronomic holonomic constraints; φ_q′ has full rank n′ − n.",
        "`mechanism.constraints()`, from the `<loop>` element of the file: the two rows of a planar loop, the constant "
        "ones dropped by proof.",
        "‖φ(q′)‖ of ccpin's configurations, evaluated by the printed (31)",
        study.largest(lambda one: apart(printed.phi(study.to_paper(one.state.q_free)), np.zeros(2))),
        "m",
        1e-12,
        ROUNDING,
        facts=(("rank of φ_q′ at every sample", ", ".join(map(str, sorted(ranks)))), ("n′ − n", "2")),
    )


def _parametrisation(study: Study) -> Iterator[Item]:
    model, parametrization = study.model, study.model.parametrization
    yield Item(
        "Eq. (7)",
        "Independent coordinates q = α(q′)",
        "Usually the actuated joints: α(q′) = A q′ with A a selection.",
        "`model.alpha`. ccpin orders q′ as Pinocchio does, joint1, joint3, joint2, joint4; this page orders it by "
        "name, as the paper does.",
        "α(σ(q)) and q",
        study.largest(lambda one: apart(model.alpha(one.state.q_free), one.q)),
        "rad",
        1e-13,
        ROUNDING,
    )

    def slopes(one: Sample) -> float:
        steps = one.q_paper[:, None] + 1j * COMPLEX * np.eye(4)
        derivative = np.vstack([np.imag(printed.phi(steps)) / COMPLEX, np.eye(2, 4)])
        ours = study.to_paper(parametrization.psi_jacobian(study.to_free(one.q_paper)))
        return apart(ours, derivative)

    yield Item(
        "Eqs. (9), (10)",
        "ψ = [φ; α] and its Jacobian ψ_q′",
        "The square n′ × n′ Jacobian whose determinant tells V′ from the singular configurations.",
        "`model.parametrization.psi_jacobian`.",
        "ψ_q′ and the derivative of the printed φ (31) along complex steps, exact to rounding",
        study.largest(slopes),
        "m/rad",
        1e-13,
        ROUNDING,
    )

    def returned(one: Sample) -> float:
        away = model.sigma(one.q + [0.05, -0.05], one.state.q_free)
        return apart(study.to_paper(model.sigma(one.q, away)), study.to_paper(one.state.q_free))

    yield Item(
        "Eqs. (11), (12), Lemma II.1",
        "q′ = σ(q), the solution of ψ̄(q′, q) = ψ(q′) − [0; q] = 0",
        "Near a point of V′ there is exactly one q′ = σ(q). It has in general no closed form and is computed by "
        "iterating on (11).",
        "`model.sigma`: Newton's method along a path whose every step is tested; it returns a converged, closed "
        "configuration of the branch or raises an error.",
        "σ(q) before and after a detour to q + (0.05, −0.05) rad",
        study.largest(returned),
        "rad",
        1e-10,
        ROUNDING,
    )
    yield Item(
        "Eq. (13)",
        "q̇′ = ρ(q′) q̇",
        "The velocities of all joints from the independent ones.",
        "`state.v_free(v)`.",
        "ρ q̇ and the slope of σ along q̇, by differences",
        study.largest(lambda one: apart(study.to_paper(one.state.v_free(one.v)), slope(study, one, lambda q: q))),
        "rad/s",
        1e-6,
        SLOPE,
    )
    yield Item(
        "Eq. (14)",
        "ρ = ψ_q′⁻¹ [0; I]",
        "The Jacobian of σ, by one linear solve.",
        "`state.rho`, from the factors of ψ_q′ that Newton's last step left.",
        "ρ and the solution with the printed (33)",
        study.largest(lambda one: apart(study.to_paper(one.state.rho.T).T, printed.rho(one.q_paper))),
        "",
        1e-11,
        ROUNDING,
    )
    yield Item(
        "Eq. (35)",
        "ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ",
        "From differentiating ψ_q′ ρ = [0; I].",
        "`state.rho_dot(v)`.",
        "ρ̇ and the slope of the printed ρ along q̇, by differences",
        study.largest(lambda one: apart(study.to_paper(one.state.rho_dot(one.v).T).T, slope(study, one, printed.rho))),
        "1/s",
        1e-5,
        SLOPE,
    )


def slope(study: Study, one: Sample, function: Callable[[Array], Array]) -> Array:
    """d/dt of a function of the paper's q′ along q̇, by five-point differences of the printed σ."""
    mode = 1 if np.sin(printed.fold(one.q_paper)) > 0 else -1

    def at(step: float) -> Array:
        moved = printed.sigma(one.q + step * one.v, mode)
        turns = np.round((one.q_paper - moved) / (2 * np.pi))  # of angles that wrapped around
        return function(moved + 2 * np.pi * turns)

    h = _STEP / float(np.abs(one.v).max())
    return np.asarray((8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h))
