"""Theorem 3 on the paper's point-to-point experiment: is its start in the set B₂ that the theorem covers?

The gain condition holds on the region 𝒟 used for control, but B₂ must also fit into Ω: its level c is far below the
value of the Lyapunov function at the paper's start. Prints both, c, β and where c is limited, simulates the paper's
motion and one from inside B₂, and draws them.
"""

import sys
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting
from ccpin.control import SetPointCertificate, certify_law, sample_region
from ccpin.simulation import lyapunov_along

OUT = Path("out/theorem3")
REGION = np.radians([[-150.0, -160.0], [-90.0, -100.0]])
Q_START, Q_GOAL = REGION
K_P, K_V = (11.0, 11.0), (0.65, 0.60)
DURATION = 0.8


def main(out: Path = OUT) -> None:
    """Certify, compare with the paper's start, simulate and draw."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    law = ccpin.control.PDSimpleGravity(model, Q_GOAL, K_P, K_V)
    slope = sample_region(model, *REGION, law.q_free_d)
    worst = slope.q[int(np.argmax(slope.norm))]
    print(
        f"gain condition on D: sup |dg/dq| = {slope.norm.max():.3f} N m/rad (sampled), at {_degrees(worst)}; K_p = 11"
    )
    certificate = certify_law(law)
    start = law.lyapunov(Q_START, np.zeros(2))
    print(f"largest level with B2 inside Omega: c >= {certificate.level_domain:.3f} J (proved)")
    print(f"largest level with the gain condition too: c = {certificate.level:.3f} J (proved), limited at")
    print(
        f"  {_degrees(certificate.touch)}; beta = {certificate.beta:.3f} < k_p = {certificate.gain:.3f} N m/rad on B2"
    )
    print(f"V at the paper's start {_degrees(Q_START)}: {start:.3f} J, {_word(certificate.contains(Q_START))}")
    near = _furthest(certificate, Q_START - Q_GOAL)
    print(f"furthest start towards it that is covered: {_degrees(near)}")
    for name, q in (("paper", Q_START), ("inside", near)):
        trajectory = ccpin.simulate(model, law, q, duration=DURATION, sample_period=2e-3)
        history = lyapunov_along(law, trajectory)
        error = np.degrees(np.abs(trajectory.q[-1] - Q_GOAL).max())
        title = f"RPDR from {_degrees(q)}: {_word(certificate.contains(q))}"
        plotting.save(plotting.plot_lyapunov(trajectory.t, history, certificate.level, title), out / f"{name}.png")
        print(f"  simulated from {_degrees(q)}: off by {error:.1e} deg after {DURATION} s")
    plotting.save(plotting.plot_sublevel(certificate, [Q_START, near]), out / "sublevel.png")
    print(f"figures in {out}/")


def _furthest(certificate: SetPointCertificate, direction: np.ndarray) -> np.ndarray:
    """The last position at rest in B2 along a ray from the set point, to 0.1 %."""
    inside, outside = 0.0, 1.0
    while outside - inside > 1e-3:
        middle = 0.5 * (inside + outside)
        covered = certificate.contains(certificate.law.q_d + middle * direction)
        inside, outside = (middle, outside) if covered else (inside, middle)
    return certificate.law.q_d + inside * direction


def _degrees(q: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.2f}°" for value in np.degrees(q)) + ")"


def _word(inside: bool) -> str:
    return "inside B2" if inside else "outside of B2: Theorem 3 does not cover it"


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
