"""What an installed wheel must do with nothing but its own dependencies: `python tests/smoke.py`, no test runner.

It builds nothing and needs no compiler, no display and no checkout: the wheel's own models are loaded, moved and drawn.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import ccpin
from ccpin import plotting, visualization


def main() -> None:
    """Identities of models, a motion, a certificate, pictures and the command line."""
    assert Path(ccpin.__file__).parent.parent != Path(__file__).resolve().parents[1] / "src", "a checkout, no wheel"
    assert ccpin.backend().name == "native", ccpin.backend().reason
    for name in ("rpdr", "four_bar", "delta", "stewart", "sarrus", "bennett"):
        model = ccpin.ReducedModel(ccpin.load(name))
        state = model.at(model.alpha(model.mechanism.q_reference))
        assert np.abs(state.D - state.D.T).max() <= 1e-12 * np.abs(state.D).max()
        assert np.linalg.eigvalsh(state.D).min() > 0
    rpdr = ccpin.ReducedModel(ccpin.load("rpdr"))
    v, u = np.array([0.1, 0.2]), np.array([1.0, -1.0])
    a = rpdr.forward_dynamics([-1.9, -1.2], v, u)
    assert np.allclose(rpdr.inverse_dynamics([-1.9, -1.2], v, a), u, atol=1e-12)
    law = ccpin.control.PDSimpleGravity(rpdr, q_d=[-1.57, -1.75], K_p=[11, 11], K_v=[0.65, 0.60])
    motion = ccpin.simulate(rpdr, law, q0=[-2.62, -2.79], duration=1.0)
    assert motion.closure_error.max() < 1e-10
    assert ccpin.domain.kantorovich_radius(rpdr, rpdr.mechanism.q_reference) > 0
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder)
        plotting.save(plotting.plot_motion(motion, rpdr.mechanism), drawn / "motion.png")
        visualization.animate(rpdr.mechanism, motion.t, motion.q_free, drawn / "motion.html")
        assert all(path.stat().st_size > 10_000 for path in drawn.iterdir())
    told = subprocess.run([sys.executable, "-m", "ccpin", "check", "rpdr"], capture_output=True, text=True, check=True)
    assert "sound" in told.stdout
    assert told.stderr == ""
    sys.stdout.write(f"ccpin {ccpin.__version__} on Python {sys.version.split()[0]}: sound\n")


if __name__ == "__main__":
    main()
