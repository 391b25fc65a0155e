"""The Rice Planar Delta Robot: (31)–(40), det ψ_q′, Table II and the drawings of Figs. 1–5."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ccpin.arrays import Array
from ccpin.paper import printed
from ccpin.paper.item import ROUNDING, Drawing, Item, apart
from ccpin.paper.sketches import mechanism_drawings
from ccpin.paper.study import NAMES, Sample, Study

_FREE_ORDER = "Rows and columns are put into the paper's order of q′ by the joints' names."


def items(study: Study) -> Iterator[Item]:
    """The case study's closed forms and parameters."""
    yield _figures(study)
    yield _table_two(study)
    yield from _closures(study)
    yield from _terms(study)
    yield _sigma(study)
    yield _determinant(study)


def _figures(study: Study) -> Item:
    """Figs. 1–5: the mechanism closed, cut open and annotated."""
    model, q_free = study.model, study.model.sigma(np.radians([-112.0, -68.0]))
    mechanism = study.mechanism
    opened = study.to_free(study.to_paper(q_free) + np.radians([0.0, 0.0, -16.0, 14.0]))
    gap = study.mechanism.constraints().residual(opened)
    q_paper = study.to_paper(q_free)
    drawings = mechanism_drawings(q_paper, study.to_paper(opened))
    sizes = ((mechanism.n_free, "n′"), (mechanism.mobility.rank, "rank φ_q′"), (model.n, "n"))
    return Item(
        "Figs. 1–5",
        "Open and closed chains, the robot, cut open and annotated",
        "A planar parallel robot beside a serial one; the RPDR, a five-bar with two motors; the free system with the "
        "loop cut at the end effector, so that the tips E of link 3 and F of link 4 come apart; lengths a_i, centres "
        "of mass l_ci, angles q_i.",
        "`ccpin info rpdr`; the drawings are made from the model's own numbers.",
        "the gap E − F of the drawing on the right of Fig. 2 and the printed φ (31)",
        apart(gap, printed.phi(study.to_paper(opened))),
        "m",
        1e-14,
        ROUNDING,
        facts=(
            *((name, str(value)) for value, name in sizes),
            ("independent and actuated", ", ".join(mechanism.independent)),
            ("q′ as Pinocchio orders it", ", ".join(joint.name for joint in mechanism.tree.joints)),
            ("q′ by name, as here and in the paper", ", ".join(NAMES)),
        ),
        drawings=tuple(Drawing(name, caption, figure) for name, caption, figure in drawings),
    )


def _table_two(study: Study) -> Item:
    tree, model = study.mechanism.tree, study.mechanism.pin_model
    ours = np.zeros((4, 4))
    rotors = np.zeros(4)
    for k, name in enumerate(NAMES):
        joint = tree.joint(name)
        inertia = model.inertias[joint.number]
        ours[k] = inertia.mass, 0.0, inertia.lever[0], inertia.inertia[1, 1]
        rotors[k] = model.armature[joint.v][0]
    for k, length in enumerate(_lengths(study)):
        ours[k, 1] = length
    head = ("link", "m kg", "a m", "l_c m", "I kg m²", "motor kg m²")
    rows = tuple(
        (str(k + 1), *(f"{value:.6g}" for value in ours[k]), f"{rotors[k]:.6g}" if rotors[k] else "–") for k in range(4)
    )
    scale = np.abs(printed.TABLE_II)
    difference = max(
        float((np.abs(ours - printed.TABLE_II) / scale).max()), apart(rotors[:2] / printed.MOTOR, np.ones(2))
    )
    return Item(
        "Table II",
        "Parameters of the robot",
        "Masses, lengths, centres of mass on the links' axes, moments of inertia about the centres of mass; 3.3263e-3 "
        "kg m² of motor and transmission on joints 1 and 2; c = 0.3048 m.",
        "`models/rpdr.urdf`, read back from the loaded mechanism. The motors' inertia is what the file states as "
        "rotors.",
        "relative, over all entries",
        difference,
        "",
        1e-12,
        "the printed digits, exactly: the file repeats them",
        rows=(head, *rows),
    )


def _lengths(study: Study) -> Array:
    """a₁ … a₄ of the loaded mechanism, from where its joints and its loop are."""
    tree, loop = study.mechanism.tree, study.mechanism.constraints().loops[0]
    near = [np.linalg.norm(tree.joint(name).placement[:3, 3]) for name in ("joint3", "joint4")]
    ends = {loop.joint_a: loop.frame_a, loop.joint_b: loop.frame_b}
    far = [np.linalg.norm(ends[tree.joint(name).number][:3, 3]) for name in ("joint3", "joint4")]
    return np.array([near[0], near[1], far[0], far[1]])


def _closures(study: Study) -> Iterator[Item]:
    random = np.random.default_rng(31)
    poses = random.uniform(-np.pi, np.pi, (24, 4))
    constraints, parametrization = study.mechanism.constraints(), study.model.parametrization
    yield Item(
        "Eq. (31)",
        "φ of the RPDR",
        "a_1c_1 + a_3c_13 − c − a_2c_2 − a_4c_24 = 0 and a_1s_1 + a_3s_13 − a_2s_2 − a_4s_24 = 0.",
        "`mechanism.constraints().residual(q_free)`.",
        "both rows at 24 random configurations, closed or not",
        max(apart(constraints.residual(study.to_free(q)), printed.phi(q)) for q in poses),
        "m",
        1e-14,
        ROUNDING,
    )
    yield Item(
        "Eq. (33)",
        "ψ_q′ of the RPDR",
        "The rows of φ_q′ above the selection of q_1 and q_2.",
        f"`model.parametrization.psi_jacobian(q_free)`. {_FREE_ORDER}",
        "all sixteen entries at 24 random configurations, closed or not",
        max(
            apart(study.to_paper(parametrization.psi_jacobian(study.to_free(q))), printed.psi_jacobian(q))
            for q in poses
        ),
        "m/rad",
        1e-14,
        ROUNDING,
    )


def _terms(study: Study) -> Iterator[Item]:
    free = study.model.free_system
    forms: tuple[tuple[str, str, str, str, str, Callable[[Sample], float]], ...] = (
        (
            "(36)",
            "D′ of the RPDR",
            "free_system.mass_matrix",
            "kg m²",
            "With the motors' inertia on d_11 and d_22.",
            lambda one: apart(study.square(free.mass_matrix(one.state.q_free)), printed.mass_matrix(one.q_paper)),
        ),
        (
            "(37)",
            "C′ of the RPDR",
            "free_system.coriolis_matrix",
            "kg m²/s",
            "From Christoffel symbols; h_1 = −m_3a_1l_c3 sin q_3, h_2 = −m_4a_2l_c4 sin q_4.",
            lambda one: apart(
                study.square(free.coriolis_matrix(one.state.q_free, one.state.v_free(one.v))),
                printed.coriolis_matrix(one.q_paper, study.to_paper(one.state.v_free(one.v))),
            ),
        ),
        (
            "(38)",
            "g′ of the RPDR",
            "free_system.gravity",
            "N m",
            "Gravity along −y, g = 9.81 m/s².",
            lambda one: apart(study.to_paper(free.gravity(one.state.q_free)), printed.gravity(one.q_paper)),
        ),
    )
    for number, title, call, unit, says, difference in forms:
        yield Item(
            f"Eq. {number}",
            title,
            f"The closed form. {says}",
            f"`model.{call}`, by Pinocchio. {_FREE_ORDER}",
            "all entries at the samples of both assembly modes",
            study.largest(difference),
            unit,
            1e-12,
            ROUNDING,
        )


def _sigma(study: Study) -> Item:
    def difference(one: Sample) -> float:
        apart_by = study.to_paper(one.state.q_free) - one.q_paper
        return float(np.abs(np.remainder(apart_by + np.pi, 2 * np.pi) - np.pi).max())

    return Item(
        "Eqs. (39), (40)",
        "σ of the RPDR",
        "q_4 and q_3 in closed form; the sign of a root is the assembly mode.",
        "`model.sigma(q, near)` by Newton's method. The modes are told apart by the sign of sin(q_1 + q_3 − q_2 − "
        "q_4); the paper's experiments are in the positive one.",
        "q_3 and q_4 at the samples of both assembly modes, the arctangents read as four-quadrant ones",
        study.largest(difference),
        "rad",
        1e-10,
        ROUNDING,
    )


def determinants(study: Study) -> Array:
    """det ψ_q′ of ccpin and sin(q1 + q3 − q2 − q4), of shape (samples, 2)."""
    jacobian = study.model.parametrization.psi_jacobian
    return np.array(
        [
            (np.linalg.det(study.to_paper(jacobian(one.state.q_free))), np.sin(printed.fold(one.q_paper)))
            for one in study.samples
        ]
    )


def _determinant(study: Study) -> Item:
    ours, sines = determinants(study).T
    factor = float(printed.A[2] * printed.A[3])
    return Item(
        "det ψ_q′",
        "Where the RPDR is singular",
        "det ψ_q′ vanishes where q_1 + q_3 − q_2 − q_4 = kπ: links 3 and 4 stretched (odd k) or on one another (even "
        "k). The printed formula lacks the factor a_3a_4.",
        "The determinant of `model.parametrization.psi_jacobian`.",
        "|det ψ_q′| and a_3a_4 |sin(q_1 + q_3 − q_2 − q_4)|",
        apart(np.abs(ours), factor * np.abs(sines)),
        "m²",
        1e-13,
        ROUNDING,
        facts=(("a_3a_4", f"{factor:.6f} m²"), ("without it apart by a factor", f"{1 / factor:.4f}")),
    )
