"""What a simulated second of the point-to-point motion costs, beside Pinocchio's constrained dynamics.

Both integrate the same closed loop with SciPy's RK45 at the same tolerances in this process, in turns; the ratio is
what counts on a noisy machine. The peer solves the constrained free system (proximal settings as tight as needed for
planar loops) with Baumgarte stabilisation and drifts; ccpin solves σ at every evaluation and does not.
"""

import time

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import ccpin

START, GOAL = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])
K_P, K_V = np.array([11.0, 11.0]), np.array([0.65, 0.60])
DURATION, RTOL, ATOL, REPEATS = 1.0, 1e-9, 1e-11, 7


def reduced(model: ccpin.ReducedModel, law: ccpin.control.ControlLaw) -> tuple[float, float]:
    """Wall time and closure error of ccpin, samples every millisecond included."""
    began = time.perf_counter()
    motion = ccpin.simulate(model, law, START, duration=DURATION, rtol=RTOL, atol=ATOL)
    return time.perf_counter() - began, float(motion.closure_error.max())


def constrained(model: ccpin.ReducedModel, law: ccpin.control.PDSimpleGravity) -> tuple[float, float]:
    """Wall time and closure error of Pinocchio's constraintDynamics on the free system."""
    mechanism = model.mechanism
    free, data = mechanism.pin_model, mechanism.pin_model.createData()
    loop = mechanism.constraints().loops[0]
    contact = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D,
        free,
        loop.joint_a,
        pin.SE3(loop.frame_a),
        loop.joint_b,
        pin.SE3(loop.frame_b),
        pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
    )
    contact.m_baumgarte_parameters.Kp, contact.m_baumgarte_parameters.Kd = 1e4, 2e2
    contacts = pin.StdVec_RigidConstraintModel()
    contacts.append(contact)
    contact_data = pin.StdVec_RigidConstraintData()
    contact_data.append(contact.createData())
    pin.initConstraintDynamics(free, data, contacts, contact_data)
    settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 10)
    select = np.array([free.idx_qs[free.getJointId(name)] for name in mechanism.independent])
    motors = mechanism.actuation

    def derivative(t: float, state: np.ndarray) -> np.ndarray:
        q_free, v_free = state[: free.nq], state[free.nq :]
        tau = motors.T @ law.torque(t, q_free[select], v_free[select])
        a = pin.constraintDynamics(free, data, q_free, v_free, tau, contacts, contact_data, settings)
        return np.concatenate([v_free, a])

    start = np.concatenate([model.sigma(START), np.zeros(free.nv)])
    began = time.perf_counter()
    times = np.arange(0.0, DURATION + 1e-9, 1e-3)
    found = solve_ivp(derivative, (0.0, DURATION), start, method="RK45", rtol=RTOL, atol=ATOL, t_eval=times)
    spent = time.perf_counter() - began
    phi = mechanism.constraints()
    return spent, max(float(np.linalg.norm(phi.residual(q))) for q in found.y[: free.nq].T)


def main() -> None:
    """Print both costs and their ratio, pair by pair."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    reduced(model, law)
    pairs = [(reduced(model, law), constrained(model, law)) for _ in range(REPEATS)]
    ours, theirs = (np.array([pair[k][0] for pair in pairs]) for k in (0, 1))
    ratios = ours / theirs
    print(f"one simulated second, RK45 at rtol {RTOL:g}, {REPEATS} pairs (median, min–max)")
    for name, spent, k in (("ccpin, reduced model   ", ours, 0), ("Pinocchio, constrained ", theirs, 1)):
        span = f"({spent.min():.3f}–{spent.max():.3f})"
        print(f"  {name} {np.median(spent):.3f} s {span}, ‖φ‖ ≤ {pairs[0][k][1]:.0e}")
    print(f"  ratio ccpin / Pinocchio   {np.median(ratios):.2f} ({ratios.min():.2f}–{ratios.max():.2f})")


if __name__ == "__main__":
    main()
