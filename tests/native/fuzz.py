"""Ask the compiled core what it must refuse, under AddressSanitizer and UndefinedBehaviorSanitizer.

    python -m tests.native.fuzz [--examples 200] [--seed 0] [--folder build/fuzz]

Builds the core with both sanitizers into a folder of its own, then runs itself again with their library loaded first:
random mechanisms, NaN, wrong sizes, singular and unreachable q through every method, and specifications and runs with
missing keys, wrong lengths and indices out of range, which must raise ValueError; also laws, estimates and friction of
absurd size, from two threads, and interrupted. A sanitizer's finding, a crash or another error ends the process with a
status other than 0. Needs CMake, Ninja and nanobind beside a compiler.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import os
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.native.spoiling import spoil, spoilt_array
from tests.support.alarms import alarm

ROOT = Path(__file__).resolve().parents[2]
FLAGS = "-fsanitize=address,undefined;-fno-sanitize-recover=undefined;-fno-omit-frame-pointer;-O1;-fno-inline"
FAR = 9.0
EXTREMES = (0.0, 1e-300, 0.1, 1.0, 1e8)
WILD = (*EXTREMES, 1e300)
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
        rng = np.random.default_rng(draw)
        description = _rubbing(drawn.description, rng)
        mechanism = ccpin.load(description)
        if rng.random() < 0.5:
            names = [name for name in mechanism.tree.names if rng.random() < 0.5]
            with contextlib.suppress(ccpin.errors.CcpinError):
                mechanism = ccpin.load(description, actuated=names)
        numbers = specification(mechanism)
        kernel = Kernel(numbers)
        asked["methods"] += ask_everything(kernel, numbers, rng) + ask_at_once(kernel, numbers, rng)
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


def _rubbing(description: Any, rng: np.random.Generator) -> Any:
    """The description with dampers, springs and dry friction in some of its joints, Stribeck speeds of all sizes."""
    joints = list(description.joints)
    for k in np.flatnonzero(rng.random(len(joints)) < 0.5):
        speed = float(rng.choice([0.0, *EXTREMES[1:]]))
        physics = {"damping": 0.1, "friction": 0.2, "stribeck_speed": speed, "breakaway": 0.3 if speed else 0.0}
        spring = {"stiffness": 2.0, "spring_reference": 0.1} if joints[k].kind in ("revolute", "prismatic") else {}
        joints[k] = joints[k] if joints[k].kind == "fixed" else replace(joints[k], **physics, **spring)
    return replace(description, joints=tuple(joints))


def ask_everything(kernel: Any, numbers: dict[str, Any], rng: np.random.Generator) -> int:
    """Every method with sound arguments, then with some of them spoilt; returns how many calls that made."""
    n_q, n, nv = (int(numbers[key]) for key in ("n_q", "n", "nv"))
    motors = _motors(numbers)
    near = np.array(numbers["reference"], dtype=np.float64)
    calls = 0
    for size in (0.0, 0.1, FAR):
        q = _alpha(numbers) + size * rng.normal(size=n_q)
        v, a, u, v_r = rng.normal(size=n), rng.normal(size=n), rng.normal(size=motors), _wild(rng, n)
        Q, V, A, U, V_r = (np.tile(x, (3, 1)) for x in (q, v, a, u, v_r))
        pushed = np.hstack([rng.integers(1, len(numbers["joints"]) + 1, size=(2, 1)), rng.normal(size=(2, 9))])
        singles = {
            "constraints": (near,), "constraint_rate": (near, rng.normal(size=nv)), "rcond": (near,),
            "sigma": (q, near), "closed_point": (near, q), "blocked": (near, q),
            "terms": (near, v, q), "gravity": (near, q), "regressor": (near, v, a, v_r, q),
            "forward_dynamics": (near, v, u, q), "generalized_force": (near, v, a, q), "energy": (near, v, q),
            "inverse_dynamics": (near, v, a, q), "transmission": (near, q), "constraint_forces": (near, v, u, q),
            "bearing_forces": (near, v, u, q), "generalized_force_derivatives": (near, v, a, q),
            "forward_dynamics_derivatives": (near, v, u, q),
            "sigma_many": (Q, near, 2), "terms_many": (Q, V, near, 2), "forward_dynamics_many": (Q, V, U, near, 2),
            "generalized_force_many": (Q, V, A, near, 2), "inverse_dynamics_many": (Q, V, A, near, 2),
            "forward_dynamics_derivatives_many": (Q, V, U, near, 2), "regressor_many": (Q, V, A, V_r, near, 2),
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
    calls += _ask_for_runs(kernel, numbers, rng)
    return calls


def ask_at_once(kernel: Any, numbers: dict[str, Any], rng: np.random.Generator) -> int:
    """A long batch from two threads, which must agree, then interrupted, as is a run of a law that learns."""
    from ccpin.simulation.integration.core_numbers import TABLEAUX

    n_q, n, near = int(numbers["n_q"]), int(numbers["n"]), np.array(numbers["reference"], dtype=np.float64)
    Q = _alpha(numbers) + 0.01 * rng.normal(size=(300, n_q))
    rows = (Q, *rng.normal(size=(3, 300, n)), near, 2)
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(lambda _: kernel.regressor_many(*rows), range(2))
    assert (first is None) == (second is None)
    for one, other in zip(first or (), second or (), strict=True):
        np.testing.assert_array_equal(one, other)
    law, run = _law(numbers, rng) | {"kind": "adaptive", "constant": [0.0] * n}, _run(numbers, rng)
    run |= {"leaving": None, "sampling": _sampling(numbers, rng), "until": 1.0, "times": np.linspace(0.0, 1.0, 3)}
    samples = np.linspace(0.0, 1.0, 3000), *(np.tile(x, (3000, 1)) for x in (_alpha(numbers), np.zeros(n), near))
    asked = (
        lambda: kernel.regressor_many(*rows),
        lambda: kernel.simulate(near, law, run, TABLEAUX["RK45"]),
        lambda: kernel.learnt(law, run["sampling"], *samples),
    )
    for ask in asked:
        with contextlib.suppress(KeyboardInterrupt), alarm(rng.exponential(2e-2)):
            ask()
    return 2 + len(asked)


def _ask_for_runs(kernel: Any, numbers: dict[str, Any], rng: np.random.Generator) -> int:
    """Short runs with each integrator, and with a spoilt law, run or tableau; some that may leave their coordinates."""
    from ccpin.simulation.integration.core_numbers import TABLEAUX

    near, law, run = np.array(numbers["reference"], dtype=np.float64), _law(numbers, rng), _run(numbers, rng)
    n_q, n = len(law["start"]), int(numbers["n"])
    for tableau in TABLEAUX.values():
        held = kernel.held_motion(kernel, tableau, 1e-6, 1e-8, np.inf, 1e-7, run["wrenches"], _leaving(numbers, rng))
        held.start(near, _numbers(rng, n_q), _numbers(rng, n), 0.0, float(rng.choice([1e-3, 1e3, np.inf])))
        held.step(_numbers(rng, _motors(numbers)), 1e-3)
        kernel.simulate(near, law, run, tableau)
        arguments = [copy.deepcopy(each) for each in (law, run, dict(tableau))]
        spoil(arguments[int(rng.integers(3))], rng)
        with contextlib.suppress(ValueError):
            kernel.simulate(near, *arguments)
        rows = [np.tile(x, (3, 1)) for x in (_alpha(numbers), rng.normal(size=n), near)]
        spoilt, k = list(rows), int(rng.integers(3))
        spoilt[k] = spoilt_array(rows[k], rng)
        for told, motion in ((law, rows), (arguments[0], spoilt)):
            with contextlib.suppress(ValueError, TypeError):  # a spoilt law, or none at all
                kernel.learnt(told | {"kind": "adaptive"}, _sampling(numbers, rng), np.linspace(0.0, 2e-3, 3), *motion)
    return 6 * len(TABLEAUX)


def _law(numbers: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A law of a random kind, its gains and what it learns of all sizes."""
    n, columns = int(numbers["n"]), _columns(numbers)
    kind = str(rng.choice(["constant", "pd", "pd_gravity", "computed_torque", "pd_plus", "adaptive"]))
    lower, upper = np.sort(_wild(rng, (2, 2)), axis=0)
    learning = {"known": [0.1] * columns, "basis": _wild(rng, 2 * columns), "rates": abs(_wild(rng, 2)),
                "lower": lower, "upper": upper, "estimate": _wild(rng, 2)}  # fmt: skip
    return {"kind": kind, "start": _alpha(numbers).tolist(), "breaks": [], "degree": 0, "coefficients": [],
            "K_p": _wild(rng, n * n).tolist(), "K_v": _wild(rng, n * n).tolist(),
            "constant": [0.1] * _motors(numbers) if kind == "constant" else [0.0] * n,
            "learning": {name: list(each) for name, each in learning.items()}}  # fmt: skip


def _run(numbers: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A short run from rest: some leave their coordinates, some are sampled, some rub."""
    n, nv, motors, q = int(numbers["n"]), int(numbers["nv"]), _motors(numbers), _alpha(numbers)
    run = {"times": np.linspace(0.0, 0.01, 3), "start": np.concatenate([q, np.zeros(n)]), "rtol": 1e-6, "atol": 1e-8,
           "max_step": np.inf, "singular_rcond": 1e-7, "goal": [], "band": 0.0, "speed": 0.0, "hold": 0.0,
           "wrenches": None, "sampling": None, "origin": 0.0, "evaluations": 2e3, "seconds": np.inf,
           "begin": 0.0, "until": 0.01, "first_step": float(rng.choice([0.0, 1e-3])),
           "leaving": _leaving(numbers, rng) if rng.random() < 0.5 else None, "friction": None,
           "lower": [-np.inf] * motors, "upper": [float(rng.choice([1e-3, np.inf]))] * motors}  # fmt: skip
    if nv and rng.random() < 0.5:
        count = int(rng.integers(1, nv + 1))
        run["friction"] = {
            "component": rng.permutation(nv)[:count].tolist(), "coordinate": [-1] * count,
            "coulomb": (level := abs(_wild(rng, count))).tolist(), "viscous": rng.choice(WILD, count).tolist(),
            "breakaway": (level * rng.uniform(1.0, 2.0, count)).tolist(),
            "stribeck_speed": rng.choice(WILD[1:], count).tolist(),
            "signs": [0.0] * count,
            "rest": rng.integers(0, 2, count).tolist(), "halted": [0] * count, "locked": False,
        }  # fmt: skip
    if rng.random() < 0.5:
        run["wrenches"] = np.hstack([np.ones((1, 1)), rng.normal(size=(1, 9))])
    if run["leaving"] is None and rng.random() < 0.7:
        run["sampling"] = _sampling(numbers, rng)
    return run


def _leaving(numbers: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """When coordinates are left: at once, or hardly ever."""
    rows, columns = [1.0] * int(numbers["nv"]), [1.0] * int(numbers["n"])
    return {"most": float(rng.choice([1e-3, 1e3])), "turn": 2.0, "rows": rows, "columns": columns}


def _sampling(numbers: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A loop of a few milliseconds, some with encoders or delays."""
    n, q = int(numbers["n"]), _alpha(numbers)
    return {"period": float(rng.choice([1e-3, 7e-3])), "gain": 0.5, "differentiates": bool(rng.integers(2)),
            "resolution": [1e-3] * n if rng.random() < 0.5 and len(q) == n else [], "limit": [np.inf] * n, "start": 0.0,
            "reading": q.tolist(), "velocity": [0.0] * n, "held": [0.0] * n,
            "pending": [0.0] * (n * int(rng.integers(3))), "count": 0}  # fmt: skip


def _wild(rng: np.random.Generator, shape: Any) -> np.ndarray:
    """Numbers of one size, ordinary as often as absurd."""
    return rng.normal(size=shape) * (rng.choice(WILD) if rng.random() < 0.5 else 1.0)


def _motors(numbers: dict[str, Any]) -> int:
    return int(numbers["n"]) if numbers["direct"] else len(numbers["motors"])


def _columns(numbers: dict[str, Any]) -> int:
    """How many constants a mechanism has: ten a body, and those of its joint."""
    count = 0
    for kind, _, (*_, nq, _), *_, stribeck_speed in numbers["joints"]:
        count += 10 + {1: 5, 4: 4 - (kind == "planar")}.get(nq, 3) + (stribeck_speed > 0.0)
    return count


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
