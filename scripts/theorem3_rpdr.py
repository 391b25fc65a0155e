"""Theorem 3 on the paper's point-to-point experiment: is its start in the set B₂ that the theorem covers?

The gain condition holds on the region 𝒟 used for control, but B₂ must also fit into Ω: its level c is far below the
value of the Lyapunov function at the paper's start. Prints both, c, β and where c is limited, simulates the paper's
motion and one from inside B₂, and draws them.
"""

from pathlib import Path

import numpy as np

import ccpin
from ccpin import paper, plotting
from ccpin.simulation import lyapunov_along

OUT = Path("out/theorem3")
DURATION = 0.8  # s


def main(out: Path = OUT) -> None:
    """Certify, compare with the paper's start, simulate and draw."""
    study = paper.Study()
    found, law = study.theorem3, study.law
    certificate = found.certificate
    print(f"gain condition on D: sup |dg/dq| = {found.slope:.3f} N m/rad (sampled); K_p = {certificate.gain:g}")
    print(f"largest level with B2 inside Omega: c >= {certificate.level_domain:.3f} J (proved)")
    print(f"largest level with the gain condition too: c = {certificate.level:.3f} J (proved), limited at")
    print(f"  {_degrees(certificate.touch)}; beta = {certificate.beta:.6f} < k_p = {certificate.gain:g} N m/rad on B2")
    word = _word(certificate.contains(study.start))
    print(f"V at the paper's start {_degrees(study.start)}: {found.start:.3f} J, {word}")
    print(f"furthest start towards it that is covered: {_degrees(found.near)}")
    if found.move is not None:
        print(f"the paper's start by validated integration: {found.move.verdict}, from {found.move.time:.3f} s")
    for name, q in (("paper", study.start), ("inside", found.near)):
        trajectory = ccpin.simulate(study.model, law, q, duration=DURATION, sample_period=2e-3)
        history = lyapunov_along(law, trajectory)
        error = np.degrees(np.abs(trajectory.q[-1] - study.goal).max())
        title = f"RPDR from {_degrees(q)}: {_word(certificate.contains(q))}"
        plotting.save(plotting.plot_lyapunov(trajectory.t, history, certificate.level, title), out / f"{name}.png")
        print(f"  simulated from {_degrees(q)}: off by {error:.1e} deg after {DURATION} s")
    plotting.save(plotting.plot_sublevel(certificate, [study.start, found.near]), out / "sublevel.png")
    print(f"figures in {out}/")


def _degrees(q: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.2f}°" for value in np.degrees(q)) + ")"


def _word(covered: bool) -> str:
    return "inside B2" if covered else "outside of B2: Theorem 3 does not cover it"


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
