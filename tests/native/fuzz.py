"""Ask the compiled core what it must refuse, under AddressSanitizer and UndefinedBehaviorSanitizer.

    python -m tests.native.fuzz [--examples 200] [--seed 0] [--folder build/fuzz]

Builds the core with both sanitizers into a folder of its own, then runs itself again with their library loaded first:
random mechanisms, NaN, wrong sizes, singular and unreachable q through every method, and specifications and runs with
missing keys, wrong lengths and indices out of range, which must raise ValueError. A sanitizer's finding, a crash or
another error ends the process with a status other than 0. Needs CMake, Ninja and nanobind beside a compiler.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np

from tests.native.spoiling import spoil, spoilt_array

ROOT = Path(__file__).resolve().parents[2]
FLAGS = "-fsanitize=address,undefined;-fno-sanitize-recover=undefined;-fno-omit-frame-pointer;-O1;-fno-inline"
FAR = 9.0
PUSHED = ("forward_dynamics", "generalized_force", "inverse_dynamics", "constraint_forces", "bearing_forces",
          "generalized_force_derivatives", "forward_dynamics_derivatives")  # fmt: skip


def build(folder: Path) -> Path:
    """The package beside a core with sanitizers, in a folder of its own.

    Raises:
        SystemExit: Something to build with is missing.
    """
    nanobind = subprocess.run([sys.executable, "-m", "nanobind", "--cmake_dir"], capture_output=True, text=True)
    if nanobind.returncode:
        raise SystemExit("fuzzing needs nanobind: pip install nanobind cmeel-eigen")
    configure = ["cmake", "-G", "Ninja", "-S", str(ROOT / "native"), "-B", str(folder / "build")]
    configure += ["-DCMAKE_BUILD_TYPE=Debug", f"-DCCPIN_FLAGS={FLAGS}", f"-DPython_EXECUTABLE={sys.executable}"]
    configure += [f"-Dnanobind_DIR={nanobind.stdout.strip()}"]
    for command in (configure, ["cmake", "--build", str(folder / "build")]):
        try:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        except FileNotFoundError:
            raise SystemExit("fuzzing needs CMake and Ninja") from None
        except subprocess.CalledProcessError:
            raise SystemExit("the core does not build with sanitizers: does the compiler bring libasan?") from None
    package = folder / "package" / "ccpin"
    package.parent.mkdir(exist_ok=True)
    for name in (path.relative_to(ROOT / "src" / "ccpin") for path in (ROOT / "src" / "ccpin").rglob("*.py")):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_bytes((ROOT / "src" / "ccpin" / name).read_bytes())
    name = "_core" + sysconfig.get_config_var("EXT_SUFFIX")
    (package / "native" / name).write_bytes((folder / "build" / name).read_bytes())
    return package.parent


def libraries() -> str:
    """The sanitizers' shared libraries, as the compiler finds them.

    Raises:
        SystemExit: It has none.
    """
    compiler = os.environ.get("CXX", "c++")
    found = []
    for name in ("libasan.so", "libubsan.so", "libstdc++.so"):
        path = subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True).stdout.strip()
        if not Path(path).is_file():
            raise SystemExit(f"{compiler} has no {name}: install the sanitizers' libraries (Debian: libasan, libubsan)")
        found.append(path)
    return ":".join(found)


def main() -> None:
    """Build, run under the sanitizers, and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--examples", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        raise SystemExit(fuzz(options.examples, options.seed))
    options.folder.mkdir(parents=True, exist_ok=True)
    preload, package = libraries(), build(options.folder.resolve())
    environment = os.environ | {
        "LD_PRELOAD": preload,
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONPATH": os.pathsep.join([str(package), str(ROOT)]),
        "OPENBLAS_NUM_THREADS": "1",
        "CCPIN_BACKEND": "native",
    }
    counts = ["--examples", str(options.examples), "--seed", str(options.seed)]
    command = [sys.executable, __file__, "--inside", *counts]
    raise SystemExit(subprocess.run(command, env=environment, check=False).returncode)


def fuzz(examples: int, seed: int) -> int:
    """Random mechanisms and their specifications spoilt, until one is wrong; how many were asked goes to stdout."""
    from hypothesis import HealthCheck, given, settings
    from hypothesis import seed as seeded
    from hypothesis import strategies as st

    import ccpin
    from ccpin.native._core import Kernel
    from ccpin.native.specification import specification
    from tests.native.fuzz_certificates import ask_for_certificates
    from tests.support.strategies import mechanisms

    asked = {"methods": 0, "refused": 0, "taken": 0, "certificates": 0}

    @seeded(seed)
    @settings(max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(mechanisms(), st.integers(0, 2**32 - 1))
    def one(drawn: Any, draw: int) -> None:
        mechanism, rng = ccpin.load(drawn.description), np.random.default_rng(draw)
        if rng.random() < 0.5:
            names = [name for name in mechanism.tree.names if rng.random() < 0.5]
            with contextlib.suppress(ccpin.errors.CcpinError):
                mechanism = ccpin.load(drawn.description, actuated=names)
        numbers = specification(mechanism)
        kernel = Kernel(numbers)
        asked["methods"] += ask_everything(kernel, numbers, rng)
        asked["certificates"] += ask_for_certificates(mechanism, rng)
        for _ in range(20):
            spoilt = copy.deepcopy(numbers)
            spoil(spoilt, rng)
            try:
                other = Kernel(spoilt)
            except ValueError:
                asked["refused"] += 1
                continue
            asked["taken"] += 1
            ask_everything(other, spoilt, rng)

    one()
    print(", ".join(f"{count} {name}" for name, count in asked.items()))  # noqa: T201
    return 0


def ask_everything(kernel: Any, numbers: dict[str, Any], rng: np.random.Generator) -> int:
    """Every method with sound arguments, then with some of them spoilt; returns how many calls that made."""
    n_q, n, nv = (int(numbers[key]) for key in ("n_q", "n", "nv"))
    motors = n if numbers["direct"] else len(numbers["motors"])
    near = np.array(numbers["reference"], dtype=np.float64)
    calls = 0
    for size in (0.0, 0.1, FAR):
        q = _alpha(numbers) + size * rng.normal(size=n_q)
        v, a, u = rng.normal(size=n), rng.normal(size=n), rng.normal(size=motors)
        Q, V, A, U = (np.tile(x, (3, 1)) for x in (q, v, a, u))
        pushed = np.hstack([rng.integers(1, len(numbers["joints"]) + 1, size=(2, 1)), rng.normal(size=(2, 9))])
        singles = {
            "constraints": (near,), "constraint_rate": (near, rng.normal(size=nv)), "rcond": (near,),
            "sigma": (q, near), "closed_point": (near, q), "blocked": (near, q),
            "terms": (near, v, q), "gravity": (near, q), "regressor": (near, v, a, v, q),
            "forward_dynamics": (near, v, u, q), "generalized_force": (near, v, a, q), "energy": (near, v, q),
            "inverse_dynamics": (near, v, a, q), "transmission": (near, q), "constraint_forces": (near, v, u, q),
            "bearing_forces": (near, v, u, q), "generalized_force_derivatives": (near, v, a, q),
            "forward_dynamics_derivatives": (near, v, u, q),
            "sigma_many": (Q, near, 2), "terms_many": (Q, V, near, 2), "forward_dynamics_many": (Q, V, U, near, 2),
            "generalized_force_many": (Q, V, A, near, 2), "inverse_dynamics_many": (Q, V, A, near, 2),
            "forward_dynamics_derivatives_many": (Q, V, U, near, 2), "regressor_many": (Q, V, A, V, near, 2),
        }  # fmt: skip
        for name in PUSHED:
            singles[f"{name} "] = (*singles[name], pushed)
        for name, arguments in ((name.strip(), arguments) for name, arguments in singles.items()):
            getattr(kernel, name)(*arguments)
            spoilt = list(arguments)
            k = int(rng.integers(len([x for x in spoilt if isinstance(x, np.ndarray)])))
            spoilt[k] = spoilt_array(spoilt[k], rng)
            with contextlib.suppress(TypeError):  # None where an array must be
                getattr(kernel, name)(*spoilt)
            calls += 2
    columns = sum(10 + {1: 5, 4: 4 - (joint[0] == "planar")}.get(joint[2][2], 3) for joint in numbers["joints"])
    calls += _ask_for_runs(kernel, near, (n_q, n, nv, motors, columns), rng)
    return calls


def _ask_for_runs(kernel: Any, near: np.ndarray, sizes: tuple[int, ...], rng: np.random.Generator) -> int:
    """Short runs with each integrator, and with a spoilt law, run or tableau; some that may leave their coordinates."""
    from ccpin.simulation.integration.core_numbers import TABLEAUX

    n_q, n, nv, motors, columns = sizes
    zero, kinds = np.zeros(n * n).tolist(), ["constant", "pd", "pd_gravity", "computed_torque", "pd_plus", "adaptive"]
    law = {"kind": str(rng.choice(kinds)), "start": [0.0] * n_q, "breaks": [], "degree": 0, "coefficients": [],
           "K_p": zero, "K_v": zero, "constant": [0.0] * n,
           "learning": {"known": [0.1] * columns, "basis": [0.1] * (2 * columns), "rates": [0.1] * 2,
                        "lower": [0.5] * 2, "upper": [2.0] * 2, "estimate": [1.0] * 2}}  # fmt: skip
    if law["kind"] == "constant":
        law["constant"] = [0.1] * motors
    leaving = {"most": float(rng.choice([1e-3, 1e3])), "turn": 2.0, "rows": [1.0] * nv, "columns": [1.0] * n}
    run = {"times": np.linspace(0.0, 0.01, 3), "start": np.zeros(n_q + n), "rtol": 1e-6, "atol": 1e-8,
           "max_step": np.inf, "singular_rcond": 1e-7, "goal": [], "band": 0.0, "speed": 0.0, "hold": 0.0,
           "wrenches": None, "sampling": None, "origin": 0.0, "evaluations": 2e4, "seconds": np.inf,
           "begin": 0.0, "until": 0.01, "first_step": float(rng.choice([0.0, 1e-3])),
           "leaving": leaving if rng.random() < 0.5 else None, "friction": None,
           "lower": [-np.inf] * motors, "upper": [float(rng.choice([1e-3, np.inf]))] * motors}  # fmt: skip
    if nv and rng.random() < 0.5:
        count = int(rng.integers(1, nv + 1))
        run["friction"] = {
            "component": rng.permutation(nv)[:count].tolist(), "coordinate": [-1] * count,
            "coulomb": (level := rng.exponential(0.1, count)).tolist(), "viscous": [0.01] * count,
            "breakaway": (level * rng.uniform(1.0, 2.0, count)).tolist(), "stribeck_speed": [0.1] * count,
            "signs": [0.0] * count,
            "rest": rng.integers(0, 2, count).tolist(), "halted": [0] * count, "locked": False,
        }  # fmt: skip
    if rng.random() < 0.5:
        run["wrenches"] = np.hstack([np.ones((1, 1)), rng.normal(size=(1, 9))])
    if run["leaving"] is None and rng.random() < 0.7:
        encoders = [1e-3] * n if rng.random() < 0.5 and n_q == n else []
        run["sampling"] = {
            "period": float(rng.choice([1e-3, 7e-3])), "gain": 0.5, "differentiates": bool(rng.integers(2)),
            "resolution": encoders, "limit": [np.inf] * n, "start": 0.0, "reading": [0.0] * n_q,
            "velocity": [0.0] * n, "held": [0.0] * n, "pending": [0.0] * (n * int(rng.integers(3))), "count": 0,
        }  # fmt: skip
    for tableau in TABLEAUX.values():
        held = kernel.held_motion(kernel, tableau, 1e-6, 1e-8, np.inf, 1e-7, run["wrenches"], leaving)
        held.start(near, _numbers(rng, n_q), _numbers(rng, n), 0.0, float(rng.choice([1e-3, 1e3, np.inf])))
        held.step(_numbers(rng, motors), 1e-3)
        kernel.simulate(near, law, run, tableau)
        arguments = [copy.deepcopy(each) for each in (law, run, dict(tableau))]
        spoil(arguments[int(rng.integers(3))], rng)
        with contextlib.suppress(ValueError):
            kernel.simulate(near, *arguments)
        rows = [np.tile(x, (3, 1)) for x in (np.zeros(n_q), rng.normal(size=n), near)]
        spoilt, k = list(rows), int(rng.integers(3))
        spoilt[k] = spoilt_array(rows[k], rng)
        for told, motion in ((law, rows), (arguments[0], spoilt)):
            with contextlib.suppress(ValueError, TypeError):  # no loop where one must be
                kernel.learnt(told, run["sampling"], np.linspace(0.0, 2e-3, 3), *motion)
    return 6 * len(TABLEAUX)


def _numbers(rng: np.random.Generator, size: int) -> np.ndarray:
    """A vector, and now and then one that is spoilt."""
    x = rng.normal(size=size)
    return spoilt_array(x, rng) if rng.random() < 0.2 else x


def _alpha(numbers: dict[str, Any]) -> np.ndarray:
    """q at the reference, whole joints only: components get 0, which is as good as any number."""
    reference, q = np.array(numbers["reference"]), np.zeros(numbers["n_q"])
    for _, joint, component, (start, _, size, _), _ in numbers["coordinates"]:
        if component < 0:
            window = numbers["joints"][joint - 1][2]
            q[start : start + size] = reference[window[0] : window[0] + size]
    return q


if __name__ == "__main__":
    main()
