"""σ, ρ, ρ̇ of the five-bar against the paper's closed forms, and what σ promises about branches and failures."""

import numpy as np
import pytest

import ccpin
from ccpin.description import Inertia, Joint, Link
from ccpin.errors import ConvergenceError, InvalidInputError, SingularConfigurationError, UnreachableError
from tests.oracles import rpdr as oracle
from tests.oracles.finite_differences import assert_close
from tests.oracles.geometry import wrap
from tests.support.paper import COUNT, MODES, order, to_free, to_paper


def elongations(start, end, count=400):
    return np.array([oracle.elongation(start + s * (end - start)) for s in np.linspace(0.0, 1.0, count)])


@pytest.mark.parametrize("mode", MODES)
def test_closed_forms_in_each_mode(rpdr, rpdr_model, mode):
    """σ (39)-(40), ρ (14) and ρ̇ (35) at random configurations of each assembly mode."""
    rng = np.random.default_rng(31 + mode)
    columns = order(rpdr)
    for expected in oracle.random_configurations(rng, COUNT, mode):
        near = to_free(rpdr, expected + rng.uniform(-1e-3, 1e-3, 4))
        v = rng.normal(size=2)
        q_free = rpdr_model.sigma(expected[:2], near)
        assert_close(wrap(q_free[columns] - expected), np.zeros(4), 1e-10, scale=1.0)
        rho = oracle.rho(expected)
        assert_close(rpdr_model.rho(q_free)[columns], rho, 1e-10)
        assert_close(
            rpdr_model.rho_dot(q_free, rpdr_model.rho(q_free) @ v)[columns], oracle.rho_dot(expected, v), 1e-10
        )


def test_constraints_are_the_papers(rpdr):
    """φ is (31) and ψ_q′ is (33), at configurations that are not closed."""
    rng = np.random.default_rng(33)
    parametrization, columns = rpdr.parametrization(), order(rpdr)
    for q_paper in rng.uniform(-np.pi, np.pi, (50, 4)):
        q_free = to_free(rpdr, q_paper)
        assert_close(parametrization.constraints.residual(q_free), oracle.phi(q_paper), 1e-14)
        assert_close(parametrization.psi_jacobian(q_free)[:, columns], oracle.psi_jacobian(q_paper), 1e-14)


def test_without_near_the_mode_is_the_references(rpdr, rpdr_model):
    """σ follows the line from the reference where the closed-form domain holds it, and raises where it does not."""
    rng = np.random.default_rng(40)
    start, reached, blocked = rpdr_model.alpha(rpdr.q_reference), 0, 0
    for q in rng.uniform(-np.pi, np.pi, (100, 2)):
        longest = elongations(start, q).max()
        if longest < 0.999:
            q_paper = to_paper(rpdr, rpdr_model.sigma(q))
            assert_close(wrap(q_paper - oracle.sigma(q, 1)), np.zeros(4), 1e-9, scale=1.0)
            reached += 1
        elif longest > 1.001:
            with pytest.raises(ConvergenceError):
                rpdr_model.sigma(q)
            blocked += 1
    assert min(reached, blocked) > 20


def test_far_configurations_never_change_the_mode_silently(rpdr, rpdr_model):
    """From any closed configuration, σ keeps its sign of sin(q1 + q3 − q2 − q4) or raises."""
    rng = np.random.default_rng(41)
    for mode in MODES:
        for near in oracle.random_configurations(rng, 20, mode, away=1e-3):
            q = rng.uniform(-np.pi, np.pi, 2)
            try:
                q_free = rpdr_model.sigma(q, to_free(rpdr, near))
            except (UnreachableError, SingularConfigurationError):
                continue
            q_paper = to_paper(rpdr, q_free)
            assert np.sin(oracle.fold(q_paper)) * mode > 0
            assert np.abs(oracle.phi(q_paper)).max() <= 1e-10
            np.testing.assert_allclose(q_paper[:2], q, rtol=0, atol=1e-12)


def test_random_closed_paths_end_where_they_began(rpdr, rpdr_model):
    """Following σ along closed paths in small steps returns to the start, modulo whole turns of q3 and q4."""
    rng = np.random.default_rng(42)
    for _ in range(20):
        centre = rng.uniform([-2.4, -2.5], [-1.8, -1.9])
        amplitude, phase = rng.normal(scale=0.2, size=(2, 3, 2)), rng.uniform(0.0, 2.0 * np.pi, (3, 2))

        def path(t, centre=centre, amplitude=amplitude, phase=phase):
            k = np.arange(1, 4)[:, None]
            return centre + (amplitude[0] * np.sin(k * t + phase) - amplitude[0] * np.sin(phase)).sum(axis=0)

        times = np.linspace(0.0, 2.0 * np.pi, 200)
        if max(oracle.elongation(path(t)) for t in times) > 0.99:
            continue
        first = here = rpdr_model.sigma(path(0.0))
        for t in times[1:]:
            here = rpdr_model.sigma(path(t), here)
            assert np.sin(oracle.fold(to_paper(rpdr, here))) > 0
        assert_close(wrap(here - first), np.zeros(4), 1e-10, scale=1.0)


def test_blocked_line_is_reported_with_where_it_ends(rpdr, rpdr_model):
    """Beyond the stretched limit UnreachableError says how far σ came: up to the closed-form boundary."""
    start, q = rpdr_model.alpha(rpdr.q_reference), np.array([-np.pi, 0.0])
    with pytest.raises(UnreachableError, match="blocked") as caught:
        rpdr_model.sigma(q)
    error = caught.value
    assert 0.0 < error.fraction < 1.0
    np.testing.assert_array_equal(error.q, q)
    np.testing.assert_allclose(error.q_reached, start + error.fraction * (q - start), rtol=0, atol=1e-9)
    assert oracle.elongation(error.q_reached) == pytest.approx(1.0, abs=1e-6)
    assert 0.0 < error.rcond < 1e-3


@pytest.mark.parametrize("sign", MODES)
@pytest.mark.parametrize("mode", MODES)
def test_coincident_elbows_are_singular(rpdr, rpdr_model, sign, mode):
    """At ±(56.944°, 123.056°) σ raises from any side, and ρ raises at every closed configuration there."""
    q = sign * oracle.coincident_elbows()
    np.testing.assert_allclose(np.rad2deg(q), sign * np.array([56.944, 123.056]), rtol=0, atol=5e-4)
    rng = np.random.default_rng(44)
    for offset in rng.normal(scale=0.05, size=(4, 2)):
        near = oracle.sigma(q + offset, mode)
        with pytest.raises(SingularConfigurationError):
            rpdr_model.sigma(q, to_free(rpdr, near))
    for angle in rng.uniform(-np.pi, np.pi, 4):
        q_paper = np.array([q[0], q[1], angle - q[0], angle - q[1]])
        assert np.abs(oracle.phi(q_paper)).max() < 1e-15
        with pytest.raises(SingularConfigurationError) as caught:
            rpdr_model.rho(to_free(rpdr, q_paper))
        assert caught.value.rcond < 1e-10
        with pytest.raises(SingularConfigurationError):
            rpdr_model.sigma(q, to_free(rpdr, q_paper))


def test_stretched_boundary_is_singular(rpdr, rpdr_model):
    """Where links 3 and 4 are in one line σ raises SingularConfigurationError, just inside it does not."""
    towards = np.array([-np.pi, 0.0])
    start = rpdr_model.alpha(rpdr.q_reference)
    inside, outside = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (inside + outside)
        if oracle.elongation(start + middle * (towards - start)) < 1.0:
            inside = middle
        else:
            outside = middle
    with pytest.raises(SingularConfigurationError, match="singular"):
        rpdr_model.sigma(start + inside * (towards - start))
    q = start + (inside - 1e-4) * (towards - start)
    assert_close(wrap(to_paper(rpdr, rpdr_model.sigma(q)) - oracle.sigma(q, 1)), np.zeros(4), 1e-9, scale=1.0)


def test_results_do_not_depend_on_call_history(rpdr):
    """A model that has seen other calls, failures among them, answers bit for bit as a fresh one."""
    rng = np.random.default_rng(45)
    used = ccpin.ReducedModel(rpdr)
    targets = rng.uniform([-2.6, -2.7], [-1.6, -1.8], (20, 2))
    fresh = [ccpin.ReducedModel(rpdr).terms(q, q) for q in targets]
    for q, expected in zip(targets, fresh, strict=True):
        with pytest.raises(ConvergenceError):
            used.sigma([-np.pi, 0.0])
        used.forward_dynamics(targets[0], [1.0, 2.0], [3.0, 4.0], fresh[1].q_free)
        for a, b in zip(used.terms(q, q), expected, strict=True):
            np.testing.assert_array_equal(a, b)


def test_arguments_are_left_alone(rpdr, rpdr_model):
    """σ changes neither q nor `near`, and what it returns is the caller's own."""
    q, near = np.array([-1.8, -1.9]), rpdr.q_reference.copy()
    first = rpdr_model.sigma(q, near)
    np.testing.assert_array_equal(q, [-1.8, -1.9])
    np.testing.assert_array_equal(near, rpdr.q_reference)
    kept = first.copy()
    rpdr_model.sigma([-2.0, -2.2])
    np.testing.assert_array_equal(first, kept)
    rpdr_model.sigma(near[[0, 2]], near)[:] = 0.0
    np.testing.assert_array_equal(near, rpdr.q_reference)


def test_the_reference_is_safe_from_its_callers(rpdr):
    """Writing into σ of the reference's own q leaves the mechanism's reference as it was."""
    model, kept = ccpin.ReducedModel(rpdr), rpdr.q_reference.copy()
    found = model.sigma(model.alpha(rpdr.q_reference))
    try:
        found[:] = 7.0
        np.testing.assert_array_equal(rpdr.q_reference, kept)
    finally:
        if not np.array_equal(rpdr.q_reference, kept):
            rpdr.q_reference[:] = kept


def test_open_configurations_are_closed_or_refused(rpdr, rpdr_model):
    """A slightly open configuration picks its branch; one too far open for that raises instead of choosing one."""
    for mode in MODES:
        expected = oracle.sigma(np.array([-2.0, -2.1]), mode)
        far = np.array([-2.4, -2.3])
        found = rpdr_model.sigma(far, to_free(rpdr, expected + [0.0, 0.0, 1e-2, -1e-2]))
        assert_close(wrap(to_paper(rpdr, found) - oracle.sigma(far, mode)), np.zeros(4), 1e-10, scale=1.0)
    hopeless = np.array([np.pi, 0.0, 0.0, 0.0])  # arms stretched away from each other
    with pytest.raises(InvalidInputError, match="near is open"):
        rpdr_model.sigma([np.pi, 0.0], to_free(rpdr, hopeless))


def test_near_turned_end_for_end_is_refused():
    """A configuration at which a planar closure's normals oppose each other satisfies φ = 0 but is not closed."""
    body = Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))
    joints = (
        Joint("a", "revolute", "base", "link_a"),
        Joint("slide", "prismatic", "link_a", "carriage", axis=np.array([0.0, 0.0, 1.0])),
        Joint("b", "revolute", "base", "link_b"),
    )
    links = (Link("base"), *(Link(name, body) for name in ("link_a", "carriage", "link_b")))
    closure = ccpin.LoopClosure("face", "planar", "carriage", "link_b")
    mechanism = ccpin.load(ccpin.MechanismDescription("faces", "base", links, joints, (closure,)), independent=["a"])
    model, turned = ccpin.ReducedModel(mechanism), np.array([0.3, 0.0, 0.3 + np.pi])
    assert np.abs(mechanism.constraints().residual(turned)).max() < 1e-15
    np.testing.assert_allclose(model.sigma([0.3]), [0.3, 0.0, 0.3], rtol=0, atol=1e-12)
    with pytest.raises(InvalidInputError, match="end for end"):
        model.sigma([0.4], turned)
