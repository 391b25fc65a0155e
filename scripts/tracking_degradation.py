"""How tracking degrades on line: with the sampling period, and with a numerical error in σ.

Computed torque and PD+ follow a quintic reference on the RPDR and on a Delta. First as a digital controller runs
them, σ warm-started once a sample under a hard cap on Newton steps; then continuously, with σ(q) off by a vector of
known size in the dependent coordinates, beside the bound that `certify_tracking` proves for every error of that size.
Writes the curves and their numbers to out/tracking_degradation.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

import ccpin
from ccpin import plotting
from ccpin.control import (
    ComputedTorque,
    OnlineLaw,
    OnlineSigma,
    PDPlus,
    PointToPoint,
    Sampling,
    WithSigmaError,
    certify_tracking,
)
from ccpin.files import write_atomically
from ccpin.plotting import COLOURS, STYLE

OUT = Path("out/tracking_degradation")
PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3)  # s between samples of the law
SIGMA_ERRORS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)  # rad, of the dependent coordinates
MAX_NEWTON_STEPS = 3  # a sample, of σ on line
MOVE, DURATION = 0.3, 0.4  # s: of the move, and of what is simulated
OPTIONS = {"duration": DURATION, "rtol": 1e-7, "atol": 1e-9, "sample_period": 5e-3}


class Case(NamedTuple):
    """A robot, its move, PD+'s gains, computed torque's ω (K_p = ω², K_v = 2ω), and the certificates' cells."""

    robot: str
    start: np.ndarray
    goal: np.ndarray
    K_p: float
    K_v: float
    omega: float
    cells: int


CASES = (
    Case("rpdr", np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0]), 11.0, 0.65, 20.0, 192),
    Case("delta", np.array([-0.2, 0.1, 0.0]), np.array([0.4, -0.1, 0.3]), 300.0, 25.0, 20.0, 64),
)


def laws(model, case):
    """The two laws that track exactly when computed exactly."""
    reference, n = PointToPoint(model, case.start, case.goal, MOVE), model.n
    return {
        "computed torque": ComputedTorque(model, reference, [case.omega**2] * n, [2 * case.omega] * n),
        "PD+": PDPlus(model, reference, [case.K_p] * n, [case.K_v] * n),
    }


def largest_error(law, motion):
    """Largest |q_d − q| of the samples, radians; not a number where the motion did not finish."""
    if motion.status != "finished":
        return float("nan")
    return max(float(np.abs(law.error(t, q)).max()) for t, q in zip(motion.t, motion.q, strict=True))


def sampled(model, law, case, period):
    """Tracking error of the law run at a period, and how σ went."""
    online = OnlineSigma(model, model.sigma(case.start), max_newton_steps=MAX_NEWTON_STEPS)
    motion = ccpin.simulate(model, OnlineLaw(law, online), case.start, sampling=Sampling(period), **OPTIONS)
    report = online.report()
    return {"period": period, "error": largest_error(law, motion), "steps": report.most_steps, "held": report.held}


def with_sigma_error(model, law, case, size):
    """Tracking error of the law with σ off by a vector of that norm (rad, m) in the dependent coordinates."""
    direction = np.random.default_rng(1).normal(size=model.mechanism.n_free)
    direction[np.abs(model.coordinates.jacobian(model.mechanism.q_reference)).max(axis=0) > 0] = 0.0
    offset = size * direction / np.linalg.norm(direction)
    motion = ccpin.simulate(model, WithSigmaError(law, offset), case.start, **OPTIONS)
    return {"sigma_error": size, "error": largest_error(law, motion)}


def bounds(law, case):
    """The proved bounds of the tracking error, of growing errors of σ, up to the first that is not proved."""
    rows = []
    for size in SIGMA_ERRORS:
        proof = certify_tracking(law, size, cells=case.cells)
        if proof.verdict != "proven":
            return rows, f"σ off by {size:.0e}: {proof.reason}"
        rows.append({"sigma_error": size, "error": float(proof.error.max())})
    return rows, ""


def curves(case):
    """The curves of both laws on one robot."""
    model = ccpin.ReducedModel(ccpin.load(case.robot))
    found = {}
    for name, law in laws(model, case).items():
        proved, stopped = bounds(law, case)
        found[name] = {
            "sampled": [sampled(model, law, case, period) for period in PERIODS],
            "sigma": [with_sigma_error(model, law, case, size) for size in SIGMA_ERRORS],
            "bound": proved,
            "bound_ends": stopped,
        }
    return found


def draw(results):
    """Tracking error against period, and against the size of the σ error with the proved bounds."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10.5, 4.6), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        for k, (robot, by_law) in enumerate(results.items()):
            for name, found in by_law.items():
                style = {"color": COLOURS[k], "linestyle": "-" if name == "PD+" else "--", "marker": "o"}
                label = f"{ {'rpdr': 'RPDR', 'delta': 'Delta'}[robot] }, {name}"
                left.plot(*_columns(found["sampled"], "period", 1e3), label=label, **style)
                right.plot(*_columns(found["sigma"], "sigma_error", 1.0), **style)
                right.plot(*_columns(found["bound"], "sigma_error", 1.0), **style | {"marker": "v", "alpha": 0.45})
        for marker, alpha, text in (("v", 0.45, "proved, any error of that norm"), ("o", 1.0, "one error, measured")):
            right.plot([], [], color="0.3", marker=marker, alpha=alpha, label=text)
        right.legend(loc="best", framealpha=0.85, edgecolor="none")
        for panel, text in ((left, "sampling period [ms]"), (right, "norm of the error in σ [rad, m]")):
            panel.set_xscale("log")
            panel.set_yscale("log")
            panel.set_xlabel(text)
        left.set_xticks([1e3 * period for period in PERIODS], [f"{1e3 * period:g}" for period in PERIODS])
        left.minorticks_off()
        left.set_ylabel("largest tracking error [°]")
        left.legend(loc="best", framealpha=0.85, edgecolor="none")
        figure.suptitle(f"Tracking a {MOVE:g} s move: sampled with σ on line (left), σ in error (right)")
    return figure


def _columns(rows, key, scale):
    return [scale * row[key] for row in rows], [np.degrees(row["error"]) for row in rows]


def main(out: Path = OUT) -> None:
    """Compute the curves of both robots and write figure and numbers."""
    results = {case.robot: curves(case) for case in CASES}
    write_atomically(out / "curves.json", "w", lambda file: json.dump(results, file, indent=2))
    plotting.save(draw(results), out / "curves.png")
    for robot, by_law in results.items():
        for name, found in by_law.items():
            print(f"{robot}, {name}")
            for row in found["sampled"]:
                print(
                    f"  {1e3 * row['period']:4.1f} ms: error {np.degrees(row['error']):.2e}°, "
                    f"at most {row['steps']} Newton steps, σ held {row['held']} times"
                )
            for row in found["sigma"]:
                print(f"  σ off by {row['sigma_error']:.0e}: error {np.degrees(row['error']):.2e}°")
            for row in found["bound"]:
                print(f"  σ off by {row['sigma_error']:.0e}: proved error below {np.degrees(row['error']):.2e}°")
            if found["bound_ends"]:
                print(f"  not proved: {found['bound_ends']}")
    print(f"figure and numbers in {out}/")


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
