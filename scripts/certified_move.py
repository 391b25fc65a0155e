"""The paper's own move (Section IV-B, experiment 1) certified past Theorem 3, by validated integration.

The start has 𝒱 = 13.1 J, more than any certified level set of Theorem 3 around q_d reaches. An enclosure of the exact
trajectory leads from there into {𝒱 < c} on q_d's branch, where Theorem 3 takes over. The level c that settles the
matter is the one `certify_set_point` proves; the others show how the time of arrival depends on it. The last is about
all starts within ±0.5° and ±0.02 rad/s, a robot's homing error: a minute or two. Needs python-flint.
"""

import sys
import time

import numpy as np

import ccpin
from ccpin.validated import certify_move

START, GOAL = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])  # the paper's first move
K_P, K_V = [11.0, 11.0], [0.65, 0.60]  # N m/rad and N m s/rad, the paper's
PRECISION = 128  # bits of the balls' middles
SPREAD = (np.radians(0.5), 0.02)  # rad, rad/s
LEVELS = (2.9, 1.0, 0.1)  # J


def main(*levels: float) -> bool:
    """Certify the move for each case (or each level given) and print a table; True where all are proven."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    certificate = ccpin.control.certify_set_point(model, GOAL, K_P, K_V)
    cases = [(level, 0.0) for level in (certificate.level, *(levels or LEVELS))]
    cases += [] if levels else [(certificate.level, SPREAD)]
    print(f"Theorem 3 is proved for c = {certificate.level:.4f} J (rigorous: {certificate.rigorous})")
    print(f"RPDR from q = (-150°, -160°) at rest to (-90°, -100°), {PRECISION} bits")
    proven = []
    for level, spread in cases:
        began = time.perf_counter()
        arrival = certificate if level == certificate.level else level
        move = certify_move(model, law, START, arrival=arrival, spread=spread, precision=PRECISION)
        spent = time.perf_counter() - began
        enclosure = move.enclosure
        about = f"all starts within ±{np.degrees(SPREAD[0]):g}° and ±{SPREAD[1]:g} rad/s" if spread else "one start"
        print(
            f"  c = {level:g} J {'proven' if move.rigorous else 'as given'}, {about}: {move.verdict}, "
            f"T = {move.time:.4f} s, 𝒱 from {move.lyapunov_start:.4f} to < {move.lyapunov:.4f} J, "
            f"|det ψ_q′| > {enclosure.smallest_determinant:.4f} m², {len(move.tubes)} tubes, {spent:.2f} s"
        )
        proven.append(move.verdict == "proven")
    return all(proven)


if __name__ == "__main__":
    sys.exit(0 if main(*map(float, sys.argv[1:])) else 1)
