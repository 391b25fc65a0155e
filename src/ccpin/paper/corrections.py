"""What must be read otherwise than the paper prints it, or what it leaves unsaid, each with its evidence."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ccpin.paper import printed
from ccpin.paper.experiments import move_times, poles, why_slower
from ccpin.paper.item import Erratum
from ccpin.paper.move_certificate import Theorem3Facts
from ccpin.paper.robot import determinants
from ccpin.paper.study import CENTRES, GOAL, START, Study


def errata(study: Study) -> Iterator[Erratum]:
    """All of them."""
    yield _determinant(study)
    yield _arctangent(study)
    yield _sign()
    yield _form(study)
    yield _start(study.theorem3)
    yield _repetitive(study)
    yield _order(study)


def _determinant(study: Study) -> Erratum:
    ours, sines = determinants(study).T
    ratio = np.abs(ours / sines)
    spread = float(np.ptp(ratio) / ratio.mean())
    return Erratum(
        "det ψ_q′",
        "det ψ_q′ without the factor a_3a_4",
        "det ψ_q′ = ± a_3a_4 sin(q_1 + q_3 − q_2 − q_4). Where it vanishes is the same.",
        f"Over the samples |det ψ_q′| / |sin(…)| is {ratio.mean():.6f} m² throughout (relative spread {spread:.0e}); "
        f"a_3a_4 = {printed.A[2] * printed.A[3]:.6f} m².",
        float(ratio.mean()),
    )


def _arctangent(study: Study) -> Erratum:
    modes = [(one, 1 if np.sin(printed.fold(one.q_paper)) > 0 else -1) for one in study.samples]
    gaps = [float(np.abs(printed.phi(printed.sigma(one.q, mode, two_quadrants=True))).max()) for one, mode in modes]
    right = max(float(np.abs(printed.phi(one.q_paper)).max()) for one, _ in modes)
    open_ones = sum(gap > 1e-6 for gap in gaps)
    return Erratum(
        "(39), (40)",
        "arctangents of quotients",
        "Four-quadrant arctangents: atan2(B, A), atan2(± √(A^2 + B^2 − C^2), C), atan2(μ + a_4s_24, λ + a_4c_24).",
        f"With arctangents of quotients {open_ones} of {len(gaps)} samples do not close (by up to {max(gaps):.2f} m); "
        f"with four-quadrant ones all do, to {right:.0e} m.",
        max(gaps),
    )


def _sign() -> Erratum:
    flipped = CENTRES * [1.0, -1.0]
    beyond = printed.elbow_distance(flipped) - printed.A[2] - printed.A[3]
    return Erratum(
        "Table I",
        "q_2 with a positive sign",
        "q_2 is negative at all four centres.",
        f"At (−108°, +72°) the elbows are {printed.elbow_distance(flipped[0]):.3f} m apart and links 3 and 4 together "
        f"{printed.A[2] + printed.A[3]:.4f} m long: it cannot be assembled, {1e3 * beyond[0]:.0f} mm short.",
        float(beyond[0]),
    )


def _form(study: Study) -> Erratum:
    found = study.radii
    closest = ", ".join(f"{one.closest:.2f}°" for one in found)
    papers = ", ".join(f"{one.paper:g}°" for one in found)
    return Erratum(
        "Table I",
        "radii without the quadratic form that gave them",
        "Theorem 2's radius depends on how ψ is brought to degree two and on the scales of the unknowns; the formula "
        "is reproduced, the digits are not.",
        f"The closest form found, absolute link angles with unit scales, gives {closest} where the table has {papers}. "
        f"Every printed radius is far inside the exact square ({', '.join(f'{one.exact:.2f}°' for one in found)}), so "
        "none is wrong.",
        found[0].closest,
    )


def _start(found: Theorem3Facts) -> Erratum:
    certificate, move = found.certificate, found.move
    closed = "With python-flint installed, `certify_move` encloses the exact motion from there."
    if move is not None and move.verdict == "proven":
        closed = (
            f"What closes it: `certify_move` encloses the exact motion from the paper's start, proves that it meets no "
            f"singularity and that after {move.time:.3f} s it is inside B_2, where Theorem 3 takes over."
        )
    return Erratum(
        "Theorem 3, Experiment 1",
        "the experiment as an instance of the theorem",
        "The theorem does not reach the experiment's start.",
        f"𝒱 is {found.start:.2f} J at the start, and B_2 reaches up to c = {certificate.level:.2f} J "
        f"({certificate.level_domain:.2f} J by the domain alone). The gain condition holds on 𝒟 (sup ‖∂g/∂q‖ = "
        f"{found.slope:.2f} < 11 N m/rad, sampled), but 𝒟 is no level set. {closed}",
        found.start,
    )


def _repetitive(study: Study) -> Erratum:
    times = move_times(study)
    narrow, slowest = max(one.ideal_narrow for one in times), max(one.bench for one in times)
    slow = {name: poles(study, goal)[0] for name, goal in {"q_f": GOAL, "q_i": START}.items()}
    return Erratum(
        "Experiment 2",
        "each move in under 0.3 s, without a band",
        "Within ±5 % of the move.",
        why_slower(slow, narrow, slowest),
        narrow,
    )


def _order(study: Study) -> Erratum:
    ours = ", ".join(joint.name for joint in study.mechanism.tree.joints)
    return Erratum(
        "q′",
        "q′ = (q_1, q_2, q_3, q_4)",
        f"Not an erratum, but where it shows: Pinocchio orders q′ by depth first, {ours}.",
        "This page puts everything into the paper's order by the joints' names. Beyond it, "
        "`mechanism.tree.joint(name).q` is where a joint sits in q′.",
        0.0,
    )
